"""Points that fill a box evenly, the same ones at every call.

An additive recurrence by the generalised golden ratio (Roberts 2018): any number of points, none near another.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from design.model.uncertainty import Tolerances

Array = NDArray[np.float64]


def in_cube(count: int, dimensions: int) -> Array:
    """``count`` points (count, dimensions) in the unit cube."""
    golden = float(np.roots([1.0, *[0.0] * (dimensions - 1), -1.0, -1.0]).real.max())  # x^(n+1) = x + 1
    return np.asarray(np.mod(0.5 + np.outer(np.arange(1, count + 1), golden ** -np.arange(1.0, dimensions + 1)), 1.0))


@lru_cache(maxsize=16)
def in_box(tolerances: Tolerances, inside: int) -> Array:
    """The centre of the box, its corners, and ``inside`` points within, as shares (N, 7); what is known stays 0."""
    free = tolerances.moving
    corners, within = np.zeros((2 ** len(free), 7)), np.zeros((inside, 7))
    corners[:, free] = list(product((-1.0, 1.0), repeat=len(free)))
    if free:
        within[:, free] = 2 * in_cube(inside, len(free)) - 1
    return np.vstack([np.zeros((1, 7)), corners, within])
