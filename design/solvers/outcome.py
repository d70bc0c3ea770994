"""How a question ended. A value is out of reach unless it was solved *and* its residuals agree."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Generic, Protocol, TypeVar

from design.errors import Unsolved

V = TypeVar("V")


class Proof(Protocol):
    """Why no gains at all can do it: a necessary condition that fails; ``str()`` states it with its numbers."""

    @property
    def id(self) -> str:
        """The row that cannot be met."""

    @property
    def physical(self) -> bool:
        """Whether no requirement or bound stands in the way, but the body, the foot and the scenario themselves."""


class Status(Enum):
    """The ways to end; the value of each is what to tell the user."""

    SOLVED = "Solved, and confirmed by an independent check."
    INFEASIBLE = "No gains within the bounds can meet the specification; this is proved."
    NOT_FOUND = (
        "No design was found that meets the specification. This is no proof that there is none; relax a requirement"
        " named below, widen a bound, or try more starts."
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
    """A status, a sentence of ``detail``, and a value that only a solved outcome gives away.

    Infeasible is an outcome with a ``proof``, and no other outcome has one: raises ``ValueError`` otherwise.
    """

    status: Status
    detail: str = ""
    found: V | None = None
    proof: Proof | None = None

    def __post_init__(self) -> None:
        if (self.status is Status.INFEASIBLE) != (self.proof is not None):
            message = (
                f"status {self.status.name}, proof {self.proof}: what is infeasible, and nothing else, has a proof"
            )
            raise ValueError(message)

    @classmethod
    def infeasible(cls, proof: Proof) -> Outcome[V]:
        """The outcome that ``proof`` proves."""
        return cls(status=Status.INFEASIBLE, detail=str(proof), proof=proof)

    @property
    def value(self) -> V:
        """The answer; raises ``Unsolved`` unless the status is solved."""
        if self.status is not Status.SOLVED or self.found is None:
            raise Unsolved(f"{self.status.value} {self.detail}".strip())
        return self.found
