"""The linear loop broken where a signal could be late or wrong.

It is written as P(s) + Q(s) = 0, Q being the part that passes the break:

actuator
    P = s (I s² - A L),  Q = s (K_d s + K_p) - (K_f/ell)(I s² - A L);  L = Q/P
force measurement
    P = s (I s² + K_d s + K_p - A L),  Q = -(K_f/ell)(I s² - A L)
angle measurement (angle and rate)
    P = (s - K_f/ell)(I s² - A L),  Q = s (K_d s + K_p)

For law (20) K_f stands for K_f (M + m) g/(F_T + F_H); law pd has K_f = 0, and a factor s cancels. Where law force
adapts within T_a = 1/a, the angle is also read through a K_p (1 - I s²/(M g L))/(s + a), and the force through
a K_p/(M g L)/(s + a). What the force measurement tells is tau + beta theta'' (``design.model.standing``): I + beta for
I where K_f is, and the law that adapts has I + M L h for I.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from design.model.body import Biped
from design.model.laws import Gains, LawKind
from design.model.polynomials import total

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Break:
    """The characteristic function P + Q, in rising powers of s; Q passes the break."""

    P: Polynomial
    Q: Polynomial

    @property
    def coefficients(self) -> tuple[Array, Array]:
        """Those of P and of Q, in rising powers."""
        return np.asarray(self.P.coef, dtype=np.float64), np.asarray(self.Q.coef, dtype=np.float64)


def effective_gain(biped: Biped, kind: LawKind, K_f: float, load: float) -> float:
    """K_f as it acts in the linear loop [m/s]."""
    if kind == "pd":
        return 0.0
    return K_f * biped.weight / load if kind == "cop" else K_f


def breaks(
    biped: Biped, kind: LawKind, K: Gains, A: float, load: float, adapt: float = math.inf, beta: float = 0.0
) -> dict[str, Break]:
    """The loop broken at ``actuator``, ``force`` and ``angle``; ``force`` is missing for law pd."""
    rest = np.array([-A * biped.L, 0.0, biped.I])
    feedback = np.array([K.K_p, K.K_d])
    if kind == "pd":
        return {"actuator": _break(rest, feedback), "angle": _break(rest, feedback)}
    pull = effective_gain(biped, kind, K.K_f, load) / biped.ell
    s = np.array([0.0, 1.0])
    extra = np.array([0.0, 0.0, beta])
    told = rest + extra
    if math.isfinite(adapt):
        a, lever = 1.0 / adapt, biped.M * biped.g * biped.L
        swung = biped.I + biped.M * biped.L * biped.height
        later = np.array([0.0, a, 1.0])  # s (s + a)
        force = np.array([a, 1.0]) * pull + s * (a * K.K_p / lever)
        angle = total(np.convolve(later, feedback), a * K.K_p * np.array([0.0, -1.0, 0.0, swung / lever]))
        passed = np.convolve(force, told)
        falls = np.convolve(later, rest)
        actuator = Polynomial(total(angle, -passed)).trim(1e-12 * abs(K.K_d))
        return {
            "actuator": Break(P=Polynomial(falls), Q=actuator),
            "force": _break(total(falls, angle), -passed),
            "angle": _break(total(np.convolve(total(later, -force), rest), -np.convolve(force, extra)), angle),
        }
    return {
        "actuator": _break(np.convolve(s, rest), total(np.convolve(s, feedback), -pull * told)),
        "force": _break(np.convolve(s, total(rest, feedback)), -pull * told),
        "angle": _break(total(np.convolve(np.array([-pull, 1.0]), rest), -pull * extra), np.convolve(s, feedback)),
    }


def _break(P: Array, Q: Array) -> Break:
    return Break(P=Polynomial(P), Q=Polynomial(Q))
