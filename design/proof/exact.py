"""(27)-(29) and a decay rate, decided in rational arithmetic over a whole range of bodies and environments.

Numbers are the decimals that they print as. Ranges of rationals are added and multiplied without rounding; what depends
on a parameter twice is enclosed, not exact, so that over a box the answer may be "unknown", never wrong. A follows from
(3): on a slope it is M g; under a force it is largest at a corner of the signal (a norm is convex) and smallest where
the segment between two corners is nearest to the origin; its square root is enclosed by rationals.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise

from design.model.body import Biped
from design.model.environment import Scenario
from design.model.laws import Gains, LawKind

DIGITS = 10**12
"""Square roots are enclosed to one part in this."""


@dataclass(frozen=True)
class Range:
    """All rationals from ``low`` to ``high``."""

    low: Fraction
    high: Fraction

    def __add__(self, other: Range) -> Range:
        """All sums."""
        return Range(self.low + other.low, self.high + other.high)

    def __neg__(self) -> Range:
        """All negatives."""
        return Range(-self.high, -self.low)

    def __sub__(self, other: Range) -> Range:
        """All differences."""
        return self + (-other)

    def __mul__(self, other: Range) -> Range:
        """All products."""
        ends = [a * b for a in (self.low, self.high) for b in (other.low, other.high)]
        return Range(min(ends), max(ends))

    def __truediv__(self, other: Range) -> Range:
        """All quotients; raises ``ZeroDivisionError`` where ``other`` holds 0."""
        if other.low <= 0 <= other.high:
            raise ZeroDivisionError
        return self * Range(1 / other.high, 1 / other.low)


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


def routh_hurwitz(bodies: Body, kind: LawKind, gains: Gains, A: Range) -> dict[str, Range]:
    """How far (27)-(29) are kept, by row id: left less right, as in ``design.model.stability``."""
    K_p, K_d, K_f = (around(gain) for gain in gains)
    AL = A * bodies.L
    stiffness = K_p - AL
    if kind == "pd":
        return {"stiffness": stiffness, "damping": K_d}
    damping = bodies.ell / bodies.I * K_d - K_f
    damping = Range(min(damping.low, K_f.low), min(damping.high, K_f.high))
    return {
        "stiffness": stiffness,
        "damping": damping,
        "routh": K_d * bodies.ell * stiffness - K_f * bodies.I * K_p,
    }


def decays(bodies: Body, kind: LawKind, gains: Gains, A: Range, sigma: Fraction) -> bool:
    """Whether every pole has a real part below -sigma, wherever in the ranges; False where that is not seen."""
    K_p, K_d, K_f = (around(gain) for gain in gains)
    s = point(sigma)
    p_1 = (K_p - A * bodies.L) / bodies.I
    if kind == "pd":
        q_1, q_0 = K_d / bodies.I - point(2) * s, p_1 - K_d / bodies.I * s + s * s
        return q_1.low > 0 and q_0.low > 0
    p_2 = K_d / bodies.I - K_f / bodies.ell
    p_0 = K_f * A * bodies.L / (bodies.I * bodies.ell)
    q_2 = p_2 - point(3) * s
    q_1 = p_1 - point(2) * p_2 * s + point(3) * s * s
    q_0 = p_0 - p_1 * s + p_2 * s * s - s * s * s
    return q_2.low > 0 and q_0.low > 0 and (q_2 * q_1 - q_0).low > 0
