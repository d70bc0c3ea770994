"""From a setting to an answer: survey, starts on the coarse grid, full resolution, check; or the nearest miss."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from design.analysis.obstacles import obstacles
from design.analysis.recheck import load_integrator
from design.analysis.rows import Row
from design.analysis.survey import best_apart
from design.analysis.synthesis import Answer
from design.analysis.verdict import judge
from design.model.laws import Gains
from design.solvers.outcome import Outcome, Status
from design.spec.setting import Setting
from problems.gains.check import checked
from problems.gains.exchange import NEAR, Local, lowest_below, union
from problems.gains.goal import Goal
from problems.gains.grid import Grid, Instants, Point
from problems.gains.modelled import wanted
from problems.gains.question import Question
from problems.gains.sequential import optimise
from problems.gains.starts import CANDIDATES, UNKNOWN, from_start, survey

Array = NDArray[np.float64]
Say = Callable[[str], None]

PATIENCE = 4
"""Where only one start reached the best value, more are tried, up to so many times as many."""
MISSES = 3
"""Nearest misses, from so many starts without a feasible point, after which the search ends."""


def solve(
    setting: Setting,
    *,
    starts: int | None = None,
    seconds: float = 600.0,
    say: Say = lambda _: None,
    beside: Sequence[Setting] = (),
    near: Point | None = None,
) -> Answer:
    """Synthesize gains for ``setting``, and for the other bodies and worlds ``beside`` it with the same requirements.

    ``near``: a point that meets what is required, and close to which the optimum is thought to be; the survey and
    other starts are then left out. ``say`` is told of the progress. Raises ``BadInput`` if there are no bounds.
    """
    question = Question(setting, beside)
    goal = question.goal(setting.objective)
    stand_in = obstacles(setting)
    if stand_in:
        return Answer(outcome=Outcome(status=Status.INFEASIBLE, detail=str(stand_in[0])), obstacle=stand_in[0])
    deadline = time.monotonic() + seconds
    threading.Thread(target=load_integrator, daemon=True).start()  # takes as long as a start, on the other core
    coarse = Grid(question, question.coarse_step, goal)
    count = starts or setting.starts
    if near is None:
        say(f"surveying {CANDIDATES} gains")
        points, merit = survey(coarse)
        most = count if starts or wanted(question, goal) else PATIENCE * count  # those take their time
        chosen = best_apart(points, merit, most, question.lower, question.upper)
        merits = {tuple(K): m for K, m in zip(points, merit, strict=True)}
    else:
        chosen = np.clip(np.array([near.gains]), question.lower, question.upper)
        merits, count = {tuple(chosen[0]): max(near.v, UNKNOWN)}, 1
    optima: list[Local] = []
    misses: list[Local] = []
    instants = coarse.thinned()
    tried = 0
    while tried < min(count, len(chosen)) or (optima and tried < len(chosen) and _reached(optima) < 2):
        if time.monotonic() > deadline:
            return Answer(outcome=Outcome(status=Status.TIME_LIMIT, detail=f"{tried} starts were tried."), starts=tried)
        K = chosen[tried]
        tried += 1
        found, optimal = from_start(coarse, K, merits[tuple(K)], instants, deadline, stay=near is not None)
        instants = union(instants, found.instants)
        if optimal:
            optima.append(found)
        elif found.converged:
            misses.append(found)
        best = max((f.point.v for f in optima), default=None)
        say(f"start {tried}: best {_shown(goal, best)}")
        if not optima and len(misses) == MISSES:
            break
    if not optima:
        return _nothing(question, coarse, chosen[:tried], instants, deadline, misses)
    return _finish(question, coarse, optima, tried, deadline, say)


def _reached(optima: list[Local]) -> int:
    """How many starts came to the best value."""
    best = max(found.point.v for found in optima)
    return sum(found.point.v >= best - 1e-4 * (abs(best) + 1e-3) for found in optima)


def _shown(goal: Goal, v: float | None) -> str:
    return "none yet" if v is None else f"{goal.value(v):.6g} {goal.unit}"


def _finish(question: Question, coarse: Grid, optima: list[Local], tried: int, deadline: float, say: Say) -> Answer:
    """Carry the best optima to full resolution, and check the winner by other means."""
    goal = coarse.goal
    optima = sorted(optima, key=lambda found: -found.point.v)
    best = optima[0].point
    distinct = [optima[0]]
    for found in optima[1:]:
        if all(_apart(question, found.point, other.point) for other in distinct):
            distinct.append(found)
    fine = Grid(question, question.setting.step, goal)
    polished = []
    for found in distinct[:3]:
        if found.point.v < best.v - 0.02 * (abs(best.v) + 0.01):
            continue
        say("refining at full resolution")
        polished.append(refined(fine, found.point, deadline))
    done = [found for found in polished if found.converged]
    if not done:
        status = Status.TIME_LIMIT if time.monotonic() > deadline else Status.STALLED
        return Answer(outcome=Outcome(status=status, detail=f"IPOPT: {polished[0].said}."), starts=tried)
    winner = max(done, key=lambda found: found.point.v)
    say("checking")
    return checked(fine, winner, tried, _reached(optima), len(distinct))


def refined(fine: Grid, point: Point, deadline: float) -> Local:
    """The optimum near ``point`` at full resolution."""
    margins = fine.margins(point)
    seen = lowest_below(NEAR, margins, tuple(() for _ in margins)) if margins else fine.thinned()
    return optimise(fine, point, seen, deadline, near=True)


def _apart(question: Question, one: Point, other: Point) -> bool:
    return float(np.abs((np.array(one.gains) - np.array(other.gains)) / question.scale).max()) > 1e-3


def _nothing(
    question: Question, grid: Grid, starts: Array, instants: Instants, deadline: float, misses: list[Local]
) -> Answer:
    """No start led to a feasible point: say what the point that misses the requirements by least misses."""
    for K in starts if not misses else ():
        found = optimise(grid.feasibility, Point(gains=Gains(*map(float, K)), v=-0.5), instants, deadline)
        if found.converged:
            misses.append(found)
            break
    if not misses:
        status = Status.TIME_LIMIT if time.monotonic() > deadline else Status.NOT_FOUND
        return Answer(outcome=Outcome(status=status, detail="Not even the nearest miss was found."), starts=len(starts))
    best = max(misses, key=lambda found: found.point.v)
    verdict = judge(question.setting, best.point.gains)
    missed = tuple(row for row in verdict.rows if row.counts and row.status != "met")
    if not missed:
        return Answer(
            outcome=Outcome(status=Status.STALLED, detail="The optimiser did not converge."), starts=len(starts)
        )
    return Answer(outcome=Outcome(status=Status.NOT_FOUND, detail=_miss(missed)), missed=missed, starts=len(starts))


def _miss(missed: tuple[Row, ...]) -> str:
    parts = []
    for row in missed:
        if row.value is None or row.margin is None:
            parts.append(f"{row.title}: {row.note}")
        else:
            unit = "" if row.unit == "1" else f" {row.unit}"
            parts.append(
                f"{row.title} reaches {row.value:.6g}{unit} of {row.required:.6g} (misses by {-row.margin:.4g})"
            )
    return "At the point that misses by least, " + "; ".join(parts) + "."
