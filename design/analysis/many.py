"""Many bodies and worlds at once: the extremes of each one's run, by one vectorised Runge-Kutta march.

For searching a box, not for judging: all march on the same times, so that a corner of a force may fall within a step.
What is found is to be confirmed by ``design.analysis.simulate`` or the second opinion. The law knows one body only.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from design import deadline
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
    else ``biped``. An ``impulse`` [N s] at the centre of gravity comes before the start. Raises
    ``OutOfTime`` where a deadline is set and has passed.
    """
    shares = np.asarray(shares, dtype=float)
    law = _Law(kind=kind, gains=gains, body=known or biped, theta_d=theta_d, target=target, adapt=adapt)
    bodies = _bodies(biped, tolerances, shares)
    final = _spread(tolerances.slope, float(scenario.signal[0, -1]), shares[:, 5])
    ramp = _spread(tolerances.ramp, float(scenario.times[-1]), shares[:, 6])
    world = _world(scenario, bodies.M, biped.g, final, ramp)
    n = len(shares)
    omega0 = scenario.omega0 + impulse * bodies.L / bodies.I
    z: State = (np.full(n, scenario.theta0), omega0, np.zeros(n))
    if law.adapts:
        z = (*z, theta_d + swing(law.body, adapt) * omega0)
    worst = _Worst(bodies)
    fallen = np.zeros(n, dtype=bool)
    steps = scenario.steps(step)
    with np.errstate(all="ignore"):
        for t, h in zip(steps.t[:-1].tolist(), steps.h.tolist(), strict=True):
            deadline.check()
            if h == 0:
                continue
            F = [world(t, t + 0.5 * h), world(t + 0.5 * h, t + 0.5 * h), world(t + h, t + 0.5 * h)]
            first = bodies.seen(law, z, F[0])
            worst.note(first)
            k1 = law.flow(z, first)
            k2 = law.flow(at_2 := _moved(z, k1, 0.5 * h), bodies.seen(law, at_2, F[1]))
            k3 = law.flow(at_3 := _moved(z, k2, 0.5 * h), bodies.seen(law, at_3, F[1]))
            k4 = law.flow(at_4 := _moved(z, k3, h), bodies.seen(law, at_4, F[2]))
            z = _moved(z, tuple((a + 2 * b + 2 * c + d) / 6 for a, b, c, d in zip(k1, k2, k3, k4, strict=True)), h)
            worst.note(bodies.seen(law, z, F[2]))  # a jump may follow
            fallen |= ~(np.abs(z[0]) < FALLEN)
    return worst.extremes(fallen)


class _Seen(NamedTuple):
    """tau, theta'', F_T, F_H, the load, and the ground's horizontal force, each (N,)."""

    tau: Array
    turning: Array
    F_T: Array
    F_H: Array
    load: Array
    shear: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class _Law:
    """The law, and the ``body`` that it knows."""

    kind: LawKind
    gains: Gains
    body: Biped
    theta_d: float
    target: float
    adapt: float

    @property
    def adapts(self) -> bool:
        return math.isfinite(self.adapt)

    def torque(self, z: State) -> Array:
        theta, omega, s = z[:3]
        aim = desired(self.body, self.adapt, z[3], omega) if self.adapts else self.theta_d
        return np.asarray(torque_of(self.kind, self.body, aim, theta, omega, s, self.gains))

    def flow(self, z: State, seen: _Seen) -> State:
        """The rates of the states."""
        rate = gathered(self.kind, self.body, seen.F_T, seen.F_H, self.target)
        if not self.adapts:
            return z[1], seen.turning, rate
        aim = desired(self.body, self.adapt, z[3], z[1])
        return z[1], seen.turning, rate, followed(self.body, self.adapt, aim, z[0], rate)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Bodies:
    """The numbers (N,) of all bodies, and those that they share."""

    M: Array
    L: Array
    I: Array
    m: Array
    ell: Array
    g: float
    skew: float
    height: float

    def seen(self, law: _Law, z: State, F: tuple[Array, Array]) -> _Seen:
        """What states and force come to under the ``law``."""
        theta, omega = z[:2]
        tau = law.torque(z)
        sine, cosine = np.sin(theta), np.cos(theta)
        turning = ((self.M * self.g - F[1]) * self.L * sine + F[0] * self.L * cosine + tau) / self.I
        load = self.M * (self.g - self.L * (turning * sine + omega**2 * cosine)) - F[1] + self.m * self.g
        shear = self.M * self.L * (turning * cosine - omega**2 * sine) - F[0]
        turn = tau - self.ell * self.skew * self.m * self.g + self.height * shear  # l_H F_H - l_T F_T
        F_T = 0.5 * ((1 - self.skew) * load - turn / self.ell)
        return _Seen(tau, turning, F_T, 0.5 * ((1 + self.skew) * load + turn / self.ell), load, shear)


def _bodies(biped: Biped, tolerances: Tolerances, shares: Array) -> _Bodies:
    M, L, I, m, ell = (
        _spread(getattr(tolerances, name), getattr(biped, name), shares[:, k])
        for k, name in enumerate(("M", "L", "I", "m", "ell"))
    )
    return _Bodies(M=M, L=L, I=I, m=m, ell=ell, g=biped.g, skew=biped.skew, height=biped.height)


def _spread(spread: Spread, value: float, shares: Array) -> Array:
    return np.asarray(value + shares * (spread.absolute + spread.part * abs(value)))


class _Worst:
    """The extremes so far."""

    def __init__(self, bodies: _Bodies) -> None:
        n = len(bodies.M)
        self._bodies = bodies
        self._toe, self._heel, self._cop = (np.full(n, np.inf) for _ in range(3))
        self._torque, self._friction = np.zeros(n), np.zeros(n)

    def note(self, seen: _Seen) -> None:
        """Take what was ``seen`` into account."""
        toe, heel = (1 + self._bodies.skew), (1 - self._bodies.skew)
        np.fmin(self._toe, seen.F_T, out=self._toe)
        np.fmin(self._heel, seen.F_H, out=self._heel)
        P = (toe * seen.F_T - heel * seen.F_H) * self._bodies.ell / seen.load
        np.fmin(self._cop, np.minimum(toe * self._bodies.ell - P, heel * self._bodies.ell + P), out=self._cop)
        np.fmax(self._torque, np.abs(seen.tau), out=self._torque)
        np.fmax(self._friction, np.abs(seen.shear) / seen.load, out=self._friction)

    def extremes(self, fallen: Array) -> Extremes:
        """What it came to, where ``fallen`` (N,) says which bodies fell."""
        lost = -(self._bodies.M + self._bodies.m) * self._bodies.g

        def of(value: Array, fell: Array | float) -> Array:
            return np.asarray(np.where(fallen, fell, value))

        return Extremes(
            toe=of(self._toe, np.minimum(self._toe, lost)), heel=of(self._heel, np.minimum(self._heel, lost)),
            cop=of(self._cop, -self._bodies.ell), torque=of(self._torque, np.inf), friction=of(self._friction, np.inf),
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
            alpha = signal[0] / whole * final if whole else final
            return M * g * np.sin(alpha), M * g * (1 - np.cos(alpha))
        if scenario.kind == "platform":
            return -M * signal[0], np.zeros_like(M)
        return signal[0], signal[1]

    return world
