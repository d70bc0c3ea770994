"""Pictures of trials: how each goes, and below, what they come to one after the other."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from design.analysis.simulate import Trajectory
from design.present.plots import BLUE, BROKEN, GREY, ORANGE, RED, canvas, heading, plain

if TYPE_CHECKING:
    from design.present.plots import Axes, Figure

Array = NDArray[np.float64]

MOST = 4
"""Trials of a series that are drawn over time: the first ones and the last."""
MARKS = ("o-", "s--", "^:", "D-.", "v-", "P--")
LEAST_ERROR = 1e-12
"""Smaller errors of the estimate are drawn as this [N]; the scale is logarithmic."""


def trials_figure(
    document: Mapping[str, Any],
    pictures: Sequence[tuple[float, Sequence[tuple[Trajectory, Trajectory | None]]]],
    title: str,
) -> Figure:
    """Two rows a series, angle and contact forces over time; then contact force, settling and error by trial.

    ``pictures`` of each series: M g [N], and its runs, each with the one from an estimate that was not used, or None.
    """
    shown = [_shown(len(runs)) for _, runs in pictures]
    columns, rows = max(3, *map(len, shown)), 2 * len(pictures) + 1
    width, height = 3.3 * columns, 2.5 * rows + 0.3
    figure, grid = canvas(width, height, rows, columns)
    figure.subplots_adjust(hspace=0.42, top=1 - 0.75 / height)
    figure.suptitle(title, fontsize=10, y=1 - 0.08 / height)
    for place, ((pull, runs), numbers) in enumerate(zip(pictures, shown, strict=True)):
        facts = [trial for trial in document["trials"] if trial["series"] == place + 1]
        two = grid[2 * place : 2 * place + 2]
        _series(two, [runs[k] for k in numbers], [facts[k] for k in numbers], pull)
    _progress(grid[-1], document)
    inside = grid[0][0].get_position()
    for ax in grid.flat:
        ax.xaxis.set_label_coords(0.5, -0.34 / (inside.height * height))
        ax.yaxis.set_label_coords(-0.58 / (inside.width * width), 0.5)
    return figure


def _shown(count: int) -> list[int]:
    return list(range(count)) if count <= MOST else [*range(MOST - 1), count - 1]


def _series(
    axes: Any,
    runs: Sequence[tuple[Trajectory, Trajectory | None]],
    facts: Sequence[Mapping[str, Any]],
    pull: float,
) -> None:
    """The trials of a series side by side, on the same scales."""
    for column, ((run, refused), trial) in enumerate(zip(runs, facts, strict=True)):
        angle, force = axes[0][column], axes[1][column]
        _angle(angle, run, pull)
        if refused is not None:
            label = "θ from the estimate, not used"
            angle.plot(refused.t, np.degrees(refused.theta), color=GREY, linestyle=":", linewidth=1.6, label=label)
        _force(force, run)
        begun = "as the spec says" if trial["start"] == "as the spec says" else "from the estimate"
        heading(angle, f"{trial['scenario']}, trial {trial['trial']}, {begun}")
        for ax in (angle, force):
            ax.set_xlabel("time [s]")
            ax.margins(x=0)
            plain(ax)
    for row in axes:
        used = row[: len(runs)]
        low, high = min(ax.get_ylim()[0] for ax in used), max(ax.get_ylim()[1] for ax in used)
        for ax in used:
            ax.set_ylim(low, high)
        for ax in row[len(runs) :]:
            ax.set_axis_off()
    axes[0][0].set_ylabel("ankle angle [deg]")
    axes[1][0].set_ylabel("contact force [N]")
    for ax in axes.flat:
        if ax.get_subplotspec().is_first_col() or (len(ax.lines) > 2 and ax in axes[0]):
            ax.legend(fontsize=8, frameon=False, loc="best")


def _angle(ax: Axes, run: Trajectory, pull: float) -> None:
    theta_f = np.degrees(np.arctan2(-run.F[0], pull - run.F[1]))
    ax.plot(run.t, theta_f, color=ORANGE, linestyle="--", linewidth=2.2, label="stationary θ_f")
    ax.plot(run.t, np.degrees(run.theta), color=BLUE, linewidth=1.2, label="angle θ")
    low, high = ax.get_ylim()
    if high - low < 0.2:  # what is smaller than this is no motion that a picture should show
        ax.set_ylim(0.5 * (low + high) - 0.1, 0.5 * (low + high) + 0.1)


def _force(ax: Axes, run: Trajectory) -> None:
    ax.plot(run.t, run.F_T, color=BLUE, label="toe F_T")
    ax.plot(run.t, run.F_H, color=ORANGE, linestyle="--", label="heel F_H")
    ax.axhline(0.0, color="black", linewidth=1.2)
    low, high = ax.get_ylim()
    ax.set_ylim(min(low, -0.06 * (high - low)), high)
    worst = np.minimum(run.F_T, run.F_H)
    if (worst < 0).any():
        ax.fill_between(run.t, np.minimum(worst, 0.0), 0.0, **BROKEN)
    if run.lost_contact is not None:
        ax.axvline(run.lost_contact[0], color=RED, linewidth=1.0, linestyle=":")
        ax.annotate(
            f"contact lost, {run.lost_contact[1]}, {run.lost_contact[0]:.3f} s", (run.lost_contact[0], 0.0),
            xytext=(5, 5), textcoords="offset points", color=RED, fontsize=8,
        )  # fmt: skip


def _progress(axes: Sequence[Axes], document: Mapping[str, Any]) -> None:
    """Smallest contact force, settling and error of the estimate against the trial's number, a line a series."""
    contact, settling, error = axes[:3]
    longest = max(trial["trial"] for trial in document["trials"])
    for place, series in enumerate(document["series"]):
        trials = [trial for trial in document["trials"] if trial["series"] == place + 1]
        number = [trial["trial"] for trial in trials]
        names = list(dict.fromkeys(series["scenarios"]))
        look: dict[str, Any] = {
            "color": (BLUE, ORANGE, "black", GREY)[place % 4], "markersize": 5, "linewidth": 1.3,
            "label": names[0] if len(names) == 1 else "the sequence",
        }  # fmt: skip
        mark = MARKS[place % len(MARKS)]
        contact.plot(number, [trial["contact_force_n"] for trial in trials], mark, **look)
        settled = [trial["settling_s"] if math.isfinite(trial["settling_s"]) else math.nan for trial in trials]
        settling.plot(number, settled, mark, **look)
        error.plot(number, [_error(trial) for trial in trials], mark, **look)
    low, high = contact.get_ylim()
    low, high = min(low, 0.0), max(high, 0.0)
    low, high = low - 0.06 * (high - low), high + 0.06 * (high - low)
    contact.set_ylim(low, high)
    contact.axhline(0.0, color="black", linewidth=1.2)
    if min(trial["contact_force_n"] for trial in document["trials"]) < 0:
        contact.axhspan(low, 0.0, **BROKEN)
    settling.set_ylim(bottom=min(0.0, settling.get_ylim()[0]))
    errors = [_error(trial) for trial in document["trials"] if trial["fx_error_n"] is not None]
    error.set_yscale("log")
    error.set_ylim(*_decades(errors or [1.0]))
    titles = "smallest contact force [N]", "settling [s]", "error of the estimated force [N]"
    for ax, title in zip((contact, settling, error), titles, strict=True):
        heading(ax, title)
        ax.set_xlabel("trial")
        ax.set_xlim(1 - 0.06 * longest, longest + 0.06 * longest)
        ax.set_xticks(range(1, longest + 1, math.ceil(longest / (10 if longest < 20 else 5))))
        plain(ax)
    for ax in axes[3:]:
        ax.set_axis_off()
    if len(document["series"]) > 1:
        settling.legend(fontsize=8, frameon=False, loc="best")


def _decades(values: Sequence[float]) -> tuple[float, float]:
    """Powers of ten below and above all ``values``."""
    return 10.0 ** math.floor(math.log10(min(values)) - 0.01), 10.0 ** math.ceil(math.log10(max(values)) + 0.01)


def _error(trial: Mapping[str, Any]) -> float:
    if trial["fx_error_n"] is None:
        return math.nan
    return max(math.hypot(trial["fx_error_n"], trial["fy_error_n"]), LEAST_ERROR)
