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
    points = [_sides(bodies, scenario, column) for column in corners(scenario)]
    squares = [_square(x) + _square(y) for x, y in points]
    low = min(square.low for square in squares)
    for (x0, y0), (x1, y1) in pairwise(points):
        low = min(low, _nearest(x0, y0, x1, y1))
    return Range(_root(low)[0], _root(max(square.high for square in squares))[1])


def _sides(bodies: Body, scenario: Scenario, column: tuple[Fraction, ...]) -> tuple[Range, Range]:
    """F_x and M g - F_y [N] where the signal of a force or of a floor is ``column``."""
    weight = bodies.M * bodies.g
    if scenario.kind == "platform":
        return bodies.M * point(-column[0]), weight
    return point(column[0]), weight - point(column[1])


def at_rest(bodies: Body, scenario: Scenario, column: tuple[Fraction, ...]) -> tuple[Range, Range]:
    """A (3) and F_T + F_H at rest [N] where the signal is ``column``."""
    weight, foot = bodies.M * bodies.g, bodies.m * bodies.g
    if scenario.kind == "slope":
        return weight, foot + weight * _cosine_of(decimal(scenario.angle) * column[0])
    x, down = _sides(bodies, scenario, column)
    square = _square(x) + _square(down)
    return Range(_root(square.low)[0], _root(square.high)[1]), foot + down


def nearest(bodies: Body, scenario: Scenario) -> list[tuple[Fraction, ...]]:
    """About where A is least on each piece of the signal of a force or a floor."""
    if scenario.kind == "slope":
        return []
    found, columns = [], corners(scenario)
    for first, last in pairwise(columns):
        (x0, y0), (x1, y1) = (
            tuple(float(side.low) for side in _sides(bodies, scenario, column)) for column in (first, last)
        )
        length = (x1 - x0) ** 2 + (y1 - y0) ** 2
        share = -(x0 * (x1 - x0) + y0 * (y1 - y0)) / length if length > 0 else 0.0
        if 0.0 < share < 1.0:
            found.append(tuple(a + decimal(share) * (b - a) for a, b in zip(first, last, strict=True)))
    return found


def corners(scenario: Scenario) -> list[tuple[Fraction, ...]]:
    """The signal where it has corners, both sides of its jumps, and when the scenario ends: all of it lies between."""
    end = decimal(scenario.duration)
    points = [
        (decimal(t), tuple(map(decimal, column)))
        for t, column in zip(scenario.times.tolist(), scenario.signal.T.tolist(), strict=True)
    ]
    within = [value for t, value in points if t < end]
    before, after = points[len(within) - 1], points[len(within) : len(within) + 1]
    if not after:
        return within
    ((t, value),) = after  # the first point at the end or after it: what the signal has come to when the scenario ends
    share = (end - before[0]) / (t - before[0])
    return [*within, tuple(a + share * (b - a) for a, b in zip(before[1], value, strict=True))]


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
        down = [column[1] for column in corners(scenario)]
        return foot + weight - Range(min(down), max(down))
    farthest = max(abs(slope.low), abs(slope.high)) * max(abs(column[0]) for column in corners(scenario))
    lowered = Range(_cosine(Fraction(math.ceil(farthest * DIGITS), DIGITS)), Fraction(1))
    return (foot + weight) * lowered if ground_loads else foot + weight * lowered


def _cosine_of(x: Fraction) -> Range:
    """The cosine of an angle [rad]."""
    size = abs(x)
    low = _cosine(Fraction(math.ceil(size * DIGITS), DIGITS))
    high = low + Fraction(2, DIGITS) if size < 3 else Fraction(1)  # the angle rounded up, and the series' rest
    return Range(low, min(high, Fraction(1)))


def _cosine(x: Fraction) -> Fraction:
    """A lower bound of the cosine: its alternating series, ended at a negative term; -1 where that says nothing."""
    total, term = Fraction(0), Fraction(1)
    for j in range(1, 19):
        total += term
        term = -term * x * x / (2 * j * (2 * j - 1))
    return max(Fraction(math.floor(total * DIGITS**2), DIGITS**2), Fraction(-1)) if x < 3 else Fraction(-1)
