"""A certificate is confirmed if and only if what it claims is shown: the checker believes nothing else."""

import copy
import json
from functools import cache

import pytest

from design.checking import verdict
from design.errors import BadInput
from design.proof.box import prove
from design.proof.certificate import write
from design.spec.load import builtin_text, parse
from design.spec.setting import setting


@cache
def written(name, replaced=()):
    """The text of the certificate of a built-in spec in which each (old, new) of ``replaced`` is changed."""
    text = builtin_text(name)
    for old, new in replaced:
        assert old in text
        text = text.replace(old, new)
    source = parse(text, origin=name)
    problem = setting(source.spec)
    proofs = [prove(problem, problem.gains, scenario.name) for scenario in problem.scenarios]
    assert all(proof.answer == "proved" for proof in proofs)
    return write(source, problem, problem.gains, proofs)


@pytest.mark.parametrize("name", ["slope", "slope-step", "wind", "train"])
def test_what_is_proved_is_confirmed(name):
    answer = verdict.check(written(name).encode())
    assert answer.confirmed, answer.why
    assert all(answer.for_ever.values())


def test_the_papers_bound_is_within_a_hundredth_of_a_newton():
    claims = verdict.check(written("slope").encode()).claims["ramp"]
    assert 29.5317 < claims["heel-force"] <= 29.5417
    assert 206.984 < claims["toe-force"] <= 206.994
