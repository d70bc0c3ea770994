"""The time grids on which trajectories are looked at, and the rows that they give."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design import deadline
from design.analysis.motion import Motion
from design.analysis.simulate import FALLEN, all_quantities
from design.analysis.slabs import SLAB, mapped
from design.model.environment import Steps
from design.model.limits import Limit
from problems.gains.goal import FEASIBILITY, Goal
from problems.gains.question import Case, Question

Array = NDArray[np.float64]
Instants = tuple[tuple[int, ...], ...]

BACKOFF = 1e-8
"""How far inside a requirement, in its scale, the program stays, so that rounding does not break it."""


@dataclass(frozen=True, kw_only=True)
class Point:
    """A point of the program: gains, and the objective ``v`` in its scale."""

    gains: Any
    v: float

    @property
    def p(self) -> Array:
        """(K, v)."""
        return np.array([*self.gains, self.v])


@dataclass(frozen=True, eq=False)
class Grid:
    """Samples of every case, ``step`` apart, at which rows are checked, and the meshes that programs march on.

    At full resolution a program marches with the coarse step and lands on the samples it sees; the difference that
    this makes to a row (some 1e-7 of its scale) is measured at each answer and added to the row in the next round.
    """

    question: Question
    step: float
    goal: Goal

    @cached_property
    def cases(self) -> list[Case]:
        """What is simulated."""
        return self.question.cases(self.goal)

    @cached_property
    def samples(self) -> list[Steps]:
        """The samples of each case."""
        found = []
        for case in self.cases:
            deadline.check()
            found.append(case.scenario.steps(self.step))
        return found

    @cached_property
    def whole(self) -> list[Motion]:
        """Each case's trajectory on the samples themselves."""
        return [
            Motion(case.loop, case.scenario, steps, case.sized)
            for case, steps in zip(self.cases, self.samples, strict=True)
        ]

    @cached_property
    def feasibility(self) -> Grid:
        """The same cases, for finding a point that meets all that is required."""
        found = Grid(self.question, self.step, FEASIBILITY)
        if not any(case.sized for case in self.cases):
            for name in ("cases", "samples", "whole", "quantities"):  # they do not know the goal
                vars(found)[name] = getattr(self, name)
        return found

    @property
    def exact(self) -> bool:
        """Whether programs march on the samples themselves."""
        return self.step >= self.question.coarse_step

    def asking(self, question: Question) -> Grid:
        """The same trajectories for a ``question`` that differs in the levels of its requirements alone."""
        found = Grid(question, self.step, self.goal)
        cases = question.cases(self.goal)
        if [mine.sized for mine in self.cases] == [its.sized for its in cases]:
            vars(found)["cases"] = [
                Case(name=mine.name, loop=mine.loop, limits=its.limits, scenario=mine.scenario, sized=mine.sized)
                for mine, its in zip(self.cases, cases, strict=True)
            ]
            for name in ("samples", "whole", "quantities"):
                vars(found)[name] = getattr(self, name)
        return found

    def motions(self, instants: Instants) -> list[tuple[Case, Motion, list[int]]]:
        """Each case's trajectory as a function of (K, v), and where the samples ``instants`` are on its mesh."""
        if self.exact:
            return [
                (case, motion, list(chosen))
                for case, motion, chosen in zip(self.cases, self.whole, instants, strict=True)
            ]
        found = []
        for case, steps, chosen in zip(self.cases, self.samples, instants, strict=True):
            seen = list(chosen)
            times = np.concatenate([case.scenario.steps(self.question.coarse_step).t, steps.t[seen]])
            mesh = case.scenario.steps_at(times)
            after_jump = np.array([k > 0 and steps.t[k] == steps.t[k - 1] for k in seen], dtype=bool)
            at = np.searchsorted(mesh.t, steps.t[seen]) + after_jump
            found.append((case, Motion(case.loop, case.scenario, mesh, case.sized), [int(k) for k in at]))
        return found

    def thinned(self, count: int = 20) -> Instants:
        """``count`` samples of each case, evenly spread."""
        return tuple(tuple(sorted({int(k) for k in np.linspace(0, len(steps.t) - 1, count)})) for steps in self.samples)

    @cached_property
    def quantities(self) -> list[Any]:
        """For each case: (K, v) -> theta and the quantities of all limits, a row each, at all samples."""
        p = ca.MX.sym("p", 4)
        found: list[Any] = []
        for case, motion in zip(self.cases, self.whole, strict=True):
            stacked = all_quantities([limit.quantity for limit in case.limits])
            if len(motion.steps.t) > SLAB:
                found.append(_InSlabs(case, motion, stacked))
                continue
            z = motion.all_states(p[: motion.free])
            n = z.size2()
            tau = case.loop.torque.map(n)(z, ca.repmat(p[:3], 1, n))
            rows = stacked.map(n)(z[:2, :], tau, motion.force(None, p))
            found.append(ca.Function("quantities", [p], [ca.vertcat(z[0, :], rows)]))
        return found

    def margins(self, point: Point) -> list[Array] | None:
        """All rows of the program at all samples, scaled, per case (rows, n); None if the biped falls."""
        found = []
        for case, function in zip(self.cases, self.quantities, strict=True):
            ends = np.cumsum([1, *(limit.quantity.size1_out(0) for limit in case.limits)])
            theta, *parts = np.vsplit(function(point.p).full(), ends[:-1])
            if not (np.isfinite(theta).all() and np.abs(theta).max() < FALLEN):
                return None
            rows = [
                row
                for limit, quantity in zip(case.limits, parts, strict=True)
                for row in self.rows(case, limit, quantity, point.v)
            ]
            found.append(np.vstack(rows))
        return found

    def rows(self, case: Case, limit: Limit, quantity: Any, v: Any) -> list[Any]:
        """Rows >= 0 that ``limit`` gives the program, scaled: against what is required, and against the objective."""
        return [row - of * v for row, of in limit_rows(self.question, self.goal, case, limit, quantity)]


class _InSlabs:
    """The function p = (K, v) -> theta and all quantities of a ``case`` with many samples, for numbers alone."""

    def __init__(self, case: Case, motion: Motion, stacked: ca.Function) -> None:
        self._torque, self._motion, self._stacked = case.loop.torque, motion, stacked

    def __call__(self, p: Array) -> _Dense:
        motion = self._motion
        z = motion.in_slabs(p)
        tau = mapped(self._torque, [z, np.broadcast_to(p[:3, None], (3, z.shape[1]))])
        F = np.asarray(ca.DM(motion.force(None, ca.DM(p))))
        return _Dense(np.vstack([z[:1], mapped(self._stacked, [z[:2], tau, F])]))


class _Dense:
    """An array with the one method of CasADi's matrices that is called here."""

    def __init__(self, array: Array) -> None:
        self._array = array

    def full(self) -> Array:
        """The array."""
        return self._array


def limit_rows(question: Question, goal: Goal, case: Case, limit: Limit, quantity: Any) -> list[tuple[Any, float]]:
    """(row, 1 if v is to be subtracted, else 0): what must be >= 0."""
    rows: list[tuple[Any, float]] = []
    level = limit.hard_level
    if case.sized is None and limit.id in goal.limits:
        rows.append((goal.sign * quantity / limit.scale, 1.0))  # v itself is bounded below by the hard level
    elif level is not None and not (limit.id == "cop-margin" and level <= 0):  # contact >= 0 says the same, smoothly
        margin = limit.margin(quantity, level) / limit.scale
        rows.append((margin, 1.0) if goal.id == "feasibility" else (margin - BACKOFF, 0.0))
    if goal.id == "goals" and limit.required is not None and limit.required.soft:
        id = "contact-force" if limit.id in ("toe-force", "heel-force") else limit.id
        rows.append((limit.margin(quantity, limit.required.level) / question.size_of(id), 1.0))
    return rows
