"""The largest sudden slope and push that a controller survives from rest, as a share of what any ankle can.

Nominal body, exact sensors with their delay; upright and without an integral, as a trial begins. Survived is a run of
``WATCHED`` time constants 1/Omega of the body without lost contact, at whose end the motion does not grow. Sought by
bisection from a scan of a few smaller ones.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from design.analysis.survival import push_limit, slope_limit
from design.model.environment import Scenario, constant_force, slope
from design.model.laws import Gains
from design.model.sensing import Sensors
from design.spec.setting import Setting
from problems.comparison.controllers import actuator, controller
from problems.comparison.trial import Run, World, run

WATCHED = 30.0
SCAN = 4
FINE = 1e-3
DISTURBANCES = ("step-slope", "push")


def survived(what: str, name: str, setting: Setting, gains: Gains | None) -> dict[str, Any]:
    """``survived`` and ``limit`` of a disturbance, in degrees (step-slope) or N s (push); the worse direction."""
    biped = setting.biped
    limit = slope_limit(biped) if what == "step-slope" else push_limit(biped)
    problem = replace(setting, sensors=Sensors(delay=setting.sensors.delay))

    watched = WATCHED * math.sqrt(biped.I / (biped.M * biped.g * biped.L))

    def kept(size: float) -> bool:
        scenario: Scenario
        if what == "step-slope":
            scenario = slope(biped, name=what, angle=size, ramp=0.0, duration=watched)
        else:
            rate = size * biped.L / biped.I
            scenario = constant_force(name=what, F_x=0.0, F_y=0.0, ramp=0.0, duration=watched, omega0=rate)
        world = World(biped=biped, scenario=scenario, sensors=problem.sensors, draws=None)
        ended = run(world, controller(name, problem, gains, scenario), actuator(problem), problem.step)
        if ended.failed:
            raise RuntimeError(ended.failed)
        return not (ended.lost or ended.fallen) and not _grows(ended)

    both = setting.theta_d != 0.0 or not setting.plain
    low, high = 0.0, limit
    for k in range(1, SCAN + 1):
        size = limit * k / SCAN
        if not (kept(size) and (not both or kept(-size))):
            high = size
            break
        low = size
    while high - low > FINE * limit:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if kept(middle) and (not both or kept(-middle)) else (low, middle)
    unit = math.degrees(1.0) if what == "step-slope" else 1.0
    return {"status": "found", "survived": float(f"{low * unit:.6g}"), "limit": float(f"{limit * unit:.6g}")}


def _grows(ended: Run) -> bool:
    """Whether the body moves faster in the last quarter of the run than in the one before, beyond a creeping."""
    rates = np.abs(ended.states[1, :-1])
    third, last = (float(part.max()) for part in np.array_split(rates, 4)[2:])
    return last > third + 1e-6
