"""Whether an ellipsoid is what it is said to be, decided in rational arithmetic from the numbers alone.

V(x) = xᵀ P x, E = {V <= 1}. Each of these is a matrix that must be positive definite, or a sign:

    P,    -(A(sigma)ᵀ P + P A(sigma) + 2 alpha P) at both ends of sigma                 V' < -2 alpha V inside E
    e_max² det P >= det of P without e                                                  max over E of e² = (P^-1)_ee
    [ room - lambda   -h/2           ]
    [ -hᵀ/2           lambda P - S   ]  at every vertex, with lambda > 0 (S-procedure: room - h x - xᵀ S x is
                                        lambda (1 - V) and a square, so that it is positive wherever V <= 1)

Together: from a state in E neither |e| <= e_max nor contact can be lost before V has grown, and V falls; so both are
kept for all times, and x goes to the stationary posture. Sylvester's leading minors decide; over ranges of the numbers
they are enclosed, so that the answer may be "not seen", never wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from design.proof.exact import Range, point
from problems.region.loop import Demand, Loop, Matrix

Array = NDArray[np.float64]


def broken(loop: Loop, P: Array, e_max: float, alpha: float, multipliers: Sequence[float]) -> str:
    """What is not proved of the ellipsoid of ``P`` (3, 3); empty where all is.

    ``e_max`` [rad], ``alpha`` [1/s] >= 0; ``multipliers``: a lambda for each of ``loop.demands``. All are taken as the
    rationals that they are.
    """
    if not (np.isfinite(P).all() and np.array_equal(P, P.T) and 0 < e_max <= 3 and alpha >= 0):
        return "P is not finite and symmetric, or e_max or alpha is out of its range"
    p = [[point(Fraction(float(entry))) for entry in row] for row in P]
    bound = Fraction(float(e_max))
    if not positive(p):
        return "P is not positive definite"
    smaller = [row[1:] for row in p[1:]]
    if (point(bound * bound) * determinant(p) - determinant(smaller)).low < 0:
        return f"the region reaches beyond |e| = {e_max:.6g} rad"
    for vertex, name in zip(loop.vertices(bound), ("sin e = e", "sin e = sigma e"), strict=True):
        if not positive(_falling(p, vertex, Fraction(float(alpha)))):
            return f"V does not fall at {alpha:.6g} 1/s where {name}"
    demands = loop.demands(bound)
    if len(multipliers) != len(demands):
        return f"{len(multipliers)} multipliers for {len(demands)} demands"
    for demand, multiplier in zip(demands, multipliers, strict=True):
        lam = Fraction(float(multiplier))
        if lam <= 0 or not positive(_kept(p, demand, lam)):
            return "contact, or the torque's limit, is not kept everywhere in the region"
    return ""


def _falling(p: Matrix, A: Matrix, alpha: Fraction) -> Matrix:
    n = range(len(p))
    pa = [[_sum([p[i][k] * A[k][j] for k in n]) for j in n] for i in n]
    return [[-(pa[i][j] + pa[j][i]) - point(2 * alpha) * p[i][j] for j in n] for i in n]


def _kept(p: Matrix, demand: Demand, lam: Fraction) -> Matrix:
    half = point(Fraction(-1, 2))
    corner = [demand.room - point(lam), *(half * part for part in demand.h)]
    return [
        corner,
        *(
            [corner[1 + i], *(point(lam) * p[i][j] - demand.S[i][j] for j in range(len(p)))]
            for i in range(len(p))
        ),
    ]  # fmt: skip


def positive(matrix: Matrix) -> bool:
    """Whether every symmetric matrix with entries in these ranges is positive definite."""
    return all(determinant([row[:n] for row in matrix[:n]]).low > 0 for n in range(1, len(matrix) + 1))


def determinant(matrix: Matrix) -> Range:
    """Its enclosure, by the first row."""
    if len(matrix) == 1:
        return matrix[0][0]
    parts = []
    for c, entry in enumerate(matrix[0]):
        part = entry * determinant([row[:c] + row[c + 1 :] for row in matrix[1:]])
        parts.append(part if c % 2 == 0 else -part)
    return _sum(parts)


def _sum(parts: Sequence[Range]) -> Range:
    total = parts[0]
    for part in parts[1:]:
        total = total + part
    return total
