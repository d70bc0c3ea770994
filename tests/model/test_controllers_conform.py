"""A sampled law is a Controller: no hidden state, the printed torque, and in the limit the loop of the paper."""

import math
from dataclasses import FrozenInstanceError
from functools import cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.analysis.simulate import simulate
from design.model.body import Biped
from design.model.closed_loop import closed_loop
from design.model.environment import constant_force, slope
from design.model.laws import Gains, Measurement, SampledLaw, law
from design.model.plant import plant

PAPER = Biped(M=50.0, L=0.75, I=50.0 * 0.75**2 / 4, m=0.1, ell=0.1)
GAINS = Gains(3500.0, 1200.0, 1.0)
KINDS = ["pd", "force", "cop"]
THETA_D = 0.03

measurements = st.builds(
    Measurement, st.floats(-0.7, 0.7), st.floats(-5.0, 5.0), st.floats(1.0, 900.0), st.floats(1.0, 900.0)
)
memories = st.floats(-500.0, 500.0)
every_kind = pytest.mark.parametrize("kind", KINDS)


def controller(kind, period=0.002, gains=GAINS):
    return SampledLaw(kind=kind, biped=PAPER, gains=gains, period=period, theta_d=THETA_D)


# ---- what any controller must do


@every_kind
def test_the_same_call_has_the_same_answer_whatever_was_called_between(kind):
    control = controller(kind)
    seen, other = Measurement(0.1, -0.2, 300.0, 190.0), Measurement(-0.3, 2.0, 20.0, 470.0)
    first = control(0.5, seen, 12.0)
    control(0.502, other, -3.0)
    control.start()
    assert control(0.5, seen, 12.0) == first
    assert controller(kind)(0.5, seen, 12.0) == first  # another one of the same settings


@every_kind
def test_a_controller_cannot_be_changed_by_a_run(kind):
    control = controller(kind)
    assert control.start() == 0.0
    with pytest.raises(FrozenInstanceError):
        control.period = 1.0


@every_kind
def test_a_run_can_be_resumed_from_its_memory(kind):
    control = controller(kind)
    readings = [Measurement(0.01 * k, -0.1, 240.0 + k, 250.0 - k) for k in range(20)]

    def run(memory, part):
        torques = []
        for k, seen in part:
            tau, memory = control(k * control.period, seen, memory)
            torques.append(tau)
        return torques, memory

    numbered = list(enumerate(readings))
    whole, last = run(control.start(), numbered)
    head, kept = run(control.start(), numbered[:7])
    tail, resumed = run(kept, numbered[7:])
    assert [*head, *tail] == whole
    assert resumed == last


# ---- the formulas


@every_kind
@given(seen=measurements, memory=memories)
@settings(max_examples=60, deadline=None)
def test_the_torque_is_the_printed_one(kind, seen, memory):
    feedback = {"pd": 0.0, "force": GAINS.K_f, "cop": GAINS.K_f * (PAPER.M + PAPER.m) * PAPER.g / PAPER.ell}[kind]
    expected = -GAINS.K_d * seen.omega + GAINS.K_p * (THETA_D - seen.theta) + feedback * memory  # (8), (20)
    tau, _ = controller(kind)(0.0, seen, memory)
    assert tau == pytest.approx(expected, rel=1e-12, abs=1e-9)


@every_kind
@given(seen=measurements, memory=memories)
@settings(max_examples=60, deadline=None)
def test_the_memory_gathers_what_the_law_integrates(kind, seen, memory):
    P = (seen.F_T - seen.F_H) * PAPER.ell / (seen.F_T + seen.F_H)  # (18)
    gathered = {"pd": 0.0, "force": seen.F_H - seen.F_T, "cop": -P}[kind]
    _, following = controller(kind, period=0.004)(0.0, seen, memory)
    assert following == pytest.approx(memory + 0.004 * gathered, rel=1e-13, abs=1e-12)


@every_kind
@given(seen=measurements, memory=memories)
@settings(max_examples=60, deadline=None)
def test_the_sampled_law_is_the_continuous_one_read_once_a_period(kind, seen, memory):
    continuous = law(kind, PAPER, THETA_D)
    tau, following = controller(kind, period=1.0)(0.0, seen, memory)
    assert tau == pytest.approx(float(continuous.torque([seen.theta, seen.omega], memory, GAINS)), rel=1e-13)
    gathered = float(continuous.memory_rate([seen.theta, seen.omega], memory, [seen.F_T, seen.F_H]))
    assert following - memory == pytest.approx(gathered, rel=1e-9, abs=1e-9)


# ---- the loop closed by hand


@cache
def _held():
    """The plant over one period with the torque held: (x, tau, F at the start, middle and end, h) -> x."""
    dynamics = plant(PAPER).dynamics
    x, tau, F, h = ca.SX.sym("x", 2), ca.SX.sym("tau"), ca.SX.sym("F", 6), ca.SX.sym("h")
    k1 = dynamics(x, tau, F[:2])
    k2 = dynamics(x + h / 2 * k1, tau, F[2:4])
    k3 = dynamics(x + h / 2 * k2, tau, F[2:4])
    k4 = dynamics(x + h * k3, tau, F[4:])
    return ca.Function("held", [x, tau, F, h], [x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)])


def _by_hand(kind, scenario, period, gains):
    """theta at the samples; the forces measured are those under the torque held so far."""
    control, forces, steps = controller(kind, period, gains), plant(PAPER).forces, scenario.steps(period)
    x, tau, memory = ca.DM([scenario.theta0, scenario.omega0]), 0.0, control.start()
    thetas = [scenario.theta0]
    for k, h in enumerate(steps.h):
        F_T, F_H = forces(x, tau, steps.start[:, k]).full().ravel()
        seen = Measurement(float(x[0]), float(x[1]), float(F_T), float(F_H))
        tau, memory = control(steps.t[k], seen, memory)
        x = _held()(x, tau, np.concatenate([steps.start[:, k], steps.middle[:, k], steps.end[:, k]]), h)
        thetas.append(float(x[0]))
    return np.array(thetas)


RUNS = {
    "slope": slope(PAPER, name="slope", angle=0.2, ramp=1.0, duration=1.6),
    "push": constant_force(name="push", F_x=25.0, F_y=40.0, ramp=0.0, duration=1.6, theta0=0.02, omega0=0.05),
}


@every_kind
@pytest.mark.parametrize("run", RUNS)
def test_a_shorter_period_comes_nearer_to_the_continuous_loop_in_proportion(kind, run):
    scenario = RUNS[run]
    continuous = simulate(closed_loop(PAPER, kind, THETA_D), scenario, GAINS, 0.001).theta[::4]
    errors = []
    for period in (0.004, 0.002, 0.001):
        theta = _by_hand(kind, scenario, period, GAINS)[:: round(0.004 / period)]
        errors.append(np.abs(theta - continuous).max())
    ratios = np.array(errors[:-1]) / errors[1:]
    assert np.abs(continuous).max() > math.radians(0.5)
    assert errors[-1] < 0.01 * np.abs(continuous).max()
    assert np.all((ratios > 1.6) & (ratios < 2.6)), (errors, ratios)


def test_the_wrong_law_does_not_come_nearer():
    scenario = RUNS["slope"]
    continuous = simulate(closed_loop(PAPER, "force", THETA_D), scenario, GAINS, 0.001).theta[::4]
    theta = _by_hand("pd", scenario, 0.001, GAINS)[::4]
    assert np.abs(theta - continuous).max() > 0.1 * np.abs(continuous).max()
