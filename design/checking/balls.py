"""Polynomials on integers, each with a bound of what it leaves out: the arithmetic of the checker.

A ``Ball`` stands for every function f of v in [-1, 1] and of parameters p in [-1, 1]^k with

    |f(v, p) - rows[0](v) - sum_i p_i rows[i](v)| <= rest,

its coefficients and its rest being integers in units of 2^-64. Sums are exact; what a product rounds down, what it has
of higher degree than ``DEGREE`` and of second order in p goes into the rest, rounded up. No floating point is used.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from itertools import zip_longest

from design.checking import need

BITS = 64
ONE = 1 << BITS
DEGREE = 8
PI = Fraction(31415926535897932384626433832795028841, 10**37)
"""Less than 1e-37 below pi."""
FARTHEST = 2 * ONE
"""Sine and cosine of angles whose middle is beyond this [rad] are refused."""
SERIES = 40
SERIES_ERROR = 1 << 10
"""Of a sine or cosine, in units: term n errs by 2/n of what the one before does, and 2 units; so by less than 4."""


@dataclass(frozen=True, slots=True)
class Ball:
    """``rows`` (1 + k) of coefficients, and ``rest``."""

    rows: list[list[int]]
    rest: int = 0

    def __add__(self, other: Ball) -> Ball:
        """The sum."""
        pairs = zip(self.rows, other.rows, strict=True)
        return Ball([[a + b for a, b in zip_longest(*pair, fillvalue=0)] for pair in pairs], self.rest + other.rest)

    def __neg__(self) -> Ball:
        """The negative."""
        return Ball([[-a for a in row] for row in self.rows], self.rest)

    def __sub__(self, other: Ball) -> Ball:
        """The difference."""
        return self + (-other)

    def __mul__(self, other: Ball) -> Ball:
        """The product."""
        a, b = self.rows, other.rows
        rows = [_times(a[0], b[0])]  # in units of 2^-128
        for x, y in zip(a[1:], b[1:], strict=True):
            rows.append([m + n for m, n in zip_longest(_times(a[0], y), _times(x, b[0]), fillvalue=0)])
        twice = sum(abs(c) for row in rows for c in row[DEGREE + 1 :])
        twice += sum(map(_sum, a[1:])) * sum(map(_sum, b[1:]))
        twice += self.size() * other.rest + self.rest * other.size()
        kept = [[c >> BITS for c in row[: DEGREE + 1]] for row in rows]
        return Ball(kept, up(twice) + sum(map(len, kept)))

    def over(self, divisor: int) -> Ball:
        """The quotient by a positive integer."""
        rows = [[c // divisor for c in row] for row in self.rows]
        return Ball(rows, -(-self.rest // divisor) + sum(map(len, rows)))

    def slope(self) -> Ball:
        """The derivative along v of a polynomial."""
        need(not self.rest, "only a polynomial has a derivative")
        return Ball([[d * c for d, c in enumerate(row)][1:] for row in self.rows])

    def ends(self, v: int) -> list[int]:
        """The value of each row at ``v`` = -1 or 1."""
        return [sum(c * v**d for d, c in enumerate(row)) for row in self.rows]

    def size(self) -> int:
        """A bound of |f|."""
        return sum(map(_sum, self.rows)) + self.rest

    def low(self) -> int:
        """A lower bound of f: the least value of the parabola in it, less the sizes of all else."""
        c0, c1, c2 = (*self.rows[0], 0, 0, 0)[:3]
        least = c0 - abs(c1) + c2 if 2 * c2 <= abs(c1) else c0 - c1 * c1 // (4 * c2) - 1
        return least - _sum(self.rows[0][3:]) - sum(map(_sum, self.rows[1:])) - self.rest


def _sum(row: Sequence[int]) -> int:
    return sum(map(abs, row))


def _times(x: list[int], y: list[int]) -> list[int]:
    if not x or not y:
        return []
    found = [0] * (len(x) + len(y) - 1)
    for i, a in enumerate(x):
        if a:
            for j, b in enumerate(y):
                found[i + j] += a * b
    return found


def up(twice: int) -> int:
    """A number in units of 2^-128, in units of 2^-64, rounded up."""
    return -(-twice >> BITS)


def above(number: Fraction) -> int:
    """The number in units, rounded up."""
    return math.ceil(number * ONE)


def root(number: Fraction) -> int:
    """Its square root in units, rounded up."""
    return math.isqrt(math.ceil(number * ONE * ONE)) + 1


def constant(value: Fraction, parts: Sequence[Fraction] = ()) -> Ball:
    """``value`` + sum of p_i ``parts``[i]."""
    rows = [[math.floor(part * ONE)] if part else [] for part in (value, *parts)]
    return Ball([rows[0] or [0], *rows[1:]], sum(map(len, rows)))


def inverse(value: Fraction, parts: Sequence[Fraction]) -> Ball:
    """1/(``value`` + sum of p_i ``parts``[i]), the sum of the sizes of the parts being below ``value``."""
    share = sum(map(abs, parts), Fraction(0)) / value
    need(value > 0 and share < 1, "the box holds bodies without length or inertia")
    linear = constant(1 / value, [-part / value**2 for part in parts])
    return Ball(linear.rows, linear.rest + above(share**2 / (1 - share) / value))


def radians(degrees: Fraction, parts: Sequence[Fraction] = ()) -> Ball:
    """An angle in degrees, |degrees| + sum of |parts| <= 1e6, in radians."""
    ball = constant(degrees * PI / 180, [part * PI / 180 for part in parts])
    return Ball(ball.rows, ball.rest + 1)


def sine_and_cosine(x: Ball) -> tuple[Ball, Ball]:
    """Of m + d, m the number in the middle of ``x``, by the series of d."""
    middle = x.rows[0][0] if x.rows[0] else 0
    need(abs(middle) <= FARTHEST, "an angle of more than 2 rad")
    none: list[list[int]] = [[] for _ in x.rows[1:]]
    d = x + Ball([[-middle], *none])
    D = Fraction(d.size(), ONE)
    one, d2 = Ball([[ONE], *none]), d * d
    even = one - d2.over(2) + (d2 * d2).over(24)
    odd = d * (one - d2.over(6) + (d2 * d2).over(120))
    even = Ball(even.rows, even.rest + above(D**6 / 720))
    odd = Ball(odd.rows, odd.rest + above(D**7 / 5040))
    s, c = (Ball([[value], *none], SERIES_ERROR) for value in series(middle))
    return s * even + c * odd, c * even - s * odd


def series(x: int) -> tuple[int, int]:
    """Sine and cosine of x, |x| <= 2, each to within ``SERIES_ERROR``; all in units."""
    totals, term = [0, 0], ONE
    for n in range(1, SERIES):
        totals[n % 2] += term
        term = (term * x >> BITS) // n * (1 if n % 2 else -1)
    return totals[0], totals[1]


def decimal(text: str) -> Fraction:
    """A number as written, exactly; raises ``ValueError`` for one that is not finite or of absurd size."""
    number = Decimal(text[:100])
    if len(text) > 100 or not number.is_finite() or (number and abs(number.adjusted()) > 300):
        raise ValueError(text[:40])
    return Fraction(number)
