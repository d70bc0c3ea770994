"""Pictures of a recoverable set: what is proved of it, the capturable strip, and states that were tried."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.present.plots import BLUE, GREY, ORANGE, canvas, heading, plain

if TYPE_CHECKING:
    from design.present.plots import Axes, Figure

Array = NDArray[np.float64]


class Cut(NamedTuple):
    """States over (e, omega), the integral following from both as the ``title`` says.

    ``outline`` (2, k) and ``shadow`` (2, k): edges [deg, deg/s] of the region's part there, and of its projection;
    ``states`` (2, n) tried, and whether each has ``recovered`` (n,); ``strip`` [deg] half the capturable strip's width,
    ``Omega`` [1/s]; ``reach`` (2,): what is drawn, from -reach to reach.
    """

    title: str
    outline: Array
    shadow: Array
    states: Array
    recovered: NDArray[np.bool_]
    strip: float
    Omega: float
    reach: Array


def region_figure(rows: Sequence[tuple[str, Sequence[Cut]]], title: str) -> Figure:
    """A row of cuts for each scenario, under its name."""
    height = 3.9 * len(rows) + 0.9
    figure, grid = canvas(4.1 * max(len(cuts) for _, cuts in rows), height, len(rows), max(len(c) for _, c in rows))
    figure.subplots_adjust(bottom=0.95 / height, top=1 - 0.75 / height, hspace=0.35)
    figure.suptitle(title, fontsize=10, y=1 - 0.08 / height)
    for axes, (name, cuts) in zip(grid, rows, strict=True):
        for ax, cut in zip(axes, cuts, strict=True):
            _cut(ax, cut)
            heading(ax, f"{name}: {cut.title}")
            box = ax.get_position()
            ax.xaxis.set_label_coords(0.5, -0.36 / (box.height * height))
        axes[0].set_ylabel("rate ω [deg/s]")
    handles = {label: handle for ax in grid.flat for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    figure.legend(handles.values(), handles.keys(), loc="lower center", ncols=len(handles), fontsize=8, frameon=False)
    return figure


def _cut(ax: Axes, cut: Cut) -> None:
    far = 4 * cut.reach[0] + cut.strip
    edge = np.array([-far, far])
    for side, label in ((1, "edge of the capturable strip"), (-1, None)):
        ax.plot(edge, cut.Omega * (side * cut.strip - edge), color="black", linewidth=1.3, linestyle="--", label=label)
    ax.plot(*cut.shadow, color=GREY, linewidth=1.4, linestyle="-.", label="projection of the region")
    ax.fill(*cut.outline, facecolor=BLUE, alpha=0.18, linewidth=0)
    ax.plot(*cut.outline, color=BLUE, linewidth=2.0, label="region, proved")
    back, lost = cut.states[:, cut.recovered], cut.states[:, ~cut.recovered]
    ax.plot(*back, "o", color=BLUE, markersize=2.6, linestyle="none", label="recovers in simulation")
    ax.plot(
        *lost, "o", markerfacecolor="white", markeredgecolor=ORANGE, markeredgewidth=0.8, markersize=2.8,
        linestyle="none", label="loses contact",
    )  # fmt: skip
    ax.axhline(0.0, color="black", linewidth=0.5)
    ax.axvline(0.0, color="black", linewidth=0.5)
    ax.set_xlim(-cut.reach[0], cut.reach[0])
    ax.set_ylim(-cut.reach[1], cut.reach[1])
    ax.set_xlabel("angle from the stationary one, e [deg]")
    plain(ax)
