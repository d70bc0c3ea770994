"""A long global search over the gains of a spec, on the independent simulator.

SciPy's differential evolution from several seeds, on runs with longer steps; then about the best answer, with the
spec's step, evolution within a small box, sequential linear programming and Nelder and Mead's method. First the largest
scaled violation is made small, then the objective best. Gains with wide bounds are sought on a logarithmic scale.

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
MET = 1e-9
"""The largest scaled violation of what counts as met in the search."""
TRUSTED = 1e-5
"""The same for the table: between the operating points looked at, a decay rate is a little less."""
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
        """The rows at ``x``; ``fine``: with the spec's step."""
        self.calls += 1
        gains, problem = self.gains(x), self.problem
        step = problem.step
        if not fine:
            fastest = np.abs(linear.poles(problem, gains, self.points[:1])).max()
            step = max(step, min(COARSE, 0.5 / max(float(fastest), 1e-9)))
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

    def penalised(self, x):
        """The objective at ``x`` and a thousand times its size for a violation of 1."""
        answer = self.judgement(x, fine=True)
        value = answer.rows.get(self.problem.objective)
        if value is None or not np.isfinite(value):
            return np.inf
        value = value if self.problem.minimise else -value
        return value + 1e3 * (abs(value) + 1e-3) * max(answer.violation, 0.0)


def search(problem, seeds=(1, 2, 3), population=14, generations=110):
    """The best gains, as a row of the table (without the spec)."""
    began, task = time.process_time(), Search(problem)
    size = int(task.free.sum())
    ends = []
    for seed in seeds:
        answer = differential_evolution(
            task.merit, [(0.0, 1.0)] * size, popsize=population, maxiter=generations, tol=1e-5, rng=seed, polish=False,
            mutation=(0.4, 0.9), recombination=0.8,
        )  # fmt: skip
        ends.append((float(answer.fun), seed, answer.x))
    ends.sort(key=lambda end: end[0])
    close = [end for end in ends[:2] if end[0] - ends[0][0] < 0.01 * abs(ends[0][0])]
    apart = [end for end in close[1:] if np.abs(end[2] - ends[0][2]).max() > 1e-2]  # another optimum as good
    polished = [_polished(task, x, seed) for _, seed, x in [ends[0], *apart]]
    _, x = min(polished, key=lambda end: end[0])
    gains = task.gains(x)
    final = judge(problem, gains)
    return {
        "objective": problem.objective,
        "value": final.rows.get(problem.objective),
        "gains": gains.tolist(),
        "feasible": bool(final.violation <= TRUSTED),
        "violation": final.violation,
        "broken": final.broken,
        "by_seed": [end[0] for end in ends],
        "evaluations": task.calls,
        "cpu_s": round(time.process_time() - began, 2),
    }


def _polished(task, x, seed):
    """``x`` improved with the spec's step: evolution in a small box, linear programs, Nelder and Mead's method."""
    best, trial = task.merit(x, fine=True), x
    for method, radius in (("box", 2e-2), ("programs", 1e-2), ("box", 1e-3)):
        if method == "box":
            box = [(max(c - radius, 0.0), min(c + radius, 1.0)) for c in x]
            trial = differential_evolution(
                task.merit, box, args=(True,), popsize=8, maxiter=10, rng=seed, polish=False, x0=x,
                mutation=(0.3, 0.8), recombination=0.9, tol=1e-9,
            ).x  # fmt: skip
        else:
            trial = _linear_programs(task, x, radius)
        if (merit := task.merit(trial, fine=True)) < best:
            best, x = merit, trial
    simplex = np.clip(np.vstack([x, x + 1e-4 * np.eye(len(x)) * np.where(x > 0.5, -1.0, 1.0)[:, None]]), 0.0, 1.0)
    answer = minimize(
        task.merit, x, args=(True,), method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": 1e-9, "fatol": 1e-9, "maxfev": 150},
    )  # fmt: skip
    if answer.fun < best:
        best, x = float(answer.fun), np.clip(answer.x, 0.0, 1.0)
    return best, x


def _linear_programs(task, x, radius, rounds=30):
    """``x`` improved by steps that solve the problem linearised about it, within ``radius``; halved where one fails.

    Each row of each scenario is a branch of its own, so that a minimum over several is no obstacle. maximise t - 1e3 e
    over (dx, t, e): every branch of the objective at least t, every required one short by at most e >= 0.
    """
    problem, size = task.problem, len(x)
    worse = {row: 1.0 if row in AT_MOST else -1.0 for row in {*problem.required, problem.objective}}
    usual, best = usual_sizes(problem), task.penalised(x)
    for _ in range(rounds):
        here = task.judgement(x, fine=True).branches
        nearby = [task.judgement(x + _difference(x, k), fine=True).branches for k in range(size)]
        if radius < 1e-8 or not here or any(len(each) != len(here) for each in nearby):
            break
        left, right = [], []
        for j, (row, value) in enumerate(here):
            if row not in worse or not np.isfinite(value):
                continue
            slope = [(nearby[k][j][1] - value) / _difference(x, k)[k] for k in range(size)]
            scale = abs(_scale(problem, usual, row, value))
            slope, value = worse[row] * np.array(slope) / scale, worse[row] * value / scale
            if row == problem.objective:
                left.append([*slope, 1.0, 0.0])
                right.append(-value)
            if row in problem.required:
                left.append([*slope, 0.0, -1.0])
                right.append(worse[row] * problem.required[row] / scale - value)
        if not np.isfinite(left).all():
            break
        ends = [(max(-radius, -c), min(radius, 1.0 - c)) for c in x]
        answer = linprog([*[0.0] * size, -1.0, 1e3], A_ub=left, b_ub=right, bounds=[*ends, (None, None), (0.0, None)])
        trial = np.clip(x + answer.x[:size], 0.0, 1.0) if answer.status == 0 else x
        merit = task.penalised(trial)
        if merit < best:
            best, x, radius = merit, trial, radius * 1.5
        else:
            radius *= 0.4
    return x


def _scale(problem, usual, row, value):
    """By what a branch of ``row`` is divided in the linear program."""
    return problem.required.get(row) or usual.get(row) or value or 1.0


def _difference(x, k, size=1e-6):
    """A small step of coordinate ``k``, into the unit cube."""
    step = np.zeros(len(x))
    step[k] = -size if x[k] > 0.5 else size
    return step


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
