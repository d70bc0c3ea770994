"""The picture of a recording: CoP within the foot, toe and heel force, and the estimated external force."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from design.analysis.recorded import Estimates, thinned
from design.present.plots import BLUE, BROKEN, GREY, ORANGE, RED, canvas, heading, plain
from design.recordings.record import Record

if TYPE_CHECKING:
    from design.present.plots import Axes, Figure

Array = NDArray[np.float64]


def figure(record: Record, found: Estimates) -> Figure:
    """Contact and estimated force over time; the angle where it was measured."""
    contact = record.P is not None
    panels = [name for name, there in (
        ("cop", contact), ("forces", record.F_T is not None), ("angle", record.theta is not None),
        ("estimate", found.F_y is not None),
    ) if there]  # fmt: skip
    drawn, axes = canvas(8.0, 2.35 * len(panels) + 0.6, len(panels), 1, sharex="col")
    for ax, panel in zip(axes[:, 0], panels, strict=True):
        {"cop": _cop, "forces": _forces, "angle": _angle, "estimate": _estimate}[panel](ax, record, found)
        _missing(ax, record)
        ax.margins(x=0)
        plain(ax)
    heading(axes[0, 0], f"{Path(record.origin).name}{_dropped(record)}")
    axes[-1, 0].set_xlabel("time [s]")
    return drawn


def _line(ax: Axes, record: Record, values: Array, colour: str, style: str = "-", label: str = "") -> None:
    t, y = thinned(record.t, np.where(record.valid, values, np.nan))
    ax.plot(t, y, color=colour, linestyle=style, linewidth=1.1, label=label)


def _dropped(record: Record) -> str:
    count = int((~record.valid).sum())
    return f": {count} of {len(record.t)} samples without data, marked ▼" if count else ""


def _missing(ax: Axes, record: Record) -> None:
    """Where samples are masked: a grey band, and a mark above it that shows a single sample too."""
    spans = record.spans(~record.valid)[:500]
    for a, b, _ in spans:
        ax.axvspan(a, b, facecolor=GREY, alpha=0.45, linewidth=0)
    ax.plot(
        [0.5 * (a + b) for a, b, _ in spans], [1.0] * len(spans), "v", color="black", markersize=6, clip_on=False,
        transform=ax.get_xaxis_transform(),
    )  # fmt: skip
    if ax.get_legend_handles_labels()[1]:
        ax.legend(fontsize=8, frameon=False, loc="upper right", ncols=3)


def _cop(ax: Axes, record: Record, found: Estimates) -> None:
    assert record.P is not None
    toe, heel = 1e3 * record.biped.toe, 1e3 * record.biped.heel
    end = max(toe, heel)
    t, P = thinned(record.t, np.where(record.valid, 1e3 * record.P, np.nan))
    reach = 1.25 * max(end, float(np.nanmax(np.abs(P))) if np.isfinite(P).any() else end)
    for sign, lever, name in ((1, toe, "toe"), (-1, heel, "heel")):
        ax.axhspan(sign * lever, sign * reach, **{**BROKEN, "alpha": 0.5})
        ax.axhline(sign * lever, color="black", linewidth=1.0)
        ax.annotate(name, (record.t[0], sign * lever), xytext=(3, 3 if sign > 0 else -10), textcoords="offset points",
                    fontsize=8, fontweight="bold")  # fmt: skip
    ax.axhline(0.0, color=GREY, linewidth=0.8, linestyle=":")
    ax.plot(t, P, color=BLUE, linewidth=1.1)
    if (outside := (toe < P) | (-heel > P)).any():
        ax.plot(t[outside], P[outside], ".", color=RED, markersize=3)
    ax.set_ylim(-reach, reach)
    ax.set_ylabel("CoP from ankle [mm]")


def _forces(ax: Axes, record: Record, found: Estimates) -> None:
    assert record.F_T is not None
    assert record.F_H is not None
    _line(ax, record, record.F_T, BLUE, label="toe F_T")
    _line(ax, record, record.F_H, ORANGE, "--", "heel F_H")
    low, high = ax.get_ylim()
    floor = min(low, -0.06 * high)
    ax.axhspan(floor, 0.0, **{**BROKEN, "alpha": 0.5})
    ax.axhline(0.0, color="black", linewidth=1.0)
    ax.set_ylim(floor, high + 0.12 * (high - floor))
    ax.set_ylabel("contact force [N]")


def _angle(ax: Axes, record: Record, found: Estimates) -> None:
    assert record.theta is not None
    _line(ax, record, np.degrees(record.theta), BLUE)
    ax.set_ylabel("ankle angle [deg]")


def _estimate(ax: Axes, record: Record, found: Estimates) -> None:
    assert found.F_y is not None
    _line(ax, record, found.F_y, ORANGE, "--", "estimate F_y")
    if found.F_x is not None:
        _line(ax, record, found.F_x, BLUE, label="estimate F_x")
    ax.axhline(0.0, color=GREY, linewidth=0.8)
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + 0.15 * (high - low))
    ax.set_ylabel("external force [N]")
