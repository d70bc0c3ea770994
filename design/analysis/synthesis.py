"""What gain synthesis found: a design with its verdict and what holds it, or the nearest miss."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from design.analysis.rows import Row, Verdict
from design.model.laws import Gains
from design.solvers.outcome import Outcome


@dataclass(frozen=True, eq=False, kw_only=True)
class Active:
    """What holds the optimum: a row at a sample, or a bound of a gain."""

    id: str
    scenario: str | None
    time_s: float | None
    value: float
    required: float


@dataclass(frozen=True, eq=False, kw_only=True)
class BoxPoint:
    """A body and world of the box that a design was sought for: where ``row`` is worst, and its uncertain numbers."""

    row: str
    scenario: str | None
    at: Mapping[str, float]


@dataclass(frozen=True, eq=False, kw_only=True)
class Box:
    """What is known of a design over the box of [uncertainty].

    ``rounds`` of looking for worse points, which gave ``points``; ``tried`` further ones, of which none breaks it.
    ``nominal``: what the best gains for the nominal body alone reach there, and the part of the points that break
    those. ``proofs``: scenario, answer, and the part of the box that is proved.
    """

    rounds: int
    points: tuple[BoxPoint, ...]
    tried: int
    nominal: float
    nominal_gains: Gains
    nominal_broken: float
    proofs: tuple[tuple[str, str, float], ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class Synthesis:
    """Gains and what is known of them. ``value`` in the unit of the objective; ``starts`` tried, ``reached`` it.

    Where there is a ``box``, ``value`` is the worst over it.
    """

    gains: Gains
    objective: str
    value: float
    active: tuple[Active, ...]
    verdict: Verdict
    starts: int
    reached: int
    optima: int
    box: Box | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Answer:
    """The outcome, and what was found on the way.

    ``missed``: rows at the nearest miss, where nothing was solved. ``given``: the objective at the spec's own gains.
    """

    outcome: Outcome[Synthesis]
    missed: tuple[Row, ...] = ()
    starts: int = 0
    given: float | None = None
