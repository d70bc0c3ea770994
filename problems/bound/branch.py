"""Branch and bound: boxes of gains are excluded or split, the most promising first.

A box is excluded where it holds no gains that reach the target, the best value known and the gap more. What is excluded
therefore lies below the target, and what is left has bounds of its own, found by halving. What was seen of a box serves
its parts for some generations: a quadratic over the whole is one over each part.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.deadline import OutOfTime
from problems.bound.course import UNSEEN, Course, Seen
from problems.bound.poles import Poles
from problems.bound.relax import Quadratics, smallest_row
from problems.gains import Question
from problems.gains.goal import Goal

Array = NDArray[np.float64]
Which = NDArray[np.intp] | NDArray[np.bool_]
Improve = Callable[[Array, float], float]
Say = Callable[[float, int, int], None]

HALVINGS = 7
AT_ONCE = 64
"""Boxes that are split in a round; eight times as many where only the poles are looked at."""
GENERATIONS = 3
"""After so many, the trajectories of a box are looked at anew."""
NEAR_ZERO = 0.03
"""Part of its upper bound below which a gain is no longer split by its logarithm."""
SMALLEST = 0.01
"""Value, in its scale, below which the gap is no longer relative."""
TRIED = 2e-5
"""Gain in v, relative, from which a point of the search counts as better."""


@dataclass(frozen=True, eq=False)
class Boxes:
    """Open boxes: ``centre`` and ``radius`` (b, 3) in parts of ``scale``, and the bound ``most`` (b,) of v in each.

    ``rows``: of the last look, ``age`` (b,) generations ago, over the box itself, and whether it was ``clear`` (b,).
    """

    centre: Array
    radius: Array
    most: Array
    age: NDArray[np.int64]
    clear: NDArray[np.bool_]
    rows: Quadratics

    def __len__(self) -> int:
        return len(self.most)

    def at(self, which: Which) -> Boxes:
        """Those boxes."""
        return Boxes(
            self.centre[which],
            self.radius[which],
            self.most[which],
            self.age[which],
            self.clear[which],
            self.rows.at(which),
        )

    def joined(self, other: Boxes) -> Boxes:
        """These and those."""
        return Boxes(
            np.vstack([self.centre, other.centre]),
            np.vstack([self.radius, other.radius]),
            np.concatenate([self.most, other.most]),
            np.concatenate([self.age, other.age]),
            np.concatenate([self.clear, other.clear]),
            self.rows.joined(other.rows),
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Searched:
    """No gains of the box have a v above ``bound``; ``best``: the greatest v known; ``looked`` at, and ``left``.

    ``courses``: how often the trajectories of a box were looked at.
    """

    bound: float
    best: float
    looked: int
    courses: int
    left: Boxes


class Exclusion:
    """What is asked of a box at a level of v: the poles, and the trajectories where there is a course."""

    def __init__(self, question: Question, goal: Goal, course: Course | None) -> None:
        self.poles, self.course = Poles(question), course
        self._sets_rate = goal.id == "decay-rate"
        self._needed = question.decay / question.pace
        self.of: Array = np.zeros(0) if course is None else course.of

    def missed(self, boxes: Boxes, v: Array) -> tuple[Array, Array]:
        """Below 0 where no gains of a box (b,) reach ``v``; and how much each gain matters there (b, 3)."""
        sigma = np.maximum(v, self._needed) if self._sets_rate else np.full_like(v, self._needed)
        rows = self.poles.rows(boxes.centre, boxes.radius, sigma)
        return smallest_row(rows.beside(boxes.rows.lowered(self.of * v[:, None])))

    def reached(self, boxes: Boxes, seen: Seen | None) -> tuple[Array, Array]:
        """Points that were tried (k, 3), and the v that each reaches; -inf where a requirement is broken."""
        if seen is None:
            points = boxes.centre
            return points, self.poles.decay(points) if self._sets_rate else np.full(len(points), -np.inf)
        points = seen.points.reshape(-1, 3)
        v, required = seen.objective.ravel(), seen.required.ravel()
        kept = np.flatnonzero((required >= 0) & (v > -np.inf))
        decay = np.full(len(points), -np.inf)
        decay[kept] = self.poles.decay(points[kept])
        v = np.minimum(v, decay) if self._sets_rate else v
        return points, np.where(decay >= self._needed, v, -np.inf)

    def root(self, question: Question, most: float = np.inf) -> Boxes:
        """The whole box of gains, in which v is at most ``most``."""
        lower, upper = question.lower / question.scale, question.upper / question.scale
        m = len(self.of)
        unseen = Quadratics(np.full((1, m), UNSEEN), np.zeros((1, m, 3)), np.zeros((1, m, 6)))
        return Boxes(
            (0.5 * (lower + upper))[None],
            (0.5 * (upper - lower))[None],
            np.array([most]),
            np.zeros(1, dtype=int),
            np.array([m == 0]),
            unseen,
        )


def target_of(best: float, gap: float) -> float:
    """The v that the search shows to be out of reach."""
    return best + gap * max(abs(best), SMALLEST)


def branch(
    test: Exclusion, box: Boxes, best: float, gap: float, deadline: float, improve: Improve, say: Say = lambda *_: None
) -> Searched:
    """Search ``box`` until no gains can reach ``best`` and the ``gap`` (relative), or until the ``deadline``.

    ``improve`` is given a point that is better than ``best`` and returns the best v known from then on; ``say`` is told
    the bound, the boxes that were looked at, and those that are left.
    """
    open_, looked, courses = box, 1, 0
    size = AT_ONCE * (8 if test.course is None else 1)
    target = target_of(best, gap)
    while len(open_) and time.monotonic() < deadline:
        unsettled = open_
        order = np.argsort(-open_.most, kind="stable")
        now, open_ = open_.at(order[:size]), open_.at(order[size:])
        missed, matters = test.missed(now, np.full(len(now), target))
        now = _split(now.at(missed >= 0), matters[missed >= 0])
        if not len(now):
            continue
        looked += len(now)
        now = now.at(test.missed(now, np.full(len(now), target))[0] >= 0)
        if not len(now):
            continue
        old = now.age >= GENERATIONS if test.course is not None else np.ones(len(now), dtype=bool)
        if old.any():
            try:
                seen = None if test.course is None else test.course.look(now.centre[old], now.radius[old])
            except OutOfTime:  # the boxes of this round stay as they were before it
                open_ = unsettled
                break
            points, reached = test.reached(now.at(old), seen)
            top = int(np.argmax(reached))
            if reached[top] > best + TRIED * max(abs(best), SMALLEST):
                best = max(best, improve(points[top], float(reached[top])))
                target = target_of(best, gap)
            if seen is not None:
                courses += int(old.sum())
                fresh = now.at(old)
                fresh = Boxes(fresh.centre, fresh.radius, fresh.most, np.zeros_like(fresh.age), seen.clear, seen.rows)
                now = now.at(~old).joined(fresh)
        open_ = open_.joined(_tightened(test, now, target))
        open_ = open_.at(open_.most > target)
        say(max(target, float(open_.most.max(initial=-np.inf))), looked, len(open_))
    bound = max(target, float(open_.most.max(initial=-np.inf)))
    return Searched(bound=bound, best=best, looked=looked, courses=courses, left=open_)


def _tightened(test: Exclusion, boxes: Boxes, target: float) -> Boxes:
    """Those of the boxes that may reach the target, each with a bound of its own."""
    low = np.full(len(boxes), target)
    boxes = boxes.at(test.missed(boxes, low)[0] >= 0)
    if not len(boxes):
        return boxes
    rows = boxes.rows
    alone = rows.f + np.abs(rows.g).sum(axis=2) + np.abs(rows.H).sum(axis=2)
    alone = np.where((test.of > 0) & (alone < 0.5 * UNSEEN), alone, np.inf).min(axis=1, initial=np.inf)
    most = np.minimum(boxes.most, alone)
    some = np.flatnonzero(np.isfinite(most))
    high, low, part = most[some].copy(), np.full(len(some), target), boxes.at(some)
    for _ in range(HALVINGS if len(some) else 0):
        middle = 0.5 * (low + high)
        out = test.missed(part, middle)[0] < 0
        high, low = np.where(out, middle, high), np.where(out, low, middle)
    most[some] = high
    return Boxes(boxes.centre, boxes.radius, most, boxes.age, boxes.clear, rows)


def _split(boxes: Boxes, matters: Array) -> Boxes:
    """Each box in two, across the gain that matters most; where it was not seen clearly, that varies most in parts."""
    if not len(boxes):
        return boxes
    weight = matters / np.maximum(matters.max(axis=1, keepdims=True), 1e-300)
    length = boxes.radius / (boxes.centre + boxes.radius + NEAR_ZERO)
    score = np.where(~boxes.clear[:, None], length, weight + 0.3 * length / length.max(axis=1, keepdims=True))
    side = np.argmax(np.where(boxes.radius > 0, score, -1.0), axis=1)
    b = np.arange(len(side))
    half = np.ones_like(boxes.radius)
    half[b, side] = 0.5
    off = np.zeros_like(half)
    off[b, side] = 0.5
    parts = [
        Boxes(
            boxes.centre + sign * off * boxes.radius, half * boxes.radius, boxes.most, boxes.age + 1,
            boxes.clear,             boxes.rows.onto(sign * off, half),
        )
        for sign in (-1.0, 1.0)
    ]  # fmt: skip
    return parts[0].joined(parts[1])
