"""Proofs and certificates with ``foot.ground_loads``: the foot weighs m g cos(alpha) on a slope."""

import itertools
from dataclasses import replace

import pytest
from certificate_cases import respelled, written

from design.analysis.recheck import second_opinion
from design.checking import verdict
from design.model.uncertainty import Spread, Tolerances
from design.proof.box import prove
from design.spec.load import builtin_text, parse
from design.spec.setting import setting

CALM = (("angle_deg = 30.0", "angle_deg = 20.0"), ("duration_s = 10.0", "duration_s = 6.0"),
        ("mass_kg = 0.1 ", "mass_kg = 3.0 "), ("kd = 1200.0", "kd = 606.2"), ("kf = 1.0", "kf = 5.61"))  # fmt: skip
HEAVY = builtin_text("slope")
for old, new in CALM:
    assert old in HEAVY
    HEAVY = HEAVY.replace(old, new)
LOADED = HEAVY.replace("half_length_m = 0.1 ", "ground_loads = true\nhalf_length_m = 0.1 ")
PROBLEM = setting(parse(LOADED, origin="spec").spec)
BOX = Tolerances(M=Spread(part=0.01), m=Spread(part=0.1), slope=Spread(absolute=0.01), ell=Spread(part=0.01))


@pytest.mark.parametrize("law", ["force", "cop"])
def test_what_is_proved_is_the_least_of_an_independent_run(law):
    problem = replace(PROBLEM, law=law)
    proof = prove(problem, problem.gains, "ramp")
    assert proof.answer == "proved"
    ramp = problem.scenarios[0]
    run = second_opinion(problem.under(ramp).biped, law, 0.0, problem.gains, ramp, 1e-3)
    for row, force in (("toe-force", run.F_T), ("heel-force", run.F_H)):
        assert 0 <= force.min() - proof.value[row] < 0.01


def gap(problem):
    """How far below the least force of corner bodies the bound over the box is [N]."""
    proof = prove(problem, problem.gains, "ramp")
    assert proof.answer == "proved"
    ramp = problem.scenarios[0]
    foot, least = problem.under(ramp).biped, []
    for M, m, ell, angle in itertools.product([-1.0, 1.0], repeat=4):
        body, world = BOX.drawn(foot, ramp, [M, 0.0, 0.0, m, ell, angle, 0.0])
        run = second_opinion(body, "force", 0.0, problem.gains, world, 5e-3)
        least.append(min(run.F_T.min(), run.F_H.min()))
    return min(least) - min(proof.value["toe-force"], proof.value["heel-force"])


@pytest.mark.slow
def test_bodies_of_a_proved_box_keep_the_bound_which_is_as_close_as_for_the_paper_s_foot():
    problem = replace(PROBLEM, tolerances=BOX)
    assert 0 <= gap(problem) < gap(replace(problem, ground_loads=False)) + 0.1


def test_a_certificate_is_confirmed_for_its_own_foot_and_refused_for_the_other_that_bears_less():
    certified = written(LOADED)
    assert verdict.check(certified.encode()).confirmed
    paper = written(HEAVY)
    assert verdict.check(paper.encode()).confirmed
    other = respelled(paper, "half_length_m = 0.1 ", "ground_loads = true\nhalf_length_m = 0.1 ")
    assert not verdict.check(other.encode()).confirmed
