"""From a design to its bracket: what the poles allow, then what the trajectories allow as well."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from design.analysis.synthesis import Synthesis
from design.deadline import OutOfTime
from design.deadline import deadline as limited
from design.errors import BadInput
from design.model.laws import Gains
from design.spec.setting import Setting
from problems import gains
from problems.bound.bracket import COVERED, Bracket
from problems.bound.branch import SMALLEST, Exclusion, Searched, branch, target_of
from problems.bound.course import Course
from problems.gains import Grid, Point, Question
from problems.gains.goal import Goal

Array = NDArray[np.float64]
Say = Callable[[str], None]

POLES_SHARE = 0.15
"""Part of the time that is spent on the poles alone, at most."""
USED = ("contact-force", "cop-margin", "torque", "friction", "decay-rate")
POLISHED = 4
"""How often a better point is polished, at most."""


def check(setting: Setting) -> None:
    """Raise ``BadInput`` for what no bound is known of."""
    if setting.objective not in COVERED:
        message = f"does not cover {setting.objective}; it bounds {', '.join(COVERED)}"
        raise BadInput(message, key="--global")
    if setting.robust and not setting.tolerances.none:
        message = "is for the nominal body, and the spec has [uncertainty]; add --nominal"
        raise BadInput(message, key="--global")


def bracket(
    setting: Setting, synthesis: Synthesis, *, seconds: float = 60.0, gap: float = 1e-3, say: Say = lambda _: None
) -> Bracket:
    """Bracket the best value of ``setting``'s objective, of which ``synthesis`` is thought to be the optimum.

    Ends when nothing can be better by more than ``gap`` (relative), or after ``seconds``. Raises ``BadInput``: see
    ``check``.
    """
    check(setting)
    begun = time.monotonic()
    with limited(begun + seconds):
        return _bracket_of(setting, synthesis, begun, seconds, gap, say)


def _bracket_of(setting: Setting, synthesis: Synthesis, begun: float, seconds: float, gap: float, say: Say) -> Bracket:
    question = Question(setting, reach=math.inf)  # what is said of all gains is asked of all gains
    goal = question.goal(setting.objective)
    keeper = _Keeper(setting, goal, question, synthesis, begun + seconds, say)
    best = goal.v(synthesis.value)
    exact: Searched | None = None
    if goal.id == "decay-rate":
        say("bounding by the poles alone")
        test = Exclusion(question, goal, None)
        exact = branch(
            test,
            test.root(question, test.poles.fastest(question)),
            best,
            gap,
            begun + POLES_SHARE * seconds,
            lambda _, v: v,
        )
        if exact.bound <= target_of(best, gap) * (1 + 1e-12):
            return _bracket(question, goal, keeper, exact, exact, gap, courses=False)
    say("bounding by the trajectories")
    most = math.inf if exact is None else exact.bound
    try:
        test = Exclusion(question, goal, Course(Grid(question, question.coarse_step, goal)))
        root = test.root(question, most)
        found = branch(test, root, best, gap, begun + seconds, keeper.improve, keeper.say)
    except OutOfTime:  # before the first trajectory
        root = Exclusion(question, goal, None).root(question, most)
        found = Searched(bound=most, best=best, looked=1, courses=0, left=root)
    return _bracket(question, goal, keeper, found, exact, gap, courses=True)


class _Keeper:
    """The best design known: a better point that the search comes across is polished and checked."""

    def __init__(
        self, setting: Setting, goal: Goal, question: Question, given: Synthesis, deadline: float, say: Say
    ) -> None:
        self.given = self.best = given
        self._setting, self._goal, self._scale = setting, goal, question.scale
        self._deadline, self._say, self._tries = deadline, say, 0

    @property
    def v(self) -> float:
        """What the best design reaches."""
        return self._goal.v(self.best.value)

    def improve(self, point: Array, v: float) -> float:
        """Polish ``point``, which is thought to reach ``v``; returns what is reached for certain."""
        if self._tries >= POLISHED:
            return self.v
        self._tries += 1
        self._say(f"polishing better gains: {self._goal.value(v):.6g} {self._goal.unit}")
        near = Point(gains=Gains(*map(float, point * self._scale)), v=v)
        left = max(self._deadline - time.monotonic(), 0.0)
        found = gains.solve(self._setting, seconds=left, near=near).outcome.found
        if found is not None and self._goal.v(found.value) > self.v:
            self.best = found
        return self.v

    def say(self, bound: float, boxes: int, left: int) -> None:
        """Tell of the progress."""
        shown = f"{self._goal.value(bound):.6g} {self._goal.unit}" if math.isfinite(bound) else "none yet"
        self._say(f"bound {shown}; {boxes} boxes, {left} left")


def _bracket(
    question: Question,
    goal: Goal,
    keeper: _Keeper,
    found: Searched,
    exact: Searched | None,
    gap: float,
    *,
    courses: bool,
) -> Bracket:
    bound = min(found.bound, math.inf if exact is None else exact.bound)
    known = math.isfinite(bound)
    ignored = tuple(id for id in question.setting.required if question.level(id) is not None and id not in USED)
    value = keeper.best.value
    by_poles = not courses or (exact is not None and bound == exact.bound)
    return Bracket(
        objective=goal.id,
        value=value,
        bound=goal.value(bound) if known else None,
        gap=(bound - keeper.v) / max(abs(keeper.v), SMALLEST) if known else None,
        asked=gap,
        basis="rigorous" if by_poles else "sampled relaxation",
        rigorous=None if exact is None else goal.value(exact.bound),
        boxes=found.looked + (0 if exact is None or found is exact else exact.looked),
        trajectories=found.courses,
        left=len(found.left),
        ignored=ignored,
        better=keeper.best if keeper.best is not keeper.given else None,
    )
