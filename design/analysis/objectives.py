"""What a design may be asked to make large or small: every row that has a size, and the soft goals together.

``goals`` is the largest of the soft requirements, each made a number without unit that is below 1 where it is met:
1 + (level - value)/size, or 1 + (value - level)/size where the value must be at most the level. The size is the level
itself, or a usual value where the level is 0; what must be at most L thus counts value/L.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Sense = Literal["at least", "at most"]


@dataclass(frozen=True, kw_only=True)
class Objective:
    """A row as an objective: made large where it must be ``at least`` something, small where ``at most``.

    ``usual`` is a size of it, in ``unit``, from which it is worth a thought; None where the body gives one.
    """

    id: str
    unit: str
    sense: Sense
    usual: float | None = None

    @property
    def sign(self) -> float:
        """1 where more is better, -1 where less is."""
        return 1.0 if self.sense == "at least" else -1.0

    @property
    def verb(self) -> str:
        """``maximise`` or ``minimise``."""
        return "maximise" if self.sense == "at least" else "minimise"


def _table(*rows: tuple[str, str, Sense, float | None]) -> dict[str, Objective]:
    return {id: Objective(id=id, unit=unit, sense=sense, usual=usual) for id, unit, sense, usual in rows}


OBJECTIVES = _table(
    ("decay-rate", "1/s", "at least", None),
    ("contact-force", "N", "at least", None),
    ("cop-margin", "m", "at least", None),
    ("routh-margin", "1", "at least", 1.0),
    ("gain-margin-up", "1", "at least", 1.0),
    ("phase-margin", "deg", "at least", 30.0),
    ("delay-margin", "s", "at least", 0.01),
    ("force-delay-margin", "s", "at least", 0.1),
    ("angle-delay-margin", "s", "at least", 0.01),
    ("disk-margin", "1", "at least", 1.0),
    ("sample-time", "s", "at least", 0.01),
    ("step-slope", "deg", "at least", None),
    ("push", "N s", "at least", None),
    ("slope-rate", "deg/s", "at least", 10.0),
    ("goals", "1", "at most", 1.0),
    ("torque", "N m", "at most", None),
    ("torque-rate", "N m/s", "at most", None),
    ("friction", "1", "at most", 1.0),
    ("settling", "s", "at most", 1.0),
    ("overshoot", "deg", "at most", 1.0),
    ("posture-error", "deg", "at most", 1.0),
    ("gain-margin-down", "1", "at most", 0.1),
)
"""By id."""


def shortfall(objective: Objective, value: float, level: float, size: float) -> float:
    """A requirement as a number that is below 1 where it is met."""
    return 1.0 - objective.sign * (value - level) / size
