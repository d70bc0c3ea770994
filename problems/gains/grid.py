"""The time grids on which trajectories are looked at, and the rows that they give."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
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
from problems.gains.approach import Branch, Path, paths
from problems.gains.goal import BACKOFF, FEASIBILITY, Goal
from problems.gains.question import Case, Question

Array = NDArray[np.float64]
Instants = tuple[tuple[int, ...], ...]
Branches = tuple[Branch | None, ...]


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
        """The samples of each case; those of the report at full resolution, and the marks too on a coarser grid."""
        found = []
        for case in self.cases:
            deadline.check()
            steps = case.scenario.steps(self.step)
            marked = case.marks and self.step > self.question.setting.step
            found.append(case.scenario.steps_at(np.append(steps.t, case.marks)) if marked else steps)
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
        if [self._built(mine) for mine in self.cases] == [self._built(its) for its in cases]:
            vars(found)["cases"] = [
                replace(its, loop=mine.loop, scenario=mine.scenario)
                for mine, its in zip(self.cases, cases, strict=True)
            ]
            for name in ("samples", "whole", "quantities"):
                vars(found)[name] = getattr(self, name)
        return found

    def _built(self, case: Case) -> tuple[Any, ...]:
        """What of a case its samples and functions depend on."""
        coarse = self.step > self.question.setting.step
        return case.sized, case.rate is None, case.marks if coarse else ()

    def motions(self, instants: Instants, branches: Branches) -> list[tuple[Case, Motion, list[int]]]:
        """Each case's trajectory as a function of (K, v), and where the samples ``instants`` are on its mesh.

        After them come those of the branch, the farthest one and the one at the corner.
        """
        chosen_ones = [
            [*chosen, *(() if path is None or branch is None else (branch.farthest, path.to.first))]
            for chosen, path, branch in zip(instants, self.paths, branches, strict=True)
        ]
        if self.exact:
            return list(zip(self.cases, self.whole, chosen_ones, strict=True))
        found = []
        for case, steps, seen in zip(self.cases, self.samples, chosen_ones, strict=True):
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
    def paths(self) -> list[Path | None]:
        """The approach to the final posture in each case; None where nothing is asked of it."""
        return paths(self.question, self.goal, self.cases, self.samples)

    def branches(self, point: Point, *, wide: bool = True) -> Branches | None:
        """The smooth branch of the approach at ``point``, in each case; None if the biped falls."""
        if not any(self.paths):
            return tuple(None for _ in self.cases)
        found = self._evaluated(point)
        return None if found is None else self._branches([theta for theta, *_ in found], wide=wide)

    def _branches(self, thetas: list[Array], *, wide: bool = True) -> Branches:
        """The objective is asked from the longest settling time on, everywhere."""
        both = list(zip(self.paths, thetas, strict=True))
        T = max((path.settling(theta[0])[1] for path, theta in both if path is not None), default=0.0)
        return tuple(None if path is None else path.branch(theta[0], T, wide=wide) for path, theta in both)

    def kept(self, v: float, branches: Branches) -> float:
        """The objective at an answer where the program says ``v`` and the branches are these."""
        sought = min((branch.v for branch in branches if branch is not None), default=math.inf)
        return sought if self.goal.id == "settling" else min(v, sought)

    @cached_property
    def quantities(self) -> list[Any]:
        """For each case: (K, v) -> theta and the quantities of all that is asked, a row each, at all samples."""
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
            if case.rate is not None:
                rows = ca.vertcat(rows, case.rate.quantity.map(n)(z, motion.force(None, p), ca.repmat(p[:3], 1, n)))
            found.append(ca.Function("quantities", [p], [ca.vertcat(z[0, :], rows)]))
        return found

    def _evaluated(self, point: Point) -> list[list[Array]] | None:
        """Theta and the quantities at all samples, per case; None if the biped falls."""
        found = []
        for case, function in zip(self.cases, self.quantities, strict=True):
            ends = np.cumsum([1, *(limit.quantity.size1_out(0) for limit in case.along)])
            parts = np.vsplit(function(point.p).full(), ends[:-1])
            if not (np.isfinite(parts[0]).all() and np.abs(parts[0]).max() < FALLEN):
                return None
            found.append(parts)
        return found

    def margins(self, point: Point, branches: Branches | None = None) -> list[Array] | None:
        """All rows of the program at all samples, scaled, per case (rows, n); None if the biped falls.

        On the smooth ``branches`` of the approach, or on those of the point itself.
        """
        evaluated = self._evaluated(point)
        if evaluated is None:
            return None
        if branches is None:
            branches = self._branches([theta for theta, *_ in evaluated])
        found = []
        for case, path, branch, (theta, *parts) in zip(self.cases, self.paths, branches, evaluated, strict=True):
            rows = [
                row
                for limit, quantity in zip(case.along, parts, strict=True)
                for row in self.rows(case, limit, quantity, point.v)
            ]
            if path is not None and branch is not None:
                e = theta - path.to.theta_f
                far, first = e[0, branch.farthest], e[0, path.to.first]
                rows += path.rows(branch, np.arange(e.size), e, None, far, first, point.v)
            found.append(np.vstack(rows))
        return found

    def names(self) -> list[list[str]]:
        """The id of each row of ``margins``, per case."""
        found = []
        for case, path in zip(self.cases, self.paths, strict=True):
            own = [
                limit.id
                for limit in case.along
                for row in self.rows(case, limit, np.zeros((limit.quantity.size1_out(0), 1)), 0.0)
                for _ in row
            ]
            found.append(own + ([] if path is None else path.names))
        return found

    def rows(self, case: Case, limit: Limit, quantity: Any, v: Any) -> list[Any]:
        """Rows >= 0 that ``limit`` gives the program, scaled: against what is required, and against the objective."""
        return [row - of * v for row, of in limit_rows(self.question, self.goal, case, limit, quantity)]


class _InSlabs:
    """The function p = (K, v) -> theta and all quantities of a ``case`` with many samples, for numbers alone."""

    def __init__(self, case: Case, motion: Motion, stacked: ca.Function) -> None:
        self._case, self._motion, self._stacked = case, motion, stacked

    def __call__(self, p: Array) -> _Dense:
        case, motion = self._case, self._motion
        z = motion.in_slabs(p)
        K = np.broadcast_to(p[:3, None], (3, z.shape[1]))
        F = np.asarray(ca.DM(motion.force(None, ca.DM(p))))
        rows = [z[:1], mapped(self._stacked, [z[:2], mapped(case.loop.torque, [z, K]), F])]
        if case.rate is not None:
            rows.append(mapped(case.rate.quantity, [z, F, K]))
        return _Dense(np.vstack(rows))


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
