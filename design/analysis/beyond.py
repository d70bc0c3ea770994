"""What a scenario beyond every ankle would take: the largest disturbance of its shape, and the foot or torque needed.

Each is the limit of what ``design.analysis.capture`` proves, bracketed on a grid that is refined, and rounded to the
side on which the proof holds: no ankle survives more than ``survivable``, and none with less than ``foot`` or
``torque`` survives the scenario.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from design.analysis.capture import Ankle, Variant, falls
from design.model.body import Biped
from design.model.environment import Scenario

Array = NDArray[np.float64]

GRID = 32
ROUNDS = 2
LONGEST = 0.9
"""Longest foot that is looked at, as a part of the radius I/(M L) on which the moments' inertia vanishes."""
STRONGEST = 1.0
"""Largest torque that is looked at, in units of M g L."""


@dataclass(frozen=True, kw_only=True)
class Beyond:
    """A scenario beyond any ankle that keeps what ``ankle`` says; the body falls to ``side`` (1 toe, -1 heel).

    ``size``: the disturbance in ``unit``, called ``what``; ``survivable``: no ankle survives more of it. ``foot``: with
    less half length [m], ``torque``: with less torque [N m] it is not survived; one of them is needed, or both
    ``together``; None where no foot up to the half length ``longest`` [m], or no torque, is enough.
    """

    scenario: str
    ankle: Ankle
    side: int
    what: str
    size: float
    unit: str
    survivable: float
    foot: float | None
    torque: float | None
    together: bool
    longest: float

    def sentence(self, biped: Biped) -> str:
        """What is impossible, what could be survived, and what it would take."""
        kept = [f"toe and heel force >= {self.ankle.level:g} N"]
        kept += [f"the CoP {self.ankle.margin:g} m inside the foot"] if self.ankle.margin > 0 else []
        kept += [f"|torque| <= {self.ankle.torque:g} N m"] if math.isfinite(self.ankle.torque) else []
        end = "toe" if self.side > 0 else "heel"
        limit = "no part of it can be survived"
        if self.survivable > 0:
            limit = f"at most {_rounded(self.survivable, up=True)} {self.unit} of it can be survived"
        return (
            f"In scenario {self.scenario!r} {self.what} of {self.size:.4g} {self.unit} makes the body fall over the"
            f" {end}, whatever ankle torque keeps {' and '.join(kept)} (capturability); with this foot"
            f" {limit}{self._needs(biped)}."
        )

    def _needs(self, biped: Biped) -> str:
        needs = []
        if self.foot is not None:
            needs.append(f"a foot with a half length of at least {_rounded(self.foot)} m (now {biped.ell:g})")
        if self.torque is not None:
            needs.append(f"a torque of at least {_rounded(self.torque)} N m (now {self.ankle.torque:g})")
        if not needs and self.longest <= biped.ell:
            return ""
        if not needs:
            return f", and no foot with a half length up to {_rounded(self.longest)} m survives all of it"
        return f", and all of it takes {(' and ' if self.together else ' or ').join(needs)}"


def beyond(biped: Biped, scenario: Scenario, ankle: Ankle, side: int) -> Beyond:
    """What is known of a ``scenario`` in which every admissible motion falls to the ``side``."""
    whole = Variant(ankle=ankle)

    def lost(vary: Callable[[float], Variant]) -> Callable[[Array], NDArray[np.bool_]]:
        return lambda values: falls(biped, scenario, side, [vary(float(value)) for value in values])

    # the largest part of the disturbance, or of the initial state where without it the scenario may be survived
    moved = scenario.theta0 != 0.0 or scenario.omega0 != 0.0
    by_start = moved and not falls(biped, scenario, side, [replace(whole, start=0.0)])[0]
    what, size, unit = _start(scenario) if by_start else _disturbance(scenario)
    shrunk = lost(lambda part: replace(whole, start=part) if by_start else replace(whole, signal=part))
    part = _least(shrunk, 0.0, 1.0)

    # the least foot with this torque, and the least torque with this foot; or each with as much of the other as may be
    longest = LONGEST * biped.I / (biped.M * biped.L) / max(biped.toe, biped.heel)
    strongest = max(STRONGEST * biped.M * biped.g * biped.L, ankle.torque)

    def least_foot(torque: float) -> float | None:
        limited = replace(ankle, torque=torque)
        return _most(lost(lambda foot: Variant(ankle=limited, foot=foot)), 1.0, longest)

    def least_torque(foot: float) -> float | None:
        if math.isinf(ankle.torque):
            return None
        return _most(lost(lambda most: Variant(ankle=replace(ankle, torque=most), foot=foot)), ankle.torque, strongest)

    foot, torque = least_foot(ankle.torque), least_torque(1.0)
    together = foot is None and torque is None and math.isfinite(ankle.torque)
    if together:
        foot, torque = least_foot(math.inf), least_torque(longest)
    return Beyond(
        scenario=scenario.name, ankle=ankle, side=side, what=what, size=size, unit=unit, survivable=part * size,
        foot=None if foot is None else foot * biped.ell, torque=torque, together=together,
        longest=longest * biped.ell,
    )  # fmt: skip


def _least(lost: Callable[[Array], NDArray[np.bool_]], low: float, high: float) -> float:
    """The least value of the grid from which on, up to ``high``, all are lost."""
    for _ in range(ROUNDS):
        grid = np.linspace(low, high, GRID + 1)
        kept = np.flatnonzero(~lost(grid))
        if not len(kept):
            return low
        last = min(int(kept[-1]), GRID - 1)
        low, high = float(grid[last]), float(grid[last + 1])
    return high


def _most(lost: Callable[[Array], NDArray[np.bool_]], low: float, high: float) -> float | None:
    """The largest value up to which, from ``low`` on, all are lost; None if all are up to ``high``."""
    if high <= low:
        return None
    for round_ in range(ROUNDS):
        grid = np.geomspace(low, high, GRID + 1)
        kept = np.flatnonzero(~lost(grid))
        if not len(kept):
            return None if round_ == 0 else high
        first = max(int(kept[0]), 1)
        low, high = float(grid[first - 1]), float(grid[first])
    return low


def _start(scenario: Scenario) -> tuple[str, float, str]:
    lean, rate = math.degrees(abs(scenario.theta0)), math.degrees(abs(scenario.omega0))
    if lean:
        also = f" (and an initial rate of {rate:.4g} deg/s with it)" if rate else ""
        return f"an initial lean{also}", lean, "deg"
    return "an initial rate", rate, "deg/s"


def _disturbance(scenario: Scenario) -> tuple[str, float, str]:
    """The disturbance in words, its size and unit."""
    pieces = scenario.pieces()
    ends = [scenario.signal_on(piece, np.array(piece)) for piece in pieces]
    signal = np.concatenate(ends, axis=1)
    peak = float(np.hypot(*signal).max() if len(signal) == 2 else np.abs(signal).max())
    if scenario.kind == "slope":
        ramp = scenario.steady_from
        return (f"a slope (within {ramp:g} s)" if ramp else "a sudden slope"), math.degrees(peak), "deg"
    if scenario.kind == "platform":
        return "an acceleration of the floor", peak, "m/s²"
    if not signal[:, -1].any() and not signal[1].any():
        lengths = np.array([end - start for start, end in pieces])
        impulse = float(np.array([each[0].mean() for each in ends]) @ lengths)
        if impulse:
            return "a push", abs(impulse), "N s"
    return "a force", peak, "N"


def _rounded(value: float, *, up: bool = False, digits: int = 4) -> str:
    """``value`` to a few digits, upward or downward."""
    unit = 10.0 ** (math.floor(math.log10(value)) - digits + 1)
    number = math.ceil(value / unit - 1e-9) if up else math.floor(value / unit + 1e-9)
    return f"{number * unit:.{digits}g}"
