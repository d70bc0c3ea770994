"""The first sheet with numbers of an .xlsx file, read as the text that it would be as tab-separated values."""

from __future__ import annotations

import importlib.util
import io
import re
import zipfile
from collections import Counter
from dataclasses import replace
from typing import Any

from design.errors import BadInput
from design.recordings import text
from design.recordings.reading import Reading
from design.recordings.table import MAX_CELLS, Table, check_cells

INSTALL = "pip install 'poise[xlsx]'"
MAX_UNPACKED = 4 * MAX_CELLS
"""Bytes of a workbook's parts once they are unpacked."""


def xlsx(content: bytes, path: str, how: Reading) -> Table:
    """The table in the ``content`` of a workbook; raises ``BadInput``."""
    if importlib.util.find_spec("openpyxl") is None:
        message = f"needs the reader of .xlsx files; install it with: {INSTALL}; or save the sheet as CSV"
        raise BadInput(message, file=path)
    import openpyxl

    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            unpacked = sum(entry.file_size for entry in archive.infolist())
        if unpacked > MAX_UNPACKED:
            message = (
                f"unpacks to {unpacked // 1_000_000:,} MB, at most {MAX_UNPACKED // 1_000_000} MB are read; save as CSV"
            )
            raise BadInput(message, file=path)
        workbook = openpyxl.load_workbook(io.BytesIO(content), read_only=True, data_only=True)
        sheets = [(sheet.title, _lines(sheet, path)) for sheet in workbook.worksheets]
    except BadInput:
        raise
    except Exception as error:  # whatever the reader raises on a damaged file
        reason = " ".join((str(error) or type(error).__name__).split())[:80]
        message = f"is a damaged .xlsx file: {reason}; save it again, or as CSV"
        raise BadInput(message, file=path) from None
    sheets = [(title, lines) for title, lines in sheets if sum(bool(re.search(r"\d", line)) for line in lines) > 1]
    if not sheets:
        message = "has no sheet with rows of numbers; needs one row a sample"
        raise BadInput(message, file=path)
    title, lines = sheets[0]
    table = text.text("\n".join(lines).encode(), path, replace(how, delimiter="tab", decimal="point"))
    others = f", of {len(sheets)} sheets with numbers" if len(sheets) > 1 else ""
    return replace(table, detected=(f"sheet {title!r}{others}", *table.detected[1:]), place="row")


def _lines(sheet: Any, path: str) -> list[str]:
    """The rows of a sheet; those that end in empty cells are as long as most."""
    rows: list[list[str]] = []
    for row in sheet.iter_rows(values_only=True):
        cells = list(map(_text, row))
        while cells and not cells[-1]:
            cells.pop()
        rows.append(cells)
        check_cells(len(rows), max(len(cells), 1), path)
    usual = Counter(len(cells) for cells in rows if cells).most_common(1)
    width = usual[0][0] if usual else 0
    return ["\t".join(cells + [""] * (width - len(cells) if cells else 0)) for cells in rows]


def _text(cell: object) -> str:
    if cell is None or isinstance(cell, bool):
        return ""
    return repr(cell) if isinstance(cell, float) else re.sub(r"[\t\r\n\"]", " ", str(cell))
