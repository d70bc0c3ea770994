"""The lines above the numbers: the columns' names and units, and a sampling rate that is stated."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from design.recordings.units import split as name_and_unit
from design.recordings.units import unit_of

Column = tuple[str, str | None]

_RATE = re.compile(
    r"\W*(export frame rate|capture frame rate|frame rate|sampl(?:e|ing)[ _]?(?:rate|frequency)|frequency|data ?rate"
    r"|scan rate|rate)\W*?(?:\(hz\)|\[hz\])?[\s,;:=\"]+(\d+(?:[.,]\d+)?)\D{0,8}",
    re.IGNORECASE,
)
_COUNT = re.compile(
    r"\W*(total exported frames|number of samples|number of frames|n[_ ]?rows|no_of_samples|no_of_frames)\W*?"
    r"[\s,;:=\"]+(\d+)[\s,;\"]*",
    re.IGNORECASE,
)
_VICON = {"devices", "joints", "trajectories", "model outputs", "segments"}


@dataclass(frozen=True, kw_only=True)
class Header:
    """Names and units of the columns (empty if the header names none), a ``rate`` [Hz], and what was found.

    ``promised``: the words in which the header states the number of rows, and this number.
    """

    columns: tuple[Column, ...]
    rate: float | None
    said: tuple[str, ...]
    promised: tuple[str, int] | None = None


def promised_rows(lines: list[str]) -> tuple[str, int] | None:
    """The words in which a header's ``lines`` state the number of rows, and the least such number."""
    found = [(match[1], int(match[2])) for line in lines if (match := _COUNT.fullmatch(line.strip()))]
    return min(found, key=lambda each: each[1]) if found else None


def understand(lines: Sequence[str], above: list[int], cells: Callable[[str], list[str]], count: int) -> Header:
    """The header in those ``lines`` that are numbered ``above``, over rows of ``count`` cells."""
    rate, said = _rate([lines[index] for index in above])
    if not above:
        return Header(columns=(), rate=rate, said=(*said, "no header"))
    promised = promised_rows([lines[index] for index in above])
    rows = [(index, _row(lines[index], cells, count)) for index in above[-3:]]
    index, last = rows[-1]
    units: list[str | None] | None = None
    if len(rows) > 1 and len(last) == count and _is_units(last):
        units = [unit_of(cell) for cell in last]
        index, last = rows[-2]
        said = [*said, f"units in line {rows[-1][0] + 1}"]
    if len(last) != count or not any(last):
        odd = f"line {index + 1} names {len(last)} column{'s' * (len(last) != 1)} over rows of {count}: no names taken"
        return Header(columns=(), rate=rate, said=(*said, odd), promised=promised)
    kinds = [_row(lines[index], cells, count) for index in above[-5:-1]]
    if {cell.upper() for cell in last[1:]} <= set("XYZ") and len(kinds) == 4 and all(len(k) == count for k in kinds):
        # Visual3D: file, signal, type and folder stand above each component
        signals = (
            f"{re.sub(kind, '', signal, flags=re.IGNORECASE)} {kind} {axis}".strip() if kind.isalnum() else axis
            for signal, kind, axis in zip(kinds[1][1:], kinds[2][1:], last[1:], strict=True)
        )
        last = [last[0], *signals]
    columns = [name_and_unit(cell) for cell in last]
    if units is not None:
        columns = [(name, own or unit) for (name, own), unit in zip(columns, units, strict=True)]
    return Header(columns=tuple(columns), rate=rate, said=(*said, f"names in line {index + 1}"), promised=promised)


def _row(line: str, cells: Callable[[str], list[str]], count: int) -> list[str]:
    """The cells of a header's line: an empty one at its end, and a sign of comment at its beginning, are none."""
    options = [cells(line)]
    if line.lstrip()[:1] in ("#", "%"):
        options.append(cells(re.sub(r"^\s*[#%]+\s*", "", line)))
    options.append([part for part in re.split(r"\s{2,}|\t", line.strip()) if part])
    for found in options:
        while len(found) > count and not found[-1]:
            found.pop()
    return next((found for found in options if len(found) == count), options[0])


def _is_units(cells: list[str]) -> bool:
    named = [cell for cell in cells if cell and cell not in ("-", "[]", "#")]
    return bool(named) and all(unit_of(cell) for cell in named)


def _rate(lines: list[str]) -> tuple[float | None, list[str]]:
    """A sampling rate that the lines state, if they agree on one."""
    found: dict[float, str] = {}
    for line, after in zip(lines, [*lines[1:], ""], strict=False):
        if match := _RATE.fullmatch(line.strip()):
            found.setdefault(float(match[2].replace(",", ".")), match[1])
        number = after.strip(' ,;\t"')
        if line.strip(' ,;\t"').lower() in _VICON and re.fullmatch(r"\d+(\.\d+)?", number):
            found.setdefault(float(number), line.strip(' ,;\t"'))
    found.pop(0.0, None)
    if len(found) == 1:
        rate, name = next(iter(found.items()))
        return rate, [f"{name} {rate:g} Hz in the header"]
    return None, [f"the header states several rates: {', '.join(f'{rate:g} Hz' for rate in found)}"] if found else []
