"""Exponentials of small matrices, many at once."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def exponential(B: Array) -> Array:
    """The exponentials of many small matrices (n, k, k): Taylor's series of what is scaled to below 1/2, squared again.

    SciPy's goes through them one by one, and on a machine that is not idle BLAS's threads wait a millisecond in each.
    """
    norm = float(np.abs(B).sum(axis=-1).max(initial=0.0))
    if not math.isfinite(norm):
        return np.full_like(B, np.inf)
    halvings = max(0, math.ceil(math.log2(norm)) + 1) if norm > 0 else 0
    small = B / 2.0**halvings
    found = term = np.broadcast_to(np.eye(B.shape[-1]), B.shape).copy()
    for k in range(1, 15):
        term = np.einsum("nij,njk->nik", term, small) / k
        found = found + term
    for _ in range(halvings):
        found = np.einsum("nij,njk->nik", found, found)
    return np.asarray(found)
