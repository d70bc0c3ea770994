"""The force plates of a C3D file as a table, read in a process of its own."""

from __future__ import annotations

import importlib.util
import math
import os
import struct
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from design.errors import BadInput
from design.recordings import c3d_reader
from design.recordings.c3d_byte_order import to_intel
from design.recordings.table import MAX_BYTES, Array, Table, check_cells, readable
from design.recordings.units import FACTORS, factor, unit_of

INSTALL = "pip install 'poise[c3d]'"
SECONDS, PACE = 10.0, 5e6
"""How long the reader may take [s], besides a second for so many bytes."""
MEMORY, TIMES, MOST_MEMORY = 800_000_000, 80, 4_000_000_000
"""Address space of the reader [bytes], besides so many times the file's size, and the most."""
INTEL, DEC, SGI = 84, 85, 86
EDGES = (0.2, 2.0)
"""Lengths of a force plate's edge [m], by which a file that states no unit of position is read."""


def c3d(content: bytes, path: str) -> Table:
    """The force plates in the ``content`` of a C3D file, each with force, moment and CoP in the laboratory's frame."""
    _check_header(content, path)
    if importlib.util.find_spec("ezc3d") is None:
        message = f"needs the reader of C3D files; install it with: {INSTALL}"
        raise BadInput(message, file=path)
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "trial.c3d", Path(folder) / "trial.npz"
        source.write_bytes(_in_intel_order(content, path))
        _run(source, target, len(content), path)
        with np.load(target, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
    return _table(arrays, path)


def _in_intel_order(content: bytes, path: str) -> bytes:
    if content[512 * (content[0] - 1) + 3] != SGI:
        return content
    try:
        return to_intel(content)
    except (ValueError, IndexError, struct.error) as error:
        message = f"cannot be read as C3D of an SGI processor: {error}; export it again"
        raise BadInput(message, file=path) from None


def _run(source: Path, target: Path, size: int, path: str) -> None:
    """Run the reader; raises ``BadInput`` for whatever it ends with but a file of arrays."""
    seconds = SECONDS + size / PACE
    memory = min(MEMORY + TIMES * size, MOST_MEMORY)
    limits = (str(memory), str(math.ceil(seconds)))
    command = [sys.executable, "-P", c3d_reader.__file__, str(source), str(target), *limits]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    try:
        ended = subprocess.run(command, capture_output=True, timeout=2 * seconds, env=environment, check=False)
    except subprocess.TimeoutExpired:
        message = f"cannot be read as C3D within {2 * seconds:.2g} s; export it again"
        raise BadInput(message, file=path) from None
    if ended.returncode == 0 and target.exists():
        return
    if ended.returncode == c3d_reader.NO_PLATES:
        message = "has no force plates (FORCE_PLATFORM:USED is 0); needs one; export markers as CSV"
        raise BadInput(message, file=path)
    reason = ended.stderr.decode("utf-8", "replace").strip()[-100:]
    if "bad_alloc" in reason or "MemoryError" in reason:
        reason = f"it would take more than {memory // 1_000_000:,} MB of memory"
    elif ended.returncode != c3d_reader.UNREADABLE or not reason:
        reason = "its parameters contradict each other or its data, so that the reader fails"
    message = f"cannot be read as C3D: {reason}; export it again"
    raise BadInput(message, file=path)


def _table(arrays: dict[str, Any], path: str) -> Table:
    count, samples = arrays["force"].shape[0], arrays["force"].shape[-1]
    if not count or not samples:
        message = "has force plates but no samples of them; export it again with its analog channels"
        raise BadInput(message, file=path)
    check_cells(samples, 9 * count, path)
    position, origin = _position_unit(arrays, path)
    names: list[str] = []
    units: list[str | None] = []
    columns: list[Array] = []
    for plate in range(count):
        force, moment = _channel_units(arrays, plate)
        moment = moment or (f"N {position}" if position else None)  # as the C3D user guide has it
        about_centre = _moment(arrays, plate, moment, position)
        cop = _cop(arrays, plate, about_centre, force, moment, position)
        quantities = (("F", arrays["force"][plate], force), ("M", about_centre, moment), ("COP", cop, position))
        for prefix, components, unit in quantities:
            for axis, values in zip("xyz", components, strict=True):
                names.append(f"{prefix}{axis}{plate + 1 if count > 1 else ''}")
                units.append(unit)
                columns.append(values)
    raw = np.column_stack(columns)
    rate = float(arrays["header_rate"])
    if not (np.isfinite(rate) and rate > 0) and arrays["analog_rate"].size:
        rate = float(arrays["analog_rate"][0])
    known = np.isfinite(rate) and rate > 0
    return Table(
        origin=path, names=tuple(names), units=tuple(units), values=readable(raw.copy()),
        lines=np.arange(1, samples + 1, dtype=np.int64), cell=lambda row, column: f"{raw[row, column]:g}",
        rate=rate if known else None, place="sample", one_frame=True,
        detected=(
            f"C3D file with {count} force plate{'s' * (count > 1)}", *origin,
            *([f"analog rate {rate:g} Hz"] if known else []),
        ),
    )  # fmt: skip


def _axes(corners: Array) -> Array:
    """The plate's axes in the laboratory's frame, one a column, from its ``corners`` (3, 4)."""
    x, y = corners[:, 0] - corners[:, 1], corners[:, 0] - corners[:, 3]
    with np.errstate(all="ignore"):
        x, y = x / np.linalg.norm(x), y / np.linalg.norm(y)
    return np.column_stack([x, y, np.cross(x, y)])


def _moment(arrays: dict[str, Any], plate: int, unit: str | None, position: str | None) -> Array:
    """Moment (3, n) about the centre of the plate's surface.

    The reader moves it there by F x origin in the unit of positions; where the moment is in another, this is mended.
    """
    moment: Array = arrays["moment"][plate]
    if unit is None or position is None or FACTORS["moment"][unit] == FACTORS["position"][position]:
        return moment
    ratio = FACTORS["position"][position] / FACTORS["moment"][unit]
    origin = _axes(arrays["corners"][plate]) @ arrays["origin"][plate]
    return moment - (1 - ratio) * np.cross(arrays["force"][plate], origin[:, None], axis=0)


def _cop(
    arrays: dict[str, Any], plate: int, moment: Array, force: str | None, unit: str | None, position: str | None
) -> Array:
    """CoP (3, n) in the laboratory's frame: centre of the corners + n x M / (n . F), n the plate's normal.

    M = p x F + T n about the centre of the surface, so that n x M = p (n . F).
    """
    corners: Array = arrays["corners"][plate]
    normal = _axes(corners)[:, 2]
    metres = FACTORS["position"][position or "m"]
    with np.errstate(all="ignore"):
        lever = FACTORS["moment"][unit or "N m"] * np.cross(normal, moment, axis=0)
        lever /= FACTORS["force"][force or "N"] * (normal @ arrays["force"][plate])
    return np.asarray(corners.mean(axis=1)[:, None] + lever / metres)


def _channel_units(arrays: dict[str, Any], plate: int) -> tuple[str | None, str | None]:
    """Units of a plate's force and moment, as its analog channels state them."""
    analog, channels = arrays["analog_units"], arrays["channels"]
    own = channels[:, plate].tolist() if channels.ndim == 2 and plate < channels.shape[1] else []
    stated = [unit_of(str(analog[k - 1])) if 0 < k <= len(analog) else None for k in own]
    force = next((unit for unit in stated if unit and factor(unit, "force")), None)
    return force, next((unit for unit in stated if unit and factor(unit, "moment")), None)


def _position_unit(arrays: dict[str, Any], path: str) -> tuple[str | None, list[str]]:
    """The unit of positions: as POINT:UNITS states it, else the one in which the corners are those of a plate."""
    points = arrays["point_units"]
    stated = unit_of(str(points[0])) if len(points) else None
    corners = arrays["corners"]  # (plates, 3, 4)
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=2), axis=1).ravel()
    fitting = [
        unit for unit, scale in FACTORS["position"].items()
        if len(edges) and (scale * edges >= EDGES[0]).all() and (scale * edges <= EDGES[1]).all()
    ]  # fmt: skip
    if stated is not None and factor(stated, "position"):
        if fitting and stated not in fitting:
            least, most = FACTORS["position"][stated] * edges.min(), FACTORS["position"][stated] * edges.max()
            message = (
                f"states positions in {stated} (POINT:UNITS), in which a plate's edges are {least:.4g} to {most:.4g} m;"
                f" they fit in {fitting[0]}: correct POINT:UNITS, or export it again"
            )
            raise BadInput(message, file=path)
        return stated, []
    if len(fitting) == 1:
        return fitting[0], [f"positions in {fitting[0]}, by the plate's corners ({edges.max():.4g} {fitting[0]} apart)"]
    return None, []


def _decoded(content: bytes, processor: int, start: int, form: str) -> tuple[Any, ...]:
    """Numbers of the header in the byte order of the ``processor`` that wrote them."""
    size = struct.calcsize(f"<{form}")
    part = content[start : start + size]
    if form == "f" and processor == DEC:  # words swapped, and the exponent counts from 129
        return (struct.unpack("<f", part[2:] + part[:2])[0] / 4.0,)
    return struct.unpack(f"{'>' if processor == SGI else '<'}{form}", part)


def _check_header(content: bytes, path: str) -> None:
    """Raise ``BadInput`` for a file that is no C3D, or shorter than its header says."""
    if len(content) < 1024 or content[1] != 0x50:
        message = "is no C3D file, or only the beginning of one; export it again"
        raise BadInput(message, file=path)
    parameters = 512 * (max(content[0], 1) - 1)
    processor = content[parameters + 3] if len(content) > parameters + 3 else INTEL
    points, analogs, first, last = _decoded(content, processor, 2, "4H")
    start = _decoded(content, processor, 16, "H")[0]
    floating = _decoded(content, processor, 12, "f")[0] < 0
    frames = max(last - first + 1, 0)
    needed = 512 * (start - 1) + frames * (4 * points + analogs) * (4 if floating else 2)
    if len(content) < min(needed, MAX_BYTES) or len(content) < parameters + 4:
        message = f"is cut off: its header promises {frames} frames, {needed:,} bytes, and it has {len(content):,}"
        raise BadInput(message, file=path)
