"""What can be met is met, whatever is sought and however wide the bounds are; what is missed is said row by row."""

import re
from dataclasses import replace

import numpy as np
import pytest

from design.analysis.obstacles import obstacles
from design.analysis.synthesis import Answer, Relaxation, WhyNot
from design.analysis.verdict import judge
from design.deadline import OutOfTime
from design.model.laws import Gains
from design.model.limits import Required
from design.present.synthesis import text
from design.solvers.outcome import Outcome, Status
from design.spec.load import load
from design.spec.setting import setting
from problems import gains
from problems.gains.direct import most_feasible
from problems.gains.grid import Grid
from problems.gains.incumbents import Incumbents
from problems.gains.question import Question
from problems.gains.search import _Search

SOURCE = load("slope")
SLOPE = setting(SOURCE.spec)
BEST = 190.99478
"""The greatest smallest contact force within the bounds of ``slope`` [N]: differential evolution finds no other."""


def needs(problem, **levels):
    required = {id.replace("_", "-"): Required(level=level) for id, level in levels.items()}
    return replace(problem, required={**problem.required, **required})


def within(problem, *upper):
    return replace(problem, bounds=np.array([[0.0, bound] for bound in upper]))


@pytest.mark.parametrize("upper", [(3500.0, 1200.0, 1e3), (3500.0, 1200.0, 1e9), (3500.0, 1e6, 1e6)])
def test_bounds_that_are_far_too_wide_do_no_harm(upper):
    narrow = gains.solve(SLOPE).outcome.value.value
    wide = gains.solve(within(SLOPE, *upper)).outcome.value
    assert wide.value >= narrow * (1 - 1e-6)
    assert judge(within(SLOPE, *upper), wide.gains).overall == "met"


@pytest.mark.slow
def test_wider_bounds_never_give_less():
    values = [gains.solve(within(SLOPE, *[size] * 3)).outcome.value.value for size in (4e3, 1e4, 1e5)]
    assert values == sorted(values)


def test_the_working_box_has_all_stable_gains_of_the_sides_that_it_keeps():
    wide = Question(within(SLOPE, 3500.0, 1200.0, 1e6))
    biped = SLOPE.biped
    for place in (each.place for each in wide.environments):
        assert wide.upper[2] * (biped.I + place.beta) >= biped.ell * wide.upper[1] * (1 - 1e-12)  # (28)
    assert (Question(within(SLOPE, 1e6, 1e6, 1e6), reach=np.inf).upper == 1e6).all()


@pytest.mark.parametrize("sought", ["torque", "cop-margin", "routh-margin", "decay-rate", "friction"])
def test_the_objective_never_prevents_feasibility(sought):
    problem = needs(SLOPE, contact_force=180.0, decay_rate=8.0)
    point = gains.solve(replace(problem, objective="contact-force")).outcome.value
    other = gains.solve(replace(problem, objective=sought)).outcome.value
    assert judge(problem, other.gains).overall == "met"
    question = Question(problem)
    goal = question.goal(sought)
    there = question.score(goal, point.gains, judge(problem, point.gains, also=(sought,)))
    assert goal.v(other.value) >= goal.v(there) - 1e-6 * abs(goal.v(there))


@pytest.mark.slow
@pytest.mark.parametrize("distance", [1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0])
def test_a_miss_is_named_and_measured_however_small_it_is(distance):
    answer = gains.solve(needs(SLOPE, contact_force=BEST + distance))
    assert answer.outcome.status is Status.NOT_FOUND
    assert {row.id for row in answer.missed} <= {"toe-force", "heel-force"}
    missed = max(-row.margin for row in answer.missed)
    assert missed == pytest.approx(distance, rel=1e-2, abs=3e-5)
    assert "misses by" in answer.outcome.detail


@pytest.mark.slow
@pytest.mark.parametrize("distance", [1e-4, 1e-2, 1.0])
def test_what_can_just_be_met_is_met(distance):
    design = gains.solve(needs(SLOPE, contact_force=BEST - distance)).outcome.value
    assert design.value >= BEST - distance


def test_gains_that_are_known_to_be_feasible_are_judged_and_kept():
    problem = needs(SLOPE, contact_force=180.0)
    feasible, broken = gains.solve(problem).outcome.value.gains, Gains(3500.0, 1200.0, 1.0)
    question = Question(problem)
    pool = Incumbents(question, question.goal("contact-force"))
    pool.offer([broken])
    assert pool.best is None
    pool.offer([feasible, Gains(*(2.0 * np.array(feasible)))])  # the second are outside of the bounds
    assert pool.best.gains == feasible and len(pool.points) == 1


def test_when_time_is_over_the_best_checked_design_is_kept(monkeypatch):
    def over(self):
        raise OutOfTime

    monkeypatch.setattr(_Search, "_finished", over)
    answer = gains.solve(SLOPE)
    assert answer.outcome.status is Status.TIME_LIMIT and answer.outcome.found is None
    assert judge(SLOPE, answer.best.gains).overall == "met"
    said = text(SOURCE, SLOPE, answer, lambda words, _: words)
    assert "best design so far was checked" in said and "UNDECIDED" in said


def test_a_search_without_derivatives_finds_what_is_narrow():
    problem = needs(SLOPE, contact_force=190.9)  # the feasible gains are some 1e-6 of the box
    question = Question(problem)
    grid = Grid(question, question.coarse_step, question.goal("contact-force"))
    K, margin = most_feasible(grid, np.array([[3000.0, 800.0, 6.0]]))
    assert margin > -2e-4
    assert abs(min(row.margin for row in judge(problem, Gains(*K)).rows if row.id.endswith("force"))) < 0.2


# what is impossible has a proof

IMPOSSIBLE = r"exclude each other|out of reach|impossible|infeasible|cannot be met|can meet"


def test_infeasible_cannot_be_said_without_a_proof():
    with pytest.raises(ValueError, match="proof"):
        Outcome(status=Status.INFEASIBLE)
    proof = obstacles(needs(SLOPE, contact_force=300.0))[0]
    assert Outcome.infeasible(proof).proof is proof
    for status in set(Status) - {Status.INFEASIBLE}:
        with pytest.raises(ValueError, match="proof"):
            Outcome(status=status, proof=proof)


RELAXED = Relaxation(
    id="contact-force", bound="", given=20.0, enough=10.0, unit="N", design=Gains(1.0, 1.0, 1.0)
)  # fmt: skip
WHYS = [None] + [
    WhyNot(conflict=conflict, minimal=minimal, complete=complete, relaxations=relaxations)
    for conflict in ((), ("contact-force",), ("contact-force", "torque"))
    for minimal in (True, False)
    for complete in (True, False)
    for relaxations in ((), (RELAXED,))
]


@pytest.mark.parametrize("status", [each for each in Status if each not in (Status.SOLVED, Status.INFEASIBLE)])
def test_without_a_proof_no_word_says_that_it_cannot_be(status):
    for why in WHYS:
        answer = Answer(outcome=Outcome(status=status), why=why)
        said = " ".join(text(SOURCE, SLOPE, answer, lambda words, _: words).split())
        assert not re.search(IMPOSSIBLE, said, flags=re.IGNORECASE), said
        assert "UNDECIDED" in said


def test_with_a_proof_its_numbers_are_said():
    problem = needs(SLOPE, contact_force=300.0)
    answer = gains.solve(problem)
    said = text(SOURCE, problem, answer, lambda words, _: words)
    assert "proved" in said and "300" in said and answer.outcome.proof.id == "contact-force"
