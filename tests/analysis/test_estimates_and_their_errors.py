"""What is read off the sensors, and what is said of its error: exact at rest, small in motion, never understated."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.analysis.estimate import Signals, at_rest, dynamic, evenly, off, static, static_estimate
from design.analysis.simulate import simulate
from design.model.body import Biped
from design.model.closed_loop import closed_loop
from design.model.environment import constant_force, platform, slope
from design.model.laws import Gains
from design.model.plant import plant
from design.model.sensing import Sensors
from design.model.uncertainty import Spread, Tolerances

PAPER = Biped(M=50.0, L=0.75, I=7.03125, m=0.1, ell=0.1)
ADULT = Biped(M=70.0, L=0.95, I=4 / 3 * 70.0 * 0.95**2, m=2.0, ell=0.12)
GAINS = {PAPER: Gains(3500.0, 1200.0, 1.0), ADULT: Gains(2500.0, 900.0, 0.3)}
EXACT, NO_TOLERANCES = Sensors(), Tolerances()
NOISY = Sensors(angle=math.radians(0.05), rate=math.radians(0.5), force=2.0)
SCENARIOS = {
    "slope": lambda body: slope(body, name="slope", angle=math.radians(15), ramp=5.0, duration=12.0),
    "wind": lambda body: constant_force(name="wind", F_x=60.0, F_y=10.0, ramp=3.0, duration=12.0),
    "train": lambda body: platform(
        body, name="train", points=np.array([[0.0, 0.0], [2.0, 1.0], [12.0, 1.0]]), duration=12.0
    ),
}
RAMPS = {"slope": 5.0, "wind": 3.0, "train": 2.0}


def _signals(body, scenario, period=None):
    run = simulate(closed_loop(body, "force"), scenario, GAINS[body], 1e-3)
    signals = Signals(run.t, run.theta, run.omega, run.F_T, run.F_H)
    return evenly(signals, period or 1e-3)


def _noisy(signals, sensors, seed):
    draws = np.random.default_rng(seed).standard_normal((4, len(signals.t)))
    sizes = (sensors.angle, sensors.rate, sensors.force, sensors.force)
    return Signals(signals.t, *(part + size * d for part, size, d in zip(signals[1:], sizes, draws, strict=True)))


states = {
    "theta": st.floats(-0.6, 0.6),
    "omega": st.floats(-2.0, 2.0),
    "tau": st.floats(-200.0, 200.0),
    "F_x": st.floats(-200.0, 200.0),
    "F_y": st.floats(-200.0, 200.0),
}


@given(F_x=states["F_x"], F_y=states["F_y"], body=st.sampled_from([PAPER, ADULT]))
def test_at_a_true_equilibrium_the_static_estimate_is_exact(F_x, F_y, body):
    theta = math.atan2(-F_x, body.M * body.g - F_y)  # (4)
    F_T, F_H = plant(body).forces([theta, 0.0], 0.0, [F_x, F_y]).full().ravel()
    found = static_estimate(body, np.array([theta]), np.array([F_T]), np.array([F_H]))
    assert np.ravel(found) == pytest.approx([F_x, F_y], rel=1e-6, abs=1e-6)


@given(**states, body=st.sampled_from([PAPER, ADULT]))
def test_what_motion_does_to_the_static_estimate_is_said_exactly(theta, omega, tau, F_x, F_y, body):
    F_T, F_H = plant(body).forces([theta, omega], tau, [F_x, F_y]).full().ravel()
    acceleration = plant(body).dynamics([theta, omega], tau, [F_x, F_y]).full()[1]
    found = np.ravel(static_estimate(body, np.array([theta]), np.array([F_T]), np.array([F_H])))
    wrong = off(body, np.array([theta]), np.array([omega]), acceleration, np.array([tau]))
    assert found - np.ravel(wrong) == pytest.approx([F_x, F_y], rel=1e-9, abs=1e-7)


@pytest.mark.parametrize("body", [PAPER, ADULT])
@pytest.mark.parametrize("name", SCENARIOS)
def test_while_the_force_grows_the_dynamic_error_is_at_most_a_tenth_of_the_static_one(body, name):
    scenario = SCENARIOS[name](body)
    signals = _signals(body, scenario)
    growing = (signals.t > 0.02) & (signals.t <= RAMPS[name])
    truth = scenario.force_at(signals.t)

    def worst(found):
        return np.abs(found.F - truth)[:, growing].max(axis=1)

    in_motion = worst(dynamic(body, signals, EXACT, NO_TOLERANCES, walk=5.0))
    at_standstill = worst(static(body, signals, EXACT, NO_TOLERANCES))
    assert (in_motion <= 0.1 * at_standstill).all()


@pytest.mark.parametrize("body", [PAPER, ADULT])
@pytest.mark.parametrize("rate_measured", [True, False])
def test_noise_spreads_the_estimates_as_predicted(body, rate_measured):
    scenario = replace(SCENARIOS["slope"](body), duration=8.0)
    signals = _signals(body, scenario, period=0.01)
    if not rate_measured:
        signals = signals._replace(omega=np.full_like(signals.omega, np.nan))
    predicted = [f(body, signals, NOISY, NO_TOLERANCES, **more) for f, more in ((static, {}), (dynamic, {"walk": 5.0}))]
    trials = [_noisy(signals, NOISY, seed) for seed in range(25)]
    for clean, again in (
        (predicted[0], [np.vstack(static_estimate(body, each.theta, each.F_T, each.F_H)) for each in trials]),
        (predicted[1], [dynamic(body, each, replace(NOISY), NO_TOLERANCES, walk=5.0).F for each in trials]),
    ):
        errors = np.array(again) - clean.F
        for window in (slice(100, 300), slice(600, 801)):  # on the ramp, and at rest on the slope
            measured = np.sqrt((errors[:, :, window] ** 2).mean(axis=(0, 2)))
            assert measured == pytest.approx(np.sqrt((clean.spread[:, window] ** 2).mean(axis=1)), rel=0.2)


TOLERANCES = Tolerances(M=Spread(part=0.01), L=Spread(part=0.01), I=Spread(part=0.02), m=Spread(absolute=0.02),
                        ell=Spread(absolute=0.001))  # fmt: skip


@pytest.mark.parametrize("estimate", [static, lambda *given: dynamic(*given, walk=5.0)])
def test_a_body_within_its_tolerances_makes_no_larger_error_than_said_and_one_of_them_makes_nearly_that(estimate):
    scenario = replace(SCENARIOS["wind"](PAPER), duration=6.0)
    share = 0.0
    for corner in itertools.product([-1.0, 1.0], repeat=5):
        real, _ = TOLERANCES.drawn(PAPER, scenario, [*corner, 0.0, 0.0])
        loop = closed_loop(real, "force")
        run = simulate(loop, scenario, GAINS[PAPER], 1e-3)
        signals = evenly(Signals(run.t, run.theta, run.omega, run.F_T, run.F_H), 2e-2)
        as_nominal = estimate(PAPER, signals, EXACT, TOLERANCES)
        as_real = estimate(real, signals, EXACT, NO_TOLERANCES)
        wrong = np.abs(as_nominal.F - as_real.F)[:, 5:]
        assert (wrong <= 1.06 * as_nominal.bias[:, 5:] + 1e-3).all()  # first order: the rest is the second
        share = max(share, float((wrong[:, -1] / np.maximum(as_nominal.bias[:, -1], 1e-9)).max()))
    assert share > 0.9


def test_the_most_that_is_said_of_a_body_within_its_tolerances_holds_at_every_time():
    wide = Tolerances(M=Spread(part=0.03), L=Spread(part=0.03), I=Spread(part=0.05), m=Spread(part=0.1),
                      ell=Spread(part=0.02))  # fmt: skip
    body = Biped(M=60.0, L=0.85, I=55.0, m=1.5, ell=0.12)
    scenario = constant_force(name="w", F_x=30.0, F_y=-40.0, ramp=0.5, duration=3.0)

    def estimated(real):
        run = simulate(closed_loop(real, "force"), scenario, Gains(2500.0, 700.0, 0.4), 2e-3)
        signals = evenly(Signals(run.t, run.theta, run.omega, run.F_T, run.F_H), 5e-3)
        found = dynamic(body, signals, EXACT, wide, walk=500.0)
        return np.abs(found.F - scenario.force_at(signals.t))[:, 20:], found.bias[:, 20:]

    late, bias = estimated(body)
    assert bias[0].max() > 2 * bias[0].mean()  # on the ramp, not a mean
    rng = np.random.default_rng(1)
    for shares in [*rng.choice([-1.0, 1.0], (6, 5)), *rng.uniform(-1, 1, (3, 5))]:
        real, _ = wide.drawn(body, scenario, [*shares, 0.0, 0.0])
        wrong, said = estimated(real)
        assert (wrong <= said + 1.2 * late.max(axis=1, keepdims=True)).all()


def test_a_changing_force_is_read_as_late_as_said():
    scenario = constant_force(name="growing", F_x=100.0, F_y=0.0, ramp=10.0, duration=9.0)
    signals = _signals(PAPER, scenario, period=0.01)
    found = dynamic(PAPER, signals, NOISY, NO_TOLERANCES, walk=5.0)
    late = (scenario.force_at(signals.t) - found.F)[0, 150:300] / 10.0
    assert late == pytest.approx(found.lag[0], rel=0.1)


# ---- whether a state is stationary


@pytest.mark.parametrize("name", SCENARIOS)
def test_rest_is_found_at_the_end_and_the_error_there_is_within_the_one_stated(name):
    scenario = replace(SCENARIOS[name](PAPER), duration=20.0)
    found = at_rest(PAPER, _signals(PAPER, scenario), EXACT, NO_TOLERANCES)
    truth = scenario.force_at(np.array([20.0]))[:, 0]
    assert found.stationary, found.why
    assert (np.abs(np.array(found.F) - truth) <= np.array(found.bound) + 1e-9).all()


@pytest.mark.parametrize("name", SCENARIOS)
@pytest.mark.parametrize("sensors", [EXACT, NOISY])
def test_amid_the_ramp_it_is_said_not_to_be_at_rest_and_by_how_much_the_formula_is_off(name, sensors):
    scenario = replace(SCENARIOS[name](PAPER), duration=RAMPS[name])
    signals = _noisy(_signals(PAPER, scenario), sensors, seed=1)
    found = at_rest(PAPER, signals, sensors, NO_TOLERANCES)
    wrong = np.abs(np.array(found.F) - scenario.force_at(signals.t[-1:])[:, 0])
    assert not found.stationary
    assert "are off by up to" in found.why
    # the mean over the window is of the force half a window ago
    moved = np.abs(np.diff(scenario.force_at(signals.t[[-1 - 250, -1]]), axis=1))[:, 0]
    assert (wrong <= np.array(found.bound) + 1.05 * moved).all()
    assert found.off[0] > 0.5 * wrong[0]


def test_noise_alone_is_not_taken_for_motion():
    scenario = replace(SCENARIOS["wind"](PAPER), duration=25.0)
    signals = _signals(PAPER, scenario, period=0.005)
    assert all(at_rest(PAPER, _noisy(signals, NOISY, seed), NOISY, NO_TOLERANCES).stationary for seed in range(40))


# ---- what is missing


def test_a_gap_is_bridged_for_a_while_and_then_left_open():
    scenario = SCENARIOS["wind"](PAPER)
    signals = _signals(PAPER, scenario, period=0.01)
    valid = np.ones(len(signals.t), dtype=bool)
    valid[400:410] = valid[800:900] = False
    found = dynamic(PAPER, signals, EXACT, NO_TOLERANCES, walk=5.0, valid=valid)
    truth = scenario.force_at(signals.t)
    assert np.abs(found.F - truth)[:, 400:412].max() < 2.0
    assert np.isnan(found.F[:, 850:900]).all()
    assert np.abs(found.F - truth)[:, 905:].max() < 1.0


def test_too_few_samples_are_refused():
    one = Signals(*(np.zeros(1) for _ in range(5)))
    with pytest.raises(ValueError, match="needs 2"):
        dynamic(PAPER, one, EXACT, NO_TOLERANCES, walk=5.0)
    with pytest.raises(ValueError, match="needs 4"):
        at_rest(PAPER, one, EXACT, NO_TOLERANCES)


@settings(max_examples=20, deadline=None)
@given(st.floats(0.001, 0.03))
def test_signals_at_another_period_lie_on_the_old_ones(period):
    t = np.sort(np.append(np.arange(0.0, 1.0, 0.01), [0.5, 0.5]))
    signals = Signals(t, 2 * t, t, t, t)
    again = evenly(signals, period)
    assert np.diff(again.t) == pytest.approx(period)
    assert again.theta == pytest.approx(2 * again.t)
