"""Law force with a theta_d that follows the estimate: its linearisation, where it is stable, and what it buys."""

import math
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.analysis.recheck import second_opinion
from design.analysis.simulate import simulate
from design.analysis.transient import torque_rate
from design.analysis.verdict import judge
from design.model.actuator import Actuator
from design.model.body import Biped
from design.model.broken_loop import breaks
from design.model.closed_loop import closed_loop
from design.model.environment import constant_force, slope
from design.model.laws import AdaptingLaw, Gains, Measurement, law
from design.model.margins import loop_margins
from design.model.sampling import longest_period, sampled_matrix
from design.model.sensing import Sensors
from design.model.stability import characteristic, closed_loop_matrix, decay_rate, is_hurwitz, shortest_adaptation
from design.spec.load import load, parse
from design.spec.setting import setting
from problems.comparison.trial import World, run
from problems.gains import Grid, Question, solve
from problems.prediction import stationary

PAPER = Biped(M=50.0, L=0.75, I=7.03125, m=0.1, ell=0.1)
ADULT = Biped(M=70.0, L=0.95, I=4 / 3 * 70.0 * 0.95**2, m=2.0, ell=0.12)
BODIES = st.sampled_from([PAPER, ADULT])
GAINS = {PAPER: Gains(3500.0, 1200.0, 1.0), ADULT: Gains(2500.0, 900.0, 0.3)}
ADAPT = st.floats(0.02, 20.0)
FORCES = {"F_x": st.floats(-150.0, 150.0), "F_y": st.floats(-200.0, 200.0)}


def _at_rest(body, adapt, F):
    loop = closed_loop(body, "force", 0.0, adapt)
    theta = stationary(body, *F)[1]
    return loop, np.array([theta, 0.0, 0.0, theta])


@given(body=BODIES, adapt=ADAPT, **FORCES)
@settings(deadline=None)
def test_the_upright_posture_of_any_force_is_where_it_rests_with_nothing_left_in_the_integral(body, adapt, F_x, F_y):
    loop, z = _at_rest(body, adapt, (F_x, F_y))
    assert loop.rate(z, [F_x, F_y], GAINS[body]).full().ravel() == pytest.approx(np.zeros(4), abs=1e-12)


@given(body=BODIES, adapt=ADAPT, **FORCES)
@settings(max_examples=60, deadline=None)
def test_the_matrix_and_its_polynomial_are_the_jacobian_of_the_nonlinear_loop(body, adapt, F_x, F_y):
    loop, rest = _at_rest(body, adapt, (F_x, F_y))
    z, F, K = ca.SX.sym("z", 4), ca.SX.sym("F", 2), ca.SX.sym("K", 3)
    slope_of = ca.Function("J", [z, F, K], [ca.jacobian(loop.rate(z, F, K), z)])
    jacobian = slope_of(rest, [F_x, F_y], GAINS[body]).full()
    A, _ = stationary(body, F_x, F_y)
    matrix = closed_loop_matrix(body, "force", GAINS[body], A, body.weight - F_y, adapt)
    assert matrix == pytest.approx(jacobian, rel=1e-9, abs=1e-9)
    p = characteristic(body, "force", GAINS[body], A, body.weight, adapt)
    assert [1.0, *p] == pytest.approx(np.poly(matrix), rel=1e-6, abs=1e-6 * max(map(abs, p)))
    assert decay_rate(p) == pytest.approx(-np.linalg.eigvals(matrix).real.max(), rel=1e-4, abs=1e-6)


@given(BODIES, ADAPT)
@settings(deadline=None)
def test_on_a_slope_the_poles_are_the_old_ones_and_one_at_the_adaptation(body, adapt):
    A, K = body.M * body.g, GAINS[body]
    old = np.linalg.eigvals(closed_loop_matrix(body, "force", K, A, body.weight))
    new = np.poly(np.append(old, -1 / adapt)).real
    assert [1.0, *characteristic(body, "force", K, A, body.weight, adapt)] == pytest.approx(new, rel=1e-9)
    assert shortest_adaptation(body, K, A, adapt) == 0.0


@given(st.lists(st.floats(-30.0, 5.0), min_size=2, max_size=4), st.floats(0.1, 20.0), st.booleans())
def test_hurwitz_of_degree_four_is_the_sign_of_the_roots(real, imaginary, pair):
    roots = [*real[:2], complex(real[-1], imaginary), complex(real[-1], -imaginary)] if pair else (real * 2)[:4]
    largest = max(np.real(roots))
    if abs(largest) > 1e-2:
        assert is_hurwitz(np.poly(roots)[1:].real.tolist()) is bool(largest < 0)


WEAK = Gains(500.0, 100.0, 0.4)
"""Stable where an upward force makes the body lighter, and not at A = M g, which a fast adaptation comes down to."""


@pytest.mark.parametrize("F", [(0.0, 90.5), (40.0, 120.0)])
def test_just_inside_the_shortest_adaptation_the_loop_calms_down_and_just_outside_it_swings_up(F):
    A, theta_f = stationary(PAPER, *F)
    shortest = shortest_adaptation(PAPER, WEAK, A, 100.0)
    assert shortest > 0.01
    for adapt, calms in ((1.2 * shortest, True), (shortest / 1.2, False)):
        loop = closed_loop(PAPER, "force", theta_f, adapt)
        world = constant_force(name="pull", F_x=F[0], F_y=F[1], ramp=0.0, duration=60.0, theta0=theta_f + 1e-4)
        went = np.abs(simulate(loop, world, WEAK, 1e-3).theta - theta_f)
        assert bool(went[40_000:].max() < went[20_000:40_000].max()) is calms  # long after the start


def test_following_the_static_estimate_instead_would_need_a_long_time():
    """(16)-(17) in (15) say theta: theta_d' = (theta - theta_d)/T_a."""
    A = PAPER.M * PAPER.g
    K = GAINS[PAPER]

    def growth(adapt):
        torque = np.array([-K.K_p, -K.K_d, K.K_f, K.K_p])
        matrix = np.array(
            [
                [0.0, 1.0, 0.0, 0.0],
                torque / PAPER.I + np.array([A * PAPER.L / PAPER.I, 0.0, 0.0, 0.0]),
                torque / PAPER.ell,
                np.array([1.0, 0.0, 0.0, -1.0]) / adapt,
            ]
        )
        return np.linalg.eigvals(matrix).real.max()

    assert growth(0.05) > 0 > growth(5.0)


# ---- the loop broken


@pytest.mark.parametrize("A", [PAPER.M * PAPER.g, 600.0])
@pytest.mark.parametrize("adapt", [0.05, 0.5])
@pytest.mark.parametrize("at", ["actuator", "force", "angle"])
def test_a_broken_loop_is_what_passes_the_break(A, adapt, at):
    """The loop's signals at s = i omega, from the law as it is written, one of them cut and fed with 1."""
    K = GAINS[PAPER]
    broken = breaks(PAPER, "force", K, A, PAPER.weight, adapt)[at]
    b = PAPER.I / (PAPER.M * PAPER.g * PAPER.L * adapt)
    for omega in (0.3, 3.0, 20.0, 200.0):
        s = 1j * omega

        # unknown: e, tau, command, eta, integral; what the law reads is e_read and tau_read
        def loop(fed, s=s):
            rows = np.zeros((5, 5), dtype=complex)
            right = np.zeros(5, dtype=complex)
            e, tau, command, eta, integral = range(5)
            rows[0, [e, tau]] = PAPER.I * s**2 - A * PAPER.L, -1.0
            rows[1, [tau, command]] = (1.0, 0.0) if at == "actuator" else (1.0, -1.0)
            right[1] = fed if at == "actuator" else 0.0
            angle = np.zeros(5, dtype=complex)
            angle[e] = at != "angle"
            torque = np.zeros(5, dtype=complex)
            torque[tau] = at != "force"
            given_angle, given_torque = fed * (at == "angle"), fed * (at == "force")
            one = np.eye(5)
            # command = -(K_d s + K_p) e + K_p theta_d + K_f integral, theta_d = eta - b s e
            law_row = (
                one[command] - K.K_f * one[integral] - K.K_p * one[eta] + (K.K_d * s + K.K_p + K.K_p * b * s) * angle
            )
            rows[2], right[2] = law_row, -(K.K_d * s + K.K_p + K.K_p * b * s) * given_angle
            rows[3] = adapt * s * one[eta] + one[eta] - (1 + b * s) * angle - torque / (PAPER.M * PAPER.g * PAPER.L)
            right[3] = (1 + b * s) * given_angle + given_torque / (PAPER.M * PAPER.g * PAPER.L)
            rows[4], right[4] = PAPER.ell * s * one[integral] - torque, given_torque
            found = np.linalg.solve(rows, right)
            return {"actuator": found[command], "force": found[tau], "angle": found[e]}[at]

        assert -loop(1.0) == pytest.approx(broken.Q(s) / broken.P(s), rel=1e-8)


@pytest.mark.parametrize("adapt", [0.05, 1.0])
def test_the_longest_sampling_period_is_where_the_sampled_law_itself_leaves_the_unit_circle(adapt):
    A, K = PAPER.M * PAPER.g, GAINS[PAPER]
    period = longest_period(PAPER, "force", K, A, PAPER.weight, adapt)

    def through(T):
        """The controller that runs in a study, around the linear body that stands upright."""
        control = AdaptingLaw(biped=PAPER, gains=K, period=T, adapt=adapt)
        w = math.sqrt(A * PAPER.L / PAPER.I)
        c, sh = math.cosh(w * T), math.sinh(w * T)
        columns = []
        for theta, omega, s, eta, before in np.eye(5):
            load = PAPER.weight
            seen = Measurement(theta, omega, 0.5 * (load - before / PAPER.ell), 0.5 * (load + before / PAPER.ell))
            tau, (s, eta) = control(0.0, seen, (s, eta))
            push = tau / (A * PAPER.L)
            columns.append(
                [c * (theta + push) - push + sh / w * omega, w * sh * (theta + push) + c * omega, s, eta, tau]
            )
        return np.array(columns).T

    assert sampled_matrix(PAPER, "force", K, A, PAPER.weight, 0.01, adapt) == pytest.approx(through(0.01), abs=1e-9)
    radii = [np.abs(np.linalg.eigvals(through(factor * period))).max() for factor in (0.99, 1.01)]
    assert radii[0] < 1 < radii[1]
    assert loop_margins(PAPER, "force", K, A, PAPER.weight, adapt).delay > 0


@pytest.mark.parametrize(("inertia", "F"), [(9.0, (0.0, 0.0)), (5.5, (30.0, 60.0))])
def test_a_law_that_knows_another_body_is_linearised_as_it_runs(inertia, F):
    real = replace(PAPER, I=inertia, M=52.0, ell=0.11)
    loop = closed_loop(real, "force", 0.0, 0.1, PAPER)
    A, theta_f = stationary(real, *F)
    z, K = ca.SX.sym("z", 4), ca.DM(GAINS[PAPER])
    jacobian = ca.Function("J", [z], [ca.jacobian(loop.rate(z, ca.DM(F), K), z)])([theta_f, 0.0, 0.0, theta_f]).full()
    found = closed_loop_matrix(real, "force", GAINS[PAPER], A, real.weight, 0.1, PAPER)
    assert found == pytest.approx(jacobian, rel=1e-9, abs=1e-9)


# ---- runs


def _spec(name, adapt):
    text = load(name).text
    return setting(parse(text.replace("[law]", f"[law]\nadapt_s = {adapt}", 1), origin=name).spec)


@pytest.mark.parametrize("name", ["slope", "wind", "train", "slope-step"])
def test_an_integrator_that_shares_nothing_finds_the_same_run(name):
    problem = _spec(name, 0.2)
    scenario = problem.scenarios[0]
    mine = simulate(problem.loop(), scenario, problem.gains, problem.step)
    other = second_opinion(
        problem.biped, "force", problem.theta_d, problem.gains, scenario, problem.step, problem.adapt
    )
    assert mine.F_T == pytest.approx(other.F_T, abs=5e-3)
    assert mine.F_H == pytest.approx(other.F_H, abs=5e-3)
    rate = torque_rate(problem.loop(), problem.gains, mine)
    smooth = slice(200, 900)
    assert rate[smooth] == pytest.approx(np.gradient(mine.tau, mine.t)[smooth], abs=0.2)


def test_on_the_ramp_it_keeps_several_times_the_contact_force_and_on_a_sudden_slope_less():
    def least(name, adapt):
        problem = _spec(name, adapt) if adapt else setting(load(name).spec)
        ran = simulate(problem.loop(), problem.scenarios[0], problem.gains, problem.step)
        return min(ran.F_T.min(), ran.F_H.min())

    assert least("slope", 0.1) > 4 * least("slope", None)
    assert 0 < least("slope-step", 0.1) < least("slope-step", None)


def test_the_report_has_its_rows():
    rows = {row.id: row for row in judge(_spec("wind", 0.5), Gains(3500.0, 1200.0, 1.0), "all").rows}
    assert rows["adapt-time"].status == "met"
    assert rows["adapt-time"].value == 0.5
    assert rows["decay-rate"].value == pytest.approx(1.4, abs=0.1)
    assert rows["slope-rate"].status == "undecided"
    assert rows["delay-margin"].value > 0
    lifted = setting(parse(_lifted(), origin="lifted").spec)
    slow = {row.id: row for row in judge(lifted, WEAK).rows}["adapt-time"]
    assert slow.status == "violated"
    assert slow.required > slow.value
    slower = replace(lifted, adapt=1.05 * slow.required)
    assert {row.id: row for row in judge(slower, WEAK).rows}["adapt-time"].status == "met"


def _lifted():
    text = load("slope-step").text.replace("[law]", "[law]\nadapt_s = 0.02", 1)
    begin, end = text.index("[[scenarios]]"), text.index("[law]")
    world = '[[scenarios]]\nname = "lift"\nkind = "force"\nfx_n = 0.0\nfy_n = 90.5\nduration_s = 5.0\n\n'
    return text[:begin] + world + text[end:]


@given(
    seen=st.builds(
        Measurement, st.floats(-0.7, 0.7), st.floats(-5.0, 5.0), st.floats(1.0, 900.0), st.floats(1.0, 900.0)
    ),
    memory=st.tuples(st.floats(-50.0, 50.0), st.floats(-0.5, 0.5)),
)
@settings(deadline=None)
def test_the_sampled_law_is_the_continuous_one_read_once_a_period(seen, memory):
    control = AdaptingLaw(biped=PAPER, gains=GAINS[PAPER], period=0.002, adapt=0.3)
    continuous = law("force", PAPER, 0.0, 0.3)
    tau, after = control(0.4, seen, memory)
    assert control(0.4, seen, memory) == (tau, after)
    x = [seen.theta, seen.omega]
    assert tau == pytest.approx(float(continuous.torque(x, memory, GAINS[PAPER])), rel=1e-12, abs=1e-9)
    gathered = continuous.memory_rate(x, memory, [seen.F_T, seen.F_H]).full().ravel()
    assert np.array(after) - memory == pytest.approx(0.002 * gathered, rel=1e-9, abs=1e-9)
    first, (_, eta) = control(0.0, seen, control.start())
    assert first == pytest.approx(-1200.0 * seen.omega - 3500.0 * seen.theta)
    assert eta is not None


def test_the_sampled_law_comes_to_the_continuous_one_as_the_period_shrinks():
    scenario = slope(PAPER, name="ramp", angle=math.radians(10), ramp=2.0, duration=4.0)
    exact = simulate(closed_loop(PAPER, "force", 0.0, 0.3), scenario, GAINS[PAPER], 1e-3)
    errors = []
    for period in (4e-3, 1e-3):
        control = AdaptingLaw(biped=PAPER, gains=GAINS[PAPER], period=period, adapt=0.3)
        ended = run(World(biped=PAPER, scenario=scenario, sensors=Sensors(), draws=None), control,
                    Actuator(period=period), 1e-3)  # fmt: skip
        errors.append(abs(ended.states[0, -1] - exact.theta[-1]))
    assert errors[1] < 0.4 * errors[0] < 1e-3


# ---- synthesis


def test_the_states_are_differentiated_exactly():
    problem = replace(_spec("slope", 0.3), step=0.01)
    question = Question(problem)
    motion = Grid(question, 0.01, question.goal("contact-force")).whole[0]
    states = motion.states((50, 300, 501))
    K = ca.MX.sym("K", 3)
    weights = ca.DM(np.random.default_rng(0).standard_normal((4, 3)))
    value = ca.dot(states(K), weights)
    first = ca.Function("first", [K], [ca.gradient(value, K)])
    plain, second = ca.Function("plain", [K], [value]), ca.Function("second", [K], [ca.hessian(value, K)[0]])
    at = np.array([3000.0, 900.0, 5.0])
    for k in range(3):
        h = 1e-4 * at[k] * np.eye(3)[k]
        assert float(plain(at + h) - plain(at - h)) / (2 * h[k]) == pytest.approx(float(first(at)[k]), rel=1e-5)
        bent = (first(at + h) - first(at - h)).full().ravel() / (2 * h[k])
        assert bent == pytest.approx(second(at).full()[k], rel=1e-4, abs=1e-12)


@pytest.mark.parametrize("goal", ["contact-force", "decay-rate"])
def test_synthesis_finds_gains_that_no_neighbour_betters(goal):
    problem = replace(_spec("slope", 0.3), objective=goal, step=0.005)
    answer = solve(problem, starts=2)
    best = answer.outcome.value
    question = Question(problem)
    rng = np.random.default_rng(0)
    for _ in range(30):
        K = np.clip(
            np.array(best.gains) + 0.02 * question.scale * rng.standard_normal(3), question.lower, question.upper
        )
        verdict = judge(problem, Gains(*K))
        if verdict.overall == "met":
            assert question.score(question.goal(goal), Gains(*K), verdict) <= best.value * (1 + 1e-6)


# ---- bad input


@pytest.mark.parametrize("kind", ["pd", "cop"])
def test_another_law_does_not_adapt(kind):
    text = (
        load("slope").text.replace('kind = "force" ', f'kind = "{kind}" ', 1).replace("[law]", "[law]\nadapt_s = 1", 1)
    )
    with pytest.raises(Exception, match="adapt_s"):
        parse(text, origin="mine.toml")
    with pytest.raises(ValueError, match="does not adapt"):
        law(kind, PAPER, 0.0, 1.0)
    assert _spec("slope", 0.3).with_law(kind).adapt == math.inf
