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


def _turns(count):
    """Seconds that pure arithmetic takes."""
    began = time.perf_counter()
    total = 0
    for k in range(count):
        total += k * k
    return time.perf_counter() - began


def test_two_workers_are_nearly_twice_as_fast_as_one(benchmark, capsys):
    """From the first row on; beside it what the machine gives two processes of arithmetic."""

    def machine():
        with processes(2) as pool:
            alone = pool.submit(_turns, 15_000_000).result()
            both = max(future.result() for future in [pool.submit(_turns, 15_000_000) for _ in range(2)])
        return 2 * alone / both

    def run():
        before = machine()
        rates = [_rate(jobs) for jobs in (1, 2, 2, 1)]
        return (rates[1] + rates[2]) / (rates[0] + rates[3]), 0.5 * (before + machine())

    ratio, possible = benchmark.pedantic(run, rounds=1)
    with capsys.disabled():
        sys.stdout.write(
            f"\ntwo workers are {ratio:.2f} times as fast as one; arithmetic alone: {possible:.2f} times\n"
        )
    assert ratio >= 0.9 * min(possible, 2.0)


def _rate(jobs):
    """Rows a second, from the first on."""
    problem = setting(parse(TEXT, origin="noisy").spec)
    case = Case(text=TEXT, seed=0, gains=(("force", problem.gains),))
    todo = [task for task in tasks(problem, ("force", "mpc"), 60) if task.trial is not None]
    times = [time.perf_counter() for _ in study(case, todo, lambda: processes(jobs), 2 * jobs)]
    return (len(times) - 1) / (times[-1] - times[0])
