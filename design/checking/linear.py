"""Poles and contraction of the loop, decided in rational numbers at the corners of what they depend on.

The loop's matrix, with G = A L cos(theta - theta_f),

    theta' = omega,   I omega' = (G - K_p) theta - K_d omega + K_f s,   ell s' = -K_p theta - K_d omega + K_f s

is affine in each of G, 1/I and 1/ell. So are the coefficients of its characteristic polynomial, and so is the matrix
K = S J S^-1; the largest eigenvalue of a symmetric part, and a size, are convex in it: the corners decide.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import product
from typing import Any

from design.checking import need
from design.checking.world import number

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


@dataclass(frozen=True)
class Norm:
    """Coordinates z = ``S`` x in blocks of these sizes, |z_b|² = sum of ``weights`` z_i²; how fast each falls [1/s].

    |z_b|' <= -rate |z_b| + sum of coupling_bc |z_c| + what the defect adds.
    """

    S: Matrix
    weights: list[Fraction]
    blocks: list[range]
    rates: list[Fraction]
    couplings: Matrix

    @property
    def inverse(self) -> Matrix:
        """S^-1."""
        return inverted(self.S)


def norm_of(part: dict[str, Any], n: int) -> Norm:
    """The norm that a part of a certificate has: one matrix P and its rate, or coordinates in blocks."""
    if "norm" in part:
        P = [[number(part["norm"][max(a, b)][min(a, b)]) for b in range(n)] for a in range(n)]
        need(positive(P), "the norm's matrix is not positive definite")
        S, weights = _squares(P)
        return Norm(S, weights, [range(n)], [number(part["rate"])], [[Fraction(0)]])
    S, sizes = [[number(entry) for entry in row] for row in part["frame"]], part["blocks"]
    whole = all(type(size) is int and size > 0 for size in sizes) and sum(sizes) == n == len(S)
    need(whole and all(len(row) == n for row in S), "the blocks of the norm are not its coordinates")
    starts = [sum(sizes[:k]) for k in range(len(sizes))]
    blocks = [range(start, start + size) for start, size in zip(starts, sizes, strict=True)]
    rates, couplings = ([number(rate) for rate in part["rates"]],
                        [[number(entry) for entry in row] for row in part["couplings"]])  # fmt: skip
    square = len(rates) == len(couplings) == len(sizes) == min(map(len, couplings)) == max(map(len, couplings))
    need(square and min(map(min, couplings)) >= 0, "the rates and couplings are not those of the blocks")
    return Norm(S, [Fraction(1)] * n, blocks, rates, couplings)


def _squares(P: Matrix) -> tuple[Matrix, list[Fraction]]:
    """xᵀ P x as a sum of ``weights`` (S x)_i²: S unit upper triangular, by Gauss's elimination."""
    rest, n = [row[:] for row in P], len(P)
    for i in range(n):
        for j in range(i + 1, n):
            factor = rest[j][i] / rest[i][i]
            rest[j] = [a - factor * b for a, b in zip(rest[j], rest[i], strict=True)]
    return [[entry / row[i] for entry in row] for i, row in enumerate(rest)], [rest[i][i] for i in range(n)]


def check_contraction(norm: Norm, gains: Sequence[Fraction], ranges: tuple[Ends, Ends, Ends]) -> None:
    """Refuse unless the norm's blocks fall and drive each other as it says, for every G, I and ell of the ranges."""
    need(min(norm.rates) > 0, "the rate of contraction is not above 0")
    back, w = norm.inverse, norm.weights
    for corner in corners(*ranges):
        K = _product(_product(norm.S, loop(gains, *corner)), back)
        for b, block in enumerate(norm.blocks):
            rate = norm.rates[b]
            falls = positive(
                [[-w[i] * K[i][j] - w[j] * K[j][i] - (2 * rate * w[i] if i == j else 0) for j in block] for i in block]
            )
            need(falls, f"the loop does not contract at the rate {float(rate):g} in the norm")
            for c, other in enumerate(norm.blocks):
                square = sum((w[i] * K[i][j] ** 2 / w[j] for i in block for j in other), Fraction(0))
                need(b == c or square <= norm.couplings[b][c] ** 2, "the norm's blocks drive each other more than said")


def _product(a: Matrix, b: Matrix) -> Matrix:
    columns = list(zip(*b, strict=True))
    return [[sum((x * y for x, y in zip(row, column, strict=True)), Fraction(0)) for column in columns] for row in a]


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
    """The inverse, by Gauss's elimination; refuses a matrix that has none."""
    n = len(matrix)
    rows = [[*row, *(Fraction(int(i == j)) for j in range(n))] for i, row in enumerate(matrix)]
    for i in range(n):
        best = max(range(i, n), key=lambda k: abs(rows[k][i]))
        rows[i], rows[best] = rows[best], rows[i]
        need(rows[i][i] != 0, "the norm's coordinates do not tell all states apart")
        rows[i] = [entry / rows[i][i] for entry in rows[i]]
        for j in range(n):
            if j != i:
                rows[j] = [a - rows[j][i] * b for a, b in zip(rows[j], rows[i], strict=True)]
    return [row[n:] for row in rows]


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
