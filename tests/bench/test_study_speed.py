"""How long a study takes, and what a second worker gives; skipped unless asked for."""

import sys
import time

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


def test_two_workers_are_nearly_twice_as_fast_as_one(benchmark, capsys):
    def run():
        return [_timed(jobs, 60, ("force", "mpc"))[0] for jobs in (1, 2)]

    one, two = benchmark.pedantic(run, rounds=1)
    with capsys.disabled():
        sys.stdout.write(f"\none worker {one:.1f} s, two {two:.1f} s: ratio {one / two:.2f}\n")
    assert one / two >= 1.8
