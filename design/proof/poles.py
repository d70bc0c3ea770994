"""(27)-(29) and a decay rate, decided in rational arithmetic over a whole range of bodies and environments.

Over a box the answer may be "not seen", never wrong (``design.proof.exact``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import product

from design.model.stability import decay_rate, shifted
from design.proof.case import Case
from design.proof.exact import DIGITS, Range, around, body, decimal, loads, point, sizes

NAMES = ("I", "ell", "AL", "load")
CUTS = 15
"""How often ranges are cut in two for one decision."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Numbers:
    """Ranges of what the linear loop depends on: ``I``, ``ell``, ``AL`` = A L [N m], ``load`` = F_T + F_H [N]."""

    I: Range
    ell: Range
    AL: Range
    load: Range


def numbers(case: Case) -> Numbers:
    """The ranges for a part of a box."""
    scenario = case.scenario
    bodies = body(case.biped, case.radii)
    final = around(float(scenario.signal[0, -1]), case.radii[5])
    AL, load = sizes(bodies, scenario) * bodies.L, loads(bodies, scenario, final, ground_loads=case.biped.ground_loads)
    return Numbers(I=_shorter(bodies.I), ell=_shorter(bodies.ell), AL=_shorter(AL), load=_shorter(load))


def _shorter(part: Range) -> Range:
    """A range a trace wider, of numbers with few digits; one number stays as it is."""
    if part.low == part.high:
        return part
    return Range(Fraction(math.floor(part.low * DIGITS), DIGITS), Fraction(math.ceil(part.high * DIGITS), DIGITS))


def gathering(case: Case, at: Numbers) -> Range:
    """How much tau there is in s' [1/m]: 1/ell, times (M + m) g by the load where the law is (20) (``Case.size``)."""
    if case.kind != "cop":
        return point(1) / at.ell
    its = body(case.believed, (0.0,) * 7)
    return (its.M + its.m) * its.g / at.load / at.ell


def routh_hurwitz(case: Case, at: Numbers) -> dict[str, Range]:
    """How far (27)-(29) are kept, by row id: left less right, as in ``design.model.stability``."""
    K_p, K_d, K_f = (around(gain) for gain in case.gains)
    stiffness = K_p - at.AL
    if case.kind == "pd":
        return {"stiffness": stiffness, "damping": K_d}
    if case.kind == "cop":
        K_f = K_f * gathering(case, at) * at.ell
    damping = at.ell / at.I * K_d - K_f
    damping = Range(min(damping.low, K_f.low), min(damping.high, K_f.high))
    return {
        "stiffness": stiffness,
        "damping": damping,
        "routh": K_d * at.ell * stiffness - K_f * at.I * K_p,
    }


def characteristic(case: Case, at: Numbers) -> tuple[Range, ...]:
    """The coefficients after the leading 1, highest power first, as ``design.model.stability`` has them.

    Where the law adapts, reckoning with a body k that need not be the real one, with a = 1/T_a, g = K_f gather,
    e = a K_p (ell_k/ell - I_k/I)/(M g L)_k and c = I_k/I A L/(M g L)_k they are those of

        (lambda² - A L/I) (lambda² + (a - g - e) lambda - g a)
            + (K_d lambda³ + (K_p + a K_d) lambda² + a c K_p lambda)/I.
    """
    K_p, K_d, K_f = (around(gain) for gain in case.gains)
    per_I = point(1) / at.I
    if case.kind == "pd":
        return K_d * per_I, (K_p - at.AL) * per_I
    g = K_f * gathering(case, at)
    if case.size == 3:
        return K_d * per_I - g, (K_p - at.AL) * per_I, g * at.AL * per_I
    its, a = body(case.believed, (0.0,) * 7), point(1 / decimal(case.adapt))
    lever, turns = its.M * its.g * its.L, its.I * per_I
    e, c = K_p * a * (its.ell / at.ell - turns) / lever, turns * at.AL / lever
    falls = at.AL * per_I
    return (
        a - g - e + K_d * per_I,
        (K_p + a * K_d - at.AL) * per_I - g * a,
        (a * c * K_p - at.AL * (a - g - e)) * per_I,
        falls * g * a,
    )


def decays(case: Case, at: Numbers, sigma: Fraction) -> bool:
    """Whether every pole has a real part below -sigma, wherever in the ranges; False where that is not seen.

    Where it is seen in the middle, but not of the ranges as a whole, they are cut in two, across the relatively widest.
    """
    waiting, cuts = [at], 0
    while waiting:
        part = waiting.pop()
        if _stable(shifted(characteristic(case, part), sigma)):
            continue
        middle = _middle(part)
        cuts += 1
        if cuts > CUTS or not _stable(shifted(characteristic(case, middle), sigma)):
            return False
        name = max(NAMES, key=lambda name: _width(getattr(part, name)))
        whole, at_ = getattr(part, name), getattr(middle, name).low
        waiting += [replace(part, **{name: Range(whole.low, at_)}), replace(part, **{name: Range(at_, whole.high)})]
    return True


def rate(case: Case, at: Numbers) -> float:
    """The least decay rate [1/s] at the corners of the ranges."""
    if case.kind != "cop":
        at = replace(at, load=point(at.load.low))
    corners = product(*(sorted({each.low, each.high}) for each in (at.I, at.ell, at.AL, at.load)))
    points = (Numbers(**{name: point(end) for name, end in zip(NAMES, corner, strict=True)}) for corner in corners)
    return min(decay_rate([float(each.low) for each in characteristic(case, its)]) for its in points)


def _middle(at: Numbers) -> Numbers:
    return Numbers(**{name: point((getattr(at, name).low + getattr(at, name).high) / 2) for name in NAMES})


def _width(part: Range) -> Fraction:
    return (part.high - part.low) / max(abs(part.low), abs(part.high), Fraction(1, DIGITS))


def _stable(p: Sequence[Range]) -> bool:
    """Whether all monic polynomials with these coefficients are Hurwitz, (26)."""
    if not all(each.low > 0 for each in p):
        return False
    if len(p) == 4:
        return bool((p[2] * (p[0] * p[1] - p[2]) - p[0] * p[0] * p[3]).low > 0)
    return len(p) == 2 or bool((p[0] * p[1] - p[2]).low > 0)
