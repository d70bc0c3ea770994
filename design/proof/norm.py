"""A norm in which a loop contracts, and the proof that it does.

|x|_P = sqrt(xᵀ P x). The Jacobian J is affine in G = A L cos(theta - theta_f), in 1/I and in 1/ell, one by one; the
largest eigenvalue of P J + Jᵀ P + 2 rate P is convex in J, and so largest at a corner of their ranges. There
Sylvester's leading minors are decided in exact rational arithmetic, floats being taken as the rationals that they are.
Which P is tried is a matter of luck and experience; that it serves is proved.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from itertools import product

import numpy as np
from numpy.typing import NDArray

from design.proof.case import Case, NotProved
from design.proof.taylor import TINY, UP

Array = NDArray[np.float64]

SHARES = (0.1, 0.3, 0.5, 0.65, 0.8, 0.9, 0.97)
"""Parts of the decay rate at which a norm is looked for."""


def contracting(case: Case, G: tuple[float, float]) -> tuple[Array, float]:
    """P and a rate > 0 that is proved for all G in its range and all bodies of the box; raises ``NotProved``."""
    biped, radii = case.biped, case.radii
    size = 2 if case.kind == "pd" else 3
    inertia = [1.0 / (biped.I - radii[2]), 1.0 / (biped.I + radii[2])]
    lengths = [1.0 / (biped.ell - radii[4]), 1.0 / (biped.ell + radii[4])]
    inertia = [math.nextafter(inertia[0] * UP, math.inf), inertia[1] / UP]
    lengths = [math.nextafter(lengths[0] * UP, math.inf), lengths[1] / UP]
    corners = [_jacobian(case, *corner) for corner in product(G, inertia, lengths)]
    middle = _jacobian(case, 0.5 * sum(G), 1.0 / biped.I, 1.0 / biped.ell)
    decay = -float(np.linalg.eigvals(middle).real.max())
    if decay <= 0:
        message = "the linear loop is not stable"
        raise NotProved(message)
    K = case.gains
    felt = np.array([K.K_p, K.K_d, K.K_f][:size])  # in toe and heel force
    best: tuple[float, Array, float] | None = None
    for weight in _weights(middle, felt):
        for share in SHARES:
            try:
                P = _lyapunov(middle + share * decay * np.eye(size), weight)
                root = np.linalg.inv(np.linalg.cholesky(P).T)
            except np.linalg.LinAlgError:
                continue
            worst = max(float(np.linalg.eigvalsh(root.T @ (P @ J + J.T @ P) @ root).max()) for J in corners)
            if worst >= 0:
                continue
            cost = math.sqrt(P[1, 1] * float(felt @ np.linalg.solve(P, felt))) / -worst  # from defect to force
            if best is None or cost < best[0]:
                best = cost, P, -0.5 * worst
    if best is None:
        message = "no norm in which the loop contracts over the whole tube and box was found"
        raise NotProved(message)
    P, rate = best[1], 0.999 * best[2]
    if not all(contracts(P, J, rate) for J in corners):
        message = "the contraction could not be confirmed exactly"
        raise NotProved(message)
    return P, rate


def _jacobian(case: Case, G: float, inertia: float, length: float) -> Array:
    K, size = case.gains, 2 if case.kind == "pd" else 3
    torque = np.array([-K.K_p, -K.K_d, K.K_f][:size])
    turning = (torque + np.array([G, 0.0, 0.0][:size])) * inertia
    rows = [np.eye(size)[1], turning]
    return np.vstack(rows if size == 2 else [*rows, torque * length])


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


def norm(size: Array, vectors: Array) -> Array:
    """Bound (n,) of |x|_P for |x_i| <= vectors (n, m), with ``size`` = |P|."""
    return np.asarray(UP * np.sqrt(np.einsum("ni,ij,nj->n", vectors, size, vectors) * UP + TINY))


def dual(inverse: Array, slopes: Sequence[float | Array], n: int) -> Array:
    """Bound (n,) of the norm of a gradient whose components are at most ``slopes`` in size."""
    g = np.stack([np.broadcast_to(np.asarray(part, dtype=float), (n,)) for part in slopes], axis=1)
    return np.asarray(UP * np.sqrt(np.einsum("ni,ij,nj->n", g, np.abs(inverse), g) * UP))


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


def contracts(P: Array, J: Array, rate: float) -> bool:
    """Whether P > 0 and P J + Jᵀ P + 2 rate P < 0, decided exactly."""
    n = len(P)
    p = [[Fraction(float(P[i, j])) for j in range(n)] for i in range(n)]
    j = [[Fraction(float(J[a, b])) for b in range(n)] for a in range(n)]
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
