"""Which of the file's axes points up and which to the toes: as the user says, or as the data leave no doubt."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from design.errors import BadInput
from design.recordings.names import Known
from design.recordings.reading import Reading
from design.recordings.remedies import Misfit, Remedy
from design.recordings.selection import Parts, Selection
from design.recordings.table import Array, Table
from design.recordings.units import FACTORS

DOMINANT = 3.0
"""How many times the other components the vertical one must be, to be taken for it."""


@dataclass(frozen=True, kw_only=True)
class Axes:
    """The axis that points ``up`` (empty if unknown), the one to the toes with its ``sign``, the ``side`` with its.

    ``assumed``: nobody stated which axis points forward.
    """

    up: str
    forward: str
    sign: int
    side: str
    side_sign: int
    assumed: bool

    def of(self, role: str) -> tuple[str, str, int]:
        """Kind, axis and sign of the columns that hold a role."""
        return {
            "fz": ("force", self.up, 1), "fx": ("force", self.forward, self.sign),
            "my": ("moment", self.side, self.side_sign), "cop": ("cop", self.forward, self.sign),
            "com_x": ("com", self.forward, self.sign), "com_y": ("com", self.up, 1),
            "ankle_x": ("ankle", self.forward, self.sign), "ankle_y": ("ankle", self.up, 1),
        }[role]  # fmt: skip


def axes(
    table: Table, how: Reading, selected: dict[str, Selection | None], known: dict[int, Known], notes: list[str]
) -> Axes:
    """The axes of ``table``, whose columns are ``known`` by name or ``selected`` by the user."""
    up = _up(table, how, selected, known, notes)
    forward, assumed = _forward(how, up, selected, known)
    axis, sign = forward[-1], -1 if forward.startswith("-") else 1
    side = next(a for a in "xyz" if a not in (axis, up))
    turn = sign if (up, axis) in (("x", "y"), ("y", "z"), ("z", "x")) else -sign  # side axis = up x forward
    return Axes(up=up, forward=axis, sign=sign, side=side, side_sign=turn, assumed=assumed)


def by_axis(known: dict[int, Known], kind: str, tags: Iterable[str] | None = None) -> dict[str, list[int]]:
    """The columns of a ``kind`` by axis: of the plates or sides ``tags``, of the net of all, or of every one."""
    alike = {index: each for index, each in known.items() if each.kind == kind}
    if tags is not None:
        alike = {index: each for index, each in alike.items() if each.tag in set(tags)}
    elif any(each.tag == "net" for each in alike.values()):
        alike = {index: each for index, each in alike.items() if each.tag == "net"}
    columns: dict[str, list[int]] = {}
    for index, each in alike.items():
        columns.setdefault(each.axis, []).append(index)
    return columns


def _tags(selected: dict[str, Selection | None], known: dict[int, Known]) -> set[str] | None:
    """The plates whose columns the user names; None if none is known."""
    for role in ("fz", "cop", "my", "fx"):
        choice = selected.get(role)
        tags = {known[index].tag for index, _ in choice.parts if index in known} if choice else set()
        if tags:
            return tags
    return None


def _up(
    table: Table, how: Reading, selected: dict[str, Selection | None], known: dict[int, Known], notes: list[str]
) -> str:
    """The axis that points up, judged by the plates with load, or by the height of the CoG; else empty."""
    stated = how.up.lower() if how.up else None
    if stated not in (None, "y", "z"):
        message = f"is {stated[:20]!r}; needs y or z"
        raise BadInput(message, key="--up")
    forces = by_axis(known, "force", _tags(selected, known)) or by_axis(known, "force")
    body, ankle = by_axis(known, "com"), by_axis(known, "ankle")
    if forces:
        what = "force"
        sizes = {axis: sum(_load(table, index) for index in columns) for axis, columns in forces.items()}
    elif body:
        what = "height of the centre of gravity"
        low = {axis: float(np.mean([_mean(table.values[:, k]) for k in columns])) for axis, columns in ankle.items()}
        sizes = {axis: abs(_mean(table.values[:, columns[0]]) - low.get(axis, 0.0)) for axis, columns in body.items()}
    else:
        return stated or ""
    ranked = sorted(sizes, key=lambda axis: -sizes[axis])
    top = ranked[0]
    clear = len(ranked) == 1 or sizes[top] > DOMINANT * sizes[ranked[1]]
    figures = ", ".join(f"{axis} {sizes[axis]:.4g}" for axis in sorted(sizes))
    if stated is not None:
        if stated not in sizes or (clear and top != stated):
            message = f"is {stated}, and the file's {what} is largest along {top} (mean {figures})"
            raise Misfit(message, file=table.origin, key="--up", remedies=[Remedy(options={"--up": top})])
        return stated
    needed = {"fz", "cop"} if forces else {"com_x", "com_y"}
    if all(selected.get(role) for role in needed):
        return top if clear and top != "x" else ""
    if not clear or top == "x":
        message = f"leaves open which axis points up (mean {what}: {figures})"
        remedies = [Remedy(options={"--up": axis}) for axis in ("y", "z") if axis in sizes]
        raise Misfit(message, file=table.origin, remedies=remedies, otherwise="give --up, or --columns")
    notes.append(f"{top} points up (mean {what}: {figures})")
    return top


def _load(table: Table, index: int) -> float:
    """Size of the usual force in a column, where there is one."""
    column = table.values[:, index]
    loaded = column[np.isfinite(column) & (column != 0)]
    scale = FACTORS["force"].get(table.units[index] or "N", 1.0)
    return scale * abs(float(np.median(loaded))) if len(loaded) else 0.0


def _mean(column: Array) -> float:
    known = column[np.isfinite(column)]
    return float(known.mean()) if len(known) else 0.0


def _forward(how: Reading, up: str, selected: dict[str, Selection | None], known: dict[int, Known]) -> tuple[str, bool]:
    """The axis to the toes: as stated, or as every column of the CoP names it; and whether it is assumed."""
    stated = how.forward.lower() if how.forward else None
    if stated is None:
        choice = selected.get("cop") or selected.get("com_x")
        named = _common(choice.parts, known) if choice else ""
        if named and named[-1] != up:
            return named, False
        return ("z" if up == "x" else "x"), choice is None
    if stated.lstrip("-+") not in ("x", "y", "z") or len(stated) > 2:
        message = f"is {stated[:20]!r}; needs x, -x, y, -y, z or -z"
        raise BadInput(message, key="--forward")
    if stated.lstrip("-+") == up:
        message = f"is {stated}, and {up} points up; needs a horizontal axis"
        raise BadInput(message, key="--forward")
    return stated.lstrip("+"), False


def _common(parts: Parts, known: dict[int, Known]) -> str:
    """The axis, with its sign, that all columns of ``parts`` name; empty if they differ or name none."""
    named = {("-" if sign < 0 else "") + known[index].axis if index in known else "" for index, sign in parts}
    axis = named.pop() if len(named) == 1 else ""
    return axis if axis.lstrip("-") else ""
