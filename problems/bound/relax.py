"""How large can the smallest of several quadratics be over a box? An upper bound, for many boxes at once.

Row i of a box is at most f_i + g_i d + d' H_i d / 2 at every d of [-1, 1]^3. If for some weights w >= 0 the sum
of w_i times row i is negative over the whole box, then no point of it keeps all rows >= 0 (Lagrange, weak duality).
Any weights give a valid bound; good ones are found by mixing the worst row with one other after another, each time in
the best of the parts at which a component of the mixed gradient vanishes, where the bound has its kinks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MIXINGS = 6
PAIRS = ((0, 1), (0, 2), (1, 2))


@dataclass(frozen=True, eq=False)
class Quadratics:
    """Rows (b, m) of b boxes: ``f`` (b, m), ``g`` (b, m, 3), and ``H`` (b, m, 6): 11, 22, 33, 12, 13, 23."""

    f: Array
    g: Array
    H: Array

    def beside(self, other: Quadratics) -> Quadratics:
        """These rows and those of ``other``."""
        parts = ((self.f, other.f), (self.g, other.g), (self.H, other.H))
        return Quadratics(*(np.concatenate(each, axis=1) for each in parts))

    def joined(self, other: Quadratics) -> Quadratics:
        """These boxes' rows, and after them those of other boxes."""
        parts = ((self.f, other.f), (self.g, other.g), (self.H, other.H))
        return Quadratics(*(np.concatenate(each, axis=0) for each in parts))

    def lowered(self, by: Array) -> Quadratics:
        """The same rows less ``by`` (b, m)."""
        return Quadratics(self.f - by, self.g, self.H)

    def at(self, which: NDArray[np.intp] | NDArray[np.bool_]) -> Quadratics:
        """The rows of those boxes."""
        return Quadratics(self.f[which], self.g[which], self.H[which])

    def onto(self, centre: Array, radius: Array) -> Quadratics:
        """The same rows over a part of each box: d = ``centre`` + ``radius`` d', both (b, 3)."""
        c, r = centre[:, None, :], radius[:, None, :]
        bent = self.H[..., :3] * c
        for at, (j, k) in enumerate(PAIRS):
            bent[..., j] += self.H[..., 3 + at] * centre[:, None, k]
            bent[..., k] += self.H[..., 3 + at] * centre[:, None, j]
        square = np.concatenate([radius**2, np.stack([radius[:, j] * radius[:, k] for j, k in PAIRS], axis=1)], axis=1)
        f = self.f + ((self.g + 0.5 * bent) * c).sum(axis=2)
        return Quadratics(f, (self.g + bent) * r, self.H * square[:, None, :])


def greatest(f: Array, g: Array, H: Array) -> Array:
    """At least the maximum over the box: exact but for the products d_j d_k, each taken at its worst."""
    h = H[..., :3]
    size = np.abs(g)
    inside = (h < 0) & (size < -h)
    edge = size + 0.5 * h
    peak = np.where(inside, g**2 / np.where(inside, -2.0 * h, 1.0), edge)
    return np.asarray(f + peak.sum(axis=-1) + np.abs(H[..., 3:]).sum(axis=-1))


def smallest_row(rows: Quadratics) -> tuple[Array, Array]:
    """An upper bound (b,) of the greatest smallest row over each box, where negative; and the slopes (b, 3) that held.

    A mixture's bound, divided by nothing: only its sign speaks of all rows together.
    """
    values = greatest(rows.f, rows.g, rows.H)
    b = np.arange(len(values))
    worst = np.argmin(values, axis=1)
    f, g, H, value = rows.f[b, worst], rows.g[b, worst], rows.H[b, worst], values[b, worst]
    for _ in range(MIXINGS):
        open_ = np.flatnonzero(value >= 0)
        if not len(open_):
            break
        before = value[open_]
        mixed = _mixed(f[open_], g[open_], H[open_], rows.at(open_))
        f[open_], g[open_], H[open_], value[open_] = mixed
        if not (value[open_] < before - 1e-9).any():
            break
    return value, np.abs(g) + 0.5 * np.abs(H[:, :3]) + 0.5 * _touching(H)


def _touching(H: Array) -> Array:
    """|H_jk| of every pair, counted at both its components: (b, 3)."""
    found = np.zeros((len(H), 3))
    for at, (j, k) in enumerate(PAIRS):
        found[:, j] += np.abs(H[:, 3 + at])
        found[:, k] += np.abs(H[:, 3 + at])
    return found


def _mixed(f: Array, g: Array, H: Array, rows: Quadratics) -> tuple[Array, Array, Array, Array]:
    """The best mixture of the row (f, g, H) of each box with one of ``rows``."""
    with np.errstate(divide="ignore", invalid="ignore"):
        parts = g[:, None, :] / (g[:, None, :] - rows.g)  # where a component of the gradient vanishes
    parts = np.where((parts > 0) & (parts < 1), parts, 0.0)
    parts = np.concatenate([parts, np.full((*parts.shape[:2], 1), 0.5)], axis=2)  # (b, m, 4)
    w = parts[..., None]
    both = (
        (1 - parts) * f[:, None, None] + parts * rows.f[:, :, None],
        (1 - w) * g[:, None, None, :] + w * rows.g[:, :, None, :],
        (1 - w) * H[:, None, None, :] + w * rows.H[:, :, None, :],
    )
    values = greatest(*both).reshape(len(f), -1)
    best, b = np.argmin(values, axis=1), np.arange(len(f))
    f, g, H = (part.reshape(len(b), -1, *part.shape[3:])[b, best] for part in both)
    return f, g, H, values[b, best]
