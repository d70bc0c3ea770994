"""A long global search over the gains of a spec, on the independent simulator.

SciPy's differential evolution from several seeds, on runs with longer steps; then about each one's answer, with the
spec's step, evolution within shrinking boxes and Nelder and Mead's method. First the largest scaled violation is made
small, then the objective best. Gains with wide bounds are sought on a logarithmic scale.

    python -m tests.independent.evolution --seeds 0-49                    # writes evolution_table.json
    python -m tests.independent.evolution --spec my.toml --output -       # one spec of one's own
"""

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np
from scipy.optimize import differential_evolution, minimize

from . import linear
from .judge import judge
from .problem import read
from .random_specs import random_spec

TABLE = Path(__file__).with_name("evolution_table.json")
VIOLATED = 1e6
"""What is added to a violation, so that it is worse than any objective."""
COARSE = 4e-3
"""Step of the runs in the global search [s]; shorter for fast poles."""
WIDE = 30.0
"""Ratio of an upper bound to the body's own size of that gain from which it is sought on a logarithmic scale."""


class Search:
    """The scalar that is made small over the unit cube, and how often it was computed."""

    def __init__(self, problem):
        self.problem = problem
        self.points = linear.operating_points(problem, 9)
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
            step = max(step, min(COARSE, 0.6 / max(float(fastest), 1e-9)))
        return judge(problem, gains, self.points, step=step, exact=False, give_up=-0.3 * problem.weight)

    def merit(self, x, fine=False):
        """What is made small at ``x``: the objective, or from ``VIOLATED`` on the violation."""
        answer = self.judgement(x, fine)
        if answer.violation > (0.0 if fine else 1e-4):
            return VIOLATED + answer.violation
        value = answer.rows[self.problem.objective]
        return value if self.problem.minimise else -value


def search(problem, seeds=(1, 2, 3), population=14, generations=110):
    """The best gains, as a row of the table (without the spec)."""
    began, task = time.process_time(), Search(problem)
    size = int(task.free.sum())
    ends = []
    for seed in seeds:
        answer = differential_evolution(
            task.merit, [(0.0, 1.0)] * size, popsize=population, maxiter=generations, tol=1e-9, rng=seed, polish=False,
            mutation=(0.4, 0.9), recombination=0.8,
        )  # fmt: skip
        ends.append((float(answer.fun), seed, answer.x))
    ends.sort(key=lambda end: end[0])
    polished = []
    for _, seed, x in ends[:2]:
        polished.append(_polished(task, x, seed))
    _, x = min(polished, key=lambda end: end[0])
    gains = task.gains(x)
    final = judge(problem, gains)
    return {
        "objective": problem.objective,
        "value": final.rows.get(problem.objective),
        "gains": gains.tolist(),
        "feasible": bool(final.violation <= 1e-9),
        "violation": final.violation,
        "broken": final.broken,
        "by_seed": [end[0] for end in ends],
        "evaluations": task.calls,
        "cpu_s": round(time.process_time() - began, 2),
    }


def _polished(task, x, seed):
    """``x`` improved with the spec's step: boxes of shrinking size about it, then Nelder and Mead's method."""
    best = task.merit(x, fine=True)
    for radius, generations in ((3e-2, 14), (3e-3, 14), (3e-4, 10)):
        box = [(max(c - radius, 0.0), min(c + radius, 1.0)) for c in x]
        answer = differential_evolution(
            task.merit, box, args=(True,), popsize=8, maxiter=generations, rng=seed, polish=False, x0=x,
            mutation=(0.3, 0.8), recombination=0.9, tol=1e-9,
        )  # fmt: skip
        if answer.fun < best:
            best, x = float(answer.fun), answer.x
    for size in (1e-3, 1e-5):
        simplex = np.clip(np.vstack([x, x + size * np.eye(len(x)) * np.where(x > 0.5, -1.0, 1.0)[:, None]]), 0.0, 1.0)
        answer = minimize(
            task.merit, x, args=(True,), method="Nelder-Mead",
            options={"initial_simplex": simplex, "xatol": 1e-9, "fatol": 1e-9, "maxfev": 250},
        )  # fmt: skip
        if answer.fun < best:
            best, x = float(answer.fun), np.clip(answer.x, 0.0, 1.0)
    return best, x


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
