"""The program's derivatives are those of its functions, and its factors are the poles."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from design.model.laws import Gains
from design.model.limits import Required
from design.model.stability import is_hurwitz
from design.spec.load import load
from design.spec.setting import setting
from problems.gains import Grid, Point, Question, pose
from problems.gains.modelled import modelled

SLOPE = setting(load("slope").spec)
WISHES = {"contact-force": 100.0, "decay-rate": 8.0, "delay-margin": 0.02, "step-slope": 6.0, "torque": 40.0,
          "settling": 1.0, "overshoot": 0.1, "posture-error": 0.1, "torque-rate": 90.0}  # fmt: skip
APPROACH = {"settling": 0.8, "overshoot": 0.1, "posture-error": 0.1, "torque-rate": 90.0}


@pytest.mark.parametrize(
    "goal",
    [
        "contact-force",
        "decay-rate",
        "cop-margin",
        "routh-margin",
        "feasibility",
        "torque",
        "step-slope",
        "push",
        "delay-margin",
        "settling",
        "overshoot",
        "posture-error",
        "torque-rate",
        "approach",
        "sample-time",
        "kp",
        "goals",
    ],
)
def test_first_and_second_derivatives_match_finite_differences(goal):
    wishes = {name: Required(level=level, soft=True) for name, level in WISHES.items()} if goal == "goals" else {}
    if goal == "approach":
        goal, wishes = "contact-force", {name: Required(level=level) for name, level in APPROACH.items()}
    question = Question(replace(SLOPE, required={**SLOPE.required, **wishes}))
    grid = Grid(question, 0.01, question.goal(goal))
    at = Point(gains=Gains(3000.0, 900.0, 5.0), v=0.1)
    seen = ((50, 300, 501, 900), (0, 20, 500)) if goal in ("step-slope", "push") else ((50, 300, 501, 900),)
    seen = (*seen, (10, 40)) if goal == "goals" else seen
    u = np.array([0.8, 0.7, 0.3])
    models = modelled(question, grid.goal, u, 0.01) or []
    program, read = pose(grid, seen, models=models, branches=grid.branches(at))
    x0 = read.start(at)
    lam = ca.MX.sym("lam", program.g.numel())
    lagrangian = program.f + ca.dot(lam, program.g)
    gradient = ca.gradient(lagrangian, program.x)
    value = ca.Function("value", [program.x, lam], [lagrangian])
    first = ca.Function("first", [program.x, lam], [gradient])
    second = ca.Function("second", [program.x, lam], [ca.hessian(lagrangian, program.x)[0]])
    weights = np.random.default_rng(1).standard_normal(program.g.numel())
    exact, bent = first(x0, weights).full().ravel(), second(x0, weights).full()
    for k in range(x0.size):
        h = 1e-5 * max(abs(x0[k]), 0.1)
        step = np.eye(x0.size)[k] * h
        slope = float(value(x0 + step, weights) - value(x0 - step, weights)) / (2 * h)
        curve = (first(x0 + step, weights) - first(x0 - step, weights)).full().ravel() / (2 * h)
        assert slope == pytest.approx(exact[k], rel=1e-5, abs=1e-5 * np.abs(exact).max())
        assert curve == pytest.approx(bent[:, k], rel=1e-4, abs=1e-4 * np.abs(bent).max())


@given(a=st.floats(0, 50), b=st.floats(0, 50), c=st.floats(0, 500), nudge=st.floats(1e-3, 1.0))
def test_every_factored_cubic_is_stable_when_shifted_a_little(a, b, c, nudge):
    roots = np.concatenate([[-a - nudge], np.roots([1.0, b, c]) - nudge])
    assert is_hurwitz(np.poly(roots)[1:].real)


def test_closed_routh_hurwitz_tests_alone_admit_an_unstable_cubic():
    # why the program factors: q_2 = q_0 = 0 with q_1 < 0 passes q_2 >= 0, q_0 >= 0, q_2 q_1 >= q_0
    q_2, q_1, q_0 = 0.0, -4.0, 0.0
    assert q_2 >= 0 and q_0 >= 0 and q_2 * q_1 >= q_0
    assert max(np.roots([1.0, q_2, q_1, q_0]).real) > 0
