"""Rows that are not read from samples, as quadratic models about a point, by differences.

A model holds near its point, and ``problems.gains.sequential`` says how near.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.analysis.objectives import OBJECTIVES
from problems.gains.approach import asked
from problems.gains.goal import Goal
from problems.gains.held import held
from problems.gains.model import Model
from problems.gains.pieces import MODELLED, Piece, Pieces, values
from problems.gains.question import Question

Array = NDArray[np.float64]

OPEN = 1e-4
"""How far a gap stays open: of |L| from 1, or of a function of the sampling period from 0."""
FAR = 1.5
"""Sampling periods so many times as long as the shortest one, or as what is required, are not modelled."""
DIFFERENCE = 1e-3
"""Step of the differences, as a part of the range of each gain."""
SHRINKS = (1.0, 0.1, 0.01, 1e-3)
"""What shorter steps are tried, where the loop is unstable at the end of one, or a piece is gone."""


def wanted(question: Question, goal: Goal) -> tuple[str, ...]:
    """Ids of the modelled rows that the program needs."""
    return tuple(id for id in MODELLED if question.asks(goal, id))


def margins(question: Question, goal: Goal, id: str, value: Any, *, gap: bool = False) -> list[tuple[Any, float]]:
    """(margin, 1 if v is to be subtracted, else 0), as ``grid.limit_rows`` has them, for a row's ``value``."""
    return [(value - OPEN, 0.0)] if gap else asked(question, goal, id, value)


def rows(question: Question, goal: Goal, model: Model, u: Any, v: Any) -> list[Any]:
    """What must be >= 0 of a ``model`` at gains ``u``, in their scale, with the objective ``v``."""
    value = model(u, _level(question, goal, model.id, v))
    return [margin - of * v for margin, of in margins(question, goal, model.id, value, gap=model.gap)]


def _level(question: Question, goal: Goal, id: str, v: Any) -> Any:
    """The value at which row ``id`` is just good enough, for the objective ``v``: its margin is linear in its value."""
    (at_0, of), (at_1, _) = (*margins(question, goal, id, 0.0), *margins(question, goal, id, 1.0))
    return (of * v - at_0) / (at_1 - at_0)


def modelled(question: Question, goal: Goal, u: Array, step: float) -> list[Model] | None:
    """Models of all the rows that are ``wanted`` about ``u``; None where the loop is unstable at it or next to it."""
    ids = wanted(question, goal)
    here = values(question, ids, u * question.scale, step)
    if here is None or not _finite(here):
        return None
    around = _Around(question, tuple(id for id in ids if id != "sample-time"), u, step)
    if all(around.ring(k) is None for k in range(len(SHRINKS))):
        return None
    models: list[Model] = []
    for (id, k, gap), pieces in here.items():
        if id == "sample-time":
            continue
        least = _least(question, goal, id, here.get((id, k, False), []))
        for j, (_, value, then) in enumerate(pieces):
            if not gap or (value >= 0 and OBJECTIVES[id].sign * then < least):
                slope, curvature = around.derivatives((id, k, gap), pieces, j)
                models.append(Model(id=id, gap=gap, at=u.copy(), value=value, slope=slope, curvature=curvature))
    if "sample-time" in ids:
        level = _least(question, goal, "sample-time", [])
        places = [[here[id, k, gap] for gap in (False, True)] for id, k, gap in here if id == "sample-time" and not gap]
        first = [min((piece.value for piece in exits), default=math.inf) for exits, _ in places]
        for each, (exits, minima), end in zip(question.environments, places, first, strict=True):
            if end <= FAR * min(level, *first):
                models += held(each, question.scale, u, exits, minima, level)
    return models


def _least(question: Question, goal: Goal, id: str, pieces: Sequence[Piece]) -> float:
    """The worst of the ``pieces`` of a row, or the level that it must keep if that is worse; signed."""
    sign = OBJECTIVES[id].sign
    least = min((sign * piece.value for piece in pieces), default=math.inf)
    required = id != goal.id and question.level(id) is not None and goal.id != "feasibility"
    return min(least, float(sign * _level(question, goal, id, 0.0))) if required else least


class _Around:
    """The values next to ``u``, at distances that shrink: where the worst changes close by, only near ones will do."""

    def __init__(self, question: Question, ids: tuple[str, ...], u: Array, step: float) -> None:
        self._question, self._ids, self._u, self._step = question, ids, u, step
        self._free = np.flatnonzero(question.upper > question.lower).tolist()
        self._rings: dict[int, dict[tuple[int, int], Pieces] | None] = {}

    def ring(self, k: int) -> dict[tuple[int, int], Pieces] | None:
        """Those at u + h_i, u - h_i (keys (i, 1), (i, -1)) and u + h_i + h_j (key (i, j + 10)); None if unstable."""
        if k not in self._rings:
            self._rings[k] = self._found(k)
        return self._rings[k]

    def derivatives(self, place: tuple[str, int, bool], pieces: list[Piece], number: int) -> tuple[Array, Array]:
        """Slope and curvature of a piece; zero if next to ``u``, however near, it is just appearing or gone."""
        slope, curvature = np.zeros(3), np.zeros((3, 3))
        for k in range(len(SHRINKS)):
            near = {key: _same(pieces, number, its.get(place, [])) for key, its in (self.ring(k) or {}).items()}
            found = {key: value for key, value in near.items() if value is not None}
            if found and len(found) == len(near):
                break
        else:
            return slope, curvature
        value, h = pieces[number].value, self._h(k)
        for i in self._free:
            ahead, behind = found[i, 1], found[i, -1]
            slope[i] = (ahead - behind) / (2 * h[i])
            curvature[i, i] = (ahead - 2 * value + behind) / h[i] ** 2
        for i, j in combinations(self._free, 2):
            both = found[i, j + 10] - found[i, 1] - found[j, 1] + value
            curvature[i, j] = curvature[j, i] = both / (h[i] * h[j])
        return slope, curvature

    def _h(self, k: int) -> Array:
        return np.asarray(SHRINKS[k] * np.minimum(DIFFERENCE, 0.3 * self._u))

    def _found(self, k: int) -> dict[tuple[int, int], Pieces] | None:
        steps = np.diag(self._h(k))
        points = {(i, side): self._u + side * steps[i] for i in self._free for side in (1, -1)}
        points |= {(i, j + 10): self._u + steps[i] + steps[j] for i, j in combinations(self._free, 2)}
        found = {}
        for key, point in points.items():
            at = values(self._question, self._ids, point * self._question.scale, self._step)
            if at is None or not _finite(at):
                return None
            found[key] = at
        return found


def _finite(found: Pieces) -> bool:
    return all(math.isfinite(value) for pieces in found.values() for _, value, _ in pieces)


def _same(pieces: list[Piece], number: int, others: list[Piece]) -> float | None:
    """The value next to this point of the piece of that ``number``: the same one of as many, or the nearest."""
    if len(others) == len(pieces):
        return others[number].value
    w = pieces[number].w
    near = min(others, key=lambda piece: abs(piece.w - w), default=None)
    return near.value if near is not None and abs(near.w - w) <= 0.1 * (abs(w) + 1e-9) else None
