"""The next trial is better where the world stays, and is not started from the estimate where the world is another.

The equations of the paper are written out here and integrated by SciPy, so that no number is only remembered.
"""

import math
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from design.analysis.contraction import contraction
from design.analysis.leftover import factor
from design.analysis.simulate import simulate
from design.analysis.transient import transient
from design.errors import BadInput
from design.model.closed_loop import closed_loop
from design.model.environment import constant_force, slope
from design.model.laws import Gains
from design.model.sensing import Sensors
from design.model.uncertainty import Spread, Tolerances
from design.spec.load import load
from design.spec.setting import setting
from problems.trials import conduct
from problems.trials.series import plans, run
from problems.trials.start import TOLERANCE, standing
from problems.trials.survives import change

STEP, RAMP = (setting(load(name).spec) for name in ("slope-step", "slope"))
BIPED, GAINS = STEP.biped, STEP.gains
BLOWS = constant_force(name="blows", F_x=25.0, F_y=0.0, ramp=0.0, duration=10.0)
WIND = replace(STEP, scenarios=(BLOWS,))
CHANGING = replace(
    STEP,
    scenarios=tuple(
        slope(BIPED, name=name, angle=math.radians(angle), ramp=0.0, duration=8.0)
        for name, angle in (("three", 3.0), ("six", 6.0), ("other", -3.0), ("same", 3.0))
    ),
)


def _on_slope(alpha):
    return BIPED.M * BIPED.g * np.sin(alpha), BIPED.M * BIPED.g * (1 - np.cos(alpha))


@lru_cache(maxsize=64)
def _run(force, theta_d, T=10.0, K=GAINS):
    """t, theta and the contact forces of law (8) by (2), (5)-(10), from rest at theta_d; ``force(t)`` or a constant."""
    M, L, I, m, ell, g = BIPED.M, BIPED.L, BIPED.I, BIPED.m, BIPED.ell, BIPED.g

    def everything(t, theta, omega, s):
        F_x, F_y = force(t) if callable(force) else force
        tau = -K.K_d * omega + K.K_p * (theta_d - theta) + K.K_f * s
        turn = ((M * g - F_y) * L * np.sin(theta) + F_x * L * np.cos(theta) + tau) / I
        f_y = -M * L * turn * np.sin(theta) - M * L * omega**2 * np.cos(theta) + M * g - F_y
        return turn, -tau / (2 * ell) + m * g / 2 + f_y / 2, tau / (2 * ell) + m * g / 2 + f_y / 2

    def rate(t, z):
        turn, F_T, F_H = everything(t, *z)
        return [z[1], turn, F_H - F_T]

    found = solve_ivp(rate, (0.0, T), [theta_d, 0.0, 0.0], method="LSODA", rtol=1e-9, atol=1e-12, max_step=0.01)
    _, F_T, F_H = everything(found.t, *found.y)
    return found.t, found.y[0], np.minimum(F_T, F_H)


def _settled(t, theta, theta_f, band):
    outside = np.flatnonzero(np.abs(theta - theta_f) > band)
    return 0.0 if not len(outside) else float(t[outside[-1]])


@pytest.mark.parametrize("problem", [STEP, WIND], ids=["slope-step", "wind that already blows"])
def test_the_second_trial_keeps_more_contact_and_settles_sooner(problem):
    facts = conduct(problem, trials=2).facts
    first, second = facts["trials"]
    force = tuple(problem.scenarios[0].force_at(np.zeros(1))[:, 0].tolist())
    theta_f = math.atan2(-force[0], BIPED.M * BIPED.g - force[1])
    t, theta, contact = _run(force, 0.0)
    band = 0.02 * np.abs(theta - theta_f).max()
    assert first["contact_force_n"] == pytest.approx(contact.min(), abs=1e-2)
    assert first["settling_s"] == pytest.approx(_settled(t, theta, theta_f, band), abs=0.012)
    assert second["start"] == "the last estimate"
    assert second["desired_angle_deg"] == second["start_angle_deg"] == pytest.approx(math.degrees(theta[-1]), abs=1e-5)
    t, again, contact_again = _run(force, float(theta[-1]))
    assert second["contact_force_n"] == pytest.approx(contact_again.min(), abs=1e-2)
    assert second["settling_s"] == pytest.approx(_settled(t, again, theta_f, band), abs=0.012)
    assert second["contact_force_n"] > first["contact_force_n"] + 90.0
    assert second["settling_s"] < first["settling_s"] - 2.0
    assert second["transient_deg"] < 1e-4 * first["transient_deg"]
    rest = 0.5 * (BIPED.weight - force[1])  # what both ends bear at rest: there is no more to be had
    assert second["contact_force_n"] == pytest.approx(rest, abs=1e-2)


def test_the_first_trial_is_that_of_simulate_and_of_the_report():
    facts = conduct(STEP, trials=1).facts["trials"][0]
    loop = closed_loop(BIPED, "force")
    alone = simulate(loop, STEP.scenarios[0], GAINS, STEP.step)
    approach = transient(loop, STEP.scenarios[0], alone)
    assert facts["contact_force_n"] == min(alone.F_T.min(), alone.F_H.min())
    assert facts["settling_s"] == approach.settling
    assert facts["overshoot_deg"] == math.degrees(approach.overshoot)


def test_errors_go_down_by_rho_from_trial_to_trial():
    short = replace(STEP, scenarios=(replace(STEP.scenarios[0], duration=1.2),))
    series = run(short, GAINS, short.scenarios * 4, seed=0)
    e = [trial.start.theta0 - trial.theta_f for trial in series.trials]
    rho = factor(BIPED, "force", GAINS, BIPED.M * BIPED.g, BIPED.weight, 1.2)
    assert 0.1 < abs(rho) < 0.5
    for before, after in pairwise(e):
        assert after / before == pytest.approx(rho, rel=1e-3)
    assert not series.trials[0].reading.stationary
    assert series.trials[1].start.estimated  # it does not rest, but is nearer


def test_on_the_ramp_trial_two_is_not_started_at_minus_30_degrees_and_the_cost_is_said():
    first, second = conduct(RAMP, trials=2).facts["trials"]
    assert first["posture_error_deg"] < 0.01
    assert second["start"] == "as the spec says"
    assert second["start_angle_deg"] == second["desired_angle_deg"] == 0.0
    assert "-30.00 deg" in second["reason"]
    assert "the world's at the start is 0.00 deg" in second["reason"]
    standing = BIPED.M * BIPED.g * BIPED.L * math.sin(math.radians(30.0))
    assert standing > BIPED.ell * BIPED.weight
    assert (
        f"would take {standing:.3g} N m, and the foot can give {BIPED.ell * BIPED.weight:.3g} N m" in second["reason"]
    )
    assert second["contact_force_n"] == first["contact_force_n"]
    refused = second["refused"]
    assert refused["desired_angle_deg"] == pytest.approx(-30.0, abs=0.01)
    _, _, contact = _run(lambda t: _on_slope(np.radians(np.minimum(6.0 * t, 30.0))), math.radians(-29.99607471), 1.0)
    assert contact.min() < 0 < first["contact_force_n"]
    assert refused["contact_force_n"] == pytest.approx(contact.min(), rel=1e-3)
    assert refused["lost_contact"]["at"] == "toe"
    assert refused["lost_contact"]["time_s"] < 0.01


def test_blind_trials_pay_it():
    facts = conduct(RAMP, trials=2, blind=True).facts
    _, second = facts["trials"]
    assert second["start"] == "the last estimate"
    assert second["blindly"]
    assert second["lost_contact"] is not None
    assert facts["verdict"] == "violated"


def test_wind_that_grows_from_nothing_is_a_world_that_starts_anew():
    grows = replace(STEP, scenarios=(constant_force(name="g", F_x=60.0, F_y=0.0, ramp=2.0, duration=10.0),))
    second = conduct(grows, trials=2).facts["trials"][1]
    assert second["start"] == "as the spec says"
    assert second["refused"]["contact_force_n"] < second["contact_force_n"]


@pytest.fixture(scope="module")
def changed():
    return conduct(CHANGING, sequence="three,six,other,same").facts


def test_what_a_changed_slope_costs_is_what_the_equations_say(changed):
    for after, was, alpha in ((1, 3.0, 6.0), (2, 6.0, -3.0), (3, -3.0, 3.0)):
        refused = changed["trials"][after]["refused"]
        assert changed["trials"][after]["start"] == "as the spec says"
        begun = math.radians(refused["desired_angle_deg"])
        assert begun == pytest.approx(-math.radians(was), abs=1e-5)
        _, _, contact = _run(_on_slope(math.radians(alpha)), begun, 3.0)
        assert refused["contact_force_n"] == pytest.approx(contact.min(), abs=0.05)
        assert (refused["lost_contact"] is not None) == (contact.min() < 0)


def test_a_slope_of_the_other_sign_is_survived_from_level_ground_but_not_from_the_estimate(changed):
    other = changed["trials"][2]
    assert other["lost_contact"] is None
    assert other["refused"]["lost_contact"] is not None
    assert "nearer" not in other["reason"]


def test_where_the_estimate_is_nearer_than_the_spec_it_is_said(changed):
    steeper = changed["trials"][1]
    assert "nearer than the spec's" in steeper["reason"]
    assert steeper["refused"]["contact_force_n"] > steeper["contact_force_n"]


def test_what_the_law_survives_is_the_end_of_what_the_equations_survive(changed):
    assert [each["next"] for each in changed["survives"]] == ["six", "other", "same", None]
    assert changed["survives"][3]["kept_from_the_estimate"] is None
    for each in changed["survives"][:2]:
        start = math.radians(each["from"])
        for end in ("up", "down"):
            kept, lost = (_on_slope(start + math.radians(part * each[end])) for part in (0.99, 1.01))
            assert _run(kept, -start, 3.0)[2].min() > 0
            assert _run(lost, -start, 3.0)[2].min() < 0
        assert each["up"] != pytest.approx(-each["down"], rel=1e-3)  # on inclined ground they are not alike
        assert each["kept_from_the_estimate"] == (each["next"] == "six")
    change_asked = 6.0 - 3.0, -3.0 - 6.0
    for each, asked in zip(changed["survives"][:2], change_asked, strict=True):
        assert each["kept_from_the_estimate"] == (each["down"] <= asked <= each["up"])


def test_of_wind_the_largest_change_survived_is_a_force():
    found = change(closed_loop(BIPED, "force", math.atan2(-25.0, BIPED.M * BIPED.g)), GAINS, BLOWS, 2e-3)
    start = math.atan2(-25.0, BIPED.M * BIPED.g)
    assert not found.slope
    for size in (found.up, found.down):
        assert _run((25.0 + 0.99 * size, 0.0), start, 3.0)[2].min() > 0
        assert _run((25.0 + 1.01 * size, 0.0), start, 3.0)[2].min() < 0


def test_the_next_theta_d_is_the_last_angle_whatever_body_it_was():
    wide = replace(STEP, tolerances=Tolerances(M=Spread(part=0.1), L=Spread(part=0.1), ell=Spread(absolute=0.01)))
    for seed in (1, 2):
        series = run(wide, GAINS, wide.scenarios * 3, seed=seed)
        assert series.biped.M != BIPED.M
        for before, after in pairwise(series.trials):
            assert after.biped is before.biped
            assert after.start.estimated
            assert after.start.theta_d == before.run.theta[-1]
            assert abs(before.reading.F[0] - before.run.F[0, -1]) <= before.reading.bound[0] * (1 + 1e-6)
            assert abs(before.reading.F[1] - before.run.F[1, -1]) <= before.reading.bound[1] * (1 + 1e-6)
        last = series.trials[-1]
        assert last.start.theta_d == pytest.approx(-math.radians(3.0), abs=1e-9)
        assert abs(last.reading.F[1] - last.run.F[1, -1]) > 1.0  # the force is off, the posture is not


def test_noise_moves_the_start_no_farther_than_its_stated_error():
    noisy = replace(STEP, sensors=Sensors(angle=math.radians(0.2), rate=0.01, force=5.0))
    outside = 0
    for seed in range(10):
        series = run(noisy, GAINS, (replace(STEP.scenarios[0], duration=6.0),) * 2, seed=seed)
        first, second = series.trials
        assert second.start.estimated
        away = abs(second.start.theta_d + math.radians(3.0))
        assert away > 0
        outside += away > first.reading.error
    assert outside <= 3  # two standard deviations


def test_toe_and_heel_tell_the_world_s_posture_to_who_stands_in_another():
    rng = np.random.default_rng(0)
    for F_x, F_y, theta in ((25.0, 0.0, 0.02), (-40.0, 30.0, 0.05), (10.0, -60.0, -0.06)):
        theta_f = math.atan2(-F_x, BIPED.M * BIPED.g - F_y)
        found, said = standing(STEP, BIPED, np.array([F_x, F_y]), theta, rng)
        assert found == pytest.approx(theta_f, abs=1e-12)
        assert "toe and heel say" in said
    noisy = replace(STEP, sensors=Sensors(angle=math.radians(0.1), force=3.0))
    found, _ = standing(noisy, BIPED, np.array([25.0, 0.0]), 0.0, rng)
    assert found != pytest.approx(theta_f, abs=1e-9)
    assert found == pytest.approx(math.atan2(-25.0, BIPED.M * BIPED.g), abs=math.radians(0.1))


def test_the_same_seed_gives_the_same_trials_and_another_seed_others():
    noisy = replace(STEP, sensors=Sensors(angle=math.radians(0.2)), tolerances=Tolerances(M=Spread(part=0.05)))
    one, same, other = (run(noisy, GAINS, STEP.scenarios * 2, seed=seed).trials[1].start.theta_d for seed in (4, 4, 5))
    assert one == same != other


def test_a_trial_that_lost_contact_tells_the_next_one_nothing():
    fatal = slope(BIPED, name="three", angle=math.radians(9.0), ramp=0.0, duration=8.0)
    steep = replace(STEP, scenarios=(fatal,))
    first, second = run(steep, GAINS, steep.scenarios * 2, seed=0).trials
    assert not first.kept
    assert first.reading is None
    assert not second.start.estimated
    assert "trial 1 lost contact at the heel" in second.start.why


def test_pd_ends_where_it_does_not_rest_in_balance_and_is_not_believed():
    pd = STEP.with_law("pd", GAINS)
    facts = conduct(pd, trials=2).facts
    first, second = facts["trials"]
    assert not first["stationary"]
    assert abs(first["fx_error_n"]) <= first["fx_bound_n"] * (1 + 1e-6)
    assert second["start"] == "as the spec says"
    assert not facts["contraction"]["contracts"]


def test_trials_go_on_with_a_law_that_adapts():
    own = replace(STEP, adapt=1.0)
    first, second = run(own, GAINS, STEP.scenarios * 2, seed=0).trials
    assert second.start.estimated
    least = [min(trial.run.F_T.min(), trial.run.F_H.min()) for trial in (first, second)]
    assert least[1] > least[0] + 90.0
    adapting, fixed = (contraction(problem, GAINS, STEP.scenarios) for problem in (own, STEP))
    assert adapting.contracts
    assert adapting.factor > 10 * fixed.factor  # theta_d of the start is left more slowly


def test_a_start_within_the_tolerance_is_no_other_world():
    for extra, used in ((0.5, True), (2.0, False)):
        angle = math.radians(3.0) + extra * TOLERANCE
        pair = (STEP.scenarios[0], slope(BIPED, name="b", angle=angle, ramp=0.0, duration=1.0))
        second = run(replace(STEP, scenarios=pair), GAINS, pair, seed=0).trials[1]
        assert second.start.estimated == used


@pytest.mark.parametrize("kind", ["cop", "force"])
def test_the_integral_at_the_start_is_that_of_14(kind):
    own = STEP.with_law(kind, Gains(3500.0, 1200.0, 1.0))
    second = run(own, own.gains, own.scenarios * 2, seed=0).trials[1]
    start = second.start
    assert start.s0 == own.gains.K_p / own.gains.K_f * (start.theta0 - start.theta_d) == 0.0
    assert abs(second.run.tau).max() < 1e-3  # nothing is left to be done


@pytest.mark.parametrize(
    "asked", [{"sequence": "three,seven"}, {"sequence": "three,six", "trials": 3}, {"scenario": "no"},
              {"sequence": "three", "scenario": "three"}]
)  # fmt: skip
def test_what_cannot_be_run_is_bad_input(asked):
    with pytest.raises(BadInput):
        plans(CHANGING, asked.get("trials"), asked.get("scenario"), asked.get("sequence"))
