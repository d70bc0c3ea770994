"""Ranges of rationals, and of what a whole range of bodies and environments leads to: A (3), and the load at rest.

Numbers are the decimals that they print as. Ranges are added and multiplied without rounding; what depends on a
parameter twice is enclosed, not exact. On a slope A is M g; under a force it is largest at a corner of the signal (a
norm is convex) and smallest where the segment between two corners is nearest to the origin; its square root is enclosed
by rationals, as is the cosine of the steepest slope.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise

from design.model.body import Biped
from design.model.environment import Scenario

DIGITS = 10**12
"""Square roots are enclosed to one part in this."""


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


def loads(bodies: Body, scenario: Scenario, slope: Range, *, ground_loads: bool) -> Range:
    """The range of F_T + F_H at rest [N], anywhere along the scenario; ``slope`` is the final one [rad]."""
    foot, weight = bodies.m * bodies.g, bodies.M * bodies.g
    if scenario.kind == "platform":
        return foot + weight
    if scenario.kind != "slope":
        down = [around(force) for force in scenario.signal[1].tolist()]
        return foot + weight - Range(min(each.low for each in down), max(each.high for each in down))
    farthest = max(abs(slope.low), abs(slope.high), *(abs(decimal(part)) for part in scenario.signal[0].tolist()))
    lowered = Range(_cosine(Fraction(math.ceil(farthest * DIGITS), DIGITS)), Fraction(1))
    return (foot + weight) * lowered if ground_loads else foot + weight * lowered


def _cosine(x: Fraction) -> Fraction:
    """A lower bound of the cosine: its alternating series, ended at a negative term; -1 where that says nothing."""
    total, term = Fraction(0), Fraction(1)
    for j in range(1, 19):
        total += term
        term = -term * x * x / (2 * j * (2 * j - 1))
    return max(Fraction(math.floor(total * DIGITS**2), DIGITS**2), Fraction(-1)) if x < 3 else Fraction(-1)
