"""One page a row: what it says, why it matters, its formula and source, and how to improve it."""

from __future__ import annotations

import difflib
import textwrap
import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

from design.errors import BadInput


@dataclass(frozen=True, kw_only=True)
class Page:
    """The page of one row."""

    title: str
    says: str
    why: str
    formula: str
    source: str
    improve: str


@cache
def pages() -> dict[str, Page]:
    """All pages by row id."""
    text = files("design.present").joinpath("pages.toml").read_text(encoding="utf-8")
    return {row: Page(**page) for row, page in tomllib.loads(text).items()}


def explain(row: str) -> str:
    """The page of ``row`` as text; raises ``BadInput`` with the rows there are."""
    known = pages()
    if row not in known:
        close = difflib.get_close_matches(row, known, n=1)
        hint = f"; did you mean {close[0]!r}?" if close else ""
        message = f"no row of that name{hint}; there are: {', '.join(known)}"
        raise BadInput(message, key=row)
    page = known[row]
    parts = [f"{row}: {page.title}", ""]
    for head, body in (
        ("", page.says),
        ("Why it matters", page.why),
        ("Formula", page.formula),
        ("Source", page.source),
        ("To improve it", page.improve),
    ):
        parts += ([head] if head else []) + textwrap.wrap(body, 78, initial_indent="  ", subsequent_indent="  ") + [""]
    return "\n".join(parts)
