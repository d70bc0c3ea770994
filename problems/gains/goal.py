"""What ``v`` means: the margin that a program makes large, in the scale of its row."""

from __future__ import annotations

from dataclasses import dataclass

from design.analysis.objectives import OBJECTIVES, Objective

GAINS = ("kp", "kd", "kf")
GAIN_UNITS = ("N m/rad", "N m s/rad", "m/s")
MORE = "+"
"""Ends the id of a gain that is to be large: what its lower bound would have to be."""
BACKOFF = 1e-8
"""How far inside a requirement, in its scale, the program stays, so that rounding does not break it."""


@dataclass(frozen=True, kw_only=True)
class Goal:
    """An objective and its ``scale`` [unit]: its value is sign scale v; 1 - v for the soft ``goals``.

    ``feasibility`` is no row: v is the smallest margin of all hard requirements, each in its scale.
    """

    id: str
    unit: str
    sign: float
    scale: float

    @property
    def limits(self) -> tuple[str, ...]:
        """Ids of the limits along a trajectory whose worst value is the objective."""
        if self.id == "contact-force":
            return ("toe-force", "heel-force")
        return (self.id,) if self.id in ("cop-margin", "torque", "friction", "torque-rate") else ()

    @property
    def gain(self) -> int | None:
        """Which gain is made small, or large, if that is the objective."""
        name = self.id.rstrip(MORE)
        return GAINS.index(name) if name in GAINS else None

    def value(self, v: float) -> float:
        """The objective in its unit."""
        return 1.0 - v if self.id == "goals" else self.sign * self.scale * v

    def v(self, value: float) -> float:
        """The margin of an objective's ``value``."""
        return 1.0 - value if self.id == "goals" else self.sign * value / self.scale


FEASIBILITY = Goal(id="feasibility", unit="1", sign=1.0, scale=1.0)


def goal_of(id: str, scale: float) -> Goal:
    """The goal of a row, or of making a gain small or large."""
    if id.rstrip(MORE) in GAINS:
        return Goal(
            id=id, unit=GAIN_UNITS[GAINS.index(id.rstrip(MORE))], sign=1.0 if id.endswith(MORE) else -1.0, scale=scale
        )
    row: Objective = OBJECTIVES[id]
    return Goal(id=id, unit=row.unit, sign=row.sign, scale=scale)
