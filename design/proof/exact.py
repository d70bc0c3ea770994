"""(27)-(29) and a decay rate, decided in rational arithmetic over a whole range of bodies and environments.

Numbers are the decimals that they print as. Ranges of rationals are added and multiplied without rounding; what depends
on a parameter twice is enclosed, not exact, so that over a box the answer may be "unknown", never wrong. A follows from
(3): on a slope it is M g; under a force it is largest at a corner of the signal (a norm is convex) and smallest where
the segment between two corners is nearest to the origin; its square root is enclosed by rationals.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise, product

from design.model.body import Biped
from design.model.environment import Scenario
from design.model.stability import decay_rate, shifted
from design.proof.case import Case

DIGITS = 10**12
"""Square roots are enclosed to one part in this."""
NAMES = ("I", "ell", "AL", "load")
CUTS = 15
"""How often ranges are cut in two for one decision."""


@dataclass(frozen=True)
class Range:
    """All rationals from ``low`` to ``high``."""

    low: Fraction
    high: Fraction

    def __add__(self, other: Range | Fraction | int) -> Range:
        """All sums."""
        its = _range(other)
        return Range(self.low + its.low, self.high + its.high)

    def __neg__(self) -> Range:
        """All negatives."""
        return Range(-self.high, -self.low)

    def __sub__(self, other: Range | Fraction | int) -> Range:
        """All differences."""
        return self + (-other)

    def __mul__(self, other: Range | Fraction | int) -> Range:
        """All products."""
        its = _range(other)
        ends = [a * b for a in (self.low, self.high) for b in (its.low, its.high)]
        return Range(min(ends), max(ends))

    __radd__ = __add__
    __rmul__ = __mul__

    def __truediv__(self, other: Range) -> Range:
        """All quotients; raises ``ZeroDivisionError`` where ``other`` holds 0."""
        if other.low <= 0 <= other.high:
            raise ZeroDivisionError
        return self * Range(1 / other.high, 1 / other.low)


def _range(number: Range | Fraction | int) -> Range:
    return number if isinstance(number, Range) else point(number)


def decimal(value: float) -> Fraction:
    """The decimal that a float prints as."""
    return Fraction(repr(float(value)))


def around(value: float, radius: float = 0.0) -> Range:
    """``value`` +- ``radius``, both as printed; a radius is a trace larger, as both have been computed then."""
    middle, reach = decimal(value), decimal(radius) * (1 + Fraction(1, 10**12))
    if radius:
        reach += abs(middle) / 10**14
    return Range(middle - reach, middle + reach)


def point(value: Fraction | int) -> Range:
    """One number."""
    return Range(Fraction(value), Fraction(value))


@dataclass(frozen=True, eq=False, kw_only=True)
class Body:
    """Ranges of the numbers of ``Biped``."""

    M: Range
    L: Range
    I: Range
    m: Range
    ell: Range
    g: Range


def body(biped: Biped, radii: tuple[float, ...]) -> Body:
    """The bodies around ``biped``, as in ``design.proof.tube``."""
    values = (biped.M, biped.L, biped.I, biped.m, biped.ell)
    ranges = [around(value, radius) for value, radius in zip(values, radii[:5], strict=True)]
    return Body(M=ranges[0], L=ranges[1], I=ranges[2], m=ranges[3], ell=ranges[4], g=around(biped.g))


def sizes(bodies: Body, scenario: Scenario) -> Range:
    """The range of A [N], (3)."""
    weight = bodies.M * bodies.g
    if scenario.kind == "slope":
        return weight
    points = []
    for column in scenario.signal.T.tolist():
        if scenario.kind == "platform":
            points.append((bodies.M * -around(column[0]), weight))
        else:
            points.append((around(column[0]), weight - around(column[1])))
    squares = [_square(x) + _square(y) for x, y in points]
    low = min(square.low for square in squares)
    for (x0, y0), (x1, y1) in pairwise(points):
        low = min(low, _nearest(x0, y0, x1, y1))
    return Range(_root(low)[0], _root(max(square.high for square in squares))[1])


def _square(x: Range) -> Range:
    ends = (x.low * x.low, x.high * x.high)
    return Range(Fraction(0) if x.low <= 0 <= x.high else min(ends), max(ends))


def _nearest(x0: Range, y0: Range, x1: Range, y1: Range) -> Fraction:
    """A lower bound of the square of the distance between the origin and a segment, by the box that holds it."""
    x, y = Range(min(x0.low, x1.low), max(x0.high, x1.high)), Range(min(y0.low, y1.low), max(y0.high, y1.high))
    return _square(x).low + _square(y).low


def _root(square: Fraction) -> tuple[Fraction, Fraction]:
    """Rationals around the square root."""
    scaled = square * DIGITS**2
    below = math.isqrt(scaled.numerator // scaled.denominator)
    return Fraction(below, DIGITS), Fraction(below + 1, DIGITS)


def loads(bodies: Body, scenario: Scenario, slope: Range) -> Range:
    """The range of F_T + F_H at rest [N], anywhere along the scenario; ``slope`` is the final one [rad]."""
    foot, weight = bodies.m * bodies.g, bodies.M * bodies.g
    if scenario.kind == "platform":
        return foot + weight
    if scenario.kind != "slope":
        down = [around(force) for force in scenario.signal[1].tolist()]
        return foot + weight - Range(min(each.low for each in down), max(each.high for each in down))
    farthest = max(abs(slope.low), abs(slope.high), *(abs(decimal(part)) for part in scenario.signal[0].tolist()))
    return foot + weight * Range(_cosine(Fraction(math.ceil(farthest * DIGITS), DIGITS)), Fraction(1))


def _cosine(x: Fraction) -> Fraction:
    """A lower bound of the cosine: its alternating series, ended at a negative term; -1 where that says nothing."""
    total, term = Fraction(0), Fraction(1)
    for j in range(1, 19):
        total += term
        term = -term * x * x / (2 * j * (2 * j - 1))
    return max(Fraction(math.floor(total * DIGITS**2), DIGITS**2), Fraction(-1)) if x < 3 else Fraction(-1)


@dataclass(frozen=True, eq=False, kw_only=True)
class Numbers:
    """Ranges of what the linear loop depends on: ``I``, ``ell``, ``AL`` = A L [N m], ``load`` = F_T + F_H [N]."""

    I: Range
    ell: Range
    AL: Range
    load: Range


def numbers(case: Case, scenario: Scenario | None = None) -> Numbers:
    """The ranges for a part of a box."""
    scenario = scenario or case.scenario
    bodies = body(case.biped, case.radii)
    final = around(float(scenario.signal[0, -1]), case.radii[5])
    AL, load = sizes(bodies, scenario) * bodies.L, loads(bodies, scenario, final)
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
