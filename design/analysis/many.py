"""Many bodies and worlds at once: the extremes of each one's run, by one vectorised Runge-Kutta march.

For searching a box, not for judging: all march on the same times, so that a corner of a force may fall within a step.
What is found is to be confirmed by ``design.analysis.simulate`` or the second opinion. The law knows one body only.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.model.body import Biped
from design.model.environment import Scenario
from design.model.laws import Gains, LawKind, desired, followed, gathered, swing, torque_of
from design.model.uncertainty import Spread, Tolerances

Array = NDArray[np.float64]
State = tuple[Array, ...]

FALLEN = 0.5 * math.pi


@dataclass(frozen=True, eq=False, kw_only=True)
class Extremes:
    """What each run (N,) came to.

    Least F_T and F_H [N] and distance of P from an end of the foot [m]; most |tau| [N m] and |f_x|/N. A body that falls
    has minus its weight for its forces, and the worst of the others.
    """

    toe: Array
    heel: Array
    cop: Array
    torque: Array
    friction: Array


def extremes(
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
    adapt: float = math.inf,
    known: Biped | None = None,
    impulse: float = 0.0,
) -> Extremes:
    """The runs at ``shares`` (N, 7) of the half-widths of ``tolerances``, which ``tolerances.drawn`` explains.

    The law has ``theta_d`` [rad], P_d = ``target`` [m], adapts within ``adapt`` [s], and knows the body ``known``, or
    else ``biped``. An ``impulse`` [N s] at the centre of gravity comes before the start.
    """
    believed = known or biped
    shares = np.asarray(shares, dtype=float)

    def at(spread: Spread, value: float, column: int) -> Array:
        return np.asarray(value + shares[:, column] * (spread.absolute + spread.part * abs(value)))

    M, L, I, m, ell = (
        at(getattr(tolerances, name), getattr(biped, name), k) for k, name in enumerate(("M", "L", "I", "m", "ell"))
    )
    g, skew, height = biped.g, biped.skew, biped.height
    final = float(scenario.signal[0, -1])
    world = _world(scenario, M, g, at(tolerances.slope, final, 5), at(tolerances.ramp, float(scenario.times[-1]), 6))
    adapts = math.isfinite(adapt)

    def seen(z: State, F: tuple[Array, Array]) -> tuple[Array, ...]:
        """tau, theta'', F_T, F_H, the load, and the ground's horizontal force."""
        theta, omega, s = z[:3]
        aim = desired(believed, adapt, z[3], omega) if adapts else theta_d
        tau = torque_of(kind, believed, aim, theta, omega, s, gains)
        sine, cosine = np.sin(theta), np.cos(theta)
        turning = ((M * g - F[1]) * L * sine + F[0] * L * cosine + tau) / I
        load = M * (g - L * (turning * sine + omega**2 * cosine)) - F[1] + m * g
        shear = M * L * (turning * cosine - omega**2 * sine) - F[0]
        turn = tau - ell * skew * m * g + height * shear  # l_H F_H - l_T F_T
        return tau, turning, 0.5 * ((1 - skew) * load - turn / ell), 0.5 * ((1 + skew) * load + turn / ell), load, shear

    def flow(z: State, found: tuple[Array, ...]) -> State:
        _, turning, F_T, F_H, *_ = found
        rate = gathered(kind, believed, F_T, F_H, target)
        if not adapts:
            return z[1], turning, rate
        return z[1], turning, rate, followed(believed, adapt, desired(believed, adapt, z[3], z[1]), z[0], rate)

    n = len(shares)
    omega0 = scenario.omega0 + impulse * L / I
    z: State = (np.full(n, scenario.theta0), omega0, np.zeros(n))
    if adapts:
        z = (*z, theta_d + swing(believed, adapt) * omega0)
    toe, heel, cop = (np.full(n, np.inf) for _ in range(3))
    torque, friction = np.zeros(n), np.zeros(n)

    def note(found: tuple[Array, ...]) -> None:
        tau, _, F_T, F_H, load, shear = found
        np.fmin(toe, F_T, out=toe)
        np.fmin(heel, F_H, out=heel)
        P = ((1 + skew) * F_T - (1 - skew) * F_H) * ell / load
        np.fmin(cop, np.minimum((1 + skew) * ell - P, (1 - skew) * ell + P), out=cop)
        np.fmax(torque, np.abs(tau), out=torque)
        np.fmax(friction, np.abs(shear) / load, out=friction)

    steps = scenario.steps(step)
    fallen = np.zeros(n, dtype=bool)
    with np.errstate(all="ignore"):
        for t, h in zip(steps.t[:-1].tolist(), steps.h.tolist(), strict=True):
            if h == 0:
                continue
            F = [world(t, t + 0.5 * h), world(t + 0.5 * h, t + 0.5 * h), world(t + h, t + 0.5 * h)]
            first = seen(z, F[0])
            note(first)
            k1 = flow(z, first)
            k2 = flow(at_2 := _moved(z, k1, 0.5 * h), seen(at_2, F[1]))
            k3 = flow(at_3 := _moved(z, k2, 0.5 * h), seen(at_3, F[1]))
            k4 = flow(at_4 := _moved(z, k3, h), seen(at_4, F[2]))
            z = _moved(z, tuple((a + 2 * b + 2 * c + d) / 6 for a, b, c, d in zip(k1, k2, k3, k4, strict=True)), h)
            note(seen(z, F[2]))  # a jump may follow
            fallen |= ~(np.abs(z[0]) < FALLEN)
    lost = -(M + m) * g

    def worst(value: Array, fell: Array | float) -> Array:
        return np.asarray(np.where(fallen, fell, value))

    return Extremes(
        toe=worst(toe, np.minimum(toe, lost)), heel=worst(heel, np.minimum(heel, lost)), cop=worst(cop, -ell),
        torque=worst(torque, np.inf), friction=worst(friction, np.inf),
    )  # fmt: skip


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
    adapt: float = math.inf,
    known: Biped | None = None,
) -> tuple[Array, Array]:
    """The smallest toe and heel force (N,) [N] of ``extremes``."""
    found = extremes(
        biped, kind, gains, scenario, tolerances, shares, step=step, theta_d=theta_d, target=target, adapt=adapt,
        known=known,
    )  # fmt: skip
    return found.toe, found.heel


def _moved(z: State, rate: State, h: float) -> State:
    return tuple(a + h * b for a, b in zip(z, rate, strict=True))


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
