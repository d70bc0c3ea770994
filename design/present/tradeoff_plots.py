"""Pictures of a front: its points, ends and knee, the spec's own gains, and the side on which no design was found."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from design.present.plots import BLUE, BROKEN, GREY, ORANGE, canvas, heading, plain

if TYPE_CHECKING:
    from design.present.plots import Axes, Figure

Array = NDArray[np.float64]
Facts = Mapping[str, Any]

STRETCHED = 1.8
"""How many times as wide the axes may get by the spec's own gains before the front has a panel of its own."""


def tradeoff_figure(facts: Facts, title: str) -> Figure:
    """Two margins: the front, and beside it again with the spec's own gains if those are far; three: all pairs."""
    points = np.array([list(each["values"].values()) for each in facts["points"]], dtype=float)
    pairs = list(combinations(range(points.shape[1]), 2))
    own = _own(facts)
    far = own is not None and bool((_reach(points, own) > STRETCHED * _reach(points, None)).any())
    rows, columns = (1 + far, 3) if len(pairs) > 1 else (1, 1 + far)
    height = 0.9 + 4.0 * rows
    figure, grid = canvas(0.8 + 4.4 * columns if len(pairs) > 1 else 0.8 + 5.8 * columns, height, rows, columns)
    for panel, ax in enumerate(grid.flat):
        pair, whole = pairs[panel % len(pairs)], not far or panel >= len(pairs)
        its = own[list(pair)] if own is not None and whole else None
        _panel(ax, facts, points[:, pair], its, pair, named=not (far and whole))
        if far:
            heading(ax, "with the spec's own gains" if whole else "the front")
    figure.subplots_adjust(bottom=0.95 / height, top=1 - 0.75 / height, hspace=0.32)
    for ax in grid.flat:
        ax.xaxis.set_label_coords(0.5, -0.13)
    if len(pairs) > 1:
        title += "\n" + "; ".join(_marks(facts))
    figure.suptitle(title, fontsize=10, y=1 - 0.08 / height)
    handles = {label: handle for ax in grid.flat for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    figure.legend(handles.values(), handles.keys(), loc="lower center", ncols=len(handles), fontsize=8, frameon=False)
    return figure


def _marks(facts: Facts) -> list[str]:
    """Which points are marked."""
    marks = [f"best {id}: {k}" for id, k in facts["ends"].items()]
    return [*marks, f"knee: {facts['knee']['point']}"] if facts["knee"] else marks


def _own(facts: Facts) -> Array | None:
    if facts["given"] is None:
        return None
    own = np.array([np.nan if v is None else v for v in facts["given"]["values"].values()], dtype=float)
    return own if np.isfinite(own).all() else None


def _reach(points: Array, own: Array | None) -> Array:
    whole = points if own is None else np.vstack([points, own])
    return np.asarray(np.maximum(np.ptp(whole, axis=0), 1e-9 * (1 + np.abs(points).max(axis=0))))


def _panel(
    ax: Axes, facts: Facts, points: Array, own: Array | None, pair: tuple[int, ...], *, named: bool = True
) -> None:
    """The points (n, 2) over the margins numbered ``pair``."""
    margins = [facts["margins"][k] for k in pair]
    two = len(facts["margins"]) == 2
    shown = points if own is None else np.vstack([points, own])
    room = 0.1 * _reach(points, own)
    low, high = shown.min(axis=0) - room, shown.max(axis=0) + room
    better = np.array([1.0 if each["sense"] == "at least" else -1.0 for each in margins])
    best, worst = np.where(better > 0, high, low), np.where(better > 0, low, high)
    if two:
        beyond = [(points[0, 0], worst[1]), *map(tuple, points), (worst[0], points[-1, 1]), (worst[0], best[1]),
                  tuple(best), (best[0], worst[1])]  # fmt: skip
        ax.fill(*np.array(beyond).T, **BROKEN, label="no design found there")
        ax.plot(*points.T, color=BLUE, linewidth=1.6)
        for one, other in facts["jumps"]:
            ax.plot(*points[[one - 1, other - 1]].T, color="white", linewidth=2.4)
            ax.plot(*points[[one - 1, other - 1]].T, color=BLUE, linewidth=1.2, linestyle=":")
    ax.plot(*points.T, "o", color=BLUE, markersize=4, linestyle="none", label="designs of the front")
    if own is not None:
        ax.plot(*own, "X", color="black", markersize=8, linestyle="none", label="the spec's own gains")
    knee = facts["knee"]
    if knee:
        at = points[knee["point"] - 1]
        ax.plot(*at, "D", markerfacecolor=ORANGE, markeredgecolor="black", markersize=8, linestyle="none", label="knee")
    ends: dict[int, list[str]] = {}
    for id, k in facts["ends"].items():
        ends.setdefault(k, []).append(id)
    for number, (k, ids) in enumerate(ends.items()):
        at = points[k - 1]
        ax.plot(
            *at, "o", markerfacecolor="white", markeredgecolor=BLUE, markeredgewidth=1.6, markersize=8,
            linestyle="none", label="ends" if number == 0 else None,
        )  # fmt: skip
        if named:
            _note(ax, f"{k}: best {', '.join(ids)}" if two else str(k), at, worst, best)
    if knee and named:
        _note(ax, f"{knee['point']}: knee" if two else str(knee["point"]), points[knee["point"] - 1], worst, best)
    ax.set_xlim(low[0], high[0])
    ax.set_ylim(low[1], high[1])
    for name, each in zip(("xlabel", "ylabel"), margins, strict=True):
        unit = "" if each["unit"] == "1" else f" [{each['unit']}]"
        ax.set(**{name: f"{each['id']}{unit}"})
    plain(ax)


def _note(ax: Axes, text: str, at: Array, worst: Array, best: Array) -> None:
    """A label on the side where designs are, if there is room."""
    x, y = (at - worst) / (best - worst)
    across, up = np.sign(best - worst)
    dx, dy = (-12 * across, -14 * up) if x > 0.2 else (4 * across, -32 * up)
    if y < 0.2:
        dy = 0.0
    if text.isdecimal():
        dx, dy = 11 * across, 0.0
    side = {1: "left", -1: "right"}[int(np.sign(dx))]
    ax.annotate(
        text, (at[0], at[1]), xytext=(dx, dy), textcoords="offset points", fontsize=8, ha=side, va="center",
        bbox={"facecolor": "white", "edgecolor": GREY, "pad": 1.5, "linewidth": 0.5},
    )  # fmt: skip
