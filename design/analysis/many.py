"""Many bodies and worlds at once: the smallest contact force of each, by one vectorised Runge-Kutta march.

For searching a box, not for judging: all march on the same times, so that a corner of a force may fall within a step.
What is found is to be confirmed by ``design.analysis.simulate`` or the second opinion. Laws pd and (8).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from design.model.body import Biped
from design.model.environment import Scenario
from design.model.laws import Gains, LawKind
from design.model.uncertainty import Spread, Tolerances

Array = NDArray[np.float64]

FALLEN = 0.5 * math.pi


def least_forces(
    biped: Biped,
    kind: LawKind,
    gains: Gains,
    scenario: Scenario,
    tolerances: Tolerances,
    shares: Sequence[Sequence[float]] | Array,
    *,
    step: float,
    theta_d: float = 0.0,
    target: float = 0.0,
) -> tuple[Array, Array]:
    """The smallest toe and heel force (N,) [N] at ``shares`` (N, 7) of the half-widths of ``tolerances``.

    ``tolerances.drawn`` says what the shares mean; the law, with P_d = ``target`` [m], knows each body. A body that
    falls has minus its weight. Raises ``ValueError`` for law cop.
    """
    if kind == "cop":
        message = "law cop is not marched for many bodies"
        raise ValueError(message)
    shares = np.asarray(shares, dtype=float)

    def at(spread: Spread, value: float, column: int) -> Array:
        return value + shares[:, column] * (spread.absolute + spread.part * abs(value))

    M, L, I, m, ell = (
        at(getattr(tolerances, name), getattr(biped, name), k) for k, name in enumerate(("M", "L", "I", "m", "ell"))
    )
    g, skew, height = biped.g, biped.skew, biped.height
    final = float(scenario.signal[0, -1])
    world = _world(scenario, M, g, at(tolerances.slope, final, 5), at(tolerances.ramp, float(scenario.times[-1]), 6))
    plain = biped.plain and target == 0.0
    K_p, K_d, K_f = gains
    if kind == "pd":
        K_f = 0.0

    def flow(z: tuple[Array, Array, Array], F: tuple[Array, Array]) -> tuple[Array, Array, Array, Array]:
        theta, omega, s = z
        tau = K_p * (theta_d - theta) - K_d * omega + K_f * s
        turning = ((M * g - F[1]) * L * np.sin(theta) + F[0] * L * np.cos(theta) + tau) / I
        if plain:
            return omega, turning, tau / ell, tau
        shear = M * L * (turning * np.cos(theta) - omega**2 * np.sin(theta)) - F[0]
        turn = tau - ell * skew * m * g + height * shear  # l_H F_H - l_T F_T
        return omega, turning, (turn + target * pressing(theta, omega, turning, F)) / ell, turn

    def pressing(theta: Array, omega: Array, turning: Array, F: tuple[Array, Array]) -> Array:
        return M * (g - L * (turning * np.sin(theta) + omega**2 * np.cos(theta))) - F[1] + m * g

    n = len(shares)
    z = (np.full(n, scenario.theta0), np.full(n, scenario.omega0), np.zeros(n))
    toe, heel = np.full(n, np.inf), np.full(n, np.inf)
    steps = scenario.steps(step)

    def seen(z: tuple[Array, Array, Array], rate: tuple[Array, ...], F: tuple[Array, Array]) -> None:
        load = pressing(z[0], z[1], rate[1], F)
        np.fmin(toe, 0.5 * ((1 - skew) * load - rate[3] / ell), out=toe)
        np.fmin(heel, 0.5 * ((1 + skew) * load + rate[3] / ell), out=heel)

    with np.errstate(all="ignore"):
        for t, h in zip(steps.t[:-1].tolist(), steps.h.tolist(), strict=True):
            if h == 0:
                continue
            F = [world(t, t + 0.5 * h), world(t + 0.5 * h, t + 0.5 * h), world(t + h, t + 0.5 * h)]
            k1 = flow(z, F[0])
            seen(z, k1, F[0])
            k2 = flow(_moved(z, k1, 0.5 * h), F[1])
            k3 = flow(_moved(z, k2, 0.5 * h), F[1])
            k4 = flow(_moved(z, k3, h), F[2])
            mean = tuple((a + 2 * b + 2 * c + d) / 6 for a, b, c, d in zip(k1, k2, k3, k4, strict=True))
            z = _moved(z, mean, h)
            seen(z, flow(z, F[2]), F[2])  # a jump may follow
    fallen = ~(np.abs(z[0]) < FALLEN)
    lost = -(M + m) * g
    return np.where(fallen, np.minimum(toe, lost), toe), np.where(fallen, np.minimum(heel, lost), heel)


def _moved(z: tuple[Array, Array, Array], rate: tuple[Array, ...], h: float) -> tuple[Array, Array, Array]:
    return z[0] + h * rate[0], z[1] + h * rate[1], z[2] + h * rate[2]


def _world(scenario: Scenario, M: Array, g: float, final: Array, ramp: Array):  # type: ignore[no-untyped-def]
    """(t, a time within the step) -> F_x and F_y (N,)."""
    nominal = float(scenario.times[-1])
    whole = float(scenario.signal[0, -1])
    stretched = scenario.kind in ("slope", "force") and nominal > 0

    def world(t: float, inside: float) -> tuple[Array, Array]:
        if stretched:
            grown = np.clip(t / np.maximum(ramp, 1e-9), 0.0, 1.0)
            signal = scenario.signal[:, -1:] * grown
        else:
            signal = scenario.signal_by(np.array([inside]), np.array([t])) * np.ones_like(M)
        if scenario.kind == "slope":
            alpha = signal[0] * (final / whole) if whole else final
            return M * g * np.sin(alpha), M * g * (1 - np.cos(alpha))
        if scenario.kind == "platform":
            return -M * signal[0], np.zeros_like(M)
        return signal[0], signal[1]

    return world
