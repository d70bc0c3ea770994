"""A number that something is shown to be at least, or at most, is rounded so that what is printed stays true."""

from dataclasses import replace
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from design.analysis.rows import Row
from design.present.text import bound, margin_of, value_of

sizes = st.floats(1e-9, 1e12) | st.floats(-1e12, -1e-9)
ROW = Row(id="heel-force", equation="(6)", scenario="s", unit="N", value=1.0, required=0.0, margin=1.0, status="met",
          time_s=None, basis="proved")  # fmt: skip


@given(value=sizes, digits=st.integers(3, 9))
def test_it_is_on_the_right_side_and_within_the_last_digit(value, digits):
    exact = Fraction(repr(value))
    below, above = Fraction(bound(value, digits)), Fraction(bound(value, digits, up=True))
    assert below <= exact <= above
    assert above - below <= abs(exact) * Fraction(1, 10 ** (min(digits, 4) - 1))


@pytest.mark.parametrize("value", [172.265853, 0.0226112099, 29.53949999, 42.39996])
def test_proved_rows_are_rounded_inward_and_sampled_ones_to_the_nearest(value):
    row = replace(ROW, value=value, margin=value)
    assert Fraction(value_of(row)) <= Fraction(repr(value))
    assert Fraction(margin_of(row, 4)) <= Fraction(repr(value))
    assert Fraction(value_of(replace(row, id="torque"))) >= Fraction(repr(value))
    assert Fraction(value_of(replace(row, basis="sampled"))) == pytest.approx(value, rel=1e-4)
