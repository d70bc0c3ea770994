"""What is known while columns are assigned: the table, what the user selects, what names say, and the axes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from design.errors import BadInput
from design.recordings.axes import Axes
from design.recordings.names import Known
from design.recordings.plates import Quantity
from design.recordings.reading import Reading
from design.recordings.remedies import Misfit, Remedy
from design.recordings.selection import ROLES, Parts, Selection, joined, listed
from design.recordings.table import Table
from design.recordings.text import ALLOW_GAPS
from design.recordings.units import FACTORS, bracketed, factor
from design.recordings.units import listed as units_listed


@dataclass(eq=False, kw_only=True)
class Finder:
    """What is known while columns are assigned."""

    table: Table
    how: Reading
    selected: dict[str, Selection | None]
    known: dict[int, Known]
    axes: Axes
    notes: list[str] = field(default_factory=list)
    assumed: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


def quantity_of(find: Finder, role: str, parts: Parts) -> Quantity:
    """The values of ``role`` in SI: forces and moments of several columns are added, positions are averaged."""
    units = [column_unit(find, role, index) for index, _ in parts]
    scales = [sign * FACTORS[ROLES[role]][unit] for (_, sign), (unit, _) in zip(parts, units, strict=True)]
    columns = [find.table.values[:, index] for index, _ in parts]
    arrays = [column if scale == 1 else scale * column for scale, column in zip(scales, columns, strict=True)]
    mean = ROLES[role] in ("position", "time") and len(arrays) > 1
    values = arrays[0] if len(arrays) == 1 else np.mean(arrays, axis=0) if mean else np.sum(arrays, axis=0)
    return Quantity(
        values=values, columns=joined(parts, find.table.names), unit=units[0][0], sure=all(sure for _, sure in units)
    )


def check_cells(table: Table, how: Reading, role: str, name: str, missing: np.ndarray) -> None:
    """Raise ``BadInput`` for a column that has no number in the rows ``missing`` (n,), unless they may be masked."""
    index = table.names.index(name)
    rows = np.flatnonzero(missing & np.isnan(table.values[:, index]))
    if not len(rows):
        return
    if len(rows) == len(table.values):
        other = ", or give --rate HZ" if role == "time" else ""
        message = f"holds no numbers; choose another with --columns{other}; the file's: {listed(table.names)}"
        raise BadInput(message, file=table.origin, key=f"column {name}")
    if how.allow_gaps:
        return
    text = table.cell(int(rows[0]), index)
    what = f"is {text[:40]!r}" if text else "is empty"
    more = f" (and {len(rows) - 1} more such cells)" if len(rows) > 1 else ""
    message = f"{what}; needs a number{more}; mend it"
    key = f"{table.place} {table.lines[rows[0]]}, column {name}"
    raise Misfit(message, file=table.origin, key=key, remedies=ALLOW_GAPS)


def column_unit(find: Finder, role: str, index: int) -> tuple[str, bool]:
    """The unit of a column, and whether the user or the file states it."""
    kind, name = ROLES[role], find.table.names[index]
    choice = find.selected.get(role)
    known = find.known.get(index)
    stated = find.table.units[index] or (known.unit if known else None)
    if stated and factor(stated, kind) is None:
        message = f"is in {stated}, and {role} is a {kind}; allowed: {', '.join(FACTORS[kind])}"
        raise BadInput(message, file=find.table.origin, key=f"column {name}")
    own = choice.unit if choice else None
    odd = None if known else bracketed(name)
    if odd and not stated and not own:
        message = (
            f"states the unit {odd[1]!r}, which is not known; {role} needs one of {units_listed(kind)}: give"
            f" --columns '{role}={name}:UNIT', or convert the column"
        )
        raise BadInput(message, file=find.table.origin, key=f"column {name}")
    if own and stated and own != stated:
        message = f"is in {stated} by the file, and --columns says {own}; leave the unit out, or correct the header"
        raise BadInput(message, file=find.table.origin, key=f"column {name}")
    return own or stated or next(iter(FACTORS[kind])), bool(own or stated)


def check_alike(find: Finder, role: str, columns: list[int]) -> None:
    """Raise ``BadInput`` for two ``columns`` of one plate that may both be ``role``, unless they hold the same."""
    first = find.table.values[:, columns[0]]
    others = [index for index in columns[1:] if not np.array_equal(first, find.table.values[:, index], equal_nan=True)]
    if not others and len({find.table.units[index] for index in columns}) == 1:
        return
    names = [find.table.names[index] for index in columns]
    message = f"has more than one column that may be {role}: {listed(names)}"
    which = " or ".join(f"--columns '{role}={name}'" for name in names[:6])
    remedies = [Remedy(options={role: name}) for name in names[:6]]
    raise Misfit(message, file=find.table.origin, remedies=remedies, otherwise=f"say which: {which}")
