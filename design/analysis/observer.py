"""What a controller can know of the world from theta, omega, F_T and F_H: the dynamic counterpart of (16)-(17).

A Kalman filter with constant gain. The external force is a random walk of ``walk`` [N/√s]. The load F_T + F_H shows
F_y by (5)-(7); F_x shows in the rate, by (2), one period late: that is what a sudden slope costs who is not told of it.
The prediction is the nonlinear model under the torque that was applied; at rest both estimates are (16) and (17).
Measurements that are ``delay`` periods old are brought up to now with the torques given since.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple, Protocol

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from design.model.body import Biped
from design.model.laws import Measurement
from design.model.sensing import Sensors

Array = NDArray[np.float64]


class Seen(NamedTuple):
    """An estimate at the time of the last measurement: theta [rad], omega [rad/s], F_x and F_y [N]."""

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
    ``known`` gives the force (F_x, F_y) at a time where it need not be estimated, and ``future`` the force over the
    prediction that begins then.
    """

    biped: Biped
    period: float
    delay: int
    gain: tuple[tuple[float, float], ...]
    gain_y: float
    known: Callable[[float], tuple[float, float]] | None = None
    future: Callable[[float], Array] | None = None

    def start(self) -> None:
        """Nothing is known before the first measurement."""
        return

    def __call__(
        self, t: float, measurement: Measurement, torques: Sequence[float], seen: Seen | None
    ) -> tuple[Belief, Seen]:
        """See ``Informant``."""
        measured_at = t - self.delay * self.period
        seen = self._corrected(measured_at, measurement, torques[0], seen)
        theta, omega, F_x, F_y = seen
        for tau in torques[1:]:
            theta, omega = self._ahead(theta, omega, tau, F_x, F_y)
        if self.known is not None:
            F_x, F_y = self.known(t)
        return Belief(theta, omega, F_x, F_y, None if self.future is None else self.future(t)), seen

    def _corrected(self, t: float, measurement: Measurement, tau: float, seen: Seen | None) -> Seen:
        """The estimate at the time ``t`` of the ``measurement``; until then the torque was ``tau``."""
        biped = self.biped
        if seen is None:
            theta, omega, F_x, F_y = measurement.theta, measurement.omega, 0.0, 0.0
        else:
            theta, omega = self._ahead(seen.theta, seen.omega, tau, seen.F_x, seen.F_y)
            angle_off, rate_off = measurement.theta - theta, measurement.omega - omega
            (a, b), (c, d), (e, f) = self.gain
            theta += a * angle_off + b * rate_off
            omega += c * angle_off + d * rate_off
            F_x, F_y = seen.F_x + e * angle_off + f * rate_off, seen.F_y
        if self.known is not None:
            return Seen(theta, omega, *self.known(max(t, 0.0)))
        acceleration = _acceleration(biped, theta, tau, F_x, F_y)
        down = biped.M * biped.L * (acceleration * math.sin(theta) + omega**2 * math.cos(theta))
        apparent = biped.weight - (measurement.F_T + measurement.F_H) - down  # (5)-(7); at rest (16)
        return Seen(theta, omega, F_x, F_y + (1.0 if seen is None else self.gain_y) * (apparent - F_y))

    def _ahead(self, theta: float, omega: float, tau: float, F_x: float, F_y: float) -> tuple[float, float]:
        """One period later, by a Runge-Kutta step of (1)-(2)."""
        h, biped = self.period, self.biped
        k1 = _acceleration(biped, theta, tau, F_x, F_y)
        k2 = _acceleration(biped, theta + h / 2 * omega, tau, F_x, F_y)
        k3 = _acceleration(biped, theta + h / 2 * omega + h * h / 4 * k1, tau, F_x, F_y)
        k4 = _acceleration(biped, theta + h * omega + h * h / 2 * k2, tau, F_x, F_y)
        return theta + h * omega + h * h / 6 * (k1 + k2 + k3), omega + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def _acceleration(biped: Biped, theta: float, tau: float, F_x: float, F_y: float) -> float:
    M, L, I, g = biped.M, biped.L, biped.I, biped.g
    return ((M * g - F_y) * L * math.sin(theta) + F_x * L * math.cos(theta) + tau) / I  # (2)


def observer(
    biped: Biped,
    sensors: Sensors,
    *,
    period: float,
    walk: float,
    known: Callable[[float], tuple[float, float]] | None = None,
    future: Callable[[float], Array] | None = None,
) -> Observer:
    """The observer that is best on average for these ``sensors`` if the force walks by ``walk`` [N/√s]."""
    gain, gain_y = _gains(biped, sensors, period, walk)
    return Observer(
        biped=biped, period=period, delay=round(sensors.delay / period), gain=gain, gain_y=gain_y, known=known,
        future=future,
    )  # fmt: skip


@lru_cache(maxsize=64)
def _gains(biped: Biped, sensors: Sensors, period: float, walk: float) -> tuple[tuple[tuple[float, float], ...], float]:
    """Stationary Kalman gains about the upright posture on level ground."""
    stiffness = biped.M * biped.g * biped.L / biped.I
    rates = np.array([[0.0, 1.0, 0.0], [stiffness, 0.0, biped.L / biped.I], [0.0, 0.0, 0.0]])
    A = scipy.linalg.expm(rates * period)
    C = np.eye(2, 3)
    # a floor far below any sensor's resolution keeps the equation solvable for exact sensors
    angle = _variance(sensors.angle, sensors.angle_step) + 1e-7**2
    rate = _variance(sensors.rate, sensors.rate_step) + 1e-6**2
    drift = walk**2 * period
    R = np.diag([angle, rate])
    P = scipy.linalg.solve_discrete_are(A.T, C.T, np.diag([0.0, 0.0, drift]), R)
    K = np.linalg.solve(C @ P @ C.T + R, C @ P).T
    load = 2 * _variance(sensors.force, sensors.force_step) + 1e-3**2
    predicted = 0.5 * (drift + math.sqrt(drift**2 + 4 * drift * load))
    return tuple((float(a), float(b)) for a, b in K), predicted / (predicted + load)


def _variance(deviation: float, step: float) -> float:
    return deviation**2 + step**2 / 12
