"""What holds an optimum, and what it costs: the change of the objective with each level and bound, by multipliers.

The derivative of the optimal value with a parameter is that of the Lagrangian (envelope theorem). A level may stand in
sampled rows, in the poles, in models or in the size of a disturbance: the program is posed again with the level a
little higher and lower, its rows are read at the optimum, and weighed with the multipliers. They are unique only where
the active constraints are independent; at a multiple pole they are not. ``problems.sensitivity`` seeks gains again.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design.analysis.objectives import OBJECTIVES
from design.analysis.synthesis import Price
from design.model.limits import Required
from problems.gains.exchange import Local, Solved
from problems.gains.goal import GAIN_UNITS, GAINS
from problems.gains.grid import Grid
from problems.gains.program import pose

Array = NDArray[np.float64]

PART = 1e-4
"""Part of a level by which it is moved for the difference."""
NOTHING = 1e-7
"""Change of v for one per cent that is not worth naming."""


def prices(grid: Grid, winner: Local) -> tuple[Price, ...]:
    """The changes for one per cent more, in the objective's unit, largest first; those that change nothing left out."""
    solved = winner.solved
    if solved is None:
        return ()
    found = [*_levels(grid, solved), *_bounds(grid, solved)]
    scale = grid.goal.value(1.0) - grid.goal.value(0.0)  # from v to the objective's unit
    found = [replace(each, change=scale * (each.change or 0.0)) for each in found if abs(each.change or 0.0) > NOTHING]
    return tuple(sorted(found, key=lambda each: -abs(each.change or 0.0)))


def _levels(grid: Grid, solved: Solved) -> list[Price]:
    """The changes of v with the levels of the requirements that count."""
    question, found = grid.question, []
    for id, wish in question.setting.required.items():
        counts = not wish.soft or grid.goal.id == "goals"
        if not counts or wish.level == 0 or id == grid.goal.id:
            continue
        sides = [_rows(grid, solved, id, wish.level * (1.0 + part)) for part in (PART, -PART)]
        if sides[0].shape != solved.answer.multiplier.shape:
            continue
        # the level itself cancels: by how much v falls from minus PART to PART of it, times 1 % over 2 PART
        fall = float(solved.answer.multiplier @ (sides[0] - sides[1]))
        found.append(
            Price(
                id=id, kind="requirement", given=wish.level, unit=OBJECTIVES[id].unit, change=-fall * 0.01 / (2 * PART)
            )
        )
    return found


def _rows(grid: Grid, solved: Solved, id: str, level: float) -> Array:
    """The rows g of the program with another level, at the optimum."""
    setting = grid.question.setting
    moved = replace(setting, required={**setting.required, id: Required(level=level, soft=setting.required[id].soft)})
    other = grid.asking(grid.question.asking(moved))
    program, _ = pose(other, solved.instants, solved.shift, solved.models, branches=solved.branches)
    return np.asarray(ca.Function("rows", [program.x], [program.g])(solved.answer.x).full().ravel())


def _bounds(grid: Grid, solved: Solved) -> list[Price]:
    """The changes of v with the bounds of the gains."""
    question, found = grid.question, []
    for k, name in enumerate(GAINS):
        price = float(solved.answer.x_multiplier[k]) / question.scale[k]  # positive at an upper bound
        bound = question.widest[k] if price > 0 else question.lower[k]
        at = abs(solved.answer.x[k] * question.scale[k] - bound) <= 1e-5 * question.scale[k]
        if at and bound > 0:
            kind = "upper bound" if price > 0 else "lower bound"
            found.append(
                Price(id=name, kind=kind, given=float(bound), unit=GAIN_UNITS[k], change=price * 0.01 * bound)  # type: ignore[arg-type]
            )
    return found
