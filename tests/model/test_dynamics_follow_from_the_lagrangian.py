"""The plant is what the Lagrangian of a rod on an ankle, Newton's law and the foot's balance say it is.

The derivation is done here by SymPy and shares nothing with ``design.model.plant``. The kinetic energy is I omega²/2:
the paper allows I < M L², so that I is not made of M L² and a part that is left over.
"""

import math
from functools import cache

import numpy as np
import pytest
import sympy as sp
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from design.model.body import Biped
from design.model.plant import plant

PAPER = Biped(M=50.0, L=0.75, I=50.0 * 0.75**2 / 4, m=0.1, ell=0.1)
ADULT = Biped(M=72.5, L=0.93, I=84.0, m=2.4, ell=0.12, g=9.80665)
MOON = Biped(M=31.0, L=0.4, I=6.5, m=0.0, ell=0.07, g=1.62)
PLANTS = {"paper": plant(PAPER), "adult": plant(ADULT), "moon": plant(MOON)}

points = st.tuples(
    st.floats(-math.pi, math.pi),  # theta
    st.floats(-8.0, 8.0),  # omega
    st.floats(-400.0, 400.0),  # tau
    st.floats(-600.0, 600.0),  # F_x
    st.floats(-900.0, 900.0),  # F_y
)
every_plant = pytest.mark.parametrize("body", PLANTS.values(), ids=PLANTS)

M, L, inertia, m, ell, g = sp.symbols("M L I m ell g", positive=True)
t, theta, omega, tau, F_x, F_y = sp.symbols("t theta omega tau F_x F_y", real=True)
q = sp.Function("q")(t)
KINETIC = inertia * q.diff(t) ** 2 / 2
CENTRE = sp.Matrix([L * sp.sin(q), L * sp.cos(q)])  # of gravity, from the ankle: to the toe, and up


def _angular_acceleration():
    """Lagrange's equation with the generalised force of (F_x, F_y) at the centre of gravity and of the torque."""
    lagrangian = KINETIC - M * g * CENTRE[1]
    generalised = sp.Matrix([F_x, F_y]).dot(CENTRE.diff(q)) + tau
    motion = lagrangian.diff(q.diff(t)).diff(t) - lagrangian.diff(q) - generalised
    (solution,) = sp.solve(motion, q.diff(t, 2))
    return solution


def _reactions():
    """Newton's law for the body, vertically; balance of the resting foot, vertically and about the ankle.

    Moments turn from up to the toe, as theta does. The foot's weight acts below the ankle and has no arm.
    """
    f_y, F_T, F_H = sp.symbols("f_y F_T F_H", real=True)  # f_y: of the body on the foot, down
    body = sp.Eq(M * CENTRE[1].diff(t, 2), f_y - M * g + F_y)
    foot = sp.Eq(F_T + F_H - f_y - m * g, 0)
    moment = sp.Eq(-tau - ell * F_T + ell * F_H, 0)
    solution = sp.solve([body, foot, moment], [f_y, F_T, F_H], dict=True)[0]
    return tuple(solution[unknown] for unknown in (f_y, F_T, F_H))


def _at_state(expression):
    settled = expression.subs(q.diff(t, 2), _angular_acceleration())
    return settled.subs(q.diff(t), omega).subs(q, theta)


@cache
def _derived():
    f_y, F_T, F_H = _reactions()
    parameters = [M, L, inertia, m, ell, g, theta, omega, tau, F_x, F_y]
    return sp.lambdify(parameters, [_at_state(each) for each in (_angular_acceleration(), f_y, F_T, F_H)], "math")


def derived(biped, point):
    """(theta'', f_y, F_T, F_H) at (theta, omega, tau, F_x, F_y)."""
    return _derived()(biped.M, biped.L, biped.I, biped.m, biped.ell, biped.g, *point)


def close(value, expected, size):
    return abs(value - expected) <= 1e-12 * (size + abs(expected))


def _force_size(biped, point):
    """The largest terms that cancel in a reaction."""
    spin = biped.M * biped.L * (point[1] ** 2 + abs(derived(biped, point)[0]))
    turning = biped.M * biped.L**2 / biped.I * (biped.weight + abs(point[3]) + abs(point[4]))
    return biped.weight + spin + turning + abs(point[2]) / biped.ell + abs(point[4])


@every_plant
@given(point=points)
@settings(max_examples=60, deadline=None)
def test_the_body_moves_as_its_lagrangian_says(body, point):
    biped = body.biped
    angle, rate, torque, *force = point
    xdot = body.dynamics([angle, rate], torque, force).full().ravel()
    size = (biped.L * (biped.M * biped.g + abs(force[0]) + abs(force[1])) + abs(torque)) / biped.I
    assert xdot[0] == rate
    assert close(xdot[1], derived(biped, point)[0], size)


@every_plant
@given(point=points)
@settings(max_examples=60, deadline=None)
def test_toe_and_heel_carry_what_newton_and_the_balance_of_the_foot_leave_them(body, point):
    angle, rate, torque, *force = point
    F_T, F_H = body.forces([angle, rate], torque, force).full().ravel()
    _, _, toe, heel = derived(body.biped, point)
    size = _force_size(body.biped, point)
    assert close(F_T, toe, size)
    assert close(F_H, heel, size)


@every_plant
@given(point=points)
@settings(max_examples=60, deadline=None)
def test_the_reactions_have_no_moment_about_the_centre_of_pressure(body, point):
    angle, rate, torque, *force = point
    _, _, toe, heel = derived(body.biped, point)
    assume(abs(toe + heel) > 1e-3 * _force_size(body.biped, point))
    half = body.biped.ell
    P = float(body.cop([angle, rate], torque, force))
    moment = toe * (half - P) + heel * (-half - P)
    assert abs(moment) <= 1e-8 * half * _force_size(body.biped, point) * (1 + abs(P) / half)


@cache
def _friction():
    """Newton's law for the body, horizontally; the foot rests and hands on to the body what the ground gives it."""
    horizontal = _at_state(M * CENTRE[0].diff(t, 2) - F_x)
    return sp.lambdify([M, L, inertia, m, ell, g, theta, omega, tau, F_x, F_y], horizontal, "math")


@every_plant
@given(point=points)
@settings(max_examples=60, deadline=None)
def test_friction_is_what_newton_asks_of_the_ground(body, point):
    biped, (angle, rate, torque, *force) = body.biped, point
    expected = _friction()(biped.M, biped.L, biped.I, biped.m, biped.ell, biped.g, *point)
    found = float(body.friction([angle, rate], torque, force))
    assert close(found, expected, _force_size(biped, point) + abs(force[0]))


@every_plant
@given(point=points)
@settings(max_examples=60, deadline=None)
def test_gravity_and_the_external_force_act_as_one_inclined_weight(body, point):
    biped = body.biped
    angle, rate, torque, push, lift = point
    A = math.hypot(biped.M * biped.g - lift, push)  # (3)
    theta_f = math.atan2(-push, biped.M * biped.g - lift)  # (4)
    expected = (A * biped.L * math.sin(angle - theta_f) + torque) / biped.I  # (2)
    found = float(body.dynamics([angle, rate], torque, [push, lift])[1])
    assert close(found, expected, (A * biped.L + biped.M * biped.g * biped.L + abs(torque)) / biped.I)


def test_the_vertical_force_of_the_body_on_the_foot_is_the_printed_one():
    acceleration = sp.Symbol("acceleration", real=True)
    printed = -M * L * acceleration * sp.sin(theta) - M * L * omega**2 * sp.cos(theta) + M * g - F_y  # (7)
    found = _reactions()[0].subs(q.diff(t, 2), acceleration).subs(q.diff(t), omega).subs(q, theta)
    assert sp.simplify(found - printed) == 0


def test_the_printed_foot_term_is_a_misprint_for_its_weight():
    """(5) prints m/2 where the balance of the foot needs m g / 2."""
    f_y, F_T, _ = _reactions()
    assert sp.simplify(F_T - (-tau / (2 * ell) + m * g / 2 + f_y / 2)) == 0
    assert sp.simplify(F_T - (-tau / (2 * ell) + m / 2 + f_y / 2)) != 0


@every_plant
def test_a_body_at_rest_upright_stands_on_both_ends_with_its_whole_weight(body):
    reactions = body.forces([0.0, 0.0], 0.0, [0.0, 0.0]).full().ravel()
    assert reactions == pytest.approx(np.full(2, body.biped.weight / 2), rel=1e-15)


@every_plant
@given(point=points)
@settings(max_examples=40, deadline=None)
def test_toe_and_heel_change_places_in_a_mirror(body, point):
    angle, rate, torque, push, lift = point
    F_T, F_H = body.forces([angle, rate], torque, [push, lift]).full().ravel()
    mirrored = body.forces([-angle, -rate], -torque, [-push, lift]).full().ravel()
    assert mirrored == pytest.approx([F_H, F_T], rel=1e-12, abs=1e-12 * _force_size(body.biped, point))
