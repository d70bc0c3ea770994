"""Which column is what: as the user gives it, else by usual names, in SI units and along the file's axes.

Both ways lead to the same ``Plate`` records; what is judged about plates is judged on these.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace

import numpy as np

from design.errors import BadInput
from design.recordings import names as usual
from design.recordings.axes import Axes, axes, by_axis
from design.recordings.names import Known
from design.recordings.plates import Plate, Quantity
from design.recordings.reading import Reading
from design.recordings.remedies import Misfit, Remedy
from design.recordings.selection import ROLES, Parts, Selection, joined, listed, negated, parse
from design.recordings.table import Array, Table
from design.recordings.text import ALLOW_GAPS
from design.recordings.units import FACTORS, Kind, bracketed, factor
from design.recordings.units import listed as units_listed

EXAMPLE = "--columns time=NAME:s,fz=NAME:N,cop=NAME:cm"
KINDS: dict[str, Kind] = {
    "force": "force", "moment": "moment", "cop": "position", "com": "position", "ankle": "position",
}  # fmt: skip
OF_A_PLATE = ("fz", "cop", "my", "fx")
FORCES = ("force", "moment", "cop")
SAME = 0.01
"""How near the load of one plate must be to the sum of the others, to be taken for this sum."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Columns:
    """The ``quantities`` of no plate by role, the ``plates``, and what was noted and ``assumed`` about them.

    ``cop``: where no vertical force was measured; ``selected``: the roles that the user gave; ``usual``: what usual
    names alone would select, if it is another choice.
    """

    quantities: dict[str, Quantity]
    plates: tuple[Plate, ...]
    cop: Quantity | None
    notes: tuple[str, ...]
    assumed: tuple[str, ...]
    selected: frozenset[str]
    usual: tuple[Remedy, ...]

    def every(self) -> list[Quantity]:
        """All that is read, of plates too."""
        of_plates = [part for plate in self.plates for part in (plate.fz, plate.fx, plate.my, plate.cop) if part]
        return [*self.quantities.values(), *of_plates, *([self.cop] if self.cop else [])]

    def get(self, role: str) -> Array | None:
        """The values of a role, or None."""
        quantity = self.quantities.get(role)
        return None if quantity is None else quantity.values


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


@dataclass(frozen=True, kw_only=True)
class PlateColumns:
    """The columns of one plate by role, each with its sign; ``given``: the roles that the user selected."""

    tag: str
    parts: dict[str, tuple[int, int]]
    given: frozenset[str] = frozenset()


def assign(table: Table, how: Reading) -> Columns:
    """The quantities in ``table``; raises ``BadInput`` that lists the columns and shows the option to give."""
    selected = parse(how.columns, table)
    known = {index: found for index, name in enumerate(table.names) if (found := usual.recognise(name))}
    if {"toe_force_n", "heel_force_n"} <= set(table.names):  # our own CSV
        known = {index: found for index, found in known.items() if found.role or not found.kind}
    notes: list[str] = []
    find = Finder(
        table=table, how=how, selected=selected, known=known, notes=notes,
        axes=axes(table, how, selected, known, notes),
    )  # fmt: skip
    parts = _single(find)
    foot = {"toe", "heel"} <= set(parts)
    plates = _own_plate(find) if foot else plate_columns(find)
    _check_enough(find, set(parts), plates)
    quantities = {role: _quantity(find, role, each) for role, each in parts.items()}
    if how.rate is not None and (stamps := quantities.get("time")) and not np.isfinite(stamps.values).all():
        del quantities["time"]
    for role, quantity in quantities.items():
        _check_cells(find, role, parts[role], ~np.isfinite(quantity.values))
    records, cop = _records(find, plates, quantities if foot else None)
    if (find.axes.assumed and any({"cop", "fx", "my"} & set(each.parts) for each in plates)) or "com_x" in parts:
        if find.axes.assumed:
            find.assumed.append(f"{find.axes.forward} points forward, to the toes (give --forward)")
    return Columns(
        quantities=quantities, plates=records, cop=cop, notes=tuple(find.notes), assumed=tuple(find.assumed),
        selected=frozenset(role for role, choice in selected.items() if choice), usual=tuple(_usual(find, plates)),
    )  # fmt: skip


def _single(find: Finder) -> dict[str, Parts]:
    """The columns of the roles that belong to no plate."""
    roles: dict[str, Parts] = {}
    for role in ("time", "angle", "rate", "toe", "heel", "torque"):
        columns = [index for index, each in find.known.items() if each.role == role]
        plain = [index for index in columns if find.table.names[index].lower() == role]
        columns = plain if len(columns) > 1 and len(plain) == 1 else columns
        if role not in find.selected and len(columns) == 1:
            roles[role] = ((columns[0], 1),)
    if find.axes.up:
        for role in ("com_x", "com_y", "ankle_x", "ankle_y"):
            kind, axis, sign = find.axes.of(role)
            columns = by_axis(find.known, kind, None if kind == "com" else ("", "r", "l", "net")).get(axis, [])
            if columns and role not in find.selected:
                if kind == "com":
                    _check_alike(find, role, columns)
                    columns = columns[:1]
                roles[role] = tuple((index, sign) for index in columns)
    for role, choice in find.selected.items():
        if choice is not None and role not in OF_A_PLATE:
            roles[role] = choice.parts
    if not {"toe", "heel"} <= set(roles):
        roles.pop("toe", None)
        roles.pop("heel", None)
    return roles


def candidates(find: Finder, role: str) -> dict[str, list[int]]:
    """The columns that may hold a ``role`` of a plate by their names, by the plate's tag."""
    by_tag: dict[str, list[int]] = {}
    kind, axis, _ = find.axes.of(role)
    for index, each in find.known.items():
        if each.role == role or (each.kind == kind and each.axis == axis and (find.axes.up or role == "cop")):
            by_tag.setdefault(each.tag, []).append(index)
    return by_tag


def _sign(find: Finder, role: str, index: int) -> int:
    """The sign of a column that is known by its axis; a name that says the role has none."""
    return 1 if find.known[index].role else find.axes.of(role)[2]


def plate_columns(find: Finder) -> list[PlateColumns]:
    """The columns of each plate, by the user's selection and, for the roles that it leaves out, by usual names."""
    named = {role: candidates(find, role) for role in OF_A_PLATE}
    given = next((role for role in OF_A_PLATE if find.selected.get(role)), None)
    one = all(len({each.tag for each in find.known.values() if each.kind == kind}) <= 1 for kind in FORCES)
    one = one and len(named["fz"]) <= 1
    if given is None:
        plates = [PlateColumns(tag=tag, parts={}) for tag in _automatic_tags(find, named, one=one)]
    else:
        choice = find.selected[given]
        assert choice is not None
        plates = [
            PlateColumns(tag=_tag(find, part[0]) or "", parts={given: part}, given=frozenset([given]))
            for part in choice.parts
        ]
    for role in OF_A_PLATE:
        if role == given:
            continue
        if role in find.selected:
            other = find.selected[role]
            plates = _paired(find, role, other.parts, plates, one=one) if other else plates
        else:
            plates = _completed(find, role, named[role], plates, one=one)
    return plates


def _automatic_tags(find: Finder, named: dict[str, dict[str, list[int]]], *, one: bool) -> list[str]:
    """The plates in the file: the net of all if there is one, or each."""
    forces = named["fz"]
    if one and forces:
        return list(forces)[:1]
    if not forces:
        return list(named["cop"])
    if "net" in forces:
        return ["net"]
    tags = list(forces)
    loads = {tag: _si(find, "fz", forces[tag][0]) for tag in tags}
    for tag in tags if len(tags) > 2 else ():
        others = np.sum([loads[other] for other in tags if other != tag], axis=0)
        with np.errstate(invalid="ignore"):
            apart, size = np.nanmean(np.abs(loads[tag] - others)), np.nanmean(np.abs(loads[tag]))
        if apart < SAME * size:
            name = find.table.names[forces[tag][0]]
            find.notes.append(f"{name} is the sum of the other plates' vertical forces")
            return [tag] if tag in named["cop"] or tag in named["my"] else [each for each in tags if each != tag]
    return tags


def _si(find: Finder, role: str, index: int) -> Array:
    return find.table.values[:, index] * FACTORS[ROLES[role]][_unit(find, role, index)[0]]


def _tag(find: Finder, index: int) -> str | None:
    """The plate that a column's name names; None if it names none."""
    known = find.known.get(index)
    return known.tag if known and (known.kind or known.role in OF_A_PLATE) else None


def _completed(
    find: Finder, role: str, named: dict[str, list[int]], plates: list[PlateColumns], *, one: bool
) -> list[PlateColumns]:
    """The plates with the columns of a ``role`` that their tags name; of the forward force all plates', or none."""
    columns: list[int | None] = []
    for plate in plates:
        own = named.get(plate.tag, [])
        if not own and (one or (len(plates) == 1 and not plate.tag)) and len(named) == 1:
            own = next(iter(named.values()))
        if own:
            _check_alike(find, role, own)
        columns.append(own[0] if own else None)
    if role == "fx" and None in columns:
        return plates
    return [
        plate if index is None else replace(plate, parts={**plate.parts, role: (index, _sign(find, role, index))})
        for plate, index in zip(plates, columns, strict=True)
    ]


def _paired(find: Finder, role: str, parts: Parts, plates: list[PlateColumns], *, one: bool) -> list[PlateColumns]:
    """The plates with the columns ``parts`` that the user gives for a ``role``: by their names, else in their order."""
    given = next(iter(plates[0].given), "fz") if plates else "fz"
    loads = [plate.parts[given] for plate in plates]
    label, own_label = joined(tuple(loads), find.table.names), joined(parts, find.table.names)
    tags, own = [_tag(find, index) for index, _ in loads], [_tag(find, index) for index, _ in parts]
    named = None not in tags and None not in own and not (one and len(plates) == len(parts) == 1)
    same = {index for index, _ in parts}
    if len(parts) != len(plates) or len(same) < len(parts) or (named and set(own) != set(tags)):

        def of(them: list[str | None], count: int) -> str:
            return f"of plate {' and '.join(tag or '?' for tag in them)}" if named else f"({count})"

        message = (
            f"has {given}={label} {of(tags, len(loads))} and {role}={own_label} {of(own, len(parts))}; needs columns of"
            " the same plates, one of each"
        )
        remedies = [Remedy(options={role: ""}), *_usual(find, plates)]
        raise Misfit(message, file=find.table.origin, remedies=remedies)
    order = _order(find, loads, parts, tags if named else None, own)
    if order is None:
        order = list(range(len(parts)))
        if len(plates) > 1:
            pairs = ", ".join(
                f"{joined((a,), find.table.names)} with {joined((b,), find.table.names)}"
                for a, b in zip(loads, parts, strict=True)
            )
            find.assumed.append(f"columns of {given} and {role} belong together in the order given: {pairs}")
    return [
        replace(plate, parts={**plate.parts, role: parts[k]}, given=plate.given | {role})
        for plate, k in zip(plates, order, strict=True)
    ]


def _order(
    find: Finder, loads: list[tuple[int, int]], parts: Parts, tags: list[str | None] | None, own: list[str | None]
) -> list[int] | None:
    """Which of ``parts`` belongs to each of ``loads``: by the plates' tags, or by the words that tell them apart."""
    if tags is not None:
        return [own.index(tag) for tag in tags]

    def words(columns: Parts | list[tuple[int, int]]) -> list[frozenset[str]]:
        each = [set(re.findall(r"[^\W\d_]+|\d+", find.table.names[index].lower())) for index, _ in columns]
        common = set.intersection(*each)
        return [frozenset(one - common) for one in each]

    mine, theirs = words(loads), words(parts)
    if len(loads) > 1 and set(mine) == set(theirs) and len(set(mine)) == len(mine):
        return [theirs.index(word) for word in mine]
    return None


def _own_plate(find: Finder) -> list[PlateColumns]:
    """The one plate under toe and heel, whose forces are in the file: CoP and forward force, where they are clear."""
    parts: dict[str, tuple[int, int]] = {}
    for role in ("cop", "fx"):
        choice, named = find.selected.get(role), candidates(find, role)
        if choice and len(choice.parts) > 1:
            message = f"has toe and heel force and {role} in {len(choice.parts)} columns; needs one"
            raise BadInput(message, file=find.table.origin)
        if choice:
            parts[role] = choice.parts[0]
        elif role not in find.selected and len(named) == 1:
            columns = next(iter(named.values()))
            _check_alike(find, role, columns)
            parts[role] = (columns[0], _sign(find, role, columns[0]))
    given = frozenset(role for role in parts if find.selected.get(role))
    return [PlateColumns(tag="", parts=parts, given=given)]


def _check_alike(find: Finder, role: str, columns: list[int]) -> None:
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


def _usual(find: Finder, plates: list[PlateColumns]) -> list[Remedy]:
    """The columns of all plates by usual names, or by names that resemble them; none if these are ``plates``."""
    for known in (find.known, _resembling(find.table)):
        other = replace(find, selected={}, known=known, notes=[], assumed=[])
        try:
            own = plate_columns(other)
        except BadInput:
            continue
        options = {
            role: joined(tuple(plate.parts[role] for plate in own), find.table.names)
            for role in OF_A_PLATE if own and all(role in plate.parts for plate in own)
        }  # fmt: skip
        if "cop" in options:
            options.pop("my", None)
        if known is find.known:
            options.pop("fx", None)  # by its plates' names
        if {"fz", "cop"} <= set(options) or {"fz", "my"} <= set(options):
            chosen = [(plate.parts.get("fz"), plate.parts.get("cop")) for plate in own]
            if chosen == [(plate.parts.get("fz"), plate.parts.get("cop")) for plate in plates]:
                return []
            remedies = [Remedy(options={**dict.fromkeys(OF_A_PLATE, ""), **options})]
            if "fx" in options:  # the sign with which fewer warnings come is proposed
                remedies.append(Remedy(options={**remedies[0].options, "fx": negated(options["fx"])}))
            return remedies
    return []


def _resembling(table: Table) -> dict[int, Known]:
    """What the names of columns that are not usual ones resemble."""
    names = enumerate(table.names)
    return {index: known for index, name in names if (known := usual.resembled(name)) is not None}


def _check_enough(find: Finder, roles: set[str], plates: list[PlateColumns]) -> None:
    """Raise ``BadInput`` unless contact forces, a CoP, or the posture follow from the columns."""
    if {"toe", "heel"} <= roles or {"com_x", "com_y", "ankle_x", "ankle_y"} <= roles:
        return
    table, forces = find.table, [plate for plate in plates if "fz" in plate.parts]
    if forces and all("fz" in plate.parts and {"cop", "my"} & set(plate.parts) for plate in plates):
        return
    give = f"give {EXAMPLE}; its columns: {listed(table.names)}"
    remedies = _usual(find, plates)
    places = joined(tuple(plate.parts["cop"] for plate in plates if "cop" in plate.parts), table.names)
    if plates and places and len(plates) > max(len(forces), 1):
        message = f"has the CoP of {len(plates)} plates ({places}), and the vertical force is missing of some"
        raise Misfit(message, file=table.origin, remedies=remedies, otherwise=give)
    if forces:
        _check_units(find)
        names = joined(tuple(plate.parts["fz"] for plate in forces), table.names)
        lacking = [plate for plate in forces if not {"cop", "my"} & set(plate.parts)]
        without = joined(tuple(plate.parts["fz"] for plate in lacking), table.names)
        if len(lacking) < len(forces):  # some plates are complete: perhaps these are all that there are
            whole = [plate for plate in forces if plate not in lacking]
            remedies.append(Remedy(options={"fz": joined(tuple(p.parts["fz"] for p in whole), table.names)}))
            message = (
                f"has more than one column of vertical force ({names}), and no CoP or moment that belongs to {without}"
            )
        else:
            message = f"has a vertical force ({names}) but neither cop nor my was found"
        raise Misfit(message, file=table.origin, remedies=remedies, otherwise=give)
    _check_units(find)
    if len(plates) == 1 and "cop" in plates[0].parts:
        return
    message = (
        "holds no columns that are known by name; needs toe and heel force, or vertical force and CoP (or moment), or"
        " centre of gravity and ankles"
    )
    raise Misfit(message, file=table.origin, remedies=remedies, otherwise=give)


def _check_units(find: Finder) -> None:
    """Raise ``BadInput`` for a column whose name would be known without the unit in its brackets."""
    for index, name in enumerate(find.table.names):
        odd = None if index in find.known else bracketed(name)
        meant = usual.recognise(odd[0]) if odd else None
        if odd and meant:
            kind = ROLES[meant.role] if meant.role else KINDS[meant.kind]
            message = (
                f"states the unit {odd[1]!r}, which is not known; needs one of {units_listed(kind)}: convert the"
                f" column, or give --columns 'NAME={name}:UNIT'; its columns: {listed(find.table.names)}"
            )
            raise BadInput(message, file=find.table.origin, key=f"column {name}")


def _records(
    find: Finder, plates: list[PlateColumns], foot: dict[str, Quantity] | None
) -> tuple[tuple[Plate, ...], Quantity | None]:
    """The plates in SI units; and the CoP if there is no vertical force. ``foot``: toe and heel force of the one."""
    records: list[Plate] = []
    for plate in plates:
        own = {role: _quantity(find, role, (part,)) for role, part in plate.parts.items()}
        if foot is not None:
            toe, heel = foot["toe"], foot["heel"]
            own["fz"] = replace(toe, values=toe.values + heel.values, columns=f"{toe.columns}+{heel.columns}")
        if "fz" not in own:
            return tuple(records), own.get("cop")
        negated = plate.parts.get("fz", (0, 1))[1] < 0 and "fz" in plate.given
        records.append(
            Plate(
                tag=plate.tag, fz=own["fz"], fx=own.get("fx"), my=own.get("my"), cop=own.get("cop"),
                selected=plate.given, negated=negated,
            )
        )  # fmt: skip
    return tuple(records), None


def _quantity(find: Finder, role: str, parts: Parts) -> Quantity:
    """The values of ``role`` in SI: forces and moments of several columns are added, positions are averaged."""
    units = [_unit(find, role, index) for index, _ in parts]
    scales = [sign * FACTORS[ROLES[role]][unit] for (_, sign), (unit, _) in zip(parts, units, strict=True)]
    columns = [find.table.values[:, index] for index, _ in parts]
    arrays = [column if scale == 1 else scale * column for scale, column in zip(scales, columns, strict=True)]
    mean = ROLES[role] in ("position", "time") and len(arrays) > 1
    values = arrays[0] if len(arrays) == 1 else np.mean(arrays, axis=0) if mean else np.sum(arrays, axis=0)
    return Quantity(
        values=values, columns=joined(parts, find.table.names), unit=units[0][0], sure=all(sure for _, sure in units)
    )


def _check_cells(find: Finder, role: str, parts: Parts, missing: np.ndarray) -> None:
    for index, _ in parts:
        check_cells(find.table, find.how, role, find.table.names[index], missing)


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


def _unit(find: Finder, role: str, index: int) -> tuple[str, bool]:
    """The unit of a column, and whether the user or the file states it."""
    kind, name = ROLES[role], find.table.names[index]
    choice = find.selected.get(role)
    known = find.known.get(index)
    stated = find.table.units[index] or (known.unit if known else None)
    if stated and factor(stated, kind) is None:
        message = f"is in {stated}, and {role} is a {kind}; allowed: {', '.join(FACTORS[kind])}"
        raise BadInput(message, file=find.table.origin, key=f"column {name}")
    given = choice.unit if choice else None
    odd = bracketed(name)
    if odd and not stated and not given:
        message = (
            f"states the unit {odd[1]!r}, which is not known; {role} needs one of {units_listed(kind)}: give"
            f" --columns '{role}={name}:UNIT', or convert the column"
        )
        raise BadInput(message, file=find.table.origin, key=f"column {name}")
    if given and stated and given != stated:
        message = f"is in {stated} by the file, and --columns says {given}; leave the unit out, or correct the header"
        raise BadInput(message, file=find.table.origin, key=f"column {name}")
    return given or stated or next(iter(FACTORS[kind])), bool(given or stated)
