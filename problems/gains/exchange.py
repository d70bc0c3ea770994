"""Exchange: solve on few samples, add what the answer violates, repeat until nothing at full resolution is violated.

On a coarse grid programs march on the samples themselves. At full resolution they march on a coarse mesh that lands on
the samples seen, and the difference that this makes is measured at each answer and added to the rows.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design.solvers.nlp import Ipopt, NlpAnswer
from problems.gains.grid import Branches, Grid, Instants, Point
from problems.gains.model import Model
from problems.gains.program import VANISHING, objective_range, pose
from problems.gains.question import question_decay

Array = NDArray[np.float64]

VIOLATED = 1e-9
"""Violation of a sample, in its scale, from which it is added to the program."""
COARSE_TOLERANCE = 1e-6
FAR = 0.04
"""Margin of a sample, in its scale, from which the program may forget it."""
NEAR = 0.01
"""Margin of a sample, in its scale, up to which the next program begins with it."""
ROUNDS = 25
CHANGES = 20
"""Branches of the approach to the final posture that are tried, one after the other."""
GAINED = 1e-7
"""Gain in v that is worth another branch."""
UNBOUNDED = 1e3
"""Value of v, in its scale, that no row allows."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Local:
    """A local optimum on a grid: the point, the samples that the program needed, and whether it converged.

    ``solved`` is the last program's answer, and what it was posed with.
    """

    point: Point
    instants: Instants
    converged: bool
    said: str
    solved: Solved | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Solved:
    """A program's ``answer``, and the samples, shift, models and branches that it was posed with."""

    answer: NlpAnswer
    instants: Instants
    shift: Array | None
    models: tuple[Model, ...]
    branches: Branches


def exchange(
    grid: Grid,
    start: Point,
    instants: Instants,
    deadline: float,
    *,
    near: bool = False,
    models: Sequence[Model] = (),
    reach: tuple[Array, float] | None = None,
    effort: float = 1.0,
) -> Local:
    """Solve on ``instants``, add what the answer violates, and repeat until nothing on ``grid`` is violated.

    ``models`` and ``reach`` as in ``pose``. ``effort``: part of the usual rounds and iterations after which to give up.
    Where something is asked of the approach to the final posture, again on the branch of each answer, until that gains
    nothing: the answer before is feasible on it.
    """
    wide, idle = True, 0
    branches = grid.branches(start, wide=wide)
    if branches is None:
        return Local(point=start, instants=instants, converged=False, said="the biped falls at the start")
    if not models and _perfect(grid, start, branches):
        best_v = objective_range(grid.question, grid.goal)[1]
        return Local(point=replace(start, v=best_v), instants=instants, converged=True, said="nothing is left to gain")
    seeks = any(branch is not None and math.isfinite(branch.v) for branch in branches)  # a settling time
    best: Local | None = None
    reached = -np.inf
    for _ in range(CHANGES):
        found = _exchange(grid, start, instants, deadline, branches, near, models, reach, effort)
        following = grid.branches(found.point, wide=wide) if found.converged else None
        if following is not None:
            # a settling time is that of a sample: what the program gains between two samples counts as well
            v = found.point.v
            found = replace(found, point=replace(found.point, v=grid.kept(v, following)))
            least = GAINED * (1 + abs(v))
            gained = best is None or found.point.v > best.point.v + least or (not wide and v > reached + least)
            best = found if best is None or found.point.v >= best.point.v else best
            reached = max(v, reached) if not wide else -np.inf
        else:
            gained = False
        if best is None:
            return found
        idle = 0 if gained else idle + 1
        if idle > seeks or (following == branches and not seeks):
            return best
        wide = wide if gained else not wide
        start, instants, near = best.point, best.instants, True
        branches = grid.branches(start, wide=wide) or branches
    return best or found


def _perfect(grid: Grid, start: Point, branches: Branches) -> bool:
    """Whether the start is feasible and there is no overshoot, or no error, left."""
    question = grid.question
    if grid.goal.id not in VANISHING or question_decay(question, np.array(start.gains)) <= question.decay:
        return False
    margins = grid.margins(replace(start, v=objective_range(question, grid.goal)[1]), branches)
    return margins is not None and min(float(rows.min()) for rows in margins) >= 0


def _exchange(
    grid: Grid, start: Point, instants: Instants, deadline: float, branches: Branches, near: bool,
    models: Sequence[Model], reach: tuple[Array, float] | None, effort: float,
) -> Local:  # fmt: skip
    """``exchange`` on one branch of the approach in each case."""
    said = "round limit"
    if not any(instants):
        instants = _lowest(grid, start, instants)
    instants = union(instants, tuple((b.sought,) if b and math.isfinite(b.v) else () for b in branches))
    tolerance, iterations = (COARSE_TOLERANCE, int(effort * 120)) if grid.exact else (1e-9, int(effort * 300))
    shift = None if grid.exact else _first_shift(grid, start, instants, branches)
    for round_ in range(int(effort * ROUNDS)):
        program, read = pose(grid, instants, shift, models, reach, branches)
        seconds = max(deadline - time.monotonic(), 0.01)
        solver = Ipopt(program, tolerance=tolerance, seconds=seconds, iterations=iterations)
        answer = solver.solve(read.start(start), near=near)
        if near and not answer.solved:
            answer = solver.solve(read.start(start))
        point, said = read.point(answer.x), answer.said
        if point.v > UNBOUNDED and round_ == 0:  # no sample that it sees bounds the objective
            instants = _lowest(grid, start, instants)
            shift = None if grid.exact else _first_shift(grid, start, instants, branches)
            continue
        margins = grid.margins(point, branches)
        if margins is None or not answer.solved:
            return Local(point=point, instants=instants, converged=False, said=said)
        added = lowest_below(-VIOLATED - 10 * tolerance, margins, instants, reach=2 if grid.exact else 5)
        settled = grid.exact or _mismatch(margins, instants, answer.g) <= 10 * tolerance
        if added == instants and settled:
            solved = Solved(answer=answer, instants=instants, shift=shift, models=tuple(models), branches=branches)
            near_ones = pruned(margins, instants, NEAR)
            return Local(point=point, instants=near_ones, converged=True, said=said, solved=solved)
        if time.monotonic() > deadline:
            said = "time limit"
            break
        following = pruned(margins, added) if round_ < ROUNDS // 2 else added  # no going in circles
        shift = None if grid.exact else _shift(margins, following, instants, answer.g, shift)
        near = min(float(rows.min()) for rows in margins) > -NEAR
        instants, start = following, point
    return Local(point=start, instants=instants, converged=False, said=said)


def _lowest(grid: Grid, start: Point, instants: Instants) -> Instants:
    """``instants`` and the lowest samples of every row at the start."""
    margins = grid.margins(start)
    return (
        union(instants, grid.thinned()) if margins is None else lowest_below(np.inf, margins, instants, most=1, reach=1)
    )


def _first_shift(grid: Grid, start: Point, instants: Instants, branches: Branches) -> Array | None:
    """What to add to the rows of the first program, measured at the start."""
    margins = grid.margins(start, branches)
    if margins is None:
        return None
    program, read = pose(grid, instants, branches=branches)
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


def pruned(margins: list[Array], instants: Instants, far: float = FAR) -> Instants:
    """``instants`` without those that are far from binding; should they bind later, they come back."""
    return tuple(
        tuple(k for k in chosen if rows[:, k].min() < far) for rows, chosen in zip(margins, instants, strict=True)
    )


def lowest_below(level: float, margins: list[Array], instants: Instants, *, most: int = 8, reach: int = 5) -> Instants:
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


def union(one: Instants, other: Instants) -> Instants:
    """The samples of both."""
    return tuple(tuple(sorted({*a, *b})) for a, b in zip(one, other, strict=True))
