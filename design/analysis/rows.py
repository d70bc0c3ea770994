"""A row: one limit in one scenario, its value, what is required, the margin, and whether it is met."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from design.analysis.simulate import Trajectory

Array = NDArray[np.float64]
RowStatus = Literal["met", "violated", "undecided"]
Basis = Literal["exact", "sampled", "proved", "measured"]


@dataclass(frozen=True, kw_only=True)
class Row:
    """One checked statement; ``margin`` >= 0 (for (27)-(29) and the decay rate > 0) means met.

    ``value``, ``required`` and ``margin`` in ``unit``; None where there is none. ``time_s``: where it is worst.
    """

    id: str
    equation: str
    scenario: str | None
    unit: str
    value: float | None
    required: float | None
    margin: float | None
    status: RowStatus
    time_s: float | None
    basis: Basis
    soft: bool = False
    note: str = ""

    @property
    def title(self) -> str:
        """The row and its scenario, in words."""
        return self.id + (f" in scenario {self.scenario!r}" if self.scenario else "")

    @property
    def counts(self) -> bool:
        """Whether the verdict depends on this row."""
        return self.required is not None and not self.soft


@dataclass(frozen=True, eq=False, kw_only=True)
class Series:
    """What a row was read from: ``value`` (n,) of its limit at times ``t`` (n,) [s], against ``level`` (None: none)."""

    id: str
    scenario: str
    unit: str
    sense: Literal["at least", "at most"]
    t: Array
    value: Array
    level: float | None


@dataclass(frozen=True, eq=False, kw_only=True)
class Verdict:
    """All rows of one design, and, where they are to be drawn, the runs and series that they were read from."""

    rows: tuple[Row, ...]
    trajectories: tuple[Trajectory, ...]
    series: tuple[Series, ...] = ()

    @property
    def overall(self) -> RowStatus:
        """``violated`` if any row that counts is; else ``undecided`` if any is, or if none counts; else ``met``."""
        counting = [row.status for row in self.rows if row.counts]
        if "violated" in counting:
            return "violated"
        return "undecided" if "undecided" in counting or not counting else "met"
