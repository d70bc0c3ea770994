"""A search for feasible gains without derivatives: the smallest scaled margin of all requirements is made large.

Where rows have kinks or jump, as loop margins do, the program of ``problems.gains`` may rest in a corner that is no
optimum. Differential evolution (Storn and Price, Journal of Global Optimization 11, 1997) over the logarithms of the
gains asks only for values; a generation's runs are marched at once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from design import deadline
from problems.gains.grid import Grid
from problems.gains.starts import missing

Array = NDArray[np.float64]

POPULATION = 24
GENERATIONS = 40
DECADES = 5.0
"""How far below the upper bound the logarithms reach where the lower one is 0."""
ENOUGH = 1e-4
"""Margin from which gains are feasible beyond doubt."""
SPREAD = 0.15
"""Standard deviation of the first generation about the seeds, in e-folds."""


def most_feasible(grid: Grid, seeds: Array) -> tuple[Array, float]:
    """The gains (3,) with the largest smallest margin that is found from ``seeds`` (n, 3), and that margin, scaled."""
    from scipy.optimize import differential_evolution

    question = grid.question
    floor = np.maximum(question.lower, 10.0**-DECADES * np.maximum(question.upper, 1e-12))
    free = question.upper > floor
    upper = np.maximum(question.upper, floor)
    low, high = np.log(floor), np.log(upper)
    draw = np.random.default_rng(0)
    first = np.log(np.clip(seeds, floor, upper))
    more = first[draw.integers(len(first), size=max(POPULATION - len(first), 0))]
    first = np.vstack([first[:POPULATION], more + SPREAD * draw.standard_normal(more.shape)])
    best, most = seeds[0], -np.inf

    def merit(x: Array) -> Array:
        nonlocal best, most
        deadline.check()
        K = np.where(free[:, None], np.exp(np.clip(x, low[:, None], high[:, None])), question.upper[:, None]).T
        margins = missing(grid, K)
        if margins.max() > most:
            best, most = K[int(np.argmax(margins))], float(margins.max())
        return -margins

    differential_evolution(
        merit, list(zip(low, high + 1e-12, strict=True)), init=np.clip(first, low, high), maxiter=GENERATIONS, rng=1,
        polish=False, vectorized=True, updating="deferred", callback=lambda *_, **__: most >= ENOUGH, tol=1e-7,
        mutation=(0.4, 0.9),
    )  # fmt: skip
    return best, most
