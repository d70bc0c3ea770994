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

_ENTRY = re.compile(r"\s*([A-Za-z_]+)\s*=\s*(.*?)\s*(?=,\s*[A-Za-z_]+\s*=|,?\s*$)", re.DOTALL)


@dataclass(frozen=True, kw_only=True)
class Wish:
    """A role, the columns (with their signs) that make it up, and the unit that the user says."""

    role: str
    parts: tuple[tuple[int, int], ...]
    unit: str | None


def parse(text: str | None, table: Table) -> dict[str, Wish | None]:
    """The wishes by role in ``--columns``; None where the user says ``role=none``. Raises ``BadInput``."""
    found: dict[str, Wish | None] = {}
    place = 0
    while text is not None and place < len(text):
        match = _ENTRY.match(text, place)
        if match is None or not match[2]:
            message = (
                f"has {text[place:].strip()[:40]!r}; needs NAME=COLUMN or NAME=COLUMN:UNIT, as fz=Fz:N,cop=COPx:cm"
            )
            raise BadInput(message, key="--columns")
        role, value = match[1].lower(), match[2]
        if role not in ROLES:
            close = difflib.get_close_matches(role, list(ROLES), n=1)
            hint = f"; did you mean {close[0]}?" if close else ""
            message = f"has no name {role!r}{hint}; there are: {', '.join(ROLES)}"
            raise BadInput(message, key="--columns")
        if role in found:
            message = f"names {role} twice; join columns with +, as fz=Fz1+Fz2"
            raise BadInput(message, key="--columns")
        found[role] = None if value.lower() == "none" else _wish(role, value, table)
        place = match.end() + 1
    return found


def _wish(role: str, value: str, table: Table) -> Wish:
    unit: str | None = None
    if _index(value, table) is None and ":" in value:
        name, _, said = value.rpartition(":")
        unit = unit_of(said)
        if unit is None or factor(unit, ROLES[role]) is None:
            message = f"says {role} is in {said!r}; allowed: {', '.join(FACTORS[ROLES[role]])}"
            raise BadInput(message, key="--columns")
        value = name.strip()
    whole = _index(value, table)
    pieces = [value] if whole is not None else value.split("+")
    parts = []
    for piece in pieces:
        name, sign = piece.strip(), 1
        if _index(name, table) is None and name.startswith("-"):
            name, sign = name[1:].strip(), -1
        index = _index(name, table)
        if index is None:
            close = difflib.get_close_matches(name, table.names, n=1)
            hint = f"; did you mean {close[0]!r}?" if close else ""
            message = f"has no column {name[:60]!r}{hint}; its columns: {listed(table.names)}"
            raise BadInput(message, file=table.origin)
        stated = bracketed(name) if name not in table.names else None
        if stated and not table.names[index].lower().endswith(name[len(stated[0]) :].lower()):
            written = unit_of(stated[1])
            if written is None or factor(written, ROLES[role]) is None:
                message = f"says {role} is in {stated[1]!r}; allowed: {', '.join(FACTORS[ROLES[role]])}"
                raise BadInput(message, key="--columns")
            if unit not in (None, written):
                message = f"says {role} is in {written} and in {unit}"
                raise BadInput(message, key="--columns")
            unit = written
        parts.append((index, sign))
    return Wish(role=role, parts=tuple(parts), unit=unit)


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
    if re.fullmatch(r"\d{1,4}", name) and 1 <= int(name) <= len(table.names):
        return int(name) - 1
    return None


def listed(names: Sequence[str], most: int = 24) -> str:
    """Names for a message."""
    more = f", ... ({len(names)} in all)" if len(names) > most else ""
    return ", ".join(names[:most]) + more
