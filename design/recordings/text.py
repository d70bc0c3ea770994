"""A text file as a table: delimiter, decimal sign and header found where they leave no doubt, demanded elsewhere.

A row is never shifted: a row with another number of cells than the others is a fault, a header that names another
number of columns names none. Lines are decoded as they are needed, so that a long file is held once.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.errors import BadInput
from design.recordings.form import MISSING, WORDS, Form, form_of, split, with_named_end
from design.recordings.header import Header, understand
from design.recordings.reading import Reading
from design.recordings.remedies import Misfit, Remedy
from design.recordings.table import Array, Table, check_cells, readable, unasked, unique

CHUNK = 20_000
SECTIONS = ("Devices", "Joints", "Model Outputs", "Segments", "Trajectories")
"""The titles of the tables in a file by Vicon Nexus."""
LONGEST = 1_000_000
"""Characters of the longest line that is split into cells."""

ALLOW_GAPS = (Remedy(options={"--allow-gaps": "yes"}, when=", which masks such rows"),)


@dataclass(frozen=True, eq=False, kw_only=True)
class Lines(Sequence[str]):
    """The lines of a text in UTF-8: ``content`` from ``starts`` (n,) to ``ends`` (n,)."""

    content: bytes
    starts: NDArray[np.int32]
    ends: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.starts)

    def __getitem__(self, index: Any) -> Any:
        """The text of one line."""
        return self.content[self.starts[index] : self.ends[index]].decode("utf-8", "replace")

    def filled(self, skipped: int) -> NDArray[np.int32]:
        """Which lines after the ``skipped`` ones hold more than delimiters."""
        empty = np.zeros(256, dtype=bool)
        empty[list(b" \t,;\n")] = True
        parts = []
        for first in range(skipped, len(self), CHUNK):
            last = min(first + CHUNK, len(self))
            begin = int(self.starts[first])
            part = np.frombuffer(self.content[begin : int(self.ends[last - 1]) + 1] + b"\n", dtype=np.uint8)
            holds = np.logical_or.reduceat(~empty[part], self.starts[first:last] - begin)
            parts.append((first + np.flatnonzero(holds)).astype(np.int32))
        return np.concatenate(parts) if parts else np.zeros(0, dtype=np.int32)


def lines_of(content: bytes) -> Lines:
    """The lines of UTF-8 ``content``; a carriage return ends one too."""
    if b"\r" in content:
        content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    step = 1 << 22
    breaks = []
    for first in range(0, len(content), step):
        part = np.frombuffer(content, dtype=np.uint8, count=min(step, len(content) - first), offset=first)
        breaks.append((first + np.flatnonzero(part == 10)).astype(np.int32))
    ends = np.concatenate([*breaks, np.array([len(content)], dtype=np.int32)])
    return Lines(content=content, starts=np.concatenate([np.zeros(1, dtype=np.int32), ends[:-1] + 1]), ends=ends)


def text(content: bytes, path: str, how: Reading) -> Table:
    """The table in the text ``content`` of the file ``path``; raises ``BadInput``."""
    utf8, encoding = _utf8(content, path)
    lines = lines_of(utf8)
    longest = int(np.argmax(lines.ends - lines.starts))
    if lines.ends[longest] - lines.starts[longest] > LONGEST:
        message = (
            f"has {int(lines.ends[longest] - lines.starts[longest]):,} characters, at most {LONGEST:,} are split into"
            " cells; needs one row a line"
        )
        raise BadInput(message, file=path, key=f"line {longest + 1}")
    try:
        return _table(lines, encoding, path, how)
    except csv.Error as error:
        message = f"has a cell in quotes that cannot be read ({error}); needs quotes that are closed in their line"
        raise BadInput(message, file=path) from None


def _table(lines: Lines, encoding: list[str], path: str, how: Reading) -> Table:
    skipped = _skipped(how.skip_rows, len(lines), path)
    filled, sections = _of_devices(lines, lines.filled(skipped))
    if not len(filled):
        message = "has no rows" + (f" after the {skipped} skipped ones" if skipped else "")
        raise BadInput(message, file=path)
    tail = filled[-max(8, len(filled) // 4) :]
    form = form_of([lines[index] for index in tail[:: max(1, len(tail) // 400)]], how, path)
    start = _first_row(form, lines, filled, path)
    above, rows = filled[:start].tolist(), filled[start:]
    form = with_named_end(form, [lines[index] for index in above[-3:]])
    header = understand(lines, above, form.split, form.cells)
    _check_commas(form, header, lines, rows, how, path)
    sign = ""
    if any(form.is_number(cell) and ("." in cell or "," in cell) for cell in form.split(lines[rows[0]])):
        sign = f", decimal {'point' if form.decimal == '.' else 'comma'}"
    names = unique([name for name, _ in header.columns]) if header.columns else []
    names = names or [f"column {index}" for index in range(1, form.cells + 1)]
    check_cells(len(rows), form.cells, path)
    cut = _check_promise(header, len(rows), how, path)
    detected = [*encoding, *sections, *cut, f"delimiter {WORDS.get(form.delimiter, repr(form.delimiter))}{sign}"]
    detected += header.said
    detected.append(f"data from line {rows[0] + 1} on, {form.cells} columns")

    values = _values(form, lines, rows, how, path)

    def cell(row: int, column: int) -> str:
        cells = form.split(lines[rows[row]])
        return cells[column] if column < len(cells) else ""

    return Table(
        origin=path, names=tuple(names), values=values, lines=rows + 1,
        cell=cell if np.isnan(values).any() else unasked,  # which lets go of the text
        rate=header.rate, detected=tuple(detected),
        units=tuple(unit for _, unit in header.columns) if header.columns else (None,) * form.cells,
    )  # fmt: skip


def _of_devices(lines: Lines, filled: NDArray[np.int32]) -> tuple[NDArray[np.int32], list[str]]:
    """Of the ``filled`` lines those of the section of devices, where a file by Vicon Nexus has several; and a note."""
    titles: dict[int, str] = {}
    for title in SECTIONS:
        place = lines.content.find(title.encode())
        while place >= 0:
            index = int(np.searchsorted(lines.starts, place, side="right")) - 1
            if lines[index].strip(' ,;\t"').lower() == title.lower():
                titles[index] = title
            place = lines.content.find(title.encode(), int(lines.ends[index]))
    first = next((index for index in sorted(titles) if titles[index] == SECTIONS[0]), None)
    if first is None or len(titles) == 1:
        return filled, []
    last = min((index for index in titles if index > first), default=len(lines))
    others = ", ".join(titles[index] for index in sorted(titles) if index != first)
    return filled[(filled >= first) & (filled < last)], [f"section {SECTIONS[0]}, without {others}"]


def _check_promise(header: Header, count: int, how: Reading, path: str) -> list[str]:
    """Raise ``BadInput`` for fewer rows than the header states; with ``allow_gaps`` it is a note."""
    if header.promised is None or count >= header.promised[1]:
        return []
    words, stated = header.promised
    if how.allow_gaps:
        return [f"truncated: {count:,} of the {stated:,} rows that the header states ({words})"]
    message = (
        f"is truncated: it has {count:,} rows, and its header states {stated:,} ({words}); copy or export it again"
    )
    remedy = Remedy(options={"--allow-gaps": "yes"}, when=" to read what there is")
    raise Misfit(message, file=path, remedies=[remedy])


def _utf8(content: bytes, path: str) -> tuple[bytes, list[str]]:
    """The text in UTF-8 without a mark at its beginning, and what it was in, if that is remarkable."""
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        encoding, remark = "utf-16", ["UTF-16 text"]
    elif b"\0" in content[:65536]:
        message = "is not a text file, nor .npy, .npz, .xlsx or .c3d; export the trial as CSV"
        raise BadInput(message, file=path)
    else:
        encoding, remark = "utf-8-sig", []
    if content.isascii():
        return content, remark
    try:
        return content.decode(encoding).encode(), remark
    except UnicodeError:
        latin = content.decode("latin-1")
    odd = sum(not (c.isprintable() or c in "\t\r\n\f") for c in latin[:65536])
    if encoding == "utf-16" or odd > 0.01 * min(len(latin), 65536):
        message = "is not a text file, nor .npy, .npz, .xlsx or .c3d; export the trial as CSV"
        raise BadInput(message, file=path)
    return latin.encode(), ["Latin-1 text"]


def _skipped(count: int | None, lines: int, path: str) -> int:
    if count is not None and count >= lines:
        message = f"skips {count} of {lines} lines; nothing is left"
        raise BadInput(message, file=path, key="--skip-rows")
    return count or 0


def _first_row(form: Form, lines: Lines, filled: NDArray[np.int32], path: str) -> int:
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


def _is_damaged(form: Form, line: str) -> bool:
    """Whether a line above the rows is one of them, with a cell too few, too many, or unreadable."""
    cells = form.split(line)
    numbers = form.numbers(cells)
    return numbers > 0 and (
        all(form.is_number(cell) or cell.lower() in MISSING for cell in cells if cell)
        or (form.cells > 2 and len(cells) > 2 and 2 * numbers >= len(cells))
    )


def _check_commas(form: Form, header: Header, lines: Lines, rows: NDArray[np.int32], how: Reading, path: str) -> None:
    """Raise ``BadInput`` where a comma may be the delimiter, the decimal sign, or both."""
    if form.delimiter != "," or how.delimiter or header.columns:
        return
    if all("." not in lines[index] for index in rows[:200]):
        message = (
            "has rows of commas alone: is the comma the delimiter or the decimal sign? Say --delimiter and --decimal"
        )
        raise BadInput(message, file=path, key=f"line {rows[0] + 1}")


def _values(form: Form, lines: Lines, rows: NDArray[np.int32], how: Reading, path: str) -> Array:
    """The numbers (n, k), NaN where there is none; ragged rows as ``how`` allows."""
    values = np.full((len(rows), form.cells), np.nan)
    ragged: list[tuple[int, int]] = []
    for first in range(0, len(rows), CHUNK):
        part = [lines[index] for index in rows[first : first + CHUNK]]
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
        _check_ragged(ragged, lines, rows, form, how, path)
    return readable(values)


def _quick(form: Form, rows: list[str]) -> Array | None:
    """The numbers of ``rows`` if a number stands in every cell, else None."""
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
    return found if found.shape == (len(rows), form.cells) else None


def _check_ragged(
    ragged: list[tuple[int, int]], lines: Lines, rows: NDArray[np.int32], form: Form, how: Reading, path: str
) -> None:
    """Raise ``BadInput`` for rows with another number of cells, unless they may be masked and are few."""
    k, count = ragged[0]
    key, line = f"line {rows[k] + 1}", lines[rows[k]]
    if how.allow_gaps and len(ragged) <= 0.5 * len(rows):
        return
    more = f" (and {len(ragged) - 1} more such lines)" if len(ragged) > 1 else ""
    if not any(map(form.is_number, split(line, form.delimiter))):
        message = f"is text, {line.strip()[:40]!r}, below the rows of numbers{more}; keep one table in the file"
        raise BadInput(message, file=path, key=key)
    cells = f"{count} cell{'s' * (count != 1)}"
    message = f"has {cells} where the other rows have {form.cells}{more}; mend it"
    raise Misfit(message, file=path, key=key, remedies=ALLOW_GAPS)
