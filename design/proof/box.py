"""A proof over a box: bounded as a whole where that is enough, else cut in two, until all is proved or time is up.

A part counts as proved when every demand is kept by its bounds; the bound of the whole is the worst of its parts'. A
part that cannot be bounded, or whose bounds break a demand, is first searched for a counterexample (its middle and its
corners, run by an integrator that shares nothing with the prover), then cut across the parameter that moves the
equations most. Stability is decided exactly in each part.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Literal

import numpy as np

from design.model.laws import Gains
from design.proof import poles
from design.proof.case import NAMES, Case, NotProved
from design.proof.counterexample import Counterexample, counterexample
from design.proof.tube import bounds
from design.spec.setting import Setting

Answer = Literal["proved", "disproved", "unknown"]
SHARES_OF_RATE = (1 - 1e-8, 1 - 1e-6, 0.999, 0.99, 0.95, 0.8, 0.65, 0.5, 0.2, 0.0)
"""Parts of the least decay rate at a corner at which a proof of it is tried."""
SMALLEST = 2.0**-12
"""Parts of a box below this volume are given up."""


@dataclass(kw_only=True)
class Proof:
    """What is proved of one scenario.

    ``value``: by row, the bound that holds for every body and world of the box and all times; ``time_s`` where it is
    worst; ``share`` of the box that is proved; ``parts`` bounded; ``why`` not all.
    """

    scenario: str
    answer: Answer = "unknown"
    value: dict[str, float] = field(default_factory=dict)
    time_s: dict[str, float] = field(default_factory=dict)
    share: float = 0.0
    parts: int = 0
    seconds: float = 0.0
    why: str = ""
    counterexample: Counterexample | None = None
    box: dict[str, tuple[float, float]] = field(default_factory=dict)


def levels(setting: Setting) -> dict[str, float]:
    """What must be kept, by row: contact, CoP margin and stability always, torque where the spec limits it."""
    hard = {row: required.level for row, required in setting.required.items() if not required.soft}
    found = {
        "toe-force": hard.get("contact-force", 0.0), "heel-force": hard.get("contact-force", 0.0),
        "cop-margin": hard.get("cop-margin", 0.0), "decay-rate": hard.get("decay-rate", 0.0),
    }  # fmt: skip
    if "torque" in hard:
        found["torque"] = hard["torque"]
    return found


def prove(
    setting: Setting,
    gains: Gains,
    scenario_name: str,
    *,
    seconds: float = 60.0,
    scale: float = 1.0,
    say: Callable[[str], None] = lambda _: None,
) -> Proof:
    """Prove what ``levels`` demands of ``gains`` in one scenario, over ``scale`` times the box of [uncertainty]."""
    began = time.monotonic()
    setting.must_be_plain("a proof")
    scenario = setting.scenario(scenario_name)
    whole = _case(setting, gains, scenario_name, scale)
    demanded = levels(setting)
    proof = Proof(scenario=scenario.name, box=_box(whole))
    waiting: list[tuple[Case, float]] = [(whole, 1.0)]
    while waiting:
        proof.seconds = time.monotonic() - began
        if proof.parts and proof.seconds > seconds:
            proof.why = f"time limit of {seconds:g} s"
            return proof
        case, volume = waiting.pop()
        why, halves = _part(case, demanded, proof)
        if proof.counterexample is not None:
            proof.answer, proof.why = "disproved", why
            proof.seconds = time.monotonic() - began
            return proof
        if not why:
            proof.share += volume
            say(f"{scenario.name}: {100 * proof.share:.4g} % of the box proved, {proof.parts} parts")
        elif not halves or volume <= SMALLEST:
            proof.why = why
            proof.seconds = time.monotonic() - began
            return proof
        else:
            waiting += [(half, 0.5 * volume) for half in halves]
    proof.answer, proof.share, proof.seconds = "proved", 1.0, time.monotonic() - began
    return proof


def _case(setting: Setting, gains: Gains, name: str, scale: float) -> Case:
    scenario, tolerances = setting.scenario(name), setting.tolerances
    setting = setting.under(scenario)
    biped = setting.biped
    ramp = float(scenario.times[-1]) if scenario.kind in ("slope", "force") else 0.0
    final = float(scenario.signal[0, -1]) if scenario.kind == "slope" else 0.0
    values = (biped.M, biped.L, biped.I, biped.m, biped.ell, final, ramp)
    radii = [
        scale * (getattr(tolerances, name).around(value, 1.0) - value)
        for name, value in zip(NAMES, values, strict=True)
    ]
    if scenario.kind != "slope":
        radii[5] = 0.0
    if ramp == 0:
        radii[6] = 0.0
    return Case(
        biped=biped, kind=setting.law, gains=gains, theta_d=setting.theta_d, scenario=scenario, radii=tuple(radii),
        step=setting.step, known=setting.known or biped, adapt=setting.adapt,
    )  # fmt: skip


def _box(case: Case) -> dict[str, tuple[float, float]]:
    middle = case.middle
    return {
        name: (middle[name] - radius, middle[name] + radius)
        for name, radius in zip(NAMES, case.radii, strict=True) if radius > 0
    }  # fmt: skip


def _part(case: Case, demanded: dict[str, float], proof: Proof) -> tuple[str, list[Case]]:
    """Why this part is not proved (empty: it is), and its halves; counts it, and notes a counterexample."""
    proof.parts += 1
    why = _unstable(case, demanded, proof)
    influence = None
    if not why:
        try:
            found = bounds(case)
        except NotProved as error:
            why, influence = str(error), error.influence
        else:
            influence = found.influence
            for row, level in demanded.items():
                if row == "decay-rate":
                    continue
                series = found.high[row] if row == "torque" else found.low[row]
                margins = level - series if row == "torque" else series - level
                worst = int(np.argmin(margins))
                if not margins[worst] >= 0:
                    why = f"{row}: the bound is {series[worst]:.6g} at {found.t[worst]:.3f} s; needs {level:g}"
                    break
                better = proof.value.get(row)
                value = float(series[worst])
                if better is None or (value > better if row == "torque" else value < better):
                    proof.value[row], proof.time_s[row] = value, float(found.t[worst])
    if not why:
        return "", []
    proof.counterexample = counterexample(case, demanded, corners=proof.parts <= 2)
    if proof.counterexample is not None:
        broken = proof.counterexample
        return f"{broken.row} is {broken.value:.6g} for a body and world of the box", []
    return why, _halves(case, influence)


def _unstable(case: Case, demanded: dict[str, float], proof: Proof) -> str:
    """Why stability is not decided over this part; notes what is proved of its rows."""
    at = poles.numbers(case)
    if case.kind == "cop" and at.load.low <= 0:
        return "at rest toe and heel together may bear nothing, and law cop divides by what they bear"
    found = {}
    for row, margin in poles.routh_hurwitz(case, at).items():
        if margin.low <= 0:
            return f"{row}: not decided over this part of the box"
        found[row] = float(margin.low)
    corner = poles.rate(case, at)
    required = Fraction(repr(demanded["decay-rate"]))
    for share in SHARES_OF_RATE[3 if case.moving else 0 :]:
        sigma = max(Fraction(f"{max(corner, 0.0) * share:.10g}"), required)
        if poles.decays(case, at, sigma):
            found["decay-rate"] = float(sigma)
            break
    else:
        return f"decay-rate: {float(required):g} is not decided over this part of the box"
    for row, value in found.items():
        proof.value[row] = min(value, proof.value.get(row, math.inf))
    return ""


def _halves(case: Case, influence: dict[int, float] | None) -> list[Case]:
    """The part cut in two across the parameter of largest influence, or of largest share; none where nothing moves."""
    if not case.moving:
        return []
    middle = list(case.middle.values())
    if influence:
        k = max(case.moving, key=lambda k: influence[k])
    else:
        k = max(case.moving, key=lambda k: case.radii[k] / max(abs(middle[k]), 1e-9))
    radii = list(case.radii)
    radii[k] *= 0.5 * (1 + 1e-15)  # what is rounded away at the seam is covered twice
    found = []
    for side in (-0.5, 0.5):
        biped, scenario = case.at({k: side})
        found.append(replace(case, biped=biped, scenario=scenario, radii=tuple(radii)))
    return found
