"""Designs that were judged at full resolution and keep every requirement: what a search may fall back on."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from design.analysis.rows import Verdict
from design.analysis.verdict import judge
from design.model.laws import Gains
from problems.gains.goal import Goal
from problems.gains.grid import Point
from problems.gains.question import Question


@dataclass(frozen=True, eq=False, kw_only=True)
class Incumbent:
    """Gains that keep every requirement for every body, their ``value`` of the objective, and the nominal verdict."""

    gains: Gains
    value: float
    verdict: Verdict


@dataclass(eq=False)
class Incumbents:
    """The incumbents of one question; each candidate is judged once."""

    question: Question
    goal: Goal
    _judged: dict[Gains, Incumbent | None] = field(default_factory=dict)

    def offer(self, candidates: Iterable[Gains]) -> None:
        """Judge ``candidates``, and keep those that are within the spec's bounds and meet every requirement."""
        question = self.question
        for gains in candidates:
            inside = np.all(question.lower <= np.array(gains)) and np.all(np.array(gains) <= question.widest)
            if gains not in self._judged and inside:
                self._judged[gains] = None  # should time run out meanwhile
                self._judged[gains] = self._checked(gains)

    def _checked(self, gains: Gains) -> Incumbent | None:
        values, first = [], None
        for world in self.question.worlds:
            verdict = judge(world, gains, also=(self.goal.id,))
            if verdict.overall != "met":
                return None
            first = first or verdict
            values.append(self.question.score(self.goal, gains, verdict))
        value = min(values) if self.goal.sign > 0 else max(values)
        if first is None or not np.isfinite(value):
            return None
        return Incumbent(gains=gains, value=value, verdict=first)

    @property
    def best(self) -> Incumbent | None:
        """The incumbent with the best objective."""
        kept = [each for each in self._judged.values() if each is not None]
        return max(kept, key=lambda each: self.goal.v(each.value), default=None)

    @property
    def points(self) -> list[Point]:
        """The incumbents as points of the program, best first."""
        kept = [each for each in self._judged.values() if each is not None]
        points = [Point(gains=each.gains, v=self.goal.v(each.value)) for each in kept]
        return sorted(points, key=lambda point: -point.v)
