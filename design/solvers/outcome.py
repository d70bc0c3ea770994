"""How a question ended. A value is out of reach unless it was solved *and* its residuals agree."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Generic, TypeVar

from design.errors import Unsolved

V = TypeVar("V")


class Status(Enum):
    """The ways to end; the value of each is what to tell the user."""

    SOLVED = "Solved, and confirmed by an independent check."
    INFEASIBLE = "No gains within the bounds can meet the specification; this is proved."
    NOT_FOUND = (
        "No feasible gains were found from any start. This is no proof that there are none; relax the requirement"
        " named, widen a bound, or try more starts."
    )
    STALLED = "The solver stopped before its optimality conditions held; try more starts or a finer time step."
    DISAGREEMENT = (
        "The independent check does not confirm what the solver found, and the check wins; a finer time step often"
        " settles it."
    )
    TIME_LIMIT = "The time limit came first."

    @property
    def word(self) -> str:
        """One word for machines: solved, infeasible or undecided."""
        return {Status.SOLVED: "solved", Status.INFEASIBLE: "infeasible"}.get(self, "undecided")


@dataclass(frozen=True, eq=False, kw_only=True)
class Outcome(Generic[V]):
    """A status, a sentence of ``detail``, and a value that only a solved outcome gives away."""

    status: Status
    detail: str = ""
    found: V | None = None

    @property
    def value(self) -> V:
        """The answer; raises ``Unsolved`` unless the status is solved."""
        if self.status is not Status.SOLVED or self.found is None:
            raise Unsolved(f"{self.status.value} {self.detail}".strip())
        return self.found
