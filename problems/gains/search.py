"""From a setting to an answer: survey, starts on the coarse grid, full resolution, check; or the nearest miss."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from design.analysis.obstacles import obstacles
from design.analysis.recheck import load_integrator
from design.analysis.rows import Row
from design.analysis.survey import best_apart, hills
from design.analysis.synthesis import Answer, Synthesis
from design.analysis.verdict import judge
from design.deadline import OutOfTime
from design.deadline import deadline as limited
from design.model.laws import Gains
from design.solvers.outcome import Outcome, Status
from design.spec.setting import Setting
from problems.gains.check import active_rows, checked
from problems.gains.direct import most_feasible
from problems.gains.exchange import NEAR, Local, lowest_below, union
from problems.gains.goal import Goal
from problems.gains.grid import Grid, Point
from problems.gains.incumbents import Incumbents
from problems.gains.modelled import wanted
from problems.gains.pieces import MODELLED
from problems.gains.question import Question
from problems.gains.sequential import optimise
from problems.gains.starts import CANDIDATES, MISSED, UNKNOWN, from_start, missing, survey
from problems.gains.working_box import WIDER

Array = NDArray[np.float64]
Say = Callable[[str], None]

PATIENCE = 4
"""Where only one start reached the best value, more are tried, up to so many times as many."""
HILLS, SLOW_HILLS = 4, 2
"""Hills of the survey beside the best points from which to start too; the fewer where rows take their time."""
GAINED = 1e-5
"""Part by which a better optimum is better."""
KINKED = tuple(dict.fromkeys((*MODELLED, "settling", "overshoot", "posture-error", "torque-rate")))
"""Rows with kinks or jumps."""
MISSES = 3
"""Nearest misses, from so many starts without a feasible point, after which other ways are tried."""
ON_SIDE = 1e-3
"""Part of an artificial side of the working box within which a design lies on it."""
WORTH = 1e-4
"""Part by which the objective must get better for the working box to be widened once more."""
GRACE = 0.3
"""Seconds that the best candidate may be checked for after the deadline."""
QUICK = 200_000
"""Samples of all runs up to which that takes less."""


def solve(
    setting: Setting,
    *,
    starts: int | None = None,
    seconds: float = 600.0,
    say: Say = lambda _: None,
    beside: Sequence[Setting] = (),
    near: Point | None = None,
    known: Sequence[Gains] = (),
) -> Answer:
    """Synthesize gains for ``setting``, and for the other bodies and worlds ``beside`` it with the same requirements.

    ``near``: a point that meets what is required, and close to which the optimum is thought to be; the survey and
    other starts are then left out. ``known``: gains that may meet it, to start from too; the spec's own always are.
    ``say`` is told of the progress. Raises ``BadInput`` if there are no bounds.
    """
    end = time.monotonic() + seconds
    question = Question(setting, beside)
    goal = question.goal(setting.objective)
    proofs = obstacles(setting)
    if proofs:
        return Answer(outcome=Outcome.infeasible(proofs[0]))
    threading.Thread(target=load_integrator, daemon=True).start()  # takes as long as a start, on the other core
    count = starts or setting.starts
    search = _Search(question, goal, end, say)
    answer = search.run(count, fixed=starts is not None, near=near, known=known)
    # widen the working box while the best design lies on a side of it that is not the spec's
    while search.crowded(answer):
        design = answer.outcome.found
        if design is None and search.question.reach > 1:
            break
        question = Question(setting, beside, WIDER * search.question.reach)
        say("widening the box of gains that is searched")
        search = _Search(question, goal, end, say)
        start = None if design is None else Point(gains=design.gains, v=goal.v(design.value))
        wider = search.run(count, fixed=starts is not None, near=start, known=known)
        if design is not None and _gain(goal, wider, answer) <= WORTH:
            answer = _bounded(answer, question)
            break
        answer = wider
    if question.reach > 1 and answer.outcome.found is not None and time.monotonic() < end:
        # one start went along while the box grew: the whole of the last box is searched too
        say("searching the widest box as a whole")
        whole = _Search(question, goal, end, say)
        met = [*known, answer.outcome.found.gains]
        again = whole.run(count, fixed=starts is not None, near=None, known=met)
        if _gain(goal, again, answer) > GAINED:
            answer = again
    return answer


def _gain(goal: Goal, one: Answer, other: Answer) -> float:
    """By what part the design of the first answer is better than that of the other."""
    if one.outcome.found is None or other.outcome.found is None:
        return -np.inf if one.outcome.found is None else np.inf
    v = goal.v(other.outcome.found.value)
    return float((goal.v(one.outcome.found.value) - v) / (abs(v) + 1e-9))


def _bounded(answer: Answer, question: Question) -> Answer:
    """The answer with a remark on the gains that were searched, which are fewer than the bounds allow."""
    K_p, K_d, K_f = question.upper
    said = (
        f"Gains up to kp = {K_p:.4g}, kd = {K_d:.4g}, kf = {K_f:.4g} were searched, which are less than the bounds:"
        f" {WIDER:g} times as many gave less than {100 * WORTH:g} % more."
    )
    return replace(answer, outcome=replace(answer.outcome, detail=said))


class _Search:
    """One working box: the incumbents, optima and nearest misses met so far."""

    def __init__(self, question: Question, goal: Goal, end: float, say: Say) -> None:
        self.question, self.goal, self.end, self.say = question, goal, end, say
        self.coarse = Grid(question, question.coarse_step, goal)
        self.fine = Grid(question, question.setting.step, goal)
        self.pool = Incumbents(question, goal)
        self.instants = self.coarse.thinned()
        self.optima: list[Local] = []
        self.misses: list[Local] = []
        self.partial: list[Point] = []
        self.surveyed: list[Point] = []
        self.tried, self.more = 0, 0
        self.hills = 0

    @property
    def _quick(self) -> bool:
        """Whether gains are judged in much less than a second."""
        step = self.question.setting.step
        runs = [case.scenario.duration / step for case in self.coarse.cases]
        return sum(runs) < QUICK

    @property
    def searches(self) -> int:
        """How many local searches there were: from starts, and from gains that were met in other ways."""
        return self.tried + self.more

    @property
    def late(self) -> bool:
        """Whether the deadline has passed."""
        return time.monotonic() > self.end

    def run(self, count: int, *, fixed: bool, near: Point | None, known: Sequence[Gains]) -> Answer:
        """Search, and say what came of it; when time is over, the best incumbent so far."""
        try:
            with limited(self.end):
                return self._run(count, fixed, near, known)
        except OutOfTime:
            return self._ended(Status.TIME_LIMIT, f"{self.tried} starts were tried.")

    def crowded(self, answer: Answer) -> bool:
        """Whether a wider working box may have a better answer: the best is on an artificial side, or there is none."""
        question = self.question
        artificial = question.upper < question.widest
        if not artificial[:2].any() or self.late or answer.outcome.proof is not None:
            return False
        design = answer.outcome.found
        if design is None:
            return True
        return bool((artificial & (np.array(design.gains) >= (1 - ON_SIDE) * question.upper))[:2].any())

    def _run(self, count: int, fixed: bool, near: Point | None, known: Sequence[Gains]) -> Answer:
        question, goal = self.question, self.goal
        if near is None:
            chosen, merits = self._chosen(count, fixed)
        else:
            chosen = np.clip(np.array([near.gains]), question.lower, question.upper)
            merits, count = {tuple(chosen[0]): max(near.v, UNKNOWN)}, 1
        while self.tried < min(count, len(chosen)) or (self.optima and self._goes_on(count, len(chosen))):
            if self.late:
                raise OutOfTime
            K = chosen[self.tried]
            self.tried += 1
            self._start(K, merits[tuple(K)], stay=near is not None)
            best = max((each.point.v for each in self.optima), default=None)
            self.say(f"start {self.tried}: best {_shown(goal, best)}")
            if not self.optima and len(self.misses) == MISSES:
                break
        if near is None and self.optima:
            self._without_kinks()
        if near is None:
            own = question.setting.gains
            self.pool.offer([*known, *([] if own is None or self.optima else [own])])
            self._from_incumbents()
        if not self.optima and near is None:
            self._other_ways(chosen)
        if self.optima:
            answer = self._finished()
            if answer is not None:
                return answer
        return self._nothing(chosen[: self.tried])

    def _goes_on(self, count: int, most: int) -> bool:
        """Whether to try another start: the best optimum was reached once, or a hill of the survey is left.

        Where all of the first ``count`` agree, one hill more is tried.
        """
        reached = _reached(self.optima)
        if self.tried == count:
            self.hills = min(self.hills, 1) if reached == count else self.hills
        return self.tried < most and (reached < 2 or self.tried < count + self.hills)

    def _chosen(self, count: int, fixed: bool) -> tuple[Array, dict[tuple[float, ...], float]]:
        """Where to start: the best points of the survey that lie apart, then its other hills; and the merits of all."""
        self.say(f"surveying {CANDIDATES} gains")
        question = self.question
        points, merit = survey(self.coarse)
        slow = bool(wanted(question, self.goal))
        most = count if fixed or slow else PATIENCE * count  # those take their time
        chosen = best_apart(points, merit, most, question.lower, question.upper)
        if not fixed:
            feasible = merit > MISSED
            tops = points[feasible][hills(points[feasible], merit[feasible], question.upper)]
            apart = [K for K in tops if not _among(K, chosen[:count])]
            more = np.array(apart[: SLOW_HILLS if slow else HILLS]).reshape(-1, 3)
            self.hills = len(more)
            rest = [K for K in chosen[count:] if not _among(K, more)]
            chosen = np.vstack([chosen[:count], more, np.array(rest).reshape(-1, 3)])
        best = [k for k in np.argsort(-merit, kind="stable")[:2] if merit[k] > MISSED]
        self.surveyed = [Point(gains=Gains(*map(float, points[k])), v=float(merit[k])) for k in best]
        return chosen, {tuple(K): m for K, m in zip(points, merit, strict=True)}

    def _without_kinks(self) -> None:
        """Solve again without the rows that have kinks or jump: the optimum may rest at one that does not bind.

        Where nothing is gained without them, they do not hold it. Otherwise a better point that keeps them all the same
        is an optimum, and from one that does not the whole is sought again.
        """
        question, setting = self.question, self.question.setting
        ids = [id for id in KINKED if question.level(id) is not None and id != self.goal.id]
        for dropped in [ids, *([id] for id in ids if len(ids) > 1)] if ids else []:
            best = max(self.optima, key=lambda each: each.point.v)
            self.say(f"without {', '.join(dropped)}")
            required = {id: wish for id, wish in setting.required.items() if id not in dropped}
            easier = self.coarse.asking(question.asking(replace(setting, required=required)))
            local = optimise(easier, best.point, easier.thinned(), self.end)  # its samples may be others
            gain = local.point.v - best.point.v if local.converged else 0.0
            if gain <= GAINED * (1 + abs(best.point.v)):
                if dropped is ids:
                    return
                continue
            margin = float(missing(self.coarse, np.array([local.point.gains]))[0])
            if margin >= -1e-6:
                self.more += 1
                self.optima.append(replace(local, solved=None))
            else:
                self._again(np.array(local.point.gains), MISSED + margin)

    def _again(self, K: Array, merit: float) -> None:
        """One local search more than there are starts."""
        self.more += 1
        self._start(K, merit)

    def _start(self, K: Array, merit: float, *, stay: bool = False) -> None:
        """Go from ``K`` to a local optimum, or to the nearest miss."""
        local, optimal = from_start(self.coarse, K, merit, self.instants, self.end, stay=stay)
        self.instants = union(self.instants, local.instants)
        if optimal:
            self.optima.append(local)
        else:
            self.partial.append(local.point)
            if local.converged:
                self.misses.append(local)

    def _from_incumbents(self) -> None:
        """Start from the best incumbent too, where no optimum is as good as it is."""
        for point in self.pool.points[:1]:
            best = max((each.point.v for each in self.optima), default=-np.inf)
            if point.v > best + 1e-6 * (1 + abs(best)):
                self.say("starting from a design that meets the specification")
                self._again(np.array(point.gains), point.v)

    def _other_ways(self, chosen: Array) -> None:
        """No start led to a feasible optimum: look for the largest smallest margin without derivatives, and go on."""
        seeds = [np.array(each.point.gains) for each in self.misses] + list(chosen)
        self.say("looking for the largest smallest margin of all requirements")
        K, margin = most_feasible(self.coarse, np.array(seeds))
        if margin > -1e-2:
            start = Point(gains=Gains(*map(float, K)), v=margin)
            local = optimise(self.coarse.feasibility, start, self.instants, self.end)
            self.misses.append(local if local.point.v > margin and local.converged else _local(K, margin, local))
            self._again(K, UNKNOWN if margin >= 0 else -100.0 + margin)
            self.pool.offer([Gains(*map(float, K))] if margin >= -1e-6 else [])
            self._from_incumbents()

    def _finished(self) -> Answer | None:
        """Carry the best optima to full resolution, and check the winner by other means; None if none gets there."""
        question, goal = self.question, self.goal
        optima = sorted(self.optima, key=lambda each: -each.point.v)
        best = optima[0].point
        distinct = [optima[0]]
        for local in optima[1:]:
            if all(_apart(question, local.point, other.point) for other in distinct):
                distinct.append(local)
        polished = []
        for local in distinct[:3]:
            if local.point.v < best.v - 0.02 * (abs(best.v) + 0.01):
                continue
            self.say("refining at full resolution")
            polished.append(refined(self.fine, local.point, self.end))
        done = [local for local in polished if local.converged]
        for point in self.pool.points[:1]:
            if point.v > max((local.point.v for local in done), default=-np.inf) + 1e-5 * (1 + abs(point.v)):
                self.say("refining a design that meets the specification")
                again = refined(self.fine, point, self.end)
                done += [again] if again.converged and again.point.v >= point.v - 1e-6 * (1 + abs(point.v)) else []
        if not done:
            self.pool.offer([local.point.gains for local in [*polished, *distinct[:3]]])
            return None
        winner = max(done, key=lambda local: local.point.v)
        self.say("checking")
        answer = checked(self.fine, winner, self.searches, _reached(self.optima), len(distinct))
        if answer.outcome.found is None:
            self.pool.offer([local.point.gains for local in [*done, *distinct[:3]]])
            return replace(answer, best=self._best())
        own = question.setting.gains
        if own is not None and answer.given is not None and goal.v(answer.given) > goal.v(answer.outcome.found.value):
            self.pool.offer([own])
        incumbent = self.pool.best
        if incumbent is not None and goal.v(incumbent.value) > goal.v(answer.outcome.found.value) + 1e-5 * (
            1 + abs(goal.v(incumbent.value))
        ):  # a design that was checked is better than this optimum: then it is not the best
            detail = "The optimum that the solver found is worse than a design that was checked."
            return self._ended(Status.STALLED, detail)
        return answer

    def _ended(self, status: Status, detail: str) -> Answer:
        """No optimum: with the best incumbent, if there is one."""
        if status is Status.TIME_LIMIT and self.pool.best is None and self._quick:
            optima = [each.point for each in sorted(self.optima, key=lambda each: -each.point.v)]
            candidates = [*optima[:1], *self.partial[-1:], *self.surveyed[:2]]
            try:
                for point in candidates:
                    with limited(self.end + GRACE):
                        self.pool.offer([point.gains])
                    if self.pool.best is not None:
                        break
            except OutOfTime:
                pass
        return Answer(outcome=Outcome(status=status, detail=detail), starts=self.tried, best=self._best())

    def _best(self) -> Synthesis | None:
        """The best incumbent, as a design whose optimality is not known."""
        incumbent = self.pool.best
        if incumbent is None:
            return None
        active = active_rows(self.question, self.goal, incumbent.gains, incumbent.verdict, incumbent.value)
        return Synthesis(
            gains=incumbent.gains, objective=self.goal.id, value=incumbent.value, active=active,
            verdict=incumbent.verdict, starts=self.tried, reached=0, optima=0,
        )  # fmt: skip

    def _nothing(self, starts: Array) -> Answer:
        """No optimum: the best incumbent; or else the point that misses the requirements by least, and its rows."""
        if self.pool.best is not None:
            return self._ended(Status.STALLED, "Feasible designs were found, none of them was confirmed as an optimum.")
        for K in starts if not self.misses else ():
            local = optimise(
                self.coarse.feasibility, Point(gains=Gains(*map(float, K)), v=-0.5), self.instants, self.end
            )
            if local.converged:
                self.misses.append(local)
                break
        if self.late:
            return self._ended(Status.TIME_LIMIT, f"{self.tried} starts were tried.")
        self.say("refining the nearest miss at full resolution")
        nearest = max(self.misses, key=lambda each: each.point.v).point if self.misses else self._least_bad(starts)
        polished = refined(self.fine.feasibility, nearest, self.end) if self.misses else None
        answers = []
        for point in [polished.point, nearest] if polished is not None and polished.converged else [nearest]:
            verdict = judge(self.question.setting, point.gains)
            missed = tuple(row for row in verdict.rows if row.counts and row.status != "met")
            if not missed:  # feasible after all
                self.pool.offer([point.gains])
                if self.pool.best is not None:
                    return self._restarted(point)
            answers.append(missed)
        missed = min(answers, key=self._size)
        detail = _miss(missed) if missed else "The nearest miss meets the specification for the nominal body alone."
        return Answer(outcome=Outcome(status=Status.NOT_FOUND, detail=detail), missed=missed, starts=len(starts))

    def _least_bad(self, starts: Array) -> Point:
        """The start with the largest smallest margin, where no optimiser came to rest."""
        margins = missing(self.coarse, starts)
        at = int(np.argmax(margins))
        return Point(gains=Gains(*map(float, starts[at])), v=float(margins[at]))

    def _size(self, missed: tuple[Row, ...]) -> float:
        """The largest miss, each row's in its scale."""
        scales = {limit.id: limit.scale for limit in self.question.limits}
        sizes = [
            np.inf if row.margin is None else -row.margin / (scales.get(row.id) or self.question.scale_or_one(row.id))
            for row in missed
        ]
        return max(sizes, default=0.0)

    def _restarted(self, point: Point) -> Answer:
        """The optimum from a feasible point at full resolution."""
        start = Point(gains=point.gains, v=self.goal.v(self.pool.best.value) if self.pool.best else 0.0)
        local = refined(self.fine, start, self.end)
        if local.converged:
            answer = checked(self.fine, local, self.tried, 1, 1)
            if answer.outcome.found is not None:
                return answer
        return self._ended(Status.STALLED, "A feasible design was found, it was not confirmed as an optimum.")


def _among(K: Array, others: Array) -> bool:
    """Whether ``K`` (3,) is one of the ``others`` (n, 3)."""
    return bool((others == K).all(axis=1).any())


def _local(K: Array, margin: float, like: Local) -> Local:
    return replace(like, point=Point(gains=Gains(*map(float, K)), v=margin), converged=True, said="direct search")


def _reached(optima: list[Local]) -> int:
    """How many starts came to the best value."""
    best = max(local.point.v for local in optima)
    return sum(local.point.v >= best - 1e-4 * (abs(best) + 1e-3) for local in optima)


def _shown(goal: Goal, v: float | None) -> str:
    return "none yet" if v is None else f"{goal.value(v):.6g} {goal.unit}"


def refined(fine: Grid, point: Point, deadline: float) -> Local:
    """The optimum near ``point`` at full resolution."""
    margins = fine.margins(point)
    seen = lowest_below(NEAR, margins, tuple(() for _ in margins)) if margins else fine.thinned()
    return optimise(fine, point, seen, deadline, near=True)


def _apart(question: Question, one: Point, other: Point) -> bool:
    return float(np.abs((np.array(one.gains) - np.array(other.gains)) / question.scale).max()) > 1e-3


def _miss(missed: tuple[Row, ...]) -> str:
    parts = []
    for row in missed:
        if row.value is None or row.margin is None:
            parts.append(f"{row.title}: {row.note}")
        else:
            unit = "" if row.unit == "1" else f" {row.unit}"
            parts.append(
                f"{row.title} reaches {row.value:.8g}{unit} of {row.required:.8g} (misses by {-row.margin:.4g})"
            )
    return "At the point that misses by least, " + "; ".join(parts) + "."
