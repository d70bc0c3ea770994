"""How much of an error in its start a trial leaves: rho(T), and from which T on it stays below a level.

    rho(T) = [1 0 0] expm(B T) (1, 0, K_p)'

with B and what it means as in ``design.analysis.contraction``.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from design.analysis.exponential import exponential
from design.model.body import Biped
from design.model.laws import Gains, LawKind
from design.model.stability import closed_loop_matrix

Array = NDArray[np.float64]

FINEST = 20_000
"""The most instants at which the factors are compared with a level."""


def iteration(
    biped: Biped,
    kind: LawKind,
    K: Gains,
    A: float,
    load: float,
    adapt: float = math.inf,
    known: Biped | None = None,
) -> tuple[Array, Array]:
    """B (3, 3) and the start (1, 0, K_p) of an error of 1 in the states (theta, omega, K_f s).

    Of a law that adapts within ``adapt`` [s], reckoning with the body that is ``known`` to it, (23) itself and
    (1, 0, 0, 1) in the states (theta, omega, s, eta).
    """
    if math.isfinite(adapt):
        return closed_loop_matrix(biped, kind, K, A, load, adapt, known), np.array([1.0, 0.0, 0.0, 1.0])
    if kind == "pd":
        gather = 0.0
    elif kind == "cop":  # s' = tau/load, and the gain of s is K_f (M + m) g/ell (20)
        gather = K.K_f * biped.weight / (biped.ell * load)
    else:
        gather = K.K_f / biped.ell
    B = [
        [0.0, 1.0, 0.0],
        [(A * biped.L - K.K_p) / biped.I, -K.K_d / biped.I, 1.0 / biped.I],
        [-gather * K.K_p, -gather * K.K_d, gather],
    ]
    return np.array(B), np.array([1.0, 0.0, K.K_p])


def factor(
    biped: Biped,
    kind: LawKind,
    K: Gains,
    A: float,
    load: float,
    T: float,
    adapt: float = math.inf,
    known: Biped | None = None,
) -> float:
    """rho(T): the part of a small error in the start that a trial of ``T`` [s] leaves."""
    B, start = iteration(biped, kind, K, A, load, adapt, known)
    return float(factors(B[None], start[None], np.array([T]))[0])


def stays_below(B: Array, start: Array, level: float) -> float | None:
    """The shortest T [s] from which every |rho(T)| stays below ``level``; None if one of them never does.

    ``B`` (n, 3, 3), ``start`` (n, 3). Sought on a grid of twenty instants a half period or more, up to where the sum of
    the modes' sizes is below the level; then bisected.
    """
    modes, vectors = np.linalg.eig(B)
    if not (modes.real < -1e-12 * np.abs(modes)).all() or not (modes != 0).all():
        return None
    try:
        sizes = np.abs(vectors[:, 0, :] * np.linalg.solve(vectors, start[:, :, None].astype(complex))[:, :, 0])
    except np.linalg.LinAlgError:
        sizes = np.full(modes.shape, 1e8)
    decay = -modes.real.max(axis=1)
    horizon = float((np.log(np.maximum(sizes.sum(axis=1) / level, 1.0 + 1e-9)) / decay).max())
    count = max(2000, math.ceil(20 * horizon * float(np.abs(modes.imag).max()) / math.pi))
    count = min(count, FINEST)
    step = horizon / count
    onward, state, last, over = exponential(B * step), start, 0, np.ones(len(B), dtype=bool)
    for k in range(1, count + 1):
        state = np.einsum("nij,nj->ni", onward, state)
        above = np.abs(state[:, 0]) >= level
        if above.any():
            last, over = k, above
    B, start = B[over], start[over]

    def largest(T: float) -> float:
        return float(np.abs(factors(B, start, np.full(len(B), T))).max())

    low, high = last * step, (last + 1) * step
    while high - low > 1e-6 * horizon:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if largest(middle) >= level else (low, middle)
    return high


def factors(B: Array, start: Array, T: Array) -> Array:
    """The factors rho (n,) of ``B`` (n, 3, 3) and ``start`` (n, 3), each at its own T (n,)."""
    return np.asarray(np.einsum("nj,nj->n", exponential(B * T[:, None, None])[:, 0], start))
