"""Units of a recording: how they are written, and what they are in SI."""

from __future__ import annotations

import math
import re
from typing import Literal

Kind = Literal["time", "angle", "rate", "force", "moment", "position"]

POUND = 4.4482216152605
KILOPOND = 9.80665

FACTORS: dict[Kind, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0},
    "angle": {"rad": 1.0, "deg": math.pi / 180},
    "rate": {"rad/s": 1.0, "deg/s": math.pi / 180},
    "force": {"N": 1.0, "kN": 1e3, "kgf": KILOPOND, "lbf": POUND},
    "moment": {"N m": 1.0, "N cm": 1e-2, "N mm": 1e-3, "kN m": 1e3},
    "position": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
}
"""Factor to SI of each unit; the first of each kind is what is taken where nothing is said."""

_OTHER_WORDS = {
    "sec": "s", "secs": "s", "second": "s", "seconds": "s", "msec": "ms", "millisecond": "ms", "milliseconds": "ms",
    "µs": "us", "μs": "us", "minute": "min", "minutes": "min", "radian": "rad", "radians": "rad", "°": "deg",
    "degree": "deg", "degrees": "deg", "rad/sec": "rad/s", "rads": "rad/s", "deg/sec": "deg/s", "°/s": "deg/s",
    "newton": "N", "newtons": "N", "kp": "kgf", "kg": "kgf", "lb": "lbf", "lbs": "lbf", "meter": "m", "meters": "m",
    "metre": "m", "metres": "m", "centimeter": "cm", "centimetre": "cm", "millimeter": "mm", "millimetre": "mm",
    "millimeters": "mm", "centimeters": "cm", "newtonmeter": "N m", "newtonmeters": "N m",
}  # fmt: skip


def _plain(text: str) -> str:
    """Without spaces, dots, stars and brackets, in small letters."""
    return re.sub(r"[\s.*·⋅\[\]()_]|(?<=n)-(?=m)", "", text.strip().lower())


_KNOWN = {_plain(name): name for units in FACTORS.values() for name in units}
_KNOWN |= {_plain(word): name for word, name in _OTHER_WORDS.items()}


def unit_of(text: str) -> str | None:
    """The unit that ``text`` writes (``Nm``, ``N.mm``, ``[sec]``), or None."""
    return _KNOWN.get(_plain(text))


def factor(unit: str, kind: Kind) -> float | None:
    """What ``unit`` is in SI as a quantity of this ``kind``; None if it measures something else."""
    return FACTORS[kind].get(unit)


def split(name: str) -> tuple[str, str | None]:
    """A header's name without the unit in its brackets or after its comma: ``COPx [cm]``, ``COPx,cm`` -> (COPx, cm)."""
    label, comma, tail = name.rpartition(",")
    found = (label.strip(), tail) if comma and label.strip() else bracketed(name)
    if found and (unit := unit_of(found[1])):
        return found[0], unit
    return name.strip(), None


def bracketed(name: str) -> tuple[str, str] | None:
    """A name without the brackets at its end, and what stands in them; None if there are none."""
    match = re.fullmatch(r"(.*\S)\s*[\[(]\s*([^\[\]()]+?)\s*[\])]\s*", name)
    return (match[1].strip(), match[2]) if match else None


def listed(kind: Kind | None = None) -> str:
    """The units of a ``kind``, or all of them, for a message."""
    return ", ".join(FACTORS[kind] if kind else [name for units in FACTORS.values() for name in units])
