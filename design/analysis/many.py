"""Many bodies and worlds at once: the smallest contact force of each, by one vectorised Runge-Kutta march.

For searching a box, not for judging: all march on the same times, so that a corner of a force may fall within a step.
What is found is to be confirmed by ``design.analysis.simulate`` or the second opinion.
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
State = tuple[Array, Array, Array, Array]

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
    adapt: float = math.inf,
    known: Biped | None = None,
) -> tuple[Array, Array]:
    """The smallest toe and heel force (N,) [N] at ``shares`` (N, 7) of the half-widths of ``tolerances``.

    ``tolerances.drawn`` says what the shares mean. A body that falls has minus its weight. The law may adapt within
    ``adapt`` [s]; it reckons with the body that is ``known`` to it, ``biped`` if that is None.
    """
    its = known or biped
    shares = np.asarray(shares, dtype=float)

    def at(spread: Spread, value: float, column: int) -> Array:
        return value + shares[:, column] * (spread.absolute + spread.part * abs(value))

    M, L, I, m, ell = (
        at(getattr(tolerances, name), getattr(biped, name), k) for k, name in enumerate(("M", "L", "I", "m", "ell"))
    )
    g = biped.g
    final = float(scenario.signal[0, -1])
    world = _world(scenario, M, g, at(tolerances.slope, final, 5), at(tolerances.ramp, float(scenario.times[-1]), 6))
    K_p, K_d, K_f = gains
    if kind == "pd":
        K_f = 0.0

    def flow(z: State, F: tuple[Array, Array]) -> tuple[Array, ...]:
        theta, omega, s, desired = z  # s as in (8); of law (20) it is (M + m) g/ell times its own
        tau = K_p * (desired - theta) - K_d * omega + K_f * s
        turning = ((M * g - F[1]) * L * np.sin(theta) + F[0] * L * np.cos(theta) + tau) / I
        gathering, following = tau / ell, np.zeros(n)
        if kind == "cop":
            load = M * (g - L * (turning * np.sin(theta) + omega**2 * np.cos(theta))) - F[1] + m * g
            gathering = gathering * its.weight / load
        if math.isfinite(adapt):
            moment = its.I * turning - its.ell * gathering
            following = (theta - moment / (its.M * its.g * its.L) - desired) / adapt
        return omega, turning, gathering, following, tau

    n = len(shares)
    z = (np.full(n, scenario.theta0), np.full(n, scenario.omega0), np.zeros(n), np.full(n, theta_d))
    toe, heel = np.full(n, np.inf), np.full(n, np.inf)
    steps = scenario.steps(step)

    def seen(z: State, rate: tuple[Array, ...], F: tuple[Array, Array]) -> None:
        pressing = M * (g - L * (rate[1] * np.sin(z[0]) + z[1] ** 2 * np.cos(z[0]))) - F[1] + m * g
        np.fmin(toe, 0.5 * (pressing - rate[4] / ell), out=toe)
        np.fmin(heel, 0.5 * (pressing + rate[4] / ell), out=heel)

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
            mean = [(a + 2 * b + 2 * c + d) / 6 for a, b, c, d in zip(k1[:4], k2[:4], k3[:4], k4[:4], strict=True)]
            z = _moved(z, mean, h)
            seen(z, flow(z, F[2]), F[2])  # a jump may follow
    fallen = ~(np.abs(z[0]) < FALLEN)
    lost = -(M + m) * g
    return np.where(fallen, np.minimum(toe, lost), toe), np.where(fallen, np.minimum(heel, lost), heel)


def _moved(z: State, rate: Sequence[Array], h: float) -> State:
    return z[0] + h * rate[0], z[1] + h * rate[1], z[2] + h * rate[2], z[3] + h * rate[3]


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
