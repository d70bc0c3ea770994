"""A trial is the closed loop of the paper, sampled; all controllers meet the same world; lost contact ends it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.analysis.simulate import simulate
from design.model.actuator import Actuator
from design.model.body import Biped
from design.model.closed_loop import closed_loop
from design.model.environment import constant_force, platform, profile, slope
from design.model.laws import Gains, Measurement, SampledLaw
from design.model.plant import plant
from design.model.sensing import Sensors
from design.model.uncertainty import Spread, Tolerances
from design.spec.load import load, parse
from design.spec.setting import setting
from problems.comparison.controllers import controller
from problems.comparison.measures import measures, trace
from problems.comparison.study import world
from problems.comparison.trial import World, course, run

PAPER = Biped(M=50.0, L=0.75, I=7.03125, m=0.1, ell=0.1)
GAINS = Gains(3500.0, 1200.0, 1.0)
RAMP = slope(PAPER, name="ramp", angle=math.radians(30), ramp=5.0, duration=10.0)
NOISY = (
    load("slope").text
    + "\n[noise]\nangle_deg = 0.02\nrate_deg_per_s = 0.1\nforce_n = 2.0\n"
    + ("[uncertainty]\nmass_kg = { percent = 5.0 }\nslope_deg = 1.0\nramp_s = { percent = 10.0 }\n")
)


def _law(kind, period, gains=GAINS):
    return SampledLaw(kind=kind, biped=PAPER, gains=gains, period=period)


def _run(scenario, control, period, sensors=None, draws=None, actuator=None):
    real = World(biped=PAPER, scenario=scenario, sensors=sensors or Sensors(), draws=draws)
    return run(real, control, actuator or Actuator(period=period), 0.001)


@pytest.mark.parametrize("kind", ["force", "cop"])
def test_a_short_period_gives_the_paper_s_smallest_force(kind):
    continuous = simulate(closed_loop(PAPER, kind), RAMP, GAINS, 0.001).F_H.min()
    errors = [abs(_run(RAMP, _law(kind, period), period).contact[1].min() - continuous) for period in (0.004, 0.001)]
    assert errors[1] < 0.5 * errors[0]
    assert errors[1] < 0.1


def test_pd_loses_contact_where_the_paper_says():
    ended = _run(RAMP, _law("pd", 0.001), 0.001)
    assert ended.lost is not None
    assert ended.lost[0] == pytest.approx(1.176, abs=0.0025)
    assert ended.lost[1] == "heel"
    assert len(ended.t) == round(ended.lost[0] / 0.001)
    assert ended.contact[1, -1] < 0 <= ended.contact[1, :-1].min()


def test_the_states_are_those_of_another_integrator():
    from scipy.integrate import solve_ivp

    ended = _run(RAMP, _law("force", 0.005), 0.005)
    dynamics = plant(PAPER).dynamics
    x = np.array([0.0, 0.0])
    for k in range(60):

        def rate(t, x, k=k):
            return dynamics(x, ended.torque[k], RAMP.force_at(np.array([t]))[:, 0]).full().ravel()

        x = solve_ivp(rate, (0.005 * k, 0.005 * (k + 1)), x, method="DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
    assert ended.states[:, 60] == pytest.approx(x, rel=1e-7, abs=1e-10)


GUSTS = np.array([[0.0, 0, 0], [0.303, 10, 0], [0.303, -10, 5], [0.7, 0, 0]])
SCENARIOS = {
    "ramp": RAMP,
    "sudden": slope(PAPER, name="s", angle=0.1, ramp=0.0, duration=0.95),
    "gusts": profile(
        name="p", points=np.array([[0.0, 0, 0], [0.303, 10, 0], [0.303, -10, 5], [0.7, 0, 0]]), duration=1.0
    ),
    "floor": platform(PAPER, name="f", points=np.array([[0.1, 0.0], [0.42, 0.3], [0.5, 0.3]]), duration=1.003),
}


@pytest.mark.parametrize("name", SCENARIOS)
@pytest.mark.parametrize("period", [0.005, 0.0073, 0.02])
def test_control_periods_cover_the_scenario_once_and_no_step_crosses_a_corner(name, period):
    scenario = SCENARIOS[name]
    way = course(scenario, period, 0.001)
    lengths = way.u[:, 0]
    assert lengths.max() <= 0.001 + 1e-12
    assert lengths.sum(axis=1)[:-1] == pytest.approx(period, abs=1e-9)
    assert lengths.sum() == pytest.approx(scenario.duration, abs=1e-9)
    ends = way.t[:, None] + np.cumsum(lengths, axis=1)
    for corner in scenario.breakpoints:
        assert np.abs(ends - corner).min() < 1e-9 or np.abs(way.t - corner).min() < 1e-9
    assert way.force == pytest.approx(scenario.force_at(way.t))


def test_steps_of_no_length_that_fill_up_a_period_change_nothing():
    gusts = SCENARIOS["gusts"]
    whole = _run(gusts, _law("force", 0.005), 0.005)
    by_simulation = simulate(closed_loop(PAPER, "force"), gusts, GAINS, 0.001)
    assert whole.states[0, -1] == pytest.approx(by_simulation.theta[-1], abs=2e-4)


# ---- fairness


@given(st.integers(0, 2**40), st.integers(0, 1000))
@settings(max_examples=20, deadline=None)
def test_the_world_of_a_trial_depends_on_its_number_alone_and_stays_within_the_tolerances(seed, trial):
    problem = setting(parse(NOISY, origin="noisy").spec)
    one, two = world(problem, "ramp", trial, seed), world(problem, "ramp", trial, seed)
    assert one.biped == two.biped
    assert np.array_equal(one.draws, two.draws)
    assert not np.array_equal(one.draws, world(problem, "ramp", trial + 1, seed).draws)
    assert abs(one.biped.M - 50.0) <= 2.5
    assert one.biped.M != 50.0
    assert one.biped.L == 0.75
    assert abs(math.degrees(one.scenario.signal[0, -1]) - 30.0) <= 1.0 + 1e-9
    assert abs(one.scenario.times[-1] - 5.0) <= 0.5 + 1e-9
    F_x, _ = one.scenario.force_at(np.array([10.0]))[:, 0]
    assert F_x == pytest.approx(one.biped.M * 9.81 * math.sin(one.scenario.signal[0, -1]))


def test_draws_spread_over_the_whole_tolerance():
    problem = setting(parse(NOISY, origin="noisy").spec)
    masses = np.array([world(problem, "ramp", k, 0).biped.M for k in range(200)])
    assert masses.min() < 47.8
    assert masses.max() > 52.2
    assert abs(masses.mean() - 50.0) < 0.4


@pytest.mark.parametrize("name", ["force", "lqr", "mpc", "mpc-oracle"])
def test_every_controller_has_the_same_limits_noise_and_delay(name):
    text = NOISY.replace("\n[noise]", "\n[noise]\ndelay_s = 0.01").replace(
        "[requirements]", "[requirements]\ntorque_nm = 20.0\ntorque_rate_nm_per_s = 500.0"
    )
    problem = setting(parse(text, origin="noisy").spec)
    real = world(problem, "ramp", 0, 0)
    told = []
    inner = controller(name, problem, problem.gains, real.scenario)

    class Listening:
        def start(self):
            return inner.start()

        def __call__(self, t, measurement, memory):
            told.append(measurement)
            return inner(t, measurement, memory)

    from problems.comparison.controllers import actuator

    ended = run(real, Listening(), actuator(problem), problem.step)
    assert np.abs(ended.torque).max() <= 20.0
    assert np.abs(np.diff(ended.torque, prepend=0.0)).max() <= 500.0 * 0.005 + 1e-9
    for k in (2, 50):
        if k < len(ended.t):
            expected = ended.states[0, k - 2] + problem.sensors.angle * real.draws[k, 0]
            assert told[k].theta == pytest.approx(expected, abs=1e-12)


def test_sensors_round_to_their_resolution_and_exact_ones_tell_the_truth():
    truth = Measurement(0.0123, -0.4, 240.3, 250.9)
    assert Sensors(delay=0.1).reading(truth, [1.0, 1.0, 1.0, 1.0]) == truth
    rough = Sensors(angle_step=0.01, force_step=5.0).reading(truth, [0.0] * 4)
    assert rough == pytest.approx((0.01, -0.4, 240.0, 250.0))


def test_tolerances_without_width_leave_the_world_as_it_is():
    shares = [0.3] * 7
    body, scenario = Tolerances().drawn(PAPER, RAMP, shares)
    assert body == PAPER
    assert scenario.force_at(np.array([2.0, 9.0])) == pytest.approx(RAMP.force_at(np.array([2.0, 9.0])))
    wide = Tolerances(slope=Spread(absolute=0.1), ramp=Spread(part=0.5))
    _, other = wide.drawn(PAPER, constant_force(name="w", F_x=10.0, F_y=0.0, ramp=2.0, duration=3.0), shares)
    assert other.times[-1] == pytest.approx(2.3)
    assert other.force_at(np.array([3.0]))[0, 0] == pytest.approx(10.0)


# ---- rows


def test_a_row_says_how_a_trial_ended_and_has_no_settling_where_contact_was_lost():
    real = World(biped=PAPER, scenario=RAMP, sensors=Sensors(), draws=None)
    lost = measures(real, _run(RAMP, _law("pd", 0.005), 0.005))
    kept = measures(real, _run(RAMP, _law("force", 0.005), 0.005))
    assert (lost["status"], lost["lost_at"], lost["settling_s"]) == ("lost", "heel", None)
    assert lost["contact_force_n"] == lost["heel_force_n"] < 0
    assert (kept["status"], kept["lost_s"]) == ("kept", None)
    assert kept["contact_force_n"] == pytest.approx(29.4, abs=0.5)
    assert kept["settling_s"] == pytest.approx(1.15, abs=0.02)


def test_a_controller_that_raises_or_gives_no_number_is_a_failed_trial():
    class Raises:
        def start(self):
            return 0

        def __call__(self, t, measurement, memory):
            if t > 0.1:
                raise ZeroDivisionError("at last")
            return 0.0, memory

    class NoNumber(Raises):
        def __call__(self, t, measurement, memory):
            return math.nan if t > 0.1 else 0.0, memory

    real = World(biped=PAPER, scenario=RAMP, sensors=Sensors(), draws=None)
    for control, why in ((Raises(), "ZeroDivisionError: at last"), (NoNumber(), "gave nan")):
        row = measures(real, _run(RAMP, control, 0.005))
        assert row["status"] == "failed"
        assert why in row["why"]


def test_a_trace_keeps_the_least_of_each_force_between_its_samples():
    ended = _run(RAMP, _law("force", 0.005), 0.005)
    kept = trace(ended)
    assert len(kept["t_s"]) == 250
    assert min(kept["heel_force_n"]) == pytest.approx(ended.contact[1].min(), rel=1e-9)


# ---- what the study must find on the paper's ramp and on sudden slopes


def _problem(**changes):
    return replace(setting(load("slope").spec), **changes)


@pytest.mark.parametrize("name", ["mpc", "mpc-oracle", "mpc-preview"])
def test_on_the_paper_s_ramp_the_prediction_keeps_193_newtons(name):
    problem = _problem()
    ended = _run(RAMP, controller(name, problem, None, RAMP), 0.005)
    assert ended.contact[:2].min() >= 193.0
    assert not ended.memory.tally.tail + ended.memory.tally.law


@pytest.mark.parametrize(("name", "degrees"), [("mpc-oracle", 7.2), ("mpc-preview", 7.2), ("mpc", 7.2)])
def test_from_rest_on_a_sudden_slope_no_force_is_ever_negative(name, degrees):
    sudden = slope(PAPER, name="sudden", angle=math.radians(degrees), ramp=0.0, duration=4.0)
    ended = _run(sudden, controller(name, _problem(), None, sudden), 0.005)
    assert not ended.lost
    assert ended.contact[:2].min() >= 0.0
    assert ended.states[0, -1] == pytest.approx(-math.radians(degrees), abs=1e-3)


def test_nothing_is_offset_at_rest_though_the_body_is_another():
    heavier = replace(PAPER, M=53.0, L=0.77, I=7.8)
    scenario = slope(heavier, name="r", angle=math.radians(5), ramp=1.0, duration=6.0)
    control = controller("mpc", _problem(), None, scenario)
    ended = run(
        World(biped=heavier, scenario=scenario, sensors=Sensors(), draws=None), control, Actuator(period=0.005), 1e-3
    )
    assert abs(ended.torque[-1]) < 1e-3
    assert ended.states[0, -1] == pytest.approx(-math.radians(5), abs=1e-5)


WISHES = {
    "contact_force_n = 0.0": ["contact_force_n = 220.0", "contact_force_n = 100.0"],
    "decay_rate_per_s = 0.0": ["cop_margin_m = 0.095", "friction = 0.1"],
}


@pytest.mark.parametrize(("written", "wish"), [(key, wish) for key, wishes in WISHES.items() for wish in wishes])
@pytest.mark.parametrize("name", ["mpc", "nmpc"])
def test_a_wish_that_cannot_be_kept_does_not_cost_contact(name, written, wish):
    problem = setting(parse(load("slope").text.replace(written, wish), origin="wish").spec)
    sudden = slope(PAPER, name="sudden", angle=math.radians(6.5), ramp=0.0, duration=4.0)
    for scenario in (RAMP, sudden):
        ended = _run(scenario, controller(name, problem, None, scenario), 0.005)
        assert not ended.lost
        if not wish.startswith("cop"):  # a hard CoP margin of 95 % keeps the body askew on a sudden slope
            assert ended.states[0, -1] == pytest.approx(-scenario.signal[0, -1], abs=1e-3)


def test_measurements_from_before_the_start_agree_with_the_motion_that_they_show():
    told = []

    class Listening:
        def start(self):
            return None

        def __call__(self, t, measurement, memory):
            told.append(measurement)
            return 0.0, None

    moving = constant_force(name="m", F_x=0.0, F_y=0.0, ramp=0.0, duration=0.1, omega0=1.0)
    _run(moving, Listening(), 0.005, sensors=Sensors(delay=0.01))
    assert told[0].F_T + told[0].F_H == pytest.approx(PAPER.weight - PAPER.M * PAPER.L * 1.0, rel=1e-9)  # (7)
