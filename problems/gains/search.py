"""From a setting to an answer: survey, starts on the coarse grid, full resolution, check; or the nearest miss."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from design.analysis.obstacles import obstacles
from design.analysis.recheck import load_integrator
from design.analysis.rows import Row
from design.analysis.survey import best_apart
from design.analysis.synthesis import OBJECTIVE_UNITS, Answer
from design.analysis.verdict import judge
from design.model.laws import Gains
from design.solvers.outcome import Outcome, Status
from design.spec.setting import Setting
from problems.gains.check import checked
from problems.gains.exchange import NEAR, Local, exchange, lowest_below, union
from problems.gains.program import Point
from problems.gains.question import Goal, Grid, Instants, Question, in_unit
from problems.gains.starts import CANDIDATES, from_start, survey

Array = NDArray[np.float64]
Say = Callable[[str], None]

PATIENCE = 4
"""Where only one start reached the best value, more are tried, up to so many times as many."""
MISSES = 3
"""Nearest misses, from so many starts without a feasible point, after which the search ends."""


def solve(setting: Setting, *, starts: int | None = None, seconds: float = 600.0, say: Say = lambda _: None) -> Answer:
    """Synthesize gains for ``setting``; ``say`` is told of the progress. Raises ``BadInput`` if there are no bounds."""
    question = Question(setting)
    stand_in = obstacles(setting)
    if stand_in:
        return Answer(outcome=Outcome(status=Status.INFEASIBLE, detail=str(stand_in[0])))
    deadline = time.monotonic() + seconds
    threading.Thread(target=load_integrator, daemon=True).start()  # takes as long as a start, on the other core
    goal: Goal = setting.maximise
    coarse = question.grid(question.coarse_step)
    say(f"surveying {CANDIDATES} gains")
    points, merit = survey(coarse, goal)
    count = starts or setting.starts
    most = count if starts else PATIENCE * count
    chosen = best_apart(points, merit, most, question.lower, question.upper)
    merits = {tuple(K): m for K, m in zip(points, merit, strict=True)}
    optima: list[Local] = []
    misses: list[Local] = []
    instants = coarse.thinned()
    tried = 0
    while tried < min(count, len(chosen)) or (optima and tried < len(chosen) and _reached(optima) < 2):
        if time.monotonic() > deadline:
            return Answer(outcome=Outcome(status=Status.TIME_LIMIT, detail=f"{tried} starts were tried."), starts=tried)
        K = chosen[tried]
        tried += 1
        found, optimal = from_start(coarse, goal, K, merits[tuple(K)], instants, deadline)
        instants = union(instants, found.instants)
        if optimal:
            optima.append(found)
        elif found.converged:
            misses.append(found)
        best = max((f.point.v for f in optima), default=None)
        say(f"start {tried}: best {_shown(question, goal, best)}")
        if not optima and len(misses) == MISSES:
            break
    if not optima:
        return _nothing(question, coarse, chosen[:tried], instants, deadline, misses)
    return _finish(question, goal, optima, tried, deadline, say)


def _reached(optima: list[Local]) -> int:
    """How many starts came to the best value."""
    best = max(found.point.v for found in optima)
    return sum(found.point.v >= best - 1e-4 * (abs(best) + 1e-3) for found in optima)


def _shown(question: Question, goal: Goal, v: float | None) -> str:
    return "none yet" if v is None else f"{in_unit(question, goal, v):.6g} {OBJECTIVE_UNITS[goal]}"


def _finish(question: Question, goal: Goal, optima: list[Local], tried: int, deadline: float, say: Say) -> Answer:
    """Carry the best optima to full resolution, and check the winner by other means."""
    optima = sorted(optima, key=lambda found: -found.point.v)
    best = optima[0].point
    distinct = [optima[0]]
    for found in optima[1:]:
        if all(_apart(question, found.point, other.point) for other in distinct):
            distinct.append(found)
    fine = question.grid(question.setting.step)
    polished = []
    for found in distinct[:3]:
        if found.point.v < best.v - 0.02 * (abs(best.v) + 0.01):
            continue
        say("refining at full resolution")
        margins = fine.margins(found.point.gains, goal, found.point.v)
        seen = lowest_below(NEAR, margins, tuple(() for _ in margins)) if margins else fine.thinned()
        polished.append(exchange(fine, goal, found.point, seen, deadline, near=True))
    done = [found for found in polished if found.converged]
    if not done:
        status = Status.TIME_LIMIT if time.monotonic() > deadline else Status.STALLED
        return Answer(outcome=Outcome(status=status, detail=f"IPOPT: {polished[0].said}."), starts=tried)
    winner = max(done, key=lambda found: found.point.v)
    say("checking")
    return checked(question, goal, winner, tried, _reached(optima), len(distinct))


def _apart(question: Question, one: Point, other: Point) -> bool:
    return float(np.abs((np.array(one.gains) - np.array(other.gains)) / question.scale).max()) > 1e-3


def _nothing(
    question: Question, grid: Grid, starts: Array, instants: Instants, deadline: float, misses: list[Local]
) -> Answer:
    """No start led to a feasible point: say what the point that misses the requirements by least misses."""
    for K in starts if not misses else ():
        found = exchange(grid, "feasibility", Point(gains=Gains(*map(float, K)), v=-0.5), instants, deadline)
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
            parts.append(f"{row.id} in scenario {row.scenario!r}: {row.note}")
        else:
            parts.append(
                f"{row.id} in scenario {row.scenario!r} reaches {row.value:.6g} {row.unit} of {row.required:.6g}"
                f" (misses by {-row.margin:.4g})"
            )
    return "At the point that misses by least, " + "; ".join(parts) + "."
