"""A writer of C3D files that shares no code with the reader: three kinds of processors, reals or integers."""

import struct

import numpy as np

INTEL, DEC, SGI = 84, 85, 86


def real(value, processor):
    """Four bytes of a real number as a processor writes it."""
    if processor == SGI:
        return struct.pack(">f", value)
    if processor == DEC:
        plain = struct.pack("<f", 4.0 * value)
        return plain[2:] + plain[:2]
    return struct.pack("<f", value)


def reals(values, processor):
    """The bytes of an array of real numbers."""
    if processor == SGI:
        return values.astype(">f4").tobytes()
    if processor == DEC:
        words = (4.0 * values).astype("<f4").view("<u2").reshape(-1, 2)
        return words[:, ::-1].tobytes()
    return values.astype("<f4").tobytes()


def c3d(
    analog, *, rate, labels, units, kind=2, corners, origins, processor=INTEL, integers=False, points=1,
    position="mm", per_plate=6,
):  # fmt: skip
    """The bytes of a C3D file with the ``analog`` channels (k, n) [units] of plates with ``corners`` (plates, 3, 4)."""
    order = ">" if processor == SGI else "<"
    channels, samples = analog.shape
    plates = len(corners)
    per_frame = 2 if samples % 2 == 0 and points else 1
    frames = samples // per_frame
    groups = {"POINT": 1, "ANALOG": 2, "FORCE_PLATFORM": 3}
    scale = np.maximum(np.abs(analog).max(axis=1), 1e-6) / 32000.0 if integers else np.ones(channels)
    parameters = {
        ("POINT", "USED"): (2, [], [points]), ("POINT", "SCALE"): (4, [], [0.1 if integers else -1.0]),
        ("POINT", "RATE"): (4, [], [rate / per_frame if points else 0.0]), ("POINT", "DATA_START"): (2, [], [0]),
        ("POINT", "FRAMES"): (2, [], [frames]),
        ("ANALOG", "USED"): (2, [], [channels]), ("ANALOG", "GEN_SCALE"): (4, [], [1.0]),
        ("ANALOG", "RATE"): (4, [], [rate]), ("ANALOG", "SCALE"): (4, [channels], scale),
        ("ANALOG", "OFFSET"): (2, [channels], [0] * channels), ("ANALOG", "LABELS"): (-1, [8, channels], labels),
        ("ANALOG", "UNITS"): (-1, [8, channels], units),
        ("FORCE_PLATFORM", "USED"): (2, [], [plates]), ("FORCE_PLATFORM", "TYPE"): (2, [plates], [kind] * plates),
        ("FORCE_PLATFORM", "ZERO"): (2, [2], [1, 0]),
        ("FORCE_PLATFORM", "CORNERS"): (4, [3, 4, plates], np.asarray(corners).transpose(0, 2, 1).ravel()),
        ("FORCE_PLATFORM", "ORIGIN"): (4, [3, plates], np.asarray(origins).ravel()),
        ("FORCE_PLATFORM", "CHANNEL"): (2, [per_plate, plates], list(range(1, channels + 1))),
    }  # fmt: skip
    if points:
        parameters["POINT", "UNITS"] = (-1, [4, 1], [position])
        parameters["POINT", "LABELS"] = (-1, [8, points], ["marker"])
    blocks = 0
    for _ in range(2):  # the second time with the number of blocks known
        start = 2 + blocks
        parameters["POINT", "DATA_START"] = (2, [], [start])
        body = b""
        for name, number in groups.items():
            body += struct.pack("bb", len(name), -number) + name.encode() + struct.pack(f"{order}h", 3) + b"\0"
        for (group, name), (kind_of, dims, values) in parameters.items():
            if kind_of == -1:
                data = b"".join(str(value).ljust(dims[0])[: dims[0]].encode() for value in values)
            elif kind_of == 2:
                data = struct.pack(f"{order}{len(values)}h", *map(int, values))
            else:
                data = b"".join(real(float(value), processor) for value in values)
            rest = struct.pack("bB", kind_of, len(dims)) + bytes(dims) + data + b"\0"
            head = struct.pack("bb", len(name), groups[group]) + name.encode()
            body += head + struct.pack(f"{order}h", 2 + len(rest)) + rest
        body += b"\0\0"
        blocks = -(-(4 + len(body)) // 512)
    section = (bytes([1, 0x50, blocks, processor]) + body).ljust(512 * blocks, b"\0")
    header = bytes([2, 0x50]) + struct.pack(f"{order}5H", points, channels * per_frame, 1, frames, 10)
    header += real(0.1 if integers else -1.0, processor) + struct.pack(f"{order}2H", 2 + blocks, per_frame)
    header += real(rate / per_frame if points else 0.0, processor)
    rows = np.zeros((frames, 4 * points + channels * per_frame))
    rows[:, 4 * points :] = (analog / scale[:, None]).T.reshape(frames, -1)
    data = np.round(rows).astype(f"{order}i2").tobytes() if integers else reals(rows.ravel(), processor)
    return header.ljust(512, b"\0") + section + data.ljust(-(-len(data) // 512) * 512, b"\0")
