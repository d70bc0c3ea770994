"""Models of the longest sampling period, from the functions of gains and period whose zeros it is the first of.

The period itself changes like a square root where an eigenvalue only just leaves the unit circle; those functions
(``design.model.sampling``) are smooth there. They are expanded in gains and period together.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from design.model.laws import Gains
from design.model.sampling import stability_functions
from problems.gains.model import Implicit, Model
from problems.gains.pieces import Piece
from problems.gains.question import Environment

Array = NDArray[np.float64]

GROWTH = 0.25
"""How much longer the period may become before the functions are expanded again, as a part of it."""
BEFORE = 1.02
"""A minimum so little beyond the first exit, as a ratio of periods, counts as one before it."""
DIFFERENCE = 1e-4
"""Step of the differences, as a part of the range of each gain and of the period."""

CORNERS = ((1, 1, 1), (-1, 1, -1), (-1, -1, 1), (1, -1, -1))
"""Sign, and steps of the two variables, of a mixed second difference."""


def held(
    each: Environment, scale: Array, u: Array, exits: Sequence[Piece], minima: Sequence[Piece], level: float
) -> list[Model]:
    """Models of row ``sample-time`` about the gains ``u``, in their ``scale``.

    All three functions are asked to be positive at the first of the ``exits``, or at the period ``level`` if that is
    what is required, and those that have ``minima`` before that also there. A period that is sought may grow as far as
    a later minimum below zero, beyond which a function is positive again but the loop not stable, and by no more than
    ``GROWTH``.
    """
    first = min((piece.value for piece in exits), default=math.inf)
    near = min(first, level)
    if not math.isfinite(near):
        return []
    own = {round(piece.w) - 1: piece.value for piece in exits}
    found: list[Model] = []
    for which in range(3):
        value, slope, curvature = _expanded(each, scale, u, near, which)
        size = max(abs(slope[3]), abs(value) / near, 1e-9 / near)
        offset = 0.0 if own.get(which) == near else value / size
        found.append(_implicit(u, own.get(which, math.inf), near, offset, slope / size, curvature / size))
    furthest = (1 + GROWTH) * near
    for piece in minima:
        if piece.then < BEFORE * (level if math.isfinite(level) else near):
            found.append(_least(each, scale, u, piece))
        elif piece.value < 0:
            furthest = min(furthest, piece.then)
    if math.isinf(level):
        no_further = np.array([0.0, 0.0, 0.0, -1.0])
        found.append(_implicit(u, math.inf, near, furthest - near, no_further, np.zeros((4, 4))))
    return found


def _implicit(u: Array, value: float, near: float, offset: float, slope: Array, curvature: Array) -> Model:
    return Implicit(
        id="sample-time", gap=False, at=u.copy(), value=value, near=near, offset=offset, slope=slope,
        curvature=curvature,
    )  # fmt: skip


def _least(each: Environment, scale: Array, u: Array, piece: Piece) -> Model:
    """Of a minimum over the period, as a function of the gains."""
    value, slope, curvature = _expanded(each, scale, u, piece.then, round(piece.w) - 1)
    across = curvature[:3, 3]
    least = curvature[:3, :3] - np.outer(across, across) / max(curvature[3, 3], 1e-12)
    return Model(id="sample-time", gap=True, at=u.copy(), value=value, slope=slope[:3], curvature=least)


def _expanded(each: Environment, scale: Array, u: Array, period: float, which: int) -> tuple[float, Array, Array]:
    """Value, gradient (4,) and Hessian (4, 4) of function ``which`` of (gains in their scale, period)."""
    world = each.world

    def function(x: Array) -> float:
        gains = world.felt(Gains(*(x[:3] * scale).tolist()))
        where = (world.biped, world.law, gains, each.place.A, each.place.load, x[3:], world.adapt, each.place.beta)
        return float(stability_functions(*where)[0, which])

    x = np.append(u, period)
    h = np.append(np.minimum(DIFFERENCE, 0.3 * u), DIFFERENCE * period)
    steps = np.diag(h)
    value = function(x)
    ahead, behind = (np.array([function(x + sign * step) for step in steps]) for sign in (1, -1))
    curvature = np.zeros((4, 4))
    for i, j in combinations_with_replacement(range(4), 2):
        if i == j:
            curvature[i, i] = (ahead[i] - 2 * value + behind[i]) / h[i] ** 2
            continue
        corners = [sign * function(x + a * steps[i] + b * steps[j]) for sign, a, b in CORNERS]
        curvature[i, j] = curvature[j, i] = sum(corners) / (4 * h[i] * h[j])
    return value, (ahead - behind) / (2 * h), curvature
