"""A front as one HTML file that opens offline: the picture, what it says, every point, and what it rests on."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from typing import Any

from design.present import store, tradeoff
from design.present.text import Style
from design.present.tradeoff_plots import tradeoff_figure
from design.spec.load import Source


def as_html(source: Source, facts: Mapping[str, Any]) -> str:
    """The whole page."""
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup

    from design.present.html import svg

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    page = files("design.present").joinpath("tradeoff.html.j2").read_text(encoding="utf-8")
    title = tradeoff.title(source, facts)
    return environment.from_string(page).render(
        title=title,
        source=source,
        word=(facts["status"].upper(), tradeoff.STYLES.get(facts["status"], Style.DOUBT)),
        findings=tradeoff.findings(facts),
        picture=Markup(svg(tradeoff_figure(facts, title))) if facts["points"] else "",
        header=tradeoff.header(facts),
        rows=tradeoff.rows(facts),
        provenance=", ".join(f"{name} {version}" for name, version in store.provenance().items()),
    )
