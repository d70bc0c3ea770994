"""NumPy files as tables. Objects in them are never unpickled."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from typing import Any

import numpy as np

from design.errors import BadInput
from design.recordings.table import MAX_CELLS, Array, Table, check_cells, readable, unique
from design.recordings.units import split

_RATES = {"rate", "rate_hz", "fs", "frequency", "sampling_rate", "sample_rate"}
_NAMES = {"names", "columns", "labels", "channels"}


def npy(content: bytes, path: str) -> Table:
    """The table in a ``.npy`` file: two-dimensional, or with named fields."""
    found = _load(content, path)
    assert isinstance(found, np.ndarray)
    if found.dtype.names:
        return _of_columns({name: found[name] for name in found.dtype.names}, path, "NumPy file with named fields")
    return _of_matrix(found, None, path, "NumPy file")


def npz(content: bytes, path: str) -> Table:
    """The table in a ``.npz`` file: arrays of one length by name, or a matrix and its ``names``."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            inside = archive.infolist()
    except (zipfile.BadZipFile, ValueError, OSError):
        message = "is a damaged .npz file (its list of contents cannot be read); copy it again"
        raise BadInput(message, file=path) from None
    if not inside or not all(entry.filename.endswith(".npy") for entry in inside):
        message = "is an archive, not a .npz file; save the trial as CSV"
        raise BadInput(message, file=path)
    if sum(entry.file_size for entry in inside) > 8 * MAX_CELLS:
        message = f"holds more than {8 * MAX_CELLS // 1_000_000} MB; cut it"
        raise BadInput(message, file=path)
    found = _load(content, path)
    assert not isinstance(found, np.ndarray)
    arrays = {name: np.asarray(array) for name, array in found.items()}
    rate = next(
        (float(a) for n, a in arrays.items() if n.lower() in _RATES and a.size == 1 and a.dtype.kind in "if"), None
    )
    names = next((a for n, a in arrays.items() if n.lower() in _NAMES and a.dtype.kind in "US"), None)
    matrices = [array for array in arrays.values() if array.ndim == 2 and array.dtype.kind in "fiu" and len(array) > 1]
    if names is not None and len(matrices) == 1:
        return _of_matrix(matrices[0], [str(name) for name in names.ravel()], path, ".npz file", rate)
    columns = {
        n: a.ravel() for n, a in arrays.items() if a.dtype.kind in "fiu" and a.size > 1 and max(a.shape) == a.size
    }
    if not columns and len(matrices) == 1:
        return _of_matrix(matrices[0], None, path, ".npz file", rate)
    for name, array in arrays.items():  # vectors (n, 2) or (n, 3) beside columns: along x, y and z
        if array.dtype.kind in "fiu" and array.ndim == 2 and 2 <= array.shape[1] <= 3 < len(array):
            columns |= {f"{name}_{axis}": array[:, k] for k, axis in enumerate("xyz"[: array.shape[1]])}
    return _of_columns(columns, path, ".npz file", rate)


def _load(content: bytes, path: str) -> np.ndarray[Any, Any] | dict[str, np.ndarray[Any, Any]]:
    try:
        found = np.load(io.BytesIO(content), allow_pickle=False)
        if isinstance(found, np.ndarray):
            return found
        with found:
            return {name: found[name] for name in found.files}
    except (ValueError, OSError, EOFError, KeyError, zipfile.BadZipFile, MemoryError, SyntaxError) as error:
        if "allow_pickle" in str(error) or "Object arrays" in str(error):
            message = "holds Python objects, which are not read (they can run code); save plain arrays of numbers"
        else:
            message = f"is a damaged NumPy file: {str(error)[:80]}; save it again"
        raise BadInput(message, file=path) from None
    except Exception as error:  # the decompressor has errors of its own
        message = f"is a damaged NumPy file: {str(error)[:80]}; save it again"
        raise BadInput(message, file=path) from None


def _of_columns(columns: Mapping[str, np.ndarray[Any, Any]], path: str, what: str, rate: float | None = None) -> Table:
    lengths = {len(array) for array in columns.values()}
    if len(lengths) != 1 or not all(array.ndim == 1 and array.dtype.kind in "fiu" for array in columns.values()):
        shapes = ", ".join(f"{name} {array.shape}" for name, array in columns.items())[:120]
        message = f"needs arrays of numbers of one length, one a column; holds {shapes or 'none'}"
        raise BadInput(message, file=path)
    return _of_matrix(np.column_stack(list(columns.values())), list(columns), path, what, rate)


def _of_matrix(
    matrix: np.ndarray[Any, Any], names: list[str] | None, path: str, what: str, rate: float | None = None
) -> Table:
    if matrix.ndim != 2 or matrix.dtype.kind not in "fiu" or 0 in matrix.shape:
        message = f"needs a matrix of numbers, one row a sample; holds {matrix.dtype} of shape {matrix.shape}"
        raise BadInput(message, file=path)
    count = matrix.shape[1]
    check_cells(len(matrix), count, path)
    if names is not None and len(names) != count:
        message = f"names {len(names)} columns and has {count}"
        raise BadInput(message, file=path)
    split_names = [split(name) for name in names or [""] * count]
    with np.errstate(over="ignore"):
        values: Array = readable(np.array(matrix, dtype=np.float64))
    return Table(
        origin=path, names=tuple(unique([name for name, _ in split_names])), units=tuple(u for _, u in split_names),
        values=values, lines=np.arange(1, len(values) + 1, dtype=np.int64), rate=rate,
        cell=lambda row, column: f"{matrix[row, column]:g}",
        detected=(what, f"{count} columns", *([f"rate {rate:g} Hz in the file"] if rate else [])), place="row",
    )  # fmt: skip
