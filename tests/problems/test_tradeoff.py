"""A front between margins: its ends are the single optima, nothing beats it, and it is evenly spread."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from design.analysis.verdict import judge
from design.errors import BadInput
from design.model.laws import Gains
from design.model.limits import Required
from design.solvers.outcome import Status
from design.spec.load import load
from design.spec.setting import setting
from problems import gains
from problems.gains import Grid, Point, Question, question_decay
from problems.tradeoff import margins, solve
from problems.tradeoff.gaps import Tried, gaps
from problems.tradeoff.margins import beats, cube, outside

SLOPE = setting(load("slope").spec)
BETWEEN = margins(["contact-force", "decay-rate"])


@pytest.fixture(scope="module")
def outcome():
    return solve(SLOPE, BETWEEN, points=9)


@pytest.fixture(scope="module")
def front(outcome):
    return outcome.value


def _least(verdict, id):
    ids = ("toe-force", "heel-force") if id == "contact-force" else (id,)
    return min(row.value for row in verdict.rows if row.id in ids)


def test_the_ends_are_the_single_optima(front):
    for id, at, k in zip(BETWEEN.ids, front.ends, (0, 1), strict=True):
        alone = gains.solve(replace(SLOPE, objective=id)).outcome.value.value
        assert front.designs[at].values[k] == pytest.approx(alone, rel=1e-4)
    assert front.ends == (0, 8)


def test_every_point_is_a_design_that_the_report_accepts(front):
    assert len(front.designs) == 9
    for each in front.designs:
        verdict = judge(SLOPE, each.gains, also=BETWEEN.ids)
        assert verdict.overall == "met"
        assert each.values.tolist() == [_least(verdict, id) for id in BETWEEN.ids]
        assert all(low <= gain <= high for gain, (low, high) in zip(each.gains, SLOPE.bounds, strict=True))


def test_along_the_front_one_margin_is_traded_for_the_other(front):
    values = np.array([each.values for each in front.designs])
    assert (np.diff(values[:, 0]) < 0).all()
    assert (np.diff(values[:, 1]) > 0).all()  # hence no point is as good as another in both


def test_the_points_are_evenly_spread(front):
    lengths = np.linalg.norm(np.diff(front.u, axis=0), axis=1)
    assert lengths.max() < 3 * np.median(lengths)


def test_a_known_point_lies_on_the_front(front):
    # independent code: with 180 N under toe and heel 8.4451 1/s at best
    values = np.array([each.values for each in front.designs])[::-1]
    assert np.interp(180.0, values[:, 0], values[:, 1]) == pytest.approx(8.4451, abs=0.05)


def test_no_gains_of_the_box_beat_a_point_in_both_margins(front):
    draw = np.random.default_rng(5)
    low, high = SLOPE.bounds.T
    anywhere = draw.uniform(low, high, (150, 3))
    near = np.array([front.designs[k].gains for k in draw.integers(0, 9, 150)]) * draw.normal(1.0, 0.03, (150, 3))
    question = Question(replace(SLOPE, objective="contact-force"))
    goal = question.goal("contact-force")
    grid = Grid(question, question.coarse_step, goal)
    values = np.array([each.values for each in front.designs])
    looked = 0
    for K in np.clip(np.vstack([anywhere, near]), np.maximum(low, 1e-3 * high), high):
        rows = grid.margins(Point(gains=K, v=0.0))
        decay = question_decay(question, K)
        if rows is None or decay <= 0:
            continue
        contact = goal.scale * min(float(each.min()) for each in rows)  # toe and heel are the only rows
        looked += contact > 0
        assert not ((contact > 1.001 * values[:, 0]) & (decay > 1.001 * values[:, 1])).any()
    assert looked > 150


def test_the_paper_s_own_gains_are_beaten(front):
    assert front.own.met
    assert front.own.values == pytest.approx([29.5417, 1.40038], rel=1e-4)
    assert (front.designs[front.own.beaten].values > front.own.values).all()


def test_the_front_of_the_readme_is_what_is_found(front):
    readme = (Path(__file__).resolve().parents[2] / "README.md").read_text(encoding="utf-8")
    section = readme.split("## What one margin costs in another\n")[1].split("\n## ")[0]
    shown = np.array(
        [[float(x) for x in line.split()[1:6]] for line in re.findall(r"^    \d .*$", section, re.MULTILINE)]
    )
    found = np.array([[*each.values, *each.gains] for each in front.designs])
    assert shown == pytest.approx(found, rel=1e-5)
    assert f"    {front.knee[0] + 1} " in next(line for line in section.splitlines() if line.endswith("knee"))
    (first, last), said = np.abs(np.diff(found[:, :2], axis=0))[[0, -1]], " ".join(section.split())
    assert round(first[0], 1) == 0.2
    assert f"The first fifth of a newton buys {first[1]:.2f} 1/s, the last {last[0]:.2f} N only {last[1]:.2f}" in said
    own = front.own.values
    assert f"own gains, {own[0]:.1f} N and {own[1]:.2f} 1/s, are beaten in both by all nine" in said
    assert (found[:, :2] > own).all()


def test_the_knee_is_farthest_outside_of_the_chord(front):
    knee, distance = front.knee
    from_chord = (front.u.sum(axis=1) - 1) / np.sqrt(2)
    assert knee == int(np.argmax(from_chord))
    assert distance == pytest.approx(from_chord[knee])


def test_out_of_reach_is_proved_and_a_time_limit_is_told():
    high = replace(SLOPE, required={**SLOPE.required, "contact-force": Required(level=300.0)})
    assert solve(high, BETWEEN).status is Status.INFEASIBLE
    late = solve(SLOPE, BETWEEN, seconds=0.01)
    assert late.status is Status.TIME_LIMIT
    assert late.found is None


def test_where_one_design_is_best_in_both_the_front_is_a_point():
    # with one gain vector alone within the bounds nothing can be traded
    only = np.array([[3500.0, 3500.0], [900.0, 900.0], [8.0, 8.0]])
    found = solve(replace(SLOPE, bounds=only), BETWEEN).value
    assert [tuple(each.gains) for each in found.designs] == [(3500.0, 900.0, 8.0)]
    assert found.knee is None


@pytest.mark.slow
def test_what_should_be_small_may_be_a_margin_and_three_may_be():
    which = margins(["contact-force,decay-rate", "torque"])
    found = solve(SLOPE, which, points=10).value
    values = np.array([each.values for each in found.designs]) * which.signs
    assert len(values) == 10
    assert not any(beats(one, other, 1e-6) for one in values for other in values)
    for k, (id, at) in enumerate(zip(which.ids, found.ends, strict=True)):
        alone = gains.solve(replace(SLOPE, objective=id)).outcome.value.value
        assert found.designs[at].values[k] == pytest.approx(alone, rel=1e-4)
        assert values[at, k] == values[:, k].max()


@pytest.mark.slow
def test_a_disturbance_that_is_survived_may_be_a_margin():
    step = setting(load("slope-step").spec)
    found = solve(step, margins(["step-slope", "decay-rate"]), points=5).value
    assert found.unsolved == 0
    assert (np.diff(found.u, axis=0)[:, 0] < 0).all()


def test_a_required_slope_is_met_as_the_report_counts_it():
    step = setting(load("slope-step").spec)
    needs = {**step.required, "step-slope": Required(level=5.0)}
    found = gains.solve(replace(step, objective="decay-rate", required=needs), starts=1).outcome.value
    row = next(row for row in found.verdict.rows if row.id == "step-slope")
    assert 5.0 <= row.value < 5.003


def test_gaps_are_halved_from_the_widest_on_and_not_where_no_design_lies():
    u = np.array([[1.0, 0.0], [0.9, 0.6], [0.0, 1.0]])
    widest, other = gaps(u, Tried())
    assert (widest.i, widest.j, widest.best, widest.levels) == (2, 1, 1, {0: pytest.approx(0.45)})
    assert (other.best, other.levels) == (0, {1: pytest.approx(0.3)})
    tried = Tried(empty=[(0, 0.45, 0.9)])  # the best above 0.45 is the point at 0.9
    again = next(gap for gap in gaps(u, tried) if gap.i == 2)
    assert again.levels == {0: pytest.approx(0.225)}
    assert again.length == pytest.approx(0.5 * widest.length)
    for _ in range(2):
        tried.fail(u, again)
    assert all(gap.i != 2 for gap in gaps(u, tried))


def test_three_margins_are_triangulated_and_the_longest_edge_comes_first():
    u = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.5, 0.5, 0.0]])
    found = gaps(u, Tried())
    assert {frozenset((gap.i, gap.j)) for gap in found} >= {frozenset((0, 2)), frozenset((1, 2)), frozenset((2, 3))}
    assert found[0].length == pytest.approx(np.sqrt(2))
    assert len(found[0].levels) == 2


def test_the_cube_turns_what_should_be_small():
    found = cube(np.array([1.0, -1.0]), np.array([[10.0, 8.0], [4.0, 2.0]]), [1.0, 1.0])
    assert found.of(np.array([[10.0, 8.0], [4.0, 2.0]])).tolist() == [[1.0, 0.0], [0.0, 1.0]]
    assert found.value(1, 0.25) == pytest.approx(6.5)
    assert outside(np.array([[0.8, 0.8]]), np.eye(2))[0] == pytest.approx(0.6 / np.sqrt(2))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["contact-force"], "names 1"),
        ([], "names 0"),
        (["contact-force", "contact-force"], "twice"),
        (["contact-force", "grace"], "'grace'"),
        (["contact-force,"], "''"),
        (["routh-margin", "decay-rate"], "'routh-margin'"),
        (["torque", "decay-rate", "contact-force", "cop-margin"], "names 4"),
    ],
)
def test_margins_that_cannot_be_are_refused_with_those_that_can(words, said):
    with pytest.raises(BadInput, match=said):
        margins(words)


def test_gains_are_a_record_of_three(front):
    assert all(isinstance(each.gains, Gains) for each in front.designs)
