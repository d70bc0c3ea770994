"""Capturability of a scenario: a proof that the body falls, whatever the ankle does while it keeps the foot flat.

Let theta grow towards the toe. Contact with F_H >= level, the CoP at most p ahead of the ankle and the torque at most
T in size each bound the angular acceleration from below by N(theta)/J(theta), with F(t) and w = omega²:

    N = S sin(theta) + C cos(theta) + K,    J = I + M L (h cos(theta) - p sin(theta))
    S = (M g - F_y) L + M L h w,    C = F_x L + M L p w
    K = c m g + h F_x + e - p ((M + m) g - F_y)    with m g - kappa F_y for m g where the force acts on the foot too
        (F_H >= level: p = l_T, e = 2 ell level; CoP: p = l_T - margin, e = 0; c: the foot's weight ahead of the ankle)
    K = -T with J = I and without the terms in w             (torque)

These are the moments about the point under the CoP, divided by the inertia there. The largest of the bounds, evaluated
with the infimum over all angles from theta to pi/2, does not decrease in theta: theta' = omega, omega' >= g(theta,
omega, t) is cooperative, and a solution of the same with equality, or below, stays below every admissible motion
(Kamke 1932, Müller 1927). That solution is marched with an acceleration that is constant in each step and below g
throughout it. Where it passes pi/2, every admissible motion has fallen. The heel's side is the mirror image.

The infimum over [theta, pi/2] is at one of its ends: (N/J)' = q/J² with

    q = a cos(theta) + b sin(theta) + S M L h + C M L p,    a = I S + K M L p,    b = K M L h - I C

has, where a >= 0, no minimum inside, so that N/J rises and then falls. Where this cannot be seen, nothing is claimed.
While the force is 0 and the body stands at theta = 0 with torque 0, the law does nothing: the march starts after that.
Any other start is followed from t = 0, and the ankle may then prepare for what it cannot know yet.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from design.analysis.simulate import FALLEN
from design.model.body import Biped
from design.model.environment import Scenario

Array = NDArray[np.float64]

STEP = 5e-3
"""Step of the march as a part of the time constant sqrt(I/(M g L)) of the fall."""
MOST_STEPS = 20_000
BACKWARD = -1.2
"""Angle [rad] from which on a motion that leans to the other side is followed no further; nothing is claimed then."""
ROUNDING = 1e-12
"""Part of its terms by which an acceleration is lowered for rounding."""


@dataclass(frozen=True, kw_only=True)
class Ankle:
    """What an admissible ankle keeps: both contact forces >= ``level`` [N], the CoP ``margin`` [m], |torque| [N m].

    ``at_rest``: it does nothing as long as the body stands upright without a force.
    """

    level: float = 0.0
    margin: float = 0.0
    torque: float = math.inf
    at_rest: bool = True


@dataclass(frozen=True, kw_only=True)
class Variant:
    """A scenario with its signal and its initial state multiplied, on a foot that is scaled, with an ``ankle``."""

    ankle: Ankle
    signal: float = 1.0
    start: float = 1.0
    foot: float = 1.0


@lru_cache(maxsize=256)
def falls_to(biped: Biped, scenario: Scenario, ankle: Ankle) -> int:
    """The side to which every admissible motion falls within the scenario: 1 toe, -1 heel, 0 if none is proved."""
    for side in (1, -1):
        if falls(biped, scenario, side, [Variant(ankle=ankle)])[0]:
            return side
    return 0


def falls(biped: Biped, scenario: Scenario, side: int, variants: list[Variant]) -> NDArray[np.bool_]:
    """Whether every admissible motion falls to the ``side`` (1 toe, -1 heel), for each of the ``variants`` (n,).

    The variants share the scenario's times; True is a proof, False says nothing.
    """
    pace = math.sqrt(biped.M * biped.g * biped.L / biped.I)
    h = max(STEP / pace, scenario.duration / MOST_STEPS)
    begin = _begin(scenario) if all(v.ankle.at_rest for v in variants) else 0.0
    times = np.append(np.arange(begin, scenario.duration, h), scenario.duration)
    steps = scenario.steps_at(times)
    kept = (steps.h > 0) & (steps.t[:-1] >= begin)
    signals = [scenario.signal_by(steps.t[:-1] + 0.5 * steps.h, at)[:, kept] for at in (steps.t[:-1], steps.t[1:])]
    ends = np.array([[scenario.to_force(v.signal * each) for v in variants] for each in signals])  # (2, n, 2, steps)
    ends[:, :, 0] *= side
    system = _System(biped, side, variants)
    # between its ends a slope's force is off the chord by at most its size times angle²/8
    bend = np.array([v.signal for v in variants])[:, None] * (signals[1] - signals[0])[0]
    bend = system.reach[:, None] * bend**2 / 8 if scenario.kind == "slope" else 0.0 * bend
    start = np.array([v.start for v in variants])
    steady = scenario.steady_from
    with np.errstate(all="ignore"):  # where J vanishes, or numbers overflow, the bound is not used
        return system.march(
            side * scenario.theta0 * start, side * scenario.omega0 * start, steps.h[kept], ends, bend,
            still=steps.t[:-1][kept] >= steady,
        )  # fmt: skip


def _begin(scenario: Scenario) -> float:
    """Until when the body stands upright without a force [s]."""
    if scenario.theta0 or scenario.omega0:
        return 0.0
    for start, end in scenario.pieces():
        if scenario.force_on((start, end), np.array([start, end])).any():
            return start
    return scenario.duration


class _System:
    """The comparison system of n variants with c bounds each; arrays (c, n) unless stated."""

    def __init__(self, biped: Biped, side: int, variants: list[Variant]) -> None:
        feet = [replace(biped, ell=v.foot * biped.ell, skew=side * biped.skew) for v in variants]
        ankles = [v.ankle for v in variants]
        M, L, weight = biped.M, biped.L, biped.weight
        self.I, self.ML, self.L, self.Mg = biped.I, M * L, L, M * biped.g
        n = len(feet)
        p = np.array([[foot.toe for foot in feet], [foot.toe - a.margin for foot, a in zip(feet, ankles, strict=True)]])
        extra = np.array([[2 * foot.ell * a.level for foot, a in zip(feet, ankles, strict=True)], [0.0] * n])
        tilt = np.array([foot.tilt for foot in feet])
        zero = np.zeros((1, n))
        torque = np.array([[a.torque for a in ankles]])
        limited = bool(np.isfinite(torque).any())
        rows = slice(None) if limited else slice(2)
        self.P = np.vstack([self.ML * p, zero])[rows]
        self.H = np.vstack([np.full((2, n), self.ML * biped.height), zero])[rows]
        self.k_0 = np.vstack([tilt + extra - p * weight, -np.where(np.isfinite(torque), torque, 1e12)])[rows]
        self.k_x = np.vstack([np.full((2, n), biped.height), zero])[rows]
        middle = np.array([foot.ell * foot.skew for foot in feet])
        self.k_y = np.vstack([p + biped.kappa * (p - middle), zero])[rows]
        self.floor = self.I - self.P
        """The least J within [-pi/2, pi/2]."""
        self.reach = self.Mg * (L + biped.height + (1 + 2 * biped.kappa) * np.abs(p).max(axis=0))
        self.usable = self.floor > 0
        self.floor = np.where(self.usable, self.floor, 1.0)

    def march(
        self, theta: Array, omega: Array, h: Array, ends: Array, bend: Array, still: NDArray[np.bool_]
    ) -> NDArray[np.bool_]:
        """Whether the solution passes pi/2; ``ends`` (2, n, 2, steps) [N], ``bend`` (n, steps) [N m]."""
        theta, omega = np.asarray(theta, dtype=float), np.asarray(omega, dtype=float)
        fallen, over = theta >= FALLEN, np.zeros(len(theta), dtype=bool)
        size = np.hypot(self.Mg - ends[:, :, 1], ends[:, :, 0]).max(axis=(0, 2)) * self.L
        K = np.abs(self.k_0) + (np.abs(self.k_x) + self.k_y) * np.abs(ends).max(axis=(0, 2, 3))
        most = np.where(self.usable, (size + K) / self.floor, 0.0).max(axis=0)
        for k, step in enumerate(h):
            # the square of the rate cannot be less than this within the step
            w = np.maximum(np.abs(omega) - most * step, 0.0) ** 2
            least, slope, sure = self._least(theta, w, ends[:, :, :, k], bend[:, k])
            # within the step theta drops by at most so much, and the bound with it
            drop = np.where((omega >= 0) & (least >= 0), 0.0, np.maximum(-omega, 0.0) * step + 0.5 * most * step**2)
            least = least - slope * drop
            over |= ~fallen & (~sure | (theta - drop < BACKWARD))
            least = np.where(sure, least, 0.0)
            if still[k]:
                over |= ~fallen & (omega <= 0) & (least <= 0)  # it never turns round again
            theta = np.where(over | fallen, theta, theta + step * (omega + 0.5 * step * least))
            omega = np.where(over | fallen, omega, omega + step * least)
            fallen |= ~over & (theta >= FALLEN)
            if (fallen | over).all():
                break
        return fallen & ~over

    def _least(self, theta: Array, w: Array, F: Array, bend: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """The least acceleration from ``theta`` to pi/2, how steep it can be in theta, and where both hold; (n,)."""
        F_x, F_y = F[:, None, :, 0], F[:, None, :, 1]  # (2, 1, n)
        sine, cosine = np.sin(theta), np.cos(theta)
        S = (self.Mg - F_y) * self.L + self.H * w
        C = F_x * self.L + self.P * w
        K = self.k_0 + self.k_x * F_x + self.k_y * F_y - bend
        K = K - ROUNDING * (np.abs(S) + np.abs(C) + np.abs(K))
        here = (S * sine + C * cosine + K) / (self.I + self.H * cosine - self.P * sine)
        there = (S + K) / (self.I - self.P)
        a, b, c = self.I * S + K * self.P, K * self.H - self.I * C, S * self.H + C * self.P
        rising = (a * cosine + b * sine + c >= 0) | (b * cosine - a * sine <= 0)
        outward = self.P * cosine + self.H * sine >= 0  # omega² then only adds to N
        finite = np.isfinite(here) & np.isfinite(there) & np.isfinite(a) & np.isfinite(b) & np.isfinite(c)
        sure = self.usable & ((a >= 0) & rising & outward & finite).all(axis=0)
        steep = np.where(sure, (np.abs(a) + np.abs(b) + np.abs(c)).max(axis=0) / self.floor**2, 0.0).max(axis=0)
        least = np.where(sure, np.minimum(here, there).min(axis=0), -np.inf).max(axis=0)
        return least, steep, sure.any(axis=0)
