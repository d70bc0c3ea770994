"""A report as JSON, Markdown, text and JUnit XML; with another design beside it where one is given.

``Report`` holds what all forms are made from; the HTML form is in ``html``.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from design.analysis.objectives import OBJECTIVES
from design.analysis.rows import Row, RowStatus, Verdict
from design.errors import BadInput
from design.model.laws import Gains
from design.present import store
from design.present.text import Paint, Style, gains_line, number, ranked, report_table, short, table, word, wrapped
from design.spec.load import Source
from design.spec.setting import Setting

if TYPE_CHECKING:  # only who reads recordings waits for it
    from design.recordings.record import Record

WORDS: dict[RowStatus, tuple[str, Style]] = {
    "met": ("KEPT", Style.GOOD),
    "violated": ("BROKEN", Style.BAD),
    "undecided": ("UNDECIDED", Style.DOUBT),
}


@dataclass(frozen=True, eq=False, kw_only=True)
class Report:
    """One design and its verdict; or, with a ``record``, a measured trial, of which no ``gains`` are known.

    ``remarks``: what must be known to read it.
    """

    source: Source
    setting: Setting
    gains: Gains | None
    verdict: Verdict
    record: Record | None = None
    remarks: tuple[str, ...] = ()

    @property
    def title(self) -> str:
        """Spec, law and gains in a line, or spec and recording."""
        if self.record is not None or self.gains is None:
            return f"{self.source.spec.name}, measured: {self.record.origin if self.record else 'nothing'}"
        return f"{self.source.spec.name}, law {self.setting.law}, {gains_line(self.gains, self.setting.law)}"

    @property
    def counted(self) -> str:
        """How many requirements are kept."""
        rows = [row for row in self.verdict.rows if row.counts]
        kept = sum(row.status == "met" for row in rows)
        return f"{kept} of {len(rows)} requirements kept"


def binding(rows: Sequence[Row], part: float = 1e-3) -> list[Row]:
    """Rows kept by less than ``part`` of their level: what holds the design back."""
    found = []
    for row in rows:
        if row.required is None or row.margin is None or row.value is None or row.status != "met":
            continue
        if row.margin <= part * max(abs(row.required), abs(row.value)):
            found.append(row)
    return found


def as_text(report: Report, paint: Paint) -> str:
    """The table for a terminal."""
    lines = [*wrapped(report.title), "", *report_table(report.verdict.rows, paint), ""]
    lines += [f"binds: {row.id} in {row.scenario}" for row in binding(report.verdict.rows)]
    lines += [line for said in report.remarks for line in wrapped(said)]
    lines.append(f"specification: {paint(*WORDS[report.verdict.overall])} ({report.counted})")
    return "\n".join(lines) + "\n"


def as_json(report: Report, other: Report | None = None) -> dict[str, Any]:
    """The report as stored; ``against`` holds the other design's rows."""
    parts = _json(report)
    if other is not None:
        parts["against"] = {"spec": {"name": other.source.spec.name, "sha256": other.source.sha256}, **_json(other)}
    return store.document("report", report.source, status="solved", **parts)


def _json(report: Report) -> dict[str, Any]:
    rows = report.verdict.rows
    return {
        "law": report.setting.law if report.gains else None,
        "gains": store.gains_json(report.gains) if report.gains else None,
        **({"record": store.record_json(report.record)} if report.record else {}),
        **({"remarks": report.remarks} if report.remarks else {}),
        "verdict": report.verdict.overall,
        "binding": [{"id": row.id, "scenario": row.scenario} for row in binding(rows)],
        "rows": [store.row_json(row) for row in rows],
    }


def as_markdown(report: Report) -> str:
    """The report for an issue, a wiki or a paper's supplement."""
    lines = [
        f"# {_plain(report.source.spec.name)}: {WORDS[report.verdict.overall][0]}",
        "",
        f"{_plain(report.title)}. {report.counted}.",
        "",
        "| | row | scenario | value | needs | margin | unit | at [s] | basis |",
        "|---|---|---|---:|---:|---:|---|---:|---|",
    ]
    rows = ranked(report.verdict.rows)
    for row in rows:
        lines.append(
            f"| {word(row)[0]} | {row.id} | {_plain(row.scenario or '')} | {number(row.value)} | {number(row.required)}"
            f" | {number(row.margin, 4)} | {row.unit} | {number(row.time_s, 5)} | {row.basis} |"
        )
    notes = [f"- `{row.id}`: {_plain(row.note)}" for row in rows if row.note]
    notes += [f"- {_plain(said)}" for said in report.remarks]
    stamp = store.provenance()
    lines += [
        "",
        *notes,
        "",
        f"Spec sha256 `{report.source.sha256}`; poise {stamp['poise']}, casadi {stamp['casadi']}.",
    ]
    return "\n".join(lines) + "\n"


def _plain(text: str) -> str:
    """Text of a spec with Markdown's and HTML's marks escaped."""
    for mark in "\\`*_[]<>|":
        text = text.replace(mark, "\\" + mark)
    return " ".join(text.split())


def as_junit(report: Report) -> str:
    """JUnit XML: a test case a row; broken soft requirements and rows that only inform are skipped cases."""
    from junitparser import Failure, JUnitXml, Skipped, TestCase, TestSuite

    suite = TestSuite(f"poise {report.source.spec.name}")
    for row in report.verdict.rows:
        case = TestCase(row.id, classname=f"{report.source.spec.name}.{row.scenario or 'all'}", time=0)
        said = f"{row.id}: {number(row.value)} {row.unit}, needs {number(row.required)}. {row.note}".strip()
        if not row.counts:
            case.result = [Skipped(said)]
        elif row.status != "met":
            case.result = [Failure(said, type_=row.status)]
        suite.add_testcase(case)
    xml = JUnitXml("poise")
    xml.add_testsuite(suite)
    xml.update_statistics()
    return str(xml.tostring().decode()) + "\n"


def comparison(one: Report, other: Report, names: tuple[str, str], paint: Paint) -> str:
    """Two designs row by row."""
    theirs = {(row.id, row.scenario): row for row in other.verdict.rows}
    loose = {row.id: row for row in other.verdict.rows if row.scenario is None or row.basis == "exact"}
    body = []
    for row in one.verdict.rows:
        match = theirs.get((row.id, row.scenario)) or loose.get(row.id)
        better = _better(row, match)
        mine, its = word(row)[0], word(match)[0] if match else ""
        body.append(
            [row.id, short(row.scenario, 8), f"{mine} {number(row.value)}",
             f"{its} {number(match.value if match else None)}", row.unit, {1: "A", -1: "B", 0: ""}[better]]
        )  # fmt: skip
    lines = [*wrapped(f"A: {names[0]}: {one.title}"), *wrapped(f"B: {names[1]}: {other.title}"), ""]
    lines += table(["row", "", "A", "B", "unit", "better"], body)
    verdicts = [paint(*WORDS[each.verdict.overall]) for each in (one, other)]
    lines += [
        "",
        f"specification: A {verdicts[0]} ({one.counted})",
        f"               B {verdicts[1]} ({other.counted})",
    ]
    return "\n".join(lines) + "\n"


def render(
    form: str, one: Report, other: Report | None, names: tuple[str, str], paint: Paint, pen: Executor | None = None
) -> str:
    """The report in a ``form``: text, json, md, html or junit; raises ``BadInput`` for one that cannot compare.

    ``pen`` draws the pictures of html.
    """
    if form == "json":
        return store.dumps(as_json(one, other))
    if other is not None:
        if form != "text":
            message = f"is not written as {form}; use --format text or json"
            raise BadInput(message, key="--against")
        return comparison(one, other, names, paint)
    if form == "html":
        from design.present.html import as_html

        return as_html(one, pen)
    return {"md": as_markdown, "junit": as_junit}[form](one) if form != "text" else as_text(one, paint)


def _better(row: Row, other: Row | None) -> int:
    """1 if ``row`` is the better one by more than rounding, -1 if the ``other``, else 0."""
    if other is None or row.value is None or other.value is None:
        return 0
    difference = row.value - other.value
    if row.id in ("stiffness", "damping", "routh") and row.margin is not None and other.margin is not None:
        difference = row.margin - other.margin
    if abs(difference) <= 1e-6 * max(abs(row.value), abs(other.value)):
        return 0
    less_is_better = row.id in OBJECTIVES and OBJECTIVES[row.id].sense == "at most"
    return int((difference > 0) != less_is_better) * 2 - 1
