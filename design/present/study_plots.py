"""Pictures of a study, one controller a row or a line; drawn so narrow that a telephone need not shrink them.

Controllers differ in line style and marker as well as in colour. Where contact is broken is hatched, and a trial that
broke it is a cross. Names of scenarios are left to the page: a spec may call them what no font and no formula can.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from design.present.plots import BLUE, GREY, ORANGE, RED, canvas, plain
from design.present.text import number, short

if TYPE_CHECKING:
    from design.present.plots import Axes, Figure

Array = NDArray[np.float64]
Row = Mapping[str, Any]
Lines = list[dict[str, Any]]

WIDTH = 4.7
MOST = 6
"""Controllers in one panel of trajectories."""
DOTS = 2000
"""More dots than this are drawn as one image, not each by itself."""
BROKEN = ("lost", "fallen")
LOST = "contact lost"
_STYLES = (
    (GREY, "-", "o"), (BLUE, "-", "s"), (ORANGE, (0, (5, 1.5)), "^"), ("black", (0, (1, 1.2)), "D"),
    ("#5b9bd5", (0, (6, 1.5, 1, 1.5)), "v"), ("#7a4a12", (0, (3, 1)), "P"),
)  # fmt: skip


def chosen(controllers: Mapping[str, Any], reference: str) -> list[str]:
    """At most ``MOST`` names: all, or the reference and those with the largest median contact force, as given."""

    def rank(name: str) -> tuple[bool, float]:
        median = controllers[name]["contact_force_n"]["median"]
        return (name != reference, np.inf if median is None else -median)

    best = sorted(controllers, key=rank)[:MOST]
    return [name for name in controllers if name in best]


def trajectory_figure(runs: Sequence[Row], names: Sequence[str]) -> Figure | None:
    """Angle, toe and heel force of one scenario's ``runs``, a line for each of ``names``; None if none has a trace."""
    from_name = {run["controller"]: run for run in runs if any((run.get("trace") or {}).get("t_s") or ())}
    styles = {name: _STYLES[k % len(_STYLES)] for k, name in enumerate(names) if name in from_name}
    if not styles:
        return None
    top = 0.2 + 0.16 * ((len(styles) + 2) // 2)
    height = 5.4 + top
    figure, axes = canvas(WIDTH, height, 3, 1, sharex="col")
    figure.subplots_adjust(top=1 - top / height, bottom=0.46 / height, hspace=0.12)
    columns = {"theta_deg": "angle θ [deg]", "toe_force_n": "toe force [N]", "heel_force_n": "heel force [N]"}
    for ax, (column, label) in zip(axes[:, 0], columns.items(), strict=True):
        for k, (name, style) in enumerate(styles.items()):
            _line(ax, from_name[name], column, style, k, name)
        ax.set_ylabel(label, fontsize=9)
        ax.margins(x=0.02, y=0.09)
        ax.locator_params(axis="y", nbins=6)
        ax.ticklabel_format(style="plain", useOffset=False)
        ax.tick_params(labelsize=9)
        plain(ax)
        if column != "theta_deg":
            _forbid(ax, "y")
    axes[-1][0].set_xlabel("time [s]", fontsize=9)
    _legend(figure, axes[0][0], ncols=2, handlelength=4)
    return figure


def _line(ax: Axes, run: Row, column: str, style: tuple[Any, Any, str], k: int, name: str) -> None:
    colour, dashes, marker = style
    t, value = _floats(run["trace"]["t_s"]), _floats(run["trace"].get(column) or [])
    if len(t) != len(value):
        return
    step = max(1, len(t) // 6)
    ax.plot(
        t, value, color=colour, linestyle=dashes, linewidth=1.4, marker=marker, markersize=4, label=_name(name),
        markevery=(k * step // len(_STYLES), step),
    )  # fmt: skip
    there = np.flatnonzero(np.isfinite(value))
    if run["status"] in BROKEN and len(there):
        ax.plot(t[there[-1]], value[there[-1]], "x", color=RED, markersize=8, markeredgewidth=2, label=LOST, zorder=5)


def contact_figure(rows: Sequence[Row], names: Sequence[str]) -> Figure | None:
    """The smallest contact force of every trial in ``rows``; a bar from quartile to quartile, and the median."""
    found = [row for row in rows if row.get("contact_force_n") is not None]
    if not found:
        return None
    figure, ax = _board(names, "smallest contact force of a trial [N]")
    for k, name in enumerate(names):
        its = [row for row in found if row["controller"] == name]
        for broken, (mark, colour) in enumerate(((".", BLUE), ("x", RED))):
            of = [(n, row) for n, row in enumerate(its) if (row["status"] in BROKEN) == bool(broken)]
            value = _floats([row["contact_force_n"] for _, row in of])
            # the golden ratio spreads the dots of a row evenly, and the same way each time
            place = k + 0.5 * (np.array([n * 0.618034 % 1.0 for n, _ in of]) - 0.5)
            ax.plot(value, place, mark, color=colour, markersize=6, alpha=0.85, rasterized=len(found) > DOTS)
        if its:
            low, middle, high = np.quantile(_floats([row["contact_force_n"] for row in its]), [0.25, 0.5, 0.75])
            ax.plot([low, high], [k, k], color="black", linewidth=5, alpha=0.25, solid_capstyle="butt")
            ax.plot([middle, middle], [k - 0.33, k + 0.33], color="black", linewidth=1.8)
        else:
            _nothing(ax, k)
    _forbid(ax, "x")
    return figure


def forest_figure(lines: Lines) -> Figure:
    """Differences of one measure: the mean, its interval, and zero; hollow where the interval holds zero."""
    first = lines[0]
    figure, ax = _board([line["name"] for line in lines], f"difference [{first['unit']}], {first['better']} is better")
    for k, line in enumerate(lines):
        mean, low, high = line["mean"], line["low"], line["high"]
        if mean is None:
            _nothing(ax, k)
            continue
        if low is not None:
            ax.plot([low, high], [k, k], "|-", color=BLUE, linewidth=1.8, markersize=9)
        clear = low is not None and not low <= 0 <= high
        ax.plot(mean, k, "o", color=BLUE, markerfacecolor=BLUE if clear else "white", markersize=6, zorder=3)
    ax.axvline(0.0, color="black", linewidth=1.1)
    ax.margins(x=0.08)
    if not any(line[key] for line in lines for key in ("mean", "low", "high")):
        ax.set_xlim(-1, 1)
    return figure


def survival_figure(found: Mapping[str, tuple[float, float]], names: Sequence[str], label: str, unit: str) -> Figure:
    """(survived, limit) by controller, as bars in percent of the physical limit."""
    figure, ax = _board(names, f"{label} [% of what any ankle can]")
    for k, name in enumerate(names):
        if name not in found or not found[name][1]:
            _nothing(ax, k)
            continue
        size, limit = found[name]
        share = 100 * size / limit
        ax.barh(k, share, height=0.6, color=BLUE, alpha=0.8)
        text, inside = f"{number(size, 3)} {unit}", share > 45
        ax.annotate(
            text, (share, k), xytext=(-4 if inside else 4, 0), textcoords="offset points", va="center",
            ha="right" if inside else "left", fontsize=8, color="white" if inside else "black",
        )  # fmt: skip
    ax.axvline(100.0, color="black", linewidth=1.2, linestyle=(0, (6, 2)))
    ax.set_xlim(0, 108)
    return figure


def times_figure(times: Mapping[str, Mapping[str, float | None]], period_ms: float) -> Figure | None:
    """Median, 99 % and largest computing time of a step, against the control period."""
    if not any(value for its in times.values() for value in its.values()):
        return None
    figure, ax = _board(list(times), "computing time of a step [ms]", above=0.25)
    ax.set_xscale("log")
    ax.xaxis.set_minor_formatter(lambda *_: "")
    for k, its in enumerate(times.values()):
        there = [value for value in its.values() if value]
        if not there:
            _nothing(ax, k)
            continue
        ax.plot([min(there), max(there)], [k, k], color=GREY, linewidth=1.2, zorder=1)
        marks = (("median", "o", "median"), ("p99", "s", "99 %"), ("max", "^", "largest"))
        for (key, mark, label), colour in zip(marks, (BLUE, ORANGE, "black"), strict=True):
            if value := its.get(key):
                ax.plot(value, k, mark, color=colour, markersize=6, label=label, linestyle="none")
    ax.axvline(period_ms, color=RED, linewidth=1.3, linestyle=(0, (6, 2)), label=f"period {period_ms:g} ms")
    every = [period_ms, *(value for its in times.values() for value in its.values() if value)]
    ax.set_xlim(10 ** np.floor(np.log10(0.8 * min(every))), 10 ** np.ceil(np.log10(1.25 * max(every))))
    ax.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    _legend(figure, ax, ncols=4, handletextpad=0.4, columnspacing=1.2)
    return figure


def _board(names: Sequence[str], label: str, above: float = 0.0) -> tuple[Figure, Axes]:
    """A panel with a row for each of ``names``, the first on top."""
    height = 0.68 + above + 0.29 * len(names)
    figure, axes = canvas(WIDTH, height)
    figure.subplots_adjust(left=1.42 / WIDTH, top=1 - (0.1 + above) / height, bottom=0.46 / height)
    ax: Axes = axes[0][0]
    ax.xaxis.set_label_coords(0.5, -0.25 / (height - 0.56 - above))
    ax.tick_params(labelsize=9)
    ax.set_yticks(range(len(names)), [_name(name) for name in names], fontsize=9)
    ax.set_ylim(len(names) - 0.5, -0.5)
    ax.set_xlabel(label, fontsize=9)
    ax.locator_params(axis="x", nbins=6)
    ax.xaxis.set_major_formatter(lambda value, _: f"{value:g}".replace("-", "−"))
    plain(ax)
    return figure, ax


def _legend(figure: Figure, ax: Axes, **style: Any) -> None:
    """The labels of ``ax``, each once, above it where no data are; what all share comes last."""
    handles = dict(zip(*ax.get_legend_handles_labels()[::-1], strict=True))
    lost = handles.pop(LOST, None)
    if lost is not None:
        handles[LOST] = lost
    figure.legend(
        handles.values(), handles.keys(), loc="upper center", fontsize=8, frameon=False, borderaxespad=0.2, **style
    )


def _forbid(ax: Axes, axis: str) -> None:
    """Hatch what is below zero, and draw zero."""
    style: dict[str, Any] = {"facecolor": "#fdf0f2", "edgecolor": "#e8b9c1", "hatch": "///", "linewidth": 0}
    low, high = ax.get_ylim() if axis == "y" else ax.get_xlim()
    low, high = min(low, -0.08 * abs(high)), max(high, 0.06 * abs(low))
    high += 0.06 * (high - low) * (axis == "y")
    (ax.axhspan if axis == "y" else ax.axvspan)(low, 0.0, zorder=0, **style)
    (ax.axhline if axis == "y" else ax.axvline)(0.0, color="black", linewidth=1.1)
    (ax.set_ylim if axis == "y" else ax.set_xlim)(low, high)


def _nothing(ax: Axes, k: int) -> None:
    ax.annotate("no result", (0.02, k), xycoords=("axes fraction", "data"), va="center", fontsize=8, color="#555555")


def _name(name: str) -> str:
    """``name`` as a label: one line, not too long, and no formula."""
    return short(" ".join(name.split()), 20).replace("$", r"\$")


def _floats(values: Sequence[float | None]) -> Array:
    return np.array([np.nan if value is None else value for value in values], dtype=float)
