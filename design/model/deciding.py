"""Which of many environments decide linear stability over all of them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from design.model.body import Biped
from design.model.laws import LawKind
from design.model.standing import Place, standing

Array = NDArray[np.float64]

MOST = 200
"""Environments that are all looked at where the foot is not the paper's; of more those that are farthest out."""


def bearing(load: Array) -> Array:
    """``load`` with what is not positive put just above 0, where law (20), which divides by it, gains without bound."""
    return np.asarray(np.maximum(load, 1e-6 * np.abs(load).max()))


def deciding_points(kind: LawKind, A: Array, load: Array, adapt: float = math.inf) -> tuple[Array, Array]:
    """Of the environments (A, load), those that decide linear stability over all of them.

    For law (8) and pd the two ends of the range of A; for law (20), and where the law adapts, all that differ.
    """
    if math.isfinite(adapt):
        sizes: Array = np.unique(np.round(A, 9))
        return sizes, np.full(len(sizes), float(load[0]))
    if kind != "cop":
        ends: Array = np.unique(np.array([A.min(), A.max()], dtype=np.float64))
        return ends, np.full(len(ends), float(load[0]))
    pairs = sorted(set(zip(np.round(A, 9).tolist(), np.round(bearing(load), 9).tolist(), strict=True)))
    return np.array([a for a, _ in pairs]), np.array([n for _, n in pairs])


def deciding_places(biped: Biped, kind: LawKind, F: Array, adapt: float = math.inf, target: float = 0.0) -> list[Place]:
    """Of the environments with forces ``F`` (2, j) [N], those that decide linear stability: ``deciding_points``.

    For a foot or a target that is not the paper's all that differ, up to ``MOST``; not under law pd, which does not ask
    the foot.
    """
    down = biped.M * biped.g - F[1]
    if kind == "pd" or (biped.plain and target == 0.0):
        points = deciding_points(kind, np.hypot(down, F[0]), biped.load(F[1]), adapt)
        return [Place(float(A), float(load)) for A, load in zip(*points, strict=True)]
    found = standing(biped, F, target)
    load = bearing(found.load) if kind == "cop" else np.full_like(found.load, found.load[0])
    distinct = np.unique(np.column_stack([found.A, load, found.beta]).round(9), axis=0)
    return [Place(*map(float, each)) for each in _outermost(distinct)]


def _outermost(points: Array) -> Array:
    """``points`` (n, 3), or, of more than ``MOST``, those farthest out in many directions and some evenly between."""
    if len(points) <= MOST:
        return points
    size = np.ptp(points, axis=0)
    unit = (points - points.mean(axis=0)) / np.where(size > 0, size, 1.0)
    turns = np.linspace(0.0, 2 * math.pi, 24, endpoint=False)
    ways = np.array(
        [[math.cos(a) * c, math.sin(a) * c, s] for a in turns for c, s in ((1, 0), (0.7, 0.7), (0.7, -0.7))]
    )
    chosen = {
        *np.argmax(unit @ ways.T, axis=0).tolist(),
        *np.linspace(0, len(points) - 1, MOST // 2).astype(int).tolist(),
    }
    return points[sorted(chosen)]
