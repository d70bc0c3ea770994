"""On a slope and on a moving floor the ground holds body and foot: friction is what Newton's law asks for both.

The accelerations are written in the frame of the ground, with gravity, or gravity less the floor's acceleration, as one
field that acts on every mass.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from design.analysis.many import extremes
from design.analysis.verdict import judge
from design.model.body import Biped
from design.model.environment import constant_force, platform, slope
from design.model.laws import Gains
from design.model.limits import limits
from design.model.plant import plant
from design.model.uncertainty import Tolerances
from design.spec.load import load
from design.spec.setting import setting

SLOPE = setting(load("slope").spec)
HEAVY = Biped(M=50.0, L=0.75, I=37.5, m=3.0, ell=0.1)
FEET = [HEAVY, replace(HEAVY, skew=0.4, height=0.08)]
GAINS = Gains(3500.0, 1200.0, 2.245957295)


def friction(biped, field, x, tau, F):
    """The row's coefficient of friction."""
    row = next(limit for limit in limits(plant(biped), {}, field=field) if limit.id == "friction")
    return float(row.quantity(x, tau, F)[0])


def posture(biped, F):
    """theta at rest without torque."""
    return math.atan2(-F[0], biped.M * biped.g - F[1])


@pytest.mark.parametrize("biped", FEET)
@pytest.mark.parametrize("degrees", [-35.0, -3.0, 12.0, 30.0])
def test_at_rest_on_a_slope_the_foot_needs_the_tangent_of_its_angle(biped, degrees):
    alpha = math.radians(degrees)
    world = slope(biped, name="s", angle=alpha, ramp=0.0, duration=1.0)
    F = world.force_at(np.array([0.0]))[:, 0]
    found = friction(biped, world.field, [posture(biped, F), 0.0], 0.0, F)
    assert found == pytest.approx(-math.tan(alpha), abs=1e-12)


@pytest.mark.parametrize("biped", FEET)
def test_on_a_floor_that_accelerates_it_needs_the_acceleration_over_gravity(biped):
    world = platform(biped, name="p", points=np.array([[0.0, 1.3]]), duration=1.0)
    F = world.force_at(np.array([0.0]))[:, 0]
    assert friction(biped, world.field, [posture(biped, F), 0.0], 0.0, F) == pytest.approx(1.3 / biped.g, abs=1e-12)


def test_wind_blows_at_the_body_alone():
    world = constant_force(name="w", F_x=40.0, F_y=25.0, ramp=0.0, duration=1.0)
    found = friction(HEAVY, world.field, [posture(HEAVY, (40.0, 25.0)), 0.0], 0.0, [40.0, 25.0])
    assert found == pytest.approx(-40.0 / (HEAVY.weight - 25.0), abs=1e-12)


@pytest.mark.parametrize("biped", FEET)
def test_in_motion_it_is_the_two_bodies_momentum_in_the_frame_of_the_slope(biped):
    alpha, theta, omega, tau = 0.3, 0.1, -0.7, 25.0
    F = slope(biped, name="s", angle=alpha, ramp=0.0, duration=1.0).force_at(np.array([0.0]))[:, 0]
    field = biped.g * np.array([math.sin(alpha), -math.cos(alpha)])
    moment = biped.M * biped.L * (math.cos(theta) * field[0] - math.sin(theta) * field[1]) + tau
    turning = moment / biped.I
    body = biped.L * np.array([turning * math.cos(theta) - omega**2 * math.sin(theta),
                               -turning * math.sin(theta) - omega**2 * math.cos(theta)])  # fmt: skip
    ground = biped.M * (body - field) + biped.m * (0.0 - field)
    # the contact forces are (5) and (6): there the foot has its weight on level ground
    assert friction(biped, True, [theta, omega], tau, F) == pytest.approx(ground[0] / ground[1], abs=1e-12)


def test_a_report_and_a_batch_of_bodies_count_the_foot_alike():
    ramp = slope(HEAVY, name="ramp", angle=math.radians(30.0), ramp=5.0, duration=10.0)
    rows = judge(replace(SLOPE, biped=HEAVY, scenarios=(ramp,)), GAINS).rows
    row = next(row for row in rows if row.id == "friction")
    assert row.value >= math.tan(math.radians(30.0))
    many = extremes(HEAVY, "force", GAINS, ramp, Tolerances(), np.zeros((1, 7)), step=1e-3)
    assert many.friction[0] == pytest.approx(row.value, abs=1e-6)
