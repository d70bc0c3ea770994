"""A report as one HTML file that opens offline and asks nothing of anywhere: style and pictures are inside."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.resources import files
from typing import TYPE_CHECKING

from design.analysis.loop_curves import loop_curves
from design.analysis.rows import Series
from design.present import plots, report_plots, store
from design.present.explain import pages
from design.present.report import WORDS, Report, binding
from design.present.text import number, ranked, word

if TYPE_CHECKING:
    from design.present.plots import Figure


def as_html(report: Report) -> str:
    """The whole page."""
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters["number"] = number
    source = files("design.present").joinpath("report.html.j2").read_text(encoding="utf-8")
    held = {(row.id, row.scenario) for row in binding(report.verdict.rows)}
    rows = [(row, *word(row), (row.id, row.scenario) in held) for row in ranked(report.verdict.rows)]
    curves = loop_curves(report.setting, report.gains)
    figures = {row: Markup(svg(report_plots.limit_figure(parts))) for row, parts in _by_row(report.verdict.series)}
    return environment.from_string(source).render(
        report=report,
        word=WORDS[report.verdict.overall],
        rows=rows,
        pages={row: page for row, page in pages().items() if any(each.id == row for each in report.verdict.rows)},
        figures=figures,
        locus=Markup(svg(report_plots.locus_figure(curves))),
        loop=Markup(svg(report_plots.loop_figure(curves))),
        runs=[
            (run.scenario, Markup(svg(plots.run_figure([run], report.setting.biped.ell, ""))))
            for run in report.verdict.trajectories
        ],
        provenance=", ".join(f"{name} {version}" for name, version in store.provenance().items()),
    )


def svg(figure: Figure) -> str:
    """The picture as an SVG element, without the head of a file of its own."""
    text = plots.figure_bytes(figure, "svg").decode()
    return text[text.index("<svg") :]


def _by_row(series: Iterable[Series]) -> list[tuple[str, list[Series]]]:
    found: dict[str, list[Series]] = {}
    for part in series:
        if part.level is not None:
            found.setdefault(part.id, []).append(part)
    return list(found.items())
