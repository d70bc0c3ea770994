"""A C3D file of an SGI (MIPS) processor in Intel's byte order, since the reader does not know the other.

Header, parameters and data are turned number by number; texts stay. The layout is that of the C3D user guide.
"""

from __future__ import annotations

import struct

import numpy as np

BLOCK = 512
INTEL = 84


def to_intel(content: bytes) -> bytes:
    """``content`` in Intel's byte order; raises ``ValueError`` or ``struct.error`` where it cannot be followed."""
    first = BLOCK * (content[0] - 1)
    points, analogs, begin, end, gap = struct.unpack(">5H", content[2:12])
    scale, start, per_frame, rate = struct.unpack(">fHHf", content[12:24])
    header = content[:2] + struct.pack("<5HfHHf", points, analogs, begin, end, gap, scale, start, per_frame, rate)
    data_at = BLOCK * (start - 1)
    if not BLOCK <= first < data_at <= len(content):
        message = "its header points outside the file"
        raise ValueError(message)
    data = np.frombuffer(content[data_at:], dtype=np.uint8)
    width = 4 if scale < 0 else 2
    turned = data[: len(data) // width * width].reshape(-1, width)[:, ::-1].tobytes()
    return header.ljust(first, b"\0") + _parameters(content[first:data_at]) + turned


def _parameters(section: bytes) -> bytes:
    """The section of parameters, each of which tells where the next one is."""
    turned = bytearray(section)
    turned[3] = INTEL
    place = 4
    while place + 2 < len(section) and section[place]:
        length, group = struct.unpack_from("bb", section, place)
        place += 2 + abs(length)
        (offset,) = struct.unpack_from(">h", section, place)
        struct.pack_into("<h", turned, place, offset)
        if group > 0:
            _turn_values(section, turned, place + 2)
        if offset <= 0:
            break
        place += offset
    return bytes(turned)


def _turn_values(section: bytes, turned: bytearray, place: int) -> None:
    """Turn the numbers of the parameter whose type and dimensions stand at ``place``."""
    kind, count = struct.unpack_from("bB", section, place)
    dimensions = section[place + 2 : place + 2 + count]
    size = int(np.prod([*dimensions], dtype=np.int64)) if count else 1
    begin = place + 2 + count
    if kind in (2, 4):
        values = np.frombuffer(section, dtype=np.uint8, count=kind * size, offset=begin).reshape(-1, kind)
        turned[begin : begin + kind * size] = values[:, ::-1].tobytes()
