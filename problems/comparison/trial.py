"""One trial: a controller against one drawn body, world, and noise, until the end or until contact is lost.

The plant is the nonlinear model, stepped as the spec says, with the torque held for a control period. Contact is
unilateral: at the first negative force the trial ends, failed.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.analysis.simulate import FALLEN
from design.buffered import Buffered
from design.model.actuator import Actuator
from design.model.body import Biped
from design.model.environment import Scenario
from design.model.laws import Controller, Measurement
from design.model.plant import body_numbers, held, reactions
from design.model.sensing import Sensors

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class World:
    """What is true in a trial: the real ``biped`` and ``scenario``, and the noise's ``draws`` (n, 4).

    ``target`` [m]: where the CoP is to come to rest.
    """

    biped: Biped
    scenario: Scenario
    sensors: Sensors
    draws: Array | None
    target: float = 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Run:
    """What happened, at the beginning of each control period.

    ``t`` (n,), ``states`` (2, n+1), ``torque`` (n,), ``contact`` (3, n) the smallest F_T, F_H and CoP margin within the
    period, ``seconds`` (n,) that the controller took. ``lost``: when contact was lost and at which end of the foot;
    ``fallen``: when the body fell; ``failed``: why the controller could not go on. ``memory`` is its last.
    """

    t: Array
    states: Array
    torque: Array
    contact: Array
    seconds: Array
    lost: tuple[float, str] | None
    fallen: float | None
    failed: str
    memory: Any


@dataclass(frozen=True, eq=False, kw_only=True)
class Course:
    """A scenario cut into control periods at ``t`` (n,): integration steps ``u`` (n, 7, k), ``force`` (2, n)."""

    t: Array
    u: Array
    force: Array


@lru_cache(maxsize=8)
def course(scenario: Scenario, period: float, step: float) -> Course:
    """Control periods of ``period`` [s] in steps of at most ``step`` [s]; none crosses a corner of the force."""
    count = max(1, math.ceil(scenario.duration / period - 1e-6))
    t = np.asarray(period * np.arange(count))
    inner = max(1, math.ceil(period / step - 1e-9))
    fine = scenario.steps_at(np.asarray(period / inner * np.arange(count * inner + 1)))
    steps = np.column_stack([fine.h, fine.start.T, fine.middle.T, fine.end.T])
    real = fine.h > 0
    steps, middle = steps[real], (fine.t[:-1] + 0.5 * fine.h)[real]
    of = np.minimum((middle / period + 1e-9).astype(int), count - 1)
    used = np.bincount(of, minlength=count)
    u = np.zeros((count, 7, int(used.max())))
    u[of, :, np.arange(len(of)) - np.searchsorted(of, of)] = steps
    for k in np.flatnonzero(used < used.max()):  # filled up with steps of no length
        u[k, 1:, used[k] :] = np.tile(u[k, 5:7, used[k] - 1], 3)[:, None]
    return Course(t=t, u=u, force=scenario.force_at(t))


@lru_cache(maxsize=16)
def _plant(count: int) -> tuple[Buffered, Buffered]:
    return Buffered(held(count)), Buffered(reactions())


def run(world: World, controller: Controller[Any], actuator: Actuator, step: float) -> Run:
    """Run ``controller`` through ``world``; never raises for what the controller does."""
    biped, scenario, sensors = world.biped, world.scenario, world.sensors
    way = course(scenario, actuator.period, step)
    count = len(way.t)
    plant, reaction = _plant(way.u.shape[2])
    body = list(body_numbers(biped))
    states, torque = np.full((2, count + 1), np.nan), np.full(count, np.nan)
    contact, seconds = np.full((3, count), np.nan), np.full(count, np.nan)
    x = np.array([scenario.theta0, scenario.omega0])
    delay = round(sensors.delay / actuator.period)
    then = reaction(x=x, tau=0.0, body=body, F=0.0)["forces"].tolist()
    readings = [Measurement(scenario.theta0, scenario.omega0, *then)] * delay  # before the start
    tau, lost, fallen, failed = 0.0, None, None, ""
    forces = reaction(x=x, tau=tau, body=body, F=way.force[:, 0])["forces"]
    ahead = np.column_stack([way.force[:, 1:], way.force[:, -1:]]).T
    memory: Any = None
    k = -1
    for k in range(count):
        states[:, k] = x
        readings.append(Measurement(*x.tolist(), *forces.tolist()))
        told = readings[k] if world.draws is None else sensors.reading(readings[k], world.draws[k])
        began = time.perf_counter()
        try:
            if k == 0:
                memory = controller.start()
            wanted, memory = controller(float(way.t[k]), told, memory)
        except Exception as error:
            failed = f"{type(error).__name__}: {error}"[:200]
            break
        seconds[k] = time.perf_counter() - began
        if not math.isfinite(wanted):
            failed = f"the controller gave {wanted}"
            break
        tau = actuator.given(wanted, tau)
        torque[k] = tau
        after = plant(x=x, tau=tau, body=body, u=way.u[k].T.ravel(), F=ahead[k])
        x, forces, along = after["x_next"].copy(), after["forces"], after["contact"].reshape(-1, 3).T
        contact[:, k] = along.min(axis=1)
        if not (contact[0, k] >= 0 and contact[1, k] >= 0):
            lost = _lost(along, way.u[k], float(way.t[k]))
            break
        if not abs(x[0]) < FALLEN:
            fallen = float(way.t[k]) + actuator.period
            break
    states[:, k + 1] = x
    n = k + 1
    return Run(
        t=way.t[:n], states=states[:, : n + 1], torque=torque[:n], contact=contact[:, :n], seconds=seconds[:n],
        lost=lost, fallen=fallen, failed=failed, memory=memory,
    )  # fmt: skip


def _lost(along: Array, u: Array, start: float) -> tuple[float, str]:
    """The end of the first step with a negative force, and the end of the foot that lifts."""
    at = int(np.argmax((along[:2] < 0).any(axis=0)))
    return start + float(u[0, : at + 1].sum()), "toe" if along[0, at] < 0 else "heel"
