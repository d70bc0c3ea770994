"""A quick look over the whole box of gains: where it is feasible, and where the objective is good.

Points of low discrepancy (``design.analysis.spread``), half of them spread linearly and half logarithmically, each
judged on a coarse time grid. From the best of them that lie apart an optimiser starts; nothing else is concluded from a
survey.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from design.analysis.spread import in_cube

Array = NDArray[np.float64]

NEIGHBOURS = 10
PART = 0.25
DECADES = 4.0
"""How far below the upper bound the logarithmic half reaches."""


def candidates(lower: Array, upper: Array, count: int) -> Array:
    """``count`` points (count, n) in the box ``lower``, ``upper`` (n,), the same ones at every call."""
    free = upper > lower
    cube = in_cube(count, lower.size)
    linear = lower + cube * (upper - lower)
    floor = np.maximum(lower, upper * 10.0**-DECADES)
    with np.errstate(all="ignore"):
        spread = np.where(free, floor * (upper / np.where(floor > 0, floor, 1.0)) ** cube, lower)
    return np.asarray(np.where(np.arange(count)[:, None] % 2 == 0, linear, spread))


def best_apart(points: Array, merit: Array, count: int, lower: Array, upper: Array, distance: float = 0.15) -> Array:
    """The ``count`` points of highest ``merit`` that lie ``distance`` apart in the unit box; fewer if need be."""
    span = np.where(upper > lower, upper - lower, 1.0)
    unit = (points - lower) / span
    chosen: list[int] = []
    for index in np.argsort(-merit, kind="stable"):
        if all(np.linalg.norm(unit[index] - unit[other]) >= distance for other in chosen):
            chosen.append(int(index))
        if len(chosen) == count:
            break
    return np.asarray(points[chosen])


def hills(points: Array, merit: Array, upper: Array) -> NDArray[np.intp]:
    """The numbers of the ``points`` that none of their ``NEIGHBOURS`` nearest ones beats, best first.

    Near is meant in the logarithms of the gains, from a thousandth of the bounds ``upper`` on. Only the best ``PART``
    of the points can be one: a linkage rule of where to start, on a reduced sample (Rinnooy Kan and Timmer,
    Mathematical Programming 39, 1987).
    """
    logarithms = np.log(np.maximum(points, 1e-3 * np.where(upper > 0, upper, 1.0)))
    apart = np.linalg.norm(logarithms[:, None] - logarithms[None], axis=2)
    near = np.argsort(apart, axis=1, kind="stable")[:, 1 : 1 + NEIGHBOURS]
    good = merit >= np.quantile(merit, 1.0 - PART) if len(merit) else merit > 0
    tops = np.flatnonzero((merit[:, None] >= merit[near]).all(axis=1) & good)
    return np.asarray(tops[np.argsort(-merit[tops], kind="stable")])


def in_batches(function: Callable[[Array], Array], points: Array, size: int = 64) -> Array:
    """``function`` maps (n, size) to (r, size); the same for all ``points`` (count, n), padded: (r, count)."""
    parts = []
    for start in range(0, len(points), size):
        part = points[start : start + size]
        padded = np.vstack([part, np.repeat(part[-1:], size - len(part), axis=0)])
        parts.append(function(padded.T)[:, : len(part)])
    return np.hstack(parts)
