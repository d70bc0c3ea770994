"""Rows that are not read from samples: loop margins, sampling, transients, as quadratic models about a point.

Their values are those of the report (``design.analysis.further``), one for each environment or scenario of each body
and for each crossing or peak that a margin is the worst of, so that where the worst one changes there are two smooth
rows and no kink. A model has the value, slope and curvature of a row at a point, by central differences; it holds near
that point, and ``problems.gains.sequential`` says how near.

Phase and delay margins are not even continuous: where |L| begins to cross 1 elsewhere, they jump. How far it is from
that is a row of its own, a *gap*, that stays open where a crossing would cost anything.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design.analysis.further import MARGINS
from design.analysis.objectives import OBJECTIVES
from design.analysis.simulate import simulate
from design.analysis.slope_rate import peak_gain
from design.analysis.transient import torque_rate, transient
from design.model.laws import Gains
from design.model.margins import breaks, longest_period, margin_pieces, near_crossings
from problems.gains.goal import Goal
from problems.gains.grid import BACKOFF
from problems.gains.question import Environment, Question

Array = NDArray[np.float64]


class Piece(NamedTuple):
    """What a margin is the worst of: ``value`` at a frequency ``w`` [rad/s], or 0 where there is none.

    Of a gap ``then`` is the value that the row would have if it closed.
    """

    w: float
    value: float
    then: float = math.inf


Pieces = dict[tuple[str, int, bool], list[Piece]]
"""By row, place (environment or scenario) and whether they are gaps."""

LOOP = tuple(row for row, *_ in MARGINS)
RUNS = ("torque-rate", "settling", "overshoot", "posture-error")
MODELLED = (*LOOP, "sample-time", "slope-rate", *RUNS)
OPEN = 1e-4
"""How far |L| stays from a crossing that would make a margin jump."""
LAGS = {"phase-margin": "actuator", "delay-margin": "actuator", "force-delay-margin": "force",
        "angle-delay-margin": "angle"}  # fmt: skip
"""Rows that jump where |L| begins to cross 1, and where their loop is broken."""
DIFFERENCE = 1e-3
"""Step of the differences, as a part of the range of each gain."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Model:
    """value + slope d + d curvature d/2 with d = u - at, for gains u in their scale; in the unit of row ``id``.

    A ``gap`` is how far |L| is from crossing 1 where it does not: closed, it would make a phase or delay margin jump.
    """

    id: str
    gap: bool
    at: Array
    value: float
    slope: Array
    curvature: Array

    def __call__(self, u: Any) -> Any:
        """The modelled value at ``u``, numbers or CasADi expressions."""
        if isinstance(u, np.ndarray):
            d = u - self.at
            return self.value + self.slope @ d + 0.5 * d @ self.curvature @ d
        d = u - ca.DM(self.at)
        return self.value + ca.dot(ca.DM(self.slope), d) + 0.5 * ca.bilin(ca.DM(self.curvature), d, d)


def wanted(question: Question, goal: Goal) -> tuple[str, ...]:
    """Ids of the modelled rows that the program needs."""
    return tuple(
        id
        for id in MODELLED
        if question.level(id) is not None or id == goal.id or (goal.id == "goals" and question.wish(id) is not None)
    )


def margins(question: Question, goal: Goal, id: str, value: Any, *, gap: bool = False) -> list[tuple[Any, float]]:
    """(margin, 1 if v is to be subtracted, else 0), as ``grid.limit_rows`` has them, for a row's ``value``."""
    if gap:
        return [(value - OPEN, 0.0)]
    sign = OBJECTIVES[id].sign
    level, wish = question.level(id), question.wish(id)
    found: list[tuple[Any, float]] = []
    if id == goal.id:
        found.append((sign * value / goal.scale, 1.0))
    elif level is not None:
        margin = sign * (value - level) / question.size_of(id)
        found.append((margin, 1.0) if goal.id == "feasibility" else (margin - BACKOFF, 0.0))
    elif goal.id == "goals" and wish is not None:
        found.append((sign * (value - wish) / question.size_of(id), 1.0))
    return found


def values(question: Question, ids: Sequence[str], K: Array, step: float) -> Pieces | None:
    """The values of each row in every environment or scenario that it has some in; None if the loop is unstable.

    What is infinitely good is left out; what is infinitely bad is infinite.
    """
    gains = Gains(*map(float, K))
    found: Pieces = {}
    try:
        for k, each in enumerate(question.environments):
            own = _linear(each, ids, gains)
            found |= {(id, k, False): pieces for id, pieces in own.items()}
            found |= {(id, k, True): gaps for id, gaps in _gaps(each, ids, gains).items()}
    except (ValueError, np.linalg.LinAlgError):
        return None
    runs = [id for id in ids if id in RUNS]
    if runs:
        place = 0
        for world in question.worlds:
            loop = world.loop()
            for scenario in world.scenarios:
                run = simulate(loop, scenario, gains, step)
                if run.fallen is not None:
                    return None
                end = transient(loop, scenario, run)
                read = {
                    "settling": end.settling,
                    "overshoot": math.degrees(end.overshoot),
                    "posture-error": math.degrees(end.error),
                }
                if "torque-rate" in runs:
                    read["torque-rate"] = float(np.abs(torque_rate(loop, gains, run)).max())
                found |= {(id, place, False): [Piece(0.0, read[id])] for id in runs}
                place += 1
    return found


def _linear(each: Environment, ids: Sequence[str], gains: Gains) -> dict[str, list[Piece]]:
    world = each.world
    found: dict[str, list[Piece]] = {}
    gains = world.felt(gains)
    where = (world.biped, world.law, gains, each.place.A, each.place.load, world.adapt, each.place.beta)
    if any(id in LOOP for id in ids):
        pieces = margin_pieces(*where)
        unit = {"phase-margin": 180 / math.pi}
        found |= {id: [Piece(w, unit.get(id, 1.0) * value) for w, value in pieces[id]] for id in ids if id in LOOP}
    if "sample-time" in ids:
        found["sample-time"] = [Piece(0.0, longest_period(*where))]
    if "slope-rate" in ids and world.law != "pd" and world.plain:
        peak = peak_gain(world.biped, world.law, gains)
        found["slope-rate"] = [Piece(0.0, math.degrees(world.biped.ell / (peak.gain + peak.error)))]
    good = {id: OBJECTIVES[id].sign * math.inf for id in found}
    return {id: [piece for piece in pieces if piece.value != good[id]] for id, pieces in found.items()}


def _gaps(each: Environment, ids: Sequence[str], gains: Gains) -> dict[str, list[Piece]]:
    """Near crossings of the rows that jump where |L| begins to cross 1."""
    world, (A, load, beta) = each.world, each.place
    rows = [id for id in ids if id in LAGS]
    at = breaks(world.biped, world.law, world.felt(gains), A, load, world.adapt, beta) if rows else {}
    found: dict[str, list[Piece]] = {}
    for id in rows:
        gaps = near_crossings(at[LAGS[id]]) if LAGS[id] in at else []
        found[id] = [
            Piece(w, gap, math.degrees(min(lag, 2 * math.pi - lag)) if id == "phase-margin" else lag / w)
            for w, lag, gap in gaps
        ]
    return found


def modelled(question: Question, ids: Sequence[str], u: Array, step: float) -> list[Model] | None:
    """Models of all those rows about ``u``; None where the loop is unstable at it or next to it."""
    free = np.flatnonzero(question.upper > question.lower).tolist()
    here = values(question, ids, u * question.scale, step)
    if here is None or not all(math.isfinite(value) for pieces in here.values() for _, value, _ in pieces):
        return None
    for shrink in (1.0, 0.1, 0.01):
        h = shrink * np.minimum(DIFFERENCE, 0.3 * u)
        around = _around(question, ids, u, h, free, step)
        if around is not None:
            break
    else:
        return None
    models = []
    for place, pieces in here.items():
        for number, (_, value, then) in enumerate(pieces):
            least = min((piece.value for piece in here.get((place[0], place[1], False), [])), default=math.inf)
            if place[2] and not (value >= 0 and then < least):
                continue
            near = {key: _same(pieces, number, its.get(place, [])) for key, its in around.items()}
            found = {key: value for key, value in near.items() if value is not None}
            if len(found) < len(near):  # a crossing that is just appearing or gone: only its value is known
                slope, curvature = np.zeros(3), np.zeros((3, 3))
            else:
                slope, curvature = _derivatives(value, found, h, free)
            models.append(Model(id=place[0], gap=place[2], at=u.copy(), value=value, slope=slope, curvature=curvature))
    return models


def _derivatives(value: float, found: dict[tuple[int, int], float], h: Array, free: list[int]) -> tuple[Array, Array]:
    slope, curvature = np.zeros(3), np.zeros((3, 3))
    for i in free:
        ahead, behind = found[i, 1], found[i, -1]
        slope[i] = (ahead - behind) / (2 * h[i])
        curvature[i, i] = (ahead - 2 * value + behind) / h[i] ** 2
    for i, j in combinations(free, 2):
        both = found[i, j + 10] - found[i, 1] - found[j, 1] + value
        curvature[i, j] = curvature[j, i] = both / (h[i] * h[j])
    return slope, curvature


def _same(pieces: list[Piece], number: int, others: list[Piece]) -> float | None:
    """The value next to this point of the piece of that ``number``: the same one of as many, or the nearest."""
    if len(others) == len(pieces):
        return others[number].value
    w = pieces[number].w
    near = min(others, key=lambda piece: abs(piece.w - w), default=None)
    return near.value if near is not None and abs(near.w - w) <= 0.1 * (abs(w) + 1e-9) else None


def _around(
    question: Question, ids: Sequence[str], u: Array, h: Array, free: list[int], step: float
) -> dict[tuple[int, int], Pieces] | None:
    """Values at u + h_i, u - h_i (keys (i, 1), (i, -1)) and u + h_i + h_j (key (i, j + 10))."""
    unit = np.eye(3)
    points = {(i, side): u + side * h[i] * unit[i] for i in free for side in (1, -1)}
    points |= {(i, j + 10): u + h[i] * unit[i] + h[j] * unit[j] for i, j in combinations(free, 2)}
    found = {}
    for key, point in points.items():
        at = values(question, ids, point * question.scale, step)
        if at is None or not all(math.isfinite(value) for pieces in at.values() for _, value, _ in pieces):
            return None
        found[key] = at
    return found
