"""A front between margins, in words, Markdown, CSV and JSON; and one of its points as a design."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from design.errors import BadInput
from design.model.laws import Gains
from design.present import plots, store
from design.present.text import Paint, Style, gains_line, number, table, wrapped
from design.spec.load import Source

Facts = Mapping[str, Any]

ENDINGS = {".html": "html", ".md": "md", ".json": "json", ".csv": "csv"}
STYLES = {"complete": Style.GOOD, "infeasible": Style.BAD}


def check(form: str, point: str | None, points: int, plot: str | None, output: str | None) -> str:
    """The form of the output, by the ending of ``output`` if none was asked for; raises ``BadInput`` beforehand."""
    if plot:
        plots.format_of(plot)
    store.check_writable(plot, output)
    if point is None:
        return ENDINGS.get(Path(output).suffix, form) if output and form == "text" else form
    if output is None:
        message = "is written as a design; say where with -o design.json"
        raise BadInput(message, key="--point")
    if point != "knee" and not (point.isdecimal() and 1 <= int(point) <= points):
        message = f"is {point[:40]!r}; needs a number from 1 to {points}, or knee"
        raise BadInput(message, key="--point")
    return form


def document(source: Source, facts: Facts) -> dict[str, Any]:
    """The JSON of the command."""
    return store.document("tradeoff", source, **facts)


def design(source: Source, facts: Facts, point: str) -> str:
    """The point of that number, or the ``knee``, as JSON that `poise report` reads; raises ``BadInput``."""
    points = facts["points"]
    chosen = (facts["knee"] or {}).get("point") if point == "knee" else int(point)
    if chosen is None or chosen > len(points):
        there = "a knee" if point == "knee" else f"as many points: there are {len(points)}"
        message = f"is {point}; this front does not have {there}"
        raise BadInput(message, key="--point")
    its = points[chosen - 1]
    found = store.document(
        "tradeoff", source, status="solved", law=facts["law"], gains=its["gains"], point=chosen, values=its["values"],
        between=[each["id"] for each in facts["margins"]],
    )  # fmt: skip
    found["spec"]["text"] = source.text
    return store.dumps(found)


def render(source: Source, facts: Facts, form: str, paint: Paint) -> str:
    """The front in a ``form``: text, json, csv, md or html."""
    if form == "json":
        return store.dumps(document(source, facts))
    if form == "csv":
        return as_csv(facts)
    if form == "md":
        return as_markdown(source, facts)
    if form == "html":
        from design.present.tradeoff_html import as_html

        return as_html(source, facts)
    return as_text(source, facts, paint)


def title(source: Source, facts: Facts) -> str:
    """What lies between what."""
    verbs = {"at least": "more", "at most": "less"}
    between = ", ".join(f"{verbs[each['sense']]} {each['id']}" for each in facts["margins"])
    return f"{source.spec.name}: between {between}; law {facts['law']}"


def header(facts: Facts) -> list[str]:
    """Of the table of points."""
    margins = [f"{each['id']}" + ("" if each["unit"] == "1" else f" [{each['unit']}]") for each in facts["margins"]]
    return ["#", *margins, "kp", "kd", *(["kf"] if facts["law"] != "pd" else []), ""]


def rows(facts: Facts) -> list[list[str]]:
    """The points: number, margins, gains, and what is special about them."""
    found = []
    for k, each in enumerate(facts["points"], 1):
        gains = each["gains"]
        marks = [f"best {id}" for id, at in facts["ends"].items() if at == k]
        marks += ["knee"] if facts["knee"] and facts["knee"]["point"] == k else []
        names = ("kp", "kd", "kf")[: 3 if facts["law"] != "pd" else 2]
        found.append(
            [str(k), *(number(value) for value in each["values"].values()), *(number(gains[name]) for name in names),
             ", ".join(marks)]
        )  # fmt: skip
    return found


def as_text(source: Source, facts: Facts, paint: Paint) -> str:
    """The points, best in the first margin first, and what they say."""
    lines = [*wrapped(title(source, facts)), ""]
    if facts["points"]:
        cells = rows(facts)
        lines += [*table(header(facts), cells, right=range(len(cells[0]) - 1)), ""]
    lines.append(paint(facts["status"].upper(), STYLES.get(facts["status"], Style.DOUBT)))
    return "\n".join([*lines, *(line for said in findings(facts) for line in wrapped(said))]) + "\n"


def as_markdown(source: Source, facts: Facts) -> str:
    """The same as Markdown."""
    lines = [
        f"# {title(source, facts)}",
        "",
        f"**{facts['status'].upper()}**",
        "",
        *(f"- {s}" for s in findings(facts)),
    ]
    if facts["points"]:
        names = header(facts)
        right = ["---:"] * (len(names) - 1)
        lines += ["", *("| " + " | ".join(row) + " |" for row in [names, [*right, "---"], *rows(facts)])]
    return "\n".join(lines) + "\n"


def as_csv(facts: Facts) -> str:
    """One line a point: number, margins, gains, all digits."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["point", *(each["id"] for each in facts["margins"]), "kp", "kd", "kf"])
    for k, each in enumerate(facts["points"], 1):
        writer.writerow([k, *map(repr, each["values"].values()), *map(repr, each["gains"].values())])
    return out.getvalue()


def findings(facts: Facts) -> list[str]:
    """One sentence for each thing to know."""
    found = [facts["reason"]] if facts["reason"] else []
    points, knee = facts["points"], facts["knee"]
    if len(points) == 1:
        found.append("One design is the best in every margin: there is nothing to trade.")
    if knee:
        share = _values(facts, points[knee["point"] - 1]["values"])
        found.append(
            f"The knee is point {knee['point']}: {share}. It is the point farthest outside of the"
            f" {'chord' if len(facts['margins']) == 2 else 'plane'} through the ends, {knee['distance']:.3g} with each"
            " margin in parts of its range."
        )
    elif len(points) > len(facts["margins"]):
        found.append("The front has no knee: no point lies outside of the line between its ends.")
    for one, other in facts["jumps"]:
        found.append(f"The front jumps from point {one} to point {other}: no design was found between them.")
    if facts["unsolved"]:
        found.append(f"{facts['unsolved']} attempts at a point gave none; the front may have more there.")
    return [*found, *_own(facts)]


def _own(facts: Facts) -> list[str]:
    own = facts["given"]
    if own is None or not facts["points"]:
        return []
    gains = gains_line(Gains(*own["gains"].values()), facts["law"])
    said = f"The spec's own gains, {gains}: {_values(facts, own['values'])}"
    if not own["met"]:
        return [f"{said}; they break a requirement."]
    if not own["dominated"]:
        return [f"{said}; no point is better in every margin."]
    by = own["dominated_by"]
    return [f"{said}; point {by} is better in every margin: {_values(facts, facts['points'][by - 1]['values'])}."]


def _values(facts: Facts, values: Mapping[str, float | None]) -> str:
    units: Sequence[str] = [each["unit"] for each in facts["margins"]]
    parts = [
        f"{id} {number(value)}" + ("" if unit == "1" else f" {unit}")
        for (id, value), unit in zip(values.items(), units, strict=True)
    ]
    return ", ".join(parts)
