"""Every operation on models holds the exact result, for all the functions that its operands stand for."""

from fractions import Fraction

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.proof.norm import falls
from design.proof.spans import Span
from design.proof.taylor import DEGREE, Model, constant, inverse, reciprocal, sine_and_cosine

PIECES, PARAMETERS = 3, 2


def _model(seed, size=1.0, rest=1e-3):
    rng = np.random.default_rng(seed)
    scale = size * np.array([1.0, 0.3, 0.1, 0.03, 0.01, 0.003, 1e-3, 3e-4]) * np.array([1.0, 0.1, 0.02])[:, None]
    return Model(rng.standard_normal((PIECES, 1 + PARAMETERS, DEGREE + 1)) * scale, rest * rng.random(PIECES))


def _exact(model, piece, v, p, share):
    """The value, as a rational, of the function that lies at ``share`` of the rest."""
    c = [[Fraction(float(entry)) for entry in row] for row in model.c[piece]]
    powers = [Fraction(v) ** d for d in range(DEGREE + 1)]
    rows = [sum(a * b for a, b in zip(row, powers, strict=True)) for row in c]
    moved = sum(Fraction(share) * row for share, row in zip(p, rows[1:], strict=True))
    return rows[0] + moved + Fraction(share) * Fraction(float(model.rest[piece]))


seeds = st.integers(0, 10_000)
unit = st.floats(-1.0, 1.0)
ends = st.one_of(unit, st.sampled_from([-1.0, 1.0]))
places = st.tuples(ends, ends, ends)
shares = st.sampled_from([-1, 0, 1])


def _holds(model, truth, piece, place):
    v, *p = place
    return abs(truth - _exact(model, piece, v, p, 0)) <= Fraction(float(model.rest[piece]))


@given(one=seeds, two=seeds, place=places, first=shares, second=shares, size=st.sampled_from([1e-8, 1.0, 1e6]))
@settings(max_examples=150, deadline=None)
def test_sums_and_products_hold_the_exact_ones(one, two, place, first, second, size):
    a, b = _model(one, size), _model(two)
    v, *p = place
    for piece in range(PIECES):
        x, y = _exact(a, piece, v, p, first), _exact(b, piece, v, p, second)
        for model, truth in ((a + b, x + y), (a - b, x - y), (a * b, x * y), (a * 0.3, x * Fraction(0.3)), (-a, -x)):
            assert _holds(model, truth, piece, place)


@given(seed=seeds, place=places, share=shares, size=st.sampled_from([1e-6, 0.1, 0.7]))
@settings(max_examples=80, deadline=None)
def test_sine_and_cosine_hold_those_of_mpmath(seed, place, share, size):
    x = _model(seed, size, rest=1e-6)
    s, c = sine_and_cosine(x)
    v, *p = place
    with mpmath.workdps(40):
        for piece in range(PIECES):
            at = _exact(x, piece, v, p, share)
            exact = mpmath.mpf(at.numerator) / at.denominator
            for model, truth in ((s, mpmath.sin(exact)), (c, mpmath.cos(exact))):
                assert _holds(model, Fraction(int(truth * mpmath.mpf(10) ** 35), 10**35), piece, place)


def test_an_angle_out_of_reach_is_refused():
    with pytest.raises(ValueError, match="angle"):
        sine_and_cosine(constant(1, 0, 4.1))


@given(seed=seeds, place=places, share=shares)
@settings(max_examples=60, deadline=None)
def test_bounds_hold_every_value(seed, place, share):
    model = _model(seed)
    low, high = model.bounds()
    v, *p = place
    for piece in range(PIECES):
        value = _exact(model, piece, v, p, share)
        assert Fraction(float(low[piece])) <= value <= Fraction(float(high[piece]))
        assert abs(value) <= Fraction(float(model.size()[piece]))


@given(seed=seeds, place=places, share=shares, m=st.sampled_from([2, 4, 8]))
@settings(max_examples=60, deadline=None)
def test_a_piece_cut_into_parts_holds_the_same_functions(seed, place, share, m):
    whole = _model(seed)
    parts = whole.parted(m)
    v, *p = place
    for piece in range(PIECES):
        for j in range(m):
            truth = _exact(whole, piece, (1 + 2 * j - m + Fraction(v)) / m, p, share)
            assert _holds(parts, truth, m * piece + j, place)


@given(x=st.floats(0.0, 800.0))
def test_an_exponential_is_held(x):
    least, most = falls(np.array([x]))
    with mpmath.workdps(40):
        truth = mpmath.exp(-mpmath.mpf(x))
        assert mpmath.mpf(least[0]) <= truth <= mpmath.mpf(most[0])
        assert x > 700 or most[0] - least[0] < (1e-6 + 1e-12 * x**5) * float(truth)


@given(value=st.floats(0.01, 100.0), part=st.floats(0.0, 0.5), share=ends)
def test_a_reciprocal_is_held(value, part, share):
    radius = part * value
    a, b, r = reciprocal(value, radius)
    truth = 1 / (Fraction(value) + Fraction(share) * Fraction(radius))
    assert abs(truth - Fraction(a) - Fraction(share) * Fraction(b)) <= Fraction(r)


@given(
    seed=seeds,
    place=places,
    share=shares,
    size=st.sampled_from([1e-8, 1e-3, 0.1]),
    middle=st.sampled_from([-3.0, 1.0, 450.0]),
)
@settings(max_examples=80, deadline=None)
def test_the_inverse_of_a_model_is_held(seed, place, share, size, middle):
    x = _model(seed, size * abs(middle), rest=1e-6) + middle
    if not (x.rest + np.abs(x.c).sum(axis=(1, 2)) - np.abs(x.centre()) < np.abs(x.centre())).all():
        with pytest.raises(ValueError, match="may be zero"):
            inverse(x)
        return
    found = inverse(x)
    v, *p = place
    for piece in range(PIECES):
        assert _holds(found, 1 / _exact(x, piece, v, p, share), piece, place)
        assert size > 1e-3 or found.rest[piece] < 1e-5


def test_what_may_be_zero_has_no_inverse():
    model = Model(np.array([[[1.0, 0.6, *[0.0] * 6], [0.4, *[0.0] * 7]]]), np.zeros(1))
    for bad in (model, -model, constant(1, 0, 0.0)):
        with pytest.raises(ValueError, match="may be zero"):
            inverse(bad)


@given(a=st.tuples(unit, unit), b=st.tuples(unit, unit), one=st.floats(0.0, 1.0), two=st.floats(0.0, 1.0))
def test_spans_hold_what_is_made_of_their_numbers(a, b, one, two):
    A, B = (Span(np.array([min(pair)]), np.array([max(pair)])) for pair in (a, b))
    x = min(max(a), max(min(a), min(a) + one * (max(a) - min(a))))
    y = min(max(b), max(min(b), min(b) + two * (max(b) - min(b))))
    X, Y = Fraction(x), Fraction(y)
    for span, truth in ((A.plus(B), X + Y), (A.less(B), X - Y), (A.times(B), X * Y), (A.times(0.3), X * Fraction(0.3))):
        assert Fraction(float(span.low[0])) <= truth <= Fraction(float(span.high[0]))
    if min(b) > 1e-9:
        quotient = A.over(B)
        assert Fraction(float(quotient.low[0])) <= X / Y <= Fraction(float(quotient.high[0]))
    elif min(b) <= 0:
        with pytest.raises(ValueError, match="zero"):
            A.over(B)


@given(seed=seeds, v=st.sampled_from([-1.0, -0.5, 0.0, 0.25, 1.0]))
def test_the_slope_is_that_of_the_polynomial(seed, v):
    model = _model(seed, rest=0.0)
    slope = model.slope()
    for piece in range(PIECES):
        c = [Fraction(float(entry)) for entry in model.c[piece, 0]]
        truth = sum(d * c[d] * Fraction(v) ** (d - 1) for d in range(1, DEGREE + 1))
        assert _holds(slope, truth, piece, (v, 0.0, 0.0))
    with pytest.raises(ValueError, match="polynomial"):
        _model(seed, rest=1.0).slope()
