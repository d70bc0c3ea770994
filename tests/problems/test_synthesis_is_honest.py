"""No gains without their status; optima hold against other methods; infeasibility is proved or not claimed."""

from dataclasses import replace

import numpy as np
import pytest

from design.analysis.obstacles import obstacles
from design.analysis.recheck import second_opinion
from design.analysis.verdict import judge
from design.errors import BadInput, Unsolved
from design.model.environment import slope
from design.model.laws import Gains
from design.model.limits import Required
from design.solvers.outcome import Status
from design.spec.load import load
from design.spec.setting import setting
from problems import gains as question

SLOPE = setting(load("slope").spec)


def _needs(problem, **levels):
    return replace(
        problem, required={**problem.required, **{k.replace("_", "-"): Required(level=v) for k, v in levels.items()}}
    )


def test_a_specification_without_bounds_is_refused():
    with pytest.raises(BadInput, match=r"synthesis\.bounds"):
        question.solve(replace(SLOPE, bounds=None))


def test_an_answer_that_is_not_solved_has_no_value():
    answer = question.solve(_needs(SLOPE, contact_force=300.0))
    assert answer.outcome.status is Status.INFEASIBLE
    with pytest.raises(Unsolved):
        _ = answer.outcome.value


@pytest.mark.slow
def test_out_of_reach_without_proof_names_what_stands_in_the_way():
    answer = question.solve(_needs(SLOPE, contact_force=200.0))
    assert answer.outcome.status is Status.NOT_FOUND
    assert {row.id for row in answer.missed} == {"toe-force", "heel-force"}
    missed = max(-row.margin for row in answer.missed)
    assert missed == pytest.approx(200.0 - 190.9948, abs=0.1)  # the nearest miss is the greatest contact force


@pytest.mark.parametrize(
    ("levels", "named"),
    [
        ({"contact_force": 250.0}, "contact-force"),
        ({"decay_rate": 12.2}, "decay-rate"),
        ({"cop_margin": 0.11}, "cop-margin"),
        ({"step_slope": 7.62}, "step-slope"),
        ({"push": 9.1}, "push"),
    ],
)
def test_proved_obstacles_name_the_requirement(levels, named):
    assert [each.id for each in obstacles(_needs(SLOPE, **levels))] == [named]


def test_an_obstacle_is_never_raised_just_inside_the_best_that_is_known():
    assert not obstacles(_needs(SLOPE, decay_rate=12.185))
    assert not obstacles(_needs(SLOPE, contact_force=190.99))
    assert not obstacles(_needs(SLOPE, step_slope=7.6, push=9.0))


def test_a_sudden_slope_beyond_capturability_is_infeasible_and_one_within_it_is_not_claimed():
    for degrees, blocked in ((7.7, True), (7.5, False)):
        step = slope(SLOPE.biped, name="step", angle=np.radians(degrees), ramp=0.0, duration=10.0)
        assert bool(obstacles(replace(SLOPE, scenarios=(step,)))) is blocked


def test_capturability_proof_holds_against_saturated_torque():
    # whatever torque keeps both forces >= 0, the body goes past the horizontal: try the best one, F_H = 0
    biped = SLOPE.biped
    alpha = np.radians(7.7)
    F_x, F_y = biped.M * biped.g * np.array([np.sin(alpha), 1 - np.cos(alpha)])
    theta, omega, h = 0.0, 0.0, 1e-3
    for _ in range(6000):
        # F_H = 0: tau = -ell (m g + f_y), with f_y affine in tau
        drive = (biped.M * biped.g - F_y) * biped.L * np.sin(theta) + F_x * biped.L * np.cos(theta)
        base = biped.M * biped.g - F_y - biped.M * biped.L * omega**2 * np.cos(theta)
        k = biped.M * biped.L * np.sin(theta) / biped.I
        tau = -biped.ell * (biped.m * biped.g + base - k * drive) / (1 - biped.ell * k)
        omega += h * (drive + tau) / biped.I
        theta += h * omega
        if theta > np.pi / 2:
            break
    assert theta > np.pi / 2


def test_a_lean_that_no_ankle_holds_is_proved_infeasible_and_the_scenario_is_named():
    ramp = replace(SLOPE.scenarios[0], theta0=np.radians(20.0))
    answer = question.solve(replace(SLOPE, scenarios=(ramp,)))
    assert answer.outcome.status is Status.INFEASIBLE
    assert answer.outcome.proof.physical
    assert "'ramp'" in answer.outcome.detail
    assert "20 deg" in answer.outcome.detail


def test_unstable_corner_is_proved_infeasible():
    weak = replace(SLOPE, bounds=np.array([[0.0, 360.0], [0.0, 1200.0], [0.0, 17.0]]))  # K_p < A L = 367.9
    answer = question.solve(weak)
    assert answer.outcome.status is Status.INFEASIBLE
    assert "stiffness" in answer.outcome.detail


def test_fixed_gains_are_kept():
    bounds = np.array([[3000.0, 3000.0], [900.0, 900.0], [0.0, 17.0]])
    found = question.solve(replace(SLOPE, bounds=bounds)).outcome.value
    assert found.gains.K_p == 3000.0
    assert found.gains.K_d == 900.0


def test_the_optimum_is_confirmed_by_an_integrator_that_shares_nothing():
    found = question.solve(SLOPE).outcome.value
    opinion = second_opinion(SLOPE.biped, "force", 0.0, found.gains, SLOPE.scenarios[0], SLOPE.step)
    assert min(opinion.F_T.min(), opinion.F_H.min()) == pytest.approx(found.value, abs=1e-4)


def test_no_neighbour_within_the_bounds_is_better():
    found = question.solve(SLOPE).outcome.value
    rng = np.random.default_rng(0)
    for size in (1e-4, 1e-3, 1e-2):
        for _ in range(8):
            K = np.array(found.gains) * (1 + size * rng.uniform(-1, 1, 3))
            K = np.clip(K, SLOPE.bounds[:, 0], SLOPE.bounds[:, 1])
            rows = judge(SLOPE, Gains(*K)).rows
            force = min(row.value for row in rows if row.id in ("toe-force", "heel-force"))
            assert force <= found.value + 1e-6


def test_a_time_limit_ends_it_undecided():
    answer = question.solve(SLOPE, seconds=0.05)
    assert answer.outcome.status.word == "undecided"


@pytest.mark.parametrize(
    ("scenario", "levels", "gains"),
    [
        ({"angle": np.radians(10.0), "duration": 0.05}, {}, Gains(400.0, 10.0, 0.001)),
        ({"angle": np.radians(12.0), "duration": 0.1}, {}, Gains(400.0, 10.0, 0.001)),
    ],
)
def test_what_some_gains_keep_is_not_called_impossible(scenario, levels, gains):
    short = slope(SLOPE.biped, name="short", ramp=0.0, **scenario)
    problem = _needs(replace(SLOPE, scenarios=(short,)), **levels)
    assert judge(problem, gains).overall == "met"
    assert not obstacles(problem)


@pytest.mark.slow
def test_a_loop_margin_out_of_reach_is_named():
    answer = question.solve(_needs(SLOPE, delay_margin=0.5))
    assert answer.outcome.status is Status.NOT_FOUND
    assert "delay-margin" in answer.outcome.detail


def test_a_law_with_an_integral_needs_bounds_for_its_gain():
    bounds = SLOPE.bounds.copy()
    bounds[2] = np.nan
    with pytest.raises(BadInput, match=r"bounds\.kf"):
        question.solve(replace(SLOPE, bounds=bounds))
