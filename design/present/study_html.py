"""A study as one HTML file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any


def as_html(document: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> str:
    """The page."""
    return "<!doctype html>"
