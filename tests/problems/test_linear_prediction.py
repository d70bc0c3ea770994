"""The linear prediction: LQR where nothing binds, the QP that other solvers solve, and a plan that can be continued."""

import math
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from design.analysis.observer import Belief
from design.model.actuator import Actuator
from design.model.body import Biped
from design.model.limits import Required
from design.model.plant import plant
from design.model.tuning import Tuning
from design.solvers.outcome import Status
from problems.linear_rows import linearised
from problems.mpc_linear import LinearPlanner
from problems.prediction import PENALTY, horizon, posture, stationary

PAPER = Biped(M=50.0, L=0.75, I=7.03125, m=0.1, ell=0.1)
CONTACT = {"contact-force": Required(level=0.0)}
TUNING = Tuning()
GRAVITY = PAPER.M * PAPER.g


def _slope(degrees):
    angle = math.radians(degrees)
    return GRAVITY * math.sin(angle), GRAVITY * (1 - math.cos(angle))


def _planner(tuning=TUNING, actuator=None, required=CONTACT, **options):
    return LinearPlanner(horizon=horizon(PAPER, tuning, actuator or Actuator(period=0.02), required), **options)


def _plan(planner, belief, before=0.0):
    outcome = planner.plan(0.0, belief, before, None)
    assert outcome.status is Status.SOLVED, outcome.detail
    return outcome.value


# ---- LQR


def _riccati_by_iteration(model, count):
    """The gain of LQR over ``count`` steps, backward, from the definition."""
    P = model.Q
    for _ in range(count):
        K = (model.Bd @ P @ model.Ad) / (model.R + model.Bd @ P @ model.Bd)
        P = model.Q + model.Ad.T @ P @ (model.Ad - np.outer(model.Bd, K))
    return K


def test_the_gain_is_that_of_an_unbounded_horizon():
    model = posture(PAPER, TUNING, GRAVITY)
    assert model.K == pytest.approx(_riccati_by_iteration(model, 5000), rel=1e-9)


@given(st.integers(2, 60), st.floats(-0.003, 0.003), st.floats(-0.02, 0.02))
@settings(max_examples=25, deadline=None)
@example(24, 0.0, 0.0)  # where Clarabel once stopped 7e-6 N m away
@example(2, -0.00065, 0.016)
@example(8, 0.0015, -0.017)
@example(30, -0.0027, 0.0063)
def test_without_active_limits_the_qp_is_lqr_whatever_the_horizon(count, e, omega):
    tuning = replace(TUNING, horizon=count)
    F = _slope(4.0)
    A, theta_f = stationary(PAPER, *F)
    belief = Belief(theta_f + e, omega, *F)
    solved = _plan(_planner(tuning, shortcut=False), belief)
    model = _model_used(tuning, A)
    expected = -model.K @ [e, omega]
    assert solved.torque[0] == pytest.approx(expected, abs=1e-6 * (abs(expected) + 1.0))
    assert _plan(_planner(tuning), belief).torque == pytest.approx(solved.torque, abs=1e-4)


def _model_used(tuning, A):
    """The model on the grid of sizes that the planner takes."""
    steps = round(math.log(A / PAPER.weight) / 0.005)
    return posture(PAPER, tuning, PAPER.weight * math.exp(0.005 * steps))


# ---- the same program, written without flat coordinates, for other solvers


def _dense(planner, belief, before):
    """The program over (tau, x_1 .. x_N, sigma) from the statement of ``problems.prediction``: P, q, G, h, E, f."""
    ahead = planner.horizon
    tuning, N = ahead.tuning, ahead.tuning.horizon
    F = np.array([belief.F_x, belief.F_y])
    A, theta_f = stationary(PAPER, *F)
    model = _model_used(tuning, A)
    n = N + 2 * (N + 1) + 1
    at_x = lambda k: slice(N + 2 * k, N + 2 * k + 2)  # noqa: E731
    P = np.zeros((n, n))
    for k in range(N):
        P[at_x(k), at_x(k)] = 2 * model.Q
        P[k, k] = 2 * model.R
    P[at_x(N), at_x(N)] = 2 * model.P
    q = np.zeros(n)
    q[-1] = PENALTY
    E = np.zeros((2 * (N + 1), n))
    f = np.zeros(2 * (N + 1))
    E[:2, at_x(0)], f[:2] = np.eye(2), [belief.theta - theta_f, belief.omega]
    for k in range(N):
        rows = slice(2 * k + 2, 2 * k + 4)
        E[rows, at_x(k + 1)], E[rows, at_x(k)], E[rows, k] = np.eye(2), -model.Ad, -model.Bd

    # F_T and F_H of (5)-(7), about (theta_f, 0) without torque, and at the first step about the state itself
    def slopes(theta, omega, tau):
        step = 1e-6
        forces = lambda th, om, ta: plant(PAPER).forces([th, om], ta, F).full().ravel()  # noqa: E731
        base = forces(theta, omega, tau)
        return base, np.column_stack(
            [
                (forces(theta + step, omega, tau) - forces(theta - step, omega, tau)) / (2 * step),
                (forces(theta, omega + step, tau) - forces(theta, omega - step, tau)) / (2 * step),
                (forces(theta, omega, tau + 1) - forces(theta, omega, tau - 1)) / 2,
            ]
        )

    level = tuning.contact * PAPER.weight
    G, h = [], []

    def keep(base, slope, point_rows, offset, factors=(1.0, 1.0)):
        """base + slope (point - offset) >= level - weight sigma/factor."""
        for j in range(2):
            row = -slope[j] @ point_rows
            row[-1] -= PAPER.weight / factors[j]
            G.append(row)
            h.append(base[j] - slope[j] @ offset - level)

    def rows_of(k):
        rows = np.zeros((3, n))
        rows[:2, at_x(k)] = np.eye(2)
        if k < N:
            rows[2, k] = 1.0
        return rows

    now = slopes(belief.theta, belief.omega, before)
    there = slopes(theta_f, 0.0, 0.0)
    factors = there[1][:, 2] / now[1][:, 2]  # sigma counts in the first rows by the others' slope in the torque
    keep(*now, rows_of(0), np.array([belief.theta - theta_f, belief.omega, before]), factors)
    for k in range(1, N):
        keep(*there, rows_of(k), np.zeros(3))
    xi = np.zeros(n)
    xi[at_x(N)] = [1.0, 1.0 / model.Omega]
    last = rows_of(N)
    last[2] = -model.AL * xi
    keep(*there, last, np.zeros(3))
    keep(*there, np.array([xi, 0 * xi, -model.AL * xi]), np.zeros(3))
    torque, change, actuator = np.eye(N, n), np.eye(N, n) - np.eye(N, n, -1), ahead.actuator
    change[:, N:] = 0.0
    for rows, first, other, offset in (
        (torque, actuator.torque, actuator.torque, 0.0),
        (change, actuator.rate * actuator.period, actuator.rate * tuning.step, before),
    ):
        for k in range(N):
            most = first if k == 0 else other
            if math.isfinite(most):
                G += [rows[k], -rows[k]]
                h += [most + (offset if k == 0 else 0.0), most - (offset if k == 0 else 0.0)]
    hold = -model.AL * xi
    size = PAPER.weight * PAPER.ell
    for row, most in ((hold, actuator.torque), (hold - np.eye(N, n)[N - 1], actuator.rate * tuning.step)):
        if math.isfinite(most):
            for sign in (1.0, -1.0):
                G.append(sign * row)
                G[-1][-1] -= size
                h.append(most)
    return P, q, np.array(G), np.array(h), E, f


CASES = {
    "contact binds": (Belief(0.0, 0.0, *_slope(6.0)), 0.0, Actuator(period=0.02)),
    "moving": (Belief(0.02, -0.3, *_slope(3.0)), 5.0, Actuator(period=0.02)),
    "torque binds": (Belief(0.01, 0.0, *_slope(2.0)), 0.0, Actuator(period=0.02, torque=25.0)),
    "torque rate binds": (Belief(0.0, 0.1, *_slope(1.0)), 3.0, Actuator(period=0.005, torque=40.0, rate=400.0)),
    "beyond rescue": (Belief(0.0, 0.0, *_slope(9.0)), 0.0, Actuator(period=0.02)),
}


OTHERS = {
    "qpoases": {"printLevel": "none", "nWSR": 10000},
    "osqp": {"osqp": {"verbose": False, "eps_abs": 1e-10, "eps_rel": 1e-10, "max_iter": 200000, "polish": True}},
}
NEAR = {"qpoases": 2e-3, "osqp": 2e-2}  # [N m]; OSQP is a first-order method


@pytest.mark.parametrize("solver", OTHERS)
@pytest.mark.parametrize("case", CASES)
def test_two_other_solvers_find_the_same_plan(case, solver):
    belief, before, actuator = CASES[case]
    planner = _planner(replace(TUNING, horizon=25), actuator=actuator, shortcut=False)
    P, q, G, h, E, f = _dense(planner, belief, before)
    # scaled by hand: torques in units of the weight's lever, and states eliminated by nobody
    unit = np.ones(len(q))
    unit[:25] = PAPER.weight * PAPER.ell
    A = np.vstack([G, E]) * unit
    size = np.abs(A).max(axis=1)
    lower, upper = np.concatenate([np.full(len(h), -np.inf), f]) / size, np.concatenate([h, f]) / size
    H = P * np.outer(unit, unit)
    options = OTHERS[solver]
    conic = ca.conic("qp", solver, {"h": ca.DM(H).sparsity(), "a": ca.DM(A / size[:, None]).sparsity()}, options)
    bounds = np.full(len(q), -np.inf)
    bounds[-1] = 0.0
    found = conic(h=H, g=q * unit, a=A / size[:, None], lba=lower, uba=upper, lbx=bounds, ubx=np.inf)
    assert conic.stats()["success"]
    x = found["x"].full().ravel() * unit
    plan = _plan(planner, belief, before)
    assert plan.torque == pytest.approx(x[:25], abs=NEAR[solver])
    value = 0.5 * x @ P @ x + q @ x
    theta_f = stationary(PAPER, belief.F_x, belief.F_y)[1]
    ours = np.concatenate([plan.torque, (plan.states - [[theta_f], [0]]).T.ravel()])
    assert 0.5 * ours @ P[:-1, :-1] @ ours + PENALTY * x[-1] == pytest.approx(value, rel=1e-5, abs=1e-9)
    assert (x[-1] > 1e-3) == (case == "beyond rescue")


# ---- limits


@pytest.mark.slow
@given(st.floats(-8.0, 8.0), st.floats(-0.3, 0.3), st.floats(-0.6, 0.6), st.sampled_from(["ankle", "limited", "wish"]))
@settings(max_examples=150, deadline=None)
@example(6.5, -0.113, 0.0, "ankle")
@example(0.0, 0.05, -0.2, "limited")
@example(7.6, -0.132, 0.0, "ankle")
@example(3.0, 0.1, 0.3, "wish")
def test_a_part_continued_by_lqr_is_taken_only_where_it_is_the_optimum_of_the_whole(degrees, theta, omega, kind):
    actuator = Actuator(period=0.02, torque=30.0, rate=600.0) if kind == "limited" else None
    required = {**CONTACT, "cop-margin": Required(level=0.03)} if kind == "wish" else CONTACT
    belief = Belief(theta, omega, *_slope(degrees))
    quick = _planner(actuator=actuator, required=required).plan(0.0, belief, 0.0, None)
    whole = _planner(actuator=actuator, required=required, shortcut=False).plan(0.0, belief, 0.0, None)
    assert quick.status is whole.status
    if quick.status is Status.SOLVED:
        assert quick.value.torque == pytest.approx(whole.value.torque, abs=2e-3)
        assert quick.value.states == pytest.approx(whole.value.states, abs=1e-5)


@pytest.mark.parametrize(
    ("degrees", "way"),
    [(0.5, "LQR's response keeps every limit"), (6.5, "Clarabel: Solved, then LQR"), (9.0, "Clarabel: Solved")],
)
def test_from_rest_the_slope_says_how_much_must_be_solved(degrees, way):
    assert _planner().plan(0.0, Belief(0.0, 0.0, *_slope(degrees)), 0.0, None).detail == way


@given(st.floats(-8.0, 8.0), st.floats(-0.15, 0.15), st.floats(-0.6, 0.6), st.floats(-30.0, 30.0))
@settings(max_examples=100, deadline=None)
def test_lqr_s_response_counts_as_kept_where_no_limit_of_it_is_broken(degrees, theta, omega, before):
    required = {**CONTACT, "cop-margin": Required(level=0.03)}
    ahead = horizon(PAPER, TUNING, Actuator(period=0.02), required)
    F = _slope(degrees)
    A, theta_f = stationary(PAPER, *F)
    model = _model_used(TUNING, A)
    response = np.column_stack([np.ravel(_lqr_from(model, unit)) for unit in np.eye(2)])
    points = _lqr_from(model, np.array([theta - theta_f, omega]))
    found = linearised(ahead, TUNING.horizon)([theta_f, theta, omega, before, *F, 0.0], response)
    slopes, levels, first, places, kept = (each.full() for each in found)
    assert places.T == pytest.approx(points, abs=1e-9)
    margins = np.array([_scaled(ahead, [theta_f, 0.0], 0.0, F)] * TUNING.horizon)
    assert levels.ravel() == pytest.approx(margins[0], abs=1e-12)
    margins += points @ slopes
    now = _scaled(ahead, [theta, omega], points[0][2], F)
    by_row = first.T @ [*points[0], 1.0]
    assert (np.sign(by_row[:2]) == np.sign(now[:2])).all() or np.abs(now).min() < 1e-9
    margins[0] = by_row
    if np.abs(margins).min() > 1e-9:
        assert bool(kept[0, 0]) == bool((margins >= 0).all())


def _lqr_from(model, x):
    """What LQR leads to from ``x``: e, omega and tau (N, 3)."""
    points = []
    for _ in range(TUNING.horizon):
        points.append([*x, -model.K @ x])
        x = model.Ad @ x + model.Bd * points[-1][2]
    return np.array(points)


def _scaled(ahead, x, tau, F):
    """Each limit's margin by its scale, by the full model."""
    return np.concatenate(
        [
            ca.DM(limit.margin(limit.quantity(ca.DM(x), tau, ca.DM(F)), level) / limit.scale).full().ravel()
            for limit, level in ahead.rows
        ]
    )


@pytest.mark.parametrize("nothing", range(6))
def test_a_response_that_is_no_number_is_not_kept(nothing):
    ahead = horizon(PAPER, TUNING, Actuator(period=0.02), CONTACT)
    now = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    response = np.zeros((6, 2))
    assert linearised(ahead, 2)(now, response)[4] == 1
    now[nothing] = math.nan
    assert linearised(ahead, 2)(now, response)[4] == 0


@given(st.floats(-7.0, 7.0), st.floats(-0.01, 0.01), st.floats(-0.1, 0.1))
@settings(max_examples=60, deadline=None)
def test_the_first_torque_keeps_contact_by_the_full_model_wherever_that_is_possible(degrees, theta, omega):
    F = _slope(degrees)
    plan = _plan(_planner(), Belief(theta, omega, *F))
    forces = plant(PAPER).forces([theta, omega], plan.torque[0], F).full().ravel()
    rest = plant(PAPER).forces([theta, omega], 0.0, F).full().ravel()
    if rest.min() > 0.01 * PAPER.weight and _capturable(theta, omega, F, share=0.9):
        assert forces.min() >= 0.01 * PAPER.weight - 1e-3


def _capturable(theta, omega, F, share=1.0):
    A, theta_f = stationary(PAPER, *F)
    AL = A * PAPER.L
    xi = theta - theta_f + omega / math.sqrt(AL / PAPER.I)
    return abs(xi) <= share * PAPER.ell * PAPER.weight / AL


def test_the_torque_limits_of_the_actuator_are_kept_at_every_step_of_the_plan():
    actuator = Actuator(period=0.005, torque=30.0, rate=300.0)
    plan = _plan(_planner(actuator=actuator), Belief(0.0, 0.2, *_slope(2.0)), 10.0)
    assert np.abs(plan.torque).max() <= 30.0 + 1e-4
    assert abs(plan.torque[0] - 10.0) <= 300.0 * 0.005 + 1e-4
    assert np.abs(np.diff(plan.torque)).max() <= 300.0 * 0.02 + 1e-4
    assert np.abs(plan.torque).max() > 29.0  # they bind


@pytest.mark.parametrize("degrees", [5.0, 6.5, 7.2])
@pytest.mark.parametrize("actuator", [Actuator(period=0.02), Actuator(period=0.02, torque=48.0, rate=900.0)])
def test_a_plan_can_be_continued_for_ever_by_the_model_it_was_made_with(degrees, actuator):
    """Recursive feasibility: from one plan that breaks nothing, every later one breaks nothing either."""
    planner = _planner(
        actuator=actuator, required={"contact-force": Required(level=0.0), "torque": Required(level=48.0)}
    )
    F = _slope(degrees)
    A, theta_f = stationary(PAPER, *F)
    model = _model_used(TUNING, A)
    x, before = np.array([-theta_f, 0.0]), 0.0
    if math.isfinite(actuator.rate):
        before = -0.8 * model.AL * x[0]
        x *= 0.8
    for _ in range(120):
        plan = _plan(planner, Belief(theta_f + x[0], x[1], *F), before)
        worst = _worst_row(planner, plan, F, theta_f)
        assert worst >= 0.01 * PAPER.weight - 0.02, worst
        before = plan.torque[0]
        x = model.Ad @ x + model.Bd * before
    assert np.abs(x).max() < 1e-3


def _worst_row(planner, plan, F, theta_f):
    """The smallest linearised contact force of the plan after its first step."""
    step = 1e-6
    forces = lambda th, ta: plant(PAPER).forces([th, 0.0], ta, F).full().ravel()  # noqa: E731
    base = forces(theta_f, 0.0)
    d_theta = (forces(theta_f + step, 0.0) - base) / step
    d_tau = forces(theta_f, 1.0) - base
    e = plan.states[0, 1:-1] - theta_f
    return (base[:, None] + np.outer(d_theta, e) + np.outer(d_tau, plan.torque[1:])).min()


def test_a_force_foreseen_to_stay_gives_the_plan_of_one_that_is_held():
    F = _slope(5.0)
    held = _plan(_planner(), Belief(0.01, -0.05, *F))
    ahead = np.tile(np.array(F)[:, None], TUNING.horizon + 1)
    foreseen = _plan(_planner(), Belief(0.01, -0.05, *F, ahead))
    assert foreseen.torque == pytest.approx(held.torque, abs=1e-3)


def test_a_force_that_is_foreseen_is_met_before_it_comes():
    later = np.zeros((2, TUNING.horizon + 1))
    later[:, 10:] = np.array(_slope(3.0))[:, None]
    plan = _plan(_planner(), Belief(0.0, 0.0, 0.0, 0.0, later))
    assert plan.states[0, 9] < -1e-3  # leaning to where the slope will ask it to be
    assert _plan(_planner(), Belief(0.0, 0.0, 0.0, 0.0)).states[0, 9] == pytest.approx(0.0, abs=1e-9)


@given(
    st.floats(-1.5, 1.5), st.floats(-20.0, 20.0), st.floats(-5e3, 5e3), st.floats(-5e3, 5e3), st.floats(-200.0, 200.0)
)
@settings(max_examples=60, deadline=None)
def test_whatever_is_believed_a_solved_plan_is_finite(theta, omega, F_x, F_y, before):
    outcome = _planner().plan(0.0, Belief(theta, omega, F_x, F_y), before, None)
    if outcome.status is Status.SOLVED:
        assert np.isfinite(outcome.value.torque).all()
