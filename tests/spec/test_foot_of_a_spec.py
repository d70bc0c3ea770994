"""A foot is told by one length or by two, and the target of the CoP lies within it."""

import pytest

from design.errors import BadInput
from design.spec.load import builtin_text, parse
from design.spec.setting import setting

TEXT = builtin_text("adult-foot")


def changed(*lines: tuple[str, str]) -> str:
    text = TEXT
    for old, new in lines:
        assert old in text
        text = text.replace(old, new, 1)
    return text


def test_toe_and_heel_become_half_a_length_and_a_skew():
    its = setting(parse(TEXT, origin="mine").spec)
    assert (its.biped.toe, its.biped.heel, its.biped.height) == pytest.approx((0.18, 0.06, 0.08), rel=1e-15)
    assert (its.biped.ell, its.biped.skew, its.target) == pytest.approx((0.12, 0.5, 0.03))
    assert not its.plain
    assert its.loop().law.target == 0.03


def test_equal_levers_are_the_same_body_as_half_a_length():
    old = ("toe_m = 0.18 ", "toe_m = 0.1 "), ("heel_m = 0.06 ", "heel_m = 0.1 "), ("ankle_height_m = 0.08", "")
    one = setting(parse(changed(*old), origin="mine").spec)
    half = "[foot]\nmass_kg = 2.0\nhalf_length_m = 0.1\n"
    start, end = TEXT.index("[foot]"), TEXT.index("[[scenarios]]")
    other = setting(parse(TEXT[:start] + half + TEXT[end:], origin="mine").spec)
    assert one.biped == other.biped
    assert one.biped.ell == 0.1


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ([("toe_m = 0.18", "half_length_m = 0.18")], "mine: foot.half_length_m: is given, and so is heel_m; leave one"),
        ([("heel_m = 0.06", "")], "mine: foot.heel_m: is missing; needs half_length_m"),
        ([("toe_m = 0.18", "")], "mine: foot.toe_m: is missing; needs half_length_m"),
        ([("toe_m = 0.18", "toes_m = 0.18")], "mine: foot.toes_m: unknown key; did you mean 'toe_m'"),
        ([("cop_target_m = 0.03", "cop_target_m = 0.18")], "mine: law.cop_target_m = 0.18 is not within the foot"),
        ([("cop_target_m = 0.03", "cop_target_m = -0.07")], "needs more than -0.06 (the heel) and less than 0.18 (the"),
    ],
)
def test_a_foot_that_is_told_twice_or_half_is_one_line(lines, said):
    with pytest.raises(BadInput) as caught:
        parse(changed(*lines), origin="mine")
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_built_in_foot_stands_through_its_scenario():
    from design.analysis.verdict import judge

    its = setting(parse(TEXT, origin="mine").spec)
    verdict = judge(its, its.given_gains())
    rows = {row.id: row for row in verdict.rows}
    assert verdict.overall == "met", rows
