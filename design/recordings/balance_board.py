"""A balance board with a sensor in each corner: its load is their sum, its CoP follows from where they are.

With sensors at (± a, ± b), CoP = b ((TL + TR) - (BL + BR)) / (TL + TR + BL + BR) to the top of the board.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from design.recordings.table import Array, Table
from design.recordings.units import unit_of

LENGTH = 0.238
"""Distance of the sensors at the top of a Wii Balance Board from those at its bottom [m]; it is 433 mm across."""
LOAD, PLACE = "sum of corners", "CoP of corners"
"""The names of the columns that are added to the file's."""

_CORNER = re.compile(
    r"(?:sensor|load|force|weight|mass|f)?(?P<end>top|front|bottom|rear|back|t|b)(?P<side>left|right|l|r)"
    r"(?:sensor|load|force|weight|mass)?(?P<unit>kg|n|kgf|lb|lbs)?"
)
_END = {"top": "t", "front": "t", "t": "t", "bottom": "b", "rear": "b", "back": "b", "b": "b"}


def with_board(table: Table) -> tuple[Table, list[str]]:
    """The ``table`` with load and CoP of a board's corners beside its columns, if it has these; and what is assumed."""
    corners: dict[str, int] = {}
    units = set()
    for index, name in enumerate(table.names):
        match = _CORNER.fullmatch(re.sub(r"[^a-z0-9]", "", name.lower()))
        if match and corners.setdefault(_END[match["end"]] + match["side"][0], index) == index:
            units.add(table.units[index] or (unit_of(match["unit"]) if match["unit"] else None))
    if set(corners) != {"tl", "tr", "bl", "br"} or len(units) != 1:
        return table, []
    parts: dict[str, Array] = {corner: table.values[:, index] for corner, index in corners.items()}
    load: Array = np.sum(list(parts.values()), axis=0)
    with np.errstate(all="ignore"):
        place = (
            0.5 * LENGTH * (parts["tl"] + parts["tr"] - parts["bl"] - parts["br"]) / np.where(load == 0, np.nan, load)
        )
    count = len(table.names)
    names = ", ".join(table.names[index] for index in sorted(corners.values()))
    wider = replace(
        table, names=(*table.names, LOAD, PLACE), units=(*table.units, units.pop(), "m"),
        values=np.column_stack([table.values, load, place]),
        cell=lambda row, column: table.cell(row, column) if column < count else "",
    )  # fmt: skip
    return wider, [
        f"{names} are the corners of a Wii Balance Board, with sensors {1e3 * LENGTH:g} mm apart from top to bottom and"
        " the toes at its top"
    ]
