"""Requirements that are not met together: the conflict is smallest, each relaxation enough, and less is not."""

from dataclasses import replace

import pytest

from design.analysis.objectives import OBJECTIVES
from design.analysis.verdict import judge
from design.model.limits import Required
from design.present.synthesis import why_lines
from design.spec.load import load
from design.spec.setting import setting
from problems import gains, whynot

SLOPE = setting(load("slope").spec)


def _with(**levels):
    wanted = {name.replace("_", "-"): Required(level=level) for name, level in levels.items()}
    return replace(SLOPE, required={**SLOPE.required, **wanted}, objective="routh-margin")


TORN = _with(contact_force=180.0, decay_rate=10.0, torque=60.0)


@pytest.fixture(scope="module")
def why():
    return whynot.solve(TORN)


def _solved(problem):
    return gains.solve(problem).outcome.found is not None


def test_the_conflict_is_the_smallest(why):
    assert set(why.conflict) == {"contact-force", "decay-rate"}  # the torque has nothing to do with it
    assert why.minimal
    for id in why.conflict:
        assert _solved(replace(TORN, required={**TORN.required, id: Required(level=0.0)}))


def test_every_kind_of_relaxation_is_found(why):
    assert {(each.id, each.bound) for each in why.relaxations} >= {
        ("contact-force", ""), ("decay-rate", ""), ("kp", "upper")
    }  # fmt: skip


@pytest.mark.parametrize("id", ["contact-force", "decay-rate"])
def test_a_relaxation_is_enough_and_a_little_less_is_not(why, id):
    enough = next(each.enough for each in why.relaxations if each.id == id)
    assert _solved(replace(TORN, required={**TORN.required, id: Required(level=enough)}))
    assert not _solved(replace(TORN, required={**TORN.required, id: Required(level=enough * 1.003)}))


def test_without_time_nothing_is_concluded():
    found = whynot.solve(TORN, seconds=0.01)
    assert not found.minimal
    assert not found.complete
    assert not found.relaxations
    assert set(found.conflict) == {"contact-force", "decay-rate", "torque"}  # none was ruled out
    said = " ".join(why_lines(found))
    assert "Time ran out" in said
    assert "each can be met" not in said


@pytest.mark.slow
def test_a_wider_bound_is_enough_and_a_little_less_is_not(why):
    enough = next(each.enough for each in why.relaxations if each.bound == "upper" and each.id == "kp")
    bounds = TORN.bounds.copy()
    bounds[0, 1] = enough
    assert _solved(replace(TORN, bounds=bounds))
    bounds[0, 1] = enough * 0.997
    assert not _solved(replace(TORN, bounds=bounds))


@pytest.mark.slow
def test_one_requirement_out_of_reach_is_named_alone():
    found = whynot.solve(_with(contact_force=195.0))
    assert found.conflict == ("contact-force",)
    assert found.relaxations[0].enough == pytest.approx(190.99, abs=0.01)


@pytest.mark.slow
def test_a_lower_bound_that_stands_in_the_way_is_found():
    bounds = SLOPE.bounds.copy()
    bounds[2, 0] = 12.0
    tight = replace(_with(contact_force=185.0), bounds=bounds)
    found = whynot.solve(tight)
    lower = next(each for each in found.relaxations if each.bound == "lower")
    bounds = bounds.copy()
    bounds[2, 0] = lower.enough
    assert lower.id == "kf" and _solved(replace(tight, bounds=bounds))
    bounds[2, 0] = 1.01 * lower.enough
    assert not _solved(replace(tight, bounds=bounds))


def test_every_relaxation_has_a_design_that_keeps_the_rest_and_asks_less_than_the_spec(why):
    for each in why.relaxations:
        if each.bound:
            assert each.bound == ("upper" if each.enough > each.given else "lower")
            continue
        sign = OBJECTIVES[each.id].sign
        assert sign * each.enough < sign * each.given
        eased = replace(TORN, required={**TORN.required, each.id: Required(level=each.enough)})
        assert judge(eased, each.design).overall == "met"


def test_what_is_feasible_after_all_is_handed_back_to_start_from():
    easy = _with(contact_force=150.0)
    found = whynot.solve(easy)
    assert found.feasible and not found.relaxations
    assert judge(easy, found.feasible[0]).overall == "met"
