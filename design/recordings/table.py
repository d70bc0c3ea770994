"""A file's numbers with their names, units and line numbers, before anybody says what they mean."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.errors import BadInput

Array = NDArray[np.float64]

MAX_BYTES = 400_000_000
"""The largest file that is read."""
MAX_CELLS = 100_000_000
"""The largest table that is held: 800 MB of numbers."""
LARGEST = 1e30
"""From this size on a number stands for none: 3.4e38 is what many programs write for a missing sample."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Table:
    """What a file holds.

    ``values`` (n, k), NaN where a cell cannot be read; ``names`` (k), unique and printable; ``units`` (k), None where
    the file states none; ``lines`` (n): where each row stands in the file, counted from 1 (``place`` names what is
    counted); ``cell``: the text in a row and a column, for messages; ``rate`` [Hz] if the file states it;
    ``one_frame``: positions of all plates are in one frame by the file's format; ``detected``: what was found out, in
    sentences.
    """

    origin: str
    names: tuple[str, ...]
    units: tuple[str | None, ...]
    values: Array
    lines: NDArray[np.integer[Any]]
    cell: Callable[[int, int], str]
    rate: float | None
    detected: tuple[str, ...]
    place: str = "line"
    one_frame: bool = False
    sha256: str = ""


def readable(values: Array) -> Array:
    """``values`` with NaN in place of infinities and of numbers that stand for none; changed where it is."""
    with np.errstate(invalid="ignore"):
        for first in range(0, len(values), 1 << 16):
            part = values[first : first + (1 << 16)]
            part[~(np.abs(part) < LARGEST)] = np.nan
    return values


def unasked(row: int, column: int) -> str:
    """The cell of a table whose every cell is a number."""
    return ""


def check_cells(rows: int, columns: int, path: str) -> None:
    """Raise ``BadInput`` for a table that would fill the memory."""
    if rows * columns > MAX_CELLS:
        message = f"has {rows:,} rows of {columns:,} cells, at most {MAX_CELLS:,} cells are held; cut it"
        raise BadInput(message, file=path)


def printable(text: str) -> str:
    """``text`` without control characters, which a terminal would obey."""
    return text if text.isprintable() else "".join(c if c.isprintable() else " " for c in text).strip()


def unique(names: list[str]) -> list[str]:
    """``names``, printable, with ``.2``, ``.3`` ... added to those that come again; nameless ones are numbered."""
    labels: dict[str, None] = {}
    repeats: dict[str, int] = {}
    for index, name in enumerate(map(printable, names), start=1):
        plain = label = name or f"column {index}"
        while label in labels:
            repeats[plain] = repeats.get(plain, 1) + 1
            label = f"{plain}.{repeats[plain]}"
        labels[label] = None
    return list(labels)
