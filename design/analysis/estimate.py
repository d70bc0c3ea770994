"""The external force, read off posture and ground reactions: at rest by (16)-(17), in motion by (1) and (5)-(7).

static
    F_y = (M + m) g - (F_T + F_H) (16),  F_x = -(F_T + F_H - m g) tan theta (17): true in the stationary posture.
    Elsewhere (1), (5)-(7) and (11) say by how much they are off (``off``):
        F_x: tau/(L cos theta) - (I/(L cos theta) - M L sin theta tan theta) theta'' + M L omega² sin theta
        F_y: M L (theta'' sin theta + omega² cos theta),    tau = ell (F_H - F_T)
    For a foot that is not the paper's L cos theta + h takes the place of L cos theta, I + M L h cos theta that of I,
    and (F_T + F_H) (P_d - P) that of tau.
dynamic
    The filter of ``design.analysis.observer``, with the torque of (11), which works while the body moves; for a foot
    that is not the paper's with the moment that toe and heel force have about the point under the ankle.

Each comes with what is known of its error, to first order: the ``spread`` that the sensors' noise makes, a standard
deviation, and the ``bias`` that a body within its tolerances can make, a bound. A force that changes is read late.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.analysis.observer import Observer, Seen, lag, observer
from design.model.body import Biped
from design.model.laws import Measurement
from design.model.sensing import Sensors
from design.model.uncertainty import Spread, Tolerances

Array = NDArray[np.float64]

BODY = ("M", "L", "I", "m", "ell")
REST = 2e-3
"""A state counts as stationary where motion makes the static estimate wrong by no more than this part of the weight."""
WINDOW = 0.5
"""Over which time [s] a stationary state is looked at."""
LONGEST_GAP = 0.2
"""How long [s] the dynamic estimate goes on without a measurement."""
RENEWED = 0.01
"""By how much theta [rad], or a force as part of the weight, may change before the filter is linearised anew."""


class Signals(NamedTuple):
    """What is measured at times ``t`` (n,) [s]: theta [rad], omega [rad/s], F_T and F_H [N], each (n,)."""

    t: Array
    theta: Array
    omega: Array
    F_T: Array
    F_H: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Estimate:
    """``F`` (2, n): F_x and F_y [N] at ``t`` (n,); ``spread`` (2, n), ``bias`` (2, n) [N]; ``lag`` (2,) [s]."""

    t: Array
    F: Array
    spread: Array
    bias: Array
    lag: tuple[float, float]


@dataclass(frozen=True, eq=False, kw_only=True)
class Rest:
    """The static estimate ``F`` (2,) at the end of a run, and whether the state there is ``stationary``.

    ``theta`` [rad] is the posture. ``off`` (2,): the largest error [N] that motion made within the window;
    ``spread``, ``bias`` (2,): as in ``Estimate``. ``why`` says what is not at rest.
    """

    theta: float
    F: tuple[float, float]
    stationary: bool
    off: tuple[float, float]
    spread: tuple[float, float]
    bias: tuple[float, float]
    why: str

    @property
    def bound(self) -> tuple[float, float]:
        """What the error of F stays below [N], with two standard deviations of noise."""
        return (
            self.off[0] + 2 * self.spread[0] + self.bias[0],
            self.off[1] + 2 * self.spread[1] + self.bias[1],
        )


def static_estimate(biped: Biped, theta: Array, F_T: Array, F_H: Array, target: float = 0.0) -> tuple[Array, Array]:
    """(F_x, F_y) [N] by (17) and (16); true at rest in the stationary posture, an approximation elsewhere.

    In the stationary posture the CoP is at the law's ``target`` [m]. There the moments about the point under the ankle
    are F_x (L cos theta + h) = -(load - m g) L sin theta - c m g + target load, in the names of ``design.model.plant``.
    """
    load = F_H + F_T
    F_y = (biped.weight - load) / (1.0 + biped.kappa)  # (16)
    F_x = -(load - (biped.m * biped.g - biped.kappa * F_y)) * np.tan(theta)  # (17)
    if biped.plain and target == 0.0:
        return F_x, F_y
    across = biped.L * np.cos(theta)
    return (F_x * across - biped.tilt_under(F_y) + target * load) / (across + biped.height), F_y


def off(biped: Biped, theta: Array, omega: Array, acceleration: Array, tau: Array) -> tuple[Array, Array]:
    """By how much (17) and (16) are too large [N] in motion, with theta'' = ``acceleration`` [rad/s²].

    ``tau`` [N m]: (F_T + F_H) (P_d - P), the torque of the paper's foot.
    """
    ML, s, c = biped.M * biped.L, np.sin(theta), np.cos(theta)
    down = ML * (acceleration * s + omega**2 * c) / (1.0 + biped.kappa)  # what (16) takes for a force
    if biped.height or biped.kappa:
        high = biped.L * c + biped.height
        turned = (biped.I + ML * biped.height * c) * acceleration - biped.height * ML * omega**2 * s
        weighed = down * (biped.L * s + biped.ell * biped.skew * biped.kappa)
        return (tau - turned + weighed) / high, down
    inertia = biped.I / (biped.L * c) - ML * s * s / c
    return tau / (biped.L * c) - inertia * acceleration + ML * omega**2 * s, down


def static(biped: Biped, signals: Signals, sensors: Sensors, tolerances: Tolerances, target: float = 0.0) -> Estimate:
    """(16)-(17) at every sample, each taken by itself; what motion does to it is not in its bounds.

    ``target`` [m] is where the law wants the CoP.
    """
    theta, F_T, F_H = signals.theta, signals.F_T, signals.F_H
    F = np.vstack(static_estimate(biped, theta, F_T, F_H, target))
    load, tangent = F_T + F_H - biped.m * biped.g, np.tan(theta)
    sum_deviation = math.sqrt(2) * _deviation(sensors.force, sensors.force_step)
    angle = _deviation(sensors.angle, sensors.angle_step)
    by_load, by_angle = tangent, load * (1 + tangent**2)
    if not biped.plain or target:
        high, along = biped.L * np.cos(theta) + biped.height, biped.L * np.sin(theta)
        by_load, by_angle = (target - along) / high, (load * biped.L * np.cos(theta) - F[0] * along) / high
    spread = np.vstack([np.hypot(by_load * sum_deviation, by_angle * angle), np.full_like(theta, sum_deviation)])

    def again(other: Biped) -> Array:
        return np.vstack(static_estimate(other, theta, F_T, F_H, target))

    return Estimate(t=signals.t, F=F, spread=spread, bias=_bias(biped, tolerances, again, F), lag=(0.0, 0.0))


def at_rest(biped: Biped, signals: Signals, sensors: Sensors, tolerances: Tolerances, target: float = 0.0) -> Rest:
    """The static estimate from means over the last ``WINDOW`` of the signals, and whether the body rests there.

    At rest the CoP is at ``target`` [m]. theta'' is taken from the slope of the rate. Raises ``ValueError`` for fewer
    than four samples.
    """
    begin = int(np.searchsorted(signals.t, signals.t[-1] - WINDOW - 1e-9))
    last = Signals(*(part[begin:] for part in signals))
    n = len(last.t)
    if n < 4:
        message = f"got {n} samples within the last {WINDOW:g} s; needs 4"
        raise ValueError(message)
    whole = Signals(*(part.mean(keepdims=True) for part in last))
    found = static(biped, whole, sensors, tolerances, target)
    spread = found.spread[:, 0] / math.sqrt(n)
    clock = last.t - last.t.mean()
    moment = float(clock @ clock)
    acceleration = float(clock @ last.omega) / moment if moment > 0 else 0.0
    parts = [Signals(*(part[piece].mean(keepdims=True) for part in last)) for piece in np.array_split(np.arange(n), 4)]
    moved = [
        off(biped, part.theta, part.omega, np.array([acceleration]), biped.behind(part.F_T, part.F_H, target))
        for part in parts
    ]
    most = np.abs(np.array(moved)[:, :, 0]).max(axis=0)
    force = _deviation(sensors.force, sensors.force_step)
    rate = _deviation(sensors.rate, sensors.rate_step)
    lean, high = biped.skew - target / biped.ell, biped.L + biped.height
    ground = biped.I + biped.M * biped.L * biped.height
    noise = math.hypot(
        biped.ell * math.sqrt(2 + 2 * lean**2) * force / (high * math.sqrt(n / 4)),
        ground / high * rate / math.sqrt(moment) if moment > 0 else 0.0,
    )
    allowed = REST * biped.weight + 3 * noise
    angle = _deviation(sensors.angle, sensors.angle_step)
    drift = abs(float(parts[-1].theta[0] - parts[0].theta[0]))
    drifts = drift * biped.weight > allowed + 3 * biped.weight * angle * math.sqrt(8 / n)
    stationary = bool(most.max() <= allowed) and not drifts
    why = ""
    if not stationary:
        tau, omega = float(biped.behind(whole.F_T[0], whole.F_H[0], target)), float(whole.omega[0])
        what = "torque" if biped.plain and target == 0.0 else "moment about the target of the CoP"
        why = (
            f"{what} {tau:.3g} N m, rate {math.degrees(omega):.3g} deg/s, acceleration"
            f" {math.degrees(acceleration):.3g} deg/s² over the last {last.t[-1] - last.t[0]:.2g} s: (16)-(17) are off"
            f" by up to {most[0]:.3g} N and {most[1]:.3g} N there"
        )
    return Rest(
        theta=float(whole.theta[0]), F=(float(found.F[0, 0]), float(found.F[1, 0])), stationary=stationary,
        off=(float(most[0]), float(most[1])), spread=(float(spread[0]), float(spread[1])),
        bias=(float(found.bias[0, 0]), float(found.bias[1, 0])), why=why,
    )  # fmt: skip


def dynamic(
    biped: Biped,
    signals: Signals,
    sensors: Sensors,
    tolerances: Tolerances,
    *,
    walk: float,
    valid: Array | None = None,
) -> Estimate:
    """The filter along evenly spaced ``signals``; the force is taken to walk by ``walk`` [N/√s].

    ``omega`` may be all NaN where the rate is not measured. Samples that are not ``valid`` (n,) are passed over; the
    estimate is NaN where nothing has been measured for ``LONGEST_GAP``. Raises ``ValueError`` for fewer than two
    samples.
    """
    if len(signals.t) < 2:
        message = f"got {len(signals.t)} samples; needs 2"
        raise ValueError(message)
    period = float(np.diff(signals.t).mean())
    if np.isnan(signals.omega).all():
        sensors = replace(sensors, rate=math.inf, rate_step=0.0)
        signals = signals._replace(omega=np.zeros_like(signals.t))
    watch = observer(biped, replace(sensors, delay=0.0), period=period, walk=walk, on_ground=not biped.plain)
    usable = np.all(np.isfinite(signals), axis=0) & (True if valid is None else np.asarray(valid, dtype=bool))
    F = _filtered(watch, signals, usable)

    def again(other: Biped) -> Array:
        return _filtered(replace(watch, biped=other), signals, usable)

    return Estimate(
        t=signals.t, F=F, spread=_spread(watch, signals, usable, F, sensors), bias=_bias(biped, tolerances, again, F),
        lag=lag(watch),
    )  # fmt: skip


def _filtered(watch: Observer, signals: Signals, usable: Array) -> Array:
    """F_x and F_y (2, n) of the filter."""
    F = np.full((2, len(signals.t)), np.nan)
    if not usable.any():
        return F
    tau = _drive(watch.biped, signals.F_T, signals.F_H)
    tau = np.interp(signals.t, signals.t[usable], tau[usable])
    middle = np.append(tau[:1], 0.5 * (tau[1:] + tau[:-1]))
    seen: Seen | None = None
    missing, longest = 0, LONGEST_GAP / watch.period
    rows = np.column_stack([*signals, tau, middle]).tolist()
    for k, ((t, theta, omega, F_T, F_H, now, until), good) in enumerate(zip(rows, usable.tolist(), strict=True)):
        if good:
            seen, missing = watch.corrected(t, Measurement(theta, omega, F_T, F_H), until, seen, now), 0
        else:
            missing += 1
            seen = watch.predicted(t, until, seen) if seen is not None and missing <= longest else None
        if seen is not None:
            F[:, k] = seen.F_x, seen.F_y
    return F


def _drive(biped: Biped, F_T: Any, F_H: Any) -> Any:
    """The torque (11) [N m]; of a foot that is not the paper's, what toe, heel and its weight turn about the ground.

    Where a field acts on the foot, its weight is that at rest, by (16).
    """
    return biped.behind(F_T, F_H) + biped.tilt_under((biped.weight - (F_T + F_H)) / (1.0 + biped.kappa))


def _spread(watch: Observer, signals: Signals, usable: Array, F: Array, sensors: Sensors) -> Array:
    """Standard deviations (2, n) of the filter's force by the noise alone, from its linearisation along the signals.

    Five errors are followed: theta, omega, F_x, F_y, and the last torque, which the forces tell with their noise.
    """
    force = _deviation(sensors.force, sensors.force_step) ** 2
    noise = np.diag(
        [
            _deviation(sensors.angle, sensors.angle_step) ** 2,
            _deviation(sensors.rate, sensors.rate_step) ** 2 if math.isfinite(sensors.rate) else 0.0,
            force,
            force,
        ]
    )
    n = len(signals.t)
    found = np.full((2, n), np.nan)
    if not noise.any():
        found[:, np.isfinite(F[0])] = 0.0
        return found
    covariance: Array | None = None
    place, J, G = np.full(3, np.inf), np.zeros((5, 5)), np.zeros((5, 4))
    scale = np.array([RENEWED, RENEWED * watch.biped.weight, RENEWED * watch.biped.weight])
    for k in range(n):
        if not np.isfinite(F[0, k]):
            covariance = None
            continue
        if usable[k]:
            here = np.array([signals.theta[k], *F[:, k]])
            if (np.abs(here - place) > scale).any():
                J, G = _linear(watch, signals, k, F[:, k])
                place = here
            covariance = _begun(watch, G, noise) if covariance is None else J @ covariance @ J.T + G @ noise @ G.T
        if covariance is not None:
            found[:, k] = np.sqrt(np.maximum(np.diag(covariance)[2:4], 0.0))
    return found


def _begun(watch: Observer, G: Array, noise: Array) -> Array:
    """The covariance after the first measurement: theta and omega as measured, F_x not looked at, F_y by the load."""
    first = np.zeros((5, 4))
    first[0, 0] = first[1, 1] = 1.0
    first[3, 2:] = -1.0
    first[4] = G[4]
    return first @ noise @ first.T


def _linear(watch: Observer, signals: Signals, k: int, F: Array) -> tuple[Array, Array]:
    """How an update of the filter passes on its errors (5, 5), and the measurement's noise (5, 4); by differences."""
    biped, weight = watch.biped, watch.biped.weight
    t = float(signals.t[k])
    tau = float(_drive(biped, signals.F_T[k], signals.F_H[k]))
    state = np.array([signals.theta[k], signals.omega[k], *F, tau])
    measured = np.array([signals.theta[k], signals.omega[k], signals.F_T[k], signals.F_H[k]])

    def update(z: Array, m: Array) -> Array:
        now = float(_drive(biped, m[2], m[3]))
        seen = watch.corrected(t, Measurement(*m.tolist()), 0.5 * (float(z[4]) + now), Seen(*z[:4].tolist()), now)
        return np.array([*seen, now])

    sizes = 1e-4 * np.array([1.0, 1.0, weight, weight, weight * biped.ell])
    J = np.column_stack([(update(state + d, measured) - update(state - d, measured)) for d in np.diag(sizes)])
    ways = 1e-4 * np.array([1.0, 1.0, weight, weight])
    G = np.column_stack([(update(state, measured + d) - update(state, measured - d)) for d in np.diag(ways)])
    return J / (2 * sizes), G / (2 * ways)


def _bias(biped: Biped, tolerances: Tolerances, again: Callable[[Biped], Array], F: Array) -> Array:
    """Bound (2, n) of the error that a body within ``tolerances`` makes, to first order: all parts at their worst."""
    found = np.where(np.isfinite(F), 0.0, np.nan)
    for name in BODY:
        tolerance: Spread = getattr(tolerances, name)
        value = getattr(biped, name)
        width = tolerance.around(value, 1.0) - value
        if width <= 0:
            continue
        step = 1e-4 * value
        slope = (again(replace(biped, **{name: value + step})) - again(replace(biped, **{name: value - step}))) / (
            2 * step
        )
        found += np.abs(slope) * width
    return found


def _deviation(deviation: float, step: float) -> float:
    return math.sqrt(deviation**2 + step**2 / 12)


def evenly(signals: Signals, period: float) -> Signals:
    """``signals`` at multiples of ``period`` [s] from their first time on; of two samples at a time the later one."""
    keep: Sequence[bool] | Array = np.append(np.diff(signals.t) > 0, True)
    t = signals.t[keep]
    at = t[0] + period * np.arange(int((t[-1] - t[0]) / period + 1e-6) + 1)
    return Signals(at, *(np.interp(at, t, part[keep]) for part in signals[1:]))
