"""Predictive control of a foot whose levers are unequal: it ends with the CoP at its target, and knows both ends."""

import math
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from design.analysis.observer import Belief
from design.model.actuator import Actuator
from design.model.laws import Measurement
from design.model.plant import plant
from design.model.standing import standing
from design.model.tuning import Tuning
from design.solvers.outcome import Status
from design.spec.load import load
from design.spec.setting import setting
from problems.comparison.controllers import actuator, controller
from problems.comparison.measures import final_posture
from problems.comparison.trial import World, run
from problems.linear_rows import linearised
from problems.mpc_linear import LinearPlanner
from problems.mpc_nonlinear import planner as nonlinear
from problems.prediction import horizon, posture, resting

FEET = setting(load("adult-foot").spec)
BIPED, TARGET = FEET.biped, FEET.target
ANKLE = Actuator(period=0.02)
TUNING = Tuning(horizon=30)
AHEAD = horizon(BIPED, TUNING, ANKLE, {}, TARGET)
FORCES = [(0.0, 0.0), (60.0, 3.0), (-25.0, 10.0)]


def planners(ahead=AHEAD):
    return {
        "linear": LinearPlanner(horizon=ahead),
        "linear, whole": LinearPlanner(horizon=ahead, shortcut=False),
        "nonlinear": nonlinear(ahead),
    }


def planned(made, belief, before):
    outcome = made.plan(0.0, belief, before, None)
    assert outcome.status is Status.SOLVED, outcome.detail
    return outcome.value


@pytest.mark.parametrize("force", FORCES)
def test_where_the_cop_is_at_its_target_nothing_is_to_be_done(force):
    rest = standing(BIPED, np.array(force)[:, None], TARGET)
    theta, tau = float(rest.theta[0]), float(rest.tau[0])
    assert resting(AHEAD, *force) == pytest.approx((rest.A[0], theta, tau))
    assert float(plant(BIPED).cop([theta, 0.0], tau, force)) == pytest.approx(TARGET)
    for name, made in planners().items():
        plan = planned(made, Belief(theta, 0.0, *force), tau)
        assert plan.torque == pytest.approx(np.full(30, tau), abs=1e-3), name
        assert plan.states[0] == pytest.approx(np.full(31, theta), abs=1e-5), name


@pytest.mark.parametrize("force", FORCES)
def test_near_it_the_first_torque_is_that_of_lqr_about_it(force):
    A, theta, tau = resting(AHEAD, *force)
    x = np.array([0.002, -0.005])
    expected = tau - posture(BIPED, TUNING, A).K @ x
    for name, made in planners().items():
        plan = planned(made, Belief(theta + x[0], x[1], *force), tau)
        assert plan.torque[0] == pytest.approx(expected, abs=0.01 * abs(expected - tau) + 1e-3), name


@pytest.mark.parametrize("force", FORCES)
def test_margins_of_linear_rows_count_torques_from_the_one_at_rest(force):
    _, theta, tau = resting(AHEAD, *force)
    rows, here, before = linearised(AHEAD, 2), [theta + 0.01, -0.05], tau + 4.0
    slopes, levels, first, points, kept = (
        each.full() for each in rows([theta, *here, before, *force, tau], np.tile(np.eye(3, 2), (2, 1)))
    )
    assert points[:, 0] == pytest.approx([0.01, -0.05, 0.0])

    def margins(x, torque):
        found = [
            limit.margin(limit.quantity(ca.DM(x), torque, ca.DM(force)), level) / limit.scale
            for limit, level in AHEAD.rows
        ]
        return np.concatenate([ca.DM(each).full().ravel() for each in found])

    assert levels.ravel() == pytest.approx(margins([theta, 0.0], tau))
    step = 1e-5
    near = [theta + step * 0.3, step * 0.7], tau + step * 20.0
    assert levels.ravel() + step * slopes.T @ [0.3, 0.7, 20.0] == pytest.approx(margins(*near), abs=1e-8)
    own = margins(here, before + 3.0)  # the first step's rows have the sign of the model's own margins, exactly
    by_row = first.T @ [0.01, -0.05, before + 3.0 - tau, 1.0]
    assert (by_row / own > 0).all()
    assert (by_row / own == pytest.approx(1.0, rel=0.2)) and (kept == 1) == bool(
        (levels.ravel() + slopes.T @ points[:, 1] >= 0).all() and (first.T @ [*points[:, 0], 1.0] >= 0).all()
    )


@pytest.mark.parametrize("state", [(0.06, 0.25), (-0.02, -0.10)], ids=["to the long end", "to the short end"])
def test_where_the_foot_binds_a_plan_keeps_both_ends_down(state):
    """The nonlinear plan all along; the linear one in its first step, in which its rows are exact."""
    for name, made in planners().items():
        plan = planned(made, Belief(*state, 0.0, 0.0), 0.0)
        forces = [
            plant(BIPED).forces(plan.states[:, k], plan.torque[k], [0.0, 0.0]).full().min()
            for k in range(30 if name == "nonlinear" else 1)
        ]
        assert min(forces) > 0, name


def test_a_torque_limit_counts_from_zero_and_not_from_the_torque_at_rest():
    weak = horizon(BIPED, TUNING, Actuator(period=0.02, torque=25.0), {}, TARGET)
    force = (60.0, 3.0)
    _, theta, tau = resting(weak, *force)
    assert abs(tau) > 10.0
    for sign in (1, -1):
        for name, made in planners(weak).items():
            plan = planned(made, Belief(theta + sign * 0.012, 0.0, *force), tau)
            assert np.abs(plan.torque).max() <= 25.0 + 1e-3, name
            assert np.abs(plan.torque).max() >= 25.0 - 1e-3 or sign < 0, name


def test_a_force_foreseen_is_met_with_the_postures_that_it_will_need():
    rise = np.linspace(0.0, 40.0, 31)
    ahead = np.stack([rise, 0.1 * rise])
    preview = horizon(BIPED, replace(TUNING, torque=TUNING.preview_torque), ANKLE, {}, TARGET)
    _, theta, tau = resting(preview, 0.0, 0.0)
    plans = {name: planned(made, Belief(theta, 0.0, 0.0, 0.0, ahead), tau) for name, made in planners(preview).items()}
    size = np.ptp(plans["nonlinear"].torque)
    assert size > 1.0
    for name in ("linear", "linear, whole"):
        assert plans[name].torque == pytest.approx(plans["nonlinear"].torque, abs=0.08 * size), name


def test_plans_are_the_same_in_a_mirror():
    turned = horizon(replace(BIPED, skew=-BIPED.skew), TUNING, ANKLE, {}, -TARGET)
    for (name, made), other in zip(planners().items(), planners(turned).values(), strict=True):
        one = planned(made, Belief(0.03, 0.1, 20.0, 5.0), -4.0)
        two = planned(other, Belief(-0.03, -0.1, -20.0, 5.0), 4.0)
        assert two.torque == pytest.approx(-one.torque, abs=2e-3), name


@pytest.mark.parametrize("name", ["force", "cop", "mpc", "mpc-oracle", "mpc-preview", "nmpc", "lqr"])
def test_in_a_trial_the_cop_comes_to_its_target_on_both_feet_ends(name):
    problem = replace(FEET, tuning=replace(FEET.tuning, horizon=30))
    world = World(biped=BIPED, scenario=FEET.scenarios[0], sensors=FEET.sensors, draws=None, target=TARGET)
    gains = FEET.gains._replace(K_f=0.6)
    control = controller(name, problem, gains if name in ("force", "cop") else None, world.scenario)
    ended = run(world, control, actuator(problem), 1e-3)
    assert not ended.failed and ended.lost is None and ended.fallen is None
    assert ended.contact.min() > 0
    force = world.scenario.force_at(np.array([world.scenario.duration]))[:, 0]
    P = float(plant(BIPED).cop(ended.states[:, -1], ended.torque[-1], force))
    assert pytest.approx(TARGET, abs=2e-3) == P
    assert ended.states[0, -1] == pytest.approx(final_posture(world), abs=2e-3)
    if name not in ("force", "cop"):
        assert ended.memory.tally.planned == len(ended.t)


@pytest.mark.parametrize("wanted", [500.0, -500.0])
def test_without_a_plan_the_torque_stays_within_what_the_load_allows(wanted):
    control = controller("mpc", FEET, None, FEET.scenarios[0])
    body, x, force = plant(BIPED), [-0.05, 0.1], [60.0, 10.0]
    F_T, F_H = body.forces(x, -20.0, force).full().ravel()
    given = control._in_contact(wanted, Measurement(*x, F_T, F_H), -20.0)
    P = float(body.cop(x, given, force))
    edge = BIPED.toe if wanted < 0 else -BIPED.heel
    assert pytest.approx(edge, abs=0.03 * BIPED.ell) == P
    assert -BIPED.heel < P < BIPED.toe
    assert control._in_contact(wanted, Measurement(*x, math.nan, F_H), -20.0) == 0.0
