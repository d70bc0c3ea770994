"""Where a trial starts: in the posture that the last estimate gives, unless the world is another by then.

The estimate (16)-(17) gives theta_d by (15), the starting posture, and by (14) the law's integral, which is
(K_p/K_f)(theta_start - theta_d) = 0 there. Before the trial begins the robot stands in that posture, and toe and heel
force say what torque it takes: tau = ell (F_H - F_T) (11), and at rest tau = -A L sin(theta - theta_f). So they say how
far theta_f is. If it is farther than the estimate's own error and ``TOLERANCE``, the world starts anew, and the trial
starts as the spec says.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from design.analysis.estimate import WINDOW, Rest, Signals, at_rest, static_estimate
from design.analysis.simulate import Trajectory
from design.model.body import Biped
from design.model.environment import Scenario
from design.model.sensing import Sensors
from design.spec.setting import Setting

Array = NDArray[np.float64]

TOLERANCE = math.radians(0.1)
"""How far theta_f may be from a start beyond what the estimate's error explains [rad]."""


@dataclass(frozen=True, kw_only=True)
class Start:
    """How a trial begins: ``theta_d`` of its law, ``theta0``, ``omega0`` and the integral ``s0``.

    ``estimated``: from the last trial's estimate. ``why`` it is so; ``away`` [rad] how far theta_f is from the
    estimate's posture as toe and heel force tell, None where there is no estimate. ``blindly``: in spite of that.
    """

    theta_d: float
    theta0: float
    omega0: float
    s0: float
    estimated: bool
    why: str
    away: float | None = None
    blindly: bool = False


@dataclass(frozen=True, kw_only=True)
class Reading:
    """What a trial's end says: ``theta`` [rad], ``F`` [N] by (16)-(17), their errors' bounds, and whether it rests.

    ``bound`` is that of F; ``error`` [rad] that of theta as the stationary posture, in which the body's numbers cancel.
    """

    theta: float
    F: tuple[float, float]
    bound: tuple[float, float]
    error: float
    stationary: bool
    why: str


def as_specified(setting: Setting, scenario: Scenario, why: str, away: float | None = None) -> Start:
    """The start that the spec writes."""
    return Start(
        theta_d=setting.theta_d, theta0=scenario.theta0, omega0=scenario.omega0, s0=0.0, estimated=False, why=why,
        away=away,
    )  # fmt: skip


def from_reading(reading: Reading, why: str, away: float) -> Start:
    """At rest in the posture of the ``reading``, its theta_d by (15), and the integral of (14)."""
    theta_d = reading.theta  # (16)-(17) in (15)
    return Start(theta_d=theta_d, theta0=theta_d, omega0=0.0, s0=0.0, estimated=True, why=why, away=away)


def sampled(setting: Setting, t: Array, truth: Array, noise: np.random.Generator) -> Signals:
    """theta, omega, F_T, F_H (4, n) as the sensors tell them once a control period, over the last ``WINDOW`` of t."""
    sensors = setting.sensors
    span = min(WINDOW, float(t[-1] - t[0]))
    n = max(4, round(span / setting.study.control_period_s))
    times = t[-1] - (span / n) * np.arange(n)[::-1]
    values = np.array([np.interp(times, t, row) for row in truth])
    deviations = np.array([sensors.angle, sensors.rate, sensors.force, sensors.force])
    values = values + deviations[:, None] * noise.standard_normal(values.shape)
    for row, step in zip(values, (sensors.angle_step, sensors.rate_step, *(sensors.force_step,) * 2), strict=True):
        if step > 0:
            row[:] = step * np.round(row / step)
    return Signals(times, *values)


def read(setting: Setting, run: Trajectory, noise: np.random.Generator) -> Reading:
    """The estimate at the end of a ``run``, by who knows the nominal body.

    Exact sensors: from the last sample. Otherwise from means over the last ``WINDOW``, one sample a control period.
    """
    biped, sensors = setting.biped, setting.sensors
    signals = sampled(setting, run.t, np.array([run.theta, run.omega, run.F_T, run.F_H]), noise)
    rest: Rest = at_rest(biped, signals, sensors, setting.tolerances)
    theta, F = rest.theta, rest.F
    if sensors.exact:
        theta = float(run.theta[-1])
        F_x, F_y = static_estimate(biped, run.theta[-1:], run.F_T[-1:], run.F_H[-1:])
        F = float(F_x[0]), float(F_y[0])
    return Reading(
        theta=theta, F=F, bound=rest.bound, error=_posture_error(biped, sensors, rest, theta, len(signals.t)),
        stationary=rest.stationary, why=rest.why,
    )  # fmt: skip


def _posture_error(biped: Biped, sensors: Sensors, rest: Rest, theta: float, n: int) -> float:
    """How far theta_f may be from ``theta`` [rad]: what motion makes of F, and two deviations of the angle's mean."""
    A = math.hypot(biped.M * biped.g - rest.F[1], rest.F[0])
    motion = (abs(math.cos(theta)) * rest.off[0] + abs(math.sin(theta)) * rest.off[1]) / A
    return motion + 2 * math.hypot(sensors.angle, sensors.angle_step / math.sqrt(12)) / math.sqrt(n)


def standing(setting: Setting, real: Biped, F: Array, theta: float, noise: np.random.Generator) -> tuple[float, str]:
    """theta_f [rad] as toe and heel force tell it to who stands still at ``theta`` while ``F`` (2,) acts.

    And, in words, how they do; where the foot cannot give the torque that it takes, nobody stands there.
    """
    biped = setting.biped
    down = real.M * real.g - F[1]
    tau = -real.L * (down * math.sin(theta) + F[0] * math.cos(theta))  # (1), -A L sin(theta - theta_f)
    half = 0.5 * (real.m * real.g + down)
    truth = np.array([theta, 0.0, half - tau / (2 * real.ell), half + tau / (2 * real.ell)])  # (5), (6)
    told = sampled(setting, np.array([-WINDOW, 0.0]), np.column_stack([truth, truth]), noise)
    angle, F_T, F_H = (float(part.mean()) for part in (told.theta, told.F_T, told.F_H))
    load = F_T + F_H - biped.m * biped.g
    F_x = -(load * math.sin(angle) + biped.ell * (F_H - F_T) / biped.L) / math.cos(angle)
    theta_f = math.atan2(-F_x, load)
    if min(truth[2:]) < 0:
        takes, gives = abs(tau), real.ell * 2 * half
        return theta_f, (
            f"the world's at the start is {_degrees(theta_f)}: standing there would take {takes:.3g} N m, and the foot"
            f" can give {gives:.3g} N m"
        )
    return theta_f, f"toe and heel say that the world's at the start is {_degrees(theta_f)}"


def decide(
    setting: Setting,
    real: Biped,
    scenario: Scenario,
    reading: Reading | None,
    why_not: str,
    noise: np.random.Generator,
    *,
    blind: bool,
) -> Start:
    """The start of a trial in the real ``scenario`` after one that said ``reading``, or (None) ``why_not``."""
    if reading is None:
        return as_specified(setting, scenario, why_not)
    F = scenario.force_at(np.zeros(1))[:, 0]
    theta_f, where = standing(setting, real, F, reading.theta, noise)
    away, spec = abs(theta_f - reading.theta), abs(theta_f - scenario.theta0)
    told = 2 * _told(setting)
    why = f"{where}, {_degrees(away)} from the estimate's"
    against = ""
    if away > reading.error + TOLERANCE + told:
        against = f"the estimate's posture is {_degrees(reading.theta)}, but {where}"
        if away < spec:
            against += f"; yet that is nearer than the spec's {_degrees(scenario.theta0)} (--blind uses it)"
    elif not reading.stationary and away >= spec:
        against = (
            "the last trial did not come to rest; toe and heel say that its end is no nearer than the spec's start"
        )
    if against and not blind:
        return as_specified(setting, scenario, against, away)
    return replace(from_reading(reading, against or why, away), blindly=bool(against))


def _degrees(angle: float) -> str:
    return f"{round(math.degrees(angle), 2) + 0.0:.2f} deg"


def _told(setting: Setting) -> float:
    """The standard deviation [rad] of what toe and heel force tell of theta_f while standing."""
    biped, sensors = setting.biped, setting.sensors
    n = max(4, round(WINDOW / setting.study.control_period_s))
    force = math.hypot(sensors.force, sensors.force_step / math.sqrt(12))
    angle = math.hypot(sensors.angle, sensors.angle_step / math.sqrt(12))
    AL = biped.M * biped.g * biped.L
    return math.hypot(math.sqrt(2) * biped.ell * force / AL, angle) / math.sqrt(n)


def begun(scenario: Scenario, start: Start) -> Scenario:
    """``scenario`` with the ``start``'s posture."""
    return replace(scenario, theta0=start.theta0, omega0=start.omega0)
