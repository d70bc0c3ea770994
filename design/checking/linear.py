"""Poles and contraction of the loop, decided in rational numbers at the corners of what they depend on.

The loop's matrix, with G = A L cos(theta - theta_f),

    theta' = omega,   I omega' = (G - K_p) theta - K_d omega + K_f s,   ell s' = -K_p theta - K_d omega + K_f s

is affine in each of G, 1/I and 1/ell. So are the coefficients of its characteristic polynomial, and so is the matrix
P J + Jᵀ P + 2 rate P, whose largest eigenvalue is convex in each: the corners decide.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import product

from design.checking import need

Matrix = list[list[Fraction]]
Ends = tuple[Fraction, Fraction]
CUTS = 200  # of ranges, for one decay rate


def ends_of(part: tuple[Fraction, Fraction]) -> Ends:
    """From middle and half-width."""
    return part[0] - part[1], part[0] + part[1]


def corners(G: Ends, inertia: Ends, length: Ends) -> Iterator[tuple[Fraction, Fraction, Fraction]]:
    """G, 1/I and 1/ell at the corners of the ranges of G, I and ell."""
    for g, i, ell in product(sorted(set(G)), sorted(set(inertia)), sorted(set(length))):
        yield g, 1 / i, 1 / ell


def loop(gains: Sequence[Fraction], G: Fraction, inertia: Fraction, length: Fraction) -> Matrix:
    """The matrix (n, n), n = 2 gains for law pd and 3 for law (8); ``inertia`` is 1/I and ``length`` 1/ell."""
    torque = [-gains[0], -gains[1], *gains[2:]]
    turning = [inertia * (torque[0] + G), *(inertia * each for each in torque[1:])]
    rows = [[Fraction(int(j == 1)) for j in range(len(gains))], turning]
    return rows if len(gains) == 2 else [*rows, [length * each for each in torque]]


def check_contraction(P: Matrix, rate: Fraction, gains: Sequence[Fraction], ranges: tuple[Ends, Ends, Ends]) -> None:
    """Refuse unless |x|_P falls at least as e^(-rate t), for every G, I and ell of the ranges."""
    n = len(gains)
    need(rate > 0, "the rate of contraction is not above 0")
    need(positive(P), "the norm's matrix is not positive definite")
    for corner in corners(*ranges):
        J = loop(gains, *corner)
        PJ = [[sum((P[a][c] * J[c][b] for c in range(n)), Fraction(0)) for b in range(n)] for a in range(n)]
        falls = positive([[-PJ[a][b] - PJ[b][a] - 2 * rate * P[a][b] for b in range(n)] for a in range(n)])
        need(falls, f"the loop does not contract at the rate {float(rate):g} in the norm")


def positive(matrix: Matrix) -> bool:
    """Whether a symmetric matrix is positive definite: whether all pivots of Gauss's elimination are above 0."""
    rest = [row[:] for row in matrix]
    while rest:
        pivot = rest[0][0]
        if not pivot > 0:
            return False
        rest = [[c - row[0] * d / pivot for c, d in zip(row[1:], rest[0][1:], strict=True)] for row in rest[1:]]
    return True


def inverted(matrix: Matrix) -> Matrix:
    """The inverse of a positive definite matrix, by the inverse of its leading block and Schur's complement."""
    if len(matrix) == 1:
        return [[1 / matrix[0][0]]]
    block, column = inverted([row[:-1] for row in matrix[:-1]]), [row[-1] for row in matrix[:-1]]
    way = [sum((a * b for a, b in zip(row, column, strict=True)), Fraction(0)) for row in block]
    last = 1 / (matrix[-1][-1] - sum((a * b for a, b in zip(way, column, strict=True)), Fraction(0)))
    rows = [[c + a * b * last for c, b in zip(row, way, strict=True)] for row, a in zip(block, way, strict=True)]
    return [*([*row, -a * last] for row, a in zip(rows, way, strict=True)), [*(-a * last for a in way), last]]


def check_decay(sigma: Fraction, gains: Sequence[Fraction], ranges: tuple[Ends, Ends, Ends]) -> None:
    """Refuse unless every pole lies left of -``sigma`` (>= 0), for every A L, I and ell of the ranges; (24)-(29).

    Where it does not follow of the ranges as a whole they are cut in two, across the relatively widest.
    """
    need(sigma >= 0, "a decay rate below 0 is claimed")
    waiting, cuts = [ranges], 0
    while waiting:
        part = waiting.pop()
        if _decays(sigma, gains, part):
            continue
        cuts += 1
        widths = [(high - low) / max(abs(low), abs(high), Fraction(1, 10**12)) for low, high in part]
        k = widths.index(max(widths))
        need(cuts <= CUTS and widths[k] > 0, f"decay-rate: {float(sigma):g} is not shown")
        low, high = part[k]
        for ends in ((low, (low + high) / 2), ((low + high) / 2, high)):
            AL, inertia, length = (ends if j == k else each for j, each in enumerate(part))
            waiting.append((AL, inertia, length))


def _decays(sigma: Fraction, gains: Sequence[Fraction], ranges: tuple[Ends, Ends, Ends]) -> bool:
    """Whether the coefficients of the polynomial in lambda + ``sigma``, each at its worst corner, satisfy (26)."""
    K_p, K_d = gains[:2]
    found: list[list[Fraction]] = []
    for AL, i, ell in corners(*ranges):
        if len(gains) == 2:
            p_1, p_0 = K_d * i, (K_p - AL) * i
            found.append([p_1 - 2 * sigma, p_0 - p_1 * sigma + sigma**2])
            continue
        p_2, p_1, p_0 = K_d * i - gains[2] * ell, (K_p - AL) * i, gains[2] * AL * i * ell
        q_1 = p_1 - 2 * p_2 * sigma + 3 * sigma**2
        found.append([p_2 - 3 * sigma, q_1, p_0 - p_1 * sigma + p_2 * sigma**2 - sigma**3])
    least = [min(each) for each in zip(*found, strict=True)]
    kept = all(q > 0 for q in least)
    return kept and (len(gains) == 2 or least[0] * least[1] > max(q[2] for q in found))
