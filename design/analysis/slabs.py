"""Long runs in slabs of a stated size: no function is built for all samples, and the deadline is seen between slabs.

CasADi builds a march for a number of steps; for millions of them that takes longer than the run, and gigabytes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design import deadline
from design.model.environment import Steps

Array = NDArray[np.float64]

SLAB = 20_000
"""Samples of a slab: some 30 ms of work."""


def marched(step: ca.Function, start: Array, steps: Steps, p: Array) -> Array:
    """The states (m, N+1) of ``step``: (z (m), u (7), p) -> z from the state ``start`` (m,) on.

    Raises ``OutOfTime`` between two slabs if the deadline has passed.
    """
    march = _march(step)
    inputs = np.zeros((7, SLAB))
    z = np.empty((len(start), len(steps.t)))
    z[:, 0] = start
    for first, last in _slabs(len(steps.h)):
        n = last - first
        inputs[0], inputs[0, :n] = 0.0, steps.h[first:last]  # steps of no length fill the last slab
        inputs[1:3, :n], inputs[3:5, :n], inputs[5:7, :n] = (
            part[:, first:last] for part in (steps.start, steps.middle, steps.end)
        )
        z[:, first + 1 : last + 1] = march(z[:, first], inputs, p).full()[:, :n]
    return z


def mapped(function: ca.Function, arrays: Sequence[Array]) -> Array:
    """``function`` of the columns of each of the ``arrays`` (k, n): (r, n). Raises ``OutOfTime`` likewise."""
    n = arrays[0].shape[1]
    many = _map(function, min(n, SLAB))
    parts = []
    for first, last in _slabs(n):
        part = [array[:, first:last] for array in arrays]
        if last - first < min(n, SLAB):
            part = [np.pad(each, ((0, 0), (0, SLAB - each.shape[1])), mode="edge") for each in part]
        parts.append(many(*part).full()[:, : last - first])
    return np.hstack(parts)


def _slabs(count: int) -> Iterator[tuple[int, int]]:
    for first in range(0, count, SLAB):
        deadline.check()
        yield first, min(first + SLAB, count)


@lru_cache(maxsize=16)
def _march(step: ca.Function) -> ca.Function:
    return step.mapaccum("march", SLAB, {"base": 4})


@lru_cache(maxsize=64)
def _map(function: ca.Function, count: int) -> ca.Function:
    return function.map(count)
