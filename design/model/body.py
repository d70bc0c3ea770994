"""The two-link biped as checked numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from design.errors import BadInput


@dataclass(frozen=True, kw_only=True)
class Biped:
    """Body and flat, symmetric foot, in SI units, standing under gravity ``g``."""

    M: float  # mass of the body [kg]
    L: float  # ankle to centre of gravity [m]
    I: float  # inertia of the body about the ankle [kg m²]
    m: float  # mass of the foot [kg]
    ell: float  # ankle to toe, ankle to heel [m]
    g: float = 9.81  # [m/s²]

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            lowest = 0.0 if field.name == "m" else math.ulp(0.0)
            if not (math.isfinite(value) and value >= lowest):
                message = f"is {value}; needs a finite number {'>=' if field.name == 'm' else '>'} 0"
                raise BadInput(message, key=f"Biped.{field.name}")

    @property
    def weight(self) -> float:
        """Weight of body and foot, (M + m) g [N]."""
        return (self.M + self.m) * self.g
