"""The longest sampling period as the zero of smooth functions: where it is, where it jumps, and models about there."""

import numpy as np
import pytest

from design.model.laws import Gains
from design.model.sampling import exits, longest_period, sampled_matrix
from design.spec.load import load
from design.spec.setting import setting
from problems.gains.held import held
from problems.gains.model import Implicit
from problems.gains.pieces import Piece
from problems.gains.question import Question

SETTING = setting(load("slope").spec)
QUESTION = Question(SETTING)
PLACE = QUESTION.environments[0]
ORDINARY = np.array([3500.0, 902.6, 8.457])
JUST_INSIDE, JUST_OUTSIDE = np.array([780.0, 143.836, 0.8034]), np.array([800.0, 143.836, 0.8034])
"""Gains between which a pair of eigenvalues begins to leave the unit circle for a while."""


def _where(K):
    return SETTING.biped, "force", Gains(*map(float, K)), PLACE.place.A, PLACE.place.load


def _radius(K, T):
    return np.abs(np.linalg.eigvals(sampled_matrix(*_where(K), T))).max()


@pytest.mark.parametrize("K", [ORDINARY, JUST_INSIDE, JUST_OUTSIDE])
def test_an_eigenvalue_is_on_the_circle_at_the_longest_period_and_none_outside_before(K):
    T = longest_period(*_where(K))
    assert _radius(K, T) == pytest.approx(1.0, abs=1e-9)
    assert max(_radius(K, t) for t in np.linspace(1e-4, 0.9999 * T, 4000)) < 1.0


def test_the_period_jumps_where_a_minimum_comes_down_to_zero():
    def gap(K):
        return next(each for each in exits(*_where(K)) if each.which == 2 and each.gap is not None)

    low, high = JUST_INSIDE, JUST_OUTSIDE
    assert gap(low).gap > 0 > gap(high).gap
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if gap(middle).gap > 0 else (low, middle)
    one, other = longest_period(*_where(low)), longest_period(*_where(high))
    assert other < 0.99 * one
    assert other == pytest.approx(gap(high).period, rel=1e-4)


@pytest.mark.parametrize("K", [ORDINARY, JUST_OUTSIDE])
def test_the_zeros_of_the_models_are_the_exits_to_third_order(K):
    """Halving the step divides the error of a quadratic model by eight; by two or four if a derivative is wrong."""
    scale, u = QUESTION.scale, K / QUESTION.scale
    found = [Piece(1.0 + each.which, each.period) for each in exits(*_where(K)) if each.gap is None]
    models = held(PLACE, scale, u, found, [], np.inf)
    first = min(found, key=lambda piece: piece.value)
    own = [model for model in models if isinstance(model, Implicit) and model.value == first.value]
    assert len(own) == 1
    for way in np.random.default_rng(1).standard_normal((4, 3)):
        errors = []
        for size in (4e-4, 2e-4):
            there = u + size * way * u
            T = min(each.period for each in exits(*_where(there * scale)) if each.gap is None)
            errors.append(abs(float(own[0](there, T)) - T))
        assert errors[1] < errors[0] / 5 + 1e-12


def test_what_is_modelled_at_a_required_period_is_there_exact():
    scale, u = QUESTION.scale, ORDINARY / QUESTION.scale
    found = [Piece(1.0 + each.which, each.period) for each in exits(*_where(ORDINARY)) if each.gap is None]
    T = longest_period(*_where(ORDINARY))
    for level, kept in ((0.5 * T, True), (0.999 * T, True), (1.001 * T, False)):
        models = held(PLACE, scale, u, found, [], level)
        assert (min(float(model(u, level)) - level for model in models) >= 0) is kept
