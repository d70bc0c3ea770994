"""Differential evolution finds no better gains than the synthesis does."""

import pytest
from global_search import Rival, posed

from problems import bound
from problems import gains as question

CASES = [
    ("slope-step", "contact-force", {}),
    ("lean", "contact-force", {}),
    ("slope", "disk-margin", {"contact_force": 100.0}),
]
"""Few, and with a smaller budget than in tests/bench, which holds more to ten times the speed."""


@pytest.mark.slow
@pytest.mark.parametrize(("name", "objective", "levels"), CASES)
def test_no_worse_than_a_global_search(name, objective, levels):
    rival = Rival(posed(name, objective, **levels))
    gains, _ = rival.search(maxiter=15, popsize=8)
    best, problem = rival.judged(gains)
    found = question.solve(problem).outcome.value
    assert found.value >= best * (1 - 1e-4)


@pytest.mark.slow
def test_its_best_lies_within_the_bracket():
    rival = Rival(posed("slope", "decay-rate", contact_force=180.0))
    gains, _ = rival.search(maxiter=12, popsize=8)
    best, problem = rival.judged(gains)
    found = bound.bracket(problem, question.solve(problem).outcome.value, seconds=300.0, gap=0.02)
    assert found.closed
    assert best <= found.bound
