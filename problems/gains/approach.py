"""Settling, overshoot and the error at the end as rows along a trajectory, each on one smooth branch.

With e, theta_f and t_c as in ``design.analysis.transient``, and all rows >= 0:

    settling <= T       BAND |e_far| -/+ e(t)       at the samples from t_c + T on
    overshoot <= x      x + sign(e(t_c)) e(t)       at the samples from t_c on, and sign(e(t_c)) e(t_c) itself
    posture-error <= x  x -/+ e                     at the last sample

The band is a maximum over the run, and the side from which the posture comes is a sign: both are held on a ``Branch``,
the sample that is farthest and the side, in which the rows are smooth. A point that is feasible on any branch is
feasible, since no sample is farther than the farthest; ``exchange`` solves again on the branch of its answer until that
gains nothing. Where T itself is sought, the band is asked for after the settling time T_j of the point so far, at which
the objective is v_j, with room c to spare for each unit that is to be gained:

    (BAND |e_far| -/+ e(t))/c >= v - v_j          at t = t_c + T_j, or (``wide``) at all samples from then on

The first is Newton's method for the time at which the run comes into the band; the second makes the humps after it
small, and where one comes into the band as a whole T jumps down. Either way T_j cannot grow, and they take turns until
neither gains anything.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design.analysis.objectives import OBJECTIVES
from design.analysis.transient import AT_REST, BAND, PART_AT_REST, Approach, approach
from design.model.environment import Steps
from design.model.standing import posture
from problems.gains.goal import BACKOFF, Goal
from problems.gains.question import APPROACH, Case, Question

Array = NDArray[np.float64]
Numbers = NDArray[np.integer]

BANDS = 5.0
"""Scale of a distance from theta_f, in bands."""
FREE = 1e4
"""Row of a sample that nothing is asked of; of the objective it is beyond every v."""
FLATTEST = 0.1
"""Least room in the band, in its scale, for each unit of v."""


@dataclass(frozen=True, kw_only=True)
class Branch:
    """The smooth branch of a run's rows: sample ``farthest`` from theta_f, ``sign`` of e there, and ``side``.

    ``begin``: the sample from which on theta must lie within the band, for the required settling time ``T`` [s] and
    for the one that the objective has come to. ``sought``: the sample of the latter, where v is ``v``, with ``room``
    c for each unit more, also after it where ``wide``.
    """

    farthest: int
    sign: float
    side: float
    begin: int
    T: float
    sought: int
    v: float
    room: float
    wide: bool


@dataclass(frozen=True, eq=False, kw_only=True)
class Path:
    """The approach in one case: its samples ``to``, and the ``scale`` of a distance from theta_f [rad]."""

    question: Question
    goal: Goal
    to: Approach
    scale: float
    ids: tuple[str, ...]

    @property
    def names(self) -> list[str]:
        """The id of each of ``rows``."""
        return [id for id in self.ids for _ in range(2 * self._asked(id))]

    def settling(self, theta: Array) -> tuple[int, float]:
        """The sample from which ``theta`` (n,) [rad] has settled, the last one if it has not, and the time [s]."""
        e = theta - self.to.theta_f
        settled = self.to.settled(e, BAND * float(np.abs(e).max()))
        at = len(e) - 1 if settled is None else settled
        return at, float(self.to.elapsed[at])

    def branch(self, theta: Array, T: float, *, wide: bool) -> Branch:
        """The branch of a run ``theta`` (n,) [rad]; the objective asks for the band from ``T`` [s] on."""
        e = theta - self.to.theta_f
        farthest = int(np.argmax(np.abs(e)))
        level = self.question.level("settling")
        sought = self.to.settled_from(T)
        before = max(sought - 1, 0)
        step = max(float(self.to.elapsed[sought] - self.to.elapsed[before]), 1e-9)
        rate = abs(float(e[sought] - e[before])) / step * self._pace() / self.scale
        v = self.v(float(self.to.elapsed[sought]))
        begins = [] if level is None else [self.to.settled_from(level)]
        begins += [sought + 1] if math.isfinite(v) else []
        return Branch(
            farthest=farthest, sign=math.copysign(1.0, e[farthest]), side=self.to.side(e),
            begin=min(begins, default=len(e)), T=math.inf if level is None else level,
            sought=sought, v=v, room=max(rate, FLATTEST), wide=wide,
        )  # fmt: skip

    def v(self, T: float) -> float:
        """The objective that a settling time of ``T`` [s] leaves."""
        if self.goal.id == "settling":
            return self.goal.v(T)
        wish = self.question.wish("settling")
        return math.inf if wish is None or self.goal.id != "goals" else (wish - T) / self.question.size_of("settling")

    def _pace(self) -> float:
        """-dT/dv [s]."""
        return self.goal.scale if self.goal.id == "settling" else self.question.size_of("settling")

    def _asked(self, id: str) -> int:
        """How many statements there are about a row: of the requirement, and of the objective."""
        if id == "settling":
            return 1 + math.isfinite(self.v(0.0))
        return len(asked(self.question, self.goal, id, 0.0))

    def rows(self, branch: Branch, k: Numbers, e: Any, omega: Any, far: Any, first: Any, v: Any) -> list[Any]:
        """The rows, (1, n) each, at the samples numbered ``k`` (n,).

        ``e`` (1, n) [rad] and its rate ``omega`` [rad/s] there, None where no level has moved; ``far`` and ``first``:
        e at the farthest sample and at the corner. Numbers or CasADi expressions.
        """
        pairs: list[tuple[Any, float]] = []
        for id in self.ids:
            own = {"settling": self._settling, "overshoot": self._overshoot, "posture-error": self._error}[id]
            pairs += own(branch, k, e, omega, far, first)
        return [row - of * v for row, of in pairs]

    def _settling(
        self, branch: Branch, k: Numbers, e: Any, omega: Any, far: Any, _: Any
    ) -> list[tuple[Any, float]]:  # fmt: skip
        """Within the band, from T on, and from the settling time so far on."""
        rows: list[tuple[Any, float]] = []
        band, level = far * (branch.sign * BAND), self.question.level("settling")
        of = 1.0 if self.goal.id == "feasibility" else 0.0
        at = e if omega is None or level is None else e + omega * ((k == branch.begin)[None, :] * (level - branch.T))
        for sign in (1.0, -1.0):
            margin = (band - at * sign) / self.scale - (0.0 if of else BACKOFF)
            rows.append((_only(k >= branch.begin, margin, of), of))
        if math.isfinite(branch.v):
            for sign in (1.0, -1.0):
                row = (band - e * sign) / (self.scale * branch.room) + branch.v
                rows.append((_only(k >= branch.sought if branch.wide else k == branch.sought, row, 1.0), 1.0))
        return rows

    def _overshoot(
        self, branch: Branch, k: Numbers, e: Any, _: Any, far: Any, first: Any
    ) -> list[tuple[Any, float]]:  # fmt: skip
        """Not past theta_f by more, on the side on which that is."""
        after, sides = k >= self.to.first, (branch.side,) if branch.side else (1.0, -1.0)
        rows = [
            (_only(after, row, of), of)
            for side in sides
            for row, of in asked(self.question, self.goal, "overshoot", e * (-side * 180 / math.pi))
        ]
        if branch.side:
            inside = first * branch.side - far * (branch.sign * PART_AT_REST) - AT_REST
            at = k == self.to.first
            rows += [(_only(at, inside / self.scale + 0.0 * e, 0.0), 0.0)] * self._asked("overshoot")
        return rows

    def _error(
        self, _: Branch, k: Numbers, e: Any, _omega: Any, _far: Any, _first: Any
    ) -> list[tuple[Any, float]]:  # fmt: skip
        """Near theta_f at the end."""
        last = k == len(self.to.elapsed) - 1
        return [
            (_only(last, row, of), of)
            for sign in (1.0, -1.0)
            for row, of in asked(self.question, self.goal, "posture-error", e * (sign * 180 / math.pi))
        ]

    def lowest(self, theta: ca.MX) -> list[tuple[ca.MX, float]]:
        """The lowest of the rows of a run ``theta`` (1, n) [rad], on whatever branch; 1 where of the objective."""
        e, start = theta - self.to.theta_f, self.to.first
        band, rows = BAND * ca.mmax(ca.fabs(e)), []
        if "settling" in self.ids:
            if (level := self.question.level("settling")) is not None:
                rows.append(((band - ca.mmax(ca.fabs(e[:, self.to.settled_from(level) :]))) / self.scale, 0.0))
            if math.isfinite(self.v(0.0)):
                next_ones = np.append(self.to.elapsed[start + 1 :], 2 * self.to.elapsed[-1])
                T = ca.mmax((ca.fabs(e[:, start:]) > band) * ca.DM(next_ones).T)
                rows.append((self.v(0.0) + T * (self.v(1.0) - self.v(0.0)), 1.0))
        if "overshoot" in self.ids:
            side = ca.if_else(ca.fabs(e[start]) > AT_REST + PART_AT_REST / BAND * band, ca.sign(e[start]), 0.0)
            past = ca.fmax(0.0, ca.if_else(side == 0.0, ca.mmax(ca.fabs(e[:, start:])), ca.mmax(-side * e[:, start:])))
            rows += asked(self.question, self.goal, "overshoot", past * (180 / math.pi))
        if "posture-error" in self.ids:
            rows += asked(self.question, self.goal, "posture-error", ca.fabs(e[:, -1]) * (180 / math.pi))
        return rows


def _only(chosen: NDArray[np.bool_], row: Any, of: float) -> Any:
    """``row`` (1, n) at the ``chosen`` samples (n,), and nothing asked at the others."""
    mask = chosen.astype(float)[None, :]
    return row * mask + (1.0 - mask) * (FREE if of else 1.0)


def asked(question: Question, goal: Goal, id: str, value: Any) -> list[tuple[Any, float]]:
    """(margin, 1 if v is to be subtracted, else 0) of a row's ``value``: against the objective, or what is required."""
    sign = OBJECTIVES[id].sign
    level, wish = question.level(id), question.wish(id)
    if id == goal.id:
        return [(sign * value / goal.scale, 1.0)]
    if level is not None:
        margin = sign * (value - level) / question.size_of(id)
        return [(margin, 1.0) if goal.id == "feasibility" else (margin - BACKOFF, 0.0)]
    if goal.id == "goals" and wish is not None:
        return [(sign * (value - wish) / question.size_of(id), 1.0)]
    return []


def paths(question: Question, goal: Goal, cases: Sequence[Case], samples: Sequence[Steps]) -> list[Path | None]:
    """The approach in each case; None where nothing is asked of it."""
    found: list[Path | None] = []
    for case, steps in zip(cases, samples, strict=True):
        ids = tuple(id for id in APPROACH if case.sized is None and question.asks(goal, id))
        if not ids:
            found.append(None)
            continue
        to = approach(case.loop, case.scenario, steps.t, steps.force)
        scale = BANDS * BAND * _distance(question, case, steps, to.theta_f)
        found.append(Path(question=question, goal=goal, to=to, scale=scale, ids=ids))
    return found


def _distance(question: Question, case: Case, steps: Steps, theta_f: float) -> float:
    """A typical largest distance from theta_f [rad]: of the postures under the forces on the way, and the start."""
    few = steps.force[:, :: max(1, steps.force.shape[1] // 50)].T
    resting = [posture(case.loop.biped, float(F_x), float(F_y), case.loop.law.target) for F_x, F_y in few]
    away = [abs(theta - theta_f) for theta in (case.scenario.theta0, *resting)]
    return max(*away, abs(case.scenario.omega0) / question.pace, 1e-4)
