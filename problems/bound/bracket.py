"""What is known of the best that any gains can do: a value that some reach, and a bound that none exceed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from design.analysis.objectives import OBJECTIVES
from design.analysis.synthesis import Synthesis

COVERED = ("decay-rate", "contact-force", "cop-margin", "torque", "friction")
"""Objectives of which a bound can be found."""

Basis = Literal["rigorous", "sampled relaxation"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Bracket:
    """No gains make the ``objective`` better than ``bound``; some reach ``value``, both in its unit.

    ``bound`` is None where none was found in time; ``gap``: their distance in parts of the value. ``asked``: the gap
    that was to be reached. ``rigorous``: a bound from the poles alone, if that was asked. ``boxes`` were looked at,
    ``trajectories``: of how many the trajectories too; ``left`` of them are not settled. ``better``: the design, where
    the search found gains better than those that it was given. ``ignored``: requirements that the bound knows nothing
    of.
    """

    objective: str
    value: float
    bound: float | None
    gap: float | None
    asked: float
    basis: Basis
    rigorous: float | None
    boxes: int
    trajectories: int
    left: int
    ignored: tuple[str, ...]
    better: Synthesis | None

    @property
    def closed(self) -> bool:
        """Whether the gap is as small as was asked."""
        return self.left == 0


def lines(found: Bracket) -> list[str]:
    """The bracket in words, a line each."""
    row = OBJECTIVES[found.objective]
    unit = "" if row.unit == "1" else f" {row.unit}"
    more = "more" if row.sign > 0 else "less"
    said = []
    if found.better is not None:
        said.append("the search found better gains than were given; they were polished")
    if found.bound is None or found.gap is None:
        said.append(f"no bound yet: {found.left} boxes of gains are not settled; give it more time")
    else:
        said.append(
            f"no gains within the bounds give {more} than {found.bound:.7g}{unit} ({found.basis});"
            f" this is {100 * found.gap:.2g} % from {found.value:.7g}{unit}"
        )
    if found.rigorous is not None and found.basis != "rigorous":
        said.append(f"from the poles alone, rigorous: not {more} than {found.rigorous:.7g}{unit}")
    end = "none is left" if found.closed else f"{found.left} are left: the time was over"
    said.append(f"{found.boxes} boxes of gains looked at, {found.trajectories} with their trajectories; {end}")
    if found.ignored:
        said.append(f"the bound does not use what is required of {', '.join(found.ignored)}")
    return said


def facts(found: Bracket) -> dict[str, Any]:
    """The bracket for JSON."""
    return {
        "objective": found.objective,
        "unit": OBJECTIVES[found.objective].unit,
        "value": found.value,
        "bound": found.bound,
        "gap": found.gap,
        "asked_gap": found.asked,
        "basis": found.basis,
        "rigorous_bound": found.rigorous,
        "boxes": found.boxes,
        "trajectories": found.trajectories,
        "left": found.left,
        "ignored": list(found.ignored),
        "better": found.better is not None,
    }
