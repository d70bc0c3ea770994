"""Which reader a file needs, by its first bytes."""

from __future__ import annotations

import hashlib
import sys
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

from design.errors import BadInput
from design.recordings import c3d, numpy_files, spreadsheet, text
from design.recordings import table as tables
from design.recordings.reading import Reading
from design.recordings.table import Table

SIGNATURES = (
    (b"MATLAB 7.3", "is a MATLAB v7.3 file, which is not read; in MATLAB: writetable(..., 'trial.csv')"),
    (b"\x89HDF", "is an HDF5 file (MATLAB v7.3 is one), which is not read; export the trial as CSV"),
    (b"MATLAB 5.0", "is a MATLAB file, which is not read; in MATLAB: writetable(..., 'trial.csv')"),
    (b"\xd0\xcf\x11\xe0", "is an old Excel or a Word file; save the sheet as .xlsx or CSV"),
    (b"%PDF", "is a PDF; export the trial as CSV"),
    (b"\x1f\x8b", "is compressed (gzip); unpack it first"),
)


def table_of(content: bytes, path: str, how: Reading) -> Table:
    """The table in the ``content`` of the file ``path``: text, .npy, .npz, .xlsx or .c3d; raises ``BadInput``."""
    if how.skip_rows is not None and how.skip_rows < 0:
        message = f"is {how.skip_rows}; needs the number of lines above the names, 0 or more"
        raise BadInput(message, key="--skip-rows")
    return replace(_table(content, path, how), sha256=hashlib.sha256(content).hexdigest())


def _table(content: bytes, path: str, how: Reading) -> Table:
    if not content:
        message = "is empty; needs a recording with one row a sample"
        raise BadInput(message, file=path)
    for mark, what in SIGNATURES:
        if content.startswith(mark):
            raise BadInput(what, file=path)
    if content.startswith(b"\x93NUMPY"):
        return numpy_files.npy(content, path)
    if content.startswith(b"PK"):
        return spreadsheet.xlsx(content, path, how) if b"xl/" in content else numpy_files.npz(content, path)
    if Path(path).suffix.lower() == ".c3d" or (content[1:2] == b"\x50" and b"\0" in content[:512]):
        return c3d.c3d(content, path)
    return text.text(content, path, how)


def read_bytes(path: str) -> bytes:
    """Content of a file, or ``BadInput`` that names the path and what is wrong with it."""
    place = Path(path)
    try:
        if path == "-":
            return _take(sys.stdin.buffer, "standard input")
        if place.is_dir():
            message = "is a directory; name a file in it"
            raise BadInput(message, file=path)
        with place.open("rb") as file:
            return _take(file, path)
    except FileNotFoundError:
        message = "no such file"
        raise BadInput(message, file=path) from None
    except (OSError, ValueError) as error:
        message = f"cannot be read: {getattr(error, 'strerror', None) or error}"
        raise BadInput(message, file=path) from None


def _take(file: BinaryIO, path: str) -> bytes:
    content = file.read(tables.MAX_BYTES + 1)
    if len(content) > tables.MAX_BYTES:
        message = f"has more than {tables.MAX_BYTES // 1_000_000} MB; cut it, or keep only the columns that are needed"
        raise BadInput(message, file=path)
    return content
