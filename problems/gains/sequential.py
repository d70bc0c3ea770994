"""Rows without samples: solve with their models, look at their true values, and trust the models as far as they held.

A trust region, as in sequential quadratic programming (Conn, Gould and Toint, Trust-Region Methods, 2000), but with the
sampled rows and the poles in the program as they are: only the modelled rows are approximated, to second order. Models
of points that were tried and refused stay in the program until a point is accepted, if they do not cut off the best
point: where a row has a kink, its other side is then known too.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from design.analysis.objectives import OBJECTIVES
from problems.gains.exchange import Local, exchange
from problems.gains.grid import Grid, Instants, Point
from problems.gains.model import Model
from problems.gains.modelled import margins, modelled, wanted
from problems.gains.modelled import rows as model_rows
from problems.gains.pieces import values

Array = NDArray[np.float64]

STEPS = 60
PATIENCE = 6
"""Points refused in a row after which the best one is taken for the optimum."""
EFFORT = 0.4
"""Part of the usual effort that a program with models is worth; the next one has better ones."""
KEPT = 12
"""Models of refused points that are remembered."""
PRICE = 10.0
"""How much of v a violation of one scale costs."""
WORSE = 1e-3
"""How much more of the modelled rows the first step may violate than the start does, in their scale."""
SETTLED = 1e-7
"""Gain in v that is not worth another step."""
RELEASES = 3
"""Times that models which do not hold the optimum are dropped to look for a better one."""
INACTIVE = 1e-5
"""Margin of a modelled row, in its scale, from which it does not hold the optimum."""
RELEASED = 0.1
"""Half-width of the box in which a better one is looked for while other models remain, in the scale of the gains."""
WALK = 0.05
"""Half-width of the box that a walk begins with, in the scale of the gains."""
SMALLEST = 1e-7
"""Radius of the trust region at which models cannot get better."""


def optimise(
    grid: Grid, start: Point, instants: Instants, deadline: float, *, near: bool = False, stay: bool = False
) -> Local:
    """A local optimum of the grid's goal from ``start``, which meets what is required of the modelled rows or nearly.

    Without modelled rows this is ``exchange``; with ``stay`` in steps, so that the optimum is that of the start's own
    valley.
    """
    ids = wanted(grid.question, grid.goal)
    if not ids:
        return (
            exchange(grid, start, instants, deadline, near=near) if not stay else _walk(grid, start, instants, deadline)
        )
    found = _trusted(grid, start, instants, deadline, near)
    for _ in range(RELEASES):
        better = _released(grid, found, deadline)
        if better is None:
            break
        found = _trusted(grid, better.point, better.instants, deadline, True)
    return found


def _released(grid: Grid, found: Local, deadline: float) -> Local | None:
    """A better optimum near ``found`` without the models of those requirements that do not hold it; None if none is.

    Far from its point a model may cut off what its row allows. What the row truly is at the new point decides.
    """
    if not found.converged or found.solved is None or time.monotonic() > deadline:
        return None
    here = np.array(found.point.gains) / grid.question.scale
    held = [model for model in found.solved.models if not _inactive(grid, model, here)]
    if len(held) == len(found.solved.models):
        return None
    reach = (here, RELEASED) if held else None
    other = exchange(grid, found.point, found.instants, deadline, near=True, models=held, reach=reach)
    if not other.converged or other.point.v <= found.point.v + SETTLED * (1 + abs(found.point.v)):
        return None
    there = np.array(other.point.gains) / grid.question.scale
    trial = modelled(grid.question, grid.goal, there, grid.step)
    if trial is None:
        return None
    v, missing = _truth(grid, trial, there, other.point.v)
    better = missing <= SETTLED and v > found.point.v + SETTLED * (1 + abs(v))
    return replace(other, point=replace(other.point, v=v)) if better else None


def _inactive(grid: Grid, model: Model, u: Array) -> bool:
    """Whether a ``model`` of a requirement says at the optimum ``u`` that the row is met with room to spare."""
    if model.gap or any(of for _, of in margins(grid.question, grid.goal, model.id, model.value)):
        return False
    return all(float(row) > INACTIVE for row in model_rows(grid.question, grid.goal, model, u, 0.0))


def _trusted(grid: Grid, start: Point, instants: Instants, deadline: float, near: bool) -> Local:
    """The optimum by models that are trusted as far as they held."""
    question = grid.question
    here = np.array(start.gains) / question.scale
    models = modelled(question, grid.goal, here, grid.step)
    if models is None:
        return Local(point=start, instants=instants, converged=False, said="the loop is not stable at the start")
    v, allowed = _truth(grid, models, here)
    best = Point(gains=start.gains, v=min(start.v, v))
    merit, radius, said, refused = -np.inf, 0.02 if near else 0.2, "step limit", 0
    kept: list[Model] = []
    for _ in range(STEPS):
        found = exchange(
            grid, best, instants, deadline, near=near, models=[*models, *kept], reach=(here, radius), effort=EFFORT
        )
        if time.monotonic() > deadline:
            said = "time limit"
            break
        if not found.converged:
            radius, near, kept, refused = 0.3 * radius, False, [], refused + 1
            if radius < SMALLEST or refused > PATIENCE:
                said = found.said
                break
            continue
        there = np.array(found.point.gains) / question.scale
        trial = modelled(question, grid.goal, there, grid.step)
        v, missing = (-np.inf, np.inf) if trial is None else _truth(grid, trial, there, found.point.v)
        worth = v - PRICE * missing
        if np.isfinite(merit):
            if found.point.v <= merit + SETTLED * (1 + abs(merit)) and missing <= SETTLED:
                return replace(found, point=best)
            if radius < SMALLEST or refused > PATIENCE:
                return replace(found, point=best)
        if worth > merit and trial is not None and (np.isfinite(merit) or missing <= allowed + WORSE):
            far = float(np.abs(there - here).max()) > 0.9 * radius
            good = not np.isfinite(merit) or worth - merit > 0.5 * (found.point.v - merit)
            radius = min(2.0 * radius, 0.25) if far and good else radius if good else 0.5 * radius
            best, merit, here, models = Point(gains=found.point.gains, v=v), worth, there, trial
            instants, near, kept, refused = found.instants, True, [], 0
        else:
            kept += [model for model in trial or [] if np.isfinite(model.value)]
            refused += 1
            radius = 0.3 * min(radius, float(np.abs(there - here).max()) or radius)
        kept = [model for model in kept if _fair(model, models, here)][-KEPT:]
    return Local(point=best, instants=instants, converged=False, said=said)


def _walk(grid: Grid, start: Point, instants: Instants, deadline: float) -> Local:
    """Exchange within a box about the best point so far, until its optimum is inside."""
    radius, near = WALK, False
    for _ in range(STEPS):
        here = np.array(start.gains) / grid.question.scale
        found = exchange(grid, start, instants, deadline, near=near, reach=(here, radius))
        if not found.converged:
            return exchange(grid, start, instants, deadline) if not near else found
        moved = float(np.abs(np.array(found.point.gains) / grid.question.scale - here).max())
        if moved < 0.99 * radius:
            return found
        start, instants, radius, near = found.point, found.instants, 2 * radius, True
    return found


def _truth(grid: Grid, models: list[Model], u: Array, v: float = np.inf) -> tuple[float, float]:
    """The objective that modelled rows leave of ``v`` at the point that they are about, and their worst violation."""
    missing = 0.0
    for model in models:
        for margin, of in margins(grid.question, grid.goal, model.id, model.value, gap=model.gap):
            if of:
                v = min(v, margin)
            else:
                missing = max(missing, -margin)
    return v, missing


def _fair(model: Model, models: list[Model], u: Array) -> bool:
    """Whether an old ``model`` says nothing worse of ``u`` than is true there."""
    sign = 1.0 if model.gap else OBJECTIVES[model.id].sign
    worst = min((sign * each.value for each in models if (each.id, each.gap) == (model.id, model.gap)), default=-np.inf)
    return bool(sign * float(model(u, sign * worst)) >= worst - 1e-9 * (1 + abs(worst)))


def meets(grid: Grid, point: Point) -> bool:
    """Whether the modelled rows keep what is required at ``point``."""
    ids = wanted(grid.question, grid.goal)
    found = values(grid.question, ids, np.array(point.gains), grid.step) if ids else {}
    if found is None:
        return False
    return all(
        margin >= 0
        for (id, _, gap), pieces in found.items()
        for _, value, _ in pieces
        if not gap
        for margin, of in margins(grid.question, grid.goal, id, value)
        if not of
    )
