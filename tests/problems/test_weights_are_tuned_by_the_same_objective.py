"""Weights are tuned by the spec's objective on the nominal body, LQR is clipped to contact, trials can be repeated."""

import csv
import io
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.analysis.observer import Belief
from design.model.body import Biped
from design.model.laws import Gains
from design.model.plant import plant
from design.present.study_text import csv_text
from design.spec.load import load, parse
from design.spec.setting import setting
from problems.comparison.conduct import conduct, facts
from problems.comparison.controllers import actuator, controller, prediction
from problems.comparison.measures import measures
from problems.comparison.study import world, world_of
from problems.comparison.summary import interval
from problems.comparison.trial import run
from problems.comparison.weights import (
    FINEST,
    MOST,
    Weights,
    all_tuned,
    initial,
    merit,
    search,
    tuned,
    weighted,
    worlds,
)
from problems.lqr import ClippedLqr, contact_interval
from problems.mpc_linear import LinearPlanner

SHORT = {"ramp_s = 5.0": "ramp_s = 1.0", "angle_deg = 30.0": "angle_deg = 3.0", "duration_s = 10.0": "duration_s = 1.5"}
TEXT = load("slope").text
for long, short in SHORT.items():
    TEXT = TEXT.replace(long, short)
NOISY = TEXT + (
    "\n[noise]\nangle_deg = 0.02\nrate_deg_per_s = 0.1\nforce_n = 2.0\n"
    "[uncertainty]\nmass_kg = { percent = 5.0 }\nhalf_length_m = { percent = 3.0 }\nslope_deg = 0.5\n"
    "ramp_s = { percent = 10.0 }\n"
)


def _problem(text=NOISY):
    return setting(parse(text, origin="noisy").spec)


# ---- the search


@given(st.floats(-3.5, 2.5), st.floats(-2.5, 1.5), st.floats(0.3, 3.0))
@settings(max_examples=30, deadline=None)
def test_the_search_comes_within_its_last_step_of_a_smooth_maximum(x, y, steep):
    found = search(lambda p: (0.0, 0.0, -((p[0] - x) ** 2) - steep * (p[1] - y) ** 2), [-1.9, -1.7],
                   [(-4.0, 3.0), (-3.0, 2.0)], lambda: 1)  # fmt: skip
    assert abs(found[0] - x) <= 2 * FINEST
    assert abs(found[1] - y) <= 2 * FINEST


def test_what_is_tuned_is_at_least_what_the_default_reaches_and_the_same_again():
    problem = _problem()
    found = tuned(problem, "mpc")
    assert found == tuned(problem, "mpc")
    assert found.value >= found.before
    assert found.evaluations <= MOST
    assert found.value == pytest.approx(merit(problem, "mpc", None, found.weights)[2])
    for factor in (10.0, 0.1):  # no better by a decade
        other = found.weights._replace(torque_weight=factor * found.weights.torque_weight)
        assert merit(problem, "mpc", None, other) <= merit(problem, "mpc", None, found.weights)


def test_weights_that_the_spec_writes_are_kept():
    problem = _problem(NOISY + "[mpc]\ntorque_weight = 0.7\n")
    found = tuned(problem, "lqr")
    assert found.weights.torque_weight == 0.7
    assert found.fixed == ("torque_weight",)
    both = tuned(_problem(NOISY + "[mpc]\ntorque_weight = 0.7\nrate_weight = 0.0\n"), "lqr")
    assert (both.weights, both.evaluations) == (Weights(0.7, 0.0), 1)


def test_controllers_with_the_same_cost_share_their_weights():
    found, left_out = all_tuned(_problem(), ["force", "mpc", "nmpc"], lambda _: None, tune=True)
    assert list(found) == ["mpc", "nmpc"]
    assert found["nmpc"] is found["mpc"]
    assert not left_out


def test_weights_are_tuned_on_the_nominal_body_with_noise_that_no_trial_has():
    problem = _problem()
    for one in worlds(problem):
        assert one.biped == problem.biped
        assert one.scenario is problem.scenario(one.scenario.name)
        for trial in range(50):
            other = world(problem, one.scenario.name, trial, problem.study.seed)
            assert not np.array_equal(one.draws[:5], other.draws[:5])


def test_a_study_says_what_its_weights_are_and_untuned_ones_are_the_defaults():
    problem = _problem()
    small = replace(problem, study=problem.study.model_copy(update={"trials": 1}))
    source = parse(NOISY, origin="noisy")
    stored = facts(conduct(source, small, ["force", "lqr"]), small)["tuning"]
    its = stored["weights"]["lqr"]
    assert its["evaluations"] > 1
    assert stored["gains"]["force"]["value"] == pytest.approx(merit(small, "force", small.gains, None)[2])
    bare = conduct(source, small, ["lqr"], tune=False)
    assert bare.tuned["lqr"].weights == initial(small, "lqr")
    assert bare.tuned["lqr"].evaluations == 0


# ---- clipped LQR


FEET = {
    "paper": Biped(M=50.0, L=0.75, I=7.03125, m=0.1, ell=0.1),
    "heavy foot": Biped(M=40.0, L=0.6, I=18.0, m=3.0, ell=0.1),
    "unequal": Biped(M=50.0, L=0.75, I=37.5, m=1.0, ell=0.12, skew=0.3, height=0.08),
}


@pytest.mark.parametrize("foot", FEET)
@given(st.floats(-0.2, 0.2), st.floats(-0.5, 0.5), st.floats(-60.0, 60.0), st.floats(-40.0, 40.0))
@settings(max_examples=40, deadline=None)
def test_at_the_ends_of_the_interval_one_end_of_the_foot_bears_the_margin(foot, theta, omega, F_x, F_y):
    body = FEET[foot]
    low, high = contact_interval(body, (theta, omega), (F_x, F_y), 5.0)
    forces = plant(body).forces
    for tau, end in ((low, 1), (high, 0)):
        assert float(forces([theta, omega], tau, [F_x, F_y])[end]) == pytest.approx(5.0, abs=1e-6)
    middle = forces([theta, omega], 0.5 * (low + high), [F_x, F_y]).full().ravel()
    assert (middle.min() > 5.0) == (low < high)


@pytest.mark.parametrize("degrees", [0.5, 2.0])
def test_where_no_limit_is_active_clipped_lqr_is_the_linear_prediction(degrees):
    problem = _problem()
    ahead = prediction(problem)
    alpha, weight = math.radians(degrees), problem.biped.M * problem.biped.g
    belief = Belief(0.002, -0.01, weight * math.sin(alpha), weight * (1 - math.cos(alpha)))
    by_lqr = ClippedLqr(horizon=ahead).plan(0.0, belief, 0.0, None).value
    by_mpc = LinearPlanner(horizon=ahead, shortcut=False).plan(0.0, belief, 0.0, None).value
    assert by_lqr.torque[0] == pytest.approx(by_mpc.torque[0], abs=1e-4)


def test_clipped_lqr_keeps_contact_where_lqr_alone_would_not():
    problem = _problem()
    ahead, weight = prediction(problem), problem.biped.M * problem.biped.g
    alpha = math.radians(6.5)
    F = (weight * math.sin(alpha), weight * (1 - math.cos(alpha)))
    outcome = ClippedLqr(horizon=ahead).plan(0.0, Belief(0.0, 0.0, *F), 0.0, None)
    assert outcome.detail == "LQR, clipped"
    forces = plant(problem.biped).forces([0.0, 0.0], outcome.value.torque[0], F).full().ravel()
    assert forces.min() == pytest.approx(0.01 * problem.biped.weight, abs=1e-6)


# ---- a trial can be repeated


@pytest.mark.parametrize("text", [NOISY, TEXT], ids=["drawn", "nominal"])
def test_a_trial_is_repeated_from_its_line_of_the_csv_alone(text):
    problem = _problem(text)
    small = replace(problem, study=problem.study.model_copy(update={"trials": 2, "seed": 5}))
    rows = conduct(parse(text, origin="spec"), small, ["force", "lqr", "mpc"]).rows
    lines = [line for line in csv.DictReader(io.StringIO(csv_text(rows))) if line["trial"]]
    assert len(lines) == 6
    for line in lines:
        numbers = {key: float(value) for key, value in line.items() if value and key not in
                   ("controller", "scenario", "status", "why", "lost_at", "trial", "seed")}  # fmt: skip
        row = {**numbers, "scenario": line["scenario"], "trial": int(line["trial"]), "seed": int(line["seed"])}
        again = world_of(problem, row)
        gains = Gains(row["kp"], row["kd"], row["kf"]) if "kp" in row else None
        weights = Weights(row["torque_weight"], row["rate_weight"]) if "torque_weight" in row else None
        posed = weighted(problem, line["controller"], weights)
        ended = measures(again, run(again, controller(line["controller"], posed, gains, again.scenario),
                                    actuator(posed), posed.step))  # fmt: skip
        for key in ("contact_force_n", "torque_rms_nm", "torque_variation_nm", "posture_error_deg"):
            assert ended[key] == row.get(key), key
    if text is NOISY:
        assert len({line["mass_kg"] for line in lines}) == len({line["slope_rad"] for line in lines}) == 2


# ---- scenarios are strata


def test_a_second_scenario_with_the_same_differences_is_no_further_evidence():
    for count in (6, 30):
        one = np.random.default_rng(count).normal(2.0, 5.0, count)
        alone, twice = interval(one), interval(np.column_stack([one, one]))
        assert twice == pytest.approx({**alone, "scenarios": 2}, rel=1e-9)


def test_scenarios_weigh_the_same_though_one_has_fewer_pairs():
    table = np.column_stack([np.full(12, 1.0), np.full(12, 5.0)]) + 0.01 * np.arange(12)[:, None] * [1, -1]
    table[3:9, 1] = np.nan
    found = interval(table)
    assert found["mean"] == pytest.approx(0.5 * (table[:, 0].mean() + np.nanmean(table[:, 1])))
    assert found["low"] <= found["mean"] <= found["high"]
    assert found["pairs"] == 12


@pytest.mark.parametrize("draws", [6, 25])
def test_intervals_over_scenarios_cover_the_truth_about_as_often_as_they_say(draws):
    rng = np.random.default_rng(draws)
    hits = 0
    for _ in range(120):
        shared = rng.normal(0.0, 1.0, (draws, 1))
        found = interval(rng.normal([1.0, 3.0], [1.0, 4.0], (draws, 2)) + shared)
        hits += found["low"] <= 2.0 <= found["high"]
    assert 0.85 <= hits / 120 <= 0.995
