"""What the observer believes: (16)-(17) at rest, the truth a period later when nothing disturbs, and now, not then."""

import math
from dataclasses import replace

import numpy as np
import pytest

from design.analysis.estimate import static_estimate
from design.analysis.observer import observer
from design.model.actuator import Actuator
from design.model.body import Biped
from design.model.environment import profile, slope
from design.model.laws import Gains, Measurement, SampledLaw
from design.model.sensing import Sensors
from problems.comparison.trial import World, run
from problems.prediction import stationary

PAPER = Biped(M=50.0, L=0.75, I=7.03125, m=0.1, ell=0.1)
PERIOD = 0.005


class _Watching:
    """A law, with an observer beside it that is not asked."""

    def __init__(self, sensors, walk=5.0, known=None):
        self.law = SampledLaw(kind="force", biped=PAPER, gains=Gains(3500.0, 1200.0, 1.0), period=PERIOD)
        self.watch = observer(PAPER, sensors, period=PERIOD, walk=walk, known=known)
        self.beliefs = []

    def start(self):
        return self.law.start(), self.watch.start(), (0.0,) * (self.watch.delay + 1)

    def __call__(self, t, measurement, memory):
        integral, seen, torques = memory
        belief, seen = self.watch(t, measurement, torques, seen)
        self.beliefs.append(belief[:4])
        tau, integral = self.law(t, measurement, integral)
        return tau, (integral, seen, (*torques[1:], tau))


def _watched(scenario, sensors=None, draws=None, **options):
    sensors = sensors or Sensors()
    control = _Watching(sensors, **options)
    ended = run(
        World(biped=PAPER, scenario=scenario, sensors=sensors, draws=draws), control, Actuator(period=PERIOD), 1e-3
    )
    return ended, np.array(control.beliefs).T, scenario.force_at(ended.t)


STEADY = profile(name="steady", points=np.array([[0.0, 20.0, 15.0]]), duration=0.5)


def test_a_force_that_stays_is_known_after_two_periods():
    _, found, force = _watched(STEADY)
    assert found[2:, 2:] == pytest.approx(force[:, 2:], abs=1e-2)


def test_at_rest_it_is_the_static_formula():
    theta = math.radians(-4.0)
    F = PAPER.M * PAPER.g * np.array([math.sin(-theta), 1 - math.cos(theta)])
    load = PAPER.weight - F[1]
    watch = observer(PAPER, Sensors(), period=PERIOD, walk=5.0)
    seen = None
    for k in range(50):
        belief, seen = watch(k * PERIOD, Measurement(theta, 0.0, load / 2, load / 2), (0.0,), seen)
    F_x, F_y = static_estimate(PAPER, np.array([theta]), np.array([load / 2]), np.array([load / 2]))
    assert belief.F_x == pytest.approx(F_x[0], rel=1e-6)
    assert belief.F_y == pytest.approx(F_y[0], rel=1e-6)
    assert (belief.F_x, belief.F_y) == pytest.approx(tuple(F), rel=1e-6)


def test_on_a_ramp_it_is_late_by_no_more_than_a_period():
    ramp = slope(PAPER, name="ramp", angle=math.radians(20), ramp=2.0, duration=1.9)
    _, found, force = _watched(ramp)
    rate = np.abs(np.diff(force[0])).max() / PERIOD
    assert np.abs(found[2] - force[0])[5:].max() <= 1.5 * PERIOD * rate


def test_measurements_that_are_late_are_brought_up_to_now():
    late = Sensors(delay=4 * PERIOD)
    ended, found, _ = _watched(STEADY, late)
    assert found[0, 10:] == pytest.approx(ended.states[0, 10:-1], abs=1e-5)
    assert found[1, 10:] == pytest.approx(ended.states[1, 10:-1], abs=1e-3)


def test_who_is_told_the_force_does_not_estimate_it():
    _, found, force = _watched(STEADY, Sensors(angle=1e-3, rate=1e-2, force=5.0), np.zeros((100, 4)),
                               known=lambda t: (20.0, 15.0))  # fmt: skip
    assert found[2:] == pytest.approx(force)


@pytest.mark.parametrize("told", [None, lambda t: (20.0, 15.0)])
def test_a_body_that_is_not_the_nominal_one_is_believed_to_stand_where_it_does(told):
    """What the nominal body needs to rest where the real one does is made up by a force, told or not."""
    real = replace(PAPER, M=53.0, L=0.73)
    control = _Watching(Sensors(), known=told)
    world = World(biped=real, scenario=replace(STEADY, duration=30.0), sensors=Sensors(), draws=None)
    ended = run(world, control, Actuator(period=PERIOD), 1e-3)
    _, posture = stationary(real, 20.0, 15.0)
    assert ended.states[0, -1] == pytest.approx(posture, abs=1e-6)
    *_, F_x, F_y = control.beliefs[-1]
    assert stationary(PAPER, F_x, F_y)[1] == pytest.approx(posture, abs=1e-5)


def test_the_filter_is_better_than_the_sensors_and_its_force_than_a_difference_of_rates():
    sensors = Sensors(angle=math.radians(0.05), rate=math.radians(0.5), force=4.0)
    still = profile(name="still", points=np.array([[0.0, 5.0, 0.0]]), duration=4.0)
    draws = np.random.default_rng(3).standard_normal((800, 4))
    ended, found, force = _watched(still, sensors, draws)
    settled = slice(200, None)
    rate_error = np.std((found[1] - ended.states[1, :-1])[settled])
    force_error = np.std((found[2] - force[0])[settled])
    by_difference = math.sqrt(2) * sensors.rate * PAPER.I / (PAPER.L * PERIOD)
    assert rate_error < 0.5 * sensors.rate
    assert force_error < 0.15 * by_difference
