"""A time limit is kept by whatever takes time in a proof, and what was proved by then is kept."""

import math
import time
from dataclasses import replace

import pytest
from certificate_cases import BOXED, source

from design.model.laws import Gains
from design.model.uncertainty import Spread, Tolerances
from design.proof.box import Proof, prove
from design.proof.certificate import Unconfirmed, confirmed
from design.proof.largest import largest
from design.spec.load import builtin_text, load
from design.spec.setting import setting

SLOPE = setting(load("slope").spec)
WIDE = Tolerances(
    M=Spread(part=0.12), L=Spread(part=0.12), I=Spread(part=0.12), m=Spread(part=0.12), ell=Spread(part=0.12),
    slope=Spread(absolute=math.radians(0.5)), ramp=Spread(absolute=0.2),
)  # fmt: skip
HARD = replace(SLOPE, tolerances=WIDE)
CALM = Gains(3500.0, 606.2, 5.61)
LATE = 0.3
"""What a loaded machine may add [s]."""


@pytest.mark.parametrize("seconds", [0.0, 0.4, 1.5])
def test_a_proof_ends_in_time_and_says_unknown(seconds):
    began = time.monotonic()
    proof = prove(HARD, CALM, "ramp", seconds=seconds)
    assert time.monotonic() - began < 1.1 * seconds + LATE
    assert proof.answer == "unknown"
    assert proof.why.startswith("time limit")
    assert 0 <= proof.share < 1


def test_the_search_for_the_largest_box_ends_in_time():
    began = time.monotonic()
    found = largest(HARD, CALM, "ramp", seconds=1.0)
    assert time.monotonic() - began < 1.1 + LATE
    assert found.proved <= found.unbroken


def test_a_certificate_is_written_in_time_or_not_at_all():
    its = source(builtin_text("slope"), BOXED)
    problem = setting(its.spec)
    proof = Proof(scenario="ramp", answer="proved", value={"cop-margin": 0.0157, "decay-rate": 8.2})
    began = time.monotonic()
    with pytest.raises(Unconfirmed, match="time limit"):
        confirmed(its, problem, problem.gains, proof, seconds=0.5)
    assert time.monotonic() - began < 0.55 + LATE
