"""What is said about a recording, and who stands on the plates."""

from __future__ import annotations

from dataclasses import dataclass, field

from design.model.body import Biped
from design.recordings.checks import Agreement


@dataclass(eq=False, kw_only=True)
class Remarks:
    """What is said about a recording: what was noted, what was assumed, and what warns."""

    notes: list[str] = field(default_factory=list)
    assumed: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


@dataclass(frozen=True, eq=False, kw_only=True)
class Subject:
    """Who stands on the plates: ``biped``, whether it is the user's spec (``given``), and where the law holds the CoP.

    ``target``: P_d [m] from the ankle.
    """

    biped: Biped
    given: bool
    target: float = 0.0


def note(found: Agreement | None, say: Remarks) -> None:
    """Note how two CoPs agree, or warn if it is only roughly."""
    if found is not None:
        (say.notes if found.close else say.warnings).append(found.sentence)
