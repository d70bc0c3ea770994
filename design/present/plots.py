"""Pictures of a run, as Figs. 3 and 4 of the paper show it. The only importer of matplotlib.

Lines differ in style and in lightness, so that they can be told apart in grey; limits are drawn, and what breaks one is
shaded. Files of the same records are the same to the byte.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from design.analysis.simulate import Trajectory
from design.errors import BadInput
from design.model.body import Biped

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
    from matplotlib.figure import Figure as Figure

Array = NDArray[np.float64]

BLUE, ORANGE, GREY, RED = "#0b4f8a", "#d9822b", "#8a8a8a", "#b00020"
BROKEN: dict[str, Any] = {"facecolor": "#f3c5cd", "edgecolor": RED, "hatch": "//", "linewidth": 0}
"""How what breaks a limit is shaded: hatched, so that it shows in grey too."""
FORMATS = ("png", "svg", "pdf")


def figure_bytes(figure: Figure, kind: str) -> bytes:
    """The picture as ``png``, ``svg`` or ``pdf``."""
    import matplotlib as mpl

    stamp = {"png": {}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}[kind]
    out = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "poise", "svg.fonttype": "none"}):
        figure.savefig(out, format=kind, metadata=stamp, dpi=130)
    return out.getvalue()


def format_of(path: str) -> str:
    """The format that a file's ending asks for; raises ``BadInput`` with those there are."""
    kind = Path(path).suffix.lstrip(".").lower()
    if kind not in FORMATS:
        message = (
            f"ends in {Path(path).suffix or 'nothing'}; a picture is written as {', '.join('.' + f for f in FORMATS)}"
        )
        raise BadInput(message, file=path)
    return kind


def gif_only(path: str, scenarios: int) -> None:
    """Raise ``BadInput`` unless ``path`` ends in .gif and there is one scenario to draw."""
    if scenarios > 1:
        message = f"draws one scenario, and the spec has {scenarios}; choose one with --scenario"
        raise BadInput(message, key="--animate")
    if Path(path).suffix.lower() != ".gif":
        message = f"ends in {Path(path).suffix or 'nothing'}; an animation is written as .gif"
        raise BadInput(message, file=path)


def canvas(width: float, height: float, rows: int = 1, columns: int = 1, *, sharex: Any = False) -> tuple[Figure, Any]:
    """An empty figure of ``width`` x ``height`` [inches] that needs no display, and its axes (rows, columns)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height))
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, columns, sharex=sharex, squeeze=False)
    across, down = 0.9 / (width / columns), 0.22 if rows > 1 else 0.0
    # margins, and the places of titles and labels, in inches: a layout engine takes half of the whole drawing time, and
    # letting titles and labels find their places by the ticks a quarter
    figure.subplots_adjust(left=0.85 / width, right=1 - 0.15 / width, bottom=0.5 / height, top=1 - 0.42 / height)
    figure.subplots_adjust(wspace=across, hspace=down)
    for ax in axes.flat:
        box = ax.get_position()
        heading(ax, "")
        ax.xaxis.set_label_coords(0.5, -0.24 / (box.height * height))
        ax.yaxis.set_label_coords(-0.53 / (box.width * width), 0.5)
    return figure, axes


def heading(ax: Axes, text: str) -> None:
    """A title just above the axes, at a place that need not be sought; a dollar sign of a file's name is one."""
    ax.set_title(text, fontsize=9, y=1.0, parse_math=False)


def plain(ax: Axes) -> None:
    """A light grid, and no box."""
    ax.grid(visible=True, color="#e4e4e4", linewidth=0.6)
    ax.set_axisbelow(True)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)


def run_figure(runs: Sequence[Trajectory], foot: Biped, title: str) -> Figure:
    """One column a scenario: angle, contact forces, estimated force, torque, CoP within the ``foot``."""
    figure, grid = canvas(max(6.4, 4.6 * len(runs)), 11.0, 5, len(runs), sharex="col")
    if title:
        figure.suptitle(title, fontsize=10, y=1 - 0.06 / 11.0)
    for column, run in enumerate(map(thinned, runs)):
        axes = grid[:, column]
        _angle(axes[0], run)
        _contact(axes[1], run)
        _estimate(axes[2], run)
        _torque(axes[3], run)
        _cop(axes[4], run, foot)
        heading(axes[0], run.scenario)
        axes[-1].set_xlabel("time [s]")
        for ax in axes:
            ax.margins(x=0)
            plain(ax)
    return figure


def thinned(run: Trajectory, most: int = 20_000) -> Trajectory:
    """``run`` with about ``most`` samples: both ends of every stretch, and where each quantity is extreme in it."""
    quantities = (run.theta, run.F_T, run.F_H, run.tau, run.P)
    stretch = -(-len(run.t) * (2 * len(quantities) + 2) // most)
    if len(run.t) <= most:
        return run
    whole = len(run.t) // stretch * stretch
    begins = np.arange(0, whole, stretch)
    kept = [begins, begins + stretch - 1, np.arange(whole, len(run.t))]
    for values in quantities:
        blocks = values[:whole].reshape(-1, stretch)
        kept += [begins + blocks.argmin(axis=1), begins + blocks.argmax(axis=1)]
    at = np.unique(np.concatenate(kept))
    arrays: dict[str, Any] = {
        part.name: value[..., at] for part in fields(run) if isinstance(value := getattr(run, part.name), np.ndarray)
    }
    return replace(run, **arrays)


def _angle(ax: Axes, run: Trajectory) -> None:
    ax.plot(run.t, np.degrees(run.theta), color=BLUE, label="ankle angle θ")
    if run.alpha is not None:
        ax.plot(run.t, np.degrees(run.alpha), color=ORANGE, linestyle="--", label="slope α")
    if np.ptp(run.theta_d) > 0:
        ax.plot(run.t, np.degrees(run.theta_d), color="black", linewidth=1.0, linestyle=":", label="desired θ_d")
    ax.set_ylabel("angle [deg]")
    _legend(ax)


def _contact(ax: Axes, run: Trajectory) -> None:
    ax.plot(run.t, run.F_T, color=BLUE, label="toe F_T")
    ax.plot(run.t, run.F_H, color=ORANGE, linestyle="--", label="heel F_H")
    ax.axhline(0.0, color="black", linewidth=1.0)
    low, high = ax.get_ylim()
    ax.set_ylim(min(low, -0.04 * (high - low)), high)
    worst = np.minimum(run.F_T, run.F_H)
    if (worst < 0).any():
        ax.fill_between(run.t, np.minimum(worst, 0.0), 0.0, **BROKEN)
    lost = run.lost_contact
    if lost is not None:
        ax.axvline(lost[0], color=RED, linewidth=1.0, linestyle=":")
        ax.annotate(
            f"contact lost, {lost[1]}, {lost[0]:.3f} s", (lost[0], 0.0), xytext=(5, 6), textcoords="offset points",
            color=RED, fontsize=8,
        )  # fmt: skip
    ax.set_ylabel("contact force [N]")
    _legend(ax)


def _estimate(ax: Axes, run: Trajectory) -> None:
    for k, (name, colour) in enumerate((("x", BLUE), ("y", ORANGE))):
        ax.plot(run.t, run.F[k], color=colour, linewidth=2.6, alpha=0.35, label=f"true F_{name}")
        ax.plot(run.t, run.F_estimate[k], color=colour, linestyle="--", linewidth=1.2, label=f"estimate F_{name}")
    ax.set_ylabel("external force [N]")
    _legend(ax)


def _torque(ax: Axes, run: Trajectory) -> None:
    ax.plot(run.t, run.tau, color=BLUE)
    ax.axhline(0.0, color=GREY, linewidth=0.8)
    ax.set_ylabel("ankle torque [N m]")


def _cop(ax: Axes, run: Trajectory, foot: Biped) -> None:
    ell, toe, heel = foot.ell, foot.toe, foot.heel
    P = np.clip(run.P, -heel - 0.5 * ell, toe + 0.5 * ell)
    ax.axhspan(-1e3 * heel, 1e3 * toe, color="#eef3ee")
    for end, name in ((1e3 * toe, "toe"), (-1e3 * heel, "heel")):
        ax.axhline(end, color="black", linewidth=1.0)
        ax.annotate(name, (run.t[0], end), xytext=(3, 2), textcoords="offset points", fontsize=8)
    ax.plot(run.t, 1e3 * P, color=BLUE)
    outside = (toe < P) | (-heel > P)
    if outside.any():
        edge = np.where(P > 0, toe, -heel)
        ax.fill_between(run.t, 1e3 * edge, 1e3 * P, where=outside, **BROKEN)
    room = (0.5 if outside.any() else 0.3) * ell
    ax.set_ylim(-1e3 * (heel + room), 1e3 * (toe + room))
    ax.set_ylabel("CoP [mm]")


def _legend(ax: Axes) -> None:
    ax.legend(fontsize=8, frameon=False, loc="best", ncols=2)
