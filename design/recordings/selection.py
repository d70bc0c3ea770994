"""The option ``--columns``: which column holds what, in which unit."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass

from design.errors import BadInput
from design.recordings.table import Table
from design.recordings.units import FACTORS, Kind, bracketed, factor, unit_of

ROLES: dict[str, Kind] = {
    "time": "time", "angle": "angle", "rate": "rate", "toe": "force", "heel": "force", "torque": "moment",
    "fz": "force", "fx": "force", "my": "moment", "cop": "position", "com_x": "position", "com_y": "position",
    "ankle_x": "position", "ankle_y": "position",
}  # fmt: skip
"""What can be read, and what it is measured in."""

Parts = tuple[tuple[int, int], ...]
"""Columns by index, each with its sign."""

_ENTRY = re.compile(r"\s*([A-Za-z_]+)\s*=\s*(.*?)\s*(?=,\s*[A-Za-z_]+\s*=|,?\s*$)", re.DOTALL)


@dataclass(frozen=True, kw_only=True)
class Selection:
    """The columns (with their signs) that make up a role, and the unit that the user states."""

    parts: Parts
    unit: str | None


def entries(text: str | None) -> dict[str, str]:
    """The value of each role in ``--columns``, as written; raises ``BadInput`` for what is no list of roles."""
    values: dict[str, str] = {}
    place = 0
    while text is not None and place < len(text):
        match = _ENTRY.match(text, place)
        if match is None or not match[2]:
            message = (
                f"has {text[place:].strip()[:40]!r}; needs NAME=COLUMN or NAME=COLUMN:UNIT, as fz=Fz:N,cop=COPx:cm"
            )
            raise BadInput(message, key="--columns")
        role = match[1].lower()
        if role not in ROLES:
            close = difflib.get_close_matches(role, list(ROLES), n=1)
            hint = f"; did you mean {close[0]}?" if close else ""
            message = f"has no name {role!r}{hint}; there are: {', '.join(ROLES)}"
            raise BadInput(message, key="--columns")
        if role in values:
            message = f"names {role} twice; join columns with +, as fz=Fz1+Fz2"
            raise BadInput(message, key="--columns")
        values[role] = match[2]
        place = match.end() + 1
    return values


def parse(text: str | None, table: Table) -> dict[str, Selection | None]:
    """What ``--columns`` selects, by role; None where the user writes ``role=none``. Raises ``BadInput``."""
    return {
        role: None if value.lower() == "none" else _selection(role, value, table)
        for role, value in entries(text).items()
    }


def _selection(role: str, value: str, table: Table) -> Selection:
    unit: str | None = None
    pieces = [value] if _index(value, table) is not None else _pieces(value, table)
    if ":" in value and any(_index(piece.strip().removeprefix("-"), table) is None for piece in pieces):
        name, _, written = value.rpartition(":")
        unit = _unit(role, written)
        value = name.strip()
        pieces = [value] if _index(value, table) is not None else _pieces(value, table)
    parts = []
    for piece in pieces:
        name, sign = piece.strip(), 1
        if _index(name, table) is None and name.startswith("-"):
            name, sign = name[1:].strip(), -1
        index = _index(name, table)
        if index is None:
            close = difflib.get_close_matches(name[:200], table.names, n=1)
            hint = f"; did you mean {close[0]!r}?" if close else ""
            message = f"has no column {name[:60]!r}{hint}; its columns: {listed(table.names)}"
            raise BadInput(message, file=table.origin)
        stated = bracketed(name) if name not in table.names else None
        if stated and not table.names[index].lower().endswith(name[len(stated[0]) :].lower()):
            written = _unit(role, stated[1])
            if unit not in (None, written):
                message = f"says {role} is in {written} and in {unit}"
                raise BadInput(message, key="--columns")
            unit = written
        parts.append((index, sign))
    return Selection(parts=tuple(parts), unit=unit)


def _pieces(value: str, table: Table) -> list[str]:
    """The columns joined by + in ``value``; a + within a column's name joins none."""
    pieces: list[str] = []
    for piece in value.split("+"):
        if pieces and _index(pieces[-1].strip().removeprefix("-"), table) is None:
            joined = f"{pieces[-1]}+{piece}"
            if _index(joined.strip().removeprefix("-"), table) is not None:
                pieces[-1] = joined
                continue
        pieces.append(piece)
    return pieces


def _unit(role: str, text: str) -> str:
    unit = unit_of(text)
    if unit is None or factor(unit, ROLES[role]) is None:
        message = f"says {role} is in {text!r}; allowed: {', '.join(FACTORS[ROLES[role]])}"
        raise BadInput(message, key="--columns")
    return unit


def _index(name: str, table: Table) -> int | None:
    """Where the column ``name`` is: by its name, by its name in other letters if that is unique, or by its number."""
    if name in table.names:
        return table.names.index(name)
    alike = [index for index, known in enumerate(table.names) if known.lower() == name.lower()]
    if len(alike) == 1:
        return alike[0]
    bare = [
        index for index, known in enumerate(table.names)
        if table.units[index] and re.sub(r"\s*[\[(][^\[\]()]*[\])]$", "", name).lower() == known.lower()
    ]  # fmt: skip
    if len(bare) == 1:
        return bare[0]
    if re.fullmatch(r"\d{1,4}", name) and name.isascii() and 1 <= int(name) <= len(table.names):
        return int(name) - 1
    return None


def joined(parts: Parts, names: Sequence[str]) -> str:
    """Columns as they are written in ``--columns``: ``Fz1+Fz2``, ``-Fx1+-Fx2``."""
    return "+".join(("-" if sign < 0 else "") + names[index] for index, sign in parts)


def negated(label: str) -> str:
    """Columns joined by + with every sign turned."""
    return "+".join(part[1:] if part.startswith("-") else f"-{part}" for part in label.split("+"))


def listed(names: Sequence[str], most: int = 24) -> str:
    """Names for a message."""
    more = f", ... ({len(names)} in all)" if len(names) > most else ""
    return ", ".join(name[:60] for name in names[:most]) + more
