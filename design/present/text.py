"""Tables and sentences for a terminal, at most 80 columns wide."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal
from enum import StrEnum

import numpy as np

from design.analysis.rows import Row
from design.analysis.simulate import Trajectory
from design.model.laws import Gains
from design.spec.load import builtin_names, builtin_text, parse


class Style(StrEnum):
    """How a word is shown: in the terminal's colours, and under the same name as a class of a page's style sheet."""

    GOOD = "good"
    BAD = "bad"
    DOUBT = "doubt"
    STRONG = "strong"

    @property
    def code(self) -> str:
        """The parameters of the terminal's escape sequence ``ESC [ ... m``."""
        return {Style.GOOD: "32", Style.BAD: "1;31", Style.DOUBT: "33", Style.STRONG: "1"}[self]


Paint = Callable[[str, Style], str]
"""(text, style) -> text."""


def painter(colour: bool) -> Paint:
    """A painter with terminal colours, or one that leaves text as it is."""

    def paint(text: str, style: Style) -> str:
        return f"\033[{style.code}m{text}\033[0m" if colour else text

    return paint


def number(value: float | None, digits: int = 6) -> str:
    """A number for people; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return "-"
    if digits == 6 and abs(value) < 1:
        digits = 4
    return f"{value:.{digits}g}"


def bound(value: float | None, digits: int = 6, *, up: bool = False) -> str:
    """A number that something is shown to be at least, or at most (``up``): rounded so that this stays true."""
    if value is None or value == 0 or not math.isfinite(value):
        return number(value, digits)
    if digits == 6 and abs(value) < 1:
        digits = 4
    exact = Decimal(repr(float(value)))
    last = Decimal(1).scaleb(exact.adjusted() - digits + 1)
    return f"{float(exact.quantize(last, ROUND_CEILING if up else ROUND_FLOOR)):.{digits}g}"


def value_of(row: Row) -> str:
    """The value of a row for people; a proved one is rounded so that it stays a bound."""
    return bound(row.value, up=row.id == "torque") if row.basis == "proved" else number(row.value)


def margin_of(row: Row, digits: int = 6) -> str:
    """Its margin, likewise."""
    return bound(row.margin, digits) if row.basis == "proved" else number(row.margin, digits)


def table(header: Sequence[str], rows: Iterable[Sequence[str]], right: Sequence[int] = ()) -> list[str]:
    """Lines of a table with aligned columns; those numbered ``right`` are aligned to the right."""
    cells = [list(header), *(list(row) for row in rows)]
    widths = [max(len(row[k]) for row in cells) for k in range(len(header))]
    lines = []
    for row in cells:
        parts = [
            cell.rjust(w) if k in right else cell.ljust(w) for k, (cell, w) in enumerate(zip(row, widths, strict=True))
        ]
        lines.append(" ".join(parts).rstrip())
    return lines


def short(name: str | None, most: int = 12) -> str:
    """A scenario's name, cut where it would make a table too wide."""
    name = name or ""
    return name if len(name) <= most else name[: most - 1] + "…"


def wrapped(text: str, indent: str = "") -> list[str]:
    """Lines of ``text`` that fit a terminal; further ones are indented by two more."""
    return textwrap.wrap(text, 79, initial_indent=indent, subsequent_indent=indent + "  ", break_long_words=False)


def builtin_lines() -> str:
    """The built-in specs: name, scenarios, source."""
    lines = []
    for name in builtin_names():
        spec = parse(builtin_text(name), origin=name).spec
        lines.append(f"{name:<14} {', '.join(s.name for s in spec.scenarios):<14} {spec.source}\n")
    return "".join(lines)


def gains_line(gains: Gains, law: str) -> str:
    """The gains with enough digits to copy, and their units."""
    text = f"kp = {gains.K_p:.10g} N m/rad, kd = {gains.K_d:.10g} N m s/rad"
    return text if law == "pd" else f"{text}, kf = {gains.K_f:.10g} m/s"


def word(row: Row) -> tuple[str, Style]:
    """PROVED, KEPT, BROKEN, UNDECIDED or (where nothing is required) INFO, and its style."""
    if row.required is None:
        return "INFO", Style.STRONG
    if row.status == "met":
        return "PROVED" if row.basis == "proved" else "KEPT", Style.GOOD
    if row.status == "undecided":
        return "UNDECIDED", Style.DOUBT
    return ("BROKEN", Style.BAD) if not row.soft else ("broken*", Style.DOUBT)


def ranked(rows: Sequence[Row]) -> list[Row]:
    """Worst first: broken, undecided, broken but soft, kept (the smallest part of a margin first), informing."""
    order = {"BROKEN": 0, "UNDECIDED": 1, "broken*": 2, "KEPT": 3, "PROVED": 3, "INFO": 4}

    def rank(row: Row) -> tuple[int, float]:
        size = max(abs(row.required or 0.0), abs(row.value or 0.0), 1e-12)
        return order[word(row)[0]], (row.margin / size if row.margin is not None else 0.0)

    return sorted(rows, key=rank)


def report_table(rows: Sequence[Row], paint: Paint) -> list[str]:
    """All rows, worst first, with notes below."""
    sorted_rows = ranked(rows)
    body = [
        [
            word(row)[0], row.id, short(row.scenario), value_of(row), number(row.required), margin_of(row, 4),
            row.unit, number(row.time_s, 5),
        ]
        for row in sorted_rows
    ]  # fmt: skip
    header = ["", "row", "scenario", "value", "needs", "margin", "unit", "at s"]
    lines = table(header, body, right=(3, 4, 5, 7))
    width = max(len(line[0]) for line in [header, *body])
    painted = [lines[0]]
    for line, row in zip(lines[1:], sorted_rows, strict=True):
        painted.append(paint(line[:width], word(row)[1]) + line[width:])
    notes = []
    for row in sorted_rows:
        if row.note:
            place = f", {row.scenario}" if row.scenario else ""
            notes += textwrap.wrap(f"{row.id}{place}: {row.note}", 78, initial_indent="  ", subsequent_indent="    ")
    if any(row.soft and row.status == "violated" for row in rows):
        notes.append("  * a soft requirement: shown, fails nothing")
    return painted + notes


def trajectory_lines(run: Trajectory, coarse: str = "") -> list[str]:
    """What a run comes to, in words; where its time step is too ``coarse``, only that."""
    if coarse:
        said = f"NO RESULT: {coarse}; what this step computes is not what the body does"
        return [f"scenario {run.scenario}:", *textwrap.wrap(said, 76, initial_indent="  ", subsequent_indent="    ")]
    low_t, low_h = int(np.argmin(run.F_T)), int(np.argmin(run.F_H))
    lost = run.lost_contact
    lines = [
        f"scenario {run.scenario}: {len(run.t):,} samples, {run.t[0]:g} to {run.t[-1]:g} s",
        f"  toe force    least {run.F_T[low_t]:10.4f} N   at {run.t[low_t]:.3f} s",
        f"  heel force   least {run.F_H[low_h]:10.4f} N   at {run.t[low_h]:.3f} s",
    ]
    if lost:
        lines.append(f"  CONTACT LOST at the {lost[1]} at {lost[0]:.3f} s (a real foot would turn from here on)")
    else:
        lines.append(f"  CoP          within {1000 * np.abs(run.P).max():.2f} mm of the ankle")
    if run.fallen is not None:
        lines.append(f"  FALLS: 90 degrees passed at {run.fallen:.3f} s; nothing is computed after it")
    F, E = run.F[:, -1], run.F_estimate[:, -1]
    lines += [
        f"  torque       largest {np.abs(run.tau).max():8.3f} N m",
        f"  at the end   angle {math.degrees(run.theta[-1]):.4f} deg, torque {run.tau[-1]:.4f} N m",
        f"  force        true ({F[0]:.3f}, {F[1]:.3f}) N, read off (16)-(17) ({E[0]:.3f}, {E[1]:.3f}) N",
    ]
    return lines


BLOCK = 10_000
"""Samples that become text at once."""

COLUMNS = (
    "time_s", "theta_rad", "rate_rad_per_s", "torque_nm", "toe_force_n", "heel_force_n", "cop_m", "fx_n", "fy_n",
    "fx_estimate_n", "fy_estimate_n", "slope_rad",
)  # fmt: skip


def columns(run: Trajectory) -> dict[str, np.ndarray | None]:
    """The samples of a run by column name; ``slope_rad`` is None where the scenario is no slope."""
    arrays = (
        run.t, run.theta, run.omega, run.tau, run.F_T, run.F_H, run.P, run.F[0], run.F[1], run.F_estimate[0],
        run.F_estimate[1], run.alpha,
    )  # fmt: skip
    return dict(zip(COLUMNS, arrays, strict=True))


def csv_parts(runs: Iterable[Trajectory], *, several: bool) -> Iterator[str]:
    """Samples as CSV, a part of the text at a time; with ``several`` runs a first column names the scenario."""
    yield ",".join([*(["scenario"] if several else []), *COLUMNS]) + "\n"
    for run in runs:
        arrays = list(columns(run).values())
        for begin in range(0, len(run.t), BLOCK):
            within = slice(begin, begin + BLOCK)
            count = len(run.t[within])
            parts = [
                [""] * count if array is None else [repr(x) if math.isfinite(x) else "" for x in array[within].tolist()]
                for array in arrays
            ]
            head = [[run.scenario] * count] if several else []
            yield "".join(",".join(row) + "\n" for row in zip(*head, *parts, strict=True))
