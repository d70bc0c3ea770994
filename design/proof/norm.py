"""A norm in which a loop contracts, and the proof that it does.

|x|_P = sqrt(xᵀ P x). The Jacobian J is affine in each of a few numbers (``design.proof.jacobian``); the largest
eigenvalue of P J + Jᵀ P + 2 rate P is convex in J, and so largest at a corner of their ranges. There Sylvester's
leading minors are decided in exact rational arithmetic, floats being taken as the rationals that they are. Which P is
tried is a matter of luck and experience; that it serves is proved.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from fractions import Fraction
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import schur

from design.proof.case import Case, NotProved, OutOfTime
from design.proof.jacobian import Matrix, Ranges, jacobian
from design.proof.taylor import TINY, UP
from design.solvers.conic import Clarabel, Cone, ConicProgram, triangle

Array = NDArray[np.float64]

SHARES = (0.1, 0.3, 0.5, 0.65, 0.8, 0.9, 0.97)
"""Parts of the decay rate at which a norm is looked for."""
BALANCES = (0.0, 0.5, 1.0)
"""How far the groups of a modal norm are balanced for what the ranges move, rather than for the defect."""
LOST = 0.7
"""Of the rate that a norm had for narrower ranges it must keep so much to be taken again."""


class Norm(NamedTuple):
    """|x|_P = sqrt(xᵀ P x), in which the loop contracts at the ``rate`` [1/s]."""

    P: Array
    rate: float


def contracting(case: Case, over: Ranges, defects: Array, h: Array, deadline: float, before: Norm | None) -> Norm:
    """A norm and a rate > 0 that is proved for all Jacobians of these ranges; raises ``NotProved``, ``OutOfTime``.

    Of the norms that are tried it is the one in which ``defects`` (n, m) in pieces of lengths ``h`` (n,) [s] move toe
    and heel force least; the one that served ``before``, for narrower ranges, if it still does.
    """
    exact = [jacobian(case, *corner) for corner in over.corners()]
    corners = np.stack([_floats(J) for J in exact])
    middle = _floats(jacobian(case, *over.middle()))
    decay = -float(np.linalg.eigvals(middle).real.max())
    if decay <= 0:
        message = "the linear loop is not stable"
        raise NotProved(message)
    if before is not None:
        P, rate = before.P, 0.999 * float(_rates(before.P[None], corners)[0])
        if rate > LOST * before.rate and all(contracts(P, J, rate) for J in exact):
            return Norm(P, rate)
    felt, defect = case.felt, _lasting(defects, h, decay)
    tried = _of_lyapunov(middle, felt) + _modal(middle, felt, defect)
    few = [_floats(jacobian(case, *corner)) for corner in over.chief().corners()]
    for share in SHARES if case.kind != "cop" else SHARES[1::2]:
        left = deadline - time.monotonic()
        if left <= 0:
            raise OutOfTime
        P = _optimal(few, felt, defect, share * decay, min(left, 2.0))
        tried += [P] if P is not None else []
    P, rate = _best(np.stack(tried), corners, felt, defect)
    if not all(contracts(P, J, rate) for J in exact):
        message = "the contraction could not be confirmed exactly"
        raise NotProved(message)
    return Norm(P, rate)


def _lasting(defects: Array, h: Array, decay: float) -> Array:
    """The constant defect (m,) [1/s] that, falling away at the rate ``decay``, sums up to as much as ``defects`` do."""
    most = np.zeros(defects.shape[1])
    now = np.zeros(defects.shape[1])
    for left, added, length in zip(np.exp(-decay * h), 2 * defects, h, strict=True):
        now = now * left + added * min(1.0, 1.0 / max(decay * length, 1e-12))
        most = np.maximum(most, now)
    return most * decay


def _best(tried: Array, corners: Array, felt: Array, defect: Array) -> Norm:
    """Of the matrices ``tried`` (c, n, n) the one in which the defect moves the forces least, in floats."""
    tried = tried[np.isfinite(tried).all(axis=(1, 2))]
    tried = tried / np.trace(tried, axis1=1, axis2=2)[:, None, None]
    tried = tried[np.linalg.eigvalsh(tried)[:, 0] > 1e-16]
    rates = _rates(tried, corners)
    tried, rates = tried[rates > 0], rates[rates > 0]
    if not len(tried):
        message = "no norm in which the loop contracts over the whole tube and box was found"
        raise NotProved(message)
    moved = np.einsum("i,cij,j->c", defect, np.abs(tried), defect)
    cost = np.sqrt(moved * np.einsum("i,cij,j->c", felt, np.linalg.inv(tried), felt)) / rates
    best = int(np.nanargmin(cost))
    return Norm(tried[best], 0.999 * float(rates[best]))


def _rates(tried: Array, corners: Array) -> Array:
    """The rate of contraction (c,) at the worst of the ``corners`` (k, n, n) for each of ``tried`` (c, n, n)."""
    roots = np.linalg.inv(np.linalg.cholesky(tried).transpose(0, 2, 1))
    PJ = tried[:, None] @ corners[None]
    moved = roots.transpose(0, 2, 1)[:, None] @ (PJ + PJ.transpose(0, 1, 3, 2)) @ roots[:, None]
    return np.asarray(-0.5 * np.linalg.eigvalsh(moved).max(axis=(1, 2)))


def _of_lyapunov(middle: Array, felt: Array) -> list[Array]:
    decay = -float(np.linalg.eigvals(middle).real.max())
    shifts = [middle + share * decay * np.eye(len(middle)) for share in SHARES]
    return [_lyapunov(shift, weight) for weight in _weights(middle, felt) for shift in shifts]


def _modal(middle: Array, felt: Array, defect: Array) -> list[Array]:
    """Norms in which groups of poles next to each other do not mix, however different their rates are.

    The states are split into the invariant subspaces of the groups (ordered Schur forms, which stand poles that are
    all but equal); a group of one pole has its own size, one of several a norm by Lyapunov's equation. The groups are
    weighed for the least effect: the sum of sqrt(a_i c_i) is least for weights a_i/c_i, with a_i what the group does to
    the torque, and c_i what the defect does to the group.
    """
    n = len(middle)
    pushed = np.eye(n)[1]  # what a change of G moves, and what moves it
    found = []
    for cuts in _cuts(np.sort(-np.linalg.eigvals(middle).real)):
        bases = [_invariant(middle, low, high) for low, high in cuts]
        if any(basis is None for basis in bases) or sum(basis.shape[1] for basis in bases if basis is not None) != n:
            continue
        Q = np.column_stack([basis for basis in bases if basis is not None])
        if not np.linalg.cond(Q) < 1e10:
            continue
        T = np.linalg.inv(Q)
        for share in SHARES:
            at, parts = 0, []
            for basis in bases:
                size = basis.shape[1]  # type: ignore[union-attr]
                its = slice(at, at + size)
                block = T[its] @ middle @ Q[:, its]
                decay = -float(np.linalg.eigvals(block).real.max())
                own = np.eye(1) if size == 1 else _lyapunov(block + share * decay * np.eye(size), np.eye(size))
                inner = np.linalg.inv(own)
                a = [float(out @ Q[:, its] @ inner @ Q[:, its].T @ out) for out in (felt, np.eye(n)[0])]
                c = [float(each @ np.abs(T[its].T @ own @ T[its]) @ each) for each in (defect, pushed)]
                parts.append((T[its].T @ own @ T[its], np.sqrt(np.array(a) / np.maximum(c, 1e-300))))
                at += size
            for balance in BALANCES:
                weights = [w[0] ** (1 - balance) * w[1] ** balance for _, w in parts]
                found.append(sum(weight * P for weight, (P, _) in zip(weights, parts, strict=True)))
    return [np.asarray(0.5 * (P + P.T)) for P in found]


def _cuts(decays: Array) -> list[list[tuple[float, float]]]:
    """The ways to cut sorted decay rates into groups: ranges of rates, at gaps between neighbours that differ."""
    gaps = [k for k in range(1, len(decays)) if decays[k] > 1.001 * abs(decays[k - 1])]
    found = []
    for some in (some for r in range(1, len(gaps) + 1) for some in combinations(gaps, r)):
        edges = [-math.inf, *(0.5 * float(decays[k - 1] + decays[k]) for k in some), math.inf]
        found.append(list(pairwise(edges)))
    return found


def _invariant(matrix: Array, low: float, high: float) -> Array | None:
    """An orthonormal basis (n, k) of the invariant subspace of the poles that decay at rates from ``low`` to ``high``."""
    try:
        _, Q, k = schur(matrix, output="real", sort=lambda re, im=0.0: low < -re <= high)
    except np.linalg.LinAlgError:
        return None
    return np.asarray(Q[:, :k]) if k else None


def _floats(matrix: Matrix) -> Array:
    return np.array([[float(entry) for entry in row] for row in matrix])


def _weights(A: Array, felt: Array) -> list[Array]:
    """Right sides of Lyapunov's equation to choose a norm from: what each state weighs, and what is felt in the end."""
    n = len(A)
    modes = np.linalg.eig(A)[1]
    balanced = np.diag(1.0 / np.maximum(np.abs(modes).max(axis=1), 1e-12) ** 2)
    output = np.outer(felt, felt) / float(felt @ felt)
    found = [balanced]
    for share in (1e-1, 1e-2, 1e-3, 1e-4):
        found += [output + share * balanced / float(np.trace(balanced)), output + share * np.eye(n) / n]
        found.append(np.diag(felt**2 / float(felt @ felt)) + share * np.eye(n) / n)
    return found


def _lyapunov(A: Array, weight: Array) -> Array:
    """P with Aᵀ P + P A = -weight, symmetric in floats."""
    n = len(A)
    eye = np.eye(n)
    P = np.linalg.solve(np.kron(eye, A.T) + np.kron(A.T, eye), -weight.ravel()).reshape(n, n)
    return np.asarray(0.5 * (P + P.T))


def _optimal(
    corners: Sequence[Array], felt: Array, defect: Array, rate: float, seconds: float
) -> Array | None:
    """P with P J + Jᵀ P <= -2 rate P at all ``corners`` for which a defect moves the forces least; None if none is.

    minimise t over P, t subject to sum of n defect_i² P_ii = 1, feltᵀ P⁻¹ felt <= t, and the inequalities: a small
    semidefinite program, in coordinates in which every state is felt alike.
    """
    n = len(felt)
    scale = np.where(felt > 0, 1.0 / np.maximum(felt, 1e-12), 1.0)
    moved = [J * scale[None, :] / scale[:, None] for J in corners]
    weight = defect / scale
    weight = np.maximum(weight / max(float(weight.max()), 1e-300), 1e-6)
    basis = []
    for i in range(n):
        for j in range(i + 1):
            E = np.zeros((n, n))
            E[i, j] = E[j, i] = 1.0
            basis.append(E)

    def bordered(E: Array, corner: float) -> Array:
        return np.block([[np.array([[corner]]), np.zeros((1, n))], [np.zeros((n, 1)), E]])

    columns = [
        np.concatenate([
            [float((n * weight**2) @ np.diag(E))], -triangle(bordered(E, 0.0)),
            *[triangle(E @ J + J.T @ E + 2 * rate * E) for J in moved],
        ])
        for E in basis
    ]  # fmt: skip
    each = n * (n + 1) // 2
    last = np.concatenate([[0.0], -triangle(bordered(np.zeros((n, n)), 1.0)), np.zeros(each * len(moved))])
    constant = np.zeros((n + 1, n + 1))
    constant[0, 1:] = constant[1:, 0] = 1.0  # felt, in these coordinates
    slack = np.tile(triangle(1e-7 * np.eye(n)), len(moved))
    b = np.concatenate([[1.0], triangle(constant), -slack])
    count = len(basis) + 1
    program = ConicProgram(
        P=sp.csc_matrix((count, count)), q=np.eye(count)[-1], A=sp.csc_matrix(np.column_stack([*columns, last])), b=b,
        cones=[Cone("zero", 1), Cone("semidefinite", n + 1), *[Cone("semidefinite", n) for _ in moved]],
    )  # fmt: skip
    answer = Clarabel(program, seconds=seconds).solve()
    if not np.isfinite(answer.x).all():  # whether it is any good is for others to say
        return None
    P = sum(float(value) * E for value, E in zip(answer.x[:-1], basis, strict=True)) / np.outer(scale, scale)
    return np.asarray(0.5 * (P + P.T))


def transfer(before: Array, after: Array) -> float:
    """A number c with |x|_after <= c |x|_before for all x, decided exactly."""
    root = np.linalg.inv(np.linalg.cholesky(before).T)
    c = math.sqrt(max(float(np.linalg.eigvalsh(root.T @ after @ root).max()), 0.0)) * (1 + 1e-6)
    square = Fraction(c) ** 2
    n = len(before)
    rest = [[square * Fraction(before[i][j]) - Fraction(after[i][j]) for j in range(n)] for i in range(n)]
    if not _positive(rest):
        message = "two norms could not be compared exactly"
        raise NotProved(message)
    return c


def falls(x: Array) -> tuple[Array, Array]:
    """Bounds (n,) of exp(-x) for 0 <= ``x`` (n,): of exp(x/1024) by its series, and that to the 1024th power."""
    y = np.minimum(x, 700.0) / 1024
    series = 1 + y * (1 + y / 2 * (1 + y / 3 * (1 + y / 4)))
    more = series + y**5 / 50  # exp(y) < 2 in the remainder
    least, most = (1 / part for part in (more, series))
    for _ in range(10):
        least, most = least * least, most * most
    return np.where(x <= 700.0, least / UP, 0.0), most * UP


def norm(size: Array, vectors: Array) -> Array:
    """Bound (n,) of |x|_P for |x_i| <= vectors (n, m), with ``size`` = |P|, one (m, m) or one for each (n, m, m)."""
    return np.asarray(UP * np.sqrt(_squares(size, vectors) * UP + TINY))


def dual(inverse: Array, slopes: Sequence[float | Array], n: int) -> Array:
    """Bound (n,) of the norm of a gradient whose components are at most ``slopes`` in size."""
    g = np.stack([np.broadcast_to(np.asarray(part, dtype=float), (n,)) for part in slopes], axis=1)
    return np.asarray(UP * np.sqrt(_squares(np.abs(inverse), g) * UP))


def _squares(matrix: Array, vectors: Array) -> Array:
    each = np.broadcast_to(matrix, (len(vectors), *matrix.shape[-2:]))
    return np.asarray(np.einsum("ni,nij,nj->n", vectors, each, vectors))


def inverted(P: Array) -> Array:
    """P^-1, each entry rounded away from zero from the exact one."""
    n = len(P)
    rows = [[Fraction(float(P[i, j])) for j in range(n)] + [Fraction(int(i == j)) for j in range(n)] for i in range(n)]
    for i in range(n):
        pivot = rows[i][i]
        rows[i] = [entry / pivot for entry in rows[i]]
        for j in range(n):
            if j != i:
                factor = rows[j][i]
                rows[j] = [a - factor * b for a, b in zip(rows[j], rows[i], strict=True)]
    exact = np.array([[float(entry) for entry in row[n:]] for row in rows])
    return np.asarray(exact + np.sign(exact) * np.abs(exact) * 1e-15)


def contracts(P: Array, J: Array | Matrix, rate: float) -> bool:
    """Whether P > 0 and P J + Jᵀ P + 2 rate P < 0, decided exactly."""
    n = len(P)
    p = [[Fraction(float(P[i, j])) for j in range(n)] for i in range(n)]
    j = [[Fraction(J[a][b]) for b in range(n)] for a in range(n)]
    pj = [[sum((p[a][c] * j[c][b] for c in range(n)), Fraction(0)) for b in range(n)] for a in range(n)]
    twice = 2 * Fraction(rate)
    q = [[-(pj[a][b] + pj[b][a]) - twice * p[a][b] for b in range(n)] for a in range(n)]
    return _positive(p) and _positive(q)


def _positive(matrix: list[list[Fraction]]) -> bool:
    """Whether a symmetric matrix is positive definite, by its leading minors."""
    return all(_determinant([row[:size] for row in matrix[:size]]) > 0 for size in range(1, len(matrix) + 1))


def _determinant(matrix: list[list[Fraction]]) -> Fraction:
    if len(matrix) == 1:
        return matrix[0][0]
    return sum(
        ((-1) ** c * matrix[0][c] * _determinant([row[:c] + row[c + 1 :] for row in matrix[1:]])
         for c in range(len(matrix))),
        Fraction(0),
    )  # fmt: skip
