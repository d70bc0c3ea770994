"""A long global search over the gains of a spec, on the independent simulator.

SciPy's differential evolution from several seeds, on runs with longer steps; the best population goes on with nearly
the spec's step; then sequential linear programming and Nelder and Mead's method. First the largest scaled violation is
made small, then the objective best. Gains with wide bounds are sought on a logarithmic scale.

    python -m tests.independent.evolution --seeds 0-49                    # writes evolution_table.json
    python -m tests.independent.evolution --spec my.toml --output -       # one spec of one's own
"""

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np
from scipy.optimize import differential_evolution, linprog, minimize

from . import linear
from .judge import judge, usual_sizes
from .problem import AT_MOST, read
from .random_specs import random_spec

TABLE = Path(__file__).with_name("evolution_table.json")
MET = 2e-6
"""The largest scaled violation of what counts as met in the search; a threefold pole has no more digits."""
TRUSTED = 5e-5
"""The same for the table, at the spec's step and more operating points: a little more is missed there."""
VIOLATED = 1e6
"""What is added to a violation, so that it is worse than any objective."""
COARSE = 8e-3
"""Step of the runs in the global search [s]; shorter for fast poles."""
WIDE = 30.0
"""Ratio of an upper bound to the body's own size of that gain from which it is sought on a logarithmic scale."""


class Search:
    """The scalar that is made small over the unit cube, and how often it was computed."""

    def __init__(self, problem):
        self.problem = problem
        self.points, self.many = linear.operating_points(problem, 7), linear.operating_points(problem, 33)
        self.calls = 0
        M, L, I, g = *problem.body[:3], problem.body[7]
        Omega = np.sqrt(M * g * L / I)
        sizes = np.array([M * g * L, I * Omega, problem.ell * Omega])
        low, high = problem.bounds.T
        self.low, self.high = low, high
        self.free = high > low
        self.logarithmic = self.free & (high > WIDE * sizes)
        self.floor = np.maximum(low, 1e-3 * sizes)

    def gains(self, x):
        """Gains (3,) of a point of the unit cube (as many as are free)."""
        K = self.low.copy()
        x = np.clip(x, 0.0, 1.0)
        for k, share in zip(np.flatnonzero(self.free), x, strict=True):
            if self.logarithmic[k]:
                K[k] = min(self.floor[k] * (self.high[k] / self.floor[k]) ** share, self.high[k])
            else:
                K[k] = self.low[k] + share * (self.high[k] - self.low[k])
        return K

    def judgement(self, x, fine):
        """The rows at ``x``; ``fine``: with nearly the spec's step."""
        self.calls += 1
        gains, problem = self.gains(x), self.problem
        fastest = np.abs(linear.poles(problem, gains, self.points[:1])).max()
        longest = 2.0 * problem.step if fine else COARSE  # between samples a minimum is missed by its second power
        if fine and "settling" in {*problem.required, problem.objective}:  # a multiple of the step
            longest = problem.step
        step = max(problem.step, min(longest, 0.5 / max(float(fastest), 1e-9)))
        return judge(
            problem, gains, self.many if fine else self.points, step=step, exact=False, give_up=-0.1 * problem.weight
        )

    def merit(self, x, fine=False):
        """What is made small at ``x``: the objective, or from ``VIOLATED`` on the violation."""
        answer = self.judgement(x, fine)
        if answer.violation > (MET if fine else 5e-4):
            return VIOLATED + answer.violation
        value = answer.rows[self.problem.objective]
        return value if self.problem.minimise else -value


def search(problem, seeds=(1, 2, 3), population=14, generations=50):
    """The best gains, as a row of the table (without the spec)."""
    began, task = time.process_time(), Search(problem)
    ends = [_evolved(task, seed, "latinhypercube", population, generations) for seed in seeds]
    best = min(ends, key=lambda end: end.fun)
    x = _polished(task, _evolved(task, seeds[0], best.population, population, generations, fine=True).x)
    gains = task.gains(x)
    final = judge(problem, gains)
    return {
        "objective": problem.objective,
        "value": final.rows.get(problem.objective),
        "gains": gains.tolist(),
        "feasible": bool(final.violation <= TRUSTED),
        "violation": final.violation,
        "broken": final.broken,
        "by_seed": [float(end.fun) for end in ends],
        "evaluations": task.calls,
        "cpu_s": round(time.process_time() - began, 2),
    }


def _evolved(task, seed, init, population, generations, fine=False):
    return differential_evolution(
        task.merit, [(0.0, 1.0)] * int(task.free.sum()), args=(fine,), init=init, popsize=population,
        maxiter=generations, tol=1e-7, rng=seed, polish=False, mutation=(0.4, 0.9), recombination=0.8,
    )  # fmt: skip


def _polished(task, x):
    """``x`` improved by linear programs, and by Nelder and Mead's method."""
    best = task.merit(x, fine=True)
    if task.problem.objective != "decay-rate":  # which is best where poles coincide, in a cusp
        trial = _linear_programs(task, x, 1e-3)
        if (merit := task.merit(trial, fine=True)) < best:
            best, x = merit, trial
    simplex = np.clip(np.vstack([x, x + 1e-4 * np.eye(len(x)) * np.where(x > 0.5, -1.0, 1.0)[:, None]]), 0.0, 1.0)
    answer = minimize(
        task.merit, x, args=(True,), method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": 1e-9, "fatol": 1e-9, "maxfev": 150},
    )  # fmt: skip
    return np.clip(answer.x, 0.0, 1.0) if answer.fun < best else x


def _linear_programs(task, x, radius, rounds=30):
    """``x`` improved by steps that solve the problem linearised about it, within ``radius``, shorter where one fails.

    Each row of each scenario is a branch of its own, so that a minimum over several is no obstacle, and a required
    decay rate sigma is kept by Hurwitz's criterion for the polynomial in lambda + sigma, so that multiple poles are
    none. maximise t - 1e3 e over (dx, t, e): every branch of the objective at least t, every other short by at most
    e >= 0.
    """
    here = _branches(task, x)
    for _ in range(rounds):
        steps = [1e-6 * np.eye(len(x))[k] * (-1.0 if x[k] > 0.5 else 1.0) for k in range(len(x))]
        nearby = [_branches(task, x + step) for step in steps]
        if here is None or radius < 1e-9 or any(each is None or len(each[0]) != len(here[0]) for each in nearby):
            break
        slopes = [
            np.column_stack([(near[j] - here[j]) / step.sum() for near, step in zip(nearby, steps, strict=True)])
            for j in (0, 1)
        ]
        left = np.vstack(
            [
                np.column_stack([-slopes[0], np.ones(len(here[0])), np.zeros(len(here[0]))]),
                np.column_stack([slopes[1], np.zeros(len(here[1])), -np.ones(len(here[1]))]),
            ]
        )
        program = linprog(
            [*[0.0] * len(x), -1.0, 1e3], A_ub=left, b_ub=np.concatenate([here[0], -here[1]]),
            bounds=[*[(max(-radius, -c), min(radius, 1.0 - c)) for c in x], (None, None), (0.0, None)],
        )  # fmt: skip
        if program.status != 0:
            break
        trial = np.clip(x + program.x[: len(x)], 0.0, 1.0)
        after = _branches(task, trial)
        if after is not None and _penalised(after) > _penalised(here):
            x, here, radius = trial, after, radius * 1.5
        else:
            radius *= 0.4
    return x


def _penalised(branches):
    return branches[0].min() - 1e3 * max(branches[1].max(initial=0.0), 0.0)


def _branches(task, x):
    """What is to be large, and what is to be at most 0, at ``x``, without units; None where there are no runs."""
    problem, answer = task.problem, task.judgement(x, fine=True)
    if not answer.branches:
        return None
    usual = usual_sizes(problem)
    sigma = problem.required["decay-rate"] * (1.0 + 3e-6)
    large, small = [], []
    for row, value in answer.branches:
        sign = -1.0 if row in AT_MOST else 1.0
        unit = problem.required.get(row) or usual.get(row, 1.0)
        if row == problem.objective:
            large.append(sign * value / unit)
        if row in problem.required and row != "decay-rate" and np.isfinite(value):
            small.append(sign * (problem.required[row] - value) / unit)
    hurwitz = linear.hurwitz_branches(problem, task.gains(x), task.many, sigma, usual["decay-rate"])
    return np.array(large), np.concatenate([small, -hurwitz])


def seeds_of(text):
    """The seeds that ``a-b`` or ``a,b,c`` names."""
    if "-" in text:
        first, last = map(int, text.split("-"))
        return list(range(first, last + 1))
    return [int(part) for part in text.split(",")]


def main():
    """Search, and keep the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=seeds_of, default=[], help="of random specs: a-b or a,b,c")
    parser.add_argument("--spec", type=Path, nargs="*", default=[], help="spec files")
    parser.add_argument("--output", default=str(TABLE), help="JSON file to add to, or - for standard output")
    options = parser.parse_args()
    texts = {f"seed {seed}": random_spec(seed) for seed in options.seeds}
    texts |= {path.stem: path.read_text() for path in options.spec}
    kept = Path(options.output)
    rows = json.loads(kept.read_text()) if options.output != "-" and kept.exists() else []
    for name, text in texts.items():
        row = {"name": name, **search(read(text)), "spec": text}
        rows = [other for other in rows if other["name"] != name] + [row]
        if options.output != "-":
            kept.write_text(json.dumps(rows, indent=1) + "\n")
        sys.stdout.write(json.dumps({key: value for key, value in row.items() if key != "spec"}) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
