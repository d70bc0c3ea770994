"""Every row of the report as objective or requirement: no neighbour is better, and goals balance."""

import math
from dataclasses import replace

import numpy as np
import pytest

from design.analysis.objectives import OBJECTIVES
from design.analysis.verdict import judge
from design.errors import BadInput
from design.model.broken_loop import breaks
from design.model.laws import Gains
from design.model.limits import Required
from design.model.margins import loop_margins, margin_pieces, near_crossings
from design.spec.load import load
from design.spec.setting import setting
from problems import gains, sensitivity
from problems.gains import Question, solve

SLOPE = replace(setting(load("slope").spec), step=0.002)


def _with(objective, **levels):
    wanted = {name.replace("_", "-"): level for name, level in levels.items()}
    required = {name: level if isinstance(level, Required) else Required(level=level) for name, level in wanted.items()}
    return replace(SLOPE, objective=objective, required={**SLOPE.required, **required})


@pytest.mark.parametrize(
    "problem",
    [
        _with("disk-margin", contact_force=100.0),
        _with("phase-margin", contact_force=100.0, decay_rate=6.0),
        pytest.param(_with("delay-margin", contact_force=150.0), marks=pytest.mark.slow),
        _with("torque", decay_rate=6.0),
        _with("step-slope", contact_force=60.0),
        pytest.param(_with("torque-rate", decay_rate=4.0), marks=pytest.mark.slow),
        pytest.param(_with("push", contact_force=60.0), marks=pytest.mark.slow),
        pytest.param(_with("sample-time", contact_force=150.0), marks=pytest.mark.slow),
        pytest.param(_with("overshoot", contact_force=100.0), marks=pytest.mark.slow),
        pytest.param(_with("settling", contact_force=185.0), marks=pytest.mark.slow),
        pytest.param(_with("gain-margin-down", contact_force=150.0, phase_margin=50.0), marks=pytest.mark.slow),
    ],
    ids=lambda problem: problem.objective,
)
def test_no_neighbour_is_better(problem):
    found = solve(problem).outcome.value
    question = Question(problem)
    goal = question.goal(problem.objective)
    rng = np.random.default_rng(0)
    assert found.verdict.overall == "met"
    for size in (1e-3, 1e-2, 5e-2):
        for _ in range(6):
            K = np.clip(
                np.array(found.gains) + size * question.scale * rng.standard_normal(3), question.lower, question.upper
            )
            verdict = judge(problem, Gains(*K), also=(problem.objective,))
            if verdict.overall == "met":
                assert goal.v(question.score(goal, Gains(*K), verdict)) <= goal.v(found.value) + 1e-4


@pytest.mark.parametrize(
    "levels",
    [
        pytest.param({"delay_margin": 0.05}, marks=pytest.mark.slow),
        {"disk_margin": 1.3, "phase_margin": 70.0},
        {"step_slope": 5.0},
        pytest.param({"torque_rate": 60.0}, marks=pytest.mark.slow),
        pytest.param({"sample_time": 0.15}, marks=pytest.mark.slow),
    ],
)
def test_a_requirement_of_any_kind_is_kept_and_costs(levels):
    free = solve(_with("contact-force")).outcome.value
    found = solve(_with("contact-force", **levels)).outcome.value
    assert found.verdict.overall == "met"
    assert found.value < free.value
    rows = {row.id: row for row in judge(_with("contact-force", **levels), found.gains).rows}
    assert min(abs(rows[name.replace("_", "-")].margin / level) for name, level in levels.items()) < 1e-3  # it binds


@pytest.mark.slow
def test_a_requirement_that_is_kept_anyway_costs_nothing():
    problem = _with("contact-force", decay_rate=4.0)
    free = solve(problem).outcome.value
    ids = ("delay-margin", "sample-time", "overshoot", "torque-rate")
    rows = {row.id: row for row in judge(problem, free.gains, also=ids).rows}
    for id in ids:
        loose = rows[id].value * (0.8 if OBJECTIVES[id].sign > 0 else 1.25)
        level = {id: Required(level=loose)}
        found = solve(replace(problem, required={**problem.required, **level})).outcome.value
        assert found.value >= free.value - 1e-6 * problem.biped.weight


def test_goals_are_met_when_below_one_and_the_worst_ones_are_alike():
    wishes = {"contact_force": Required(level=120.0, soft=True), "decay_rate": Required(level=9.0, soft=True),
              "torque": Required(level=12.0, soft=True)}  # fmt: skip
    found = solve(_with("goals", **wishes)).outcome.value
    rows = {row.id: row for row in found.verdict.rows}
    sizes = sorted(
        1 - OBJECTIVES[id].sign * (rows[row].value - level) / level
        for id, row, level in (
            ("contact-force", "toe-force", 120.0), ("contact-force", "heel-force", 120.0),
            ("decay-rate", "decay-rate", 9.0), ("torque", "torque", 12.0),
        )
    )  # fmt: skip
    assert found.value == pytest.approx(sizes[-1], abs=1e-6)
    assert sizes[-2] == pytest.approx(sizes[-1], abs=1e-4)
    assert (found.value < 1) == all(
        rows[row].margin >= 0 for row in ("toe-force", "heel-force", "decay-rate", "torque")
    )


def test_goals_need_a_soft_requirement():
    with pytest.raises(BadInput, match="soft"):
        solve(_with("goals"))


@pytest.mark.slow
def test_a_gain_can_be_made_small():
    found = solve(_with("kp", contact_force=150.0)).outcome.value
    assert found.value == found.gains.K_p < 3500
    less = SLOPE.bounds.copy()
    less[0, 1] = 0.995 * found.value
    assert solve(replace(_with("contact-force", contact_force=150.0), bounds=less)).outcome.found is None


def test_multipliers_say_what_seeking_again_finds():
    problem = _with("contact-force", decay_rate=8.0)
    answer = sensitivity.checked(problem, solve(problem))
    prices = {price.id: price for price in answer.outcome.value.prices}
    assert {"decay-rate", "kp"} <= set(prices)
    for price in prices.values():
        assert price.solved == pytest.approx(price.change, rel=0.05, abs=2e-3)
    assert prices["decay-rate"].change < 0 < prices["kp"].change


# ---- margins in pieces


def test_margins_are_the_worst_of_their_pieces():
    A = 50 * 9.81
    for K in (Gains(3500.0, 902.6, 8.457), Gains(900.0, 120.0, 1.0), Gains(548.85, 435.31, 2.0097)):
        pieces, its = (
            margin_pieces(SLOPE.biped, "force", K, A, 491.48),
            loop_margins(SLOPE.biped, "force", K, A, 491.48),
        )
        assert its.delay == min(value for _, value in pieces["delay-margin"])
        assert its.disk == min(value for _, value in pieces["disk-margin"])
        assert its.phase == min(value for _, value in pieces["phase-margin"])


def test_where_a_gap_closes_the_delay_margin_jumps():
    """Along a line of gains on which |L| begins to cross 1 at another frequency."""
    A = 50 * 9.81

    def gap(K_d):
        K = Gains(548.85, K_d, 2.0097)
        at = breaks(SLOPE.biped, "force", K, A, 491.48)["actuator"]
        return min((gap for _, _, gap in near_crossings(at)), default=math.nan), K

    below, above = 434.0, 437.0
    (first, _), (last, _) = gap(below), gap(above)
    assert first * last < 0
    for _ in range(50):
        middle = 0.5 * (below + above)
        below, above = (middle, above) if gap(middle)[0] * first > 0 else (below, middle)
    delays = [
        loop_margins(SLOPE.biped, "force", Gains(548.85, K_d, 2.0097), A, 491.48).delay
        for K_d in (below - 1e-6, above + 1e-6)
    ]
    assert max(delays) > 1.3 * min(delays)


def test_one_start_near_an_optimum_reaches_it():
    best = solve(_with("contact-force")).outcome.value
    start = gains.Point(gains=Gains(*(1.02 * np.array(best.gains) * [0.97, 1, 1])), v=0.3)
    assert solve(_with("contact-force"), near=start).outcome.value.value == pytest.approx(best.value, rel=1e-6)
