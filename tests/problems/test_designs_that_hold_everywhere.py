"""Robust designs: the worst body of the box is found, and no body breaks the design; the nominal one is broken."""

import math
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from design.analysis.verdict import judge
from design.model.environment import slope
from design.model.laws import Gains
from design.model.limits import Required
from design.model.uncertainty import Spread, Tolerances
from design.spec.load import load
from design.spec.setting import setting
from problems import robust
from problems.gains import Question
from problems.robust.worst import runs, sampled_margins, world

EVERYWHERE = setting(load("everywhere").spec)
SUDDEN = replace(
    EVERYWHERE,
    scenarios=(slope(EVERYWHERE.biped, name="sudden", angle=math.radians(4.0), ramp=0.0, duration=4.0),),
    required={**EVERYWHERE.required, "contact-force": Required(level=40.0)},
    step=0.002,
)


def _broken(problem, gains, count, seed=0):
    """How many of ``count`` random bodies of the box lose what is required, in any scenario."""
    shares = np.zeros((count, 7))
    free = problem.tolerances.moving
    shares[:, free] = np.random.default_rng(seed).uniform(-1, 1, (count, len(free)))
    level = problem.required["contact-force"].level
    kept = np.ones(count, dtype=bool)
    for scenario in problem.scenarios:
        its = runs(problem, scenario, gains, shares, 0.002)
        kept &= np.minimum(its.toe, its.heel) >= level - 1e-4
    return int((~kept).sum())


@pytest.fixture(scope="module")
def sudden():
    return robust.solve(SUDDEN).outcome.value


def test_no_random_body_breaks_the_robust_design_and_many_break_the_nominal_one(sudden):
    assert _broken(SUDDEN, sudden.gains, 2000) == 0
    assert _broken(SUDDEN, sudden.box.nominal_gains, 2000) > 100
    assert sudden.box.nominal_broken > 0
    assert sudden.value < sudden.box.nominal  # what it costs


def test_contact_over_the_whole_box_is_proved(sudden):
    assert sudden.box.proofs == (("sudden", "proved", 1.0),)


def test_every_body_that_the_design_was_sought_for_meets_the_spec(sudden):
    assert sudden.box.points
    for point in sudden.box.points:
        assert judge(world(SUDDEN, point.shares, point.scenario), sudden.gains).overall == "met"


def test_the_worst_point_is_worse_than_random_ones(sudden):
    question = Question(SUDDEN)
    goal = question.goal("decay-rate")
    v = goal.v(sudden.value)
    worst = {weak.id: weak.margin for weak in robust.weakest(question, goal, sudden.gains, v, 0.01)}
    shares = np.zeros((500, 7))
    free = SUDDEN.tolerances.moving
    shares[:, free] = np.random.default_rng(3).uniform(-1, 1, (500, len(free)))
    random = sampled_margins(question, goal, v, runs(SUDDEN, SUDDEN.scenarios[0], sudden.gains, shares, 0.01))
    for id, margins in random.items():
        assert worst[id] <= margins.min() + 1e-9
    assert min(worst.values()) >= -2e-5


def test_without_tolerances_or_when_told_so_the_nominal_design_is_sought():
    exact = robust.solve(replace(SUDDEN, tolerances=Tolerances())).outcome.value
    nominal = robust.solve(replace(SUDDEN, robust=False)).outcome.value
    assert exact.gains == nominal.gains
    assert exact.box is None and nominal.box is None


def test_a_box_that_no_gains_can_hold_is_not_called_solved():
    level = Required(level=140.0)  # the nominal body keeps 144 N at best
    step = setting(load("slope-step").spec)
    wide = replace(
        step, required={**step.required, "contact-force": level},
        tolerances=Tolerances(L=Spread(part=0.05), M=Spread(part=0.05)),
    )  # fmt: skip
    answer = robust.solve(wide)
    assert answer.outcome.found is None
    assert "box" in answer.outcome.detail
    assert answer.points


@pytest.mark.slow
def test_ten_thousand_bodies_in_four_scenarios():
    """The paper's ramp, sudden slopes of 5 degrees both ways, a push; mass, height and inertia known to 5 per cent."""
    found = robust.solve(EVERYWHERE).outcome.value
    assert _broken(EVERYWHERE, found.gains, 10_000) == 0
    assert _broken(EVERYWHERE, found.box.nominal_gains, 10_000) > 0
    assert _broken(EVERYWHERE, EVERYWHERE.gains, 100) == 100  # the paper's own gains


@pytest.mark.parametrize(("law", "adapt"), [("cop", math.inf), ("force", 0.3)])
def test_the_decay_rate_of_another_body_is_that_of_its_own_loop(law, adapt):
    """The law knows the nominal body; the loop itself is linearised at its own stationary state."""
    problem = replace(EVERYWHERE.with_law(law), adapt=adapt)
    gains = Gains(2500.0, 450.0, 1.2)
    drawn = world(problem, (1.0, -1.0, 1.0, 0.0, 0.0, 0.0, 0.0), "ramp")
    loop, forces = drawn.loop(), drawn.scenarios[0].operating_forces(drawn.biped)
    z, F = ca.SX.sym("z", loop.size), ca.SX.sym("F", 2)
    rate = ca.Function("rate", [z, F], [loop.rate(z, F, ca.DM(gains))])
    jacobian = ca.Function("jacobian", [z, F], [ca.jacobian(loop.rate(z, F, ca.DM(gains)), z)])
    rates = []
    for F_x, F_y in forces.T:
        x = np.zeros(loop.size)
        x[0] = -math.atan2(F_x, drawn.biped.M * drawn.biped.g - F_y)
        for _ in range(40):
            x = x - np.linalg.solve(jacobian(x, [F_x, F_y]).full(), rate(x, [F_x, F_y]).full().ravel())
        rates.append(-np.linalg.eigvals(jacobian(x, [F_x, F_y]).full()).real.max())
    row = next(row for row in judge(drawn, gains).rows if row.id == "decay-rate")
    assert row.value == pytest.approx(min(rates), rel=1e-6)
