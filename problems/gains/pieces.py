"""The true values of rows that are not read from samples, in the smooth pieces that each is the worst of.

They are those of the report (``design.analysis.further``): one for each environment or scenario of each body, and for
each crossing, peak or exit of an eigenvalue that a margin is the worst of, so that where the worst one changes there
are two smooth rows and no kink.

Phase and delay margins are not even continuous: where |L| begins to cross 1 elsewhere, they jump, and so does the
sampling period where an eigenvalue begins to leave the unit circle earlier. How far it is from that is a row of its
own, a *gap*, that stays open where closing it would cost anything.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from design import deadline
from design.analysis.further import MARGINS
from design.analysis.objectives import OBJECTIVES
from design.analysis.slope_rate import peak_gain
from design.model.broken_loop import Break, breaks
from design.model.laws import Gains
from design.model.margins import margin_pieces, near_crossings
from design.model.sampling import exits
from problems.gains.question import Environment, Question

Array = NDArray[np.float64]


class Piece(NamedTuple):
    """What a margin is the worst of: ``value`` at ``w``, a frequency [rad/s] or another mark to tell it by.

    Of a gap ``then`` is the value that the row would have if it closed.
    """

    w: float
    value: float
    then: float = math.inf


Pieces = dict[tuple[str, int, bool], list[Piece]]
"""By row, place (environment or scenario) and whether they are gaps."""

LOOP = tuple(row for row, *_ in MARGINS)
MODELLED = (*LOOP, "sample-time", "slope-rate")
LAGS = {"phase-margin": "actuator", "delay-margin": "actuator", "force-delay-margin": "force",
        "angle-delay-margin": "angle"}  # fmt: skip
"""Rows that jump where |L| begins to cross 1, and where their loop is broken."""


def values(question: Question, ids: Sequence[str], K: Array, step: float) -> Pieces | None:
    """The values of each row in every environment or scenario that it has some in; None if the loop is unstable.

    What is infinitely good is left out; what is infinitely bad is infinite. Raises ``OutOfTime`` where a deadline has
    passed.
    """
    deadline.check()
    gains = Gains(*map(float, K))
    found: Pieces = {}
    try:
        for k, each in enumerate(question.environments):
            found |= {(id, k, gap): pieces for (id, gap), pieces in _linear(each, ids, gains).items()}
    except (ValueError, np.linalg.LinAlgError):
        return None
    return found


def _linear(each: Environment, ids: Sequence[str], gains: Gains) -> dict[tuple[str, bool], list[Piece]]:
    """By row and whether they are gaps."""
    world, (A, load, beta) = each.world, each.place
    felt = world.felt(gains)
    where = (world.biped, world.law, felt, A, load, world.adapt, beta)
    found: dict[tuple[str, bool], list[Piece]] = {}
    if loop := [id for id in ids if id in LOOP]:
        unit = {"phase-margin": 180 / math.pi}
        for id, pieces in margin_pieces(*where, ids=loop).items():
            found[id, False] = [Piece(w, unit.get(id, 1.0) * value) for w, value in pieces]
    if lags := [id for id in ids if id in LAGS]:
        broken = breaks(*where)
        for id in lags:
            found[id, True] = _gaps(id, broken[LAGS[id]]) if LAGS[id] in broken else []
    if "sample-time" in ids:
        ends = exits(*where)
        found["sample-time", False] = [Piece(1.0 + end.which, end.period) for end in ends if end.gap is None]
        found["sample-time", True] = [
            Piece(1.0 + end.which, end.gap, end.period) for end in ends if end.gap is not None
        ]
    if "slope-rate" in ids and world.law != "pd" and world.plain:
        peak = peak_gain(world.biped, world.law, felt)
        found["slope-rate", False] = [Piece(0.0, math.degrees(world.biped.ell / (peak.gain + peak.error)))]
    best = {id: OBJECTIVES[id].sign * math.inf for id, _ in found}
    return {
        (id, gap): [piece for piece in pieces if gap or piece.value != best[id]] for (id, gap), pieces in found.items()
    }


def _gaps(id: str, broken: Break) -> list[Piece]:
    """Near crossings of a row that jumps where |L| begins to cross 1."""
    return [
        Piece(w, gap, math.degrees(min(lag, 2 * math.pi - lag)) if id == "phase-margin" else lag / w)
        for w, lag, gap in near_crossings(broken)
    ]
