"""What a recording says: the external force over time, and how near the foot came to turning.

Where the ankle's angle is known the force is that of the dynamic estimator, which holds while the body moves. Elsewhere
F_y is (16) and F_x the horizontal force on the foot with its sign turned: both hold for a body that is nearly at rest.
Where neither was measured there is none; nor an F_x by the angle where the ankle's place is assumed under the mean CoP,
since the torque that balances it is then zero by assumption.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.analysis.estimate import BODY, Signals, dynamic, static_estimate
from design.model.sensing import Sensors
from design.model.uncertainty import Spread
from design.recordings.record import Record
from design.spec.setting import Setting

Array = NDArray[np.float64]

MOST = 200_000
"""Samples that the dynamic estimator is given; of a longer recording every second, third, ... one."""

DRAWN = 8000
"""Points of a line to draw; of a longer one the extremes of each piece are kept."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Estimates:
    """``F_x``, ``F_y`` (n,) [N] or None, NaN where unknown, and ``how`` each was found, in words.

    ``spread`` (2,) and ``bias`` (2,) [N]: the mean over time of the standard deviation that noise makes, and the most
    that a body within its tolerances moves the estimate by at any time; None where no angle was measured, ``bias`` also
    where no tolerances are given; NaN for a force that is not estimated. ``static_x`` (n,): (17), for comparison.
    """

    F_x: Array | None
    F_y: Array | None
    how_x: str
    how_y: str
    static_x: Array | None = None
    spread: tuple[float, float] | None = None
    bias: tuple[float, float] | None = None


@dataclass(frozen=True, kw_only=True)
class Least:
    """The smallest ``value`` of a quantity over the valid samples, when [s] it was, the largest, and the mean."""

    value: float
    time: float
    most: float
    mean: float


def estimates(record: Record, setting: Setting) -> Estimates:
    """The external force over a recording; the one place where an estimator is chosen.

    ``setting`` says the sensors' noise, the body's tolerances, and how fast the force may walk.
    """
    if record.F_T is None or record.F_H is None:
        nothing = "not estimated: no contact force was measured"
        return Estimates(F_x=None, F_y=None, how_x=nothing, how_y=nothing)
    if record.theta is not None:
        return _dynamic(record, setting, record.theta, record.F_T, record.F_H)
    _, F_y = static_estimate(record.biped, np.zeros_like(record.F_T), record.F_T, record.F_H)
    how_y = "static: weight less load, (16)"
    if record.horizontal is not None:
        how_x = "quasi-static: minus the horizontal force on the foot"
        return Estimates(F_x=0.0 - record.horizontal, F_y=F_y, how_x=how_x, how_y=how_y)
    how_x = "not estimated: neither the angle nor a horizontal force was measured"
    return Estimates(F_x=None, F_y=F_y, how_x=how_x, how_y=how_y)


def _dynamic(record: Record, setting: Setting, theta: Array, F_T: Array, F_H: Array) -> Estimates:
    every = -(-len(record.t) // MOST)
    rate = record.omega if record.omega is not None and "rate" in record.columns else np.full_like(theta, np.nan)
    signals = Signals(*(part[::every] for part in (record.t, theta, rate, F_T, F_H)))
    sensors, said = setting.sensors, "the spec's noise"
    if not any((sensors.angle, sensors.rate, sensors.force, sensors.angle_step, sensors.rate_step, sensors.force_step)):
        sensors = Sensors(
            angle=noise(signals.theta), rate=0.0 if np.isnan(rate).all() else noise(signals.omega),
            force=max(noise(F_T[::every]), noise(F_H[::every])),
        )  # fmt: skip
        said = "the noise seen in the recording"
    found = dynamic(
        record.biped, signals, sensors, setting.tolerances, walk=setting.tuning.walk * record.biped.weight,
        valid=record.valid[::every].astype(np.float64),
    )  # fmt: skip
    F = found.F.copy()
    F[0, _beginning(F[0], found.t, 5 * found.lag[0])] = np.nan  # there F_x is still on its way from zero
    F_x, F_y = (
        np.interp(record.t, found.t[np.isfinite(row)], row[np.isfinite(row)]) if every > 1 else row for row in F
    )
    static_x, _ = static_estimate(record.biped, theta, F_T, F_H, setting.target)
    how = f"dynamic: from angle, contact forces and (11), with {said}"
    spread = _means(found.spread)
    bias = _most(found.bias, F) if _has_tolerances(setting) else None
    if record.ankle_assumed:
        nothing = "not estimated: it follows from the ankle torque, and the ankle's place is assumed; needs --ankle"
        return Estimates(
            F_x=None, F_y=F_y, how_x=nothing, how_y=how, spread=(math.nan, spread[1]),
            bias=bias and (math.nan, bias[1]),
        )  # fmt: skip
    return Estimates(F_x=F_x, F_y=F_y, how_x=how, how_y=how, static_x=static_x, spread=spread, bias=bias)


def _has_tolerances(setting: Setting) -> bool:
    return any(getattr(setting.tolerances, name) != Spread() for name in BODY)


def _beginning(values: Array, t: Array, settle: float) -> NDArray[np.bool_]:
    """The samples of ``values`` (n,) up to ``settle`` [s], and at least six, after each place where they begin."""
    known = np.isfinite(values)
    starts = np.flatnonzero(known & ~np.concatenate([[False], known[:-1]]))
    early = np.zeros(len(t), dtype=bool)
    for start in starts:
        end = int(np.searchsorted(t, t[start] + settle, side="right"))
        early[start : max(end, start + 6)] = True
    return early & known if not (early | ~known).all() else np.zeros_like(early)


def _means(parts: Array) -> tuple[float, float]:
    return float(np.nanmean(parts[0])), float(np.nanmean(parts[1]))


def _most(parts: Array, F: Array) -> tuple[float, float]:
    """The largest of ``parts`` (2, n) over the times at which there is an estimate ``F`` (2, n)."""
    known = np.where(np.isfinite(F) & np.isfinite(parts), parts, 0.0)
    return float(known[0].max()), float(known[1].max())


def noise(values: Array) -> float:
    """Standard deviation of white noise on ``values`` (n,), by their third differences, in which what is smooth is not.

    The median of their sizes is taken, so that corners and jumps do not count.
    """
    third = np.abs(np.diff(values, 3))
    return float(1.4826 * np.median(third) / math.sqrt(20.0)) if len(third) else 0.0


def least(record: Record, values: Array | None) -> Least | None:
    """Smallest, largest and mean of ``values`` (n,) over the valid samples; None where there are none."""
    if values is None:
        return None
    usable = record.valid & np.isfinite(values)
    if not usable.any():
        return None
    own = np.where(usable, values, np.inf)
    at, kept = int(np.argmin(own)), values[usable]
    mean = float(kept.mean())
    if abs(mean) < 1e-12 * float(np.abs(kept).max()):
        mean = 0.0
    return Least(value=float(own[at]), time=float(record.t[at]), most=float(kept.max()), mean=mean)


def cop_margin(record: Record) -> Array | None:
    """Distance of the CoP from the nearer end of the foot (n,) [m]."""
    foot = record.biped
    return None if record.P is None else np.minimum(foot.toe - record.P, foot.heel + record.P)


def thinned(t: Array, values: Array) -> tuple[Array, Array]:
    """The line to draw: all points of a short one, else the least and the greatest of each piece."""
    if len(t) <= DRAWN:
        return t, values
    size = -(-len(t) // (DRAWN // 2))
    kept = len(t) // size * size
    pieces = values[:kept].reshape(-1, size)
    known = np.isfinite(pieces)
    low = np.argmin(np.where(known, pieces, np.inf), axis=1)
    high = np.argmax(np.where(known, pieces, -np.inf), axis=1)
    rows = (np.arange(len(pieces))[:, None] * size + np.sort(np.column_stack([low, high]), axis=1)).ravel()
    holes = np.flatnonzero(~np.isfinite(values))
    rows = np.union1d(rows, holes[:DRAWN])
    return t[rows], values[rows]
