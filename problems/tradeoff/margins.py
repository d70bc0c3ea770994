"""The margins that a front is between: their senses and units, and the cube that the ends span."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.analysis.objectives import OBJECTIVES
from design.errors import BadInput

Array = NDArray[np.float64]

ALLOWED = tuple(id for id in OBJECTIVES if id not in ("goals", "routh-margin"))
"""Rows that can be both an objective and a requirement."""


@dataclass(frozen=True, kw_only=True)
class Margins:
    """Two or three rows by id; ``signs`` is -1 for those that are made small."""

    ids: tuple[str, ...]

    @property
    def signs(self) -> Array:
        """(k,) of 1 and -1."""
        return np.array([OBJECTIVES[id].sign for id in self.ids])

    @property
    def units(self) -> tuple[str, ...]:
        """The rows' units."""
        return tuple(OBJECTIVES[id].unit for id in self.ids)


def margins(words: Sequence[str]) -> Margins:
    """The margins named by ``words``, which may hold several with commas between; raises ``BadInput``."""
    ids = [id.strip() for word in words for id in word.split(",")]
    for id in ids:
        if id not in ALLOWED:
            message = f"names {id[:60]!r}; needs two or three of {', '.join(ALLOWED)}"
            raise BadInput(message, key="--between")
    if len(set(ids)) < len(ids):
        message = f"names {next(id for id in ids if ids.count(id) > 1)!r} twice; each row can be one margin"
        raise BadInput(message, key="--between")
    if not 2 <= len(ids) <= 3:
        message = f"names {len(ids)}; needs two or three of {', '.join(ALLOWED)}"
        raise BadInput(message, key="--between")
    return Margins(ids=tuple(ids))


@dataclass(frozen=True, eq=False, kw_only=True)
class Cube:
    """Margins without units, u = (sign value - low)/span: 1 at its own end, 0 at the worst end; more is better.

    ``low``, ``span`` (k,); a margin that no end gives anything away of has its scale for a span.
    """

    signs: Array
    low: Array
    span: Array

    def of(self, values: Array) -> Array:
        """The margins ``values`` (..., k) as u (..., k)."""
        return np.asarray((self.signs * values - self.low) / self.span)

    def value(self, k: int, u: float) -> float:
        """The value of margin number ``k`` at ``u``."""
        return float(self.signs[k] * (self.low[k] + u * self.span[k]))


def cube(signs: Array, ends: Array, scales: Sequence[float]) -> Cube:
    """The cube of the ``ends`` (k, k), values of each end's design in a row; ``scales`` (k,) of the margins."""
    turned = signs * ends
    low, high = turned.min(axis=0), turned.max(axis=0)
    span = np.where(high - low > 1e-5 * np.array(scales), high - low, np.array(scales))
    return Cube(signs=signs, low=low, span=span)


def beats(one: Array, other: Array, by: float) -> bool:
    """Whether ``one`` (k,) is as good as ``other`` in every margin, and better ``by`` so much in one."""
    return bool((one >= other - 1e-3 * by).all() and (one - other).max() > by)


def outside(u: Array, ends: Array) -> Array:
    """How far the points ``u`` (n, k) are outside of the chord, or the plane, through the ``ends`` (k, k)."""
    k = u.shape[1]
    normal = np.ones(k)
    if k == 3:
        across = np.cross(ends[1] - ends[0], ends[2] - ends[0])
        across = across * np.sign(across.sum())
        normal = across if across.min() > 1e-6 else normal
    elif np.ptp(ends, axis=0).min() > 1e-9:
        chord = np.abs(ends[1] - ends[0])
        normal = chord[::-1]
    return np.asarray((u - ends[0]) @ (normal / np.linalg.norm(normal)))
