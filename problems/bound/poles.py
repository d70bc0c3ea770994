"""What the poles allow over a box of gains: exact, because every coefficient of (24) is affine in the gains.

The polynomial shifted by sigma has coefficients q_k that are affine in K again. Where a box has no K with all q_k >= 0
and the next condition of Routh and Hurwitz, q_2 q_1 >= q_0 (q_3 q_2 >= q_1 and (q_3 q_2 - q_1) q_1 >= q_3^2 q_0 where
the law adapts), no K of it decays at sigma; nor at any greater rate, so that whatever sigma is excluded is a bound.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from design.model.stability import shifted
from problems.bound.relax import Quadratics
from problems.gains import Question

Array = NDArray[np.float64]

ROUNDING = 1e-11
"""Added to every row, in parts of the sum of the sizes of its terms: far more than rounding can make of it."""


class Poles:
    """The characteristic polynomials of a question: offsets (e, n) and slopes (e, n, 3) by gain, without units."""

    def __init__(self, question: Question) -> None:
        at = [[each.coefficients(K) for K in np.vstack([np.zeros(3), np.diag(question.scale)])]
              for each in question.environments]  # fmt: skip
        found = np.array(at, dtype=float)  # (e, 4, n)
        self.degree = found.shape[2]
        unit = question.pace ** np.arange(1, self.degree + 1)
        self.offset: Array = found[:, 0] / unit
        self.slope: Array = np.moveaxis(found[:, 1:] - found[:, :1], 1, 2) / unit[:, None]

    def rows(self, centre: Array, radius: Array, sigma: Array) -> Quadratics:
        """Rows that no K of a box keeps >= 0 unless its poles may decay at ``sigma`` (b,), in parts of the pace.

        ``centre``, ``radius`` (b, 3) in parts of ``scale``. (b, e (n + 1)) rows, one more each where n = 4.
        """
        p = self.offset + np.einsum("enk,bk->ben", self.slope, centre)
        size = np.abs(self.offset) + np.einsum("enk,bk->ben", np.abs(self.slope), np.abs(centre) + radius)
        by = self.slope[None] * radius[:, None, None, :]
        s = sigma[:, None]
        columns = [p[..., k] for k in range(self.degree)]
        q = np.stack(shifted(columns, s), axis=2)
        zero = [np.zeros_like(s)] * self.degree
        base = np.stack(shifted(zero, s), axis=2)
        dq = np.stack([np.stack(shifted([by[:, :, k, j] for k in range(self.degree)], s), axis=2) - base
                       for j in range(3)], axis=3)  # fmt: skip
        slack = np.stack(shifted([size[..., k] for k in range(self.degree)], -np.abs(s)), axis=2)  # all terms positive
        slack = np.abs(slack) + np.abs(dq).sum(axis=3)
        b = len(centre)
        flat = Quadratics(
            (q + ROUNDING * slack).reshape(b, -1), dq.reshape(b, -1, 3), np.zeros((b, q.shape[1] * self.degree, 6))
        )
        if self.degree == 2:
            return flat
        first, second, third = (0, 1, 2)
        f = q[..., first] * q[..., second] - q[..., third]
        f = f + ROUNDING * (slack[..., first] * slack[..., second] + slack[..., third])
        d1, d2 = dq[:, :, first], dq[:, :, second]
        g = q[..., first, None] * d2 + q[..., second, None] * d1 - dq[:, :, third]
        H = np.stack([d1[..., j] * d2[..., k] + d1[..., k] * d2[..., j] for j, k in SIX], axis=-1)
        found = flat.beside(Quadratics(f, g, H))
        if self.degree == 3:
            return found
        reach = np.abs(dq).sum(axis=3)
        low, high = q - reach, q + reach
        rise = np.abs(g).sum(axis=2) + _spread(H)
        most = np.maximum(f + rise, 0.0) * np.maximum(high[..., 2], 0.0)
        least = np.maximum(low[..., 0], 0.0) ** 2 * np.maximum(low[..., 3], 0.0)
        none = np.zeros_like(g)
        last = most - least + ROUNDING * (most + least)
        return found.beside(Quadratics(last, none, np.zeros_like(H)))

    def fastest(self, question: Question) -> float:
        """No gains within the bounds decay faster: the mean of the poles, in parts of the pace."""
        most = np.maximum(
            self.slope[:, 0] * question.lower / question.scale, self.slope[:, 0] * question.upper / question.scale
        )
        return float((self.offset[:, 0] + most.sum(axis=1)).min() / self.degree) * (1 + ROUNDING) + ROUNDING

    def decay(self, points: Array) -> Array:
        """The decay rate (k,) at ``points`` (k, 3), by eigenvalues; both without units."""
        p = self.offset + np.einsum("enk,bk->ben", self.slope, points)
        n = self.degree
        companion = np.zeros((*p.shape[:2], n, n))
        companion[..., 0, :] = -p
        companion[..., np.arange(1, n), np.arange(n - 1)] = 1.0
        return np.asarray(-np.linalg.eigvals(companion).real.max(axis=(1, 2)))


SIX = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def _spread(H: Array) -> Array:
    """At least |d' H d| / 2 over the box."""
    return np.asarray(0.5 * np.abs(H[..., :3]).sum(axis=-1) + np.abs(H[..., 3:]).sum(axis=-1))
