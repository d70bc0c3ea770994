"""Which gains are best? Gain synthesis for the paper's laws.

::

    maximise    v                                          the chosen margin, see below
    over        K = (K_p, K_d, K_f) in its bounds
    subject to  poles of (24) at -sigma or left of it, for every A of every scenario, i.e. (26)-(29)
                F_T(t), F_H(t) >= required                 at every sample of every scenario
                the spec's other hard requirements         likewise

``decay-rate``: v = sigma. ``contact-force``: v <= F_T(t), F_H(t). ``cop-margin``: v <= ell - |P(t)|.
``routh-margin``: v <= each normalised slack of (27)-(29), see ``design.model.stability.normalised_slacks``.

*The poles.* The tests q_2 >= 0, q_0 >= 0, q_2 q_1 >= q_0 on the polynomial shifted by sigma are not enough when they
are closed, as constraints of a program are: q_2 = q_0 = 0 with q_1 < 0 passes them, with a pole on the right,
and an optimiser finds that corner. Nor is there a constraint qualification at a triple pole, where the best decay rate
often lies. Therefore the polynomial is factored: (mu + a)(mu² + b mu + c) with a, b, c >= 0 as variables of the program
is every cubic without roots in the open right half-plane, and nothing else. The coefficients are affine in A, so that
the two ends of its range suffice (law (20): every environment on the way).

*The samples.* The trajectory is a function of K alone (single shooting with exact sensitivities, ``design.analysis.
motion``). Of the samples, which are many thousands, a program sees few; those that its answer violates, or that lie
lowest, are added until none at full resolution is violated (exchange, as in semi-infinite programming: Hettich and
Kortanek, SIAM Review 35, 1993).

*The starts.* A survey of the box gives the starts; all are optimised on a coarse time grid, the best of the distinct
optima at full resolution. The answer is judged by ``design.analysis.verdict`` and by a second integrator that shares
nothing with this program; if they disagree with the solver, they win.

*No feasible point.* Then the smallest margin of all requirements, each in its scale, is maximised instead: the answer
says which requirement stands in the way, and by how much the best point misses it.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design.analysis.motion import Motion
from design.analysis.obstacles import obstacles
from design.analysis.recheck import load_integrator, second_opinion
from design.analysis.rows import Row, Verdict
from design.analysis.simulate import FALLEN, all_quantities
from design.analysis.survey import best_apart, candidates, in_batches
from design.analysis.synthesis import OBJECTIVE_UNITS, Active, Answer, Synthesis
from design.analysis.verdict import judge, worst
from design.errors import BadInput
from design.model.closed_loop import ClosedLoop, closed_loop
from design.model.environment import Steps
from design.model.laws import Gains
from design.model.limits import Limit, Required, limits
from design.model.stability import characteristic, deciding_points, normalised_slacks, shifted
from design.solvers.nlp import Ipopt, Nlp
from design.solvers.outcome import Outcome, Status
from design.spec.setting import Setting

Array = NDArray[np.float64]
Goal = Literal["decay-rate", "contact-force", "cop-margin", "routh-margin", "feasibility"]
Instants = tuple[tuple[int, ...], ...]
Say = Callable[[str], None]

BACKOFF = 1e-8
"""How far inside a requirement, in its scale, the program stays, so that rounding does not break it."""
VIOLATED = 1e-9
"""Violation of a sample, in its scale, from which it is added to the program."""
CANDIDATES = 256
MISSES = 3
"""Nearest misses, from so many starts without a feasible point, after which the search ends."""
COARSE_TOLERANCE = 1e-6
COARSEST = 0.01
"""Longest step of the coarse time grid [s]."""
FAR = 0.04
"""Margin of a sample, in its scale, from which the program may forget it."""
NEAR = 0.01
"""Margin of a sample, in its scale, up to which the next program begins with it."""
ROUNDS = 25


class Question:
    """The parts of the program that do not change: loop, limits, environments, bounds, scales."""

    def __init__(self, setting: Setting) -> None:
        if setting.bounds is None:
            message = (
                "is missing; give [synthesis.bounds] with kp, kd, kf as [lower, upper]: nothing else limits the gains"
            )
            raise BadInput(message, key="synthesis.bounds")
        self.setting = setting
        self.loop: ClosedLoop = closed_loop(setting.biped, setting.law, setting.theta_d)
        self.limits: list[Limit] = limits(self.loop.plant, setting.required)
        bounds = setting.bounds.copy()
        if setting.law == "pd":
            bounds[2] = 0.0
        self.upper: Array = bounds[:, 1]
        self.lower: Array = bounds[:, 0]
        self.scale: Array = np.where(self.upper > 0, self.upper, 1.0)
        biped = setting.biped
        A, load = (
            np.concatenate(part)
            for part in zip(*(scenario.operating_points(biped) for scenario in setting.scenarios), strict=True)
        )
        self.environments: list[tuple[float, float]] = list(zip(*deciding_points(setting.law, A, load), strict=True))
        self.pace: float = float(np.sqrt(max(self.upper[0], 1e-9) / biped.I))
        """A typical frequency of the loop [1/s], the scale of decay rates."""

    @property
    def decay(self) -> float:
        """The decay rate that must be kept [1/s]; a trace above 0, since poles on the axis are not stable."""
        wish = self.setting.required.get("decay-rate", Required(level=0.0))
        return max(0.0 if wish.soft else wish.level, 1e-7 * self.pace)

    @property
    def coarse_step(self) -> float:
        """A longer integration step that the fastest loop within the bounds allows [s]."""
        biped = self.setting.biped
        fastest = max(self.upper[1] / biped.I, self.pace, self.upper[2] / biped.ell)
        return float(max(self.setting.step, min(COARSEST, 2.0 / fastest)))

    def grid(self, step: float) -> Grid:
        """The scenarios on time grids of ``step`` [s]."""
        return Grid(question=self, step=step)

    def score(self, goal: Goal, gains: Gains, verdict: Verdict) -> float:
        """The objective's value at ``gains``, from the rows of its verdict."""
        if goal == "decay-rate":
            return min(row.value for row in verdict.rows if row.id == "decay-rate" and row.value is not None)
        if goal == "routh-margin":
            return min(
                float(slack)
                for A, load in self.environments
                for slack in normalised_slacks(self.setting.biped, self.setting.law, gains, A, load)
            )
        ids = _objective_rows(goal)
        values = [row.value for row in verdict.rows if row.id in ids]
        return min((float("-inf") if value is None else value) for value in values)


@dataclass(frozen=True, eq=False)
class Grid:
    """Samples of every scenario, ``step`` apart, at which rows are checked, and the meshes that programs march on.

    At full resolution a program marches with the coarse step and lands on the samples it sees; the difference that
    this makes to a row (some 1e-7 of its scale) is measured at each answer and added to the row in the next round.
    """

    question: Question
    step: float

    @cached_property
    def samples(self) -> list[Steps]:
        """The samples of each scenario."""
        return [scenario.steps(self.step) for scenario in self.question.setting.scenarios]

    @cached_property
    def whole(self) -> list[Motion]:
        """Each scenario's trajectory on the samples themselves."""
        return [
            Motion(self.question.loop, scenario, steps)
            for scenario, steps in zip(self.question.setting.scenarios, self.samples, strict=True)
        ]

    @property
    def exact(self) -> bool:
        """Whether programs march on the samples themselves."""
        return self.step >= self.question.coarse_step

    def motions(self, instants: Instants) -> list[tuple[Motion, list[int]]]:
        """Each scenario's trajectory as a function of the gains, and where the samples ``instants`` are on its mesh."""
        if self.exact:
            return [(motion, list(chosen)) for motion, chosen in zip(self.whole, instants, strict=True)]
        found = []
        for scenario, steps, chosen in zip(self.question.setting.scenarios, self.samples, instants, strict=True):
            seen = list(chosen)
            times = np.concatenate([scenario.steps(self.question.coarse_step).t, steps.t[seen]])
            mesh = scenario.steps_at(times)
            after_jump = np.array([k > 0 and steps.t[k] == steps.t[k - 1] for k in seen], dtype=bool)
            at = np.searchsorted(mesh.t, steps.t[seen]) + after_jump
            found.append((Motion(self.question.loop, scenario, mesh), [int(k) for k in at]))
        return found

    def thinned(self, count: int = 12) -> Instants:
        """``count`` samples of each scenario, evenly spread."""
        return tuple(tuple(sorted({int(k) for k in np.linspace(0, len(steps.t) - 1, count)})) for steps in self.samples)

    @cached_property
    def quantities(self) -> list[ca.Function]:
        """For each scenario: K -> theta and the quantities of all limits, a row each, at all samples."""
        question = self.question
        K = ca.MX.sym("K", 3)
        stacked = all_quantities([limit.quantity for limit in question.limits])
        found = []
        for motion in self.whole:
            z = motion.all_states(K)
            n = z.size2()
            tau = question.loop.torque.map(n)(z, ca.repmat(K, 1, n))
            rows = stacked.map(n)(z[:2, :], tau, ca.DM(motion.steps.force))
            found.append(ca.Function("quantities", [K], [ca.vertcat(z[0, :], rows)]))
        return found

    def margins(self, gains: Gains, goal: Goal, v: float) -> list[Array] | None:
        """All rows of the program at all samples, scaled, per scenario (rows, n); None if the biped falls."""
        question = self.question
        ends = np.cumsum([1, *(limit.quantity.size1_out(0) for limit in question.limits)])
        found = []
        for function in self.quantities:
            theta, *parts = np.vsplit(function(np.array(gains)).full(), ends[:-1])
            if not (np.isfinite(theta).all() and np.abs(theta).max() < FALLEN):
                return None
            rows = [
                row
                for limit, quantity in zip(question.limits, parts, strict=True)
                for row in limit_margins(limit, quantity, goal, v)
            ]
            found.append(np.vstack(rows))
        return found


def _objective_rows(goal: Goal) -> tuple[str, ...]:
    return {"contact-force": ("toe-force", "heel-force"), "cop-margin": ("cop-margin",)}.get(goal, ())


def limit_margins(limit: Limit, quantity: Any, goal: Goal, v: Any) -> list[Any]:
    """Rows >= 0 that ``limit`` gives the program, scaled: against what is required, and against the objective ``v``."""
    rows = []
    level = limit.hard_level
    if limit.id in _objective_rows(goal):
        rows.append(quantity / limit.scale - v)  # v itself is bounded below by the hard level
    elif level is not None and not (limit.id == "cop-margin" and level <= 0):  # contact >= 0 says the same, smoothly
        relax = v if goal == "feasibility" else BACKOFF
        rows.append(limit.margin(quantity, level) / limit.scale - relax)
    return rows


@dataclass(frozen=True, eq=False, kw_only=True)
class Point:
    """A point of the program: gains, and the objective ``v`` in its scale."""

    gains: Gains
    v: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Read:
    """Between named quantities and the solver's vector: x = (K/scale, v, factors of each environment)."""

    question: Question
    goal: Goal

    def point(self, x: Array) -> Point:
        """The gains and the objective in ``x``."""
        K = np.clip(x[:3] * self.question.scale, self.question.lower, self.question.upper)
        return Point(gains=Gains(*map(float, K)), v=float(x[3]))

    def start(self, point: Point) -> Array:
        """A vector whose factors fit the poles of ``point`` as well as they can."""
        question = self.question
        rate = _sigma(question, self.goal, point.v)
        factors: list[float] = []
        for A, load in question.environments:
            p = characteristic(question.setting.biped, question.setting.law, point.gains, A, load)
            roots = np.roots([1.0, *shifted([float(c) for c in p], rate)]) / question.pace
            roots = np.minimum(roots.real, -1e-3) + 1j * roots.imag
            if len(p) == 2:
                factors += [-float(roots.sum().real), float(roots.prod().real)]
            else:
                real = int(np.argmin(np.abs(roots.imag)))
                rest = np.delete(roots, real)
                factors += [-float(roots[real].real), -float(rest.sum().real), float(rest.prod().real)]
        return np.array([*(np.array(point.gains) / question.scale), point.v, *factors])


def _sigma(question: Question, goal: Goal, v: Any) -> Any:
    """The decay rate that the poles must have [1/s]."""
    if goal == "decay-rate":
        return v * question.pace
    if goal == "feasibility":
        return question.decay + v * question.pace
    return question.decay * (1 + BACKOFF)


def pose(grid: Grid, goal: Goal, instants: Instants, shift: Array | None = None) -> tuple[Nlp, Read]:
    """The program that sees the samples ``instants`` of each scenario; ``shift`` is added to its sampled rows.

    The sampled rows come first: by scenario, then by sample, then in the order of ``Grid.margins``.
    """
    question = grid.question
    setting, loop = question.setting, question.loop
    u, v = ca.MX.sym("u", 3), ca.MX.sym("v")
    K = u * ca.DM(question.scale)
    rows: list[Any] = []
    equal: list[Any] = []

    for motion, chosen in grid.motions(instants):
        if not chosen:
            continue
        n = len(chosen)
        z = motion.states(chosen)(K)
        F = ca.DM(motion.steps.force[:, chosen])
        tau = loop.torque.map(n)(z, ca.repmat(K, 1, n))
        parts = [
            part
            for limit in question.limits
            for part in limit_margins(limit, limit.quantity.map(n)(z[:2, :], tau, F), goal, v)
        ]
        if parts:
            rows.append(ca.vec(ca.vertcat(*parts)))
    if shift is not None and rows:
        rows = [ca.vertcat(*rows) + ca.DM(shift)]

    factors = []
    for A, load in question.environments:
        p = characteristic(setting.biped, setting.law, ca.vertsplit(K), A, load)
        q = shifted(p, _sigma(question, goal, v))
        a, b, c = (ca.MX.sym(name) for name in "abc")
        if len(q) == 2:
            factors += [b, c]
            product: tuple[Any, ...] = (b, c)
        else:
            factors += [a, b, c]
            product = (a + b, a * b + c, a * c)
        equal += [q[k] / question.pace ** (k + 1) - product[k] for k in range(len(q))]
        if goal == "routh-margin":
            rows += [slack - v for slack in normalised_slacks(setting.biped, setting.law, ca.vertsplit(K), A, load)]

    free = len(factors)
    low, high = _objective_range(question, goal)
    smallest = np.where(question.lower > 0, question.lower, 1e-9 * question.upper)  # poles and slacks divide by gains
    count = sum(row.numel() for row in rows)
    program = Nlp(
        x=ca.vertcat(u, v, *factors),
        f=-v,
        g=ca.vertcat(*rows, *equal),
        x_lower=np.array([*(smallest / question.scale), low, *np.zeros(free)]),
        x_upper=np.array([*(question.upper / question.scale), high, *np.full(free, np.inf)]),
        lower=np.zeros(count + len(equal)),
        upper=np.array([*np.full(count, np.inf), *np.zeros(len(equal))]),
    )
    return program, Read(question=question, goal=goal)


def _objective_range(question: Question, goal: Goal) -> tuple[float, float]:
    """Bounds of v: below, what is required of the objective itself; above, where more needs no effort."""
    if goal == "decay-rate":
        return question.decay / question.pace * (1 + BACKOFF), np.inf
    if goal == "feasibility":
        return -np.inf, 1e-3
    if goal == "routh-margin":
        return 0.0, 1.0
    levels = [(limit.hard_level or 0.0) / limit.scale for limit in question.limits if limit.id in _objective_rows(goal)]
    return max(levels) + BACKOFF, np.inf


@dataclass(frozen=True, eq=False, kw_only=True)
class Local:
    """A local optimum on a grid: the point, the samples that the program needed, and whether it converged."""

    point: Point
    instants: Instants
    converged: bool
    said: str


def exchange(grid: Grid, goal: Goal, start: Point, instants: Instants, deadline: float, *, near: bool = False) -> Local:
    """Solve on ``instants``, add what the answer violates, and repeat until nothing on ``grid`` is violated."""
    said = "round limit"
    tolerance, iterations = (COARSE_TOLERANCE, 120) if grid.exact else (1e-9, 300)
    shift = None if grid.exact else _first_shift(grid, goal, start, instants)
    for round_ in range(ROUNDS):
        program, read = pose(grid, goal, instants, shift)
        seconds = max(deadline - time.monotonic(), 0.01)
        solver = Ipopt(program, tolerance=tolerance, seconds=seconds, iterations=iterations)
        answer = solver.solve(read.start(start), near=near)
        if near and not answer.solved:
            answer = solver.solve(read.start(start))
        point, said = read.point(answer.x), answer.said
        margins = grid.margins(point.gains, goal, point.v)
        if margins is None or not answer.solved:
            return Local(point=point, instants=instants, converged=False, said=said)
        added = _lowest_below(-VIOLATED - 10 * tolerance, margins, instants, reach=2 if grid.exact else 5)
        settled = grid.exact or _mismatch(margins, instants, answer.g) <= 10 * tolerance
        if added == instants and settled:
            return Local(point=point, instants=_pruned(margins, instants, NEAR), converged=True, said=said)
        if time.monotonic() > deadline:
            said = "time limit"
            break
        following = _pruned(margins, added) if round_ < ROUNDS // 2 else added  # no going in circles
        shift = None if grid.exact else _shift(margins, following, instants, answer.g, shift)
        near = min(float(rows.min()) for rows in margins) > -NEAR
        instants, start = following, point
    return Local(point=start, instants=instants, converged=False, said=said)


def _first_shift(grid: Grid, goal: Goal, start: Point, instants: Instants) -> Array | None:
    """What to add to the rows of the first program, measured at the start."""
    margins = grid.margins(start.gains, goal, start.v)
    if margins is None:
        return None
    program, read = pose(grid, goal, instants)
    rows = ca.Function("rows", [program.x], [program.g])(read.start(start)).full().ravel()
    return _shift(margins, instants, instants, rows, None)


def _seen(margins: list[Array], instants: Instants) -> Array:
    """The exact rows at ``instants``, in the order of the program's."""
    return np.concatenate([rows[:, list(chosen)].T.ravel() for rows, chosen in zip(margins, instants, strict=True)])


def _mismatch(margins: list[Array], instants: Instants, g: Array) -> float:
    """How far the rows of the program are from the exact ones, scaled."""
    exact = _seen(margins, instants)
    return float(np.abs(exact - g[: exact.size]).max(initial=0.0))


def _shift(margins: list[Array], following: Instants, instants: Instants, g: Array, shift: Array | None) -> Array:
    """What to add to the sampled rows of the next program: exact row minus marched row, where the last one saw it."""
    exact = _seen(margins, instants)
    difference = exact - g[: exact.size] + (0.0 if shift is None else shift)
    parts, at = [], 0
    for rows, chosen, coming in zip(margins, instants, following, strict=True):
        known = np.zeros(rows.shape)
        size = rows.shape[0] * len(chosen)
        known[:, list(chosen)] = difference[at : at + size].reshape(len(chosen), rows.shape[0]).T
        parts.append(known[:, list(coming)].T.ravel())
        at += size
    return np.concatenate(parts)


def _pruned(margins: list[Array], instants: Instants, far: float = FAR) -> Instants:
    """``instants`` without those that are far from binding; should they bind later, they come back."""
    return tuple(
        tuple(k for k in chosen if rows[:, k].min() < far) for rows, chosen in zip(margins, instants, strict=True)
    )


def _lowest_below(level: float, margins: list[Array], instants: Instants, *, most: int = 8, reach: int = 5) -> Instants:
    """``instants``, and the local minima below ``level`` of each row with some of their neighbours.

    The lowest sample moves as the gains do: neighbours at distances of 1, 2, 4 ... save rounds.
    """
    near = [0, *(sign * 2**j for j in range(reach) for sign in (-1, 1))]
    found = []
    for rows, chosen in zip(margins, instants, strict=True):
        wanted = set(chosen)
        for row in rows:
            padded = np.concatenate([[np.inf], row, [np.inf]])
            low = np.flatnonzero((row <= padded[:-2]) & (row <= padded[2:]) & (row < level))
            wanted.update(int(k) + d for k in low[np.argsort(row[low])][:most] for d in near if 0 <= k + d < len(row))
        found.append(tuple(sorted(wanted)))
    return tuple(found)


def survey(grid: Grid, goal: Goal) -> tuple[Array, Array]:
    """Points of the box of gains (count, 3) and their merits (count,): v where feasible, else below any v."""
    question = grid.question
    points = candidates(question.lower, question.upper, CANDIDATES)
    given = question.setting.gains
    corner = np.array([question.upper[0], question.upper[1], max(question.lower[2], 1e-3 * question.upper[2])])
    extra = [corner] if given is None else [corner, np.clip(np.array(given), question.lower, question.upper)]
    points = np.maximum(np.vstack([*extra, points]), 1e-9 * question.upper)
    decay = np.array([question_decay(question, K) for K in points])
    merit = np.where(decay > 0, -10.0, -1e3) + np.minimum(decay / question.pace, 1.0)
    stable = np.flatnonzero(decay > 0)
    if not len(stable):
        return points, merit
    size = min(64, len(stable))
    K = ca.MX.sym("K", 3)
    lowest = ca.Function("lowest", [K], [ca.vertcat(*_lowest(grid, goal, K))]).map(size)
    found = in_batches(lambda batch: np.asarray(lowest(batch).full()), points[stable], size)
    rows = 0.0 if found.shape[0] == 1 else found[:-1].min(axis=0)
    objective = found[-1]
    if goal == "decay-rate":
        objective = decay[stable] / question.pace
    if goal == "routh-margin":
        objective = np.array(
            [
                min(
                    min(normalised_slacks(question.setting.biped, question.setting.law, k, A, load))
                    for A, load in question.environments
                )
                for k in points[stable]
            ]
        )
    missing = np.minimum(rows, (decay[stable] - question.decay) / question.pace)
    value = np.where(missing >= 0, objective, -1.0 + np.maximum(missing, -8.0))
    merit[stable] = np.where(np.isfinite(value), value, -9.5)
    return points, merit


def _lowest(grid: Grid, goal: Goal, K: ca.MX) -> list[ca.MX]:
    """The smallest scaled margin of each requirement, and last the smallest objective row (0 where none)."""
    required: list[ca.MX] = []
    objective: list[ca.MX] = []
    ends = np.cumsum([1, *(limit.quantity.size1_out(0) for limit in grid.question.limits)])
    for function in grid.quantities:
        parts = ca.vertsplit(function(K), [0, *map(int, ends)])[1:]
        for limit, part in zip(grid.question.limits, parts, strict=True):
            quantity = ca.vec(part)
            if limit.hard_level is not None:
                required.append(ca.mmin(limit.margin(quantity, limit.hard_level) / limit.scale))
            if limit.id in _objective_rows(goal):
                objective.append(ca.mmin(quantity / limit.scale))
    best = ca.mmin(ca.vertcat(*objective)) if objective else ca.MX(0.0)
    return [*required, best]


def question_decay(question: Question, K: Array) -> float:
    """The decay rate over all environments, from plain eigenvalues: quick, for the survey."""
    rates = []
    for A, load in question.environments:
        p = characteristic(question.setting.biped, question.setting.law, K, A, load)
        rates.append(-float(np.roots([1.0, *p]).real.max()))
    return min(rates)


def solve(setting: Setting, *, starts: int | None = None, seconds: float = 600.0, say: Say = lambda _: None) -> Answer:
    """Synthesize gains for ``setting``; ``say`` is told of the progress. Raises ``BadInput`` if there are no bounds."""
    question = Question(setting)
    stand_in = obstacles(setting)
    if stand_in:
        return Answer(outcome=Outcome(status=Status.INFEASIBLE, detail=str(stand_in[0])))
    deadline = time.monotonic() + seconds
    threading.Thread(target=load_integrator, daemon=True).start()  # takes as long as a start, on the other core
    goal: Goal = setting.maximise
    coarse = question.grid(question.coarse_step)
    say(f"surveying {CANDIDATES} gains")
    points, merit = survey(coarse, goal)
    count = starts or setting.starts
    chosen = best_apart(points, merit, count, question.lower, question.upper)
    merits = {tuple(K): m for K, m in zip(points, merit, strict=True)}
    optima: list[Local] = []
    misses: list[Local] = []
    instants = coarse.thinned()
    for index, K in enumerate(chosen):
        if time.monotonic() > deadline:
            return Answer(outcome=Outcome(status=Status.TIME_LIMIT, detail=f"{index} of {count} starts were tried."))
        found, optimal = _from_start(coarse, goal, K, merits[tuple(K)], instants, deadline)
        instants = _union(instants, found.instants)
        if optimal:
            optima.append(found)
        elif found.converged:
            misses.append(found)
        best = max((f.point.v for f in optima), default=None)
        say(f"start {index + 1} of {len(chosen)}: best {_shown(question, goal, best)}")
        if not optima and len(misses) == MISSES:
            break
    if not optima:
        return _nothing(question, coarse, chosen, instants, deadline, misses)
    return _finish(question, goal, optima, len(chosen), deadline, say)


def _shown(question: Question, goal: Goal, v: float | None) -> str:
    return "none yet" if v is None else f"{_in_unit(question, goal, v):.6g} {OBJECTIVE_UNITS[goal]}"


def _in_unit(question: Question, goal: Goal, v: float) -> float:
    """The objective ``v``, which the program has in its scale, in its unit."""
    scales = {limit.id: limit.scale for limit in question.limits}
    scale = {"decay-rate": question.pace, "contact-force": scales["toe-force"], "cop-margin": scales["cop-margin"]}
    return v * scale.get(goal, 1.0)


def _from_start(
    grid: Grid, goal: Goal, K: Array, merit: float, instants: Instants, deadline: float
) -> tuple[Local, bool]:
    """What is reached from ``K``, and whether that is an optimum of ``goal``: else it is the nearest miss, or nothing.

    A start that is not feasible goes through feasibility first.
    """
    point = Point(gains=Gains(*map(float, K)), v=merit)
    margins = grid.margins(point.gains, goal, max(merit, 0.0))
    if margins is not None:
        instants = _pruned(margins, _lowest_below(FAR, margins, instants, most=3, reach=0))
    if merit < -0.5:
        near = replace(point, v=max(merit + 1.0, -2.0))
        feasible = exchange(grid, "feasibility", near, instants, deadline)
        if not feasible.converged or feasible.point.v < -1e-6:
            return feasible, False
        low, _ = _objective_range(grid.question, goal)
        instants = _union(instants, feasible.instants)
        point = Point(gains=feasible.point.gains, v=low)
    found = exchange(grid, goal, point, instants, deadline)
    return found, found.converged


def _union(one: Instants, other: Instants) -> Instants:
    return tuple(tuple(sorted({*a, *b})) for a, b in zip(one, other, strict=True))


def _finish(question: Question, goal: Goal, optima: list[Local], tried: int, deadline: float, say: Say) -> Answer:
    """Carry the best optima to full resolution, and check the winner by other means."""
    optima = sorted(optima, key=lambda found: -found.point.v)
    best = optima[0].point
    same = 1e-4 * (abs(best.v) + 1e-3)
    reached = sum(found.point.v >= best.v - same for found in optima)
    distinct = [optima[0]]
    for found in optima[1:]:
        if all(_apart(question, found.point, other.point) for other in distinct):
            distinct.append(found)
    fine = question.grid(question.setting.step)
    polished = []
    for found in distinct[:3]:
        if found.point.v < best.v - 0.02 * (abs(best.v) + 0.01):
            continue
        say("refining at full resolution")
        margins = fine.margins(found.point.gains, goal, found.point.v)
        seen = _lowest_below(NEAR, margins, tuple(() for _ in margins)) if margins else fine.thinned()
        polished.append(exchange(fine, goal, found.point, seen, deadline, near=True))
    done = [found for found in polished if found.converged]
    if not done:
        status = Status.TIME_LIMIT if time.monotonic() > deadline else Status.STALLED
        return Answer(outcome=Outcome(status=status, detail=f"IPOPT: {polished[0].said}."), starts=tried)
    winner = max(done, key=lambda found: found.point.v)
    say("checking")
    return _checked(question, goal, winner, tried, reached, len(distinct))


def _apart(question: Question, one: Point, other: Point) -> bool:
    return float(np.abs((np.array(one.gains) - np.array(other.gains)) / question.scale).max()) > 1e-3


def _checked(question: Question, goal: Goal, winner: Local, tried: int, reached: int, optima: int) -> Answer:
    gains, verdict, value = _snapped(question, goal, winner.point.gains)
    claim = _in_unit(question, goal, winner.point.v)
    synthesis = Synthesis(
        gains=gains, objective=goal, value=value, active=_active(question, goal, gains, verdict, value),
        verdict=verdict, starts=tried, reached=reached, optima=optima,
    )  # fmt: skip
    doubt = _doubt(question, goal, gains, verdict)
    slack = 1e-3 if goal == "decay-rate" else 1e-5  # at a triple pole the gains' last digits cost that much
    if value < claim - slack * (abs(claim) + 1e-3 * _in_unit(question, goal, 1.0)):
        doubt = (
            doubt
            or f"{goal}: the program claims {claim:.8g}, the trajectory gives {value:.8g} {OBJECTIVE_UNITS[goal]}."
        )
    if verdict.overall != "met":
        row = next(row for row in verdict.rows if row.counts and row.status == verdict.overall)
        doubt = doubt or f"{row.id} in scenario {row.scenario!r} is {row.status}. {row.note}".strip()
    if doubt:
        return Answer(outcome=Outcome(status=Status.DISAGREEMENT, detail=doubt), missed=verdict.rows, starts=tried)
    setting = question.setting
    given = None if setting.gains is None else question.score(goal, setting.gains, judge(setting, setting.gains))
    return Answer(outcome=Outcome(status=Status.SOLVED, found=synthesis), starts=tried, given=given)


def _snapped(question: Question, goal: Goal, gains: Gains) -> tuple[Gains, Verdict, float]:
    """The gains with those that touch a bound put on it, unless that costs anything."""
    verdict = judge(question.setting, gains)
    value = question.score(goal, gains, verdict)
    K = np.array(gains)
    for bound in (question.lower, question.upper):
        K = np.where(np.abs(K - bound) <= 1e-6 * question.scale, bound, K)
    snapped = Gains(*map(float, K))
    if snapped == gains:
        return gains, verdict, value
    other = judge(question.setting, snapped)
    its = question.score(goal, snapped, other)
    if other.overall == "met" and its >= value - 1e-7 * abs(value):
        return snapped, other, its
    return gains, verdict, value


def _doubt(question: Question, goal: Goal, gains: Gains, verdict: Verdict) -> str:
    """What a second integrator and eigenvalues say against the rows, or an empty string."""
    setting = question.setting
    for scenario in setting.scenarios:
        opinion = second_opinion(setting.biped, setting.law, setting.theta_d, gains, scenario, setting.step)
        if not opinion.finished:
            return f"In scenario {scenario.name!r} the second integrator does not reach the end."
        rows = {row.id: row for row in verdict.rows if row.scenario == scenario.name}
        for id, force in (("toe-force", opinion.F_T), ("heel-force", opinion.F_H)):
            value, scale = rows[id].value, setting.biped.weight
            lowest = float(force.min())
            if value is None or abs(lowest - value) > 1e-5 * scale:
                return (
                    f"{id} in scenario {scenario.name!r}: {value} N with the step of {setting.step:g} s,"
                    f" {lowest:.8g} N with an adaptive integrator."
                )
    slowest = question_decay(question, np.array(gains))
    claimed = worst(verdict.rows, "decay-rate").value
    if slowest <= 0 or claimed is None or abs(slowest - claimed) > 1e-3 * question.pace:
        return f"decay-rate: {claimed} 1/s by the polynomial, {slowest:.8g} 1/s by eigenvalues."
    return ""


def _active(question: Question, goal: Goal, gains: Gains, verdict: Verdict, value: float) -> tuple[Active, ...]:
    """Bounds and rows that are tight at the optimum."""
    found = []
    for name, gain, low, high in zip(("kp", "kd", "kf"), gains, question.lower, question.upper, strict=True):
        for bound in {float(low), float(high)}:
            if abs(gain - bound) <= 1e-6 * max(high, 1e-300):
                found.append(Active(id=name, scenario=None, time_s=None, value=gain, required=bound))
    scales = {limit.id: limit.scale for limit in question.limits} | {"decay-rate": question.pace}
    for row in verdict.rows:
        if row.value is None or row.id not in scales:
            continue
        if row.id in _objective_rows(goal) and abs(row.value - value) <= 1e-6 * scales[row.id]:
            found.append(Active(id=row.id, scenario=row.scenario, time_s=row.time_s, value=row.value, required=value))
        elif row.counts and row.id != goal and row.margin is not None and row.margin <= 1e-6 * scales[row.id]:
            found.append(
                Active(
                    id=row.id, scenario=row.scenario, time_s=row.time_s, value=row.value, required=row.required or 0.0
                )
            )
    return tuple(found)


def _nothing(
    question: Question, grid: Grid, starts: Array, instants: Instants, deadline: float, misses: list[Local]
) -> Answer:
    """No start led to a feasible point: say what the point that misses the requirements by least misses."""
    for K in starts if not misses else ():
        found = exchange(grid, "feasibility", Point(gains=Gains(*map(float, K)), v=-0.5), instants, deadline)
        if found.converged:
            misses.append(found)
            break
    if not misses:
        status = Status.TIME_LIMIT if time.monotonic() > deadline else Status.NOT_FOUND
        return Answer(outcome=Outcome(status=status, detail="Not even the nearest miss was found."), starts=len(starts))
    best = max(misses, key=lambda found: found.point.v)
    verdict = judge(question.setting, best.point.gains)
    missed = tuple(row for row in verdict.rows if row.counts and row.status != "met")
    if not missed:
        return Answer(
            outcome=Outcome(status=Status.STALLED, detail="The optimiser did not converge."), starts=len(starts)
        )
    return Answer(outcome=Outcome(status=Status.NOT_FOUND, detail=_miss(missed)), missed=missed, starts=len(starts))


def _miss(missed: tuple[Row, ...]) -> str:
    parts = []
    for row in missed:
        if row.value is None or row.margin is None:
            parts.append(f"{row.id} in scenario {row.scenario!r}: {row.note}")
        else:
            parts.append(
                f"{row.id} in scenario {row.scenario!r} reaches {row.value:.6g} {row.unit} of {row.required:.6g}"
                f" (misses by {-row.margin:.4g})"
            )
    return "At the point that misses by least, " + "; ".join(parts) + "."
