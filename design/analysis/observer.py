"""What a controller can know of the world from theta, omega, F_T and F_H: the dynamic counterpart of (16)-(17).

A Kalman filter with constant gain. The external force is a random walk of ``walk`` [N/√s]. The load F_T + F_H shows
F_y by (5)-(7); F_x shows in the rate, by (2), one period late: that is what a sudden slope costs who is not told of it.
The prediction is the nonlinear model under the torque that was applied; at rest both estimates are (16) and (17).
Who is told the force estimates, more slowly, what is missing in it: a body that is not the nominal one acts like a
force.
Who does not know the torque, but what toe and heel force turn about the point *on the ground* under an ankle of height
h, has for (2) the moments about that point:

    (I + M L h cos theta) theta'' = (M g - F_y) L sin theta + F_x (L cos theta + h) + moment + h M L omega² sin theta

Measurements that are ``delay`` periods old are brought up to now with the torques given since.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from design.errors import BadInput
from design.model.body import Biped
from design.model.laws import Measurement
from design.model.sensing import Sensors

Array = NDArray[np.float64]

MISSING = 0.1
"""How fast what is missing in a force that is told walks, by how fast one does that is not."""


class Seen(NamedTuple):
    """An estimate at the time of the last measurement: theta [rad], omega [rad/s], F_x and F_y [N].

    Of an observer that is told a force: what is missing in it.
    """

    theta: float
    omega: float
    F_x: float
    F_y: float


class Belief(NamedTuple):
    """What a controller believes now; ``ahead`` (2, N+1) the force over its prediction, None where it is held."""

    theta: float
    omega: float
    F_x: float
    F_y: float
    ahead: Array | None = None


class Informant(Protocol):
    """Turns measurements into a belief; holds no state."""

    def start(self) -> Seen | None:
        """What is known before the first measurement."""
        ...

    def __call__(
        self, t: float, measurement: Measurement, torques: Sequence[float], seen: Seen | None
    ) -> tuple[Belief, Seen]:
        """The belief at ``t`` [s]; ``torques`` [N m] are those of the last periods, as many as the delay and one."""
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class Observer:
    """The filter for ``biped``, called once a ``period`` [s], with measurements ``delay`` periods old.

    ``gain`` (3, 2) corrects theta, omega and F_x by the errors of angle and rate, ``gain_y`` F_y by that of the load.
    ``known`` gives the force (F_x, F_y) that is told at a time, and ``future`` the one over the prediction that begins
    then; what is estimated is then what is missing in it. ``on_ground``: torques are moments about the ground.
    """

    biped: Biped
    period: float
    delay: int
    gain: tuple[tuple[float, float], ...]
    gain_y: float
    known: Callable[[float], tuple[float, float]] | None = None
    future: Callable[[float], Array] | None = None
    on_ground: bool = False

    def start(self) -> None:
        """Nothing is known before the first measurement."""
        return

    def __call__(
        self, t: float, measurement: Measurement, torques: Sequence[float], seen: Seen | None
    ) -> tuple[Belief, Seen]:
        """See ``Informant``."""
        at = t - self.delay * self.period
        seen = self.corrected(at, measurement, torques[0], seen)
        theta, omega = seen.theta, seen.omega
        for tau in torques[1:]:
            at += self.period
            theta, omega = self._ahead(theta, omega, tau, *self._force(at - 0.5 * self.period, seen))
        F_x, F_y = self._force(t, seen)
        ahead = None if self.future is None else self.future(t) + np.array([[seen.F_x], [seen.F_y]])
        return Belief(theta, omega, F_x, F_y, ahead), seen

    def _force(self, t: float, seen: Seen) -> tuple[float, float]:
        """The force at ``t``, and what was told for the middle of a period counts for the whole."""
        if self.known is None:
            return seen.F_x, seen.F_y
        told = self.known(max(t, 0.0))
        return told[0] + seen.F_x, told[1] + seen.F_y

    def predicted(self, t: float, tau: float, seen: Seen) -> Seen:
        """The estimate at ``t``, from the one a period before, by the torque ``tau`` [N m] between."""
        theta, omega = self._ahead(seen.theta, seen.omega, tau, *self._force(t - 0.5 * self.period, seen))
        return seen._replace(theta=theta, omega=omega)

    def corrected(
        self, t: float, measurement: Measurement, tau: float, seen: Seen | None, tau_now: float | None = None
    ) -> Seen:
        """The estimate at the time ``t`` of the ``measurement``; until then the torque was ``tau`` [N m].

        ``tau_now``: the torque under which toe and heel force were measured, where it is another.
        """
        M, L, g = self.biped.M, self.biped.L, self.biped.g
        angle, rate, F_T, F_H = measurement
        if seen is None:
            theta, omega, missing_x, missing_y, gain_y = angle, rate, 0.0, 0.0, 1.0
        else:
            theta, omega = self._ahead(seen.theta, seen.omega, tau, *self._force(t - 0.5 * self.period, seen))
            angle_off, rate_off = angle - theta, rate - omega
            (a, b), (c, d), (e, f) = self.gain
            theta, omega = theta + a * angle_off + b * rate_off, omega + c * angle_off + d * rate_off
            missing_x, missing_y, gain_y = seen.F_x + e * angle_off + f * rate_off, seen.F_y, self.gain_y
        seen = Seen(theta, omega, missing_x, missing_y)
        F_x, F_y = self._force(t, seen)
        s, c = math.sin(theta), math.cos(theta)
        if tau_now is not None:
            tau = tau_now
        if self.on_ground:
            acceleration = _on_ground(self.biped, theta, omega, tau, F_x, F_y)
        else:
            acceleration = ((M * g - F_y) * L * s + F_x * L * c + tau) / self.biped.I  # (2)
        down = M * L * (acceleration * s + omega**2 * c)
        apparent = (self.biped.weight - (F_T + F_H) - down) / (1.0 + self.biped.kappa)  # (5)-(7); at rest (16)
        return Seen(theta, omega, missing_x, missing_y + gain_y * (apparent - F_y))

    def _ahead(self, theta: float, omega: float, tau: float, F_x: float, F_y: float) -> tuple[float, float]:
        """One period later, by a Runge-Kutta step of (1)-(2)."""
        h, I, sin, cos = self.period, self.biped.I, math.sin, math.cos
        if self.on_ground:
            return _ahead_on_ground(self.biped, h, theta, omega, tau, F_x, F_y)
        down, push = (self.biped.M * self.biped.g - F_y) * self.biped.L, F_x * self.biped.L
        k1 = (down * sin(theta) + push * cos(theta) + tau) / I
        middle = theta + h / 2 * omega
        k2 = (down * sin(middle) + push * cos(middle) + tau) / I
        middle += h * h / 4 * k1
        k3 = (down * sin(middle) + push * cos(middle) + tau) / I
        end = theta + h * omega + h * h / 2 * k2
        k4 = (down * sin(end) + push * cos(end) + tau) / I
        return theta + h * omega + h * h / 6 * (k1 + k2 + k3), omega + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def _ahead_on_ground(
    biped: Biped, h: float, theta: float, omega: float, moment: float, F_x: float, F_y: float
) -> tuple[float, float]:
    """The same by the moments about the ground, which ask for the rate too."""
    k1 = _on_ground(biped, theta, omega, moment, F_x, F_y)
    k2 = _on_ground(biped, theta + h / 2 * omega, omega + h / 2 * k1, moment, F_x, F_y)
    k3 = _on_ground(biped, theta + h / 2 * omega + h * h / 4 * k1, omega + h / 2 * k2, moment, F_x, F_y)
    k4 = _on_ground(biped, theta + h * omega + h * h / 2 * k2, omega + h * k3, moment, F_x, F_y)
    return theta + h * omega + h * h / 6 * (k1 + k2 + k3), omega + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def _on_ground(biped: Biped, theta: float, omega: float, moment: float, F_x: float, F_y: float) -> float:
    M, L, h, s, c = biped.M, biped.L, biped.height, math.sin(theta), math.cos(theta)
    turning = (M * biped.g - F_y) * L * s + F_x * (L * c + h) + moment + h * M * L * omega**2 * s
    return turning / (biped.I + M * L * h * c)


def observer(
    biped: Biped,
    sensors: Sensors,
    *,
    period: float,
    walk: float,
    known: Callable[[float], tuple[float, float]] | None = None,
    future: Callable[[float], Array] | None = None,
    on_ground: bool = False,
) -> Observer:
    """The observer that is best on average for these ``sensors`` if the force walks by ``walk`` [N/√s].

    What is missing in a force that is ``known`` walks by ``MISSING`` times as much. Raises ``BadInput`` for a body
    that falls too far within a ``period`` to be observed.
    """
    if known is not None:
        walk *= MISSING
    gain, gain_y = _gains(biped, sensors, period, walk, on_ground)
    return Observer(
        biped=biped, period=period, delay=round(sensors.delay / period), gain=gain, gain_y=gain_y, known=known,
        future=future, on_ground=on_ground,
    )  # fmt: skip


@lru_cache(maxsize=64)
def _gains(
    biped: Biped, sensors: Sensors, period: float, walk: float, on_ground: bool
) -> tuple[tuple[tuple[float, float], ...], float]:
    """Stationary Kalman gains about the upright posture on level ground; an infinite deviation: not measured."""
    import scipy.linalg

    A = _free(biped, period, on_ground)
    # a floor far below any sensor's resolution keeps the equation solvable for exact sensors
    angle = _variance(sensors.angle, sensors.angle_step) + 1e-7**2
    rate = _variance(sensors.rate, sensors.rate_step) + 1e-6**2
    drift = walk**2 * period
    measured = 2 if math.isfinite(rate) else 1
    C, R = np.eye(measured, 3), np.diag([angle, rate][:measured])
    K = np.zeros((3, 2))
    try:
        P = scipy.linalg.solve_discrete_are(A.T, C.T, np.diag([0.0, 0.0, drift]), R)
        K[:, :measured] = np.linalg.solve(C @ P @ C.T + R, C @ P).T
    except np.linalg.LinAlgError as error:
        message = f"the body falls {A[0, 0]:.2g}-fold within a sample of {period:g} s; needs samples closer together"
        raise BadInput(message, key="body") from error
    load = 2 * _variance(sensors.force, sensors.force_step) + 1e-3**2
    predicted = 0.5 * (drift + math.sqrt(drift**2 + 4 * drift * load))
    return tuple((float(a), float(b)) for a, b in K), predicted / (predicted + load)


def lag(watch: Observer) -> tuple[float, float]:
    """How late [s] a force that changes evenly is read, F_x about the upright posture, and F_y."""
    biped, h = watch.biped, watch.period
    push = _upright(biped, watch.on_ground)[1]
    A = _free(biped, h, watch.on_ground)
    K = np.array(watch.gain)
    keep = np.eye(3) - K @ np.eye(2, 3)
    within = np.array([push * h**3 / 6, push * h**2 / 2, h])  # what a rise by 1 N/s does in a period
    error = np.linalg.solve(np.eye(3) - keep @ A, keep @ within)
    return float(error[2]), h * (1 - watch.gain_y) / watch.gain_y


def _upright(biped: Biped, on_ground: bool) -> tuple[float, float]:
    """What theta [rad] and F_x [N] make of theta'' about the upright posture on level ground."""
    height = biped.height if on_ground else 0.0
    inertia = biped.I + biped.M * biped.L * height
    return biped.M * biped.g * biped.L / inertia, (biped.L + height) / inertia


def _free(biped: Biped, period: float, on_ground: bool) -> Array:
    """How theta, omega and F_x go on over a period, about the upright posture on level ground."""
    import scipy.linalg

    stiffness, push = _upright(biped, on_ground)
    rates = np.array([[0.0, 1.0, 0.0], [stiffness, 0.0, push], [0.0, 0.0, 0.0]])
    return np.asarray(scipy.linalg.expm(rates * period))


def _variance(deviation: float, step: float) -> float:
    return deviation**2 + step**2 / 12
