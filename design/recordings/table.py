"""A file's numbers with their names, units and line numbers, before anybody says what they mean."""

from __future__ import annotations

import hashlib
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from design.errors import BadInput
from design.recordings.reading import Reading

Array = NDArray[np.float64]

MAX_BYTES = 400_000_000
"""The largest file that is read."""
MAX_CELLS = 100_000_000
"""The largest table that is held: 800 MB of numbers."""

SIGNATURES = (
    (b"MATLAB 7.3", "is a MATLAB v7.3 file, which is not read; in MATLAB: writetable(..., 'trial.csv')"),
    (b"\x89HDF", "is an HDF5 file (MATLAB v7.3 is one), which is not read; export the trial as CSV"),
    (b"MATLAB 5.0", "is a MATLAB file, which is not read; in MATLAB: writetable(..., 'trial.csv')"),
    (b"\xd0\xcf\x11\xe0", "is an Excel or Word file; save the sheet as CSV"),
    (b"%PDF", "is a PDF; export the trial as CSV"),
    (b"\x1f\x8b", "is compressed (gzip); unpack it first"),
)


@dataclass(frozen=True, kw_only=True)
class Fault:
    """The first cell of a column that is no number: its line, what stands there, and how many there are."""

    line: int
    text: str
    count: int


@dataclass(frozen=True, eq=False, kw_only=True)
class Table:
    """What a file holds.

    ``values`` (n, k), NaN where a cell cannot be read; ``names`` (k), unique; ``units`` (k), None where the file says
    none; ``lines`` (n): where each row stands in the file, counted from 1 (``place`` names what is counted);
    ``faults`` by column; ``rate`` [Hz] if the file states it; ``detected``: what was found out, in sentences.
    """

    origin: str
    names: tuple[str, ...]
    units: tuple[str | None, ...]
    values: Array
    lines: NDArray[np.int64]
    faults: dict[int, Fault]
    rate: float | None
    detected: tuple[str, ...]
    place: str = "line"
    sha256: str = ""


def read(path: str, how: Reading) -> Table:
    """The table in the file at ``path``: text, ``.npy``, ``.npz`` or ``.c3d``; raises ``BadInput``."""
    content = read_bytes(path)
    return replace(_table(content, path, how), sha256=hashlib.sha256(content).hexdigest())


def _table(content: bytes, path: str, how: Reading) -> Table:
    from design.recordings import numpy_files as binary
    from design.recordings import text

    if not content:
        message = "is empty; needs a recording with one row a sample"
        raise BadInput(message, file=path)
    for mark, said in SIGNATURES:
        if content.startswith(mark):
            raise BadInput(said, file=path)
    if content.startswith(b"\x93NUMPY"):
        return binary.npy(content, path)
    if content.startswith(b"PK"):
        return binary.npz(content, path)
    if Path(path).suffix.lower() == ".c3d" or (content[1:2] == b"\x50" and b"\0" in content[:512]):
        return binary.c3d(content, path)
    return text.read(content, path, how)


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
    parts, size = [], 0
    while part := file.read(1 << 24):
        size += len(part)
        if size > MAX_BYTES:
            message = f"has more than {MAX_BYTES // 1_000_000} MB; cut it, or keep only the columns that are needed"
            raise BadInput(message, file=path)
        parts.append(part)
    return b"".join(parts)


def check_cells(rows: int, columns: int, path: str) -> None:
    """Raise ``BadInput`` for a table that would fill the memory."""
    if rows * columns > MAX_CELLS:
        message = f"has {rows:,} rows of {columns:,} cells, at most {MAX_CELLS:,} cells are held; cut it"
        raise BadInput(message, file=path)


def unique(names: list[str]) -> list[str]:
    """``names`` with ``.2``, ``.3`` ... added to those that come again; nameless ones are numbered."""
    found: list[str] = []
    for index, name in enumerate(names, start=1):
        label, again = name or f"column {index}", 2
        while label in found:
            label, again = f"{name or f'column {index}'}.{again}", again + 1
        found.append(label)
    return found
