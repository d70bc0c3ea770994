"""A study for the terminal and as Markdown: who kept contact, by how much, and what the differences are worth."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from typing import Any

from design.present.text import Paint, Style, number, table, wrapped

Summary = Mapping[str, Any]

COLUMNS = (
    "controller", "scenario", "trial", "status", "why", "survived", "limit", "lost_s", "lost_at", "fallen_s",
    "toe_force_n", "heel_force_n", "contact_force_n", "cop_margin_m", "settling_s", "posture_error_deg",
    "torque_rms_nm", "torque_peak_nm", "torque_variation_nm", "steps", "tail_steps", "law_steps",
)  # fmt: skip
TIMES = ("median_ms", "p99_ms", "max_ms")
LEGEND = (
    "lost: trials that lost contact. least, median: smallest contact force of a trial [N]. settle: time to the"
    " final posture, median. rms: torque. ms: computing time of a step, median and 99 %. fails: steps that took the"
    " previous plan's tail or law (20). slope, push: largest sudden slope and push survived from rest, as a share of"
    " what any ankle can."
)
MEASURES = {
    "contact_force_n": ("smallest contact force", "N"),
    "settling_s": ("settling", "s"),
    "torque_rms_nm": ("torque, rms", "N m"),
    "torque_variation_nm": ("torque variation", "N m"),
}
"""The differences that are printed; all are in the JSON."""


def csv_text(rows: Sequence[Mapping[str, Any]]) -> str:
    """All rows as CSV, an empty cell where a row has no such value."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([*COLUMNS, *TIMES])
    for row in rows:
        cells = [row.get(name) for name in COLUMNS]
        times = row.get("seconds") or {}
        writer.writerow(["" if cell is None else cell for cell in [*cells, *(times.get(name) for name in TIMES)]])
    return out.getvalue()


def as_text(document: Mapping[str, Any], paint: Paint) -> str:
    """The study in at most 80 columns."""
    controllers = document["controllers"]
    lines = [*wrapped(title(document)), ""]
    body = [[*cells(name, one)] for name, one in controllers.items()]
    whole = table(_HEADER, body, right=tuple(range(1, len(_HEADER))))
    lines.append(whole[0])
    for line, one in zip(whole[1:], controllers.values(), strict=True):
        lines.append(paint(line, Style.BAD) if one["lost"] or one["failed"] else line)
    lines += ["", *wrapped(LEGEND)]
    differences = _differences(document)
    if differences:
        lines += ["", *wrapped(_differences_heading(document))]
        lines += table(["", "measure", "difference", "95 % interval", "pairs"], differences, right=(2, 4))
    lines += _remarks(document)
    return "\n".join(lines) + "\n"


def as_markdown(document: Mapping[str, Any]) -> str:
    """The study as Markdown tables."""
    lines = [f"# Study of {document['spec']['name']}", "", title(document), ""]
    lines += _markdown(_HEADER, [cells(name, one) for name, one in document["controllers"].items()])
    lines += ["", LEGEND, ""]
    differences = _differences(document)
    if differences:
        lines += [_differences_heading(document), ""]
        lines += _markdown(["controller", "measure", "difference", "95 % interval", "pairs"], differences)
    lines += _remarks(document)
    return "\n".join(lines) + "\n"


_HEADER = ["", "lost", "least", "median", "settle", "rms", "ms", "99 %", "fails", "slope", "push"]


def title(document: Mapping[str, Any]) -> str:
    """What was tried, in a sentence."""
    return (
        f"{document['spec']['name']}: {document['trials']} trial{'s' * (document['trials'] != 1)} of each controller in"
        f" {len(document['scenarios'])} scenario{'s' * (len(document['scenarios']) != 1)}, seed {document['seed']},"
        f" control period {1e3 * document['control_period_s']:g} ms"
    )


def cells(name: str, one: Summary) -> list[str]:
    """A controller's line of the table."""
    force, ms = one["contact_force_n"], one["step_ms"]
    return [
        name, f"{one['lost']}/{one['trials']}" + (f" +{one['failed']} failed" if one["failed"] else ""),
        number(force["min"], 4), number(force["median"], 4), number(one["settling_s"], 3),
        number(one["torque_rms_nm"], 3), number(ms["median"], 2), number(ms["p99"], 2), str(one["unsolved"]),
        _percent(one["step_slope_share"]), _percent(one["push_share"]),
    ]  # fmt: skip


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.1f}%"


def _differences_heading(document: Mapping[str, Any]) -> str:
    where = f"Differences from {document['reference']} in the same world and noise"
    return f"{where}, with 95 % intervals (bootstrap; Student's t below 10 pairs):"


def _differences(document: Mapping[str, Any]) -> list[list[str]]:
    """Rows of differences that have an interval; a bare mean is not shown."""
    found = []
    for name, one in document["controllers"].items():
        for measure, (words, unit) in MEASURES.items():
            each = one.get("against", {}).get(measure)
            if each and each["low"] is not None:
                interval = f"{number(each['low'], 4)} to {number(each['high'], 4)} {unit}"
                found.append([name, words, f"{each['mean']:+.4g} {unit}", interval, str(each["pairs"])])
    return found


def _remarks(document: Mapping[str, Any]) -> list[str]:
    lines = [line for name, why in document["left_out"].items() for line in wrapped(f"{name} is left out: {why}")]
    if not _differences(document) and len(document["controllers"]) > 1:
        lines += wrapped(
            "Differences are not shown: an interval needs three trials or more that both controllers have."
        )
    if document["remark"]:
        lines += wrapped(document["remark"])
    return ["", *lines] if lines else []


def _markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [
        "| " + " | ".join(header) + " |",
        "|" + "---|" * len(header),
        *("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows),
    ]
