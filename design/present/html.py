"""A report as one HTML file that opens offline and asks nothing of anywhere: style and pictures are inside."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import Executor, Future
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from design.analysis.loop_curves import loop_curves
from design.analysis.rows import Series
from design.present import plots, report_plots, store
from design.present.explain import pages
from design.present.report import WORDS, Report, binding
from design.present.text import margin_of, number, ranked, value_of, word
from design.workers import Here

if TYPE_CHECKING:
    from design.present.plots import Figure


def as_html(report: Report, pen: Executor | None = None) -> str:
    """The whole page; its pictures are drawn where ``pen`` draws, by default here."""
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup

    hand = pen or Here()

    def draw(figure: Callable[..., Figure], *records: Any) -> Future[str]:
        return hand.submit(_drawn, figure, *records)

    runs = [
        (run.scenario, draw(plots.run_figure, [run], report.setting.biped, "")) for run in report.verdict.trajectories
    ]
    figures = {row: draw(report_plots.limit_figure, parts) for row, parts in _by_row(report.verdict.series)}
    loop: list[tuple[str, Future[str]]] = []
    if report.gains is not None:
        curves = loop_curves(report.setting, report.gains)
        loop.append(("Root locus over the actuator's gain", draw(report_plots.locus_figure, curves)))
        loop.append(("Loop gain and sensitivities at the actuator", draw(report_plots.loop_figure, curves)))
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters.update(number=number, value_of=value_of, margin_of=margin_of)
    source = files("design.present").joinpath("report.html.j2").read_text(encoding="utf-8")
    held = {(row.id, row.scenario) for row in binding(report.verdict.rows)}
    rows = [(row, *word(row), (row.id, row.scenario) in held) for row in ranked(report.verdict.rows)]
    template = environment.from_string(source)
    return template.render(
        report=report,
        word=WORDS[report.verdict.overall],
        rows=rows,
        pages={row: page for row, page in pages().items() if any(each.id == row for each in report.verdict.rows)},
        figures={row: Markup(picture.result()) for row, picture in figures.items()},
        loop=[(head, Markup(picture.result())) for head, picture in loop],
        runs=[(scenario, Markup(picture.result())) for scenario, picture in runs],
        provenance=", ".join(f"{name} {version}" for name, version in store.provenance().items()),
    )


def _drawn(figure: Callable[..., Figure], *records: Any) -> str:
    return svg(figure(*records))


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
