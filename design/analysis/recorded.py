"""What a recording says: the external force over time, and how near the foot came to turning.

F_y is (16). F_x is (17) where the ankle's angle is known, and else the horizontal force on the plate with its sign
turned: both hold for a body that is (nearly) at rest. Where neither was measured there is none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.analysis.estimate import static_estimate
from design.recordings.record import Record

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class Estimates:
    """``F_x``, ``F_y`` (n,) [N] or None, and ``how`` each was found, in words."""

    F_x: Array | None
    F_y: Array | None
    how_x: str
    how_y: str


@dataclass(frozen=True, kw_only=True)
class Least:
    """The smallest ``value`` of a quantity over the valid samples, when [s] it was, the largest, and the mean."""

    value: float
    time: float
    most: float
    mean: float


def estimates(record: Record) -> Estimates:
    """The external force over a recording; the one place where an estimator is chosen."""
    if record.load is None or record.F_T is None or record.F_H is None:
        nothing = "not estimated: no contact force was measured"
        return Estimates(F_x=None, F_y=None, how_x=nothing, how_y=nothing)
    static_x, F_y = static_estimate(
        record.biped, np.zeros_like(record.load) if record.theta is None else record.theta, record.F_T, record.F_H
    )
    how_y = "(16), static: weight less load"
    if record.theta is not None:
        return Estimates(F_x=static_x, F_y=F_y, how_x="(17), static: from load and angle", how_y=how_y)
    if record.horizontal is not None:
        how_x = "quasi-static: minus the horizontal force on the foot"
        return Estimates(F_x=-record.horizontal, F_y=F_y, how_x=how_x, how_y=how_y)
    how_x = "not estimated: neither the angle nor a horizontal force was measured"
    return Estimates(F_x=None, F_y=F_y, how_x=how_x, how_y=how_y)


def least(record: Record, values: Array | None) -> Least | None:
    """Smallest, largest and mean of ``values`` (n,) over the valid samples."""
    if values is None or not record.valid.any():
        return None
    own = np.where(record.valid, values, np.inf)
    at = int(np.argmin(own))
    kept = values[record.valid]
    return Least(value=float(own[at]), time=float(record.t[at]), most=float(kept.max()), mean=float(kept.mean()))


def cop_margin(record: Record) -> Array | None:
    """Distance of the CoP from the nearer end of the foot (n,) [m]."""
    return None if record.P is None else record.biped.ell - np.abs(record.P)
