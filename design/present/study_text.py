"""A study for the terminal and as Markdown: who kept contact, by how much, and what the differences are worth."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from typing import Any

from design.present.text import Paint, Style, number, short, table, wrapped

Summary = Mapping[str, Any]

COLUMNS = (
    "controller", "scenario", "trial", "seed", "mass_kg", "com_height_m", "inertia_kgm2", "foot_mass_kg",
    "half_length_m", "slope_rad", "ramp_s", "kp", "kd", "kf", "torque_weight", "rate_weight", "status", "why",
    "survived", "limit", "lost_s", "lost_at", "fallen_s", "toe_force_n", "heel_force_n", "contact_force_n",
    "cop_margin_m", "settling_s", "posture_error_deg", "torque_rms_nm", "torque_peak_nm", "torque_variation_nm",
    "steps", "tail_steps", "law_steps",
)  # fmt: skip
"""What was drawn, with which gains or weights, and what came of it: a trial can be repeated from its line."""
TIMES = ("median_ms", "p99_ms", "max_ms")
LEGEND = (
    "lost: trials that lost contact. least, median: smallest contact force of a trial [N]. settle: time to the"
    " final posture, median of the trials that settled, and how many of all did. rms: torque. ms: computing time of a"
    " step, median and 99 %. fails: steps that took the previous plan's tail or law (20). slope, push: largest sudden"
    " slope and push survived from rest, as a share of what any ankle can [%]."
)
MEASURES = {
    "lost": ("trials that lost contact", "%", 100.0),
    "contact_force_n": ("smallest contact force", "N", 1.0),
    "settling_s": ("settling", "s", 1.0),
    "torque_rms_nm": ("torque, rms", "N m", 1.0),
    "torque_variation_nm": ("torque variation", "N m", 1.0),
}
"""The differences that are printed, with unit and factor, those of lost contact first; all are in the JSON."""
BY_SCENARIO = ("lost", "contact_force_n")
"""Those that are printed scenario by scenario too, where there are several."""


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
    body = [_joined(cells(name, one)) for name, one in controllers.items()]
    whole = table(_joined(_HEADER), body, right=tuple(range(1, len(_HEADER) - 1)))
    lines.append(whole[0])
    for line, one in zip(whole[1:], controllers.values(), strict=True):
        lines.append(paint(line, Style.BAD) if one["lost"] or one["failed"] else line)
    lines += ["", *wrapped(LEGEND)]
    lines += tuning_lines(document)
    differences = _differences(document)
    if differences:
        lines += ["", *wrapped(_differences_heading(document))]
        lines += _by_measure(differences)
    lines += _remarks(document)
    return "\n".join(lines) + "\n"


def as_markdown(document: Mapping[str, Any]) -> str:
    """The study as Markdown tables."""
    lines = [f"# Study of {document['spec']['name']}", "", title(document), ""]
    lines += _markdown(_HEADER, [cells(name, one) for name, one in document["controllers"].items()])
    lines += ["", LEGEND, "", *(f"- {said}" for said in tuning_sentences(document)), ""]
    differences = _differences(document)
    if differences:
        lines += [_differences_heading(document), ""]
        lines += _markdown(["measure", *_DIFFERENCES[1:]], differences)
    lines += _remarks(document)
    return "\n".join(lines) + "\n"


_HEADER = ["", "lost", "least", "median", "settle", "n/N", "rms", "ms", "99 %", "fails", "slope", "push"]
_DIFFERENCES = ["", "controller", "scenario", "difference", "95 % interval", "pairs"]


def title(document: Mapping[str, Any]) -> str:
    """What was tried, in a sentence."""
    return (
        f"{document['spec']['name']}: {document['trials']} trial{'s' * (document['trials'] != 1)} of each controller in"
        f" {len(document['scenarios'])} scenario{'s' * (len(document['scenarios']) != 1)}, seed {document['seed']},"
        f" control period {1e3 * document['control_period_s']:g} ms"
    )


def _joined(line: Sequence[str]) -> list[str]:
    """A line of the table as narrow as it can be: settling time and how many settled in one cell, shares without %."""
    return [*line[:4], f"{line[4]} {line[5]}", *line[6:-2], *(cell.rstrip("%") for cell in line[-2:])]


def cells(name: str, one: Summary) -> list[str]:
    """A controller's line of the table."""
    force, ms = one["contact_force_n"], one["step_ms"]
    return [
        name, f"{one['lost']}/{one['trials']}" + (f" +{one['failed']} failed" if one["failed"] else ""),
        number(force["min"], 4), number(force["median"], 4), number(one["settling_s"], 3),
        f"{one['settled']}/{one['trials']}", number(one["torque_rms_nm"], 3), _milliseconds(ms["median"]),
        _milliseconds(ms["p99"]), str(one["unsolved"]),
        _percent(one["step_slope_share"]), _percent(one["push_share"]),
    ]  # fmt: skip


def _milliseconds(value: float | None) -> str:
    return "<.01" if value is not None and value < 0.01 else number(value, 2)


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.1f}%"


def tuning_lines(document: Mapping[str, Any]) -> list[str]:
    """How gains and weights were chosen, for a terminal; empty where nothing was."""
    head, *rest = tuning_sentences(document) or [""]
    return ["", *wrapped(head), *(line for said in rest for line in wrapped(said, "  "))] if head else []


def tuning_sentences(document: Mapping[str, Any]) -> list[str]:
    """By what weights were tuned and gains sought, then a sentence for each controller."""
    tuning = document["tuning"]
    weights, gains = tuning["weights"], tuning["gains"]
    if not weights and not any(its["starts"] for its in gains.values()):
        return []
    objective = tuning["objective"]
    digits = f" {objective['unit']}"
    found = []
    for name, its in weights.items():
        numbers = f"torque_weight {its['torque_weight']:g}, rate_weight {its['rate_weight']:g}"
        said = f"{name}: {numbers}"
        if not its["evaluations"]:
            found.append(f"{said}, not tuned")
            continue
        said += f": {number(its['value'], 4)}{digits}, from {number(its['value_before'], 4)}{digits}"
        said += f" with the default weights, in {its['evaluations']} evaluations"
        if its["tuned_with"] != name:
            said += f" of {its['tuned_with']}, whose cost it shares"
        found.append(said + (f"; {' and '.join(its['fixed'])} as the spec says" if its["fixed"] else ""))
    for name, its in gains.items():
        said = f"{name}: {number(its['value'], 4)}{digits} with "
        if its["starts"]:
            tried = f"{its['surveyed']} gains surveyed, then searches with exact derivatives"
            said += f"the gains of `poise synthesize` ({tried})"
        else:
            said += "the spec's gains"
        if its["value"] is not None:
            found.append(said)
    head = f"Weights are tuned to {objective['sense']} {objective['id']}, as gains are: the worst of the spec's"
    head += " scenarios, nominal body, noise that no trial has. An evaluation is one run of every scenario."
    if weights and not any(its["evaluations"] for its in weights.values()):
        head = "Weights are those of [mpc] or its defaults; they were not tuned."
    elif tuning["instead_of"]:
        head += f" (The spec's objective, {tuning['instead_of']}, cannot be read off a run.)"
    return [head, *found]


def _by_measure(differences: Sequence[Sequence[str]]) -> list[str]:
    """The table of differences with a line for each measure, in at most 80 columns."""
    head, *lines = table(
        _DIFFERENCES[1:], [[f"  {name}", short(where), *rest] for _, name, where, *rest in differences], right=(2, 4)
    )
    found = [head]
    for (words, *_), line in zip(differences, lines, strict=True):
        found += [words, line] if words else [line]
    return found


def _differences_heading(document: Mapping[str, Any]) -> str:
    where = f"Differences from {document['reference']} in the same world and noise"
    several = ", scenarios weighing the same" if len(document["scenarios"]) > 1 else ""
    return f"{where}{several}, with 95 % intervals (draws resampled, BCa; Student's t below 10 draws):"


def _differences(document: Mapping[str, Any]) -> list[list[str]]:
    """Rows of differences that have an interval; a bare mean is not shown. Of lost trials the counts are shown too."""
    controllers, reference = document["controllers"], document["reference"]
    several = len(document["scenarios"]) > 1
    found = []
    for measure, (words, unit, scale) in MEASURES.items():
        rows = []
        for name, one in controllers.items():
            whole = one.get("against", {}).get(measure)
            if not whole:
                continue
            parts = whole["by_scenario"] if several and measure in BY_SCENARIO else {}
            for scenario, each in [(covered(whole), whole), *parts.items()]:
                said = _difference(each, unit, scale)
                if measure == "lost" and each is whole and each["pairs"] >= 3:
                    lost = [f"{controllers[who]['lost']}/{controllers[who]['trials']}" for who in (reference, name)]
                    said = said or [f"{lost[0]} to {lost[1]}", "-"]
                if said:
                    rows.append([name, scenario, *said, str(each["pairs"])])
        found += [[words if k == 0 else "", *row] for k, row in enumerate(rows)]
    return found


def covered(whole: Mapping[str, Any]) -> str:
    """Over which scenarios a difference is a mean: all, or as many as have a pair."""
    count = len(whole["by_scenario"])
    return "all" if whole["scenarios"] in (0, count) else f"{whole['scenarios']} of {count}"


def _difference(each: Mapping[str, Any], unit: str, scale: float) -> list[str]:
    """The mean and its interval as words; empty where there is none."""
    if each["low"] is None:
        return []
    low, high = scale * each["low"], scale * each["high"]
    return [f"{scale * each['mean']:+.4g} {unit}", f"{number(low, 4)} to {number(high, 4)} {unit}"]


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
