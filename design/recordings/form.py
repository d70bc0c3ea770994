"""How the rows of a text file are written: delimiter, decimal sign and number of cells, from the rows themselves."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from design.errors import BadInput
from design.recordings.reading import Reading
from design.recordings.remedies import Misfit, Remedy

NAMED = {"tab": "\t", "\\t": "\t", "comma": ",", "semicolon": ";", "space": " ", "spaces": " ", "whitespace": " "}
WORDS = {"\t": "tab", ",": "comma", ";": "semicolon", " ": "spaces", "|": "|", ":": ":"}
MISSING = {"", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "?", ".", "inf", "+inf", "-inf", "-nan"}
NUMBER = {
    ".": re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?"),
    ",": re.compile(r"[+-]?(\d+(,\d+)?|,\d+)([eEdD][+-]?\d+)?"),
}


@dataclass(frozen=True, kw_only=True)
class Form:
    """How the rows are written: ``delimiter`` (a space stands for any white space), ``decimal``, ``cells`` of a row.

    ``closed``: a delimiter stands after the last cell too.
    """

    delimiter: str
    decimal: str
    cells: int
    closed: bool = False

    def split(self, line: str) -> list[str]:
        """The cells of a line, without the spaces around them, and without the one after a delimiter that closes it."""
        cells = split(line, self.delimiter)
        if self.closed and len(cells) == self.cells + 1 and not cells[-1]:
            cells.pop()
        return cells

    def is_number(self, cell: str) -> bool:
        """Whether the cell is a number."""
        return NUMBER[self.decimal].fullmatch(cell) is not None

    def numbers(self, cells: Sequence[str]) -> int:
        """How many of ``cells`` are numbers."""
        return sum(map(self.is_number, cells))

    def is_row(self, line: str) -> bool:
        """Whether every cell is a number or missing, and at least one (and a third of them) is a number."""
        cells = self.split(line)
        count = self.numbers(cells)
        blank = sum(cell.lower() in MISSING for cell in cells)
        return len(cells) == self.cells and count + blank == len(cells) and 3 * count >= len(cells) and count > 0

    def is_rather_a_row(self, line: str) -> bool:
        """Whether it has the right number of cells, and half of them are numbers."""
        cells = self.split(line)
        return len(cells) == self.cells and 2 * self.numbers(cells) >= len(cells)


def split(line: str, delimiter: str) -> list[str]:
    """The cells of ``line``; quotes are honoured, and an empty cell after a delimiter at the end is none."""
    if delimiter == " ":
        return next(csv.reader([line], delimiter=" ", skipinitialspace=True), []) if '"' in line else line.split()
    cells = (
        next(csv.reader([line], delimiter=delimiter, skipinitialspace=True)) if '"' in line else line.split(delimiter)
    )
    return [cell.strip() for cell in cells]


def form_of(tail: Sequence[str], how: Reading, path: str) -> Form:
    """Delimiter, decimal sign and number of cells of the lines in ``tail``, which ends a file."""
    found: list[tuple[float, Form]] = []
    for delimiter in [_delimiter(how.delimiter)] if how.delimiter else ["\t", ";", ",", " ", "|"]:
        for decimal in [_decimal(how.decimal)] if how.decimal else [".", ","]:
            if decimal == delimiter and not any('"' in line for line in tail):
                continue
            part, form = _fit(tail, delimiter, decimal)
            if part >= 0.25 and (form.cells > 1 or how.delimiter or delimiter == " "):
                found.append((part, form))
    best = max((part for part, _ in found), default=0.0)
    forms = [form for part, form in found if part > best - 0.2]
    if any(form.cells > 1 for form in forms):
        forms = [form for form in forms if form.cells > 1 or how.delimiter]
    distinct: dict[str, Form] = {}
    for form in forms:
        distinct.setdefault(form.delimiter, form)
    if " " in distinct and len(distinct) > 1:
        others = [form for delimiter, form in distinct.items() if delimiter != " "]
        if all(form.cells >= distinct[" "].cells for form in others):
            del distinct[" "]
    if not distinct:
        message = (
            "has no rows of numbers that a delimiter (tab, comma, semicolon, spaces) separates; say"
            " --delimiter, --decimal and --skip-rows, or export the trial as CSV"
        )
        raise BadInput(message, file=path)
    if len(distinct) > 1:
        which = " or ".join(WORDS.get(delimiter, delimiter) for delimiter in distinct)
        remedies = [Remedy(options={"--delimiter": WORDS.get(delimiter, delimiter)}) for delimiter in distinct]
        message = "can be read with several delimiters"
        raise Misfit(message, file=path, remedies=remedies, otherwise=f"state which with --delimiter ({which})")
    return next(iter(distinct.values()))


def _fit(tail: Sequence[str], delimiter: str, decimal: str) -> tuple[float, Form]:
    """How well the lines of ``tail`` are rows under these signs, and the form with their number of cells.

    A line of numbers counts twice as much as one with other cells too.
    """
    rows = [split(line, delimiter) for line in tail]
    plain = Form(delimiter=delimiter, decimal=decimal, cells=0)
    counts: dict[int, float] = {}
    for cells in rows:
        numbers = plain.numbers(cells)
        if numbers and all(plain.is_number(cell) or cell.lower() in MISSING for cell in cells):
            counts[len(cells)] = counts.get(len(cells), 0.0) + 1.0
        elif numbers and 2 * numbers >= len(cells):
            counts[len(cells)] = counts.get(len(cells), 0.0) + 0.5
    if not counts:
        return 0.0, plain
    usual = max(counts, key=lambda count: counts[count])
    closed = usual > 2 and delimiter != " " and all(not cells[-1] for cells in rows if len(cells) == usual)
    form = Form(delimiter=delimiter, decimal=decimal, cells=usual - closed, closed=closed)
    return counts[usual] / len(rows), form


def _delimiter(text: str) -> str:
    delimiter = NAMED.get(text.lower(), text)
    if len(delimiter) != 1 or delimiter.isalnum() or delimiter in ".+-\"'\n":
        message = f"is {text[:20]!r}; needs tab, comma, semicolon, space, or one sign"
        raise BadInput(message, key="--delimiter")
    return delimiter


def _decimal(text: str) -> str:
    decimal = {"point": ".", "dot": ".", "comma": ","}.get(text.lower(), text)
    if decimal not in NUMBER:
        message = f"is {text[:20]!r}; needs point or comma"
        raise BadInput(message, key="--decimal")
    return decimal


def with_named_end(form: Form, above: list[str]) -> Form:
    """The form with its last, empty column where a line of the header names it."""
    if form.closed and any(
        len(cells) == form.cells + 1 and cells[-1] for cells in (split(x, form.delimiter) for x in above)
    ):
        return replace(form, cells=form.cells + 1, closed=False)
    return form
