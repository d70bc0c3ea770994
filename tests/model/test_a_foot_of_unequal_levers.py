"""A foot whose ankle is off its middle and above the ground: forces, centre of pressure, laws, and the linear loop.

The forces are derived here by SymPy from the momentum of the body and the balance of the foot with every force at its
point, and share nothing with ``design.model.plant``.
"""

import math
from functools import cache

import numpy as np
import pytest
import sympy as sp
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from design.analysis.simulate import simulate
from design.errors import BadInput
from design.model.body import Biped
from design.model.closed_loop import closed_loop
from design.model.deciding import deciding_places
from design.model.environment import constant_force, slope
from design.model.laws import AdaptingLaw, Gains, SampledLaw
from design.model.limits import limits
from design.model.plant import plant
from design.model.stability import characteristic, closed_loop_matrix, is_hurwitz, polynomial_map
from design.model.standing import met, standing

ADULT = {"M": 68.0, "L": 0.92, "I": 70.0, "m": 2.0}
FOOT = Biped(**ADULT, ell=0.12, skew=0.5, height=0.08)
GAINS = Gains(3000.0, 1000.0, 0.3)

feet = st.builds(
    lambda toe, heel, height, m: Biped(
        **{**ADULT, "m": m}, ell=(toe + heel) / 2, skew=(toe - heel) / (toe + heel), height=height
    ),
    st.floats(0.03, 0.3), st.floats(0.03, 0.3), st.floats(0.0, 0.2), st.floats(0.0, 10.0),
)  # fmt: skip
points = st.tuples(
    st.floats(-1.2, 1.2), st.floats(-4.0, 4.0), st.floats(-200.0, 200.0), st.floats(-300.0, 300.0),
    st.floats(-300.0, 300.0),
)  # fmt: skip
shares = st.floats(-0.6, 0.6)


def target_of(foot, share):
    """A point within the foot, some way from its middle."""
    return foot.ell * (foot.skew + share)


@cache
def derived():
    """(l_T, l_H, h, M, L, I, m, g, theta, omega, tau, F_x, F_y) -> F_T, F_H, P, f_x, by vectors."""
    l_T, l_H, h, M, L, inertia, m, g = sp.symbols("l_T l_H h M L I m g", positive=True)
    theta, omega, tau, F_x, F_y = sp.symbols("theta omega tau F_x F_y", real=True)
    t = sp.Symbol("t")
    q = sp.Function("q")(t)
    centre = sp.Matrix([L * sp.sin(q), h + L * sp.cos(q)])
    weight, force = sp.Matrix([0, -M * g]), sp.Matrix([F_x, F_y])
    turning = ((weight + force)[0] * (centre[1] - h) - (weight + force)[1] * centre[0] + tau) / inertia
    acceleration = centre.diff(t, 2).subs(q.diff(t, 2), turning).subs(q.diff(t), omega).subs(q, theta)
    on_body = M * acceleration - weight - force  # what the foot gives the body at the ankle

    def moment(at, of):  # about the point on the ground under the ankle, from up to the toe
        return at[1] * of[0] - at[0] * of[1]

    F_T, F_H, f_x = sp.symbols("F_T F_H f_x", real=True)
    ankle = sp.Matrix([0, h])
    balance = [
        f_x - on_body[0],
        F_T + F_H - m * g - on_body[1],
        moment(sp.Matrix([l_T, 0]), sp.Matrix([f_x, F_T]))
        + moment(sp.Matrix([-l_H, 0]), sp.Matrix([0, F_H]))
        + moment(sp.Matrix([(l_T - l_H) / 2, 0]), sp.Matrix([0, -m * g]))
        + moment(ankle, -on_body)
        - tau,
    ]
    found = sp.solve(balance, [F_T, F_H, f_x], dict=True)[0]
    P = (l_T * found[F_T] - l_H * found[F_H]) / (found[F_T] + found[F_H])
    answer = [part.subs(q, theta) for part in (found[F_T], found[F_H], P, found[f_x])]
    return sp.lambdify([l_T, l_H, h, M, L, inertia, m, g, theta, omega, tau, F_x, F_y], answer, "math")


@given(foot=feet, point=points)
@settings(max_examples=80, deadline=None)
def test_toe_and_heel_force_are_those_of_a_foot_in_balance(foot, point):
    numbers = (foot.toe, foot.heel, foot.height, foot.M, foot.L, foot.I, foot.m, foot.g)
    F_T, F_H, P, f_x = derived()(*numbers, *point)
    angle, rate, torque, *force = point
    body = plant(foot)
    size = 2e3 + (abs(torque) + foot.height * abs(f_x)) / foot.ell + abs(F_T) + abs(F_H)
    assert body.forces([angle, rate], torque, force).full().ravel() == pytest.approx([F_T, F_H], abs=1e-12 * size)
    assert float(body.friction([angle, rate], torque, force)) == pytest.approx(f_x, abs=1e-11 * size)
    assume(abs(F_T + F_H) > 1e-2 * size)
    assert float(body.cop([angle, rate], torque, force)) == pytest.approx(P, rel=1e-9, abs=1e-9)
    assert foot.pressure(F_T, F_H) == pytest.approx(P, rel=1e-9, abs=1e-9)


@given(foot=feet, point=points)
@settings(max_examples=40, deadline=None)
def test_what_the_ground_does_at_toe_and_heel_it_does_at_the_centre_of_pressure(foot, point):
    angle, rate, torque, *force = point
    F_T, F_H = plant(foot).forces([angle, rate], torque, force).full().ravel()
    P = float(plant(foot).cop([angle, rate], torque, force))
    assert foot.toe * F_T - foot.heel * F_H == pytest.approx(P * (F_T + F_H), abs=1e-9 * (abs(F_T) + abs(F_H) + 1))
    if F_T > 0 and F_H > 0:
        assert -foot.heel < P < foot.toe


@given(foot=feet, point=points)
@settings(max_examples=40, deadline=None)
def test_the_cop_margin_is_positive_while_both_ends_press(foot, point):
    angle, rate, torque, *force = point
    rows = {limit.id: limit.quantity([angle, rate], torque, force).full().ravel() for limit in limits(plant(foot), {})}
    F_T, F_H = rows["toe-force"][0], rows["heel-force"][0]
    assume(F_T + F_H > 1.0 and min(abs(F_T), abs(F_H)) > 1e-6)
    assert (rows["cop-margin"].min() > 0) == (F_T > 0 and F_H > 0)
    assert rows["cop-margin"] == pytest.approx(2 * foot.ell * np.array([F_H, F_T]) / (F_T + F_H), rel=1e-7, abs=1e-9)


@given(foot=feet, point=points)
@settings(max_examples=40, deadline=None)
def test_toe_and_heel_change_places_in_a_mirror(foot, point):
    angle, rate, torque, push, lift = point
    other = Biped(**{**ADULT, "m": foot.m}, ell=foot.ell, skew=-foot.skew, height=foot.height)
    F_T, F_H = plant(foot).forces([angle, rate], torque, [push, lift]).full().ravel()
    mirrored = plant(other).forces([-angle, -rate], -torque, [-push, lift]).full().ravel()
    assert mirrored == pytest.approx([F_H, F_T], rel=1e-10, abs=1e-8)


def test_a_foot_keeps_its_shape_when_it_is_scaled():
    from dataclasses import replace

    larger = replace(FOOT, ell=1.1 * FOOT.ell)
    assert (larger.toe, larger.heel) == pytest.approx((1.1 * FOOT.toe, 1.1 * FOOT.heel))
    assert (FOOT.toe, FOOT.heel) == pytest.approx((0.18, 0.06))


@pytest.mark.parametrize("skew", [1.0, -1.0, 2.0, math.nan])
def test_an_ankle_outside_the_foot_is_refused(skew):
    with pytest.raises(BadInput, match="between heel and toe"):
        Biped(**ADULT, ell=0.12, skew=skew)


@pytest.mark.parametrize(("kind", "adapt"), [("force", math.inf), ("cop", math.inf), ("force", 0.5)])
@given(toe=st.floats(0.08, 0.2), heel=st.floats(0.05, 0.12), height=st.floats(0.0, 0.12), share=shares,
       angle=st.floats(-2.0, 2.0))  # fmt: skip
@settings(max_examples=6, deadline=None)
def test_the_integral_brings_the_centre_of_pressure_to_its_target(kind, adapt, toe, heel, height, share, angle):
    foot = Biped(**ADULT, ell=(toe + heel) / 2, skew=(toe - heel) / (toe + heel), height=height)
    target = target_of(foot, share)
    world = slope(foot, name="tilt", angle=math.radians(angle), ramp=2.0, duration=40.0)
    run = simulate(closed_loop(foot, kind, 0.0, adapt, None, target), world, GAINS, 0.005)
    assert run.fallen is None
    assert run.P[-1] == pytest.approx(target, abs=2e-6)
    rest = standing(foot, run.F[:, -1:], target)
    assert (run.theta[-1], run.tau[-1]) == pytest.approx((rest.theta[0], rest.tau[0]), abs=1e-3)
    assert run.F_estimate[:, -1] == pytest.approx(run.F[:, -1], abs=0.05)
    if math.isfinite(adapt):
        assert run.theta_d[-1] == pytest.approx(rest.theta[0], abs=1e-4)


def test_a_law_with_other_levers_in_mind_brings_it_where_its_own_balance_is():
    known = Biped(**ADULT, ell=0.13, skew=0.5, height=0.05)
    world = constant_force(name="wind", F_x=10.0, F_y=0.0, ramp=0.0, duration=40.0)
    run = simulate(closed_loop(FOOT, "cop", 0.0, math.inf, known, 0.04), world, GAINS, 0.005)
    assert met(FOOT, 0.04, known) == pytest.approx(0.04 * 0.12 / 0.13)
    assert run.P[-1] == pytest.approx(met(FOOT, 0.04, known), abs=1e-6)
    skewed = Biped(**ADULT, ell=0.13, skew=0.3)
    run = simulate(closed_loop(FOOT, "force", 0.0, math.inf, skewed, 0.04), world, GAINS, 0.005)
    assert run.P[-1] == pytest.approx(met(FOOT, 0.04, skewed), abs=1e-6)


@given(foot=feet, share=shares, F_T=st.floats(10, 900), F_H=st.floats(10, 900))
@settings(max_examples=40, deadline=None)
def test_laws_in_sampled_and_continuous_time_gather_the_same(foot, share, F_T, F_H):
    target = target_of(foot, share)
    P, N = foot.pressure(F_T, F_H), F_T + F_H
    for kind, expected in (("force", N * (target - P) / foot.ell), ("cop", target - P)):
        sampled = SampledLaw(kind=kind, biped=foot, gains=GAINS, period=0.01, target=target)
        _, after = sampled(0.0, (0.1, 0.2, F_T, F_H), 0.0)
        assert after == pytest.approx(0.01 * expected, abs=1e-9)
    adapting = AdaptingLaw(biped=foot, gains=GAINS, period=0.01, adapt=0.4, target=target)
    assert adapting(0.0, (0.1, 0.2, F_T, F_H), (0.0, 0.0))[1][0] == pytest.approx(0.01 * N * (target - P) / foot.ell)
    continuous = closed_loop(foot, "force", 0.0, 0.4, None, target).law.memory_rate([0.1, 0.2], [0, 0], [F_T, F_H])
    after = adapting(0.0, (0.1, 0.2, F_T, F_H), (0.0, 0.0))[1]
    assert np.array(after) / 0.01 == pytest.approx(continuous.full().ravel(), rel=1e-9, abs=1e-9)


def linearised(loop, gains, F):
    """The eigenvalues of the loop about where it rests under ``F``, by central differences; and that state."""
    biped, law = loop.biped, loop.law
    rest = standing(biped, np.array(F)[:, None], met(biped, law.target, law.biped))
    theta, tau = float(rest.theta[0]), float(rest.tau[0])
    pull = gains.K_f * (law.biped.weight / law.biped.ell if law.kind == "cop" else 1.0)
    theta_d = law.theta_d
    if math.isfinite(law.adapt):  # P^known = P_d there, so that the estimate is theta
        theta_d = theta
    s = (tau - gains.K_p * (theta_d - theta)) / pull
    z = np.array([theta, 0.0, s, *([theta_d] if loop.size == 4 else [])])
    assert np.abs(loop.rate(z, F, gains).full().ravel()) == pytest.approx(0.0, abs=1e-8)
    sizes = np.array([1e-5, 1e-4, 1e-5 * (1 + abs(s)), 1e-5])[: loop.size]
    columns = [
        (loop.rate(z + d, F, gains).full() - loop.rate(z - d, F, gains).full()).ravel() / (2 * h)
        for d, h in zip(np.diag(sizes), sizes, strict=True)
    ]
    return np.column_stack(columns)


@pytest.mark.parametrize(("kind", "adapt"), [("force", math.inf), ("cop", math.inf), ("force", 0.5)])
@pytest.mark.parametrize("other", [False, True], ids=["knows its body", "knows another"])
@given(foot=feet, share=shares, F_x=st.floats(-150, 150), F_y=st.floats(-150, 150))
@settings(max_examples=25, deadline=None)
def test_the_polynomial_is_that_of_the_loop_linearised_by_differences(kind, adapt, other, foot, share, F_x, F_y):
    known = Biped(M=66.0, L=0.95, I=75.0, m=1.5, ell=1.1 * foot.ell, skew=foot.skew, height=0.9 * foot.height)
    known = known if other else None
    loop = closed_loop(foot, kind, 0.02, adapt, known, target_of(foot, share))
    expected = np.poly(linearised(loop, GAINS, (F_x, F_y)))[1:]
    offset, slope_ = polynomial_map(loop, F_x, F_y)
    found = offset + slope_ @ np.array(GAINS)
    size = np.abs(offset) + np.abs(slope_) @ np.array(GAINS)
    assert found == pytest.approx(expected, rel=1e-5, abs=1e-5 * float(size.max()))
    assert np.abs(np.polyval([1.0, *found], np.roots([1.0, *expected]))).max() < 1e-3 * (1 + np.abs(expected).max())


@pytest.mark.parametrize(("kind", "adapt"), [("force", math.inf), ("force", 0.5), ("cop", math.inf), ("pd", math.inf)])
@given(foot=feet, share=shares, F_x=st.floats(-150, 150), F_y=st.floats(-150, 150))
@settings(max_examples=20, deadline=None)
def test_polynomial_map_matrix_and_characteristic_agree(kind, adapt, foot, share, F_x, F_y):
    target = target_of(foot, share)
    loop = closed_loop(foot, kind, 0.0, adapt, None, target)
    (place,) = deciding_places(foot, kind, np.array([[F_x], [F_y]]), adapt, target)
    offset, slope_ = polynomial_map(loop, F_x, F_y)
    p = characteristic(foot, kind, GAINS, place.A, place.load, adapt, place.beta)
    matrix = closed_loop_matrix(foot, kind, GAINS, place.A, place.load, adapt, None, place.beta)
    assert np.array(p) == pytest.approx(offset + slope_ @ np.array(GAINS), rel=1e-6, abs=1e-7)
    assert np.poly(matrix)[1:] == pytest.approx(p, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("kind", ["force", "cop"])
def test_the_paper_s_foot_has_the_paper_s_polynomial(kind):
    biped = Biped(M=50.0, L=0.75, I=50.0 * 0.75**2 / 4, m=0.1, ell=0.1)
    loop = closed_loop(biped, kind)
    for F_x, F_y in ((0.0, 0.0), (200.0, 60.0), (-90.0, 10.0)):
        A, load = math.hypot(biped.M * biped.g - F_y, F_x), biped.weight - F_y
        offset, slope_ = polynomial_map(loop, F_x, F_y)
        p = characteristic(biped, kind, (3500.0, 1200.0, 1.0), A, load)
        assert offset + slope_ @ [3500.0, 1200.0, 1.0] == pytest.approx(p, rel=1e-13)


@given(foot=feet, share=shares, K_p=st.floats(300, 4000), K_d=st.floats(50, 1500), K_f=st.floats(0.01, 10))
@settings(max_examples=60, deadline=None)
def test_the_rows_27_to_29_hold_where_the_polynomial_is_stable(foot, share, K_p, K_d, K_f):
    from design.model.stability import normalised_slacks, routh_hurwitz

    target, gains = target_of(foot, share), Gains(K_p, K_d, K_f)
    (place,) = deciding_places(foot, "force", np.array([[40.0], [-20.0]]), math.inf, target)
    p = characteristic(foot, "force", gains, place.A, place.load, math.inf, place.beta)
    pairs = [pair for row in routh_hurwitz(foot, "force", gains, *place).values() for pair in row]
    assume(min(abs(left - right) for left, right in pairs) > 1e-9)
    assert all(left > right for left, right in pairs) == is_hurwitz(p)
    assert (min(normalised_slacks(foot, "force", gains, *place)) > 0) == is_hurwitz(p)


def test_where_the_foot_asks_for_more_torque_than_there_is_nothing_stands():
    light = np.array([[0.0], [68.0 * 9.81 - 1.0]])  # hardly any weight is left to lean on
    rest = standing(FOOT, light, -0.05)
    assert np.isnan(rest.theta[0]) and rest.A[0] == 0.0
    assert not is_hurwitz(characteristic(FOOT, "force", GAINS, *rest.places[0][:2], beta=rest.places[0].beta))
