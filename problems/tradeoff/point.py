"""One design of the front: the best of one margin while the others keep their levels, checked."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from design.analysis.rows import Verdict
from design.analysis.synthesis import Active, Synthesis
from design.analysis.verdict import judge
from design.deadline import OutOfTime
from design.deadline import deadline as limited
from design.model.laws import Gains
from design.model.limits import Required
from design.spec.setting import Setting
from problems.gains.check import checked
from problems.gains.exchange import union
from problems.gains.grid import Grid, Instants, Point
from problems.gains.question import Question
from problems.gains.search import refined
from problems.gains.starts import from_start

Array = NDArray[np.float64]

BLURRED = 1e-4
"""Part of a loop's typical rate to which its decay rate is known where poles coincide, as best designs have them."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Design:
    """A point of the front: its ``gains``, the margins' ``values`` (k,) in their units, and what holds it.

    It is the best of margin ``asked`` under the ``levels`` of others, by id.
    """

    gains: Gains
    values: Array
    active: tuple[Active, ...]
    asked: str
    levels: Mapping[str, float]


class Designer:
    """Designs for one ``setting`` and the margins ``ids``; trajectories are built once for each margin."""

    def __init__(self, setting: Setting, ids: Sequence[str], deadline: float) -> None:
        self.setting, self.ids, self.deadline = replace(setting, gains=None), tuple(ids), deadline
        self._question = Question(setting)
        self._goals = [self._question.goal(id) for id in ids]
        self._grids: dict[str, tuple[Grid, Grid]] = {}
        self._instants: dict[str, Instants] = {}

    @property
    def late(self) -> bool:
        """Whether the time is over."""
        return time.monotonic() > self.deadline

    @property
    def scales(self) -> Array:
        """Typical sizes of the gains (3,)."""
        return self._question.scale

    def scale(self, k: int) -> float:
        """A typical size of margin number ``k``, in its unit."""
        return self._goals[k].scale

    def values(self, gains: Gains) -> tuple[Array, bool]:
        """The margins (k,) at ``gains`` from the rows of the report, and whether all that is required is kept."""
        return self._read(judge(self.setting, gains, also=self.ids), gains)

    def _read(self, verdict: Verdict, gains: Gains) -> tuple[Array, bool]:
        values = [self._question.score(goal, gains, verdict) for goal in self._goals]
        return np.array(values), verdict.overall == "met"

    def known(self, found: Synthesis, asked: str, levels: Mapping[str, float]) -> Design | None:
        """The design of a checked answer; None where the report does not accept it, or a margin has no value."""
        told = {asked, *levels} >= set(self.ids)  # its verdict then has the rows of all margins
        values, met = self._read(found.verdict, found.gains) if told else self.values(found.gains)
        if not met or not np.isfinite(values).all():
            return None
        return Design(gains=found.gains, values=values, active=found.active, asked=asked, levels=dict(levels))

    def best(
        self, id: str, levels: Mapping[str, float], gains: Gains, value: float, *, near: bool = False
    ) -> Design | None:
        """The design of the largest margin ``id`` above the ``levels`` of others, or None if none was found.

        It starts at ``gains``, where the margin is thought to be ``value``; ``near``: at full resolution at once. None
        too where time is over.
        """
        try:
            with limited(self.deadline):
                return self._best(id, levels, gains, value, near)
        except OutOfTime:
            return None

    def _best(self, id: str, levels: Mapping[str, float], gains: Gains, value: float, near: bool) -> Design | None:
        required = {**self.setting.required, **{other: Required(level=level) for other, level in levels.items()}}
        question = self._question.asking(replace(self.setting, objective=id, required=required))
        goal = question.goal(id)
        fine, coarse = (grid.asking(question) for grid in self._bases(id))
        point = Point(gains=Gains(*np.clip(np.array(gains), question.lower, question.upper)), v=goal.v(value))
        if not near:
            seen = self._instants.get(id, coarse.thinned())
            found, optimal = from_start(coarse, np.array(point.gains), point.v, seen, self.deadline)
            if not optimal:
                return None
            self._instants[id] = union(found.instants, coarse.thinned())
            point = found.point
        winner = refined(fine, point, self.deadline)
        if not winner.converged:
            return None
        for grid in (fine, fine.asking(self._lenient(question))):
            answer = checked(grid, winner, 1, 1, 1)
            if answer.outcome.found is not None:
                return self.known(answer.outcome.found, id, levels)
        return None

    def _lenient(self, question: Question) -> Question:
        """The question with decay rates that the last digits of the gains can tell apart; the spec's own are kept."""
        required = dict(question.setting.required)
        if "decay-rate" in required and not required["decay-rate"].soft:
            own = self._question.level("decay-rate")
            level = required["decay-rate"].level - BLURRED * question.pace
            required["decay-rate"] = Required(level=level if own is None else max(level, own))
        return question.asking(replace(question.setting, required=required))

    def _bases(self, id: str) -> tuple[Grid, Grid]:
        """The grids at full resolution and coarse whose trajectories the questions about this margin share."""
        if id not in self._grids:
            question = self._question.asking(replace(self.setting, objective=id))
            goal = question.goal(id)
            self._grids[id] = (
                Grid(question, question.setting.step, goal),
                Grid(question, question.coarse_step, goal),
            )
            for grid in self._grids[id]:
                _ = grid.quantities
        return self._grids[id]
