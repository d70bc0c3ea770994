"""The loop of a trial, written out step by step from the paper's equations, has a run's states, forces and torques."""

import math
from dataclasses import replace

import numpy as np
import pytest

from design.model.actuator import Actuator
from design.model.body import Biped
from design.model.environment import profile, slope
from design.model.laws import Gains, Measurement, SampledLaw
from design.model.plant import plant
from design.model.sensing import Sensors
from design.spec.load import load, parse
from design.spec.setting import setting
from problems.comparison.controllers import controller
from problems.comparison.trial import World, course, run

PAPER = Biped(M=50.0, L=0.75, I=7.03125, m=0.1, ell=0.1)
BODY = replace(PAPER, M=52.0, L=0.76, I=7.4)
NOISE = Sensors(angle=2e-4, rate=1e-3, force=1.0)
ROUGH = replace(NOISE, angle_step=1e-4, force_step=0.5, delay=0.01)
ANKLE = Actuator(period=0.005, torque=20.0, rate=500.0)
SCENARIOS = {
    "ramp": slope(BODY, name="ramp", angle=math.radians(10), ramp=0.2, duration=0.4),
    "gusts": profile(
        name="gusts", points=np.array([[0.0, 0, 0], [0.103, 10, 0], [0.103, -10, 5], [0.2, 0, 0]]), duration=0.303
    ),
}


def _written_out(world, control, actuator):
    """States, torques and smallest forces, a period at a time, until a force is negative."""
    equations, way = plant(world.biped), course(world.scenario, actuator.period, 0.001)
    sensors, delay = world.sensors, round(world.sensors.delay / actuator.period)
    x, tau, memory = np.array([world.scenario.theta0, world.scenario.omega0]), 0.0, control.start()
    states, torques, least = [x], [], []

    def rate(x, F):
        return equations.dynamics(x, tau, F).full().ravel()

    def forces(x, F):
        return equations.forces(x, tau, F).full().ravel()

    told = [Measurement(*x, *forces(x, [0.0, 0.0]))] * delay + [Measurement(*x, *forces(x, way.force[:, 0]))]
    for k, t in enumerate(way.t):
        measured = told[k]
        if world.draws is not None:
            noisy = np.array(measured) + world.draws[k] * [sensors.angle, sensors.rate, sensors.force, sensors.force]
            steps = [sensors.angle_step, sensors.rate_step, sensors.force_step, sensors.force_step]
            measured = Measurement(
                *(step * round(v / step) if step else v for v, step in zip(noisy, steps, strict=True))
            )
        wanted, memory = control(t, measured, memory)
        near = np.clip(wanted, tau - actuator.rate * actuator.period, tau + actuator.rate * actuator.period)
        tau = float(np.clip(near, -actuator.torque, actuator.torque))
        smallest = np.full(2, np.inf)
        for h, *F in way.u[k].T:
            start, middle, end = np.array(F).reshape(3, 2)
            smallest = np.minimum(smallest, forces(x, start))
            k1 = rate(x, start)
            k2 = rate(x + h / 2 * k1, middle)
            k3 = rate(x + h / 2 * k2, middle)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(x + h * k3, end))
            smallest = np.minimum(smallest, forces(x, end))
        states.append(x)
        torques.append(tau)
        least.append(smallest)
        if smallest.min() < 0:
            break
        told.append(Measurement(*x, *forces(x, way.force[:, min(k + 1, len(way.t) - 1)])))
    return np.array(states).T, np.array(torques), np.array(least).T


def _world(scenario, sensors):
    count = len(course(scenario, 0.005, 0.001).t)
    draws = None if sensors.exact else np.random.default_rng(3).standard_normal((count, 4))
    return World(biped=BODY, scenario=scenario, sensors=sensors, draws=draws)


def _same(world, control, actuator):
    ended = run(world, control, actuator, 0.001)
    states, torque, least = _written_out(world, control, actuator)
    assert ended.torque == pytest.approx(torque, rel=1e-9, abs=1e-9)
    assert ended.states == pytest.approx(states, rel=1e-9, abs=1e-12)
    assert ended.contact[:2] == pytest.approx(least, rel=1e-9, abs=1e-9)
    return ended


@pytest.mark.parametrize("name", SCENARIOS)
@pytest.mark.parametrize("kind", ["pd", "force", "cop"])
@pytest.mark.parametrize(
    ("sensors", "actuator"),
    [(Sensors(), Actuator(period=0.005)), (NOISE, Actuator(period=0.005)), (ROUGH, ANKLE)],
    ids=["exact", "noise", "rough, late and limited"],
)
def test_a_law(kind, sensors, actuator, name):
    law = SampledLaw(kind=kind, biped=PAPER, gains=Gains(3500.0, 1200.0, 1.0), period=0.005)
    ended = _same(_world(SCENARIOS[name], sensors), law, actuator)
    if (kind, name) == ("pd", "ramp") and actuator is not ANKLE:
        assert ended.lost is not None


@pytest.mark.parametrize("name", ["mpc", "mpc-preview"])
def test_a_prediction(name):
    noise = "\n[noise]\nangle_deg = 0.01\nrate_deg_per_s = 0.05\nforce_n = 1.0\ndelay_s = 0.01\n"
    problem = setting(parse(load("slope").text + noise, origin="noisy").spec)
    world = _world(SCENARIOS["ramp"], problem.sensors)
    _same(world, controller(name, problem, None, world.scenario), Actuator(period=0.005))


def test_a_controller_that_fails_leaves_a_last_period_of_which_nothing_is_known():
    class Fails:
        def start(self):
            return 0

        def __call__(self, t, measurement, memory):
            return (1.0 if memory < 7 else math.inf), memory + 1

    ended = run(_world(SCENARIOS["ramp"], Sensors()), Fails(), Actuator(period=0.005), 0.001)
    assert ended.failed
    assert len(ended.t) == len(ended.torque) == len(ended.seconds) == ended.contact.shape[1] == 8
    assert np.isfinite(ended.torque).tolist() == [True] * 7 + [False]
    assert np.isnan(ended.contact[:, 7]).all()
    assert np.isfinite(ended.contact[:, :7]).all()
    assert (ended.states[:, 8] == ended.states[:, 7]).all()
