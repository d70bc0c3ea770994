"""Where to start: a survey of the box of gains, and the way from one start to a local optimum on the coarse grid."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design import deadline
from design.analysis.spread import in_cube
from design.analysis.survey import best_apart, candidates, in_batches
from design.analysis.survival import push, step_slope
from design.model.laws import Gains
from problems.gains.exchange import FAR, Local, lowest_below, pruned, union
from problems.gains.goal import FEASIBILITY, Goal
from problems.gains.grid import Grid, Instants, Point, limit_rows
from problems.gains.modelled import margins, wanted
from problems.gains.pieces import values
from problems.gains.program import objective_range
from problems.gains.question import SURVIVALS, Question, question_decay
from problems.gains.sequential import meets, optimise

Array = NDArray[np.float64]

CANDIDATES = 256
DECADES = 2.5
"""How far below its bound K_d is tried."""
FINEST = 3.0
"""How far below what (29) allows K_f is tried, in decades."""
BATCH = 64
AT_ONCE = 2_000_000
"""Samples of all runs that are marched at once, at most."""
CLEARLY = 0.2
"""Margin, in its scale, by which a requirement is missed clearly."""
CLOSER = 24
"""Candidates of which also the rows are looked at that take longer."""
CLOSE = 0.1
"""Smallest margin, in its scale, at which a nearest miss may be one of the search and not of the specification."""
MISSED = -100.0
"""Merit of what just misses a requirement; what is feasible has a greater one."""
UNKNOWN = -50.0
"""Merit of what seems feasible but has not been looked at closely."""


def survey(grid: Grid) -> tuple[Array, Array]:
    """Points of the box of gains (count, 3) and their merits (count,): v where feasible, else ``MISSED`` or less."""
    question, goal = grid.question, grid.goal
    points = _candidates(question)
    own = question.setting.gains
    corner = np.array([question.upper[0], question.upper[1], max(question.lower[2], 1e-3 * question.upper[2])])
    extra = [corner] if own is None else [corner, np.clip(np.array(own), question.lower, question.upper)]
    points = np.maximum(np.vstack([*extra, points]), 1e-9 * question.upper)
    decay = np.array([question_decay(question, K) for K in points])
    merit = np.where(decay > 0, MISSED - 10.0, -1e3) + np.minimum(decay / question.pace, 1.0)
    stable = np.flatnonzero(decay > 0)
    if not len(stable):
        return points, merit
    rows, objective = _lowest_rows(grid, points[stable])
    if goal.id == "decay-rate":
        objective = decay[stable] / question.pace
    elif goal.id == "routh-margin":
        objective = np.array([min(min(each.slacks(k)) for each in question.environments) for k in points[stable]])
    elif goal.gain is not None:
        objective = goal.sign * points[stable, goal.gain] / goal.scale
    elif goal.id == "goals" and (wish := question.wish("decay-rate")) is not None:
        objective = np.minimum(objective, (decay[stable] - wish) / question.size_of("decay-rate"))
    short = np.minimum(rows, (decay[stable] - question.decay) / question.pace)
    value = np.where(short >= 0, np.maximum(objective, UNKNOWN), MISSED + np.maximum(short, -8.0))
    merit[stable] = np.where(np.isfinite(value), value, MISSED - 9.0)
    return points, _closer(grid, points, merit)


def _candidates(question: Question) -> Array:
    """``CANDIDATES`` gains: half of them spread over the working box, half over the stable part of it.

    The stable ones have K_p from A L on (27), K_d over ``DECADES``, and K_f a part of what (29) allows beside them, all
    evenly in their logarithms: however wide the box is, they are where designs can be.
    """
    lower, upper = question.lower, question.upper
    points = candidates(lower, upper, CANDIDATES)
    if question.setting.law == "pd":
        return points
    cube = in_cube(CANDIDATES // 2, 3)
    places = [each.place for each in question.environments]
    biped = question.setting.biped
    AL = max(max(place.A, 0.0) for place in places) * biped.L
    beta = max(place.beta for place in places)
    least = np.clip(1.02 * AL, max(lower[0], 1e-9 * upper[0]), upper[0])
    K_p = least * (upper[0] / least) ** cube[:, 0]
    K_d = upper[1] * 10.0 ** (-DECADES * (1 - cube[:, 1]))
    most = biped.ell * K_d * np.maximum(1 - AL / K_p, 0.0) / max(biped.I + beta, 0.1 * biped.I)
    K_f = most * 10.0 ** (-FINEST * (1 - cube[:, 2]))
    stable = np.clip(np.column_stack([K_p, K_d, K_f]), lower, upper)
    return np.vstack([points[: CANDIDATES - len(stable)], stable])


def missing(grid: Grid, points: Array) -> Array:
    """The smallest scaled margin (n,) of all hard requirements at gains ``points`` (n, 3); below 0 what is missed.

    Of points that miss the sampled rows or the poles by more than ``CLEARLY`` the other rows are not looked at.
    """
    question = grid.question
    ids = wanted(question, FEASIBILITY)
    decay = np.array([question_decay(question, K) for K in points])
    margins = np.where(decay > 0, 0.0, -10.0) + np.clip((decay - question.decay) / question.pace, -10.0, 10.0)
    stable = np.flatnonzero(decay > 0)
    if len(stable):
        rows, _ = _lowest_rows(grid.feasibility, points[stable], FEASIBILITY)
        margins[stable] = np.minimum(margins[stable], np.where(np.isfinite(rows), np.maximum(rows, -9.0), -9.0))
    for k in np.flatnonzero(margins > -CLEARLY) if ids else ():
        _, short = _slow_rows(grid, ids, points[k], FEASIBILITY)
        margins[k] = min(float(margins[k]), short)
    return margins


def _lowest_rows(grid: Grid, points: Array, goal: Goal | None = None) -> tuple[Array, Array]:
    """The smallest scaled margin of the sampled requirements (n,), and the smallest objective row (n,)."""
    samples = max(len(steps.t) for steps in grid.samples)
    size = max(1, min(BATCH, len(points), AT_ONCE // samples))
    lowest = _mapped(grid, size)
    rows, objective = in_batches(lambda batch: np.asarray(lowest(batch).full()), points, size)
    return (np.minimum(rows, objective), objective) if goal is not None else (rows, objective)


@lru_cache(maxsize=4)
def _mapped(grid: Grid, size: int) -> ca.Function:
    K = ca.MX.sym("K", 3)
    return ca.Function("lowest", [K], [_lowest(grid, K)]).map(size)


def _closer(grid: Grid, points: Array, merit: Array) -> Array:
    """The merits with the rows that take longer, of the best candidates that lie apart."""
    question, goal = grid.question, grid.goal
    ids = wanted(question, goal)
    sized = [kind for kind in SURVIVALS if goal.id == kind or (goal.id == "goals" and question.wish(kind) is not None)]
    if not ids and not sized:
        return merit
    merit = np.where(merit > MISSED, merit if goal.id == "goals" else UNKNOWN, merit)
    for K in best_apart(points, merit, CLOSER, question.lower, question.upper, 0.05):
        at = int(np.flatnonzero((points == K).all(axis=1))[0])
        if merit[at] <= MISSED:
            continue
        v, short = (float(merit[at]) if goal.id == "goals" else math.inf), 0.0
        worst, low = _slow_rows(grid, ids, K, goal)
        v, short = min(v, worst), min(short, low)
        for kind in sized:
            survived, wish = _survived(grid, kind, Gains(*map(float, K))), question.wish(kind)
            if goal.id == "goals" and wish is not None:
                v = min(v, (survived - wish) / question.size_of(kind))
            elif goal.id == kind:
                v = min(v, goal.v(survived))
        if short < 0:
            merit[at] = MISSED + max(short, -8.0)
        elif math.isfinite(v):
            merit[at] = max(v, UNKNOWN)
    return merit


def _slow_rows(grid: Grid, ids: tuple[str, ...], K: Array, goal: Goal) -> tuple[float, float]:
    """The objective that rows without samples allow, and their smallest margin, scaled; infinite where none is."""
    deadline.check()
    rows = values(grid.question, ids, K, grid.step) if ids else {}
    if rows is None:
        return -math.inf, -9.0
    v, short = math.inf, math.inf
    for (id, _, gap), pieces in rows.items():
        for _, value, _ in () if gap else pieces:
            for margin, of in margins(grid.question, goal, id, value):
                if of and goal is not FEASIBILITY:
                    v = min(v, margin)
                else:
                    short = min(short, margin)
    return v, short


def _survived(grid: Grid, kind: str, gains: Gains) -> float:
    """The largest disturbance survived, in the unit of its row, by the worst body."""
    worlds = grid.question.worlds
    if kind == "step-slope":
        worst = min(step_slope(world.in_a_field().loop(), gains, grid.step).survived for world in worlds)
    else:
        worst = min(push(world.loop(), gains, grid.step).survived for world in worlds)
    return math.degrees(worst) if kind == "step-slope" else worst


def _lowest(grid: Grid, K: ca.MX) -> ca.MX:
    """The smallest scaled margin of all requirements, and the smallest objective row; a large number where none."""
    required: list[ca.MX] = [ca.MX(10.0)]
    objective: list[ca.MX] = [ca.MX(10.0)]
    v = 0.5 if grid.goal.id in SURVIVALS else 0.0
    for case, path, function in zip(grid.cases, grid.paths, grid.quantities, strict=True):
        ends = np.cumsum([1, *(limit.quantity.size1_out(0) for limit in case.along)])
        theta, *parts = ca.vertsplit(function(ca.vertcat(K, v)), [0, *map(int, ends)])
        for row, of in () if path is None else path.lowest(theta):
            (objective if of else required).append(row)
        for limit, part in zip(case.along, parts, strict=True):
            for row, of in limit_rows(grid.question, grid.goal, case, limit, ca.vec(part)):
                hard = not of and not (case.sized and case.sized.rate)
                (required if hard else objective).append(ca.mmin(row))
    return ca.vertcat(ca.mmin(ca.vertcat(*required)), ca.mmin(ca.vertcat(*objective)))


def from_start(
    grid: Grid, K: Array, merit: float, instants: Instants, end: float, *, stay: bool = False
) -> tuple[Local, bool]:
    """What is reached from ``K``, and whether that is an optimum of the goal: else it is the nearest miss, or nothing.

    A start that is not feasible goes through feasibility first. Where that ends at most ``CLOSE`` from feasible it may
    rest at a kink: the goal's own program then tries to get there. ``stay``: see ``optimise``.
    """
    low, _ = objective_range(grid.question, grid.goal)
    feasible = merit > MISSED
    point = Point(gains=Gains(*map(float, K)), v=max(merit, low, UNKNOWN) if feasible else max(low, -1.0))
    margins = grid.margins(replace(point, v=max(point.v, 0.0)))
    if margins is not None:
        instants = pruned(margins, lowest_below(FAR, margins, instants, most=3, reach=1 if stay else 0))
    if not feasible or not meets(grid, point):
        near = replace(point, v=0.0 if feasible else max(merit - MISSED, -2.0))
        nearest = optimise(grid.feasibility, near, instants, end)
        if not nearest.converged or nearest.point.v < -CLOSE or (nearest.point.v < -1e-6 and not _kinked(grid)):
            return nearest, False
        instants = union(instants, nearest.instants)
        point = Point(gains=nearest.point.gains, v=max(low, -1.0))
        found = optimise(grid, point, instants, end, stay=stay)
        return (found, True) if found.converged else (nearest, False)
    found = optimise(grid, point, instants, end, stay=stay)
    return found, found.converged


def _kinked(grid: Grid) -> bool:
    """Whether there are requirements whose rows are models, with kinks."""
    return bool(wanted(grid.question, FEASIBILITY))
