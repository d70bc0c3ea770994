"""Where to start: a survey of the box of gains, and the way from one start to a local optimum on the coarse grid."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design.analysis.survey import candidates, in_batches
from design.model.laws import Gains
from design.model.stability import normalised_slacks
from problems.gains.exchange import FAR, Local, exchange, lowest_below, pruned, union
from problems.gains.program import Point, objective_range
from problems.gains.question import Goal, Grid, Instants, objective_rows, question_decay

Array = NDArray[np.float64]

CANDIDATES = 256


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
            if limit.id in objective_rows(goal):
                objective.append(ca.mmin(quantity / limit.scale))
    best = ca.mmin(ca.vertcat(*objective)) if objective else ca.MX(0.0)
    return [*required, best]


def from_start(
    grid: Grid, goal: Goal, K: Array, merit: float, instants: Instants, deadline: float
) -> tuple[Local, bool]:
    """What is reached from ``K``, and whether that is an optimum of ``goal``: else it is the nearest miss, or nothing.

    A start that is not feasible goes through feasibility first.
    """
    point = Point(gains=Gains(*map(float, K)), v=merit)
    margins = grid.margins(point.gains, goal, max(merit, 0.0))
    if margins is not None:
        instants = pruned(margins, lowest_below(FAR, margins, instants, most=3, reach=0))
    if merit < -0.5:
        near = replace(point, v=max(merit + 1.0, -2.0))
        feasible = exchange(grid, "feasibility", near, instants, deadline)
        if not feasible.converged or feasible.point.v < -1e-6:
            return feasible, False
        low, _ = objective_range(grid.question, goal)
        instants = union(instants, feasible.instants)
        point = Point(gains=feasible.point.gains, v=low)
    found = exchange(grid, goal, point, instants, deadline)
    return found, found.converged
