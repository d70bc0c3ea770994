"""NumPy and C3D files as tables. Objects in a NumPy file are never unpickled."""

from __future__ import annotations

import io
import struct
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from design.errors import BadInput
from design.recordings.table import MAX_BYTES, MAX_CELLS, Array, Fault, Table, check_cells, unique
from design.recordings.units import factor, split, unit_of

INSTALL = "pip install 'poise[c3d]'"
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
        what = "a spreadsheet" if any(entry.filename.startswith("xl/") for entry in inside) else "an archive"
        message = f"is {what}, not a .npz file; save the trial as CSV"
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
    values: Array = np.array(matrix, dtype=np.float64)
    bad = ~np.isfinite(values)
    faults = {
        column: Fault(line=int(np.argmax(bad[:, column])) + 1, text="nan", count=int(bad[:, column].sum()))
        for column in np.flatnonzero(bad.any(axis=0)).tolist()
    }
    values[bad] = np.nan
    return Table(
        origin=path, names=tuple(unique([name for name, _ in split_names])), units=tuple(u for _, u in split_names),
        values=values, lines=np.arange(1, len(values) + 1, dtype=np.int64), faults=faults, rate=rate,
        detected=(what, f"{count} columns", *([f"rate {rate:g} Hz in the file"] if rate else [])), place="row",
    )  # fmt: skip


def c3d(content: bytes, path: str) -> Table:
    """The force plates of a C3D file, each with force, moment and centre of pressure in the laboratory's frame."""
    _check_c3d(content, path)
    try:
        import ezc3d
    except ImportError:
        message = f"needs the reader of C3D files; install it with: {INSTALL}"
        raise BadInput(message, file=path) from None
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "trial.c3d"
        place.write_bytes(content)
        try:
            bare = ezc3d.c3d(str(place))
            used = bare["parameters"].get("FORCE_PLATFORM", {}).get("USED", {}).get("value", [0])
            count = int(np.asarray(used).ravel()[0]) if np.size(used) else 0
            whole = ezc3d.c3d(str(place), extract_forceplat_data=True) if count > 0 else None
        except BadInput:
            raise
        except Exception as error:  # whatever the reader raises on a damaged file
            said = " ".join(str(error).split())[:100]
            message = f"cannot be read as C3D: {said}; export it again"
            raise BadInput(message, file=path) from None
    if whole is None:
        message = "has no force plates (FORCE_PLATFORM:USED is 0); needs one; export markers as CSV"
        raise BadInput(message, file=path)
    parameters = whole["parameters"]
    units = [_c3d_units(parameters, plate) for plate in range(len(whole["data"]["platform"]))]
    return _of_plates(whole["data"]["platform"], units, float(whole["header"]["analogs"]["frame_rate"]), path)


def _c3d_units(parameters: Any, plate: int) -> tuple[str | None, str | None, str | None]:
    """Units of a plate's force, moment and position, as its analog channels and the points state them."""

    def values(group: str, name: str) -> list[Any]:
        return np.asarray(parameters.get(group, {}).get(name, {}).get("value", [])).ravel(order="F").tolist()

    analog, points = values("ANALOG", "UNITS"), values("POINT", "UNITS")
    channels = np.asarray(parameters.get("FORCE_PLATFORM", {}).get("CHANNEL", {}).get("value", []))
    own = channels[:, plate].astype(int).tolist() if channels.ndim == 2 and plate < channels.shape[1] else []
    stated = [unit_of(str(analog[k - 1])) if 0 < k <= len(analog) else None for k in own]
    force = next((unit for unit in stated if unit and factor(unit, "force")), None)
    moment = next((unit for unit in stated if unit and factor(unit, "moment")), None)
    return force, moment, unit_of(str(points[0])) if points else None


def _of_plates(
    plates: list[Any], stated: list[tuple[str | None, str | None, str | None]], rate: float, path: str
) -> Table:
    names: list[str] = []
    units: list[str | None] = []
    columns: list[Array] = []
    kinds = (("F", "force"), ("M", "moment"), ("COP", "center_of_pressure"))
    for number, (plate, its) in enumerate(zip(plates, stated, strict=True), start=1):
        tag = str(number) if len(plates) > 1 else ""
        for (prefix, key), unit in zip(kinds, its, strict=True):
            for axis, array in zip("xyz", np.asarray(plate[key], dtype=np.float64), strict=True):
                names.append(f"{prefix}{axis}{tag}")
                units.append(unit)
                columns.append(array)
    if not columns or not len(columns[0]):
        message = "has force plates but no samples of them; export it again with its analog channels"
        raise BadInput(message, file=path)
    values = np.column_stack(columns)
    values[~np.isfinite(values)] = 0.0  # the centre of pressure of an empty plate: masked as a drop-out further on
    check_cells(len(values), values.shape[1], path)
    return Table(
        origin=path, names=tuple(names), units=tuple(units), values=values,
        lines=np.arange(1, len(values) + 1, dtype=np.int64), faults={}, rate=rate or None,
        detected=(f"C3D file with {len(plates)} force plate{'s' * (len(plates) > 1)}", f"analog rate {rate:g} Hz"),
        place="sample",
    )  # fmt: skip


def _check_c3d(content: bytes, path: str) -> None:
    """Raise ``BadInput`` for a file that is no C3D, or shorter than its header says."""
    if len(content) < 1024 or content[1] != 0x50:
        message = "is no C3D file, or only the beginning of one; export it again"
        raise BadInput(message, file=path)
    parameters = 512 * (content[0] - 1)
    order = ">" if len(content) > parameters + 3 and content[parameters + 3] == 86 else "<"
    points, analogs, first, last = struct.unpack(f"{order}4H", content[2:10])
    start = struct.unpack(f"{order}H", content[16:18])[0]
    floating = content[12:16] != b"\0\0\0\0" and struct.unpack(f"{order}f", content[12:16])[0] < 0
    frames = max(last - first + 1, 0)
    needed = 512 * (start - 1) + frames * (4 * points + analogs) * (4 if floating else 2)
    if len(content) < min(needed, MAX_BYTES) or len(content) < parameters + 4:
        message = f"is cut off: its header promises {frames} frames, {needed:,} bytes, and it has {len(content):,}"
        raise BadInput(message, file=path)
