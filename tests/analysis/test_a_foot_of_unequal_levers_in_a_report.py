"""Rows of a foot with unequal levers: both integrators, both directions, a mirror, and the linear loop's margins."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.analysis.recheck import second_opinion
from design.analysis.simulate import simulate
from design.analysis.survival import at_rest, mirrored, push, push_limit, slope_limit, step_slope
from design.analysis.verdict import judge
from design.model.body import Biped
from design.model.broken_loop import breaks
from design.model.closed_loop import closed_loop
from design.model.deciding import deciding_places
from design.model.environment import slope
from design.model.laws import Gains
from design.model.sampling import sampled_matrix
from design.model.stability import characteristic
from design.spec.load import builtin_text, load, parse
from design.spec.setting import setting

FEET = setting(load("adult-foot").spec)
GAINS = FEET.given_gains()
ADULT = {"M": 68.0, "L": 0.92, "I": 70.0, "m": 2.0}
LAWS = [("force", math.inf), ("cop", math.inf), ("force", 0.5), ("pd", math.inf)]


@pytest.mark.parametrize(("kind", "adapt"), LAWS)
def test_a_second_integrator_that_shares_no_code_agrees(kind, adapt):
    world = FEET.scenarios[0]
    run = simulate(closed_loop(FEET.biped, kind, 0.01, adapt, None, 0.03), world, GAINS, 1e-3)
    other = second_opinion(FEET.biped, kind, 0.01, GAINS, world, 1e-3, adapt, 0.03)
    for mine, its in ((run.F_T, other.F_T), (run.F_H, other.F_H), (run.tau, other.tau)):
        assert np.abs(mine - its).max() < 1e-6 * FEET.biped.weight


@pytest.mark.parametrize(("kind", "adapt"), LAWS[:3])
def test_a_sudden_slope_is_survived_just_inside_and_not_just_outside(kind, adapt):
    loop = closed_loop(FEET.biped, kind, 0.0, adapt, None, 0.03)
    gains = Gains(3000.0, 900.0, 0.6)
    theta, s, theta_d = at_rest(loop, gains)
    found = step_slope(loop, gains, 2e-3)
    assert found.survived < 0.999 * found.limit
    for factor, kept in ((0.999, True), (1.001, False)):
        least = []
        for sign in (1, -1):
            world = slope(FEET.biped, name="s", angle=sign * factor * found.survived, ramp=0.0, duration=10.0)
            world = replace(world, theta0=theta)
            run = second_opinion(FEET.biped, kind, theta_d, gains, world, 2e-3, adapt, 0.03, s)
            least.append(min(run.F_T.min(), run.F_H.min()))
        assert bool(min(least) >= 0) is kept


def test_a_push_is_survived_just_inside_and_not_just_outside():
    loop, biped = closed_loop(FEET.biped, "force", 0.0, math.inf, None, 0.03), FEET.biped
    gains = Gains(3000.0, 900.0, 0.6)
    theta, s, theta_d = at_rest(loop, gains)
    survived = push(loop, gains, 2e-3).survived
    for factor, kept in ((0.999, True), (1.001, False)):
        least = []
        for sign in (1, -1):
            rate = sign * factor * survived * biped.L / biped.I
            world = slope(biped, name="s", angle=0.0, ramp=0.0, duration=10.0, theta0=theta, omega0=rate)
            run = second_opinion(biped, "force", theta_d, gains, world, 2e-3, math.inf, 0.03, s)
            least.append(min(run.F_T.min(), run.F_H.min()))
        assert bool(min(least) >= 0) is kept


@given(toe=st.floats(0.05, 0.25), heel=st.floats(0.05, 0.25), height=st.floats(0.0, 0.15), share=st.floats(-0.5, 0.5))
@settings(max_examples=25, deadline=None)
def test_no_ankle_holds_a_body_beyond_the_slope_limit_and_one_does_within(toe, heel, height, share):
    biped = Biped(**ADULT, ell=(toe + heel) / 2, skew=(toe - heel) / (toe + heel), height=height)
    target = biped.ell * (biped.skew + share)
    theta, *_ = at_rest(closed_loop(biped, "force", 0.0, math.inf, None, target), GAINS)
    limit = slope_limit(biped, theta)

    def moment(angle, end):  # about the point of the ground under the ankle, with the whole load at one end
        down, along = biped.M * biped.g * math.cos(angle), biped.M * biped.g * math.sin(angle)
        body = down * biped.L * math.sin(theta) + along * (biped.L * math.cos(theta) + biped.height)
        middle = 0.5 * (biped.toe - biped.heel)
        return body + middle * biped.m * biped.g - end * (down + biped.m * biped.g)

    def falls(angle):
        return moment(angle, biped.toe) > 0 or moment(angle, -biped.heel) < 0

    assert not falls(0.999 * limit) and not falls(-0.999 * limit)
    assert falls(1.001 * limit) or falls(-1.001 * limit)


def test_a_push_beyond_the_limit_defeats_even_the_best_ankle():
    b, N = FEET.biped, FEET.biped.weight
    limit = push_limit(b)  # smaller on the heel's side
    ground = b.I + b.M * b.L * b.height

    def turns_back(impulse):  # linear, with the whole load under the heel
        theta, omega, h = 0.0, -impulse * b.L / b.I, 1e-4
        for _ in range(100_000):
            omega += h * (b.M * b.g * b.L * theta + b.tilt + b.heel * N) / ground
            theta += h * omega
            if omega > 0 or theta < -1:
                return omega > 0
        return False

    assert turns_back(0.998 * limit)
    assert not turns_back(1.002 * limit)


@pytest.mark.parametrize("kind", ["force", "cop"])
def test_a_report_is_the_same_in_a_mirror(kind):
    required = dict(FEET.required)
    one = replace(FEET, law=kind, theta_d=0.02, required=required)
    other = replace(
        one, biped=mirrored(FEET.biped), target=-FEET.target, theta_d=-0.02,
        scenarios=tuple(
            slope(FEET.biped, name="ramp", angle=-math.radians(8.0), ramp=5.0, duration=12.0) for _ in FEET.scenarios
        ),
    )  # fmt: skip
    names = {"toe-force": "heel-force", "heel-force": "toe-force"}
    rows = {row.id: row.value for row in judge(one, GAINS, "all").rows}
    swapped = {names.get(row.id, row.id): row.value for row in judge(other, GAINS, "all").rows}
    assert rows.keys() == swapped.keys()
    for id, value in rows.items():
        assert swapped[id] == (None if value is None else pytest.approx(value, rel=1e-6, abs=1e-9)), id


def test_heel_and_toe_are_each_judged_by_their_own_lever():
    rows = {row.id: row.value for row in judge(FEET, GAINS).rows}
    run = simulate(FEET.loop(), FEET.scenarios[0], GAINS, FEET.step)
    assert rows["cop-margin"] == pytest.approx(min((0.18 - run.P).min(), (0.06 + run.P).min()))
    assert rows["toe-force"] == pytest.approx(run.F_T.min())
    assert rows["heel-force"] == pytest.approx(run.F_H.min())


def test_where_stability_was_sampled_a_row_says_so_and_the_paper_s_stay_exact():
    basis = {row.id: row.basis for row in judge(FEET, GAINS).rows}
    assert {basis[id] for id in ("stiffness", "damping", "routh", "decay-rate")} == {"sampled"}
    paper = setting(load("slope").spec)
    basis = {row.id: row.basis for row in judge(paper, paper.given_gains()).rows}
    assert {basis[id] for id in ("stiffness", "damping", "routh", "decay-rate")} == {"exact"}


def test_the_slope_rate_of_such_a_foot_is_undecided_with_its_reason():
    row = next(row for row in judge(FEET, GAINS, "all").rows if row.id == "slope-rate")
    assert (row.status, row.value) == ("undecided", None)
    assert "toe 0.18 m and heel 0.06 m" in row.note and "0.08 m high" in row.note and "0.03 m" in row.note


def test_settling_is_to_the_posture_with_the_cop_at_its_target():
    text = builtin_text("adult-foot").replace("duration_s = 12.0", "duration_s = 30.0")
    its = setting(parse(text, origin="mine").spec)
    rows = {row.id: row for row in judge(its, Gains(3000.0, 1000.0, 1.0), "all").rows}
    assert rows["posture-error"].value < 1e-4
    assert rows["settling"].value is not None


PLACES = [
    deciding_places(FEET.biped, "force", np.array([[F_x], [10.0]]), math.inf, target)[0]
    for F_x in (-80.0, 0.0, 120.0)
    for target in (-0.02, 0.03, 0.1)
]


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize(("kind", "adapt"), LAWS[:3])
def test_every_break_of_the_loop_closes_to_its_polynomial(kind, adapt, place):
    A, load, beta = place
    p = characteristic(FEET.biped, kind, GAINS, A, load, adapt, beta)
    for broken in breaks(FEET.biped, kind, GAINS, A, load, adapt, beta).values():
        whole = (broken.P + broken.Q).coef[::-1]
        assert whole[1:] / whole[0] == pytest.approx(p, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(("kind", "adapt"), LAWS[:3])
def test_one_held_period_is_what_the_body_and_the_sampled_law_do(kind, adapt):
    """The matrix against a fine simulation of the nonlinear plant near its rest, with the torque held."""
    from design.model.plant import plant
    from design.model.standing import standing

    biped, target, T = FEET.biped, 0.03, 0.02
    F = np.array([60.0, 20.0])
    rest = standing(biped, F[:, None], target)
    (place,) = rest.places
    matrix = sampled_matrix(biped, kind, GAINS, place.A, place.load, T, adapt, place.beta)
    body = plant(biped)
    loop = closed_loop(biped, kind, 0.0, adapt, None, target)
    tau_0, theta_0 = float(rest.tau[0]), float(rest.theta[0])
    K_p, K_d, K_f = GAINS
    pull = K_f * (biped.weight / biped.ell if kind == "cop" else 1.0)
    scale = pull / (K_f * (biped.weight / place.load if kind == "cop" else 1.0))  # of the matrix' s
    n = len(matrix)
    size = 1e-4
    for k in range(n):
        d = np.zeros(n)
        d[k] = size
        theta, omega, s = theta_0 + d[0], d[1], d[2] / scale
        aim = 0.0
        if n == 5:
            from design.model.laws import swing

            aim = d[3] - swing(biped, adapt) * omega
        tau = tau_0 + K_p * (aim - d[0]) - K_d * omega + pull * s
        x, after = np.array([theta, omega]), s
        forces = body.forces(x, tau_0 + d[4] if n == 5 else tau, F)
        first = loop.law.memory_rate(x, [0, 0][: n - 3 if n == 5 else 1], forces).full().ravel()
        steps = 400
        for _ in range(steps):

            def rate(x, tau=tau):
                xdot = body.dynamics(x, tau, F).full().ravel()
                return xdot, float(loop.law.memory_rate(x, np.zeros(loop.size - 2), body.forces(x, tau, F))[0])

            k1, g1 = rate(x)
            k2, g2 = rate(x + T / steps * k1)
            x = x + T / steps * (k1 + k2) / 2
            after += T / steps * (g1 + g2) / 2
        expected = matrix @ d
        assert x[0] - theta_0 == pytest.approx(expected[0], abs=2e-7)
        assert x[1] == pytest.approx(expected[1], abs=2e-5)
        if n == 5:
            assert first[0] * T + s == pytest.approx(expected[2], abs=2e-6 * (1 + abs(expected[2])))
        else:
            assert after * scale == pytest.approx(expected[2], abs=3e-3 * abs(expected[2]) + 1e-7)


@pytest.mark.parametrize("kind", ["force", "pd", "cop"])
def test_many_bodies_at_once_are_the_runs_of_each(kind):
    from design.analysis.many import least_forces
    from design.model.uncertainty import Spread, Tolerances

    wide = Tolerances(M=Spread(part=0.1), ell=Spread(part=0.1), slope=Spread(absolute=0.02))
    shares = np.array([[0.0] * 7, [1, 0, 0, 0, -1, 1, 0], [-1, 0, 0, 0, 1, -1, 0]])
    found = least_forces(FEET.biped, kind, GAINS, FEET.scenarios[0], wide, shares, step=2e-3, target=0.03)
    for k, share in enumerate(shares):
        biped, world = wide.drawn(FEET.biped, FEET.scenarios[0], share.tolist())
        run = simulate(closed_loop(biped, kind, 0.0, math.inf, FEET.biped, 0.03), world, GAINS, 2e-3)
        assert [each[k] for each in found] == pytest.approx([run.F_T.min(), run.F_H.min()], abs=1e-3)


@pytest.mark.parametrize("key", ["ankle_height_m = 0.01", "cop_target_m", "toe_m"])
def test_what_is_proved_for_the_paper_s_foot_only_is_refused_in_one_line(key):
    from design.checking import Refused
    from design.checking.world import read
    from design.errors import BadInput
    from design.proof.box import prove
    from design.proof.largest import largest
    from problems.region import solve

    text = builtin_text("slope")
    changed = {
        "ankle_height_m = 0.01": text.replace("[foot]\n", "[foot]\nankle_height_m = 0.01\n", 1),
        "cop_target_m": text.replace("[law]\n", "[law]\ncop_target_m = 0.01\n", 1),
        "toe_m": text.replace("half_length_m = 0.1", "toe_m = 0.12\nheel_m = 0.08", 1),
    }[key]
    assert changed != text
    its = setting(parse(changed, origin="mine").spec)
    gains = its.given_gains()
    for ask in (
        lambda: prove(its, gains, "ramp"),
        lambda: largest(its, gains, "ramp"),
        lambda: solve(its, its.scenarios[0], gains),
    ):
        with pytest.raises(BadInput, match=r"foot: has .*needs toe and heel equally far from an ankle on the ground"):
            ask()
    with pytest.raises(Refused):
        read(changed)
