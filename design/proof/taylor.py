"""Taylor models: functions of time within a piece, and of parameters, as polynomials with a bound of what is left out.

A ``Model`` stands, for each of n pieces, for all functions f of v in [-1, 1] and p in [-1, 1]^k with

    |f(v, p) - sum_d c[0, d] v^d - sum_i p_i sum_d c[i, d] v^d| <= rest,        d <= DEGREE

(Makino and Berz 2003, first order in the parameters). Every operation gives a model of the exact result for all the
functions that its operands stand for. *Rounding.* Each float operation errs by at most u = 2^-53 of its result, or
2^-1074 below the normal range; a coefficient that is a sum of m products errs by at most 2 m u times the sum of their
sizes, and no m here is above 60: ``ROUNDING`` of the product of the sizes covers it several times over. Sizes and rests
are sums of numbers >= 0, whose computed value may be too small by as many u: ``UP`` makes good for it. Soundness is
tested against exact rationals and mpmath.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial.chebyshev import poly2cheb
from numpy.typing import NDArray

Array = NDArray[np.float64]

DEGREE = 7
ROUNDING = 2e-14
UP = 1 + 1e-12
TINY = 1e-300
FARTHEST = 4.0
"""Arguments of sine and cosine beyond this are refused."""
SINE_ERROR = 1e-12
"""Bound of the error of ``_sine`` and ``_cosine``: series of 30 terms at |x| <= 4, of total size cosh 4 < 28."""


@dataclass(frozen=True, eq=False)
class Model:
    """Coefficients ``c`` (n, 1 + k, DEGREE + 1) and ``rest`` (n,)."""

    c: Array
    rest: Array

    def __add__(self, other: Model | float | Array) -> Model:
        """The sum."""
        if not isinstance(other, Model):
            c = self.c.copy(order="K")
            c[:, 0, 0] += other
            return Model(c, UP * (self.rest + ROUNDING * np.abs(c[:, 0, 0]) + TINY))
        c = self.c + other.c
        return Model(c, UP * (self.rest + other.rest + ROUNDING * _size(c) + TINY))

    def __neg__(self) -> Model:
        """The negative, exact."""
        return Model(-self.c, self.rest)

    def __sub__(self, other: Model | float | Array) -> Model:
        """The difference."""
        return self + (-other)

    def __mul__(self, other: Model | float) -> Model:
        """The product."""
        if not isinstance(other, Model):
            c = self.c * other
            return Model(c, UP * (self.rest * abs(other) + ROUNDING * _size(c) + TINY))
        a, b = self.c, other.c
        c = np.zeros_like(a)
        high = np.zeros(len(a))  # sizes of products that have too high a degree
        sizes_a, sizes_b = np.abs(a), np.abs(b)
        whole = sizes_a[:, 1:].sum(axis=1)
        wholes = sizes_b[:, 1:].sum(axis=1)
        of_b = _used(b)
        for i in _used(a):
            for j in of_b:
                if i + j <= DEGREE:
                    c[:, 0, i + j] += a[:, 0, i] * b[:, 0, j]
                    if a.shape[1] > 1:
                        c[:, 1:, i + j] += a[:, :1, i] * b[:, 1:, j] + a[:, 1:, i] * b[:, :1, j]
                else:
                    high += sizes_a[:, 0, i] * (sizes_b[:, 0, j] + wholes[:, j]) + whole[:, i] * sizes_b[:, 0, j]
        both = whole.sum(axis=1) * wholes.sum(axis=1)  # of second order in the parameters
        A, B = _size(a), _size(b)
        rest = high + both + A * other.rest + B * self.rest + self.rest * other.rest + ROUNDING * A * B
        return Model(c, UP * (rest + TINY))

    __rmul__ = __mul__
    __radd__ = __add__

    def centre(self) -> Array:
        """c[0, 0] (n,)."""
        return self.c[:, 0, 0]

    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bound (n,) over all v and p: the ends of the parabola in it, and the size of all else."""
        c0, c1, c2 = (self.c[:, 0, d] for d in range(3))
        others = self.c.copy()
        others[:, 0, :3] = 0.0
        reach = UP * (_least_sizes(others) + self.rest + ROUNDING * (_size(self.c) + self.rest) + TINY)
        low, high = _parabola(c0, c1, c2), -_parabola(-c0, -c1, -c2)
        return low - reach - ROUNDING * np.abs(low), high + reach + ROUNDING * np.abs(high)

    def size(self) -> Array:
        """Bound (n,) of |f|: the sizes of its coefficients in Chebyshev's polynomials, none of which exceeds 1."""
        return np.asarray(UP * (_least_sizes(self.c) + self.rest + ROUNDING * _size(self.c)))

    def parted(self, m: int) -> Model:
        """The same function in m n pieces: each piece cut into ``m`` of equal length."""
        c = np.einsum("npd,jde->njpe", self.c, restrictions(m)).reshape(-1, *self.c.shape[1:])
        return Model(c, UP * (np.repeat(self.rest + ROUNDING * _size(self.c), m) + TINY))

    def slope(self) -> Model:
        """The derivative along v, of a model without rest: of that very polynomial."""
        if self.rest.any():
            message = "only a polynomial can be differentiated"
            raise ValueError(message)
        c = np.zeros_like(self.c)
        c[:, :, :-1] = self.c[:, :, 1:] * np.arange(1.0, DEGREE + 1)
        return Model(c, ROUNDING * _size(c) + TINY)

    def at(self, v: float) -> Array:
        """Value (n, 1 + k) of the polynomials at ``v`` = -1 or 1, to within ``ROUNDING`` of their size."""
        return np.asarray((self.c * v ** np.arange(DEGREE + 1)).sum(axis=2))


def blank(n: int, k: int) -> Array:
    """Coefficients (n, 1 + k, DEGREE + 1) of zero, each of them together in memory for all pieces."""
    return np.zeros((DEGREE + 1, 1 + k, n)).transpose(2, 1, 0)


def _used(c: Array) -> list[int]:
    """Degrees of which a coefficient is not zero."""
    return [d for d in range(DEGREE + 1) if c[:, :, d].any()]


def constant(n: int, k: int, value: float | Array, off: float = 0.0, parts: Sequence[float] = ()) -> Model:
    """``value`` in n pieces, +- ``off``, with ``parts`` (k) that go with the parameters."""
    c = blank(n, k)
    c[:, 0, 0] = value
    for i, part in enumerate(parts):
        c[:, 1 + i, 0] = part
    return Model(c, np.full(n, off))


def sine_and_cosine(x: Model) -> tuple[Model, Model]:
    """Of ``x``, by the series about its centre; raises ``ValueError`` for |x| > ``FARTHEST``."""
    if not (x.size() <= FARTHEST).all():
        message = f"an angle of more than {FARTHEST:g} rad"
        raise ValueError(message)
    middle = x.centre().copy()
    d = x - middle
    d2 = d * d
    d3 = d2 * d
    d4 = d2 * d2
    D = d.size()
    even = 1.0 + d2 * -0.5 + d4 * (1 / 24) + d3 * d3 * (-1 / 720)
    odd = d + d3 * (-1 / 6) + d4 * d * (1 / 120)
    even = Model(even.c, UP * (even.rest + D**8 / 40320 + ROUNDING))
    odd = Model(odd.c, UP * (odd.rest + D**7 / 5040 + ROUNDING))
    s, c = (_piecewise(series(middle), x, np.full(len(middle), SINE_ERROR)) for series in (_sine, _cosine))
    return s * even + c * odd, c * even - s * odd


def inverse(x: Model) -> Model:
    """1/x, by the series about its centre c: (1 - e + e² - e³)/c, e = x/c - 1; raises ``ValueError`` if x may be 0."""
    middle = x.centre().copy()
    per = np.divide(1.0, middle, out=np.zeros_like(middle), where=middle != 0)
    e = _piecewise(per, x, ROUNDING * np.abs(per)) * x - 1.0
    E = e.size()
    if not (E < 1).all():
        message = "a number that may be zero has no reciprocal"
        raise ValueError(message)
    series = 1.0 + e * (e * (1.0 + -e) - 1.0)
    left_out = UP * E**4 / (1.0 - E)
    series = Model(series.c, UP * (series.rest + left_out))
    return _piecewise(per, x, ROUNDING * np.abs(per)) * series


def _piecewise(value: Array, like: Model, off: Array) -> Model:
    """The same at all times of a piece: ``value`` (n,) +- ``off`` (n,)."""
    c = np.zeros_like(like.c)
    c[:, 0, 0] = value
    return Model(c, off)


def _sine(x: Array) -> Array:
    total, term = x.copy(), x.copy()
    for j in range(1, 30):
        term = term * (x * x) / (-(2 * j) * (2 * j + 1))
        total = total + term
    return total


def _cosine(x: Array) -> Array:
    total, term = np.ones_like(x), np.ones_like(x)
    for j in range(1, 30):
        term = term * (x * x) / (-(2 * j - 1) * (2 * j))
        total = total + term
    return total


def _size(c: Array) -> Array:
    return np.asarray(np.abs(c).sum(axis=(1, 2)))


TO_CHEBYSHEV = np.array([[*poly2cheb([0.0] * d + [1.0]), *[0.0] * (DEGREE - d)] for d in range(DEGREE + 1)])
"""Row d: v^d in Chebyshev's polynomials; each entry is a fraction of 64, and so exact."""


def _least_sizes(c: Array) -> Array:
    """Bound (n,) of the polynomials, to within ``ROUNDING`` of ``_size``."""
    return np.asarray(np.abs(c @ TO_CHEBYSHEV).sum(axis=(1, 2)))


@lru_cache
def restrictions(m: int) -> Array:
    """(m, degree, degree): from coefficients in v to those in each m-th of the piece; exact where m is 2, 4 or 8."""
    return np.array([
        [[math.comb(d, e) * ((1 + 2 * j - m) / m) ** (d - e) * m**-e if e <= d else 0.0 for e in range(DEGREE + 1)]
         for d in range(DEGREE + 1)]
        for j in range(m)
    ])  # fmt: skip


def _parabola(c0: Array, c1: Array, c2: Array) -> Array:
    """The least of c0 + c1 v + c2 v² for |v| <= 1, to within ``ROUNDING`` of the sizes of the three."""
    inside = 2 * c2 > np.abs(c1)
    turn = np.divide(c1 * c1, 4 * c2, out=np.zeros_like(c1), where=inside)
    return np.where(inside, c0 - turn, c0 - np.abs(c1) + c2)


def reciprocal(value: float, radius: float) -> tuple[float, float, float]:
    """1/(value + p radius), |p| <= 1, as a + b p +- r; 0 <= radius < value."""
    if not 0 <= radius < value:
        message = "a number that may be zero has no reciprocal"
        raise ValueError(message)
    a, b = 1.0 / value, -radius / value / value
    share = radius / value
    r = a * share * share / (1 - share) * UP + ROUNDING * a
    return a, b, math.nextafter(r, math.inf)
