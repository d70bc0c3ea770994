"""Which columns belong to which plate: by the user's selection, by the plates' numbers and sides, by their words."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np

from design.errors import BadInput
from design.recordings import names as usual
from design.recordings.axes import axes
from design.recordings.finder import Finder, check_alike, column_unit
from design.recordings.names import Known
from design.recordings.plates import UNLOADED, some, usual_load
from design.recordings.remedies import Misfit, Remedy
from design.recordings.selection import ROLES, Parts, joined, negated
from design.recordings.table import Array, Table
from design.recordings.units import FACTORS

OF_A_PLATE = ("fz", "cop", "my", "fx")
FORCES = ("force", "moment", "cop")
SAME = 0.01
"""How near the load of one plate must be to the sum of the others, to be taken for this sum."""


@dataclass(frozen=True, kw_only=True)
class PlateColumns:
    """The columns of one plate by role, each with its sign; ``selected``: the roles that the user gave."""

    tag: str
    parts: dict[str, tuple[int, int]]
    selected: frozenset[str] = frozenset()


def plate_columns(find: Finder) -> list[PlateColumns]:
    """The columns of each plate, by the user's selection and, for the roles that it leaves out, by usual names."""
    named = {role: candidates(find, role) for role in OF_A_PLATE}
    leading = next((role for role in OF_A_PLATE if find.selected.get(role)), None)
    one = all(len({each.tag for each in find.known.values() if each.kind == kind}) <= 1 for kind in FORCES)
    one = one and len(named["fz"]) <= 1
    if leading is None:
        plates = [PlateColumns(tag=tag, parts={}) for tag in _automatic_tags(find, named, one=one)]
    else:
        choice = find.selected[leading]
        assert choice is not None
        plates = [
            PlateColumns(tag=_tag(find, part[0]) or "", parts={leading: part}, selected=frozenset([leading]))
            for part in choice.parts
        ]
    for role in OF_A_PLATE:
        _check_one_axis(find, role)
        if role == leading:
            continue
        if role in find.selected:
            other = find.selected[role]
            plates = _paired(find, role, other.parts, plates, one=one) if other else plates
        else:
            plates = _completed(find, role, named[role], plates, one=one)
    return plates


def candidates(find: Finder, role: str) -> dict[str, list[int]]:
    """The columns that may hold a ``role`` of a plate by their names, by the plate's tag."""
    by_tag: dict[str, list[int]] = {}
    kind, axis, _ = find.axes.of(role)
    for index, each in find.known.items():
        if each.role == role or (each.kind == kind and each.axis == axis and (find.axes.up or role == "cop")):
            by_tag.setdefault(each.tag, []).append(index)
    return by_tag


def usual_sign(find: Finder, role: str, index: int) -> int:
    """The sign with which a column is the ``role``, as its axis tells; a name that tells no axis has none."""
    kind, axis, sign = find.axes.of(role)
    known = find.known.get(index)
    return sign if known and (known.kind, known.axis) == (kind, axis) else 1


def _check_one_axis(find: Finder, role: str) -> None:
    """Raise ``BadInput`` for selected columns of one role whose names name different axes."""
    choice = find.selected.get(role)
    named = [find.known[index].axis for index, _ in choice.parts if index in find.known] if choice else []
    if choice and len({axis for axis in named if axis}) > 1:
        label = joined(choice.parts, find.table.names)
        message = f"has {role}={label}, whose columns are along different axes ({', '.join(named)}); needs one axis"
        raise BadInput(message, file=find.table.origin)


def left_out(find: Finder, plates: list[PlateColumns]) -> list[str]:
    """Vertical forces in the file that bear load and belong to no plate of the selection, in words.

    None where the selection is the net of all plates, or no plate is named.
    """
    tags = {plate.tag for plate in plates}
    chosen = [abs(usual_load(_si(find, "fz", plate.parts["fz"][0]))) for plate in plates if "fz" in plate.parts]
    used = {plate.parts["fz"][0] for plate in plates if "fz" in plate.parts}
    others = {tag: columns[0] for tag, columns in candidates(find, "fz").items() if tag not in tags and tag != "net"}
    if not chosen or "" in tags or "net" in tags or not find.axes.up:
        return []
    loads = {index: abs(usual_load(_si(find, "fz", index))) for index in others.values() if index not in used}
    whole = sum(chosen)
    return [
        f"{find.table.names[index]} ({load:.4g} N)" for index, load in loads.items()
        if load > UNLOADED * whole and abs(load - whole) > SAME * whole
    ]  # fmt: skip


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
        apart, size = some(np.abs(loads[tag] - others)), some(np.abs(loads[tag]))
        if len(apart) and apart.mean() < SAME * size.mean():
            name = find.table.names[forces[tag][0]]
            find.notes.append(f"{name} is the sum of the other plates' vertical forces")
            return [tag] if tag in named["cop"] or tag in named["my"] else [each for each in tags if each != tag]
    return tags


def _si(find: Finder, role: str, index: int) -> Array:
    return find.table.values[:, index] * FACTORS[ROLES[role]][column_unit(find, role, index)[0]]


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
            check_alike(find, role, own)
        columns.append(own[0] if own else None)
    if role == "fx" and None in columns:
        return plates
    return [
        plate if index is None else replace(plate, parts={**plate.parts, role: (index, usual_sign(find, role, index))})
        for plate, index in zip(plates, columns, strict=True)
    ]


def _paired(find: Finder, role: str, parts: Parts, plates: list[PlateColumns], *, one: bool) -> list[PlateColumns]:
    """The plates with the columns ``parts`` that the user gives for a ``role``: by their names, else in their order."""
    leading = next((each for each in OF_A_PLATE if plates and each in plates[0].selected), "fz")
    loads = [plate.parts[leading] for plate in plates]
    label, own_label = joined(tuple(loads), find.table.names), joined(parts, find.table.names)
    tags, own = [_tag(find, index) for index, _ in loads], [_tag(find, index) for index, _ in parts]
    named = None not in tags and None not in own and not (one and len(plates) == len(parts) == 1)
    same = {index for index, _ in parts}
    if len(parts) != len(plates) or len(same) < len(parts) or (named and set(own) != set(tags)):

        def of(them: list[str | None], count: int) -> str:
            return f"of plate {' and '.join(tag or '?' for tag in them)}" if named else f"({count})"

        message = (
            f"has {leading}={label} {of(tags, len(loads))} and {role}={own_label} {of(own, len(parts))}; needs"
            " columns of the same plates, one of each"
        )
        if role == "cop" and len(parts) == 1 and not own[0]:
            message += "; the CoP of all plates needs the sum of their forces in one column"
        remedies = [Remedy(options={role: ""}), *usual_columns(find, plates)]
        raise Misfit(message, file=find.table.origin, remedies=remedies)
    order = _order(find, loads, parts, tags if named else None, own)
    if order is None:
        order = list(range(len(parts)))
        if len(plates) > 1:
            pairs = ", ".join(
                f"{joined((a,), find.table.names)} with {joined((b,), find.table.names)}"
                for a, b in zip(loads, parts, strict=True)
            )
            find.assumed.append(f"columns of {leading} and {role} belong together in the order given: {pairs}")
    return [
        replace(plate, parts={**plate.parts, role: parts[k]}, selected=plate.selected | {role})
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


def foot_plate(find: Finder) -> list[PlateColumns]:
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
            check_alike(find, role, columns)
            parts[role] = (columns[0], usual_sign(find, role, columns[0]))
    selected = frozenset(role for role in parts if find.selected.get(role))
    return [PlateColumns(tag="", parts=parts, selected=selected)]


def usual_columns(find: Finder, plates: list[PlateColumns]) -> list[Remedy]:
    """The columns of all plates by usual names, or by names that resemble them; none if these are ``plates``."""
    for known in (find.known, _resembling(find.table)):
        try:
            own_axes = find.axes if known is find.known else axes(find.table, find.how, {}, known, [])
            own = plate_columns(replace(find, selected={}, known=known, axes=own_axes, notes=[], assumed=[]))
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
                continue
            remedies = [Remedy(options={**dict.fromkeys(OF_A_PLATE, ""), **options})]
            if "fx" in options:  # the sign with which fewer warnings come is proposed
                remedies.append(Remedy(options={**remedies[0].options, "fx": negated(options["fx"])}))
            return remedies
    return []


def _resembling(table: Table) -> dict[int, Known]:
    """What the names of columns that are not usual ones resemble."""
    names = enumerate(table.names)
    return {index: known for index, name in names if (known := usual.resembled(name)) is not None}
