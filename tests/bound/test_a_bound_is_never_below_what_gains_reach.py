"""No gains of a box do better than its bound: random gains, other searches, closed forms; and time narrows the gap."""

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from design.analysis.synthesis import Synthesis
from design.analysis.verdict import judge
from design.errors import BadInput
from design.model.laws import Gains
from design.model.limits import Required
from design.model.stability import decay_rate
from design.spec.load import load
from design.spec.setting import setting
from problems import bound
from problems import gains as question
from problems.bound.branch import Boxes, Exclusion, _split, _tightened
from problems.bound.course import CORNERS, Course
from problems.bound.relax import Quadratics, greatest, smallest_row

SLOPE = setting(load("slope").spec)
part = st.floats(0.0, 1.0)


def _random_rows(rng, rows=5):
    return Quadratics(rng.normal(size=(1, rows)) - 1, rng.normal(size=(1, rows, 3)), rng.normal(size=(1, rows, 6)))


def _at(rows, d):
    square = 0.5 * d**2
    cross = np.stack([d[:, 0] * d[:, 1], d[:, 0] * d[:, 2], d[:, 1] * d[:, 2]], axis=1)
    return rows.f[0] + d @ rows.g[0].T + np.concatenate([square, cross], axis=1) @ rows.H[0].T


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_a_quadratic_is_nowhere_above_its_greatest(seed):
    rng = np.random.default_rng(seed)
    rows = _random_rows(rng)
    values = _at(rows, rng.uniform(-1, 1, (500, 3)))
    assert (values <= greatest(rows.f, rows.g, rows.H)[0] + 1e-12).all()


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_what_a_mixture_excludes_no_point_reaches(seed):
    rng = np.random.default_rng(seed)
    rows = _random_rows(rng)
    if smallest_row(rows)[0][0] < 0:
        assert _at(rows, rng.uniform(-1, 1, (2000, 3))).min(axis=1).max() < 0


def test_a_mixture_excludes_where_no_single_row_does():
    rows = Quadratics(np.array([[-0.1, -0.1]]), np.array([[[1.0, 0, 0], [-1.0, 0, 0]]]), np.zeros((1, 2, 6)))
    assert (greatest(rows.f, rows.g, rows.H) > 0).all()
    assert smallest_row(rows)[0][0] < 0


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_rows_over_a_part_of_a_box_are_the_same_rows(seed):
    rng = np.random.default_rng(seed)
    rows, centre, radius = _random_rows(rng), rng.uniform(-0.5, 0.5, (1, 3)), rng.uniform(0, 0.5, (1, 3))
    d = rng.uniform(-1, 1, (20, 3))
    assert np.allclose(_at(rows.onto(centre, radius), d), _at(rows, centre + radius * d))


@lru_cache(maxsize=8)
def _asked(name, objective):
    asked = question.Question(replace(setting(load(name).spec), objective=objective))
    grid = question.Grid(asked, asked.coarse_step, asked.goal(objective))
    return asked, grid, Exclusion(asked, grid.goal, Course(grid))


def _reached(asked, grid, K):
    """The v of gains K (3,), straight from the program's rows; -inf where a requirement is broken."""
    decay = question.question_decay(asked, K)
    if decay < asked.decay:
        return -math.inf
    margins = grid.margins(question.Point(gains=Gains(*K), v=0.0))
    if margins is None:
        return -math.inf
    if grid.goal.id == "decay-rate":
        return decay / asked.pace if min(rows.min() for rows in margins) >= 0 else -math.inf
    return min(rows[:2].min() for rows in margins)


@pytest.mark.slow
@settings(max_examples=25, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    st.sampled_from(["slope", "wind", "train", "slope-step"]),
    st.sampled_from(["contact-force", "decay-rate"]),
    st.tuples(part, part, part),
    st.tuples(part, part, part),
    st.integers(0, 2**32 - 1),
)
def test_no_gains_of_a_box_do_better_than_its_bound(name, objective, where, size, seed):
    asked, grid, test = _asked(name, objective)
    radius = 0.5 * 10.0 ** (-2.0 * np.array([size]))
    centre = radius + (1 - 2 * radius) * np.array([where])
    root = test.root(asked)
    box = replace(root, centre=centre, radius=radius)
    seen = test.course.look(centre, radius)
    box = replace(box, rows=seen.rows, most=np.array([1.0]), clear=seen.clear)
    low = -0.5
    kept = _tightened(test, box, low)
    most = kept.most[0] if len(kept) else low
    parts = _tightened(test, _split(box, np.ones((1, 3))), low)
    halves = parts.most.max(initial=low)
    rng = np.random.default_rng(seed)
    best = -math.inf
    for d in rng.uniform(-1, 1, (200, 3)):
        best = max(best, _reached(asked, grid, (centre[0] + radius[0] * d) * asked.scale))
    assert best <= most + 1e-9
    assert best <= halves + 1e-9


def test_a_double_pole_bounds_law_pd_rigorously():
    # two real poles merge at -K_d/(2 I) when K_p - A L = K_d^2/(4 I): the best K_d within K_p <= 3500
    biped = SLOPE.biped
    best = ((3500.0 - biped.M * biped.g * biped.L) / biped.I) ** 0.5
    mild = replace(SLOPE.scenarios[0], signal=SLOPE.scenarios[0].signal / 10)  # 3 degrees: pd keeps contact there
    problem = replace(SLOPE, law="pd", objective="decay-rate", scenarios=(mild,), gains=None)
    found = bound.bracket(problem, question.solve(problem).outcome.value, gap=1e-5)
    assert found.basis == "rigorous"
    assert found.bound == pytest.approx(best, rel=2e-5)
    assert found.bound >= best
    assert found.closed


@settings(deadline=None)
@given(st.tuples(part, part, part), st.tuples(part, part, part), st.integers(0, 2**32 - 1))
def test_no_poles_within_a_box_decay_faster_than_is_excluded(where, size, seed):
    asked = question.Question(SLOPE)
    poles = Exclusion(asked, asked.goal("decay-rate"), None).poles
    radius = 0.5 * 10.0 ** (-3.0 * np.array([size]))
    centre = radius + (1 - 2 * radius) * np.array([where])
    rates = np.linspace(0.0, 1.0, 30)
    out = [rate for rate in rates if smallest_row(poles.rows(centre, radius, np.array([rate])))[0][0] < 0]
    points = centre + radius * np.random.default_rng(seed).uniform(-1, 1, (200, 3))
    assert poles.decay(points).max() <= min(out, default=math.inf)


def test_the_decay_without_units_is_that_of_the_polynomial():
    asked = question.Question(SLOPE)
    poles = Exclusion(asked, asked.goal("decay-rate"), None).poles
    K = np.array([2000.0, 700.0, 3.0])
    exact = min(decay_rate([float(c) for c in each.coefficients(K)]) for each in asked.environments)
    assert poles.decay((K / asked.scale)[None])[0] * asked.pace == pytest.approx(exact, rel=1e-9)


def test_what_trajectories_say_at_a_centre_is_the_programs_own():
    asked, grid, test = _asked("slope", "contact-force")
    centre, radius = np.array([[0.8, 0.7, 0.4]]), np.full((1, 3), 0.01)
    seen = test.course.look(centre, radius)
    assert seen.objective[0, 0] == pytest.approx(_reached(asked, grid, centre[0] * asked.scale), rel=1e-12)
    corner = (centre + radius * CORNERS[1])[0]
    assert seen.objective[0, 2] == pytest.approx(_reached(asked, grid, corner * asked.scale), rel=1e-12)
    model = seen.rows.f[0].min()
    assert seen.objective[0, 0] <= model <= seen.objective[0, 0] + 0.01


def _given(problem, gains):
    """A design that is not optimal, with its value."""
    asked = question.Question(problem)
    verdict = judge(problem, gains, also=(problem.objective,))
    value = asked.score(asked.goal(problem.objective), gains, verdict)
    return Synthesis(
        gains=gains, objective=problem.objective, value=value, active=(), verdict=verdict, starts=1, reached=1, optima=1
    )


@pytest.mark.slow
def test_a_bad_design_is_bettered():
    required = {**SLOPE.required, "contact-force": Required(level=180.0)}
    problem = replace(SLOPE, objective="decay-rate", required=required)
    found = bound.bracket(problem, _given(problem, Gains(3500.0, 700.0, 6.5)), seconds=300.0, gap=0.02)
    assert found.better is not None
    assert found.value == pytest.approx(8.4451, abs=5e-4)
    assert found.bound >= found.value


@pytest.mark.slow
def test_the_gap_narrows_with_time():
    given = question.solve(SLOPE).outcome.value
    gaps = []
    for seconds in (10.0, 400.0):
        found = bound.bracket(SLOPE, given, seconds=seconds, gap=0.02)
        gaps.append(math.inf if found.gap is None else found.gap)
        assert found.bound is None or found.bound >= found.value
    assert gaps[1] <= gaps[0]
    assert gaps[1] == pytest.approx(0.02, rel=1e-6)


def test_no_time_gives_no_bound_and_says_so():
    given = _given(SLOPE, Gains(3500.0, 902.6, 8.457))
    found = bound.bracket(SLOPE, given, seconds=0.0)
    assert found.bound is None
    assert not found.closed
    assert "no bound yet" in bound.lines(found)[0]
    assert bound.facts(found)["gap"] is None


def test_an_objective_that_is_not_covered_is_refused():
    with pytest.raises(BadInput, match="disk-margin"):
        bound.bracket(replace(SLOPE, objective="disk-margin"), _given(SLOPE, Gains(3500.0, 902.6, 8.457)))


def test_a_split_box_is_its_two_halves():
    m = 0
    rows = Quadratics(np.zeros((1, m)), np.zeros((1, m, 3)), np.zeros((1, m, 6)))
    whole = Boxes(
        np.array([[0.5, 0.5, 0.5]]), np.array([[0.5, 0.25, 0.1]]), np.ones(1), np.zeros(1, dtype=int),
        np.ones(1, dtype=bool), rows,
    )  # fmt: skip
    halves = _split(whole, np.array([[1.0, 0.0, 0.0]]))
    assert np.allclose(halves.centre[:, 0], [0.25, 0.75])
    assert np.allclose(halves.radius, [[0.25, 0.25, 0.1]] * 2)
