"""Pictures of a report: each limit against its level, the root locus, and the loop's frequency response."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from design.analysis.loop_curves import LoopCurves
from design.analysis.rows import Series
from design.present.plots import BLUE, BROKEN, GREY, ORANGE, canvas, heading, plain

if TYPE_CHECKING:
    from design.present.plots import Axes, Figure


def limit_figure(parts: Sequence[Series]) -> Figure:
    """One limit in each scenario: its value over time, the level, and what breaks it shaded."""
    figure, axes = canvas(max(4.6, 3.4 * len(parts)), 2.3, 1, len(parts))
    for ax, part in zip(axes[0], parts, strict=True):
        _limit(ax, part)
    axes[0][0].set_ylabel(f"{part.id} [{part.unit}]" if part.unit != "1" else part.id)
    return figure


def _limit(ax: Axes, part: Series) -> None:
    value = np.where(np.isfinite(part.value), part.value, np.nan)
    ax.plot(part.t, value, color=BLUE, linewidth=1.3)
    if part.level is not None:
        ax.axhline(part.level, color="black", linewidth=1.1, linestyle=(0, (6, 2)))
        ax.annotate(
            f"{part.sense} {part.level:g}", (part.t[-1], part.level), xytext=(-2, 3), textcoords="offset points",
            ha="right", fontsize=8,
        )  # fmt: skip
        broken = value < part.level if part.sense == "at least" else value > part.level
        if broken.any():
            ax.fill_between(part.t, part.level, value, where=broken, **BROKEN)
    worst = int(np.nanargmin(value) if part.sense == "at least" else np.nanargmax(value))
    ax.plot(part.t[worst], value[worst], "o", color=ORANGE, markeredgecolor="black", markersize=5)
    heading(ax, part.scenario)
    ax.set_xlabel("time [s]")
    ax.margins(x=0.01)
    plain(ax)


def locus_figure(curves: LoopCurves) -> Figure:
    """Poles while the actuator's gain goes from nothing to three times its own."""
    figure, axes = canvas(4.6, 3.6)
    ax = axes[0][0]
    ax.axvspan(0, max(1.0, 1.2 * float(curves.poles.real.max(initial=0.0))), color="#f2dede", zorder=0)
    every = curves.locus.ravel()
    ax.plot(every.real, every.imag, ".", color=GREY, markersize=2, rasterized=True)
    ax.plot(curves.start.real, curves.start.imag, "x", color="black", label="without torque")
    ax.plot(curves.poles.real, curves.poles.imag, "o", color=BLUE, label="this design")
    ax.axhline(0, color="black", linewidth=0.6)
    ax.axvline(0, color="black", linewidth=0.9)
    ax.set_xlabel("real part [1/s]")
    ax.set_ylabel("imaginary part [1/s]")
    sizes = np.sort(np.abs(np.concatenate([curves.poles, curves.start])))
    far = sizes[-1] > 8 * sizes[-2]
    span = 1.6 * float(sizes[-2] if far else sizes[-1])
    if far:
        heading(ax, f"one pole is far left, at {-sizes[-1]:.3g} 1/s")
    ax.set_xlim(-span, 0.45 * span)
    ax.set_ylim(-0.7 * span, 0.7 * span)
    ax.legend(fontsize=8, frameon=False, loc="upper left")
    plain(ax)
    return figure


def loop_figure(curves: LoopCurves) -> Figure:
    """Loop gain and phase at the actuator, and sensitivity and complementary sensitivity."""
    figure, axes = canvas(4.6, 5.4, 3, 1, sharex="col")
    top, middle, low = axes[:, 0]
    w = curves.omega
    top.loglog(w, np.abs(curves.L), color=BLUE)
    top.axhline(1.0, color="black", linewidth=0.9)
    top.set_ylabel("|L|")
    middle.semilogx(w, np.degrees(np.unwrap(np.angle(curves.L))), color=BLUE)
    middle.set_ylabel("phase of L [deg]")
    low.loglog(w, np.abs(1 / (1 + curves.L)), color=BLUE, label="|S|, S = 1/(1+L)")
    low.loglog(w, np.abs(curves.L / (1 + curves.L)), color=ORANGE, linestyle="--", label="|T|, T = L/(1+L)")
    low.axhline(1.0, color="black", linewidth=0.9)
    low.set_xlabel("frequency [rad/s]")
    low.set_ylabel("magnitude")
    low.legend(fontsize=8, frameon=False)
    for ax in (top, middle, low):
        plain(ax)
        for axis in (ax.xaxis, ax.yaxis):
            if axis.get_scale() == "log":
                axis.set_major_formatter(lambda value, _: f"{value:g}")
                axis.minorticks_off()
    return figure
