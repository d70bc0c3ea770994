"""What gain synthesis found: a design with its verdict and what holds it, or the nearest miss."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from design.analysis.objectives import OBJECTIVES
from design.analysis.rows import Row, Verdict
from design.model.laws import Gains
from design.solvers.outcome import Outcome


@dataclass(frozen=True, kw_only=True)
class MissRate:
    """What a long global search found on random ``specs``: better gains by 0.01 % on ``missed`` of them.

    On ``undecided`` of them no optimum was confirmed.
    """

    missed: int
    undecided: int
    specs: int


MEASURED = MissRate(missed=1, undecided=0, specs=50)
"""Against differential evolution with an independent simulator; local optima are no proof of a global one."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Active:
    """What holds the optimum: a row at a sample, or a bound of a gain."""

    id: str
    scenario: str | None
    time_s: float | None
    value: float
    required: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Price:
    """What one per cent more of a requirement's level, of a gain's bound or of the tolerances does to the objective.

    ``change``: by the multipliers of the program, in the objective's unit; None where they say nothing. ``solved``: by
    seeking gains again, where that was asked for.
    """

    id: str
    kind: Literal["requirement", "lower bound", "upper bound", "tolerances"]
    given: float
    unit: str
    change: float | None
    solved: float | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class BoxPoint:
    """A body and world of the box that a design was sought for: where ``row`` is worst, and its uncertain numbers.

    ``shares`` (7): of the half-widths.
    """

    row: str
    scenario: str | None
    shares: tuple[float, ...]
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
    prices: tuple[Price, ...] = ()
    box: Box | None = None


@dataclass(frozen=True, kw_only=True)
class Relaxation:
    """What would make the rest feasible: ``enough`` instead of ``given``, in ``unit``.

    ``id`` is a requirement, or a gain whose upper or lower bound is meant (``bound``). ``design``: gains that were
    checked to meet everything else, and this as far as ``enough``.
    """

    id: str
    bound: str
    given: float
    enough: float
    unit: str
    design: Gains

    def __str__(self) -> str:
        if self.bound:
            verb = "up to" if self.bound == "upper" else "down to"
            return f"{self.id} {verb} {self.enough:g} {self.unit} (now {self.given:g})"
        sign = ">=" if OBJECTIVES[self.id].sense == "at least" else "<="
        unit = "" if self.unit == "1" else f" {self.unit}"
        return f"{self.id} {sign} {self.enough:g}{unit} (now {self.given:g})"


@dataclass(frozen=True, kw_only=True)
class WhyNot:
    """``conflict``: requirements that no design was found to meet together, while one was without any one of them.

    Empty where none was found for contact and stability alone. Not ``minimal`` where time ran out before it was known,
    not ``complete`` where it ran out before all ``relaxations`` were; each of these alone is enough. ``feasible``:
    designs met on the way that keep every requirement after all. Nothing here is a proof: ``Outcome.proof`` is.
    """

    conflict: tuple[str, ...]
    minimal: bool
    complete: bool
    relaxations: tuple[Relaxation, ...]
    feasible: tuple[Gains, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Settling:
    """The decay rate that was ``required`` [1/s] although the spec asks none, and whether the design has it (``kept``).

    ``value`` of the objective and ``decay`` rate [1/s] are those of the best design without that requirement.
    """

    required: float
    value: float
    decay: float
    kept: bool


@dataclass(frozen=True, eq=False, kw_only=True)
class Answer:
    """The outcome, and what was found on the way; ``why`` not, where it was asked.

    ``missed``: rows at the nearest miss, where nothing was solved. ``given``: the objective at the spec's own gains.
    ``points`` of the box of [uncertainty] that were asked for too. ``best``: the best design that was checked to keep
    every requirement, where the search ended before its optimality was; no result of a solved outcome. ``settling``:
    None where the design decays as fast as is asked for.
    """

    outcome: Outcome[Synthesis]
    missed: tuple[Row, ...] = ()
    starts: int = 0
    given: float | None = None
    why: WhyNot | None = None
    points: tuple[BoxPoint, ...] = ()
    best: Synthesis | None = None
    settling: Settling | None = None
