"""Differential evolution with a generous budget finds no better gains than the synthesis does."""

import pytest
from global_search import Rival, posed

from problems import bound
from problems import gains as question

CASES = [
    ("adult-slope", "contact-force", {}),
    ("wind", "contact-force", {}),
    ("train", "cop-margin", {}),
    ("slope-step", "contact-force", {}),
    ("lean", "contact-force", {}),
    ("gust", "decay-rate", {"contact_force": 250.0}),
    ("slope", "decay-rate", {"contact_force": 180.0}),
    ("slope", "delay-margin", {}),
    ("wind", "disk-margin", {}),
    ("slope", "step-slope", {}),
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "objective", "levels"), CASES)
def test_no_worse_than_a_global_search(name, objective, levels):
    rival = Rival(posed(name, objective, **levels))
    gains, _ = rival.search(maxiter=40, popsize=15)
    best, problem = rival.judged(gains)
    found = question.solve(problem).outcome.value
    assert found.value >= best * (1 - 1e-4)


@pytest.mark.slow
def test_its_best_lies_within_the_bracket():
    rival = Rival(posed("slope", "decay-rate", contact_force=180.0))
    gains, _ = rival.search(maxiter=30, popsize=10)
    best, problem = rival.judged(gains)
    found = bound.bracket(problem, question.solve(problem).outcome.value, seconds=300.0, gap=0.01)
    assert found.closed
    assert best <= found.bound
