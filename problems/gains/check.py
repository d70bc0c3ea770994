"""The winner under suspicion: bounds made exact, a verdict, a second integrator, eigenvalues, and what is active.

What the optimiser claims counts for nothing where these disagree with it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from design.analysis.recheck import second_opinion
from design.analysis.rows import Verdict
from design.analysis.synthesis import Active, Answer, Synthesis
from design.analysis.verdict import judge, worst
from design.model.laws import Gains
from design.solvers.outcome import Outcome, Status
from problems.gains.exchange import Local
from problems.gains.goal import GAINS, Goal
from problems.gains.grid import Grid, Point
from problems.gains.prices import prices
from problems.gains.question import APPROACH, Question

Array = NDArray[np.float64]

PATHS = (*APPROACH, "torque-rate")
"""Rows that are read from the whole of a run and are no limits of the plant."""
SLACK = {"decay-rate": 1e-3, "goals": 1e-3, "step-slope": 3e-4, "push": 3e-4}
"""Part by which a row may be worse than the program says, where it is not 1e-5.

At a triple pole the gains' last digits cost so much; the largest disturbance is reported as the last one tried.
"""


def checked(grid: Grid, winner: Local, tried: int, reached: int, optima: int) -> Answer:
    """The answer that ``winner`` deserves: solved if everything agrees, undecided with what does not otherwise."""
    question, goal = grid.question, grid.goal
    gains, verdict, value = _snapped(question, goal, winner.point.gains)
    others, broken_beside = _beside(question, goal, gains)
    if broken_beside and gains != winner.point.gains:
        gains = winner.point.gains
        verdict = _judged(question, goal, gains)
        value = question.score(goal, gains, verdict)
        others, broken_beside = _beside(question, goal, gains)
    value = min(value, others) if goal.sign > 0 else max(value, others)
    claim = goal.value(winner.point.v)
    active = (*active_rows(question, goal, gains, verdict, value), *_along(grid, gains, verdict, value))
    synthesis = Synthesis(
        gains=gains, objective=goal.id, value=value, active=active,
        verdict=verdict, starts=tried, reached=reached, optima=optima, prices=prices(grid, winner),
    )  # fmt: skip
    doubt = _doubt(question, goal, gains, verdict) or broken_beside
    slack = SLACK.get(goal.id, 1e-5)
    if goal.v(value) < winner.point.v - slack * (abs(winner.point.v) + 1e-3):
        doubt = doubt or f"{goal.id}: the program claims {claim:.8g}, the report gives {value:.8g} {goal.unit}."
    broken = [row for row in verdict.rows if row.counts and row.status != "met"]
    if broken:
        doubt = doubt or f"{broken[0].title} is {broken[0].status}. {broken[0].note}".strip()
    if doubt:
        return Answer(outcome=Outcome(status=Status.DISAGREEMENT, detail=doubt), missed=verdict.rows, starts=tried)
    setting = question.setting
    given = (
        None if setting.gains is None else question.score(goal, setting.gains, _judged(question, goal, setting.gains))
    )
    return Answer(outcome=Outcome(status=Status.SOLVED, found=synthesis), starts=tried, given=given)


def _judged(question: Question, goal: Goal, gains: Gains) -> Verdict:
    return judge(question.setting, gains, also=(goal.id,))


def _beside(question: Question, goal: Goal, gains: Gains) -> tuple[float, str]:
    """The worst value of the objective over the other bodies, and what one of them breaks, or an empty string."""
    worst, broken = goal.sign * np.inf, ""
    for world in question.worlds[1:]:
        verdict = judge(world, gains, also=(goal.id,))
        value = question.score(goal, gains, verdict)
        worst = min(worst, value) if goal.sign > 0 else max(worst, value)
        for row in verdict.rows:
            if row.counts and row.status != "met" and not broken:
                broken = f"{row.title} is {row.status} by {row.margin} {row.unit} for another body of the box."
    return float(worst), broken


def _snapped(question: Question, goal: Goal, gains: Gains) -> tuple[Gains, Verdict, float]:
    """The gains with those that touch a bound put on it, unless that costs anything."""
    verdict = _judged(question, goal, gains)
    value = question.score(goal, gains, verdict)
    K = np.array(gains)
    for bound in (question.lower, question.upper):
        K = np.where(np.abs(K - bound) <= 1e-6 * question.scale, bound, K)
    snapped = Gains(*map(float, K))
    if snapped == gains:
        return gains, verdict, value
    other = _judged(question, goal, snapped)
    its = question.score(goal, snapped, other)
    if other.overall == "met" and goal.v(its) >= goal.v(value) - 1e-7 * abs(goal.v(value)):
        return snapped, other, its
    return gains, verdict, value


def _doubt(question: Question, goal: Goal, gains: Gains, verdict: Verdict) -> str:
    """What a second integrator and eigenvalues say against the rows, or an empty string."""
    setting = question.setting
    for scenario in setting.scenarios:
        opinion = second_opinion(
            setting.under(scenario).biped, setting.law, setting.theta_d, gains, scenario, setting.step, setting.adapt,
            setting.target,
        )  # fmt: skip
        if not opinion.finished:
            return f"In scenario {scenario.name!r} the second integrator does not reach the end."
        rows = {row.id: row for row in verdict.rows if row.scenario == scenario.name}
        for id, force in (("toe-force", opinion.F_T), ("heel-force", opinion.F_H)):
            value, scale = rows[id].value, setting.biped.weight
            lowest = float(force.min())
            if value is None or abs(lowest - value) > 1e-5 * scale:
                return (
                    f"{id} in scenario {scenario.name!r}: {value} N with the step of {setting.step:g} s,"
                    f" {lowest:.8g} N with an adaptive integrator."
                )
    own = [each for each in question.environments if each.world is setting]
    slowest = min(-float(np.roots([1.0, *each.coefficients(gains)]).real.max()) for each in own)
    claimed = worst(verdict.rows, "decay-rate").value
    if slowest <= 0 or claimed is None or abs(slowest - claimed) > 1e-3 * question.pace:
        return f"decay-rate: {claimed} 1/s by the polynomial, {slowest:.8g} 1/s by eigenvalues."
    return ""


def active_rows(question: Question, goal: Goal, gains: Gains, verdict: Verdict, value: float) -> tuple[Active, ...]:
    """Bounds and rows that are tight at the optimum."""
    found = []
    for name, gain, low, high in zip(GAINS, gains, question.lower, question.widest, strict=True):
        for bound in {float(low), float(high)} if (name != "kf" or question.setting.law != "pd") else ():
            if abs(gain - bound) <= 1e-6 * max(high, 1e-300):
                found.append(Active(id=name, scenario=None, time_s=None, value=gain, required=bound))
    scales = {limit.id: limit.scale for limit in question.limits} | {"decay-rate": question.pace}
    for row in verdict.rows:
        if row.value is None or row.id not in scales:
            continue
        if row.id in goal.limits and abs(row.value - value) <= 1e-6 * scales[row.id]:
            found.append(Active(id=row.id, scenario=row.scenario, time_s=row.time_s, value=row.value, required=value))
        elif row.counts and row.id != goal.id and row.margin is not None and row.margin <= 1e-6 * scales[row.id]:
            found.append(
                Active(
                    id=row.id, scenario=row.scenario, time_s=row.time_s, value=row.value, required=row.required or 0.0
                )
            )
    return tuple(found)


def _along(grid: Grid, gains: Gains, verdict: Verdict, value: float) -> list[Active]:
    """Rows of the approach to the final posture, and of the torque's rate, that are tight, where they are tightest.

    A required settling time may be held by a sample long after it: one at which theta just stays within the band.
    """
    question, goal = grid.question, grid.goal
    if not any(question.asks(goal, id) for id in PATHS):
        return []
    margins = grid.margins(Point(gains=gains, v=goal.v(value)))
    found, own_cases = [], grid.cases[: len(question.setting.scenarios)]  # those of other bodies come after
    for case, names, rows, steps in zip(own_cases, grid.names(), margins or (), grid.samples, strict=False):
        for id in PATHS:
            own = rows[[name == id for name in names]]
            row = next((row for row in verdict.rows if (row.id, row.scenario) == (id, case.name)), None)
            # a settling time that is made short is that of a sample, and so held to within a step
            slack = 1.5 * question.setting.step / goal.scale if id == goal.id == "settling" else 1e-6
            if row is None or row.value is None or not own.size or own.min() > slack:
                continue
            at = int(np.argmin(own.min(axis=0)))
            required = value if id == goal.id else question.level(id)
            if required is not None:
                time_s = float(steps.t[at])
                found.append(Active(id=id, scenario=case.name, time_s=time_s, value=row.value, required=required))
    return found
