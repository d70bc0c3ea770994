"""Optima that independent code found within the paper's caps (K_p <= 3500, K_d <= 1200, K_f <= 17)."""

from dataclasses import replace

import pytest

from design.model.limits import Required
from design.spec.load import load
from design.spec.setting import setting
from problems.gains import solve

SLOPE = setting(load("slope").spec)


def test_greatest_smallest_contact_force():
    found = solve(SLOPE).outcome.value
    assert found.value == pytest.approx(190.9948, abs=1e-3)
    assert found.gains.K_p == 3500.0
    assert found.gains.K_d == pytest.approx(902.6, abs=0.5)
    assert found.gains.K_f == pytest.approx(8.457, abs=0.005)
    assert 3 <= found.reached < found.starts == 4  # the last start finds another hill, with K_d at its bound
    assert {each.id for each in found.active} == {"kp", "toe-force", "heel-force"}


@pytest.mark.parametrize(("contact", "rate", "tolerance"), [(180.0, 8.4451, 5e-4), (0.0, 12.185, 1e-3)])
def test_greatest_decay_rate(contact, rate, tolerance):
    required = {**SLOPE.required, "contact-force": Required(level=contact)}
    found = solve(replace(SLOPE, objective="decay-rate", required=required)).outcome.value
    assert found.value == pytest.approx(rate, abs=tolerance)
    assert found.verdict.overall == "met"


def test_routh_margin_has_a_closed_form():
    # 1 - r - kappa and r are equal at the best r, and kappa = A L / K_p is least at the upper bound of K_p
    kappa = SLOPE.biped.M * SLOPE.biped.g * SLOPE.biped.L / 3500.0
    found = solve(replace(SLOPE, objective="routh-margin")).outcome.value
    assert found.value == pytest.approx((1 - kappa) / 2, rel=1e-6)


def test_law_pd_decays_as_fast_as_its_double_pole():
    # two real poles merge at -K_d/(2 I) when K_p - A L = K_d^2/(4 I): the best K_d within K_p <= 3500
    biped = SLOPE.biped
    best = ((3500.0 - biped.M * biped.g * biped.L) / biped.I) ** 0.5
    mild = replace(SLOPE.scenarios[0], signal=SLOPE.scenarios[0].signal / 10)  # 3 degrees: pd keeps contact there
    found = solve(replace(SLOPE, law="pd", objective="decay-rate", scenarios=(mild,), gains=None)).outcome.value
    assert found.value == pytest.approx(best, rel=1e-5)
    assert found.gains.K_f == 0.0
