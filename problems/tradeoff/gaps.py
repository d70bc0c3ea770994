"""Where a front is thin: its gaps, widest first, and what to ask of a design that is to halve one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError

Array = NDArray[np.float64]
Edge = frozenset[tuple[float, ...]]

EMPTY = 1e-9
ACROSS: Array = np.array([[1.0, -1.0, 0.0], [1.0, 1.0, -2.0]]).T / np.sqrt([2.0, 6.0])
"""Onto the plane across (1, 1, 1), as a front of three margins is seen."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Gap:
    """The edge between the points ``i`` and ``j``; to halve it, margin ``best`` is maximised above ``levels``.

    ``levels``: u by number of the other margins; ``length`` of what is not known to be empty, or near to a point.
    """

    i: int
    j: int
    best: int
    levels: dict[int, float]
    length: float


@dataclass
class Tried:
    """What is known of gaps: how often an edge failed, and with two margins where along one no design lies.

    ``empty``: (margin, from, to) in u: the best design above ``from`` is the one at ``to``.
    """

    failed: dict[Edge, int] = field(default_factory=dict)
    empty: list[tuple[int, float, float]] = field(default_factory=list)

    def fail(self, u: Array, gap: Gap) -> None:
        """The attempt at ``gap`` between points of ``u`` (n, k) gave nothing."""
        edge = _edge(u, gap.i, gap.j)
        self.failed[edge] = self.failed.get(edge, 0) + 1

    def close(self, u: Array, gap: Gap) -> None:
        """The attempt at ``gap`` gave a point; if that did not split the edge, nothing will."""
        self.failed[_edge(u, gap.i, gap.j)] = u.shape[1]

    def top(self, k: int, low: float, high: float) -> float:
        """Up to where between ``low`` and ``high`` a level of margin ``k`` may give a new design."""
        bounds = [at for which, at, to in self.empty if which == k and at > low and abs(to - high) < 1e-6]
        return min(bounds, default=high)


def gaps(u: Array, tried: Tried) -> list[Gap]:
    """The gaps between the points ``u`` (n, k), longest first; none that failed in every way."""
    found = []
    for i, j in _edges(u):
        wide = np.abs(u[i] - u[j])
        order = [int(k) for k in np.argsort(wide, kind="stable")]
        failed = tried.failed.get(_edge(u, i, j), 0)
        if failed >= len(order):
            continue
        best, open_, levels = order[failed], 1.0, {}
        for k in order:
            if k == best:
                continue
            low, high = sorted((float(u[i, k]), float(u[j, k])))
            top = tried.top(k, low, high) if u.shape[1] == 2 else high
            open_ = min(open_, (top - low) / max(high - low, EMPTY)) if high > low else open_
            levels[k] = 0.5 * (low + top)
        length = float(np.linalg.norm(wide)) * open_ if u.shape[1] == 2 else _bare(u, i, j)
        found.append(Gap(i=i, j=j, best=best, levels=levels, length=length))
    return sorted(found, key=lambda gap: -gap.length)


def _edge(u: Array, i: int, j: int) -> Edge:
    return frozenset(tuple(np.round(u[k], 9).tolist()) for k in (i, j))


def _edges(u: Array) -> Iterator[tuple[int, int]]:
    """Neighbours: along the line, or of a triangulation of the points as they are seen along (1, 1, 1)."""
    if u.shape[1] == 2:
        yield from pairwise(int(k) for k in np.argsort(u[:, 0], kind="stable"))
        return
    yield from triangulated(u) or combinations(range(len(u)), 2)


def _bare(u: Array, i: int, j: int) -> float:
    """The diameter of the disc about the middle of an edge that holds no point: its length if none is nearer."""
    flat = u @ ACROSS
    return 2 * float(np.linalg.norm(flat - 0.5 * (flat[i] + flat[j]), axis=1).min())


def triangulated(u: Array) -> Sequence[tuple[int, int]]:
    """The edges between points ``u`` (n, 3); none where they lie on a line."""
    try:
        corners = Delaunay(u @ ACROSS).simplices
    except (QhullError, ValueError):
        return []
    return sorted({(min(a, b), max(a, b)) for each in corners.tolist() for a, b in combinations(each, 2)})
