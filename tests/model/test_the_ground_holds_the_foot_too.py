"""On a slope and on a moving floor the ground holds body and foot: what Newton and Euler ask for both.

The accelerations are written in the frame of the ground, with gravity, or gravity less the floor's acceleration, as one
field that acts on every mass. Friction counts the foot always, toe and heel force where ``foot.ground_loads`` is set.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from design.analysis.capture import Ankle, falls_to
from design.analysis.estimate import off, static_estimate
from design.analysis.many import extremes
from design.analysis.recheck import second_opinion
from design.analysis.survival import slope_limit
from design.analysis.verdict import judge
from design.errors import BadInput
from design.model.body import Biped
from design.model.environment import constant_force, platform, slope, slope_force
from design.model.laws import Gains
from design.model.limits import limits
from design.model.plant import body_numbers, plant, reactions
from design.model.standing import standing
from design.model.uncertainty import Tolerances
from design.spec.load import load
from design.spec.setting import setting
from problems import gains

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


def two_bodies(biped, alpha, theta, omega, tau):
    """The ground's force on the foot (along, up) [N], and its moment about the point below the ankle [N m]."""
    field = biped.g * np.array([math.sin(alpha), -math.cos(alpha)])
    moment = biped.M * biped.L * (math.cos(theta) * field[0] - math.sin(theta) * field[1]) + tau
    turning = moment / biped.I
    body = biped.L * np.array([turning * math.cos(theta) - omega**2 * math.sin(theta),
                               -turning * math.sin(theta) - omega**2 * math.cos(theta)])  # fmt: skip
    on_body = biped.M * (body - field)  # what the foot gives to the body at the ankle
    ground = on_body + biped.m * (0.0 - field)
    # about the point below the ankle, anticlockwise as seen with the toe on the right: x F_y - y F_x of each force
    middle = 0.5 * (biped.toe - biped.heel)  # the foot's mass, on the ground
    others = -biped.height * -on_body[0] + middle * biped.m * field[1] + tau
    return ground, -others


@pytest.mark.parametrize("biped", FEET)
def test_in_motion_friction_is_the_two_bodies_momentum_in_the_frame_of_the_slope(biped):
    alpha, theta, omega, tau = 0.3, 0.1, -0.7, 25.0
    F = slope_force(biped)(np.array([[alpha]]))[:, 0]
    (along, up), _ = two_bodies(biped, alpha, theta, omega, tau)
    assert friction(biped, True, [theta, omega], tau, F) == pytest.approx(along / up, abs=1e-12)


@pytest.mark.parametrize("biped", FEET)
def test_toe_and_heel_force_hold_the_two_bodies_where_slopes_load_the_foot(biped):
    rng = np.random.default_rng(4)
    loaded = replace(biped, ground_loads=True)
    body = plant(loaded)
    for _ in range(20):
        alpha, theta, omega, tau = rng.uniform([-0.6, -0.7, -2.0, -60.0], [0.6, 0.7, 2.0, 60.0])
        F = slope_force(biped)(np.array([[alpha]]))[:, 0]
        (_, up), moment = two_bodies(biped, alpha, theta, omega, tau)
        F_T, F_H = np.linalg.solve([[1.0, 1.0], [biped.toe, -biped.heel]], [up, moment])
        found = body.forces([theta, omega], tau, F).full().ravel()
        assert found == pytest.approx([F_T, F_H], abs=1e-9)
        numbers = list(body_numbers(loaded))
        assert reactions()([theta, omega], tau, numbers, F).full().ravel() == pytest.approx(found, abs=1e-9)


@pytest.mark.parametrize("biped", FEET)
@pytest.mark.parametrize("degrees", [-20.0, 0.0, 30.0])
def test_at_rest_on_a_slope_they_are_the_weight_across_it_and_the_estimate_is_exact(biped, degrees):
    alpha, loaded = math.radians(degrees), replace(biped, ground_loads=True)
    F = slope_force(biped)(np.array([[alpha]]))
    rest = standing(loaded, F, 0.01)
    theta, tau = float(rest.theta[0]), float(rest.tau[0])
    body = plant(loaded)
    F_T, F_H = body.forces([theta, 0.0], tau, F[:, 0]).full().ravel()
    assert F_T + F_H == pytest.approx(biped.weight * math.cos(alpha), abs=1e-9)
    assert rest.load[0] == pytest.approx(F_T + F_H, abs=1e-9)
    assert loaded.pressure(F_T, F_H) == pytest.approx(0.01, abs=1e-12)
    assert abs(float(body.dynamics([theta, 0.0], tau, F[:, 0])[1])) < 1e-9
    estimate = static_estimate(loaded, np.array([theta]), np.array([F_T]), np.array([F_H]), 0.01)
    assert np.vstack(estimate) == pytest.approx(F, abs=1e-9)


@pytest.mark.parametrize("biped", FEET)
def test_motion_puts_the_estimate_off_by_what_is_said(biped):
    loaded, alpha, theta, omega, tau = replace(biped, ground_loads=True), 0.3, -0.2, 0.8, 15.0
    F = slope_force(biped)(np.array([[alpha]]))[:, 0]
    body = plant(loaded)
    F_T, F_H = body.forces([theta, omega], tau, F).full().ravel()
    turning = float(body.dynamics([theta, omega], tau, F)[1])
    found = static_estimate(loaded, theta, F_T, F_H)
    said = off(loaded, theta, omega, turning, loaded.behind(F_T, F_H))
    assert [a - b for a, b in zip(found, F, strict=True)] == pytest.approx(list(said), abs=1e-9)


@pytest.mark.parametrize("biped", FEET)
def test_report_second_opinion_and_batch_agree_where_slopes_load_the_foot(biped):
    ramp = slope(biped, name="ramp", angle=math.radians(30.0), ramp=2.0, duration=4.0)
    problem = replace(SLOPE, biped=biped, scenarios=(ramp,), ground_loads=True, required={})
    rows = {row.id: row for row in judge(problem, GAINS).rows}
    loaded = problem.under(ramp).biped
    opinion = second_opinion(loaded, "force", 0.0, GAINS, ramp, 1e-3)
    many = extremes(loaded, "force", GAINS, ramp, Tolerances(), np.zeros((1, 7)), step=1e-3)
    light = {row.id: row for row in judge(replace(problem, ground_loads=False), GAINS).rows}
    for id, force, batch in (("toe-force", opinion.F_T, many.toe), ("heel-force", opinion.F_H, many.heel)):
        assert rows[id].value == pytest.approx(force.min(), abs=1e-5)
        assert rows[id].value == pytest.approx(batch[0], abs=1e-6)
        assert rows[id].value < light[id].value
    assert rows["friction"].value == pytest.approx(many.friction[0], abs=1e-9)


def test_the_steepest_sudden_slope_is_that_of_the_whole_weight_and_capture_proves_no_less():
    loaded = replace(HEAVY, ground_loads=True)
    limit = slope_limit(loaded)
    assert math.tan(limit) == pytest.approx(HEAVY.ell * (HEAVY.M + HEAVY.m) / (HEAVY.M * HEAVY.L), rel=1e-9)
    for factor, side in ((0.9999, 0), (1.0001, 1)):
        step = slope(HEAVY, name="s", angle=factor * limit, ramp=0.0, duration=10.0)
        assert falls_to(loaded, step, Ankle()) == side


def test_a_scenario_that_is_no_field_and_a_spec_without_the_option_have_the_paper_s_foot():
    wind = constant_force(name="w", F_x=40.0, F_y=0.0, ramp=0.0, duration=1.0)
    problem = replace(SLOPE, biped=HEAVY, ground_loads=True)
    assert problem.under(wind).biped == HEAVY
    assert replace(problem, ground_loads=False).under(SLOPE.scenarios[0]).biped == HEAVY
    assert problem.under(SLOPE.scenarios[0]).biped.kappa == HEAVY.m / HEAVY.M


def test_what_needs_one_foot_for_all_scenarios_says_so():
    wind = constant_force(name="w", F_x=40.0, F_y=0.0, ramp=0.0, duration=1.0)
    problem = replace(SLOPE, ground_loads=True)
    assert problem.throughout("a study").biped.ground_loads
    assert not replace(problem, scenarios=(wind,)).throughout("a study").biped.ground_loads
    with pytest.raises(BadInput, match=r"foot\.ground_loads: .* a study needs"):
        replace(problem, scenarios=(*SLOPE.scenarios, wind)).throughout("a study")
    with pytest.raises(BadInput, match=r"foot\.ground_loads"):
        problem.must_not_load_the_foot("a region")


def test_gains_for_a_foot_that_slopes_load_are_found_and_confirmed():
    ramp = slope(HEAVY, name="ramp", angle=math.radians(30.0), ramp=5.0, duration=8.0)
    bounds = np.array([[3500.0, 3500.0], [800.0, 1200.0], [1.0, 6.0]])
    problem = replace(SLOPE, biped=HEAVY, scenarios=(ramp,), ground_loads=True, bounds=bounds, robust=False)
    found = gains.solve(problem, starts=1).outcome.value
    opinion = second_opinion(problem.under(ramp).biped, "force", 0.0, found.gains, ramp, 1e-3)
    assert min(opinion.F_T.min(), opinion.F_H.min()) == pytest.approx(found.value, abs=1e-3)


def test_a_report_and_a_batch_of_bodies_count_the_foot_alike():
    ramp = slope(HEAVY, name="ramp", angle=math.radians(30.0), ramp=5.0, duration=10.0)
    rows = judge(replace(SLOPE, biped=HEAVY, scenarios=(ramp,)), GAINS).rows
    row = next(row for row in rows if row.id == "friction")
    assert row.value >= math.tan(math.radians(30.0))
    many = extremes(HEAVY, "force", GAINS, ramp, Tolerances(), np.zeros((1, 7)), step=1e-3)
    assert many.friction[0] == pytest.approx(row.value, abs=1e-6)
