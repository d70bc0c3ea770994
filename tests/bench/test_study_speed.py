"""How long a study takes, and what a second worker gives; skipped unless asked for."""

import multiprocessing
import os
import sys
import time
from pathlib import Path

import numpy as np

from design.spec.load import load, parse
from design.spec.setting import setting
from design.workers import processes
from problems.comparison.study import Case, study, tasks

TEXT = load("slope").text + "\n[noise]\nangle_deg = 0.01\nrate_deg_per_s = 0.05\nforce_n = 1.0\n"
LAWS = ("pd", "force", "cop", "mpc")


def _timed(jobs, trials, controllers):
    problem = setting(parse(TEXT, origin="noisy").spec)
    case = Case(text=TEXT, seed=0, gains=tuple((name, problem.gains) for name in ("pd", "force", "cop")))
    todo = [task for task in tasks(problem, controllers, trials) if task.trial is not None]
    began = time.perf_counter()
    rows = list(study(case, todo, lambda: processes(jobs), 2 * jobs))
    return time.perf_counter() - began, rows


def test_a_study_of_200_trials_of_4_laws_within_a_minute(benchmark, capsys):
    seconds, rows = benchmark.pedantic(lambda: _timed(2, 200, LAWS), rounds=1)
    with capsys.disabled():
        sys.stdout.write(f"\n200 trials x 4 controllers x 10 s on two workers: {seconds:.1f} s\n")
    assert len(rows) == 800
    assert all(row["status"] in ("kept", "lost") for row in rows)
    assert seconds < 60


def _sum(count):
    """Seconds that pure arithmetic takes."""
    began = time.perf_counter()
    total = 0
    for k in range(count):
        total += k * k
    return time.perf_counter() - began


def _arithmetic(pool):
    """How many times as fast two processes of pure arithmetic are as one, here and now."""
    alone = pool.submit(_sum, 3_000_000).result()
    both = max(future.result() for future in [pool.submit(_sum, 3_000_000) for _ in range(2)])
    return 2 * alone / both


class _InTurns:
    """A study on ``jobs`` workers that goes on for a number of rows and then stands still, as often as asked."""

    def __init__(self, jobs):
        problem = setting(parse(TEXT, origin="noisy").spec)
        case = Case(text=TEXT, seed=0, gains=tuple((name, problem.gains) for name in ("pd", "force", "cop")))
        todo = [task for task in tasks(problem, LAWS, 200) if task.trial is not None]
        self._window = 2 * jobs
        self._rows = study(case, todo, self._pool(jobs), self._window)

    def _pool(self, jobs):
        def pool():
            before = {child.pid for child in multiprocessing.active_children()}
            made = processes(jobs)
            self._workers = [child.pid for child in multiprocessing.active_children() if child.pid not in before]
            return made

        return pool

    def rate(self, count):
        """Rows a second over ``count`` rows, and the seconds a second that the workers compute."""
        for _ in range(self._window):  # those that were under way when it stood still
            next(self._rows)
        began, before = time.perf_counter(), self._computed()
        for _ in range(count):
            next(self._rows)
        seconds = time.perf_counter() - began
        return count / seconds, (self._computed() - before) / seconds

    def _computed(self):
        """Processor time of the workers [s]."""
        ticks = 0
        for pid in self._workers:
            fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
            ticks += int(fields[11]) + int(fields[12])
        return ticks / os.sysconf("SC_CLK_TCK")


def test_two_workers_are_nearly_twice_as_fast_as_one(benchmark, capsys):
    """The same study on one worker and on two, 88 rows of each in turn: a machine's speed may drift within seconds.

    What the second worker has begun when a turn ends is not counted; turns are long enough for that to be little.
    """

    def run():
        one, two = _InTurns(1), _InTurns(2)
        one.rate(8), two.rate(8)
        turns = []
        with processes(2) as pool:
            for _ in range(8):
                (alone, _), (both, busy) = one.rate(88), two.rate(88)
                turns.append((both / alone, busy, _arithmetic(pool)))
        return np.median(turns, axis=0)

    ratio, busy, possible = benchmark.pedantic(run, rounds=1)
    with capsys.disabled():
        sys.stdout.write(
            f"\ntwo workers are {ratio:.2f} times as fast as one, and compute for {busy:.2f} s a second;"
            f" arithmetic alone: {possible:.2f} times\n"
        )
    assert ratio >= 1.8
