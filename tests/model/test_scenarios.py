"""A scenario is the force it says, and its steps end on every corner and see both sides of every jump."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.model.body import Biped
from design.model.environment import constant_force, platform, profile, slope, varied
from design.model.plant import plant

PAPER = Biped(M=50.0, L=0.75, I=50.0 * 0.75**2 / 4, m=0.1, ell=0.1)
ADULT = Biped(M=72.5, L=0.93, I=84.0, m=2.4, ell=0.12, g=9.80665)

durations = st.floats(0.05, 4.0)
values = st.floats(-300.0, 300.0)


@st.composite
def tables(draw, columns):
    """Rows (t, values...) whose times do not fall; some are equal, which is a jump, and some lie beyond the end."""
    gaps = draw(st.lists(st.one_of(st.just(0.0), st.floats(1e-3, 1.0)), min_size=0, max_size=6))
    t = np.cumsum([draw(st.sampled_from([0.0, 0.25])), *gaps])
    return np.array([[time, *(draw(values) for _ in range(columns))] for time in t])


@st.composite
def scenarios(draw):
    kind = draw(st.sampled_from(["slope", "force", "platform", "profile"]))
    ramp = draw(st.one_of(st.just(0.0), st.floats(1e-3, 5.0)))
    duration = draw(durations)
    if kind == "slope":
        return slope(ADULT, name=kind, angle=draw(st.floats(-1.2, 1.2)), ramp=ramp, duration=duration)
    if kind == "force":
        return constant_force(name=kind, F_x=draw(values), F_y=draw(values), ramp=ramp, duration=duration)
    if kind == "platform":
        return platform(ADULT, name=kind, points=draw(tables(1)), duration=duration)
    return profile(name=kind, points=draw(tables(2)), duration=duration)


steps_of = st.one_of(st.sampled_from([0.001, 0.01, 0.1, 0.3]), st.floats(2e-3, 1.0))
several = settings(max_examples=100, deadline=None)


def _signal_beside(scenario, t, side):
    """The signal just before or just after t, written out; at either end of the table its value is held."""
    times, table = list(scenario.times), scenario.signal
    passed = [k for k, time in enumerate(times) if (time <= t if side == "after" else time < t)]
    k = max(passed, default=0)
    if k + 1 == len(times) or times[k] == times[k + 1]:
        return table[:, k]
    share = (t - times[k]) / (times[k + 1] - times[k])
    return table[:, k] + max(share, 0.0) * (table[:, k + 1] - table[:, k])


# ---- the steps of any scenario


@given(scenario=scenarios(), h=steps_of)
@several
def test_steps_fill_the_duration(scenario, h):
    steps = scenario.steps(h)
    assert steps.h.sum() == pytest.approx(scenario.duration, rel=1e-12)
    assert steps.t[0] == 0.0
    assert steps.t[-1] == scenario.duration
    assert len(steps.t) == len(steps.h) + 1


@given(scenario=scenarios(), h=steps_of)
@several
def test_time_does_not_fall_and_no_step_is_longer_than_asked(scenario, h):
    steps = scenario.steps(h)
    assert np.all(steps.h >= 0)
    assert np.array_equal(np.diff(steps.t), steps.h)
    assert np.all(steps.h <= h * (1 + 1e-8))


@given(scenario=scenarios(), h=steps_of)
@several
def test_no_step_has_a_breakpoint_inside(scenario, h):
    steps = scenario.steps(h)
    corners = [t for t in scenario.times if 0 < t < scenario.duration]
    assert scenario.breakpoints == sorted(set(corners))
    for corner in corners:
        assert not np.any((steps.t[:-1] < corner) & (corner < steps.t[1:]))


@given(scenario=scenarios(), h=steps_of)
@several
def test_each_step_sees_the_force_of_its_own_piece(scenario, h):
    steps = scenario.steps(h)
    for k in np.linspace(0, len(steps.h) - 1, 12).astype(int):
        if steps.h[k] == 0.0:
            continue  # the two sides of a jump; see below
        start, end = steps.t[k], steps.t[k + 1]
        for found, t, side in (
            (steps.start, start, "after"), (steps.middle, 0.5 * (start + end), "after"), (steps.end, end, "before"),
        ):  # fmt: skip
            expected = scenario.to_force(_signal_beside(scenario, t, side)[:, None])[:, 0]
            assert found[:, k] == pytest.approx(expected, rel=1e-9, abs=1e-7)


@given(scenario=scenarios(), h=steps_of)
@several
def test_both_sides_of_a_jump_are_samples(scenario, h):
    steps = scenario.steps(h)
    for corner in scenario.breakpoints:
        before, after = (_signal_beside(scenario, corner, side) for side in ("before", "after"))
        at = np.flatnonzero(steps.t == corner)
        if np.abs(after - before).max() > 1e-6:
            assert len(at) == 2
            assert steps.h[at[0]] == 0.0
            assert steps.signal[:, at[0]] == pytest.approx(before, rel=1e-9, abs=1e-9)
            assert steps.signal[:, at[1]] == pytest.approx(after, rel=1e-9, abs=1e-9)
        elif np.array_equal(after, before):
            assert len(at) == 1


@given(scenario=scenarios(), h=steps_of)
@several
def test_the_force_at_the_samples_is_that_of_the_steps_that_meet_there(scenario, h):
    steps = scenario.steps(h)
    assert np.array_equal(steps.force, scenario.to_force(steps.signal))
    moving = steps.h > 0
    assert np.array_equal(steps.force[:, :-1][:, moving], steps.start[:, moving])
    assert steps.force[:, 1:][:, moving] == pytest.approx(steps.end[:, moving], rel=1e-9, abs=1e-9)


@given(scenario=scenarios())
@several
def test_the_operating_points_span_every_environment_passed(scenario):
    A, load = scenario.operating_points(ADULT)
    for piece in scenario.pieces():
        F_x, F_y = scenario.force_on(piece, np.linspace(*piece, 201))
        passed = np.hypot(ADULT.M * ADULT.g - F_y, F_x)
        assert passed.max() <= A.max() + 1e-8
        assert passed.min() >= A.min() - 1e-8
        assert (ADULT.weight - F_y).max() <= load.max() + 1e-8
        assert (ADULT.weight - F_y).min() >= load.min() - 1e-8


@given(scenario=scenarios(), h=steps_of, times=st.lists(st.floats(0.0, 4.0), max_size=8))
@several
def test_steps_at_chosen_times_end_there_and_at_every_breakpoint(scenario, h, times):
    steps = scenario.steps_at(np.array(times))
    wanted = {0.0, scenario.duration, *scenario.breakpoints, *(t for t in times if t <= scenario.duration)}
    assert set(steps.t.tolist()) == wanted


def test_a_multiple_of_the_step_that_misses_a_breakpoint_by_rounding_is_moved_onto_it():
    ramp = 0.1 + 0.2  # one ulp above 300 steps of 1 ms
    steps = slope(PAPER, name="s", angle=0.1, ramp=ramp, duration=1.0).steps(0.001)
    assert len(steps.h) == 1000
    assert steps.h.min() > 0.000999
    assert ramp in steps.t


# ---- the slope, (21)-(22)


def test_the_paper_s_slope_is_its_equation_22():
    ramp = slope(PAPER, name="slope", angle=math.pi / 6, ramp=5.0, duration=10.0)
    steps = ramp.steps(0.001)
    alpha = np.where(steps.t < 5.0, math.pi / 6 * steps.t / 5.0, math.pi / 6)
    assert len(steps.h) == 10_000
    assert ramp.angle * steps.signal[0] == pytest.approx(alpha, rel=1e-14)
    assert steps.force[0] == pytest.approx(PAPER.M * PAPER.g * np.sin(alpha), rel=1e-13)
    assert steps.force[1] == pytest.approx(PAPER.M * PAPER.g * (1 - np.cos(alpha)), rel=1e-13, abs=1e-12)


@given(alpha=st.floats(-1.5, 1.5))
def test_on_a_slope_gravity_keeps_its_size_and_turns_by_the_slope(alpha):
    for biped in (PAPER, ADULT):
        F_x, F_y = slope(biped, name="s", angle=alpha, ramp=0.0, duration=1.0).steps(0.5).force[:, 0]
        assert math.hypot(biped.M * biped.g - F_y, F_x) == pytest.approx(biped.M * biped.g, rel=1e-15)  # (3)
        assert math.atan2(-F_x, biped.M * biped.g - F_y) == pytest.approx(-alpha, rel=1e-12, abs=1e-15)  # (4)


@given(alpha=st.floats(-1.0, 1.0), theta=st.floats(-1.0, 1.0), tau=st.floats(-100, 100))
def test_a_body_on_a_slope_moves_as_one_on_the_flat_seen_askew(alpha, theta, tau):
    force = slope(ADULT, name="s", angle=alpha, ramp=0.0, duration=1.0).steps(0.5).force[:, 0]
    dynamics = plant(ADULT).dynamics
    tilted = float(dynamics([theta, 0.3], tau, force)[1])
    assert tilted == pytest.approx(float(dynamics([theta + alpha, 0.3], tau, [0, 0])[1]), rel=1e-10, abs=1e-10)


def test_a_sudden_slope_is_there_from_the_first_sample():
    steps = slope(PAPER, name="sudden", angle=0.1, ramp=0.0, duration=1.0).steps(0.01)
    assert np.all(steps.signal == 1.0)
    assert steps.force[0] == pytest.approx(np.full(101, PAPER.M * PAPER.g * math.sin(0.1)), rel=1e-14)
    assert len(steps.h) == 100


def test_a_ramp_longer_than_the_run_is_cut():
    long = slope(PAPER, name="long", angle=0.4, ramp=4.0, duration=1.0)
    assert long.angle * long.steps(0.01).signal[0, -1] == pytest.approx(0.1, rel=1e-14)


@given(angle=st.sampled_from([0.0, 1e-9, 0.1, -0.2]), final=st.floats(-0.5, 0.5), ramp=st.floats(0.1, 4.0))
@several
def test_a_slope_varied_to_another_angle_is_that_slope_with_its_ramp_whatever_it_was(angle, final, ramp):
    meant = slope(ADULT, name="s", angle=final, ramp=ramp, duration=5.0)
    varied_one = varied(
        slope(PAPER, name="s", angle=angle, ramp=1.0, duration=5.0), ADULT, slope=lambda _: final, ramp=lambda _: ramp
    )
    t = np.linspace(0.0, 5.0, 41)
    assert varied_one.force_at(t) == pytest.approx(meant.force_at(t), rel=1e-12, abs=1e-12)


# ---- other kinds


def test_a_floor_that_accelerates_forward_pushes_back_with_the_mass_of_the_body():
    points = np.array([[0.0, 0.0], [0.5, 2.0], [1.0, -1.0]])
    steps = platform(ADULT, name="bus", points=points, duration=2.0).steps(0.01)
    a = np.interp(steps.t, points[:, 0], points[:, 1])
    assert steps.force[0] == pytest.approx(-ADULT.M * a, rel=1e-12, abs=1e-10)
    assert np.all(steps.force[1] == 0.0)


def test_a_force_comes_up_linearly_and_stays():
    steps = constant_force(name="wind", F_x=40.0, F_y=-8.0, ramp=0.3, duration=1.0).steps(0.01)
    share = np.minimum(steps.t / 0.3, 1.0)
    assert steps.force == pytest.approx(np.outer([40.0, -8.0], share), rel=1e-12, abs=1e-12)


def test_a_profile_jumps_where_two_of_its_points_share_a_time():
    points = np.array([[0.0, 0.0, 0.0], [0.35, 30.0, 5.0], [0.35, -20.0, 0.0], [0.8, -20.0, 9.0]])
    gust = profile(name="gust", points=points, duration=1.0)
    steps = gust.steps(0.1)
    (first, second) = np.flatnonzero(steps.t == 0.35)
    assert gust.breakpoints == [0.35, 0.8]
    assert steps.force[:, first] == pytest.approx([30.0, 5.0])
    assert steps.force[:, second] == pytest.approx([-20.0, 0.0])
    assert steps.force[:, -1] == pytest.approx([-20.0, 9.0])  # held to the end


def test_a_profile_that_begins_late_holds_its_first_value_back_to_the_beginning():
    steps = profile(name="late", points=np.array([[0.4, 7.0, 1.0], [0.6, 9.0, 1.0]]), duration=1.0).steps(0.1)
    assert steps.force[:, steps.t <= 0.4] == pytest.approx(np.tile([[7.0], [1.0]], 5))
