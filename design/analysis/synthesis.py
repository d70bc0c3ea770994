"""What gain synthesis found: a design with its verdict and what holds it, or the nearest miss."""

from __future__ import annotations

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
class Synthesis:
    """Gains and what is known of them. ``value`` in the unit of the objective; ``starts`` tried, ``reached`` it."""

    gains: Gains
    objective: str
    value: float
    active: tuple[Active, ...]
    verdict: Verdict
    starts: int
    reached: int
    optima: int


@dataclass(frozen=True, eq=False, kw_only=True)
class Answer:
    """The outcome, and what was found on the way.

    ``missed``: rows at the nearest miss, where nothing was solved. ``given``: the objective at the spec's own gains.
    """

    outcome: Outcome[Synthesis]
    missed: tuple[Row, ...] = ()
    starts: int = 0
    given: float | None = None
