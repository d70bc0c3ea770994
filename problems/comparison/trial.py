"""One trial: a controller against one drawn body, world, and noise, until the end or until contact is lost.

The plant is the nonlinear model, stepped as the spec says, with the torque held for a control period. Contact is
unilateral: at the first negative force the trial ends, failed.
"""

from __future__ import annotations

import math
import time
from collections import deque
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
    """A scenario cut into control periods at ``t`` (n,): integration steps ``u`` (n, 7, k), ``force`` (2, n).

    ``drive`` (n, 7 k + 2): the same as ``design.model.plant.held`` takes it, each period's steps and the force after.
    """

    t: Array
    u: Array
    force: Array
    drive: Array


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
    last = np.tile(u[np.arange(count), 5:7, used - 1], 3)
    for j in range(int(used.min()), int(used.max())):  # filled up with steps of no length
        u[used <= j, 1:, j] = last[used <= j]
    force = scenario.force_at(t)
    ahead = np.column_stack([force[:, 1:], force[:, -1:]]).T
    drive = np.column_stack([u.transpose(0, 2, 1).reshape(count, -1), ahead])
    return Course(t=t, u=u, force=force, drive=drive)


@lru_cache(maxsize=16)
def _plant(count: int) -> tuple[Buffered, Buffered]:
    return Buffered(held(count)), Buffered(reactions())


def run(world: World, controller: Controller[Any], actuator: Actuator, step: float) -> Run:
    """Run ``controller`` through ``world``; never raises for what the controller does."""
    biped, scenario, sensors = world.biped, world.scenario, world.sensors
    way = course(scenario, actuator.period, step)
    plant, reaction = _plant(way.u.shape[2])
    body = list(body_numbers(biped))
    plant.given["body"][:] = body
    x, held_torque, drive = plant.given["x"], plant.given["tau"], plant.given["drive"]
    after, along = (plant.found[name] for name in ("after", "contact"))
    contact = np.full((len(way.t), len(along)), np.nan)
    states, torque, seconds = [(scenario.theta0, scenario.omega0)], [], []
    before = reaction(x=states[0], tau=0.0, body=body, F=0.0)["forces"].tolist()
    start = reaction(x=states[0], tau=0.0, body=body, F=way.force[:, 0])["forces"].tolist()
    readings = deque([Measurement(*states[0], *before)] * round(sensors.delay / actuator.period))
    readings.append(Measurement(*states[0], *start))
    draws = None if world.draws is None else world.draws.tolist()
    tau, lost, fallen, failed = 0.0, None, None, ""
    memory: Any = None
    for k, t in enumerate(way.t.tolist()):
        told = readings.popleft()
        if draws is not None:
            told = sensors.reading(told, draws[k])
        began = time.perf_counter()
        try:
            if k == 0:
                memory = controller.start()
            wanted, memory = controller(t, told, memory)
        except Exception as error:
            failed = f"{type(error).__name__}: {error}"[:200]
            break
        seconds.append(time.perf_counter() - began)
        if not math.isfinite(wanted):
            failed = f"the controller gave {wanted}"
            break
        tau = actuator.given(wanted, tau)
        torque.append(tau)
        x[:], held_torque[0], drive[:] = states[-1], tau, way.drive[k]
        plant.run()
        theta, omega, F_T, F_H, kept = after.tolist()
        states.append((theta, omega))
        contact[k] = along
        if not kept:
            lost = _lost(along.reshape(-1, 3).T, way.u[k], t)
            break
        if not abs(theta) < FALLEN:
            fallen = t + actuator.period
            break
        readings.append(Measurement(theta, omega, F_T, F_H))
    n = k + 1
    if failed:  # the period that nothing is known of
        states.append(states[-1])
    return Run(
        t=way.t[:n], states=np.array(states).T, torque=_filled(torque, n),
        contact=contact[:n].reshape(n, -1, 3).min(axis=1).T, seconds=_filled(seconds, n),
        lost=lost, fallen=fallen, failed=failed, memory=memory,
    )  # fmt: skip


def _filled(values: list[float], count: int) -> Array:
    """The ``values`` (count,), with NaN where a trial ended before there was one."""
    return np.array(values + [math.nan] * (count - len(values)))


def _lost(along: Array, u: Array, start: float) -> tuple[float, str]:
    """The end of the first step with a negative force, and the end of the foot that lifts."""
    at = int(np.argmax((along[:2] < 0).any(axis=0)))
    return start + float(u[0, : at + 1].sum()), "toe" if along[0, at] < 0 else "heel"
