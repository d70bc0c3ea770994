"""The loop with the torque held over a sampling period: its matrix, and the longest period that it bears.

A period is borne while every eigenvalue is inside the unit circle. The first to leave does so at -1, at +1, or as a
pair; each of the three is the first zero of a smooth function of the period,

    det(1 + Phi),    det(1 - Phi),    the product of 1 - lambda_i lambda_j over all pairs i < j

so that where the gains change which comes first, the row has a kink but its three parts do not. Where such a function
has a minimum that comes down to zero, there is an exit at once where none was, and the row jumps.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.model.body import Biped
from design.model.broken_loop import breaks, effective_gain
from design.model.laws import Gains, LawKind, swing

Array = NDArray[np.float64]

GROWTH = 1.01
"""Ratio of neighbouring periods in the search for the first that is too long."""
AT_ONCE = 192
"""Periods whose eigenvalues are found together."""
ROUNDS = 11
"""Of narrowing sixteenfold between two of them: to the last digit."""
BEYOND = 1.5
"""How far past the first exit the others are looked for, as a factor."""


def sampled_matrix(
    biped: Biped,
    kind: LawKind,
    K: Gains,
    A: float,
    load: float,
    period: float | Array,
    adapt: float = math.inf,
    beta: float = 0.0,
) -> Array:
    """The loop over one ``period`` [s] with the torque held: exact, for the states (theta, omega, s), and eta.

    The law reads the states at the beginning of the period; its integral goes on by itself, as a force plate's does.
    A law that adapts is taken as ``design.model.laws.AdaptingLaw`` is: both integrals by Euler's rule from the forces
    that are read, which still are those of the torque before; it is the fifth state. For several periods (n,) a matrix
    for each, (n, m, m).
    """
    T = np.asarray(period, dtype=float)
    Omega = math.sqrt(max(A * biped.L / biped.I, 1e-12))
    c, sh = np.cosh(Omega * T), np.sinh(Omega * T)
    free = _matrices([[c, sh / Omega], [Omega * sh, c]])
    push = _matrices([[(c - 1.0) / (Omega**2 * biped.I)], [sh / (Omega * biped.I)]])
    if math.isfinite(adapt):
        return _adapting_matrix(biped, K, A, T, adapt, beta, free, push)
    if kind == "pd":
        return np.asarray(free + push * [-K.K_p, -K.K_d])
    torque = [-K.K_p, -K.K_d, effective_gain(biped, kind, K.K_f, load)]
    zero = np.zeros_like(T)
    gathered = beta / biped.ell * (free[..., 1, :] - [0.0, 1.0])  # theta'' gathered is the change of the rate
    open_loop = _matrices([[c, sh / Omega, zero], [Omega * sh, c, zero], [*np.moveaxis(gathered, -1, 0), zero + 1.0]])
    gather = (T[..., None, None] + beta * push[..., 1:, :]) / biped.ell
    return np.asarray(open_loop + np.concatenate([push, gather], axis=-2) * torque)


def _matrices(entries: list[list[Any]]) -> Array:
    """Of entries () or (n,), a matrix, or n of them."""
    return np.stack([np.stack(row, axis=-1) for row in entries], axis=-2)


def _adapting_matrix(
    biped: Biped, K: Gains, A: float, T: Array, adapt: float, beta: float, free: Array, push: Array
) -> Array:
    """For the states theta, omega, s, eta, and the torque of the last period."""
    b, lever = swing(biped, adapt), biped.M * biped.g * biped.L
    torque = np.array([-K.K_p, -K.K_d - K.K_p * b, K.K_f, K.K_p, 0.0])
    told, swung = 1.0 + beta / biped.I, beta * A * biped.L / biped.I  # tau + beta theta'' by tau and theta
    found = np.zeros((*T.shape, 5, 5))
    found[..., :2, :2] = free
    found[..., :2, :] += push * torque
    found[..., 2, [0, 4]] = T[..., None] / biped.ell * np.array([swung, told])
    found[..., 2, 2] = 1.0
    found[..., 3, :] = T[..., None] / adapt * np.array([1.0 + swung / lever, b, 0.0, -1.0, told / lever])
    found[..., 3, 3] += 1.0
    found[..., 4, :] = torque
    return found


def stability_functions(
    biped: Biped,
    kind: LawKind,
    K: Gains,
    A: float,
    load: float,
    periods: Array,
    adapt: float = math.inf,
    beta: float = 0.0,
) -> Array:
    """The three functions (n, 3) at ``periods`` (n,) [s]; all are positive where the held loop is stable."""
    matrices = sampled_matrix(biped, kind, K, A, load, periods, adapt, beta)
    eigenvalues = np.linalg.eigvals(matrices).astype(complex)
    i, j = np.triu_indices(eigenvalues.shape[1], 1)
    pairs = np.prod(1 - eigenvalues[:, i] * eigenvalues[:, j], axis=1)
    return np.stack([np.prod(1 + eigenvalues, axis=1), np.prod(1 - eigenvalues, axis=1), pairs], axis=1).real


class Exit(NamedTuple):
    """Where function ``which`` (0, 1, 2) is first zero, or, with a ``gap``, where it has a minimum of that value.

    A gap below zero is of a minimum that comes after the zero.
    """

    which: int
    period: float
    gap: float | None


def longest_period(
    biped: Biped, kind: LawKind, K: Gains, A: float, load: float, adapt: float = math.inf, beta: float = 0.0
) -> float:
    """The sampling period [s] at which the held loop first leaves the unit circle; stable at every shorter one.

    Infinite if there is none; raises ``ValueError`` if the loop is unstable.
    """
    found = exits(biped, kind, K, A, load, adapt, beta)
    return min((each.period for each in found if each.gap is None), default=math.inf)


def exits(
    biped: Biped, kind: LawKind, K: Gains, A: float, load: float, adapt: float = math.inf, beta: float = 0.0
) -> list[Exit]:
    """What the longest period is the shortest of, and where an eigenvalue nearly leaves the circle before it does.

    Where a gap closes the longest period jumps. Sought upward in steps of one per cent as far as ``BEYOND`` the first
    exit, and then between the steps; raises ``ValueError`` if the loop is unstable.
    """

    def functions(periods: Array) -> Array:
        return stability_functions(biped, kind, K, A, load, periods, adapt, beta)

    broken = breaks(biped, kind, K, A, load, adapt, beta)["actuator"]
    fastest = float(np.abs((broken.P + broken.Q).roots()).max())
    first = 1e-3 / fastest
    if np.abs(np.linalg.eigvals(sampled_matrix(biped, kind, K, A, load, first, adapt, beta))).max() >= 1:
        message = "the loop is not stable; no sampling period keeps it so"
        raise ValueError(message)
    periods = np.array([first])
    rows = functions(periods)
    end = 1e4 / fastest
    while periods[-1] < end:
        further = periods[-1] * GROWTH ** np.arange(1.0, AT_ONCE + 1)
        periods, rows = np.append(periods, further), np.vstack([rows, functions(further)])
        if (out := (rows <= 0).any(axis=1)).any():
            end = min(end, BEYOND * float(periods[np.argmax(out)]))
    return [each for which, row in enumerate(rows.T) for each in _exits(functions, which, periods, row)]


def _exits(functions: Callable[[Array], Array], which: int, periods: Array, row: Array) -> list[Exit]:
    """The first zero and the minima of one of the ``functions``, whose values at ``periods`` (n,) are ``row``."""

    def function(T: Array) -> Array:
        return functions(T)[:, which]

    found = []
    brackets = []
    for k in 1 + np.flatnonzero((row[1:-1] < row[:-2]) & (row[1:-1] <= row[2:])):
        least = Exit(which, *_least(function, periods[k - 1], periods[k + 1]))
        found.append(least)
        if least.gap is not None and least.gap <= 0 < row[k]:  # below zero between the steps only
            brackets.append((periods[k - 1], least.period))
    if (row <= 0).any():
        first = int(np.argmax(row <= 0))
        brackets.append((periods[first - 1], periods[first]))
    if brackets:
        found.append(Exit(which, _zero(function, *min(brackets)), None))
    return found


def _zero(function: Callable[[Array], Array], low: float, high: float) -> float:
    """Where ``function``, positive at ``low`` and not at ``high``, is zero; approached from below."""
    for _ in range(ROUNDS):
        places = np.linspace(low, high, 17)
        k = int(np.argmax(np.append(function(places[1:-1]) <= 0, True)))
        low, high = places[k], places[k + 1]
    return float(low)


def _least(function: Callable[[Array], Array], low: float, high: float) -> tuple[float, float]:
    """Where ``function`` is least between ``low`` and ``high``, and how small."""
    for _ in range(ROUNDS // 2):
        places = np.linspace(low, high, 17)
        value = function(places)
        k = int(np.clip(np.argmin(value), 1, 15))
        low, high = places[k - 1], places[k + 1]
    return float(places[k]), float(value[k])
