"""For every slope, not only one: the largest CoP excursion that any slope profile of bounded rate can cause.

In the linear loop about level ground the CoP follows the slope rate r = d alpha/dt through

    P(s)/r(s) = (A L/N) (K_d s + K_p) / (I (s³ + p_2 s² + p_1 s + p_0)),   A = M g,  N = (M + m) g,

so that |P| <= ||h||_1 max|r|, h being the impulse response, and the profile r(t) = max|r| sign h(T - t) attains it in
the limit of a long T (peak-to-peak gain: Desoer and Vidyasagar 1975; Boyd and Barratt 1991, section 5.2).

The norm is not a sampled sum. Between two neighbouring sign changes the integral of h is a difference of its
antiderivative; all sign changes are found, because h divided by one real mode exp(lambda_1 t) is monotone between the
zeros of a two-mode response, which are known in closed form. What comes after the last one is bounded by a Lyapunov
function.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from design.analysis.exponential import exponential
from design.model.body import Biped
from design.model.broken_loop import effective_gain
from design.model.laws import Gains, LawKind

Array = NDArray[np.float64]

TOLERANCE = 1e-6
"""Relative width of the bracket of the norm."""
SPANS = 40
"""Stretches of five slowest time constants after which the impulse response is given up."""
TURNS = 1_000
"""Sign changes of h beyond which the loop is not followed."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PeakGain:
    """``gain`` is the L1 norm [m s/rad], at most ``error`` below the true one; ``switches`` (n,) the zeros of h [s].

    ``first`` is the sign of h just after t = 0; ``horizon`` the time after which h is bounded and no more followed [s].
    """

    gain: float
    error: float
    switches: Array
    first: float
    horizon: float


def peak_gain(biped: Biped, kind: LawKind, K: Gains, tolerance: float = TOLERANCE) -> PeakGain:
    """The peak-to-peak gain from slope rate [rad/s] to CoP [m]; raises ``ValueError`` for an unstable loop.

    For law pd, whose CoP does not return to zero, the gain is infinite: ``ValueError`` as well.
    """
    if kind == "pd":
        message = "under law pd the CoP stays displaced on every slope; no slope rate is small enough"
        raise ValueError(message)
    A, B, C = _response(biped, kind, K)
    if not (np.isfinite(A).all() and np.isfinite(C).all()):
        message = "the linear loop is not finite"
        raise ValueError(message)
    poles = np.linalg.eigvals(A)
    if poles.real.max() >= 0:
        message = "the loop is not stable"
        raise ValueError(message)
    X = _lyapunov(A)
    weight = float(np.sqrt(C @ np.linalg.solve(X, C)))
    slowest = 2.0 * float(np.linalg.eigvalsh(X).max())
    steady = np.linalg.solve(A, B)  # antiderivative of h: C exp(A t) A^-1 B

    def h(t: float) -> float:
        return float(C @ _expm(A * t) @ B)

    def antiderivative(t: float) -> float:
        return float(C @ _expm(A * t) @ steady)

    real = float(poles[np.argmin(np.abs(poles.imag))].real)
    turns = _Turns(A, B, C, real)
    span = 5.0 / float(-poles.real.max())
    total, begin = 0.0, 0.0
    switches: list[float] = []
    last = antiderivative(0.0)
    for _ in range(SPANS):
        end = begin + span
        edges = [begin, *turns.between(begin, end), end]
        for left, right in pairwise(edges):
            zero = _zero(h, left, right)
            if zero is not None and (not switches or zero > switches[-1] + 1e-12):
                switches.append(zero)
                now = antiderivative(zero)
                total, last = total + abs(now - last), now
        state = _expm(A * end) @ B
        tail = weight * float(np.sqrt(state @ X @ state)) * slowest
        here = antiderivative(end)
        if tail <= tolerance * (total + abs(here - last)):
            break
        if len(switches) > TURNS:
            message = f"the impulse response changes its sign more than {TURNS:,} times before it dies out"
            raise ValueError(message)
        begin = end
    else:
        message = "the impulse response does not die out within reach of the tolerance"
        raise ValueError(message)
    return PeakGain(
        gain=total + abs(here - last),
        error=tail,
        switches=np.array(switches),
        first=math.copysign(1.0, h(1e-9 * span)),
        horizon=end,
    )


def worst_profile(peak: PeakGain, rate: float) -> Array:
    """The slope profile that attains the bound at its end, (n, 2): time [s], slope [rad], at ``rate`` [rad/s]."""
    switches = peak.switches[peak.switches < peak.horizon]
    edges = np.concatenate([[0.0], switches, [peak.horizon]])
    signs = peak.first * (-1.0) ** np.arange(len(edges) - 1)
    lengths = np.diff(edges)[::-1]  # h is read backwards
    slopes = np.concatenate([[0.0], np.cumsum(rate * signs[::-1] * lengths)])
    return np.column_stack([np.concatenate([[0.0], np.cumsum(lengths)]), slopes])


def _response(biped: Biped, kind: LawKind, K: Gains) -> tuple[Array, Array, Array]:
    """(A, B, C) of P/r in controllable form."""
    I, ell, load = biped.I, biped.ell, biped.weight
    AL = biped.M * biped.g * biped.L
    K_f = effective_gain(biped, kind, K.K_f, load)
    p = np.array([K_f * AL / (I * ell), (K.K_p - AL) / I, K.K_d / I - K_f / ell])
    A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], -p])
    B = np.array([0.0, 0.0, 1.0])
    C = AL / (load * I) * np.array([K.K_p, K.K_d, 0.0])
    scale = np.diag([1.0, 1.0 / (s := float(np.cbrt(abs(p[0])) or 1.0)), 1.0 / s**2])  # balance the powers of s
    inverse = np.linalg.inv(scale)
    return scale @ A @ inverse, scale @ B, C @ inverse


class _Turns:
    """Where h exp(-lambda_1 t) turns: zeros of y = C (A - lambda_1) exp(A t) B, in which the mode lambda_1 is gone."""

    def __init__(self, A: Array, B: Array, C: Array, lambda_1: float) -> None:
        D = C @ (A - lambda_1 * np.eye(3))
        self._y, self._dy = float(D @ B), float(D @ A @ B)
        trace = float(np.trace(A)) - lambda_1
        product = float(np.linalg.det(A)) / lambda_1
        self._half = -0.5 * trace  # y'' + 2 half y' + product y = 0
        self._bend = product - self._half**2

    def between(self, begin: float, end: float) -> list[float]:
        y, slope = self._y, self._dy + self._half * self._y  # of y exp(half t), which oscillates or is hyperbolic
        if self._bend > 1e-14 * self._half**2:
            w = math.sqrt(self._bend)
            if (end - begin) * w / math.pi > TURNS:
                message = f"the impulse response turns more than {TURNS:,} times before it dies out"
                raise ValueError(message)
            first = math.atan2(-y * w, slope) % math.pi / w
            count = np.arange(math.floor((begin - first) * w / math.pi), math.ceil((end - first) * w / math.pi) + 1)
            zeros = first + count * math.pi / w
            return [float(t) for t in zeros if begin < t < end]
        w = math.sqrt(max(-self._bend, 0.0))
        if slope == 0:
            return []
        ratio = -y / slope  # tanh(w t)/w = ratio
        if w * abs(ratio) < 1:
            t = math.atanh(w * ratio) / w if w > 0 else ratio
            return [t] if begin < t < end else []
        return []


def _zero(h: Callable[[float], float], left: float, right: float) -> float | None:
    """The sign change of ``h`` in [left, right), where h is monotone up to a positive factor; None if there is none."""
    low, high = h(left), h(right)
    if low == 0 or low * high > 0:
        return None
    a, b = left, right
    for _ in range(200):
        middle = 0.5 * (a + b)
        if not a < middle < b:
            break
        if h(middle) * low > 0:
            a = middle
        else:
            b = middle
        if b - a < 1e-12 * (right - left):
            break
    return b


def _lyapunov(A: Array) -> Array:
    """X > 0 with A' X + X A = -1, by its linear system."""
    n = len(A)
    eye = np.eye(n)
    X = np.linalg.solve(np.kron(eye, A.T) + np.kron(A.T, eye), -eye.ravel()).reshape(n, n)
    return np.asarray(0.5 * (X + X.T))


def _expm(A: Array) -> Array:
    found: Array = exponential(A[None])[0]
    if not np.isfinite(found).all():
        message = "the linear loop is not finite"
        raise ValueError(message)
    return found
