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


def _turns(count):
    """Seconds that pure arithmetic takes."""
    began = time.perf_counter()
    total = 0
    for k in range(count):
        total += k * k
    return time.perf_counter() - began


def _machine():
    """How many times as fast two processes of pure arithmetic are as one, here and now."""
    with processes(2) as pool:
        list(pool.map(_turns, [1000, 1000]))
        alone = pool.submit(_turns, 6_000_000).result()
        both = max(future.result() for future in [pool.submit(_turns, 6_000_000) for _ in range(2)])
    return 2 * alone / both


def test_two_workers_are_nearly_twice_as_fast_as_one(benchmark, capsys):
    """Medians of pairs, from the first row on; beside them what the machine gives, and how busy the workers are."""

    def run():
        rounds = []
        for _ in range(11):
            possible, (one, _), (two, busy) = _machine(), _rate(1), _rate(2)
            rounds.append((two / one, min(possible, 2.0), busy))
        return np.median(rounds, axis=0)

    ratio, possible, busy = benchmark.pedantic(run, rounds=1)
    with capsys.disabled():
        sys.stdout.write(
            f"\ntwo workers are {ratio:.2f} times as fast as one; arithmetic alone: {possible:.2f} times;"
            f" they compute for {busy:.2f} s a second\n"
        )
    assert busy >= 1.9  # what the study itself can see to; the rest is what two processes take from each other
    assert ratio > 1.0


def _rate(jobs):
    """Rows a second from the first on, and the seconds a second that the workers compute."""
    problem = setting(parse(TEXT, origin="noisy").spec)
    case = Case(text=TEXT, seed=0, gains=(("force", problem.gains),))
    todo = [task for task in tasks(problem, ("force", "mpc"), 30) if task.trial is not None]
    marks = [(time.perf_counter(), _computed()) for _ in study(case, todo, lambda: processes(jobs), 2 * jobs)]
    (began, before), (ended, after) = marks[0], marks[-2]  # at the last row a worker may be gone already
    return (len(marks) - 2) / (ended - began), (after - before) / (ended - began)


def _computed():
    """Processor time of this process's children [s]."""
    ticks = 0
    for child in multiprocessing.active_children():
        fields = Path(f"/proc/{child.pid}/stat").read_text().rpartition(")")[2].split()
        ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")
