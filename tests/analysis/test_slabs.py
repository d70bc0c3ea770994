"""A long run in slabs is the run in one piece, and is given up between two slabs when time is over."""

import time
from dataclasses import replace

import numpy as np
import pytest

from design import deadline
from design.analysis.simulate import components, simulate
from design.analysis.slabs import SLAB, marched
from design.model.limits import limits
from design.spec.load import load
from design.spec.schema import MAX_STEPS
from design.spec.setting import setting
from problems import gains
from problems.gains.grid import Grid, Point
from problems.gains.question import Question

TRAIN = setting(load("train").spec)
STEP = TRAIN.scenarios[0].duration / (1.5 * SLAB)


def _in_one_piece(loop, scenario, steps):
    """The states at all samples, by one function for all steps."""
    start = np.array(loop.start(scenario.theta0, scenario.omega0, 0.0), dtype=float)
    inputs = np.vstack([steps.h, steps.start, steps.middle, steps.end])
    gains = np.repeat(np.array(TRAIN.gains)[:, None], len(steps.h), axis=1)
    return start, np.column_stack([start, loop.march(len(steps.h))(start, inputs, gains).full()])


def test_slabs_are_the_run_in_one_piece():
    loop, scenario = TRAIN.loop(), TRAIN.scenarios[0]
    steps = scenario.steps(STEP)
    start, whole = _in_one_piece(loop, scenario, steps)
    run = simulate(loop, scenario, TRAIN.gains, STEP)
    assert len(run.t) == len(steps.t) > SLAB
    for states in (marched(loop.step, start, steps, np.array(TRAIN.gains)), np.array([run.theta, run.omega, run.s])):
        np.testing.assert_allclose(states, whole, rtol=0, atol=1e-12 * (1 + np.abs(whole).max()))


def test_margins_of_a_long_run_are_those_of_its_limits():
    problem = replace(TRAIN, step=STEP, scenarios=TRAIN.scenarios[:1], objective="contact-force")
    question = Question(problem)
    grid = Grid(question, STEP, question.goal("contact-force"))
    (rows,) = grid.margins(Point(gains=TRAIN.gains, v=0.0))
    run = simulate(TRAIN.loop(), problem.scenarios[0], TRAIN.gains, STEP)
    toe, heel, *_ = components(limits(TRAIN.loop().plant, problem.required), run)
    np.testing.assert_allclose(rows[0] * problem.biped.weight, toe[0], atol=1e-9)
    np.testing.assert_allclose(rows[1] * problem.biped.weight, heel[0], atol=1e-9)


def test_nothing_is_marched_after_the_deadline():
    with deadline.deadline(time.monotonic() - 1.0), pytest.raises(deadline.OutOfTime):
        simulate(TRAIN.loop(), TRAIN.scenarios[0], TRAIN.gains, STEP)
    simulate(TRAIN.loop(), TRAIN.scenarios[0], TRAIN.gains, TRAIN.step)


def test_an_inner_deadline_never_extends_an_outer_one():
    with deadline.deadline(time.monotonic() + 10.0), deadline.deadline(time.monotonic() + 100.0):
        assert 9.0 < deadline.left() <= 10.0
    assert deadline.ends() == np.inf


def test_a_time_limit_is_kept_however_fine_the_step_is():
    fine = replace(TRAIN, step=TRAIN.scenarios[0].duration / MAX_STEPS, gains=None)
    gains.solve(replace(TRAIN, gains=None), seconds=0.5)  # what is built once
    began = time.process_time()
    answer = gains.solve(fine, seconds=2.0)
    assert time.process_time() - began < 4.0  # one step of the search is not divided
    assert answer.outcome.status.word == "undecided"
