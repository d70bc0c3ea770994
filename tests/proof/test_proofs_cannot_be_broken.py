"""What is called proved is never broken, by other integrators, other bodies of the box, or demands moved by a hair."""

import itertools
import math
from dataclasses import replace
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from design.analysis.recheck import second_opinion
from design.analysis.verdict import stability_rows
from design.model.body import Biped
from design.model.environment import constant_force, platform, profile, slope
from design.model.laws import Gains
from design.model.limits import Required
from design.model.stability import closed_loop_matrix
from design.model.uncertainty import Spread, Tolerances
from design.proof import exact, poles
from design.proof.box import prove
from design.proof.case import Case, NotProved
from design.proof.jacobian import jacobian
from design.proof.norm import Norm, holds, inverted, settled, transfer
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


def _case(body, gains, world, radii=(0.0,) * 7, kind="force", step=1e-3, adapt=math.inf):
    radii = list(radii)
    if world.kind != "slope":
        radii[5] = 0.0
    if world.kind not in ("slope", "force") or world.times[-1] == 0:
        radii[6] = 0.0
    return Case(biped=body, kind=kind, gains=gains, theta_d=0.0, scenario=world, radii=tuple(radii), step=step,
                known=body, adapt=adapt)  # fmt: skip


def _held(case, found, biped, scenario, slack=2e-4):
    """Whether another integrator's run of a body and world of the box stays within the bounds over all times."""
    ran = second_opinion(biped, case.kind, 0.0, case.gains, scenario, case.step, case.adapt, known=case.believed)
    for row, values in (("toe-force", ran.F_T), ("heel-force", ran.F_H), ("torque", np.abs(ran.tau))):
        assert values.min() >= found.low[row].min() - slack, row
        assert values.max() <= found.high[row].max() + slack, row
    margin = biped.ell - np.abs(ran.F_T - ran.F_H) * biped.ell / (ran.F_T + ran.F_H)
    assert margin.min() >= found.low["cop-margin"].min() - 1e-6


# ---- the tube holds what it should


LAWS = {"force": ("force", math.inf), "cop": ("cop", math.inf), "adapts": ("force", 0.2)}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize(("body", "gains"), [(PAPER, CALM), (ADULT, Gains(2500.0, 900.0, 0.3))])
def test_at_every_time_the_nominal_run_lies_within_the_bounds_and_they_are_narrow(world, body, gains, law):
    kind, adapt = LAWS[law]
    case = _case(body, gains, WORLDS[world](body), kind=kind, adapt=adapt)
    found = bounds(case)
    ran = second_opinion(body, kind, 0.0, gains, case.scenario, case.step, adapt)
    for row, values in (("toe-force", ran.F_T), ("heel-force", ran.F_H)):
        piece = np.clip(np.searchsorted(found.t, ran.t, side="right") - 1, 0, None)
        inside = np.append(np.diff(ran.t) > 0, True) & np.append(True, np.diff(ran.t) > 0)  # not both sides of a jump
        assert (found.low[row][piece] <= values + 2e-4)[inside].all()
        assert (found.high[row][piece] >= values - 2e-4)[inside].all()
        within = np.flatnonzero(found.t[1:] <= case.scenario.duration)  # what comes after may be more, or less
        assert values.min() - found.low[row][within].min() < 0.1
        assert found.high[row][within].max() - values.max() < 0.1


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("world", WORLDS)
def test_bodies_and_worlds_of_the_box_stay_within_its_bounds(world, law):
    kind, adapt = LAWS[law]
    part = 0.6 if law == "force" else 0.15
    case = _case(PAPER, CALM, WORLDS[world](PAPER), tuple(part * each for each in BOX), kind, adapt=adapt)
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
    world=st.sampled_from(sorted(WORLDS)), body=st.sampled_from([PAPER, ADULT]),
    law=st.sampled_from(["force", "pd", "cop", 2.0, 0.1]),
    part=st.sampled_from([0.0, 0.1]),
)  # fmt: skip
@example(kp=800.0, kd=200.0, kf=2.2250738585e-313, world="push", body=PAPER, law="force", part=0.0)
@settings(max_examples=40, deadline=None)
def test_random_designs_are_bounded_rightly_or_not_at_all(kp, kd, kf, world, body, law, part):
    kind, adapt = ("force", law) if isinstance(law, float) else (law, math.inf)
    gains = Gains(kp, kd, 0.0 if kind == "pd" else kf)
    case = _case(body, gains, WORLDS[world](body), tuple(part * radius for radius in BOX), kind, adapt=adapt)
    try:
        found = bounds(case)
    except NotProved:
        return
    for share in (0.0, 1.0, -1.0):
        _held(case, found, *case.at(dict.fromkeys(case.moving, share)))


@pytest.mark.parametrize("law", LAWS)
def test_an_integration_to_thirty_digits_lies_within_the_bounds(law):
    kind, adapt = LAWS[law]
    real = replace(PAPER, M=50.2, ell=0.0995)  # not quite what the law believes in
    case = replace(_case(real, CALM, WORLDS["step"](real), kind=kind, adapt=adapt), known=PAPER)
    found = bounds(case)
    M, L, I, m, ell, g = (mpmath.mpf(part) for part in (real.M, real.L, real.I, real.m, real.ell, real.g))
    weight, lever = PAPER.M * g + PAPER.m * g, PAPER.M * g * PAPER.L
    alpha = -3 * mpmath.pi / 180
    with mpmath.workdps(30):

        def parts(z):
            tau = -CALM.K_d * z[1] + CALM.K_p * (z[3] - z[0]) + CALM.K_f * z[2]
            turning = (M * g * L * mpmath.sin(z[0] + alpha) + tau) / I
            pressing = M * (g * mpmath.cos(alpha) - L * (turning * mpmath.sin(z[0]) + z[1] ** 2 * mpmath.cos(z[0])))
            return tau, turning, pressing + m * g

        def rate(_, z):
            tau, turning, load = parts(z)
            gathered = tau / ell * (weight / load if kind == "cop" else 1)
            leaning = z[0] + (PAPER.ell * tau / ell - PAPER.I * turning) / lever
            return [z[1], turning, gathered, (leaning - z[3]) / adapt if adapt < math.inf else 0]

        run = mpmath.odefun(rate, 0, [0, 0, 0, 0], tol=mpmath.mpf(10) ** -22)
        for t in (0.0305, 0.1205):
            tau, _, load = parts(run(mpmath.mpf(t)))
            piece = int(np.searchsorted(found.t, t, side="right")) - 1
            for row, value in (("heel-force", (load + tau / ell) / 2), ("toe-force", (load - tau / ell) / 2),
                               ("load", load), ("torque", abs(tau))):  # fmt: skip
                assert found.low[row][piece] <= value <= found.high[row][piece], row
            forces = []
            for at in found.t[piece : piece + 2].tolist():
                tau, _, load = parts(run(mpmath.mpf(at)))
                forces.append(float((load + tau / ell) / 2))
            assert found.low["heel-force"][piece] > min(forces) - 0.05
            assert found.high["heel-force"][piece] < max(forces) + 0.05


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


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("name", ["ramp", "step"])
def test_demands_just_below_and_just_above_what_is_are_not_confused(name, law):
    world = WORLDS[name](PAPER)
    kind, adapt = LAWS[law]
    if (name, law) == ("step", "adapts"):  # the step lifts its foot
        world = slope(PAPER, name="w", angle=math.radians(-1.5), ramp=0.0, duration=2.0)
    problem = replace(SLOPE, scenarios=(world,), law=kind, adapt=adapt)
    ran = second_opinion(PAPER, kind, 0.0, CALM, world, 1e-4, adapt)
    least = float(min(ran.F_T.min(), ran.F_H.min()))
    for off, allowed in ((-0.5, {"proved"}), (-1e-3, {"proved", "unknown"}), (1e-3, {"unknown", "disproved"}),
                         (0.5, {"disproved"})):  # fmt: skip
        demanding = replace(problem, required={**problem.required, "contact-force": Required(level=least + off)})
        assert prove(demanding, CALM, "w").answer in allowed


@pytest.mark.slow
@given(kp=st.floats(300.0, 3500.0), kd=st.floats(50.0, 1200.0), kf=st.floats(0.05, 17.0), degrees=st.floats(0.5, 8.0),
       law=st.sampled_from(sorted(LAWS)))  # fmt: skip
@settings(max_examples=40, deadline=None)
def test_a_design_that_dense_sampling_breaks_is_never_proved(kp, kd, kf, degrees, law):
    world = slope(PAPER, name="w", angle=math.radians(degrees), ramp=0.0, duration=2.0)
    kind, adapt = LAWS[law]
    problem = replace(SLOPE, scenarios=(world,), law=kind, adapt=adapt)
    proof = prove(problem, Gains(kp, kd, kf), "w", seconds=5.0)
    ran = second_opinion(PAPER, kind, 0.0, Gains(kp, kd, kf), world, 5e-4, adapt)
    broken = not ran.finished or np.nanmin(ran.F_T) < 0 or np.nanmin(ran.F_H) < 0
    if broken:
        assert proof.answer != "proved"
    if proof.answer == "disproved" and proof.counterexample.row != "decay-rate":
        assert broken


# ---- exact arithmetic


@pytest.mark.parametrize("law", ["pd", *LAWS])
@given(kp=st.floats(400.0, 3500.0), kd=st.floats(50.0, 1200.0), kf=st.floats(0.05, 10.0), off=st.floats(-0.05, 0.05))
@settings(deadline=None)
def test_a_decay_rate_is_decided_on_both_sides(law, kp, kd, kf, off):
    gains = Gains(kp, kd, kf)
    kind, adapt = LAWS.get(law, (law, math.inf))
    real = replace(PAPER, M=PAPER.M * (1 + off), I=PAPER.I * (1 - off), ell=PAPER.ell * (1 + off))
    world = constant_force(name="w", F_x=20.0, F_y=-30.0, ramp=0.0, duration=1.0)
    case = replace(_case(real, gains, world, kind=kind, adapt=adapt), known=PAPER)
    at = poles.numbers(case)
    A, load = math.hypot(20.0, real.M * real.g + 30.0), real.weight + 30.0
    assert float(at.AL.low) <= A * real.L * (1 + 1e-12)
    assert A * real.L * (1 - 1e-12) <= float(at.AL.high)
    assert float(at.load.low) == pytest.approx(load, rel=1e-12)
    its = gains if kind != "cop" else gains._replace(  # K_F and the CoP are the believed body's
        K_f=kf * PAPER.weight / real.weight)  # fmt: skip
    matrix = closed_loop_matrix(real, kind, its, A, load, adapt, PAPER if adapt < math.inf else None)
    sigma = -float(np.linalg.eigvals(matrix).real.max())
    assert poles.rate(case, at) == pytest.approx(sigma, rel=1e-5, abs=1e-5)
    if abs(sigma) > 1e-3:
        slower, faster = sorted([sigma - 1e-4 * abs(sigma) - 1e-5, sigma + 1e-4 * abs(sigma) + 1e-5])
        assert poles.decays(case, at, Fraction(slower))
        assert not poles.decays(case, at, Fraction(faster))


@pytest.mark.parametrize("law", ["cop", "adapts"])
@given(kp=st.floats(1000.0, 3500.0), kd=st.floats(300.0, 1200.0), kf=st.floats(0.05, 5.0))
@settings(deadline=None, max_examples=15)
def test_in_a_box_no_body_decays_slower_than_is_proved(law, kp, kd, kf):
    kind, adapt = LAWS[law]
    case = _case(PAPER, Gains(kp, kd, kf), WORLDS["ramp"](PAPER), BOX, kind, adapt=adapt)
    at = poles.numbers(case)
    corner = poles.rate(case, at)
    if corner <= 0:
        return
    proved = next((share for share in (0.95, 0.5, 0.0) if poles.decays(case, at, Fraction(share * corner))), None)
    rng = np.random.default_rng(1)
    for shares in rng.uniform(-1, 1, (20, 7)):
        real, world = case.at(dict(enumerate(shares)))
        one = replace(case, biped=real, scenario=world, radii=(0.0,) * 7)
        assert proved is None or poles.rate(one, poles.numbers(one)) >= proved * corner * (1 - 1e-9)


def test_without_rounding_the_papers_slope_has_one_A():
    size = exact.sizes(exact.body(PAPER, (0.0,) * 7), SLOPE.scenarios[0])
    assert size.low == size.high == Fraction(50) * Fraction("9.81")


@given(degrees=st.floats(-40.0, 40.0), share=st.floats(0.0, 1.0), off=st.floats(-1.0, 1.0))
@example(degrees=1e-309, share=0.5, off=1.0)
def test_the_range_of_the_load_holds_every_load_on_the_way(degrees, share, off):
    world = slope(PAPER, name="w", angle=math.radians(degrees), ramp=1.0, duration=2.0)
    case = _case(PAPER, CALM, world, BOX, "cop")
    real, its = case.at({0: off, 5: off})
    F = its.force_at(np.array([share * its.times[-1]]))[:, 0]
    load = poles.numbers(case).load
    assert float(load.low) <= real.weight - F[1] <= float(load.high)


@given(F_x=st.floats(-300.0, 300.0), F_y=st.floats(-200.0, 200.0), share=st.floats(0.0, 1.0))
def test_the_range_of_A_holds_every_A_on_the_way(F_x, F_y, share):
    world = constant_force(name="w", F_x=F_x, F_y=F_y, ramp=1.0, duration=2.0)
    size = exact.sizes(exact.body(PAPER, (1.0, 0, 0, 0, 0, 0, 0)), world)
    for mass in (49.0, 50.3, 51.0):
        A = math.hypot(mass * 9.81 - share * F_y, share * F_x)
        assert float(size.low) <= A * (1 + 1e-12)
        assert A * (1 - 1e-12) <= float(size.high)


def _norm(S, blocks, J):
    """The least rates and couplings of the blocks of S J S^-1, by numpy."""
    K, edges = S @ J @ np.linalg.inv(S), np.cumsum([0, *blocks])
    parts = [[K[a:b, c:d] for c, d in itertools.pairwise(edges)] for a, b in itertools.pairwise(edges)]
    rates = [-0.5 * np.linalg.eigvalsh(row[b] + row[b].T).max() for b, row in enumerate(parts)]
    couplings = [[0.0 if b == c else np.linalg.norm(part) for c, part in enumerate(row)] for b, row in enumerate(parts)]
    return Norm(S=S, blocks=blocks, rates=np.array(rates), couplings=np.array(couplings))


@pytest.mark.parametrize("blocks", [(3,), (1, 2), (2, 1), (1, 1, 1)])
@given(seed=st.integers(0, 1000))
@settings(deadline=None, max_examples=20)
def test_rates_and_couplings_claimed_by_a_hair_too_good_are_refused(blocks, seed):
    S, J = np.random.default_rng(seed).standard_normal((2, 3, 3))
    norm = _norm(S, blocks, J)
    more = 1e-9 * np.abs(np.linalg.inv(S)).max() * np.abs(S).max() * np.abs(J).max() * np.linalg.cond(S)
    assert holds(replace(norm, rates=norm.rates - more, couplings=norm.couplings + more), [J])
    for b in range(len(blocks)):
        faster = norm.rates - more
        faster[b] += 2 * more
        assert not holds(replace(norm, rates=faster, couplings=norm.couplings + more), [J])
        for c in range(len(blocks)):
            if b != c:
                looser = norm.couplings + more
                looser[b, c] = norm.couplings[b, c] - more
                assert not holds(replace(norm, rates=norm.rates - more, couplings=np.maximum(looser, 0.0)), [J])
    assert (np.abs(inverted(S)) >= np.abs(np.linalg.inv(S)) * (1 - 1e-9)).all()


@given(seed=st.integers(0, 1000), gain=st.floats(0.1, 1.5))
@settings(deadline=None)
def test_blocks_that_drive_each_other_have_a_limit_or_are_refused(seed, gain):
    K = np.random.default_rng(seed).random((1, 3, 3)) * np.array([1e-6, 1.0, 1e6])
    K = K / np.array([1e-6, 1.0, 1e6])[:, None]
    radius = np.abs(np.linalg.eigvals(K[0])).max()
    K *= gain / radius
    if gain > 1:
        with pytest.raises(NotProved, match="drive each other"):
            settled(K)
    elif gain < 0.99:
        truth = np.linalg.inv(np.eye(3) - K[0])
        assert (settled(K)[0] >= truth * (1 - 1e-12)).all()
        assert (settled(K)[0] <= truth * (1 + 1e-6 / (1 - gain) ** 2)).all()


@given(seed=st.integers(0, 1000), blocks=st.sampled_from([(3,), (1, 2), (1, 1, 1)]))
@settings(deadline=None)
def test_from_one_norm_to_another_no_error_is_lost(seed, blocks):
    rng = np.random.default_rng(seed)
    before, after = (
        _norm(S, b, -np.eye(3)) for S, b in zip(rng.standard_normal((2, 3, 3)), (blocks, (2, 1)), strict=True)
    )
    C = transfer(before, after)
    for x in rng.standard_normal((100, 3)):
        sizes = [np.sqrt(norm.members @ (norm.S @ x) ** 2) for norm in (before, after)]
        assert (sizes[1] <= C @ sizes[0] * (1 + 1e-12)).all()


LAWS_OF_JACOBIAN = {"pd": ("pd", math.inf), **LAWS}


@pytest.mark.parametrize("law", LAWS_OF_JACOBIAN)
def test_the_jacobian_is_that_of_the_loop_and_lies_in_the_hull_of_its_corners(law):
    kind, adapt = LAWS_OF_JACOBIAN[law]
    real = replace(PAPER, M=51.0, ell=0.098, I=7.2)
    case = replace(_case(real, CALM, WORLDS["step"](real), kind=kind, adapt=adapt), known=PAPER)
    theta, omega, s = -0.31, 0.4, -150.0
    alpha = math.radians(3)

    def rates(x):
        tau = CALM.K_p * ((x[3] if case.size > 3 else 0.0) - x[0]) - CALM.K_d * x[1]
        tau += CALM.K_f * x[2] if case.size > 2 else 0.0
        turning = (real.M * 9.81 * real.L * mpmath.sin(x[0] + alpha) + tau) / real.I
        load = real.M * (9.81 * math.cos(alpha) - real.L * (turning * mpmath.sin(x[0]) + x[1] ** 2 * mpmath.cos(x[0])))
        load += real.m * 9.81
        gathered = tau / real.ell * (PAPER.weight / load if kind == "cop" else 1)
        leaning = x[0] + (PAPER.ell * tau / real.ell - PAPER.I * turning) / (PAPER.M * 9.81 * PAPER.L)
        found = [x[1], turning, gathered, (leaning - x[3]) / adapt if case.size > 3 else 0]
        return found[: case.size], (tau, turning, load)

    x = [theta, omega, s, -0.28][: case.size]
    with mpmath.workdps(40):
        J = np.array([
            [float(mpmath.diff(lambda h, i=i, j=j: rates([y + h * (k == j) for k, y in enumerate(x)])[0][i], 0))
             for j in range(case.size)] for i in range(case.size)
        ])  # fmt: skip
        tau, turning, load = (float(each) for each in rates(x)[1])
    G = real.M * 9.81 * real.L * math.cos(theta + alpha)
    z = PAPER.weight * real.M * real.L * tau / (real.ell * load**2)
    numbers = {"force": (1 / real.ell, 0.0, 0.0), "adapts": (1 / real.ell, 0.0, 0.0), "pd": (0.0, 0.0, 0.0), "cop": (
        PAPER.weight / (real.ell * load) + z * math.sin(theta) / real.I,
        z * (G * math.sin(theta) / real.I + turning * math.cos(theta) - omega**2 * math.sin(theta)),
        2 * z * omega * math.cos(theta),
    )}[law]  # fmt: skip
    mine = np.array([[float(each) for each in row] for row in jacobian(case, G, 1 / real.I, *numbers)])
    assert mine == pytest.approx(J, rel=1e-9, abs=1e-9)


def test_a_ramp_of_uncertain_length_must_end_within_the_scenario():
    world = slope(PAPER, name="w", angle=math.radians(5), ramp=2.0, duration=2.0)
    with pytest.raises(NotProved, match="lengthen"):
        bounds(_case(PAPER, CALM, world, (0.0,) * 6 + (0.1,)))


@pytest.mark.parametrize("law", ["cop", "adapts"])
def test_the_papers_gains_keep_contact_under_the_other_laws(law):
    kind, adapt = LAWS[law]
    problem = replace(SLOPE, law=kind, adapt=adapt)
    proof = prove(problem, SLOPE.gains, "ramp")
    assert proof.answer == "proved"
    ran = second_opinion(PAPER, kind, 0.0, SLOPE.gains, SLOPE.scenarios[0], 1e-4, adapt)
    for row, force in (("heel-force", ran.F_H), ("toe-force", ran.F_T)):
        assert 0 <= force.min() - proof.value[row] < 0.01
    decay = min(row.value for row in stability_rows(problem, SLOPE.scenarios[0], SLOPE.gains) if row.id == "decay-rate")
    assert 0.99 * decay < proof.value["decay-rate"] <= decay * (1 + 1e-12)


@pytest.mark.parametrize("law", ["cop", "adapts"])
def test_a_box_is_proved_under_the_other_laws_for_a_law_that_knows_the_middle_only(law):
    kind, adapt = LAWS[law]
    world = WORLDS["ramp"](PAPER)
    tolerances = Tolerances(M=Spread(part=0.01), L=Spread(part=0.01), ell=Spread(part=0.01),
                            slope=Spread(absolute=math.radians(0.25)))  # fmt: skip
    problem = replace(SLOPE, scenarios=(world,), tolerances=tolerances, law=kind, adapt=adapt)
    proof = prove(problem, CALM, "w")
    assert proof.answer == "proved"
    for signs in itertools.product((-1.0, 1.0), repeat=4):
        body, its = tolerances.drawn(PAPER, world, [*signs[:2], 0.0, 0.0, signs[2], signs[3], 0.0])
        ran = second_opinion(body, kind, 0.0, CALM, its, 1e-3, adapt, known=PAPER)
        assert min(ran.F_T.min(), ran.F_H.min()) >= min(proof.value["toe-force"], proof.value["heel-force"])
        one = replace(_case(body, CALM, its, kind=kind, adapt=adapt), known=PAPER)
        assert poles.rate(one, poles.numbers(one)) >= proof.value["decay-rate"]


def test_where_the_load_may_vanish_law_cop_is_not_bounded():
    lifted = constant_force(name="w", F_x=0.0, F_y=495.0, ramp=1.0, duration=2.0)
    assert prove(replace(SLOPE, scenarios=(lifted,), law="cop"), CALM, "w").answer != "proved"
    with pytest.raises(NotProved, match="bear nothing"):
        bounds(_case(PAPER, Gains(3500.0, 1200.0, 0.0), lifted, kind="cop"))


def test_a_box_is_disproved_at_a_corner_that_another_integrator_confirms():
    world = slope(PAPER, name="w", angle=math.radians(6.5), ramp=0.0, duration=1.0)
    problem = replace(SLOPE, scenarios=(world,), tolerances=Tolerances(slope=Spread(absolute=math.radians(1.0))))
    for kind, adapt, degrees in (("force", math.inf, 6.5), ("cop", math.inf, 6.5), ("force", 0.2, 5.0)):
        world = slope(PAPER, name="w", angle=math.radians(degrees), ramp=0.0, duration=1.0)
        proof = prove(replace(problem, scenarios=(world,), law=kind, adapt=adapt), SLOPE.gains, "w", seconds=20.0)
        assert proof.answer == "disproved"
        worst = slope(PAPER, name="w", angle=proof.counterexample.at["slope"], ramp=0.0, duration=1.0)
        ran = second_opinion(PAPER, kind, 0.0, SLOPE.gains, worst, 1e-3, adapt)
        assert min(ran.F_T.min(), ran.F_H.min()) < 0
        assert proof.counterexample.at["slope"] > math.radians(degrees + 0.4)


@pytest.mark.parametrize("rates", [(2.6154, 11.19, 99.66), (0.002, 20.0, 200.0), (0.07, 3.0, 3.0), (5.0, 5.0, 5.0)])
@pytest.mark.parametrize("step", [1e-5, 1e-2])
def test_a_body_at_rest_on_level_ground_is_proved_to_bear_half_the_weight_on_each_end(rates, step):
    """By symmetry: nothing moves, whatever the poles are; of the loop -(M g L), p_2, p_1, p_0 give the gains."""
    p_2, p_1, p_0 = np.poly(-np.array(rates))[1:]
    lever = ADULT.M * ADULT.g * ADULT.L
    K_f = p_0 * ADULT.I * ADULT.ell / lever
    gains = Gains(p_1 * ADULT.I + lever, (p_2 + K_f / ADULT.ell) * ADULT.I, K_f)
    world = slope(ADULT, name="w", angle=0.0, ramp=1.36, duration=3.7)
    problem = replace(SLOPE, biped=ADULT, scenarios=(world,), step=step)
    proof = prove(problem, gains, "w")
    assert proof.answer == "proved", proof.why
    for end in ("toe-force", "heel-force"):
        assert proof.value[end] == pytest.approx(0.5 * (ADULT.M + ADULT.m) * ADULT.g, rel=1e-6)
        assert proof.value[end] <= 0.5 * (ADULT.M + ADULT.m) * ADULT.g
    assert proof.value["cop-margin"] == pytest.approx(ADULT.ell, rel=1e-6)
