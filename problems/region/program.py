"""The largest ellipsoid for a bound e_max and multipliers lambda, as a semidefinite program; multipliers for it.

::

    maximise    det(Q)^(1/3)
    over        Q (3, 3) symmetric, the ellipsoid being xᵀ Q^-1 x <= 1
    subject to  A Q + Q Aᵀ + 2 alpha Q <= 0                        A(sigma) at both ends of sigma
                Q_ee <= e_max²
                G Q Gᵀ <= 1                                        for each demand h x + xᵀ S x <= room

G comes from the S-procedure: with a lambda in (0, room), the demand is kept on the ellipsoid if and only if
Q^-1 >= R = S/lambda + hᵀ h/(4 lambda (room - lambda)). R has directions in which it is negative; there nothing is asked
of Q. Of the majorants of R the one is taken that is least in the metric of the ellipsoid at hand, R = sum mu_i v_i v_iᵀ
with v_i orthonormal in it and G the rows sqrt(mu_i) v_iᵀ, mu_i > 0: at hand nothing is lost. With lambda likewise the
best for the ellipsoid at hand it stays feasible, so that a sequence of such programs never gets smaller.

det(Q)^(1/3) <= geometric mean of the diagonal of Z, triangular, with [[Q, Z], [Zᵀ, diag Z]] >= 0 (Nesterov and
Nemirovskii 1994), by three second-order cones. All is in coordinates z, x = T z, in which the ellipsoid at hand is the
unit ball.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from design.solvers.conic import Clarabel, Cone, ConicProgram, matrix, triangle

Array = NDArray[np.float64]

ZOOMS, PER_ZOOM = 9, 17
"""Rounds of the search for a multiplier, and how many are compared in each."""
TOLERANCE = 1e-7
"""Of the programs; what they return is not believed, but an inaccurate one ends the sequence too early."""


class Asked(NamedTuple):
    """A demand in floats: ``h`` (3,), ``S`` (3, 3), ``room``."""

    h: Array
    S: Array
    room: float


def multipliers(T: Array, demands: Sequence[Asked], zooms: int = ZOOMS) -> tuple[Array, Array]:
    """The lambda (k,) of each demand that leaves most on {T z: |z| <= 1}, and what then is to be <= 1 (k,).

    That is the largest mu of R. It is quasi-convex in lambda: mu <= c is a linear matrix inequality in lambda.
    """
    h = np.array([T.T @ each.h for each in demands])
    S = np.array([T.T @ each.S @ T for each in demands])
    room = np.array([each.room for each in demands])
    outer = h[:, :, None] * h[:, None, :]
    low, high = np.full(len(room), 1e-6), np.full(len(room), 1 - 1e-6)
    for _ in range(zooms):
        share = np.linspace(low, high, PER_ZOOM)
        lam = share * room
        mu = np.linalg.eigvalsh(S / lam[..., None, None] + outer / (4 * lam * (room - lam))[..., None, None])[..., -1]
        at, every = mu.argmin(axis=0), np.arange(len(room))
        low, high = share[np.maximum(at - 1, 0), every], share[np.minimum(at + 1, PER_ZOOM - 1), every]
    return share[at, every] * room, mu[at, every]


def larger(
    T: Array, vertices: Sequence[Array], demands: Sequence[Asked], lam: Array, e_max: float, alpha: float
) -> Array | None:
    """The optimal Q (3, 3) in the coordinates z, or None where Clarabel finds none."""
    rows: list[Array] = []
    b: list[Array] = []
    cones: list[Cone] = []
    n, size = 3, 15  # Q (6), Z (6), two means of two, their mean

    def block(columns: Sequence[Array], constant: Array) -> None:
        """A matrix that is affine in the unknowns and at least 0."""
        rows.append(-_triangles(np.array(columns)).T)
        b.append(triangle(constant))
        cones.append(Cone("semidefinite", len(constant)))

    def cone(spread: Array, constant: Array) -> None:
        rows.append(-spread)
        b.append(constant)
        cones.append(Cone("second order", len(constant)))

    units = [matrix(row) for row in np.eye(6)]
    none = [np.zeros((n, n))] * (size - 6)
    turn = np.linalg.inv(T)
    for A in vertices:
        A_z = turn @ A @ T + alpha * np.eye(n)
        unit = np.abs(A_z).max()
        block([-(A_z @ Q + Q @ A_z.T) / unit for Q in units] + none, np.zeros((n, n)))
    e = T[0] / e_max
    rows.append(np.array([[*(float(e @ Q @ e) for Q in units), *([0.0] * 9)]]))
    b.append(np.ones(1))
    cones.append(Cone("nonnegative", 1))
    for demand, best in zip(demands, lam, strict=True):
        h, S = T.T @ demand.h, T.T @ demand.S @ T
        mu, v = np.linalg.eigh(S / best + np.outer(h, h) / (4 * best * (demand.room - best)))
        G = (np.sqrt(np.maximum(mu, 0.0)) * v).T[mu > 1e-9 * mu.max()]
        if len(G):
            block([-G @ Q @ G.T for Q in units] + [np.zeros((len(G), len(G)))] * 9, np.eye(len(G)))
    lower = [(i, j) for i in range(n) for j in range(i + 1)]
    wide: list[Array] = []
    for Q in units:
        wide.append(np.block([[Q, np.zeros((n, n))], [np.zeros((n, n)), np.zeros((n, n))]]))
    for i, j in lower:
        Z = np.zeros((n, n))
        Z[i, j] = 1.0
        wide.append(np.block([[np.zeros((n, n)), Z], [Z.T, np.diag(np.diag(Z))]]))
    block(wide + [np.zeros((2 * n, 2 * n))] * 3, np.zeros((2 * n, 2 * n)))
    z = [6 + lower.index((i, i)) for i in range(n)]
    for x, y, mean in ((z[0], z[1], 12), (z[2], 14, 13), (12, 13, 14)):  # mean² <= x y
        spread = np.zeros((3, size))
        spread[0, [x, y]] = spread[1, x] = 1.0
        spread[1, y] -= 1.0
        spread[2, mean] += 2.0
        cone(spread, np.zeros(3))
    q = np.zeros(size)
    q[14] = -1.0
    program = ConicProgram(
        P=sp.csc_matrix((size, size)), q=q, A=sp.csc_matrix(np.vstack(rows)), b=np.concatenate(b), cones=cones
    )
    answer = Clarabel(program, tolerance=TOLERANCE, seconds=10.0).solve()
    return matrix(answer.x[:6]) if answer.solved else None


def _triangles(stack: Array) -> Array:
    """``triangle`` of each of many matrices (k, n, n)."""
    j, i = np.tril_indices(stack.shape[1])
    return np.asarray(stack[:, i, j] * np.where(i == j, 1.0, np.sqrt(2.0)))
