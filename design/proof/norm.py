"""A norm in which a loop contracts, and the proof that it does.

|x|_P = sqrt(xᵀ P x). The Jacobian J is affine in each of a few numbers (``design.proof.jacobian``); the largest
eigenvalue of P J + Jᵀ P + 2 rate P is convex in J, and so largest at a corner of their ranges. There Sylvester's
leading minors are decided in exact rational arithmetic, floats being taken as the rationals that they are. Which P is
tried is a matter of luck and experience; that it serves is proved.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from design.proof.case import Case, NotProved
from design.proof.jacobian import Matrix, Ranges, jacobian
from design.proof.taylor import TINY, UP
from design.solvers.conic import Clarabel, Cone, ConicProgram, triangle

Array = NDArray[np.float64]

SHARES = (0.1, 0.3, 0.5, 0.65, 0.8, 0.9, 0.97)
"""Parts of the decay rate at which a norm is looked for."""


def contracting(case: Case, over: Ranges, defect: Array) -> tuple[Array, float]:
    """P and a rate > 0 that is proved for all Jacobians of these ranges; raises ``NotProved``.

    Of the norms that are tried it is the one in which a ``defect`` (n,) of these sizes moves toe and heel force least.
    """
    size, felt = case.size, case.felt
    exact = [jacobian(case, *corner) for corner in over.corners()]
    corners = np.stack([_floats(J) for J in exact])
    middle = _floats(jacobian(case, *over.middle()))
    decay = -float(np.linalg.eigvals(middle).real.max())
    if decay <= 0:
        message = "the linear loop is not stable"
        raise NotProved(message)
    shifts = [middle + share * decay * np.eye(size) for share in SHARES]
    tried = [_lyapunov(shift, weight) for weight in _weights(middle, felt) for shift in shifts]
    if case.moving or case.kind == "cop":
        few = [_floats(jacobian(case, *corner)) for corner in over.chief().corners()]
        shares = SHARES if case.kind != "cop" else SHARES[1::2]
        tried += [P for share in shares if (P := _optimal(few, felt, defect, share * decay)) is not None]
    best: tuple[float, Array, float] | None = None
    for P in tried:
        try:
            root = np.linalg.inv(np.linalg.cholesky(P).T)
        except np.linalg.LinAlgError:
            continue
        PJ = P @ corners
        worst = float(np.linalg.eigvalsh(root.T @ (PJ + PJ.transpose(0, 2, 1)) @ root).max())
        if worst >= 0:
            continue
        cost = math.sqrt(float(defect @ np.abs(P) @ defect) * float(felt @ np.linalg.solve(P, felt))) / -worst
        if best is None or cost < best[0]:
            best = cost, P, -0.5 * worst
    if best is None:
        message = "no norm in which the loop contracts over the whole tube and box was found"
        raise NotProved(message)
    P, rate = best[1], 0.999 * best[2]
    if not all(contracts(P, J, rate) for J in exact):
        message = "the contraction could not be confirmed exactly"
        raise NotProved(message)
    return P, rate


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


def _optimal(corners: Sequence[Array], felt: Array, defect: Array, rate: float) -> Array | None:
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
    answer = Clarabel(program, seconds=2.0).solve()
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
