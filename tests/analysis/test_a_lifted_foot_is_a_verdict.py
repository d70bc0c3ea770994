"""A force that lifts the biped off the ground is answered with ``violated``, under every law, and not with an error.

On the way up the force passes two singular places: A = 0 (3), where no posture is preferred, and F_T + F_H = 0, by
which law cop divides.
"""

from dataclasses import replace

import pytest

from design.analysis.verdict import judge
from design.model.environment import constant_force
from design.model.laws import Gains
from design.spec.load import load
from design.spec.setting import setting

SLOPE = setting(load("slope").spec)
WEIGHT = SLOPE.biped.weight


@pytest.mark.parametrize("kind", ["pd", "force", "cop"])
@pytest.mark.parametrize("lift", [WEIGHT, 2 * WEIGHT, 1.7 * WEIGHT], ids=["just", "twice", "well"])
def test_a_lifted_foot_is_a_violation(kind, lift):
    up = constant_force(name="lift", F_x=10.0, F_y=lift, ramp=1.0, duration=2.0)
    verdict = judge(replace(SLOPE, scenarios=(up,), law=kind), Gains(3500.0, 1200.0, 1.0))
    assert verdict.overall == "violated"
    standing = [row.status == "met" for row in verdict.rows if row.id in ("toe-force", "heel-force")]
    assert len(standing) == 2
    assert not all(standing)
