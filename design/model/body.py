"""The two-link biped as checked numbers.

The paper's foot is symmetric, its ankle on the ground. Here the ankle may be nearer to one end, and above the ground:
ell is half the length of the foot, and the distances to toe and heel are ell (1 + skew) and ell (1 - skew), so that a
foot that is scaled, ``replace(biped, ell=...)``, keeps its shape. The foot's weight acts in the middle of its length.

On a slope the external force of (21) is gravity's, which acts on the foot's mass as well, m/M times. The paper leaves
that out of (5) and (6). With ``ground_loads`` it is counted: the foot then weighs m g - kappa F_y, kappa = m/M, which
on a slope is m g cos(alpha). The foot is flat, its mass at the ground: along the ground its share acts through the
points of contact and turns nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

from design.errors import BadInput


@dataclass(frozen=True, kw_only=True)
class Biped:
    """Body and flat foot, in SI units, standing under gravity ``g``."""

    M: float  # mass of the body [kg]
    L: float  # ankle to centre of gravity [m]
    I: float  # inertia of the body about the ankle [kg m²]
    m: float  # mass of the foot [kg]
    ell: float  # half the length of the foot; without skew ankle to toe, ankle to heel [m]
    g: float = 9.81  # [m/s²]
    skew: float = 0.0  # (toe - heel)/(toe + heel) of the distances from the ankle, in (-1, 1)
    height: float = 0.0  # of the ankle above the ground [m]
    ground_loads: bool = False  # the external force is an acceleration field, and m/M times it acts on the foot too

    def __post_init__(self) -> None:
        for field in fields(self):
            if field.name == "ground_loads":
                continue
            value = getattr(self, field.name)
            may_vanish = field.name in ("m", "height")
            if field.name == "skew":
                if not abs(value) < 1:
                    message = f"is {value}; needs a number between -1 and 1: the ankle lies between heel and toe"
                    raise BadInput(message, key="Biped.skew")
            elif not (math.isfinite(value) and value >= (0.0 if may_vanish else math.ulp(0.0))):
                message = f"is {value}; needs a finite number {'>=' if may_vanish else '>'} 0"
                raise BadInput(message, key=f"Biped.{field.name}")

    @property
    def toe(self) -> float:
        """Ankle to toe [m]."""
        return self.ell * (1.0 + self.skew)

    @property
    def heel(self) -> float:
        """Ankle to heel [m]."""
        return self.ell * (1.0 - self.skew)

    @property
    def plain(self) -> bool:
        """Whether the foot is the paper's: symmetric, the ankle on the ground."""
        return self.skew == 0.0 and self.height == 0.0

    def pressure(self, F_T: Any, F_H: Any) -> Any:
        """The centre of pressure P [m] from the ankle, toe side positive, (18)."""
        return ((1.0 + self.skew) * F_T - (1.0 - self.skew) * F_H) * self.ell / (F_T + F_H)

    def behind(self, F_T: Any, F_H: Any, target: float = 0.0) -> Any:
        """(F_T + F_H) (P_d - P) [N m], how far P is behind ``target`` [m]: ell (F_H - F_T) of the paper's foot."""
        lean = self.skew - target / self.ell
        if lean == 0.0:
            return self.ell * (F_H - F_T)
        return self.ell * ((1.0 - lean) * F_H - (1.0 + lean) * F_T)

    @property
    def kappa(self) -> float:
        """The force on the foot as a part of that on the body: m/M with ``ground_loads``, else 0."""
        return self.foot_share if self.ground_loads else 0.0

    def load(self, F_y: Any) -> Any:
        """F_T + F_H at rest under the vertical force ``F_y`` [N]."""
        return self.weight - (1.0 + self.kappa) * F_y

    def tilt_under(self, F_y: Any) -> Any:
        """``tilt`` under the vertical force ``F_y`` [N]."""
        return self.tilt - self.ell * self.skew * self.kappa * F_y

    @property
    def tilt(self) -> float:
        """Moment about the ankle of the foot's own weight, which acts in the middle of its length [N m]."""
        return self.ell * self.skew * self.m * self.g

    @property
    def foot_share(self) -> float:
        """m/M: the force of an acceleration field on the foot as a part of that on the body."""
        return self.m / self.M

    @property
    def weight(self) -> float:
        """Weight of body and foot, (M + m) g [N]."""
        return (self.M + self.m) * self.g
