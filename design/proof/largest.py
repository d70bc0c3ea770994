"""How large a box can be: the largest multiple of [uncertainty] that is proved, and the smallest that is broken.

Both by bisection over the multiple. Broken: a corner of the box, or one of a low-discrepancy set of points in it, loses
contact in a simulation (``design.analysis.many``). The true limit lies between the two; their ratio says how much the
proof gives away.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

from design.analysis.many import least_forces
from design.analysis.spread import in_box
from design.model.laws import Gains
from design.proof.box import levels, prove
from design.spec.setting import Setting

INSIDE = 256
"""Points inside the box that are tried beside its corners."""
LARGEST = 64.0
"""Multiples beyond this are not looked at."""
CLOSE = 1.03
"""Ratio of the ends of a bisection at which it stops."""


@dataclass(frozen=True, kw_only=True)
class Largest:
    """``proved`` and ``unbroken``: the largest multiples of the box that are proved, and that sampling cannot break.

    ``beyond``: whether even ``LARGEST`` is not broken.
    """

    scenario: str
    proved: float
    unbroken: float
    beyond: bool

    @property
    def ratio(self) -> float:
        """The part of what sampling cannot break that is proved."""
        return self.proved / self.unbroken if self.unbroken > 0 else 1.0


def largest(
    setting: Setting, gains: Gains, name: str, *, seconds: float = 120.0, say: Callable[[str], None] = lambda _: None
) -> Largest:
    """Both multiples in the scenario called ``name``; proofs are given ``seconds`` in all.

    Raises ``ValueError`` where the spec has no [uncertainty] that bears on the scenario.
    """
    setting.must_be_plain("a proof")
    tolerances = setting.tolerances
    if tolerances.none:
        message = "there is no box: [uncertainty] is empty"
        raise ValueError(message)
    unbroken, beyond = _unbroken(setting, gains, name, say)
    began = time.monotonic()

    def provable(scale: float) -> bool:
        left = seconds - (time.monotonic() - began)
        if left <= 0:
            return False
        say(f"{name}: proving {scale:.3g} times the box")
        return prove(setting, gains, name, seconds=0.25 * left, scale=scale).answer == "proved"

    low, high = 0.0, min(0.25, unbroken)
    while high <= unbroken and provable(high):
        low, high = high, 2 * high
    proved = _end(provable, min(high, unbroken), low)
    return Largest(scenario=name, proved=proved, unbroken=unbroken, beyond=beyond)


def _end(holds: Callable[[float], bool], most: float, least: float = 0.0) -> float:
    """The largest multiple up to ``most`` that holds, by bisection; ``least`` is known to."""
    if most <= least:
        return least
    low, high = least, most
    scale = math.sqrt(low * high) if low > 0 else 0.5 * high
    for _ in range(12):
        if holds(scale):
            low = scale
        else:
            high = scale
        if low > 0 and high / low <= CLOSE:
            break
        scale = math.sqrt(low * high) if low > 0 else 0.5 * high
    return low


def _unbroken(setting: Setting, gains: Gains, name: str, say: Callable[[str], None]) -> tuple[float, bool]:
    scenario = setting.scenario(name)
    points = in_box(setting.tolerances, INSIDE)
    level = levels(setting)["toe-force"]

    def holds(scale: float) -> bool:
        say(f"{name}: trying to break {scale:.3g} times the box")
        tolerances = setting.tolerances.scaled(scale)
        values = (setting.biped.M, setting.biped.L, setting.biped.I, setting.biped.ell)
        widths = [
            getattr(tolerances, key).around(value, 1.0) - value
            for key, value in zip(("M", "L", "I", "ell"), values, strict=True)
        ]
        if any(width >= value for width, value in zip(widths, values, strict=True)):
            return False
        toe, heel = least_forces(
            setting.under(scenario).biped, setting.law, gains, scenario, tolerances, points,
            step=max(setting.step, 2e-3), theta_d=setting.theta_d, adapt=setting.adapt, known=setting.known,
        )  # fmt: skip
        return bool(min(toe.min(), heel.min()) >= level)

    low, high = 0.0, 1.0
    while holds(high):
        low, high = high, 2 * high
        if high > LARGEST:
            return LARGEST, True
    return low + _end(lambda more: holds(low + more), high - low), False
