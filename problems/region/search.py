"""The search over e_max, the sequence of programs for each, and the ellipsoid that is proved in the end."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from design.model.environment import Scenario
from design.model.laws import Gains
from design.spec.setting import Setting
from problems.region.check import broken
from problems.region.loop import Loop, NoRegion, coarse, middle, posed
from problems.region.program import Asked, larger, multipliers

Array = NDArray[np.float64]

SHARE = 0.05
"""Of the linear loop's decay rate that is asked of V."""
STRICTER = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2)
"""Of the same, asked beyond alpha by the program, so that what is proved is strict: the first that serves."""
GRID = (0.05, 0.1, 0.2, 0.4, 0.8)
"""Bounds e_max [rad] that are tried first."""
PASSES = 25
"""Programs in a row for one e_max, at most."""
ROUGHLY = 1e-5
"""Part of the volume at which ellipsoids are compared."""
SECTIONS = 8
"""Steps of the golden section, at most."""
ENOUGH = 1e-4
"""Volumes that differ by less than this part end it."""
SHRINKS = (1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2)
"""By how much the semi-axes are shortened until the rounded ellipsoid is proved."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Region:
    """States (e, omega, w) [rad, rad/s, N m] with (e, omega, w) P (e, omega, w)ᵀ <= 1, from which the loop recovers.

    e = theta - ``theta_f`` [rad]; w = K_f s less its stationary value; ``P``, ``Q`` = P^-1 (3, 3). ``alpha`` [1/s]:
    V = xᵀ P x falls at least as exp(-2 alpha t); ``decay`` [1/s] is the linear loop's rate. ``e_max`` [rad] bounds |e|
    in it; ``multipliers`` belong to ``Loop.demands``. ``volume`` [rad² N m/s]. ``turn`` [rad] of ground under a body
    that was at rest; ``push`` [rad/s] from rest; ``angle`` [rad] with the integral at rest. ``strip`` [rad]: half the
    width of the capturable strip |e + omega/Omega| <= ell (F_T + F_H)/(A L), the load being that at rest; ``share`` of
    it that the region reaches. ``tried``: (e_max, volume) before rounding. ``scaled``: volume against that of the
    ellipsoid of Lyapunov's equation with equal weights, made as large as it may be.
    """

    scenario: str
    theta_f: float
    P: Array
    Q: Array
    e_max: float
    alpha: float
    decay: float
    multipliers: Array
    volume: float
    angle: float
    push: float
    turn: float
    Omega: float
    strip: float
    share: float
    load: float
    level: float
    scaled: float
    tried: tuple[tuple[float, float], ...]


def solve(setting: Setting, scenario: Scenario, gains: Gains, *, alpha: float | None = None) -> Region:
    """The region, proved; raises ``NoRegion`` where there is none or none was found.

    ``alpha`` [1/s]: the decay rate asked of V; ``SHARE`` of the linear loop's if left out.
    """
    setting.must_be_plain("a region")
    setting.must_not_load_the_foot("a region")
    loop = posed(setting, scenario, gains)
    decay = -float(np.linalg.eigvals(middle(loop.vertices(Fraction(1, 1000))[0])).real.max())
    if not decay > 0:
        message = "the linear loop is not stable, (27)-(29)"
        raise NoRegion(message)
    alpha = SHARE * decay if alpha is None else alpha
    if not 0 <= alpha < decay:
        message = f"a decay of {alpha:.4g} 1/s is asked, and that of the linear loop is {decay:.4g} 1/s"
        raise NoRegion(message)
    asked = alpha + STRICTER[0] * decay
    try:
        start = _lyapunov(loop, asked)
    except np.linalg.LinAlgError:
        message = "the numbers are too far apart for Lyapunov's equation in floats"
        raise NoRegion(message) from None
    tried: dict[float, Array] = {}
    for e_max in GRID:
        T = best(loop, e_max, asked, start, ROUGHLY)
        if T is not None:
            tried[e_max] = T
    if not tried:
        message = f"no ellipsoid falls at {alpha:.4g} 1/s for the sine's whole sector, or Clarabel found none"
        raise NoRegion(message)
    _refine(loop, tried, asked)
    e_max = max(tried, key=lambda each: _size(tried[each]))
    for stricter in STRICTER:
        T = best(loop, e_max, alpha + stricter * decay, tried[e_max])
        found = None if T is None else _proved(loop, T, e_max, alpha)
        if found is not None:
            return _region(loop, scenario.name, *found, e_max, alpha, decay, tried, start)
    message = "an ellipsoid was found, but not proved after rounding"
    raise NoRegion(message)


def best(loop: Loop, e_max: float, alpha: float, start: Array, until: float = 1e-7) -> Array | None:
    """T of the largest ellipsoid {T z: |z| <= 1} on |e| <= ``e_max``, from the shape ``start``; None if none is.

    The sequence ends when a program adds less than the part ``until`` to the semi-axes' product.
    """
    vertices, demands = _floats(loop, e_max)
    found = None
    try:
        T = _fitted(start, demands, e_max)
        for _ in range(PASSES):
            lam, _ = multipliers(T, demands)
            Q = larger(T, vertices, demands, lam, e_max, alpha)
            if Q is None:
                return found
            root = np.linalg.cholesky(Q)
            found = T = T @ root
            if abs(float(np.log(np.diag(root)).sum())) < until:
                break
    except (np.linalg.LinAlgError, ValueError):  # numbers too far apart: singular, or no longer finite
        return found
    return found


def _floats(loop: Loop, e_max: float) -> tuple[list[Array], list[Asked]]:
    """Vertices and demands for the search."""
    bound, loop = Fraction(e_max), coarse(loop)
    vertices = [middle(A) for A in loop.vertices(bound)]
    asked = [Asked(middle([each.h])[0], middle(each.S), float(each.room.low)) for each in loop.demands(bound)]
    return vertices, asked


def _fitted(T: Array, demands: Sequence[Asked], e_max: float) -> Array:
    """The shape of ``T`` as large as it may be."""
    low, high = 0.0, e_max / float(np.linalg.norm(T[0]))
    if _fits(high * T, demands):
        return high * T
    for _ in range(14):
        half = 0.5 * (low + high)
        low, high = (half, high) if _fits(half * T, demands) else (low, half)
    return low * T


def _fits(T: Array, demands: Sequence[Asked]) -> bool:
    return bool(multipliers(T, demands, 4)[1].max() <= 1)


def _lyapunov(loop: Loop, alpha: float) -> Array:
    """A shape to start with: of Lyapunov's equation for the linear loop, states weighed by what falls and turns."""
    A = middle(loop.vertices(Fraction(1, 1000))[0])
    unit = np.array([1.0, math.sqrt(abs(A[1, 0])), float(loop.K_p.high)])
    scaled = A * unit / unit[:, None] + alpha * np.eye(3)
    Q = scipy.linalg.solve_continuous_lyapunov(scaled, -np.eye(3))
    return np.asarray(unit[:, None] * np.linalg.cholesky(0.5 * (Q + Q.T)))


def _size(T: Array) -> float:
    return float(np.linalg.slogdet(T)[1])


def _refine(loop: Loop, tried: dict[float, Array], alpha: float) -> None:
    """What the best ellipsoid needs of its e_max, then golden section between the neighbours of the best e_max."""

    def size(e_max: float) -> float:
        if e_max not in tried:
            T = best(loop, e_max, alpha, tried[top], ROUGHLY)
            if T is None:
                return -math.inf
            tried[e_max] = T
        return _size(tried[e_max])

    top = max(tried, key=size)
    size(float(np.linalg.norm(tried[top][0])))
    top = max(tried, key=size)
    ordered = sorted(tried)
    at = ordered.index(top)
    low, high = ordered[max(at - 1, 0)], ordered[min(at + 1, len(ordered) - 1)]
    golden = 0.5 * (math.sqrt(5) - 1)
    left, right = high - golden * (high - low), low + golden * (high - low)
    for _ in range(SECTIONS):
        if abs(size(left) - size(right)) < ENOUGH:
            break
        if size(left) > size(right):
            high, right = right, left
            left = high - golden * (high - low)
        else:
            low, left = left, right
            right = low + golden * (high - low)
    top = max(tried, key=size)
    size(float(np.linalg.norm(tried[top][0])))


def _proved(loop: Loop, T: Array, e_max: float, alpha: float) -> tuple[Array, Array] | None:
    """P and the multipliers of the ellipsoid, shrunk until they are proved."""
    _, demands = _floats(loop, e_max)
    for shrink in SHRINKS:
        smaller = (1 - shrink) * T
        inverse = np.linalg.inv(smaller)
        P = inverse.T @ inverse
        P = 0.5 * (P + P.T)
        lam, _ = multipliers(smaller, demands)
        if not broken(loop, P, e_max, alpha, lam.tolist()):
            return P, lam
    return None


def _region(
    loop: Loop,
    name: str,
    P: Array,
    lam: Array,
    e_max: float,
    alpha: float,
    decay: float,
    tried: dict[float, Array],
    start: Array,
) -> Region:
    Q = np.linalg.inv(P)
    Q = 0.5 * (Q + Q.T)
    number = {
        each: float(middle([[getattr(loop, each)]])[0, 0]) for each in ("A", "L", "I", "ell", "K_p", "load", "level")
    }
    AL = number["A"] * number["L"]
    Omega, strip = math.sqrt(AL / number["I"]), number["ell"] * number["load"] / AL
    fall, turn = np.array([1.0, 1.0 / Omega, 0.0]), np.array([1.0, 0.0, number["K_p"]])
    ball = 4 / 3 * math.pi
    volume = ball / math.sqrt(float(np.linalg.det(P)))
    plain = _size(_fitted(start, _floats(loop, e_max)[1], e_max))
    at_rest = math.sqrt(float(turn @ P @ turn))
    return Region(
        scenario=name, theta_f=loop.theta_f, P=P, Q=Q, e_max=e_max, alpha=alpha, decay=decay, multipliers=lam,
        volume=volume, angle=1 / math.sqrt(P[0, 0]), push=1 / math.sqrt(P[1, 1]), turn=1 / at_rest,
        Omega=Omega, strip=strip, share=math.sqrt(float(fall @ Q @ fall)) / strip, load=number["load"],
        level=number["level"], scaled=volume / (ball * math.exp(plain)),
        tried=tuple(sorted((each, ball * math.exp(_size(T))) for each, T in tried.items())),
    )  # fmt: skip
