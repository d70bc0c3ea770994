"""Where to start: a survey of the box of gains, and the way from one start to a local optimum on the coarse grid."""

from __future__ import annotations

import math
from dataclasses import replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design.analysis.survey import best_apart, candidates, in_batches
from design.analysis.survival import push, step_slope
from design.model.laws import Gains
from problems.gains.exchange import FAR, Local, lowest_below, pruned, union
from problems.gains.grid import Grid, Instants, Point, limit_rows
from problems.gains.modelled import margins, wanted
from problems.gains.pieces import values
from problems.gains.program import objective_range
from problems.gains.question import SURVIVALS, question_decay
from problems.gains.sequential import meets, optimise

Array = NDArray[np.float64]

CANDIDATES = 256
CLOSER = 24
"""Candidates of which also the rows are looked at that take longer."""
MISSED = -100.0
"""Merit of what just misses a requirement; what is feasible has a greater one."""
UNKNOWN = -50.0
"""Merit of what seems feasible but has not been looked at closely."""


def survey(grid: Grid) -> tuple[Array, Array]:
    """Points of the box of gains (count, 3) and their merits (count,): v where feasible, else ``MISSED`` or less."""
    question, goal = grid.question, grid.goal
    points = candidates(question.lower, question.upper, CANDIDATES)
    given = question.setting.gains
    corner = np.array([question.upper[0], question.upper[1], max(question.lower[2], 1e-3 * question.upper[2])])
    extra = [corner] if given is None else [corner, np.clip(np.array(given), question.lower, question.upper)]
    points = np.maximum(np.vstack([*extra, points]), 1e-9 * question.upper)
    decay = np.array([question_decay(question, K) for K in points])
    merit = np.where(decay > 0, MISSED - 10.0, -1e3) + np.minimum(decay / question.pace, 1.0)
    stable = np.flatnonzero(decay > 0)
    if not len(stable):
        return points, merit
    size = min(64, len(stable))
    K = ca.MX.sym("K", 3)
    lowest = ca.Function("lowest", [K], [_lowest(grid, K)]).map(size)
    rows, objective = in_batches(lambda batch: np.asarray(lowest(batch).full()), points[stable], size)
    if goal.id == "decay-rate":
        objective = decay[stable] / question.pace
    elif goal.id == "routh-margin":
        objective = np.array([min(min(each.slacks(k)) for each in question.environments) for k in points[stable]])
    elif goal.gain is not None:
        objective = goal.sign * points[stable, goal.gain] / goal.scale
    elif goal.id == "goals" and (wish := question.wish("decay-rate")) is not None:
        objective = np.minimum(objective, (decay[stable] - wish) / question.size_of("decay-rate"))
    missing = np.minimum(rows, (decay[stable] - question.decay) / question.pace)
    value = np.where(missing >= 0, np.maximum(objective, UNKNOWN), MISSED + np.maximum(missing, -8.0))
    merit[stable] = np.where(np.isfinite(value), value, MISSED - 9.0)
    return points, _closer(grid, points, merit)


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
        found = values(question, ids, K, grid.step) if ids else {}
        if found is None:
            merit[at] = MISSED - 9.0
            continue
        v, missing = (float(merit[at]) if goal.id == "goals" else math.inf), 0.0
        for (id, _, gap), pieces in found.items():
            for _, value, _ in () if gap else pieces:
                for margin, of in margins(question, goal, id, value):
                    v, missing = (min(v, margin), missing) if of else (v, min(missing, margin))
        for kind in sized:
            survived, wish = _survived(grid, kind, Gains(*map(float, K))), question.wish(kind)
            if goal.id == "goals" and wish is not None:
                v = min(v, (survived - wish) / question.size_of(kind))
            elif goal.id == kind:
                v = min(v, goal.v(survived))
        if missing < 0:
            merit[at] = MISSED + max(missing, -8.0)
        elif math.isfinite(v):
            merit[at] = max(v, UNKNOWN)
    return merit


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
    grid: Grid, K: Array, merit: float, instants: Instants, deadline: float, *, stay: bool = False
) -> tuple[Local, bool]:
    """What is reached from ``K``, and whether that is an optimum of the goal: else it is the nearest miss, or nothing.

    A start that is not feasible goes through feasibility first. ``stay``: see ``optimise``.
    """
    low, _ = objective_range(grid.question, grid.goal)
    feasible = merit > MISSED
    point = Point(gains=Gains(*map(float, K)), v=max(merit, low, UNKNOWN) if feasible else max(low, -1.0))
    margins = grid.margins(replace(point, v=max(point.v, 0.0)))
    if margins is not None:
        instants = pruned(margins, lowest_below(FAR, margins, instants, most=3, reach=1 if stay else 0))
    if not feasible or not meets(grid, point):
        near = replace(point, v=0.0 if feasible else max(merit - MISSED, -2.0))
        nearest = optimise(grid.feasibility, near, instants, deadline)
        if not nearest.converged or nearest.point.v < -1e-6:
            return nearest, False
        instants = union(instants, nearest.instants)
        point = Point(gains=nearest.point.gains, v=max(low, -1.0))
    found = optimise(grid, point, instants, deadline, stay=stay)
    return found, found.converged
