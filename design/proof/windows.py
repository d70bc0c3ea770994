"""A tube's time in windows, each with a norm of its own in which the loop contracts there.

Law (20) gathers the faster, the less the foot bears, so that a norm that serves at the beginning of a slope need not
serve at its end. From one window to the next the radius grows by the factor c with |x|_after <= c |x|_before.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from design.proof.case import Case, NotProved
from design.proof.equations import Equations, Parts
from design.proof.jacobian import Ranges, ranges
from design.proof.norm import Norm, contracting, inverted, transfer
from design.proof.readout import Reach, gathering, stiffness
from design.proof.spans import Span
from design.proof.taylor import UP, Model

Array = NDArray[np.float64]

CHANGE = 0.05
"""By what part of itself the gathering may change in a window, beside what it does in one piece."""
MOST = 12
"""Windows, about."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Norms:
    """For each of n pieces how the errors in its blocks change, of which it has no more than m (``design.proof.norm``).

    ``S`` and its ``inverse`` (n, m, m); ``members`` (n, m, m): 1 where a coordinate (last) belongs to a block;
    ``rates`` (n, m) and ``couplings`` (n, m, m) [1/s]; ``carried`` (n, m, m): what is left of the errors of the piece
    before, on the way into the piece. ``before``: the norms by where they begin.
    """

    S: Array
    inverse: Array
    members: Array
    rates: Array
    couplings: Array
    carried: Array
    before: dict[int, Norm]

    def sizes(self, vectors: Array) -> Array:
        """Bound (n, m) of the blocks of S x for |x_i| <= ``vectors`` (n, m)."""
        moved = (np.abs(self.S) @ vectors[:, :, None])[:, :, 0]
        return np.asarray(UP * np.sqrt(UP * (self.members @ (moved**2)[:, :, None])[:, :, 0]))

    def felt(self, gradient: Array) -> Array:
        """Bound (n, m) of how fast what has this ``gradient`` (m,) changes with each block."""
        along = np.abs(gradient @ self.inverse) + 1e-13 * (np.abs(gradient) @ np.abs(self.inverse))
        return np.asarray(UP * np.sqrt(UP * (self.members @ (along**2)[:, :, None])[:, :, 0]))


def norms(
    equations: Equations, places: list[tuple[list[Model], Parts]], defects: Array, h: Array, reach: Reach,
    deadline: float, before: Norms | None,
) -> Norms:  # fmt: skip
    """Norms for the pieces of all ``places``, one after the other; raises ``NotProved``, ``OutOfTime``.

    ``defects`` (n, m) are those of the pieces of the first place, of lengths ``h`` (n,) [s]; a tube of this ``reach``
    is around them all. ``before``: those for a smaller reach.
    """
    case, n = equations.case, len(reach.theta)
    each = list(zip(places, reach.parted([len(x[0].c) for x, _ in places]), strict=True))
    G = _joined([(Span(*stiffness(parts, its.theta)),) for (_, parts), its in each])
    gathered = _joined([gathering(equations, x, parts, its) for (x, parts), its in each] if case.kind == "cop" else [])

    def one(begin: int, end: int) -> Norm:
        low, high = float(G[0, 0, begin:end].min()), float(G[0, 1, begin:end].max())
        over = ranges(case, (math.nextafter(low, -math.inf), math.nextafter(high, math.inf)))
        if len(gathered):
            ends = [(float(low.min()), float(high.max())) for low, high in gathered[:, :, begin:end]]
            over = Ranges(over.G, over.inertia, *ends)
        inside = slice(min(begin, len(defects) - 1), end)
        its = before.before.get(begin) if before is not None else None
        return contracting(case, over, defects[inside], h[inside], deadline, its)

    if not len(gathered) or not case.moving:
        try:
            return _filled([0, n], [one(0, n)])
        except NotProved:
            if not len(gathered):
                raise
    starts = [*_starts(case, gathered), n]
    return _filled(starts, [one(*pair) for pair in pairwise(starts)])


def _joined(spans: list[tuple[Span, ...]]) -> Array:
    """Ends of each of several numbers in all pieces, (j, 2, n), from those in the pieces of each place."""
    return np.stack([np.concatenate(some, axis=1) for some in zip(*spans, strict=True)]) if spans else np.zeros(0)


def _filled(starts: list[int], found: list[Norm]) -> Norms:
    """The norms of windows that begin at ``starts``, the last of which is the end."""
    lengths, m = np.diff(starts), len(found[0].S)

    def padded(blocks: Array) -> Array:
        return np.pad(blocks, [(0, m - size) for size in blocks.shape])

    carried = np.tile(np.eye(m), (starts[-1], 1, 1))
    for at, (before, after) in zip(starts[1:], pairwise(found), strict=False):
        carried[at] = padded(transfer(before, after))

    def all_of(parts: list[Array]) -> Array:
        return np.repeat(parts, lengths, axis=0)

    rates = [np.append(norm.rates, np.ones(m - len(norm.rates))) for norm in found]
    return Norms(
        S=all_of([norm.S for norm in found]), inverse=all_of([inverted(norm.S) for norm in found]),
        members=all_of([padded(np.vstack([norm.members, np.zeros((m - len(norm.blocks), m))])) for norm in found]),
        rates=all_of(rates), couplings=all_of([padded(norm.couplings) for norm in found]), carried=carried,
        before=dict(zip(starts[:-1], found, strict=True)),
    )  # fmt: skip


def _starts(case: Case, its: Array) -> list[int]:
    """Where windows begin, by the spans (3, 2, n) of gather, bend and drag."""
    gather = its[0].mean(axis=0)
    felt = np.array([1.0, case.gains.K_p, case.gains.K_d])[:, None]
    allowed = CHANGE * gather * felt + (its[:, 1] - its[:, 0])
    while True:
        found, low, high = [0], its[:, 0, 0], its[:, 1, 0]
        for k in range(its.shape[2]):
            low, high = np.minimum(low, its[:, 0, k]), np.maximum(high, its[:, 1, k])
            if (high - low > allowed[:, k]).any():
                found.append(k)
                low, high = its[:, 0, k], its[:, 1, k]
        if len(found) <= MOST:
            return found
        allowed = allowed + 0.5 * CHANGE * gather * felt
