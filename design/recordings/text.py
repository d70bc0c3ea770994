"""A text file as a table: delimiter, decimal sign and header found where they leave no doubt, demanded elsewhere.

A row is never shifted: a row with another number of cells than the others is a fault, a header that names another
number of columns names none.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from design.errors import BadInput
from design.recordings.header import Header, understand
from design.recordings.reading import Reading
from design.recordings.table import Array, Fault, Table, check_cells, unique

NAMED = {"tab": "\t", "\\t": "\t", "comma": ",", "semicolon": ";", "space": " ", "spaces": " ", "whitespace": " "}
WORDS = {"\t": "tab", ",": "comma", ";": "semicolon", " ": "spaces", "|": "|", ":": ":"}
MISSING = {"", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "?", ".", "inf", "+inf", "-inf", "-nan"}
NUMBER = {
    ".": re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?"),
    ",": re.compile(r"[+-]?(\d+(,\d+)?|,\d+)([eEdD][+-]?\d+)?"),
}
CHUNK = 20_000


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


def read(content: bytes, path: str, how: Reading) -> Table:
    """The table in the text ``content`` of the file ``path``; raises ``BadInput``."""
    text, said = _decode(content, path)
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    skipped = _skipped(how.skip_rows, len(lines), path)
    filled = [index for index in range(skipped, len(lines)) if lines[index].strip(" \t,;")]
    if not filled:
        message = "has no rows" + (f" after the {skipped} skipped ones" if skipped else "")
        raise BadInput(message, file=path)
    form = _form([lines[index] for index in filled], how, path)
    start = _first_row(form, lines, filled, path)
    above = filled[:start]
    form = _with_named_end(form, [lines[index] for index in above[-3:]])
    header = understand(lines, above, form.split, form.cells)
    _check_commas(form, header, lines, filled[start:], how, path)
    if not any(form.is_number(cell) and ("." in cell or "," in cell) for cell in form.split(lines[filled[start]])):
        sign = ""
    else:
        sign = f", decimal {'point' if form.decimal == '.' else 'comma'}"
    names = unique([name for name, _ in header.columns]) if header.columns else []
    names = names or [f"column {index}" for index in range(1, form.cells + 1)]
    rows = np.array(filled[start:], dtype=np.int64)
    check_cells(len(rows), form.cells, path)
    said += _check_promise(header, len(rows), how, path)
    values, faults = _values(form, [lines[index] for index in rows], rows, names, how, path)
    detected = [*said, f"delimiter {WORDS.get(form.delimiter, repr(form.delimiter))}{sign}", *header.said]
    detected.append(f"data from line {rows[0] + 1} on, {form.cells} columns")
    return Table(
        origin=path, names=tuple(names), values=values, lines=rows + 1, faults=faults, rate=header.rate,
        units=tuple(unit for _, unit in header.columns) if header.columns else (None,) * form.cells,
        detected=tuple(detected),
    )  # fmt: skip


def _check_promise(header: Header, count: int, how: Reading, path: str) -> list[str]:
    """Raise ``BadInput`` for fewer rows than the header states; with ``allow_gaps`` it is a note."""
    if header.promised is None or count >= header.promised[1]:
        return []
    words, stated = header.promised
    if how.allow_gaps:
        return [f"truncated: {count:,} of the {stated:,} rows that the header states ({words})"]
    message = (
        f"is truncated: it has {count:,} rows, and its header states {stated:,} ({words}); copy or export it again, or"
        " read what there is with --allow-gaps"
    )
    raise BadInput(message, file=path)


def _decode(content: bytes, path: str) -> tuple[str, list[str]]:
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        encoding, said = "utf-16", ["UTF-16 text"]
    elif b"\0" in content[:65536]:
        message = "is not a text file, nor .npy, .npz or .c3d; export the trial as CSV"
        raise BadInput(message, file=path)
    else:
        encoding, said = "utf-8-sig", []
    try:
        return content.decode(encoding), said
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    odd = sum(not (c.isprintable() or c in "\t\r\n\f") for c in text[:65536])
    if encoding == "utf-16" or odd > 0.01 * min(len(text), 65536):
        message = "is not a text file, nor .npy, .npz or .c3d; export the trial as CSV"
        raise BadInput(message, file=path)
    return text, ["Latin-1 text"]


def _skipped(wish: int | None, count: int, path: str) -> int:
    if wish is not None and wish >= count:
        message = f"skips {wish} of {count} lines; nothing is left"
        raise BadInput(message, file=path, key="--skip-rows")
    return wish or 0


def _form(lines: list[str], how: Reading, path: str) -> Form:
    """Delimiter, decimal sign and number of cells, from the last quarter of the file."""
    tail = lines[-max(8, len(lines) // 4) :]
    tail = tail[:: max(1, len(tail) // 400)]
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
        options = " or ".join(f"--delimiter {WORDS.get(delimiter, delimiter)}" for delimiter in distinct)
        message = f"can be read with several delimiters; say which: {options}"
        raise BadInput(message, file=path)
    return next(iter(distinct.values()))


def _fit(tail: list[str], delimiter: str, decimal: str) -> tuple[float, Form]:
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


def _first_row(form: Form, lines: list[str], filled: list[int], path: str) -> int:
    """The place in ``filled`` of the first row; one that is faulty belongs to the rows below it."""
    whole = next((k for k, index in enumerate(filled) if form.is_row(lines[index])), None)
    if whole is None:
        whole = next((k for k, index in enumerate(filled) if form.is_rather_a_row(lines[index])), None)
    if whole is None:
        message = "has no row of numbers; say --delimiter, --decimal and --skip-rows"
        raise BadInput(message, file=path)
    while whole > 0 and _is_damaged(form, lines[filled[whole - 1]]):
        whole -= 1
    return whole


def _with_named_end(form: Form, above: list[str]) -> Form:
    """The form with its last, empty column where a line of the header names it."""
    if form.closed and any(
        len(cells) == form.cells + 1 and cells[-1] for cells in (split(x, form.delimiter) for x in above)
    ):
        return replace(form, cells=form.cells + 1, closed=False)
    return form


def _is_damaged(form: Form, line: str) -> bool:
    """Whether a line above the rows is one of them, with a cell too few, too many, or unreadable."""
    cells = form.split(line)
    numbers = form.numbers(cells)
    return numbers > 0 and (
        all(form.is_number(cell) or cell.lower() in MISSING for cell in cells if cell)
        or (form.cells > 2 and len(cells) > 2 and 2 * numbers >= len(cells))
    )


def _check_commas(form: Form, header: Header, lines: list[str], rows: list[int], how: Reading, path: str) -> None:
    """Raise ``BadInput`` where a comma may be the delimiter, the decimal sign, or both."""
    if form.delimiter != "," or how.delimiter or header.columns:
        return
    sample = [lines[index] for index in rows[:200]]
    if all("." not in line for line in sample):
        message = (
            "has rows of commas alone: is the comma the delimiter or the decimal sign? Say --delimiter and --decimal"
        )
        raise BadInput(message, file=path, key=f"line {rows[0] + 1}")


def _values(
    form: Form, rows: list[str], places: NDArray[np.int64], names: list[str], how: Reading, path: str
) -> tuple[Array, dict[int, Fault]]:
    """The numbers (n, k), NaN where there is none, and the faults by column; ragged rows as ``how`` allows."""
    values = np.full((len(rows), form.cells), np.nan)
    faults: dict[int, Fault] = {}
    ragged: list[tuple[int, int]] = []
    for first in range(0, len(rows), CHUNK):
        part = rows[first : first + CHUNK]
        quick = _quick(form, part)
        if quick is not None:
            values[first : first + len(part)] = quick
            continue
        for k, line in enumerate(part, start=first):
            cells = form.split(line)
            if len(cells) != form.cells:
                ragged.append((k, len(cells)))
                continue
            for column, cell in enumerate(cells):
                if form.is_number(cell):
                    plain = cell.replace(",", ".") if form.decimal == "," else cell
                    values[k, column] = float(plain.replace("D", "e").replace("d", "e"))
    if ragged:
        _ragged(ragged, rows, places, form, how, path)
    bad = ~np.isfinite(values)
    bad[[k for k, _ in ragged]] = False
    for column in np.flatnonzero(bad.any(axis=0)).tolist():
        k = int(np.argmax(bad[:, column]))
        text = form.split(rows[k])[column]
        faults[column] = Fault(line=int(places[k]) + 1, text=text, count=int(bad[:, column].sum()))
    values[bad] = np.nan
    return values, faults


def _quick(form: Form, rows: list[str]) -> Array | None:
    """The numbers of ``rows`` if all of them are clean, else None."""
    if form.decimal == ",":
        if form.delimiter == ",":
            return None
        if any("." in line for line in rows):
            return None
        rows = [line.replace(",", ".") for line in rows]
    if any('"' in line for line in rows):
        return None
    if form.closed:
        rows = [line.rstrip().removesuffix(form.delimiter) for line in rows]
    try:
        found = np.loadtxt(
            rows, delimiter=None if form.delimiter == " " else form.delimiter, comments=None, ndmin=2, dtype=np.float64
        )
    except ValueError:
        return None
    return found if found.shape == (len(rows), form.cells) and np.isfinite(found).all() else None


def _ragged(
    ragged: list[tuple[int, int]], rows: list[str], places: NDArray[np.int64], form: Form, how: Reading, path: str
) -> None:
    k, count = ragged[0]
    key = f"line {places[k] + 1}"
    if how.allow_gaps and len(ragged) <= 0.5 * len(rows):
        return
    more = f" (and {len(ragged) - 1} more such lines)" if len(ragged) > 1 else ""
    if not any(map(form.is_number, form.split(rows[k]))):
        message = f"is text, {rows[k].strip()[:40]!r}, below the rows of numbers{more}; keep one table in the file"
        raise BadInput(message, file=path, key=key)
    cells = f"{count} cell{'s' * (count != 1)}"
    message = f"has {cells} where the other rows have {form.cells}{more}; mend it, or mask such rows with --allow-gaps"
    raise BadInput(message, file=path, key=key)
