"""What is called proved is never broken, by other integrators, other bodies of the box, or demands moved by a hair."""

import itertools
import math
from dataclasses import replace
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.analysis.recheck import second_opinion
from design.model.body import Biped
from design.model.environment import constant_force, platform, profile, slope
from design.model.laws import Gains
from design.model.limits import Required
from design.model.stability import characteristic, decay_rate
from design.model.uncertainty import Spread, Tolerances
from design.proof import exact
from design.proof.box import prove
from design.proof.case import Case, NotProved
from design.proof.norm import contracts, inverted
from design.proof.tube import bounds
from design.spec.load import load
from design.spec.setting import setting

SLOPE = setting(load("slope").spec)
PAPER = SLOPE.biped
ADULT = Biped(M=70.0, L=0.95, I=4 / 3 * 70.0 * 0.95**2, m=2.0, ell=0.12)
CALM = Gains(3500.0, 606.2, 5.61)
BOX = (0.02 * PAPER.M, 0.02 * PAPER.L, 0.02 * PAPER.I, 0.0, 0.02 * PAPER.ell, math.radians(1.0), 0.05)
WORLDS = {
    "ramp": lambda body: slope(body, name="w", angle=math.radians(12), ramp=1.5, duration=3.0),
    "step": lambda body: slope(body, name="w", angle=math.radians(-3), ramp=0.0, duration=2.0),
    "wind": lambda body: constant_force(name="w", F_x=-40.0, F_y=25.0, ramp=0.8, duration=2.0),
    "train": lambda body: platform(
        body, name="w", points=np.array([[0.0, 0.0], [0.5, 0.6], [1.0, 0.6], [1.0, -0.3]]), duration=2.0
    ),
    "push": lambda body: profile(
        name="w", points=np.array([[0.0, 0.0, 0.0], [0.3, 30.0, -20.0], [0.4, 0.0, 0.0]]), duration=1.5, theta0=0.01,
    ),
}  # fmt: skip


def _case(body, gains, world, radii=(0.0,) * 7, kind="force", step=1e-3):
    radii = list(radii)
    if world.kind != "slope":
        radii[5] = 0.0
    if world.kind not in ("slope", "force") or world.times[-1] == 0:
        radii[6] = 0.0
    return Case(biped=body, kind=kind, gains=gains, theta_d=0.0, scenario=world, radii=tuple(radii), step=step)


def _held(case, found, biped, scenario, slack=2e-4):
    """Whether another integrator's run of a body and world of the box stays within the bounds over all times."""
    ran = second_opinion(biped, case.kind, 0.0, case.gains, scenario, case.step)
    for row, values in (("toe-force", ran.F_T), ("heel-force", ran.F_H), ("torque", np.abs(ran.tau))):
        assert values.min() >= found.low[row].min() - slack, row
        assert values.max() <= found.high[row].max() + slack, row
    margin = biped.ell - np.abs(ran.F_T - ran.F_H) * biped.ell / (ran.F_T + ran.F_H)
    assert margin.min() >= found.low["cop-margin"].min() - 1e-6


# ---- the tube holds what it should


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize(("body", "gains"), [(PAPER, CALM), (ADULT, Gains(2500.0, 900.0, 0.3))])
def test_at_every_time_the_nominal_run_lies_within_the_bounds_and_they_are_narrow(world, body, gains):
    case = _case(body, gains, WORLDS[world](body))
    found = bounds(case)
    ran = second_opinion(body, "force", 0.0, gains, case.scenario, case.step)
    for row, values in (("toe-force", ran.F_T), ("heel-force", ran.F_H)):
        piece = np.clip(np.searchsorted(found.t, ran.t, side="right") - 1, 0, None)
        inside = np.append(np.diff(ran.t) > 0, True) & np.append(True, np.diff(ran.t) > 0)  # not both sides of a jump
        assert (found.low[row][piece] <= values + 2e-4)[inside].all()
        assert (found.high[row][piece] >= values - 2e-4)[inside].all()
        assert np.median((found.high[row] - found.low[row])[piece]) < 0.5


@pytest.mark.parametrize("world", WORLDS)
def test_bodies_and_worlds_of_the_box_stay_within_its_bounds(world):
    case = _case(PAPER, CALM, WORLDS[world](PAPER), tuple(0.6 * part for part in BOX))
    found = bounds(case)
    rng = np.random.default_rng(5)
    points = [dict.fromkeys(case.moving, 1.0), dict.fromkeys(case.moving, -1.0)]
    points += [{k: float(rng.choice([-1.0, 1.0])) for k in case.moving} for _ in range(4)]
    points += [{k: float(rng.uniform(-1, 1)) for k in case.moving} for _ in range(4)]
    for shares in points:
        _held(case, found, *case.at(shares))


@pytest.mark.slow
@given(
    kp=st.floats(800.0, 4000.0), kd=st.floats(200.0, 1500.0), kf=st.floats(0.0, 12.0),
    world=st.sampled_from(sorted(WORLDS)), body=st.sampled_from([PAPER, ADULT]), kind=st.sampled_from(["force", "pd"]),
    part=st.sampled_from([0.0, 0.1]),
)  # fmt: skip
@settings(max_examples=20, deadline=None)
def test_random_designs_are_bounded_rightly_or_not_at_all(kp, kd, kf, world, body, kind, part):
    gains = Gains(kp, kd, 0.0 if kind == "pd" else kf)
    case = _case(body, gains, WORLDS[world](body), tuple(part * radius for radius in BOX), kind)
    try:
        found = bounds(case)
    except NotProved:
        return
    for share in (0.0, 1.0, -1.0):
        _held(case, found, *case.at(dict.fromkeys(case.moving, share)))


def test_an_integration_to_thirty_digits_lies_within_the_bounds():
    case = _case(PAPER, CALM, WORLDS["step"](PAPER))
    found = bounds(case)
    F = case.scenario.force_at(np.array([0.0]))[:, 0]
    M, L, I, m, ell, g = (mpmath.mpf(part) for part in (PAPER.M, PAPER.L, PAPER.I, PAPER.m, PAPER.ell, PAPER.g))
    alpha = -3 * mpmath.pi / 180
    with mpmath.workdps(30):

        def parts(z):
            tau = -CALM.K_d * z[1] - CALM.K_p * z[0] + CALM.K_f * z[2]
            turning = (M * g * L * mpmath.sin(z[0] + alpha) + tau) / I
            return tau, turning

        def rate(_, z):
            tau, turning = parts(z)
            return [z[1], turning, tau / ell]

        run = mpmath.odefun(rate, 0, [0, 0, 0], tol=mpmath.mpf(10) ** -22)
        for t in (0.0305, 0.1205):
            z = run(mpmath.mpf(t))
            tau, turning = parts(z)
            pressing = M * (g * mpmath.cos(alpha) - L * (turning * mpmath.sin(z[0]) + z[1] ** 2 * mpmath.cos(z[0])))
            heel = (pressing + m * g + tau / ell) / 2
            piece = int(np.searchsorted(found.t, t, side="right")) - 1
            assert found.low["heel-force"][piece] <= heel <= found.high["heel-force"][piece]
            assert found.high["heel-force"][piece] - found.low["heel-force"][piece] < 5.0  # it moves within the piece
    assert F[0] < 0


# ---- the paper's case


def test_the_papers_gains_are_proved_and_the_bound_is_within_a_hundredth_of_a_newton():
    proof = prove(SLOPE, SLOPE.gains, "ramp")
    assert proof.answer == "proved"
    ran = second_opinion(PAPER, "force", 0.0, SLOPE.gains, SLOPE.scenarios[0], 1e-4)
    assert 0 <= ran.F_H.min() - proof.value["heel-force"] < 0.01
    assert 0 <= ran.F_T.min() - proof.value["toe-force"] < 0.01
    assert proof.value["decay-rate"] <= 1.40038


def test_pd_alone_is_disproved_with_the_instant():
    alone = SLOPE.with_law("pd")
    proof = prove(alone, alone.gains, "ramp")
    assert proof.answer == "disproved"
    assert proof.counterexample.row == "heel-force"
    assert proof.counterexample.time_s == pytest.approx(1.176, abs=1e-3)
    assert proof.counterexample.value < 0


def test_a_box_of_two_per_cent_and_a_degree_is_proved_on_gains_with_more_than_150_newtons():
    tolerant = replace(SLOPE, tolerances=Tolerances(
        M=Spread(part=0.02), L=Spread(part=0.02), I=Spread(part=0.02), ell=Spread(part=0.02),
        slope=Spread(absolute=math.radians(1.0)),
    ))  # fmt: skip
    proof = prove(tolerant, CALM, "ramp")
    assert proof.answer == "proved"
    assert proof.share == 1.0
    for corner in itertools.islice(itertools.product([-1.0, 1.0], repeat=5), 0, 32, 5):
        shares = [*corner[:3], 0.0, corner[3], corner[4], 0.0]
        biped, scenario = tolerant.tolerances.drawn(PAPER, SLOPE.scenarios[0], shares)
        ran = second_opinion(biped, "force", 0.0, CALM, scenario, 1e-3)
        assert min(ran.F_T.min(), ran.F_H.min()) >= min(proof.value["toe-force"], proof.value["heel-force"])


# ---- by a hair


@pytest.mark.parametrize("name", ["ramp", "step"])
def test_demands_just_below_and_just_above_what_is_are_not_confused(name):
    world = WORLDS[name](PAPER)
    problem = replace(SLOPE, scenarios=(world,))
    ran = second_opinion(PAPER, "force", 0.0, CALM, world, 1e-4)
    least = float(min(ran.F_T.min(), ran.F_H.min()))
    for off, allowed in ((-0.5, {"proved"}), (-1e-3, {"proved", "unknown"}), (1e-3, {"unknown", "disproved"}),
                         (0.5, {"disproved"})):  # fmt: skip
        demanding = replace(problem, required={**problem.required, "contact-force": Required(level=least + off)})
        assert prove(demanding, CALM, "w").answer in allowed


@pytest.mark.slow
@given(kp=st.floats(300.0, 3500.0), kd=st.floats(50.0, 1200.0), kf=st.floats(0.05, 17.0), degrees=st.floats(0.5, 8.0))
@settings(max_examples=25, deadline=None)
def test_a_design_that_dense_sampling_breaks_is_never_proved(kp, kd, kf, degrees):
    world = slope(PAPER, name="w", angle=math.radians(degrees), ramp=0.0, duration=2.0)
    proof = prove(replace(SLOPE, scenarios=(world,)), Gains(kp, kd, kf), "w", seconds=5.0)
    ran = second_opinion(PAPER, "force", 0.0, Gains(kp, kd, kf), world, 5e-4)
    broken = not ran.finished or np.nanmin(ran.F_T) < 0 or np.nanmin(ran.F_H) < 0
    if broken:
        assert proof.answer != "proved"
    if proof.answer == "disproved" and proof.counterexample.row != "decay-rate":
        assert broken


# ---- exact arithmetic


@given(kp=st.floats(400.0, 3500.0), kd=st.floats(50.0, 1200.0), kf=st.floats(0.05, 10.0))
@settings(deadline=None)
def test_a_decay_rate_is_decided_on_both_sides(kp, kd, kf):
    gains = Gains(kp, kd, kf)
    A = PAPER.M * PAPER.g
    sigma = decay_rate(characteristic(PAPER, "force", gains, A, PAPER.weight))
    bodies = exact.body(PAPER, (0.0,) * 7)
    size = exact.sizes(bodies, SLOPE.scenarios[0])
    assert size.low == size.high == Fraction(50) * Fraction("9.81")
    if abs(sigma) > 1e-3:
        slower, faster = sorted([sigma * (1 - 1e-6), sigma * (1 + 1e-6)])
        assert exact.decays(bodies, "force", gains, size, Fraction(slower))
        assert not exact.decays(bodies, "force", gains, size, Fraction(faster))


@given(F_x=st.floats(-300.0, 300.0), F_y=st.floats(-200.0, 200.0), share=st.floats(0.0, 1.0))
def test_the_range_of_A_holds_every_A_on_the_way(F_x, F_y, share):
    world = constant_force(name="w", F_x=F_x, F_y=F_y, ramp=1.0, duration=2.0)
    size = exact.sizes(exact.body(PAPER, (1.0, 0, 0, 0, 0, 0, 0)), world)
    for mass in (49.0, 50.3, 51.0):
        A = math.hypot(mass * 9.81 - share * F_y, share * F_x)
        assert float(size.low) <= A * (1 + 1e-12)
        assert A * (1 - 1e-12) <= float(size.high)


def test_a_contraction_that_is_claimed_too_fast_is_refused():
    P = np.array([[2.0, 0.5], [0.5, 1.0]])
    J = np.array([[-1.0, 0.2], [-0.3, -2.0]])
    root = np.linalg.inv(np.linalg.cholesky(P).T)
    rate = -0.5 * float(np.linalg.eigvalsh(root.T @ (P @ J + J.T @ P) @ root).max())
    assert contracts(P, J, rate * (1 - 1e-9))
    assert not contracts(P, J, rate * (1 + 1e-9))
    assert not contracts(-P, J, -5.0)
    assert (np.abs(inverted(P)) >= np.abs(np.linalg.inv(P)) * (1 - 1e-15)).all()


def test_a_ramp_of_uncertain_length_must_end_within_the_scenario():
    world = slope(PAPER, name="w", angle=math.radians(5), ramp=2.0, duration=2.0)
    with pytest.raises(NotProved, match="lengthen"):
        bounds(_case(PAPER, CALM, world, (0.0,) * 6 + (0.1,)))


def test_what_is_not_bounded_yet_is_unknown():
    problem = SLOPE.with_law("cop")
    assert prove(problem, problem.gains, "ramp").answer == "unknown"
    adapting = replace(SLOPE, adapt=0.3)
    assert prove(adapting, SLOPE.gains, "ramp").answer == "unknown"
