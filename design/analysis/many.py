"""Many bodies and worlds at once: the extremes of each one's run, by one vectorised Runge-Kutta march.

For searching a box, not for judging: all march on the same times, so that a corner of a force may fall within a step.
What is found is to be confirmed by ``design.analysis.simulate`` or the second opinion. The law knows one body only.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.analysis.transient import AT_REST, PART_AT_REST
from design.deadline import check as check_time
from design.model.body import Biped
from design.model.environment import Scenario
from design.model.laws import Gains, LawKind, desired, followed, gathered, swing, torque_of
from design.model.standing import posture
from design.model.uncertainty import Spread, Tolerances

Array = NDArray[np.float64]
State = tuple[Array, ...]

FALLEN = 0.5 * math.pi


@dataclass(frozen=True, eq=False, kw_only=True)
class Paths:
    """Where each run was on its way to its final posture: e = theta - theta_f (N, n) [rad] at times ``t`` (n,) [s].

    ``corner`` (N,): when the force came to rest [s].
    """

    t: Array
    e: Array
    corner: Array

    @property
    def farthest(self) -> Array:
        """The largest |e| (N,) [rad]."""
        return np.asarray(np.abs(self.e).max(axis=1))

    @property
    def error(self) -> Array:
        """|e| at the end (N,) [rad]."""
        return np.asarray(np.abs(self.e[:, -1]))

    def distance(self, T: float) -> Array:
        """The largest |e| (N,) [rad] from ``T`` [s] after the corner on."""
        start = np.minimum(self.corner + T, self.t[-1])
        late = np.where(self.t >= start[:, None], np.abs(self.e), 0.0).max(axis=1)
        return np.asarray(np.maximum(late, np.abs(self._at(start))))

    def overshoot(self) -> Array:
        """How far (N,) [rad] e came past 0 from the corner on; to either side where it was 0 there."""
        e = np.where(self.t >= self.corner[:, None], self.e, 0.0)
        start = self._at(self.corner)
        at_rest = np.abs(start) <= AT_REST + PART_AT_REST * self.farthest
        past = (-np.sign(start)[:, None] * e).max(axis=1)
        return np.asarray(np.where(at_rest, np.abs(e).max(axis=1), np.maximum(past, 0.0)))

    def _at(self, t: Array) -> Array:
        """The e (N,) at times ``t`` (N,)."""
        after = np.clip(np.searchsorted(self.t, t), 1, len(self.t) - 1)
        part = (t - self.t[after - 1]) / np.maximum(self.t[after] - self.t[after - 1], 1e-12)
        row = np.arange(len(t))
        return np.asarray(self.e[row, after - 1] * (1 - part) + self.e[row, after] * part)


@dataclass(frozen=True, eq=False, kw_only=True)
class Extremes:
    """What each run (N,) came to.

    Least F_T and F_H [N] and distance of P from an end of the foot [m]; most |tau| [N m], friction, and |dtau/dt|
    [N m/s]. A body that falls has minus its weight for its forces, and the worst of the others. ``paths`` where they
    were asked for; after a fall they are infinite.
    """

    toe: Array
    heel: Array
    cop: Array
    torque: Array
    friction: Array
    rate: Array
    paths: Paths | None = None


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
    deadline: float = math.inf,
    paths: bool = False,
) -> Extremes:
    """The runs at ``shares`` (N, 7) of the half-widths of ``tolerances``, which ``tolerances.drawn`` explains.

    The law has ``theta_d`` [rad], P_d = ``target`` [m], adapts within ``adapt`` [s], and knows the body ``known``, or
    else ``biped``. An ``impulse`` [N s] at the centre of gravity comes before the start. What has not been run by the
    ``deadline`` (``time.monotonic``) is left out; raises ``OutOfTime`` where that of the whole question has passed.
    """
    shares = np.asarray(shares, dtype=float)
    law = _Law(kind=kind, gains=gains, body=known or biped, theta_d=theta_d, target=target, adapt=adapt)
    bodies = _bodies(biped, tolerances, shares, field=scenario.field)
    final = _spread(tolerances.slope, scenario.angle, shares[:, 5])
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
    way = [z[0]]
    with np.errstate(all="ignore"):
        for t, h in zip(steps.t[:-1].tolist(), steps.h.tolist(), strict=True):
            check_time()
            if time.monotonic() > deadline:
                break
            if h == 0:
                way += [z[0]] if paths else []
                continue
            F = [world(t, t + 0.5 * h), world(t + 0.5 * h, t + 0.5 * h), world(t + h, t + 0.5 * h)]
            first = bodies.seen(law, z, F[0])
            k1 = law.flow(z, first)
            worst.note(first, law.torque_rate(k1) if paths else None)
            k2 = law.flow(at_2 := _moved(z, k1, 0.5 * h), bodies.seen(law, at_2, F[1]))
            k3 = law.flow(at_3 := _moved(z, k2, 0.5 * h), bodies.seen(law, at_3, F[1]))
            k4 = law.flow(at_4 := _moved(z, k3, h), bodies.seen(law, at_4, F[2]))
            z = _moved(z, tuple((a + 2 * b + 2 * c + d) / 6 for a, b, c, d in zip(k1, k2, k3, k4, strict=True)), h)
            last = bodies.seen(law, z, F[2])  # a jump may follow
            worst.note(last, law.torque_rate(law.flow(z, last)) if paths else None)
            fallen |= ~(np.abs(z[0]) < FALLEN)
            way += [z[0]] if paths else []
    if not paths:
        return worst.extremes(fallen)
    end = float(steps.t[-1])
    e = np.column_stack(way) - bodies.postures(biped, world(end, end), target)[:, None]
    still = scenario.steady_from
    corner = np.minimum(ramp, end) if scenario.kind in ("slope", "force") and still > 0 else np.full(n, still)
    e = np.where(fallen[:, None] | ~np.isfinite(e), np.inf, e)
    return worst.extremes(fallen, Paths(t=steps.t, e=e, corner=corner))


class _Seen(NamedTuple):
    """tau, theta'', F_T, F_H, the load, and the needed coefficient of friction, each (N,)."""

    tau: Array
    turning: Array
    F_T: Array
    F_H: Array
    load: Array
    slip: Array


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

    def torque_rate(self, rates: State) -> Array:
        """dtau/dt (N,) where the states change at these ``rates``: the torque is linear in them."""
        turned = desired(self.body, self.adapt, rates[3], rates[1]) if self.adapts else 0.0
        return np.asarray(torque_of(self.kind, self.body, turned, rates[0], rates[1], rates[2], self.gains))

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
    share: Array
    """m/M where the force is an acceleration field, which friction must hold the foot against too; else 0."""
    kappa: Array
    """The part of the force that the contact forces have from the foot: ``share``, or 0."""

    def seen(self, law: _Law, z: State, F: tuple[Array, Array]) -> _Seen:
        """What states and force come to under the ``law``."""
        theta, omega = z[:2]
        tau = law.torque(z)
        sine, cosine = np.sin(theta), np.cos(theta)
        turning = ((self.M * self.g - F[1]) * self.L * sine + F[0] * self.L * cosine + tau) / self.I
        foot = self.m * self.g - self.kappa * F[1]
        load = self.M * (self.g - self.L * (turning * sine + omega**2 * cosine)) - F[1] + foot
        shear = self.M * self.L * (turning * cosine - omega**2 * sine) - F[0]
        middle = self.ell * self.skew
        turn = tau - middle * self.m * self.g + middle * self.kappa * F[1] + self.height * shear  # l_H F_H - l_T F_T
        F_T = 0.5 * ((1 - self.skew) * load - turn / self.ell)
        slip = np.abs(shear - self.share * F[0]) / (load - (self.share - self.kappa) * F[1])
        return _Seen(tau, turning, F_T, 0.5 * ((1 + self.skew) * load + turn / self.ell), load, slip)

    def postures(self, biped: Biped, F: tuple[Array, Array], target: float) -> Array:
        """The final posture (N,) [rad] of each body under its force."""
        numbers = zip(self.M, self.L, self.I, self.m, self.ell, *F, strict=True)
        return np.array(
            [
                posture(replace(biped, M=M, L=L, I=I, m=m, ell=ell), F_x, F_y, target)
                for M, L, I, m, ell, F_x, F_y in (map(float, each) for each in numbers)
            ]
        )


def _bodies(biped: Biped, tolerances: Tolerances, shares: Array, *, field: bool) -> _Bodies:
    M, L, I, m, ell = (
        _spread(getattr(tolerances, name), getattr(biped, name), shares[:, k])
        for k, name in enumerate(("M", "L", "I", "m", "ell"))
    )
    share = m / M if field else 0.0 * m
    kappa = m / M if biped.ground_loads else 0.0 * m
    return _Bodies(
        M=M, L=L, I=I, m=m, ell=ell, g=biped.g, skew=biped.skew, height=biped.height, share=share, kappa=kappa
    )


def _spread(spread: Spread, value: float, shares: Array) -> Array:
    return np.asarray(value + shares * (spread.absolute + spread.part * abs(value)))


class _Worst:
    """The extremes so far."""

    def __init__(self, bodies: _Bodies) -> None:
        n = len(bodies.M)
        self._bodies = bodies
        self._toe, self._heel, self._cop = (np.full(n, np.inf) for _ in range(3))
        self._torque, self._friction, self._rate = np.zeros(n), np.zeros(n), np.zeros(n)

    def note(self, seen: _Seen, rate: Array | None = None) -> None:
        """Take what was ``seen``, and the torque's ``rate``, into account."""
        if rate is not None:
            np.fmax(self._rate, np.abs(rate), out=self._rate)
        toe, heel = (1 + self._bodies.skew), (1 - self._bodies.skew)
        np.fmin(self._toe, seen.F_T, out=self._toe)
        np.fmin(self._heel, seen.F_H, out=self._heel)
        P = (toe * seen.F_T - heel * seen.F_H) * self._bodies.ell / seen.load
        np.fmin(self._cop, np.minimum(toe * self._bodies.ell - P, heel * self._bodies.ell + P), out=self._cop)
        np.fmax(self._torque, np.abs(seen.tau), out=self._torque)
        np.fmax(self._friction, seen.slip, out=self._friction)

    def extremes(self, fallen: Array, paths: Paths | None = None) -> Extremes:
        """What it came to, where ``fallen`` (N,) says which bodies fell."""
        lost = -(self._bodies.M + self._bodies.m) * self._bodies.g

        def of(value: Array, fell: Array | float) -> Array:
            return np.asarray(np.where(fallen, fell, value))

        return Extremes(
            toe=of(self._toe, np.minimum(self._toe, lost)), heel=of(self._heel, np.minimum(self._heel, lost)),
            cop=of(self._cop, -self._bodies.ell), torque=of(self._torque, np.inf), friction=of(self._friction, np.inf),
            rate=of(self._rate, np.inf), paths=paths,
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
    deadline: float = math.inf,
) -> tuple[Array, Array]:
    """The smallest toe and heel force (N,) [N] of ``extremes``."""
    found = extremes(
        biped, kind, gains, scenario, tolerances, shares, step=step, theta_d=theta_d, target=target, adapt=adapt,
        known=known, deadline=deadline,
    )  # fmt: skip
    return found.toe, found.heel


def _moved(z: State, rate: State, h: float) -> State:
    return tuple(a + h * b for a, b in zip(z, rate, strict=True))


def _world(scenario: Scenario, M: Array, g: float, final: Array, ramp: Array):  # type: ignore[no-untyped-def]
    """(t, a time within the step) -> F_x and F_y (N,)."""
    nominal = float(scenario.times[-1])
    stretched = scenario.kind in ("slope", "force") and nominal > 0
    pace = nominal / np.maximum(ramp, 1e-9) if stretched else np.ones_like(M)  # a ramp that takes longer is slower

    def world(t: float, inside: float) -> tuple[Array, Array]:
        signal = scenario.signal_by(inside * pace, t * pace)
        if scenario.kind == "slope":
            alpha = signal[0] * final
            return M * g * np.sin(alpha), M * g * (1 - np.cos(alpha))
        if scenario.kind == "platform":
            return -M * signal[0], np.zeros_like(M)
        return signal[0], signal[1]

    return world
