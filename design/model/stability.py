"""Local stability of the stationary posture, (23)-(29), and the decay rate.

On flat ground contact the linearised loop has, for the laws (8) and (20), the characteristic polynomial
lambda^3 + p_2 lambda^2 + p_1 lambda + p_0 (24)-(25). Law (20) divides by the measured load F_T + F_H, so its K_f acts
(M + m) g / (F_T + F_H) times as strongly. Law pd has lambda^2 + (K_d/I) lambda + (K_p - A L)/I, taken at its
stiffest demand, theta = theta_f.

Where law force adapts within T_a (``design.model.laws``) theta_d - theta_f is a fourth state, and with a = 1/T_a and
kappa = 1 - A/(M g), what its estimate is wrong by where A is not M g,

    (lambda + a)(lambda^3 + p_2 lambda^2 + p_1 lambda + p_0) - a kappa (K_p/I) lambda

so that on a slope, where A = M g, a pole -a is added and no other is moved: any T_a is stable.

Where foot or target are not the paper's, A stands for A cos(theta_0 - theta_f), and where K_f is, I + beta for I
(``design.model.standing``): p_2 = K_d/I - K_f (1 + beta/I)/ell, (28) is ell K_d > (I + beta) K_f, and (29)
(K_d ell - K_f (I + beta)) K_p > (K_d ell - K_f beta) A L. From the polynomial of the law that adapts, which reckons
with the inertia I + M L h about the point under the ankle, a (K_p/I) (kappa lambda + epsilon lambda^3) is subtracted,
epsilon = (beta - M L h)/(M g L). All of it is affine in K: ``polynomial_map``.

Every pole has a real part of at most -sigma if and only if the polynomial in mu = lambda + sigma has no root in the
open right half-plane. For law (8) the tests on its coefficients are affine in A, so that over a range of A its two
ends decide; the same holds for pd.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from design.model.body import Biped
from design.model.closed_loop import ClosedLoop
from design.model.laws import Gains, LawKind, swing
from design.model.standing import met, standing

Array = NDArray[np.float64]


def characteristic(
    biped: Biped, kind: LawKind, K: Any, A: Any, load: Any, adapt: float = math.inf, beta: Any = 0.0
) -> tuple[Any, ...]:
    """Coefficients after the leading 1, highest power first: (p_2, p_1, p_0), or (p_1, p_0) for law pd; (25).

    ``K`` = (K_p, K_d, K_f), ``A`` [N] (3), ``load`` = F_T + F_H at rest [N]: floats, fractions or CasADi expressions.
    Four coefficients where the law adapts within ``adapt`` [s]. ``beta``: see ``design.model.standing``.
    """
    K_p, K_d, K_f = K[0], K[1], K[2]
    if kind == "pd":
        return K_d / biped.I, (K_p - A * biped.L) / biped.I
    if kind == "cop":
        K_f = K_f * (biped.weight / load)
    p = (
        K_d / biped.I - K_f / biped.ell * (1 + beta / biped.I),
        (K_p - A * biped.L) / biped.I,
        K_f * (A * biped.L / (biped.I * biped.ell)),
    )
    if not math.isfinite(adapt):
        return p
    a = 1.0 / adapt
    kappa = 1.0 - A / (biped.M * biped.g)
    swollen = a * (beta - biped.M * biped.L * biped.height) / (biped.M * biped.g * biped.L) * K_p / biped.I
    return p[0] + a - swollen, p[1] + a * p[0], p[2] + a * (p[1] - kappa * K_p / biped.I), a * p[2]


def polynomial_map(loop: ClosedLoop, F_x: float, F_y: float) -> tuple[Array, Array]:
    """The characteristic polynomial of ``loop`` about where it comes to rest under (F_x, F_y) [N], for all gains.

    Its coefficients after the leading 1, highest power first, are offset (n,) + slope (n, 3) @ (K_p, K_d, K_f): n is 3,
    2 for law pd, 4 for a law that adapts. The law may know another body than the one that there is.
    """
    biped, known, kind = loop.biped, loop.law.biped, loop.law.kind
    place = standing(biped, np.array([[F_x], [F_y]]), met(biped, loop.law.target, known))
    A, load, beta = place.places[0]
    I, ell = biped.I, biped.ell
    if kind == "pd":
        A = math.hypot(biped.M * biped.g - F_y, F_x)
        return np.array([0.0, -A * biped.L / I]), np.array([[0.0, 1 / I, 0.0], [1 / I, 0.0, 0.0]])
    strong = known.weight / load if kind == "cop" else 1.0
    offset = np.array([0.0, -A * biped.L / I, 0.0])
    slope = np.zeros((3, 3))
    slope[0] = 0.0, 1 / I, -strong / ell * (1 + beta / I)
    slope[1, 0] = 1 / I
    slope[2, 2] = strong * (A * biped.L / (I * ell))
    if not math.isfinite(loop.law.adapt):
        return offset, slope
    a, lever = 1.0 / loop.law.adapt, known.M * known.g * known.L
    wide = known.ell / ell
    kappa = 1.0 - wide * A * biped.L / lever
    epsilon = (wide * (I + beta) - known.I - known.M * known.L * known.height) / lever
    offset = np.append(offset, 0.0) + a * np.append(1.0, offset)
    slope = np.vstack([slope, np.zeros(3)]) + a * np.vstack([np.zeros(3), slope])
    slope[0, 0] -= a * epsilon / I
    slope[2, 0] -= a * kappa / I
    return offset, slope


def shifted(p: Sequence[Any], sigma: Any) -> tuple[Any, ...]:
    """Coefficients of the same monic polynomial in mu = lambda + sigma."""
    if len(p) == 2:
        p_1, p_0 = p
        return p_1 - 2 * sigma, p_0 - p_1 * sigma + sigma**2
    if len(p) == 4:
        p_3, p_2, p_1, p_0 = p
        return (
            p_3 - 4 * sigma,
            p_2 - 3 * p_3 * sigma + 6 * sigma**2,
            p_1 - 2 * p_2 * sigma + 3 * p_3 * sigma**2 - 4 * sigma**3,
            p_0 - p_1 * sigma + p_2 * sigma**2 - p_3 * sigma**3 + sigma**4,
        )
    p_2, p_1, p_0 = p
    return p_2 - 3 * sigma, p_1 - 2 * p_2 * sigma + 3 * sigma**2, p_0 - p_1 * sigma + p_2 * sigma**2 - sigma**3


def is_hurwitz(p: Sequence[Any]) -> bool:
    """Whether all roots of the monic polynomial of degree 2, 3 or 4 have negative real parts, (26)."""
    positive = all(c > 0 for c in p)
    if len(p) == 4:
        return bool(positive and p[2] * (p[0] * p[1] - p[2]) > p[0] ** 2 * p[3])
    return bool(positive and (len(p) == 2 or p[0] * p[1] > p[2]))


def decay_rate(p: Sequence[float]) -> float:
    """The largest sigma such that every root has a real part of at most -sigma [1/s]; negative if unstable.

    Decided with the exact signs of the shifted polynomial (the coefficients are taken as exact rationals), because
    at a multiple root, where an optimal design often lies, computed roots keep only a third of their digits.
    """
    exact = [Fraction(float(c)) for c in p]
    estimate = -float(np.roots([1.0, *map(float, p)]).real.max())
    size = max(abs(float(c)) ** (1 / (k + 1)) for k, c in enumerate(p)) or 1.0
    width = 1e-9 * size
    stable = is_hurwitz(exact)
    low, high = estimate - width, estimate + width
    while not is_hurwitz(shifted(exact, Fraction(low))):
        width *= 4
        low = estimate - width
    while is_hurwitz(shifted(exact, Fraction(high))):
        width *= 4
        high = estimate + width
    low, high = (max(low, 0.0), high) if stable else (low, min(high, 0.0))  # its sign is decided, however small it is
    while high - low > 1e-13 * size or (stable and high - low > 1e-6 * high):
        middle = low + 0.5 * (high - low)
        if not low < middle < high:
            break
        low, high = (middle, high) if is_hurwitz(shifted(exact, Fraction(middle))) else (low, middle)
    return low


def shortest_adaptation(biped: Biped, K: Gains, A: float, adapt: float, beta: float = 0.0) -> float:
    """The T_a [s] down to which every one from ``adapt`` on, or from infinity if that is unstable, is stable.

    0 if all are; raises ``ValueError`` if the loop is unstable without adaptation.
    """
    p_2, p_1, p_0 = characteristic(biped, "force", K, A, biped.weight, beta=beta)
    if not is_hurwitz((p_2, p_1, p_0)):
        message = "the loop is not stable"
        raise ValueError(message)
    a = Polynomial([0.0, 1.0])
    epsilon = (beta - biped.M * biped.L * biped.height) / (biped.M * biped.g * biped.L)
    q_3, q_2, q_1, q_0 = (
        p_2 + (1.0 - epsilon * K.K_p / biped.I) * a,
        p_1 + p_2 * a,
        p_0 + (p_1 - (1 - A / (biped.M * biped.g)) * K.K_p / biped.I) * a,
        p_0 * a,
    )
    changes = [q_1 * (q_3 * q_2 - q_1) - q_3**2 * q_0, q_1, q_2, *([] if epsilon == 0.0 else [q_3])]
    rates = sorted(
        float(root.real)
        for each in changes
        for root in each.trim(1e-12 * float(np.abs(each.coef).max())).roots()
        if root.real > 0 and abs(root.imag) <= 1e-9 * abs(root)
    )
    from_ = 1.0 / adapt if is_hurwitz(characteristic(biped, "force", K, A, biped.weight, adapt, beta)) else 0.0
    return next((1.0 / rate for rate in rates if rate > from_ * (1 + 1e-12)), 0.0)


def closed_loop_matrix(
    biped: Biped,
    kind: LawKind,
    K: Gains,
    A: float,
    load: float,
    adapt: float = math.inf,
    known: Biped | None = None,
    beta: float = 0.0,
) -> Array:
    """(23) for the states (theta, omega, s) about the stationary posture; (2, 2) without s for law pd.

    (4, 4) with eta last where the law adapts within ``adapt`` [s], reckoning with the body that is ``known`` to it.
    """
    I, ell = biped.I, biped.ell
    K_p, K_d, K_f = K
    if kind == "pd":
        return np.array([[0.0, 1.0], [(A * biped.L - K_p) / I, -K_d / I]])
    if math.isfinite(adapt):
        believed = known or biped
        b, a, lever = swing(believed, adapt), 1.0 / adapt, believed.M * believed.g * believed.L
        torque = np.array([-K_p, -K_d - K_p * b, K_f, K_p])
        fall = np.array([A * biped.L / I, 0.0, 0.0, 0.0])
        pushed = torque * (1.0 + beta / I) + beta * fall
        follow = a * (pushed * (believed.ell / ell) / lever + np.array([1.0, b, 0.0, -1.0]))
        return np.array([[0.0, 1.0, 0.0, 0.0], torque / I + fall, pushed / ell, follow])
    if kind == "cop":  # s' = -P = tau / load, tau = ... + K_F s
        K_F = K_f * biped.weight / ell
        torque, gather = np.array([-K_p, -K_d, K_F]), 1.0 / load
    else:  # s' = tau / ell (11)
        torque, gather = np.array([-K_p, -K_d, K_f]), 1.0 / ell
    fall = np.array([A * biped.L / I, 0.0, 0.0])
    return np.array([[0.0, 1.0, 0.0], torque / I + fall, gather * (torque * (1.0 + beta / I) + beta * fall)])


def routh_hurwitz(
    biped: Biped, kind: LawKind, K: Any, A: Any, load: Any, beta: Any = 0.0
) -> dict[str, list[tuple[Any, Any]]]:
    """(27)-(29) as pairs (left, right) of which left > right is required, by row id.

    ``stiffness`` [N m/rad], ``damping`` [m/s], ``routh`` [N² m² s]. Law pd has no ``routh``, and its ``damping`` is
    K_d > 0 [N m s/rad].
    """
    K_p, K_d, K_f = K[0], K[1], K[2]
    AL, I, ell = A * biped.L, biped.I, biped.ell
    if kind == "pd":
        return {"stiffness": [(K_p, AL), (AL, 0.0)], "damping": [(K_d, 0.0)]}
    if kind == "cop":
        K_f = K_f * (biped.weight / load)
    return {
        "stiffness": [(K_p, AL), (AL, 0.0)],  # (27)
        "damping": [(ell / I * K_d, K_f * (1 + beta / I)), (K_f, 0.0)],  # (28)
        "routh": [((K_d * ell - K_f * (I + beta)) * K_p, (K_d * ell - K_f * beta) * AL)],  # (29)
    }


def normalised_slacks(biped: Biped, kind: LawKind, K: Any, A: Any, load: Any, beta: Any = 0.0) -> tuple[Any, ...]:
    """(27)-(29) without units, each > 0 where it holds; the smallest, always below 1, is the ``routh-margin``.

    With kappa = A L/K_p and r = K_f (I + beta)/(ell K_d): 1 - kappa (27); 1 - r and r (28); and (29) divided by K_p K_d
    ell, 1 - r - kappa (1 - r beta/(I + beta)). For law pd 1 - kappa alone.
    """
    K_p, K_d, K_f = K[0], K[1], K[2]
    kappa = A * biped.L / K_p
    if kind == "pd":
        return (1 - kappa,)
    if kind == "cop":
        K_f = K_f * (biped.weight / load)
    r = K_f * (biped.I + beta) / (biped.ell * K_d)
    return 1 - kappa, 1 - r, r, 1 - r - kappa * (1 - r * beta / (biped.I + beta))
