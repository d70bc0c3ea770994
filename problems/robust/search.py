"""Rounds of: seek the worst point of the box, add it as a body, seek gains again; then many points, and a proof."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from design.analysis.spread import in_box
from design.analysis.synthesis import Answer, Box, BoxPoint
from design.deadline import OutOfTime
from design.deadline import deadline as limited
from design.model.laws import Gains
from design.proof.box import prove
from design.solvers.outcome import Outcome, Status
from design.spec.setting import Setting
from problems import gains as nominal
from problems.gains.goal import Goal
from problems.gains.grid import Point
from problems.gains.question import Question
from problems.robust.worst import INSIDE, Weak, named, path_ids, runs, sampled_margins, weakest, world

Say = Callable[[str], None]

ROUNDS = 20
FOUND = 2e-5
"""Violation, in its scale, from which a point of the box counts as found: what a coarse march can tell."""
AT_ONCE = 3
"""Points that are added in a round, at most."""
TRIED = 1000
"""Points of the box in which the answer is tried, beside its corners."""
TRIAL = 4e-3
"""Step of the runs of those bodies [s]."""
PROOF = 30.0
"""Seconds for the proofs of contact over the box, in all scenarios."""


def solve(
    setting: Setting,
    *,
    starts: int | None = None,
    seconds: float = 600.0,
    say: Say = lambda _: None,
    known: Sequence[Gains] = (),
) -> Answer:
    """Gains for every point of the box of [uncertainty]; without one, or with ``robust`` off, for the nominal body.

    ``known``: gains that may meet the specification, to start from too.
    """
    deadline = time.monotonic() + seconds
    first = nominal.solve(setting, starts=starts, seconds=seconds, say=say, known=known)
    if not setting.robust or setting.tolerances.none or first.outcome.found is None:
        return first
    try:
        with limited(deadline):
            return _over_box(setting, first, starts, deadline, say, known)
    except OutOfTime:
        said = "The best gains for the nominal body are known, what the box of [uncertainty] does to them is not."
        return Answer(outcome=Outcome(status=Status.TIME_LIMIT, detail=said), starts=first.starts)


def _over_box(
    setting: Setting, first: Answer, starts: int | None, deadline: float, say: Say, known: Sequence[Gains]
) -> Answer:
    """Rounds of the worst point of the box, and gains that hold there too."""
    question = Question(setting)
    goal = question.goal(setting.objective)
    step = question.coarse_step
    answer, found = first, first.outcome.value
    best, v = found.gains, goal.v(found.value)
    points: list[Weak] = []
    met = [*known, best]
    for round_ in range(ROUNDS):
        say(f"round {round_ + 1}: looking for the body and world that breaks the design worst")
        weak = weakest(question, goal, best, v, step)
        new = [each for each in weak if each.margin < -FOUND and not _near(each, points)][:AT_ONCE]
        if not new:
            break
        points += new
        beside = [world(setting, each.shares, each.scenario) for each in points]
        left = deadline - time.monotonic()
        say(f"round {round_ + 1}: {new[0].id} breaks by {-new[0].margin:.2g} of its scale; {len(points)} points beside")
        near = Point(gains=best, v=v + min(each.margin for each in new))
        answer = nominal.solve(setting, seconds=max(left, 0.01), say=say, beside=beside, near=near)
        if answer.outcome.found is None and left > 0:
            left = max(deadline - time.monotonic(), 0.01)
            met.append(best)
            answer = nominal.solve(setting, starts=starts, seconds=left, say=say, beside=beside, known=met)
        if answer.outcome.found is None:
            return _over_the_box(setting, answer, points)
        best, v = answer.outcome.found.gains, goal.v(answer.outcome.found.value)
    else:
        said = f"{ROUNDS} rounds; each found a worse point of the box."
        return Answer(outcome=Outcome(status=Status.STALLED, detail=said), starts=answer.starts)
    return _finished(question, goal, answer, first, points, round_ + 1, deadline, say)


def _near(weak: Weak, points: list[Weak]) -> bool:
    """Whether this point is one of those that are known."""
    return any(
        weak.scenario == other.scenario and float(np.abs(np.subtract(weak.shares, other.shares)).max()) < 1e-3
        for other in points
    )


def _over_the_box(setting: Setting, answer: Answer, points: list[Weak]) -> Answer:
    said = f"Over the box of [uncertainty], with {len(points)} of its points: {answer.outcome.detail}"
    return replace(
        answer, outcome=Outcome(status=answer.outcome.status, detail=said), points=_box_points(setting, points)
    )


def _box_points(setting: Setting, points: list[Weak]) -> tuple[BoxPoint, ...]:
    return tuple(
        BoxPoint(row=each.id, scenario=each.scenario, shares=each.shares, at=named(setting, each.shares))
        for each in points
    )


def _finished(
    question: Question, goal: Goal, answer: Answer, first: Answer, points: list[Weak], rounds: int, deadline: float,
    say: Say,
) -> Answer:  # fmt: skip
    """The answer with what is known of it over the box."""
    setting, found, alone = question.setting, answer.outcome.value, first.outcome.value
    say(f"trying {TRIED} bodies and worlds")
    shares = np.vstack([in_box(setting.tolerances, INSIDE), *[list(each.shares) for each in points]])
    shares = np.vstack([shares, in_box(setting.tolerances, TRIED)[-TRIED:]])
    lost, worst = _tried(question, goal, found.gains, goal.v(found.value), shares)
    if lost:
        said = f"{lost} of {len(shares)} bodies and worlds of the box break it, by up to {-worst:.2g} of a row's scale."
        return Answer(outcome=Outcome(status=Status.DISAGREEMENT, detail=said), starts=answer.starts)
    few = shares[: -TRIED or None]
    broken, _ = _tried(question, goal, alone.gains, -math.inf, few)
    proofs, end = [], min(deadline, time.monotonic() + PROOF)
    bare = replace(setting, required={})  # contact >= 0: what is required often holds the design, with nothing to spare
    for scenario in setting.scenarios if setting.plain else ():
        say(f"{scenario.name}: proving contact over the whole box")
        left = end - time.monotonic()
        proof = prove(bare, found.gains, scenario.name, seconds=max(left, 0.01))
        proofs.append((scenario.name, proof.answer, proof.share))
    box = Box(
        rounds=rounds, tried=len(shares), nominal=alone.value, nominal_gains=alone.gains,
        nominal_broken=broken / len(few), proofs=tuple(proofs),
        points=_box_points(setting, points),
    )  # fmt: skip
    return replace(answer, given=first.given, outcome=Outcome(status=Status.SOLVED, found=replace(found, box=box)))


def _tried(question: Question, goal: Goal, gains: Gains, v: float, shares: np.ndarray) -> tuple[int, float]:
    """How many of those bodies break a limit along a run, or the claimed ``v``; and the worst margin."""
    setting = question.setting
    kept, worst = np.ones(len(shares), dtype=bool), math.inf
    for scenario in setting.scenarios:
        happened = runs(
            setting, scenario, gains, shares, max(setting.step, TRIAL), paths=bool(path_ids(question, goal))
        )
        its = sampled_margins(question, goal, v, happened)
        for id, margin in its.items():
            claimed = id in goal.limits and math.isfinite(v)
            slack = FOUND if claimed or id in path_ids(question, goal) else 1e-7
            kept &= margin >= -slack
            worst = min(worst, float(margin.min()))
    return int((~kept).sum()), worst
