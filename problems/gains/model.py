"""Quadratic models of rows about a point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class Model:
    """value + slope d + d curvature d/2 with d = u - at, for gains u in their scale; in the unit of row ``id``.

    A ``gap`` is how far a crossing is from where there is none: closed, it would make the row jump.
    """

    id: str
    gap: bool
    at: Array
    value: float
    slope: Array
    curvature: Array

    def __call__(self, u: Any, level: Any = 0.0) -> Any:
        """The modelled value at ``u``, numbers or CasADi expressions, to be compared with ``level``."""
        return self.value + _quadratic(self.slope, self.curvature, u, self.at)


@dataclass(frozen=True, eq=False, kw_only=True)
class Implicit(Model):
    """A value that is the zero of a function f(u, value), of which the model is: it bends as zeros do, near a fold.

    About (``at``, ``near``) f = ``offset`` + slope d + d curvature d/2 with d = (u, value) - (at, near), scaled so that
    f falls by one for each unit of the value.
    """

    near: float
    offset: float

    def __call__(self, u: Any, level: Any = 0.0) -> Any:
        """What is at least ``level`` where f(u, level) is at least 0."""
        there = np.append(u, level) if isinstance(u, np.ndarray) else ca.vertcat(u, level)
        return level + self.offset + _quadratic(self.slope, self.curvature, there, np.append(self.at, self.near))


def _quadratic(slope: Array, curvature: Array, u: Any, at: Array) -> Any:
    if isinstance(u, np.ndarray):
        d = u - at
        return slope @ d + 0.5 * d @ curvature @ d
    d = u - ca.DM(at)
    return ca.dot(ca.DM(slope), d) + 0.5 * ca.bilin(ca.DM(curvature), d, d)
