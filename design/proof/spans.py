"""Intervals, one for each piece, their ends rounded outward: for what need not be known as a function of time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.proof.taylor import ROUNDING, TINY, Model

Array = NDArray[np.float64]


class Span(NamedTuple):
    """All numbers from ``low`` (n,) to ``high`` (n,)."""

    low: Array
    high: Array

    def plus(self, other: Span) -> Span:
        """All sums."""
        return _outward(self.low + other.low, self.high + other.high)

    def less(self, other: Span) -> Span:
        """All differences."""
        return _outward(self.low - other.high, self.high - other.low)

    def times(self, other: Span | float) -> Span:
        """All products."""
        pair = other if isinstance(other, Span) else (other, other)
        ends = np.stack([mine * its for mine in self for its in pair])
        return _outward(ends.min(axis=0), ends.max(axis=0))

    def over(self, other: Span) -> Span:
        """All quotients by numbers > 0; raises ``ValueError`` if ``other`` holds others."""
        if not (other.low > 0).all():
            message = "a number that may be zero has no reciprocal"
            raise ValueError(message)
        return self.times(_outward(1.0 / other.high, 1.0 / other.low))

    def wider(self, by: Array | float) -> Span:
        """All within ``by`` of them."""
        return _outward(self.low - by, self.high + by)

    def within(self, bound: float) -> Span:
        """Those from -``bound`` to ``bound``."""
        return Span(np.clip(self.low, -bound, bound), np.clip(self.high, -bound, bound))

    def ends(self) -> tuple[float, float]:
        """The least and largest of all pieces."""
        return float(self.low.min()), float(self.high.max())


def _outward(low: Array, high: Array) -> Span:
    return Span(low - ROUNDING * np.abs(low) - TINY, high + ROUNDING * np.abs(high) + TINY)


def span(model: Model) -> Span:
    """The values of a model."""
    return Span(*model.bounds())
