"""Polynomials by their coefficients in rising powers, as plain arrays: what loop margins are found from."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.polynomial.polynomial import polyroots
from numpy.typing import NDArray

Array = NDArray[np.float64]

TURNS = np.tile([1.0, 1.0, -1.0, -1.0], 8)
"""Signs of the powers of i."""


def total(a: Array, b: Array) -> Array:
    """The sum of two polynomials."""
    a, b = (a, b) if len(a) >= len(b) else (b, a)
    found = a.copy()
    found[: len(b)] += b
    return found


def derivative(c: Array) -> Array:
    """With respect to the variable."""
    return c[1:] * np.arange(1, len(c))


def value_at(c: Array, x: Any) -> Any:
    """The value at one real or complex ``x``."""
    found = 0.0
    for each in reversed(c.tolist()):
        found = found * x + each
    return found


def square(c: Array) -> Array:
    """|p(i omega)|² as a polynomial in w = omega²."""
    even, odd = parts(c)
    return total(np.convolve(even, even), np.append(0.0, np.convolve(odd, odd)))


def parts(c: Array) -> tuple[Array, Array]:
    """p(i omega) = even(w) + i omega odd(w) with w = omega²."""
    turned = c * TURNS[: len(c)]
    return turned[0::2], turned[1::2] if len(c) > 1 else np.zeros(1)


def positive_roots(c: Array) -> list[float]:
    """Real roots > 0; a pair that rounding moved off the axis counts, since a margin may only err on the safe side."""
    sizes = np.abs(c)
    c = c[: 1 + int(np.flatnonzero(sizes > 1e-14 * (sizes.max() or 1.0)).max(initial=0))]
    if len(c) < 2:
        return []
    roots = polyroots(c)
    size = float(np.abs(roots).max())
    near = np.abs(roots.imag) <= 1e-7 * np.abs(roots)
    return sorted(float(r) for r in roots.real[near] if r > 1e-12 * size)
