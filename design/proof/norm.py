"""Norms in which the error of an approximate trajectory is followed, and the proof of how it falls.

In coordinates z = S x, cut into blocks, |z_b| is Euclid's norm of a block. With K = S J S^-1 for the Jacobian J,

    |z_b|' <= -rate_b |z_b| + sum of coupling_bc |z_c| over the other blocks c + |S_b defect|

where -rate_b bounds the largest eigenvalue of the symmetric part of K_bb, and coupling_bc the size of K_bc (a vector of
norms: Matrosov, Bellman; with one block the logarithmic norm of Dahlquist 1958). Blocks keep a slow pole from a fast
one: what hits the fast one is forgotten at the fast one's rate. J is affine in each of a few numbers
(``design.proof.jacobian``); both bounds are convex in J, and so hold for a range of them if they hold at its corners.
There they are decided in exact rational arithmetic, floats being taken as the rationals that they are. Which S is tried
is a matter of luck and experience; that it serves is proved.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
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
Integers = list[list[int]]

SHARES = (0.1, 0.3, 0.5, 0.65, 0.8, 0.9, 0.97)
"""Parts of the decay rate at which a norm is looked for."""
EPS = 4 * np.finfo(float).eps
"""About what a sum of a few products is rounded by, in parts of the sum of their sizes."""
LOST = 0.7
"""Of the rate that a norm had for narrower ranges it must keep so much to be taken again."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Norm:
    """``S`` (n, n), the sizes of its ``blocks``, their ``rates`` (b,) [1/s] and ``couplings`` (b, b) [1/s]."""

    S: Array
    blocks: tuple[int, ...]
    rates: Array
    couplings: Array

    @property
    def members(self) -> Array:
        """(b, n): 1 where a coordinate belongs to a block."""
        return np.repeat(np.eye(len(self.blocks)), self.blocks, axis=1)


class Frame(NamedTuple):
    """Coordinates to try: ``S`` (n, n), the sizes of its ``blocks``, and about the rate at which each falls [1/s]."""

    S: Array
    blocks: tuple[int, ...]


def contracting(
    case: Case, over: Ranges, defects: Array, h: Array, deadline: float, before: Norm | None = None, *,
    single: bool = False,
) -> Norm:  # fmt: skip
    """A norm proved for all Jacobians of these ranges; raises ``NotProved``, ``OutOfTime``.

    Of those that are tried it is the one in which ``defects`` (n, m) in pieces of lengths ``h`` (n,) [s] move toe and
    heel force least; the one that served ``before``, for narrower ranges, if it still does. ``single``: of one block.
    """
    exact = [jacobian(case, *corner) for corner in over.corners()]
    corners = np.stack([_floats(J) for J in exact])
    middle = _floats(jacobian(case, *over.middle()))
    decay = -float(np.linalg.eigvals(middle).real.max())
    if decay <= 0:
        message = "the linear loop is not stable"
        raise NotProved(message)
    if before is not None:
        again = _bounded(Frame(before.S, before.blocks), corners)
        if again is not None and (again.rates > LOST * before.rates).all() and holds(again, exact):
            return again
    felt, defect = case.felt, _lasting(defects, h, decay)
    tried = [] if single else _modal(middle)
    matrices = _of_lyapunov(middle, felt)
    few = [_floats(jacobian(case, *corner)) for corner in over.chief().corners()]
    for share in SHARES if case.kind != "cop" else SHARES[1::2]:
        left = deadline - time.monotonic()
        if left <= 0:
            raise OutOfTime
        P = _optimal(few, felt, defect, share * decay, min(left, 2.0))
        matrices += [P] if P is not None else []
    best = _best_single(np.stack(matrices), corners, felt, defect)
    tried += [Frame(np.asarray(np.linalg.cholesky(best).T), (len(felt),))] if best is not None else []
    choices: list[tuple[float, Norm]] = []
    for frame in tried:
        norm = _bounded(frame, corners)
        if norm is not None:
            choices.append((_effect(norm, felt, defects, h), norm))
    choices.sort(key=lambda choice: choice[0])
    found = next((norm for cost, norm in choices[:3] if cost < math.inf and holds(norm, exact)), None)
    if found is None:
        message = "no norm in which the loop contracts over the whole tube and box was found"
        raise NotProved(message)
    return found


def _bounded(frame: Frame, corners: Array) -> Norm | None:
    """The norm with the least rates and couplings that the ``corners`` (k, n, n) allow, in floats; None if it grows."""
    S, blocks = frame
    back = np.linalg.inv(S)
    K = S @ corners @ back
    rounding = EPS * (np.abs(S) @ np.abs(corners).max(axis=0) @ np.abs(back) @ np.abs(S) @ np.abs(back))
    edges = np.cumsum([0, *blocks])
    rates, couplings = np.zeros(len(blocks)), np.zeros((len(blocks), len(blocks)))
    for b, its in enumerate(map(slice, edges[:-1], edges[1:])):
        own = K[:, its, its]
        rates[b] = -0.49995 * float(np.linalg.eigvalsh(own + own.transpose(0, 2, 1)).max()) - rounding[its, its].sum()
        for c, other in enumerate(map(slice, edges[:-1], edges[1:])):
            if c != b:
                size = math.sqrt(float((K[:, its, other] ** 2).sum(axis=(1, 2)).max()))
                couplings[b, c] = 1.0001 * size + rounding[its, other].sum() + 1e-300
    if not (rates > 0).all() or not np.isfinite(couplings).all():
        return None
    gain = couplings / rates[:, None]
    if np.abs(np.linalg.eigvals(gain)).max() >= 1:
        return None
    return Norm(S=S, blocks=blocks, rates=rates, couplings=couplings)


def _effect(norm: Norm, felt: Array, defects: Array, h: Array) -> float:
    """About how far a defect moves the torque [N m]."""
    slow = np.array([_lasting(defects, h, rate) for rate in norm.rates])  # what each block has to bear
    moved = [
        math.sqrt(float(((np.abs(norm.S) @ slow[b]) ** 2 * members).sum())) for b, members in enumerate(norm.members)
    ]
    far = np.linalg.solve(np.diag(norm.rates) - norm.couplings, np.array(moved))
    each = np.sqrt(((felt_signed(felt) @ np.linalg.inv(norm.S)) ** 2 * norm.members).sum(axis=1))
    return float(each @ far) if (far >= 0).all() else math.inf


def felt_signed(felt: Array) -> Array:
    """How tau changes with each state: minus K_p, minus K_d, K_f, K_p."""
    return np.asarray(felt * np.array([-1.0, -1.0, 1.0, 1.0])[: len(felt)])


def _lasting(defects: Array, h: Array, decay: float) -> Array:
    """The constant defect (m,) [1/s] that, falling away at the rate ``decay``, sums up to as much as ``defects`` do."""
    left = np.exp(-decay * h)
    added = 2 * defects * np.minimum(1.0, 1.0 / np.maximum(decay * h, 1e-12))[:, None]
    most = [0.0] * defects.shape[1]
    for j, column in enumerate(added.T.tolist()):
        now = 0.0
        for less, more in zip(left.tolist(), column, strict=True):
            now = now * less + more
            if now > most[j]:
                most[j] = now
    return np.asarray(np.array(most) * decay)


def _best_single(tried: Array, corners: Array, felt: Array, defect: Array) -> Array | None:
    """Of the matrices ``tried`` (c, n, n) the one in whose norm the defect moves the forces least, in floats."""
    tried = tried[np.isfinite(tried).all(axis=(1, 2))]
    tried = tried / np.trace(tried, axis1=1, axis2=2)[:, None, None]
    tried = tried[np.linalg.eigvalsh(tried)[:, 0] > 1e-16]
    roots = np.linalg.inv(np.linalg.cholesky(tried).transpose(0, 2, 1))
    PJ = tried[:, None] @ corners[None]
    moved = roots.transpose(0, 2, 1)[:, None] @ (PJ + PJ.transpose(0, 1, 3, 2)) @ roots[:, None]
    rates = -0.5 * np.linalg.eigvalsh(moved).max(axis=(1, 2))
    tried, rates = tried[rates > 0], rates[rates > 0]
    if not len(tried):
        return None
    pushed = np.einsum("i,cij,j->c", defect, np.abs(tried), defect)
    signed = felt_signed(felt)
    cost = np.sqrt(pushed * np.einsum("i,cij,j->c", signed, np.linalg.inv(tried), signed)) / rates
    return np.asarray(tried[int(np.nanargmin(cost))])


def _of_lyapunov(middle: Array, felt: Array) -> list[Array]:
    decay = -float(np.linalg.eigvals(middle).real.max())
    weights, eye = np.stack(_weights(middle, felt)), np.eye(len(middle))
    found = []
    for share in SHARES:
        A = middle + share * decay * eye
        P = np.linalg.solve(np.kron(eye, A.T) + np.kron(A.T, eye), -weights.reshape(len(weights), -1).T)
        found += [0.5 * (each + each.T) for each in P.T.reshape(weights.shape)]
    return found


def _modal(middle: Array) -> list[Frame]:
    """Coordinates in which groups of poles next to each other do not mix, however different their rates are.

    The states are split into the invariant subspaces of the groups (ordered Schur forms, which stand poles that are
    all but equal); a group of one pole is a coordinate, one of several has a norm by Lyapunov's equation.
    """
    n = len(middle)
    found = []
    for cuts in _cuts(np.sort(-np.linalg.eigvals(middle).real)):
        bases = [basis for low, high in cuts if (basis := _invariant(middle, low, high)) is not None]
        Q = np.column_stack(bases)
        if len(bases) < len(cuts) or Q.shape[1] != n or not np.linalg.cond(Q) < 1e12:
            continue
        T, blocks = np.linalg.inv(Q), tuple(basis.shape[1] for basis in bases)
        for share in SHARES if max(blocks) > 1 else SHARES[:1]:
            rows, at = [], 0
            for size in blocks:
                its = slice(at, at + size)
                own = T[its] @ middle @ Q[:, its]
                decay = -float(np.linalg.eigvals(own).real.max())
                P = np.eye(1) if size == 1 else _lyapunov(own + share * decay * np.eye(size), np.eye(size))
                rows.append(np.linalg.cholesky(P).T @ T[its])
                at += size
            found.append(Frame(np.vstack(rows), blocks))
    return found


def _cuts(decays: Array) -> list[list[tuple[float, float]]]:
    """The ways to cut sorted decay rates into groups: ranges of rates, at gaps between neighbours that differ."""
    gaps = [k for k in range(1, len(decays)) if decays[k] > 1.001 * abs(decays[k - 1])]
    found = []
    for some in (some for r in range(1, len(gaps) + 1) for some in combinations(gaps, r)):
        edges = [-math.inf, *(0.5 * float(decays[k - 1] + decays[k]) for k in some), math.inf]
        found.append(list(pairwise(edges)))
    return found


def _invariant(matrix: Array, low: float, high: float) -> Array | None:
    """An orthonormal basis (n, k) of the invariant subspace of poles that decay at rates from ``low`` to ``high``."""
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


def _optimal(corners: Sequence[Array], felt: Array, defect: Array, rate: float, seconds: float) -> Array | None:
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


def transfer(before: Norm, after: Norm) -> Array:
    """Numbers C (b, c) with |z_b| after <= sum of C_bc |z_c| before, for all x."""
    there, back = np.abs(after.S), inverted(before.S)
    product = np.abs(after.S @ back) + 1e-13 * there @ np.abs(back)
    return np.asarray(UP * np.sqrt(UP * after.members @ product**2 @ before.members.T + TINY))


def settled(K: Array) -> Array:
    """Matrices M >= (1 - K)^-1 >= 0 for ``K`` (n, b, b) >= 0; raises ``NotProved`` where the sum of K^j has no limit.

    That (1 - K) M >= 1 with M >= 0 shows both: 1 - K is an M-matrix (Berman and Plemmons 1994, theorem 6.2.3).
    """
    eye = np.eye(K.shape[1])
    about = np.maximum(np.linalg.inv(eye - K), 0.0)
    inverse = about + 1e-7 * (about + about @ (K @ about))
    shown = inverse - K @ inverse - 1e-13 * (inverse + K @ inverse)
    if not ((inverse >= 0).all() and (shown >= eye).all()):
        message = "the blocks of the norm drive each other"
        raise NotProved(message)
    return np.asarray(inverse)


def falls(x: Array) -> tuple[Array, Array]:
    """Bounds (n,) of exp(-x) for 0 <= ``x`` (n,): of exp(x/1024) by its series, and that to the 1024th power."""
    y = np.minimum(x, 700.0) / 1024
    series = 1 + y * (1 + y / 2 * (1 + y / 3 * (1 + y / 4)))
    more = series + y**5 / 50  # exp(y) < 2 in the remainder
    least, most = (1 / part for part in (more, series))
    for _ in range(10):
        least, most = least * least, most * most
    return np.where(x <= 700.0, least / UP, 0.0), most * UP


def inverted(S: Array) -> Array:
    """S^-1, each entry rounded away from zero from the exact one."""
    whole, scale = _integers(_rational(S))
    adjugate, determinant = _adjugate(whole)
    exact = np.array([[float(Fraction(entry * scale, determinant)) for entry in row] for row in adjugate])
    return np.asarray(exact + np.sign(exact) * np.abs(exact) * 1e-15)


def holds(norm: Norm, jacobians: Sequence[Array | Matrix]) -> bool:
    """Whether the rates and couplings of a norm are right for all these Jacobians, decided in whole numbers."""
    S, _ = _integers(_rational(norm.S))
    adjugate, determinant = _adjugate(S)
    if not determinant:
        return False
    if determinant < 0:
        adjugate, determinant = [[-entry for entry in row] for row in adjugate], -determinant
    edges = np.cumsum([0, *norm.blocks]).tolist()
    blocks = [range(*pair) for pair in pairwise(edges)]
    rates = [Fraction(float(rate)) for rate in norm.rates]
    couplings = [[Fraction(float(each)) for each in row] for row in norm.couplings]
    for J in jacobians:
        whole, scale = _integers(_rational(J))
        K, unit = _product(_product(S, whole), adjugate), scale * determinant  # S J S^-1 in parts of the unit
        for b, its in enumerate(blocks):
            top, bottom = 2 * rates[b].numerator * unit, rates[b].denominator
            if not _positive([[-(K[i][j] + K[j][i]) * bottom - (top if i == j else 0) for j in its] for i in its]):
                return False
            for c, other in enumerate(blocks):
                most = couplings[b][c]
                size = sum(K[i][j] ** 2 for i in its for j in other) * most.denominator**2
                if c != b and size > (most.numerator * unit) ** 2:
                    return False
    return True


def _rational(matrix: Array | Matrix) -> Matrix:
    return [[Fraction(entry) for entry in row] for row in matrix]


def _integers(matrix: Matrix) -> tuple[Integers, int]:
    """The matrix times the least number that makes it whole, and that number."""
    scale = math.lcm(*(entry.denominator for row in matrix for entry in row))
    return [[entry.numerator * (scale // entry.denominator) for entry in row] for row in matrix], scale


def _adjugate(matrix: Integers) -> tuple[Integers, int]:
    """The matrix of cofactors, transposed, and the determinant."""
    n = len(matrix)

    def cofactor(i: int, j: int) -> int:
        minor = [row[:j] + row[j + 1 :] for k, row in enumerate(matrix) if k != i]
        return int((-1) ** (i + j) * (_determinant(minor) if minor else 1))

    return [[cofactor(i, j) for i in range(n)] for j in range(n)], _determinant(matrix)


def _product(a: Integers, b: Integers) -> Integers:
    columns = list(zip(*b, strict=True))
    return [[sum(x * y for x, y in zip(row, column, strict=True)) for column in columns] for row in a]


def _positive(matrix: Integers) -> bool:
    """Whether a symmetric matrix is positive definite, by its leading minors."""
    return all(_determinant([row[:size] for row in matrix[:size]]) > 0 for size in range(1, len(matrix) + 1))


def _determinant(matrix: Integers) -> int:
    if len(matrix) == 1:
        return matrix[0][0]
    return sum(
        (-1) ** c * matrix[0][c] * _determinant([row[:c] + row[c + 1 :] for row in matrix[1:]])
        for c in range(len(matrix)) if matrix[0][c]
    )  # fmt: skip
