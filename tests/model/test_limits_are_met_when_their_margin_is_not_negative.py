"""A Limit is met if and only if every component of its margin is >= 0, and it says what its name says.

The quantities are compared with the reactions written out here, (5)-(7) and (18).
"""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from design.model.body import Biped
from design.model.limits import Required, limits
from design.model.plant import plant

ADULT = Biped(M=72.5, L=0.93, I=84.0, m=2.4, ell=0.12, g=9.80665)
PLANT = plant(ADULT)
points = st.tuples(
    st.floats(-0.6, 0.6), st.floats(-3.0, 3.0), st.floats(-120.0, 120.0), st.floats(-200.0, 200.0),
    st.floats(-300.0, 300.0),
)  # fmt: skip
several = settings(max_examples=150, deadline=None)


def named(id, **required):
    levels = {key.replace("_", "-"): Required(level=level) for key, level in required.items()}
    (found,) = (limit for limit in limits(PLANT, levels) if limit.id == id)
    return found


def read(limit, point):
    theta, omega, tau, *F = point
    return limit.quantity([theta, omega], tau, F).full()


def reactions(point):
    theta, omega, tau, F_x, F_y = point
    M, L, g = ADULT.M, ADULT.L, ADULT.g
    turning = ((M * g - F_y) * L * math.sin(theta) + F_x * L * math.cos(theta) + tau) / ADULT.I
    total = M * g - F_y + ADULT.m * g - M * L * (turning * math.sin(theta) + omega**2 * math.cos(theta))
    return (total - tau / ADULT.ell) / 2, (total + tau / ADULT.ell) / 2


@pytest.mark.parametrize(("id", "side"), [("toe-force", 0), ("heel-force", 1)])
@given(point=points, level=st.floats(-100.0, 400.0))
@several
def test_a_contact_limit_is_met_if_and_only_if_the_force_reaches_the_level(id, side, point, level):
    limit = named(id, contact_force=level)
    force = reactions(point)[side]
    assume(abs(force - level) > 1e-6)
    assert bool((limit.margin(read(limit, point), level) >= 0).all()) is (force >= level)


@given(point=points, level=st.floats(0.0, 0.11))
@several
def test_the_cop_limit_is_met_if_and_only_if_the_cop_is_that_far_from_both_ends(point, level):
    F_T, F_H = reactions(point)
    assume(F_T + F_H > 1.0)
    P = (F_T - F_H) * ADULT.ell / (F_T + F_H)
    limit = named("cop-margin", cop_margin=level)
    assume(abs(ADULT.ell - abs(P) - level) > 1e-9)
    assert bool((limit.margin(read(limit, point), level) >= 0).all()) is (abs(P) <= ADULT.ell - level)


@given(point=points, level=st.floats(0.0, 150.0))
@several
def test_the_torque_limit_is_met_if_and_only_if_the_torque_is_within_it_both_ways(point, level):
    limit = named("torque", torque=level)
    assert bool((limit.margin(read(limit, point), level) >= 0).all()) is (abs(point[2]) <= level)


@given(point=points, level=st.floats(0.1, 1.0))
@several
def test_the_friction_limit_is_met_if_and_only_if_the_foot_needs_no_more_friction(point, level):
    F_T, F_H = reactions(point)
    assume(F_T + F_H > 1.0)
    theta, omega, tau, F_x, F_y = point
    M, L = ADULT.M, ADULT.L
    turning = ((M * ADULT.g - F_y) * L * math.sin(theta) + F_x * L * math.cos(theta) + tau) / ADULT.I
    ground = M * L * (turning * math.cos(theta) - omega**2 * math.sin(theta)) - F_x  # Newton, along the ground
    limit = named("friction", friction=level)
    assume(abs(abs(ground) - level * (F_T + F_H)) > 1e-6)
    needed = bool((limit.margin(read(limit, point), level) >= 0).all())
    assert needed is (abs(ground) <= level * (F_T + F_H))


@given(point=points)
@several
def test_both_contacts_are_kept_if_and_only_if_the_cop_stays_on_a_loaded_foot(point):
    F_T, F_H = reactions(point)
    assume(F_T + F_H > 1.0 and min(abs(F_T), abs(F_H)) > 1e-6)
    inside = bool((read(named("cop-margin"), point) >= 0).all())
    assert inside is all(read(named(id), point).item() >= 0 for id in ("toe-force", "heel-force"))


@pytest.mark.parametrize("limit", limits(PLANT, {}), ids=lambda limit: limit.id)
@given(several_points=st.lists(points, min_size=1, max_size=5), level=st.floats(-50.0, 50.0))
@settings(max_examples=30, deadline=None)
def test_the_value_is_the_component_with_the_smallest_margin(limit, several_points, level):
    quantity = np.hstack([read(limit, point) for point in several_points])
    smallest = limit.margin(quantity, level).min(axis=0)
    assert limit.margin(limit.value(quantity), level) == pytest.approx(smallest, rel=1e-12, abs=1e-12)


def test_one_contact_requirement_is_for_toe_and_heel():
    found = limits(PLANT, {"contact-force": Required(level=50.0)})
    assert {limit.id: limit.required for limit in found if limit.required} == {
        "toe-force": Required(level=50.0),
        "heel-force": Required(level=50.0),
    }


def test_a_wish_leaves_the_foot_on_the_ground_as_the_hard_level():
    wish = {id: Required(level=50.0, soft=True) for id in ("contact-force", "torque")}
    levels = {limit.id: limit.hard_level for limit in limits(PLANT, wish)}
    assert levels["toe-force"] == levels["heel-force"] == levels["cop-margin"] == 0.0
    assert levels["torque"] is None


def test_a_requirement_is_the_hard_level():
    levels = {limit.id: limit.hard_level for limit in limits(PLANT, {"contact-force": Required(level=50.0)})}
    assert levels["toe-force"] == levels["heel-force"] == 50.0
    assert levels["torque"] is None
