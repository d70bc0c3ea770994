"""Curves of the linear loop for pictures: root locus over the actuator's gain, and L on the imaginary axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from design.model.broken_loop import breaks
from design.model.laws import Gains
from design.spec.setting import Setting


@dataclass(frozen=True, eq=False, kw_only=True)
class LoopCurves:
    """``locus`` (k, n) poles at rising gain, ``start`` (n,) at none, ``poles`` (n,) at this design; L at ``omega``."""

    locus: NDArray[np.complex128]
    start: NDArray[np.complex128]
    poles: NDArray[np.complex128]
    omega: NDArray[np.float64]
    L: NDArray[np.complex128]


def loop_curves(setting: Setting, gains: Gains) -> LoopCurves:
    """The curves at the largest A of the scenarios."""
    places = [place for scenario in setting.scenarios for place in setting.places(scenario)]
    A, load, beta = max(places, key=lambda place: place.A)
    broken = breaks(setting.biped, setting.law, gains, A, load, setting.adapt, beta)["actuator"]
    factors = np.concatenate([np.linspace(0.0, 1.0, 300), np.linspace(1.0, 3.0, 200)])
    size = max(float(np.abs((broken.P + broken.Q).roots()).max()), 1e-6)
    omega = np.logspace(np.log10(size) - 3.5, np.log10(size) + 1.5, 500)
    return LoopCurves(
        locus=_roots(broken.P, broken.Q, factors),
        start=np.asarray(broken.P.roots(), dtype=np.complex128),
        poles=np.asarray((broken.P + broken.Q).roots(), dtype=np.complex128),
        omega=omega,
        L=np.asarray(broken.Q(1j * omega) / broken.P(1j * omega)),
    )


def _roots(P: Polynomial, Q: Polynomial, factors: NDArray[np.float64]) -> NDArray[np.complex128]:
    """The roots of P + k Q for each k of ``factors``, (k, n), as eigenvalues of the companion matrices; P leads."""
    p = P.coef / P.coef[-1]
    n = len(p) - 1
    q = np.zeros(n)
    q[: len(Q.coef)] = Q.coef / P.coef[-1]
    companion = np.zeros((len(factors), n, n))
    companion[:, 1:, :-1] = np.eye(n - 1)
    companion[:, :, -1] = -(p[:-1] + factors[:, None] * q)
    return np.linalg.eigvals(companion).astype(np.complex128)
