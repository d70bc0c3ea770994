"""Which column is what: from ``--columns``, else from usual names, in SI units and along the user's axes.

Force on the foot, forward x and upward y of the paper; ``my`` is the moment for which CoP = -my / fz.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from design.errors import BadInput
from design.recordings import names as usual
from design.recordings.reading import Reading
from design.recordings.selection import ROLES, Wish, listed, parse
from design.recordings.table import Array, Table
from design.recordings.units import FACTORS, Kind, bracketed, factor
from design.recordings.units import listed as units_listed

EXAMPLE = "--columns time=NAME:s,fz=NAME:N,cop=NAME:cm"
KINDS: dict[str, Kind] = {
    "force": "force", "moment": "moment", "cop": "position", "com": "position", "ankle": "position",
}  # fmt: skip
DOMINANT = 3.0
"""How many times the other components the vertical one must be, to be taken for it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Quantity:
    """One quantity in SI units (n,), the ``columns`` it comes from, and its ``unit`` there; ``sure``: it is stated."""

    values: Array
    columns: str
    unit: str
    sure: bool


@dataclass(frozen=True, eq=False, kw_only=True)
class Columns:
    """The quantities by role, the ``axes`` as taken (up, forward), and what was ``said`` and ``assumed``.

    ``told``: the roles that the user gave.
    """

    quantities: dict[str, Quantity]
    axes: tuple[str, str] | None
    said: tuple[str, ...]
    assumed: tuple[str, ...]
    told: frozenset[str]

    def get(self, role: str) -> Array | None:
        """The values of a role, or None."""
        found = self.quantities.get(role)
        return None if found is None else found.values


@dataclass(eq=False, kw_only=True)
class _Finder:
    """What is known while columns are assigned."""

    table: Table
    how: Reading
    wishes: dict[str, Wish | None]
    known: dict[int, usual.Known]
    ambiguous: dict[str, list[str]] = field(default_factory=dict)
    said: list[str] = field(default_factory=list)
    assumed: list[str] = field(default_factory=list)


def assign(table: Table, how: Reading) -> Columns:
    """The quantities in ``table``; raises ``BadInput`` that lists the columns and shows the option to give."""
    wishes = parse(how.columns, table)
    known = {index: found for index, name in enumerate(table.names) if (found := usual.recognise(name))}
    own = {"toe_force_n", "heel_force_n"} <= set(table.names)
    if own:
        known = {index: found for index, found in known.items() if found.role or not found.kind}
    find = _Finder(table=table, how=how, wishes=wishes, known=known)
    parts = _scalars(find)
    up = _vertical(find)
    forward = _forward(find, up)
    _along(find, parts, up, forward)
    for role, wish in wishes.items():
        if wish is None:
            parts.pop(role, None)
        else:
            parts[role] = wish.parts
    if how.rate is not None and any(index in table.faults for index, _ in parts.get("time", ())):
        del parts["time"]
    axes = (up, forward) if up and any(not _scalar(find, role) for role in parts) else None
    _check_enough(find, set(parts))
    _pair(find, parts)
    loads = {role: _parts(find, role, parts[role]) for role in parts if role == "fz"}
    quantities = {role: _quantity(find, role, parts[role], loads.get("fz")) for role in parts}
    told = frozenset(role for role, wish in wishes.items() if wish)
    return Columns(quantities=quantities, axes=axes, said=tuple(find.said), assumed=tuple(find.assumed), told=told)


Parts = tuple[tuple[int, int], ...]


def _scalar(find: _Finder, role: str) -> bool:
    """Whether ``role`` does not depend on the axes."""
    if find.wishes.get(role) is not None:
        return True
    return role in ("time", "angle", "rate", "toe", "heel", "torque")


def _scalars(find: _Finder) -> dict[str, Parts]:
    """Roles that a name alone says."""
    found: dict[str, Parts] = {}
    for role in usual.SCALARS:
        if role in find.wishes:
            continue
        columns = [index for index, each in find.known.items() if each.role == role]
        if len(columns) > 1:
            plain = [index for index in columns if find.table.names[index].lower() == role]
            columns = plain if len(plain) == 1 else columns
        if len(columns) == 1:
            found[role] = ((columns[0], 1),)
        elif columns:
            find.ambiguous[role] = [find.table.names[index] for index in columns]
    if not {"toe", "heel"} <= {*found, *(role for role, wish in find.wishes.items() if wish)}:
        found.pop("toe", None)
        found.pop("heel", None)
    return found


def _groups(find: _Finder, kind: str) -> dict[str, dict[str, list[int]]]:
    """Columns of a ``kind`` by plate and axis."""
    groups: dict[str, dict[str, list[int]]] = {}
    for index, each in find.known.items():
        if each.kind == kind:
            groups.setdefault(each.tag, {}).setdefault(each.axis, []).append(index)
    return groups


def _plate(find: _Finder, kind: str) -> dict[str, int]:
    """Columns of a ``kind`` by axis, of the plate that there is, or of the net of several; empty if in doubt."""
    groups = _groups(find, kind)
    chosen = groups.get("net") or (next(iter(groups.values())) if len(groups) == 1 else None)
    if chosen is not None:
        return {axis: columns[0] for axis, columns in chosen.items()}
    if groups:
        find.ambiguous[kind] = [
            find.table.names[index] for group in groups.values() for columns in group.values() for index in columns
        ]
    return {}


def _check_single(find: _Finder, role: str, columns: list[int]) -> None:
    """Raise ``BadInput`` for two ``columns`` that may both be ``role``, unless they hold the same."""
    first = find.table.values[:, columns[0]]
    others = [index for index in columns[1:] if not np.array_equal(first, find.table.values[:, index], equal_nan=True)]
    if not others and len({find.table.units[index] for index in columns}) == 1:
        return
    names = [find.table.names[index] for index in columns]
    options = " or ".join(f"--columns '{role}={name}'" for name in names)
    message = f"has more than one column that may be {role}: {', '.join(names)}; say which: {options}"
    raise BadInput(message, file=find.table.origin)


def _tags(find: _Finder, parts: Parts) -> tuple[str | None, ...]:
    """The plates that columns belong to, None where a name does not say."""
    known = [find.known.get(index) for index, _ in parts]
    return tuple(each.tag if each and each.kind else None for each in known)


def _one_plate(find: _Finder) -> bool:
    """Whether the file has the forces of one plate, and at most one tag of the other kinds."""
    return all(len(_groups(find, kind)) <= 1 for kind in ("force", "moment", "cop"))


def _of_plates(find: _Finder, kind: str, along: str, tags: tuple[str | None, ...]) -> list[int]:
    """The columns of a ``kind`` along an axis of the plates ``tags`` of the load; empty unless all have one."""
    groups = _groups(find, kind)
    if None in tags or _one_plate(find):
        return [_plate(find, kind)[along]] if len(groups) == 1 and along in _plate(find, kind) else []
    if len(tags) > 1 and kind == "moment":
        return []  # each about its own plate's origin
    found = [index for tag in tags for index in groups.get(tag or "", {}).get(along, [])[:1]]
    return found if len(found) == len(tags) else []


def _told_plate(find: _Finder) -> dict[str, int]:
    """Columns of force by axis of the first plate that the user names; empty if none is known."""
    told = find.wishes.get("fz")
    tag = _tags(find, told.parts)[0] if told else None
    group = {} if tag is None else _groups(find, "force").get(tag, {})
    return {axis: columns[0] for axis, columns in group.items()}


def _vertical(find: _Finder) -> str:
    """The axis that points up: as the user says and the data confirm, or as the data leave no doubt; else empty."""
    wish = find.how.up.lower() if find.how.up else None
    if wish not in (None, "y", "z"):
        message = f"is {wish[:20]!r}; needs y or z"
        raise BadInput(message, key="--up")
    force = _plate(find, "force") or _told_plate(find)
    body, ankle = _plate(find, "com"), _sides(find, "ankle")
    sizes: dict[str, float] = {}
    if force:
        what = "force"
        for axis, index in force.items():
            column = find.table.values[:, index] * FACTORS["force"].get(find.table.units[index] or "N", 1.0)
            loaded = column[np.isfinite(column) & (column != 0)]
            sizes[axis] = abs(float(np.median(loaded))) if len(loaded) else 0.0
    elif body:
        what = "height of the centre of gravity"
        for axis, index in body.items():
            low = [_mean(find.table.values[:, each]) for each in ankle.get(axis, ())]
            sizes[axis] = abs(_mean(find.table.values[:, index]) - (float(np.mean(low)) if low else 0.0))
    else:
        return wish or ""
    ranked = sorted(sizes, key=lambda axis: -sizes[axis])
    top = ranked[0]
    clear = len(ranked) == 1 or sizes[top] > DOMINANT * sizes[ranked[1]]
    figures = ", ".join(f"{axis} {sizes[axis]:.4g}" for axis in sorted(sizes))
    if wish is not None:
        if wish not in sizes or (clear and top != wish):
            message = f"is {wish}, and the file's {what} is largest along {top} (mean {figures}); give --up {top}"
            raise BadInput(message, file=find.table.origin, key="--up")
        return wish
    needed = {"fz", "cop"} if force else {"com_x", "com_y"}
    if all(find.wishes.get(role) for role in needed):
        return top if clear and top != "x" else ""
    if not clear or top == "x":
        message = f"leaves open which axis points up (mean {what}: {figures}); give --up y or --up z, or --columns"
        raise BadInput(message, file=find.table.origin)
    find.said.append(f"{top} points up (mean {what}: {figures})")
    return top


def _mean(column: Array) -> float:
    known = column[np.isfinite(column)]
    return float(known.mean()) if len(known) else 0.0


def _forward(find: _Finder, up: str) -> str:
    wish = find.how.forward.lower() if find.how.forward else None
    if wish is None:
        named = find.wishes.get("cop") or find.wishes.get("com_x")
        known = find.known.get(named.parts[0][0]) if named and len(named.parts) == 1 else None
        if named and known and known.axis and known.axis != up:
            return ("-" if named.parts[0][1] < 0 else "") + known.axis
        return "z" if up == "x" else "x"
    if wish.lstrip("-+") not in ("x", "y", "z") or len(wish) > 2:
        message = f"is {wish[:20]!r}; needs x, -x, y, -y, z or -z"
        raise BadInput(message, key="--forward")
    if wish.lstrip("-+") == up:
        message = f"is {wish}, and {up} points up; needs a horizontal axis"
        raise BadInput(message, key="--forward")
    return wish.lstrip("+")


def _along(find: _Finder, parts: dict[str, Parts], up: str, forward: str) -> None:
    """Add the roles along the axes ``up`` and ``forward`` to ``parts``."""
    if not up:
        return
    axis, sign = forward[-1], -1 if forward.startswith("-") else 1
    side = next(a for a in "xyz" if a not in (axis, up))
    turn = sign if (up, axis) in (("x", "y"), ("y", "z"), ("z", "x")) else -sign  # side axis = up x forward
    before = set(parts)
    wanted = {
        "fz": ("force", up, 1), "fx": ("force", axis, sign), "my": ("moment", side, turn), "cop": ("cop", axis, sign),
        "com_x": ("com", axis, sign), "com_y": ("com", up, 1),
    }  # fmt: skip
    told = find.wishes.get("fz")
    tags = _tags(find, told.parts) if told else None
    for role, (kind, along, its) in wanted.items():
        if role in find.wishes:
            continue
        if tags is not None and kind in ("force", "moment", "cop"):
            columns = _of_plates(find, kind, along, tags)
        else:
            plate = _plate(find, kind)
            columns = [plate[along]] if along in plate else []
        for index in columns:
            its_tag = find.known[index].tag
            alike = _groups(find, kind)[its_tag][along]
            _check_single(find, role, [*(first for first, _ in parts.get(role, ())), *alike])
        if columns and role not in parts:
            parts[role] = tuple((index, its) for index in columns)
    ankle = _sides(find, "ankle")
    for role, along, its in (("ankle_x", axis, sign), ("ankle_y", up, 1)):
        if role not in find.wishes and along in ankle:
            parts[role] = tuple((index, its) for index in ankle[along])
    axis_told = find.wishes.get("cop") or find.wishes.get("com_x")
    if find.how.forward is None and not axis_told and set(parts) - before - {"fz", "com_y", "ankle_y"}:
        find.assumed.append(f"{axis} points forward, to the toes (give --forward)")


def _sides(find: _Finder, kind: str) -> dict[str, list[int]]:
    """Columns of a ``kind`` by axis, right and left together."""
    found: dict[str, list[int]] = {}
    for index, each in find.known.items():
        if each.kind == kind and each.tag in ("", "r", "l", "net"):
            found.setdefault(each.axis, []).append(index)
    return found


def _check_enough(find: _Finder, roles: set[str]) -> None:
    """Raise ``BadInput`` unless the contact forces, or the posture, follow from ``roles``."""
    contact = {"toe", "heel"} <= roles or ("fz" in roles and roles & {"cop", "my"})
    posture = {"com_x", "com_y", "ankle_x", "ankle_y"} <= roles
    if contact or posture:
        return
    columns = listed(find.table.names)
    for index, name in enumerate(find.table.names):
        odd = None if index in find.known else bracketed(name)
        meant = usual.recognise(odd[0]) if odd else None
        if odd and meant:
            kind = ROLES[meant.role] if meant.role else KINDS[meant.kind]
            message = (
                f"states the unit {odd[1]!r}, which is not known; needs one of {units_listed(kind)}: convert the"
                f" column, or give --columns 'NAME={name}:UNIT'; its columns: {columns}"
            )
            raise BadInput(message, file=find.table.origin, key=f"column {name}")
    if "fz" in roles and not find.ambiguous:
        message = f"has a vertical force but neither cop nor my was found; give them: {EXAMPLE}; its columns: {columns}"
    elif find.ambiguous:
        which = "; ".join(f"{kind}: {listed(found, 12)}" for kind, found in find.ambiguous.items())
        joined = ",".join(filter(None, (_joined(find, "fz", "force"), _joined(find, "cop", "cop"))))
        example = f"--columns '{joined}'" if joined else EXAMPLE
        message = (
            f"has more than one column of a kind ({which}); say which, or join plates with +, as {example}; its"
            f" columns: {columns}"
        )
    else:
        message = (
            "holds no columns that are known by name; needs toe and heel force, or vertical force and CoP (or moment),"
            f" or centre of gravity and ankles: {EXAMPLE}; its columns: {columns}"
        )
    raise BadInput(message, file=find.table.origin)


def _joined(find: _Finder, role: str, kind: str) -> str:
    """The plates' columns of a kind joined, as an example: the largest component of force, the first of CoP."""
    axes: dict[str, list[int]] = {}
    for index, each in find.known.items():
        if each.kind == kind:
            axes.setdefault(each.axis, []).append(index)
    if not axes:
        return ""

    def size(axis: str) -> float:
        return float(np.abs(np.nan_to_num(find.table.values[:, axes[axis][0]])).mean())

    best = max(axes, key=size) if kind == "force" else min(axes)
    return f"{role}=" + "+".join(find.table.names[index] for index in axes[best])


def _pair(find: _Finder, parts: dict[str, Parts]) -> None:
    """Put the CoP's columns in the order of the plates of the load; raise ``BadInput`` where these are not the same.

    So are ``fx`` and ``my`` checked that the user gives.
    """
    if "fz" not in parts or {"toe", "heel"} <= set(parts) or _one_plate(find):
        return
    tags = _tags(find, parts["fz"])
    names = "+".join(find.table.names[index] for index, _ in parts["fz"])
    for role in ("cop", "fx", "my"):
        if role not in parts:
            continue
        own, several = _tags(find, parts[role]), len(parts[role]) > 1
        its = "+".join(find.table.names[index] for index, _ in parts[role])
        if None in tags or None in own:
            if not several or role != "cop":
                continue
            message = (
                f"does not say which plate each column of fz={names} and of cop={its} belongs to; needs names with the"
                " plate's number, as Fz1, COPx1: rename the columns, or join the plates before"
            )
            raise BadInput(message, file=find.table.origin)
        if len(set(own)) < len(own) or set(own) != set(tags):
            message = (
                f"has fz={names} of plate {_plates(tags)} and {role}={its} of plate {_plates(own)}; needs columns of"
                f" the same plates: give --columns, or {role}=none"
            )
            raise BadInput(message, file=find.table.origin)
        parts[role] = tuple(parts[role][own.index(tag)] for tag in tags)


def _plates(tags: tuple[str | None, ...]) -> str:
    return " and ".join(tag or "without a number" for tag in tags)


def _quantity(find: _Finder, role: str, parts: Parts, loads: list[Array] | None) -> Quantity:
    """The values of ``role`` in SI: forces and moments of several columns are added, positions are averaged.

    Centres of pressure of several plates are weighted by their loads where there are as many of these.
    """
    arrays = _parts(find, role, parts)
    unit, sure = _unit(find, role, parts[0][0])
    label = "+".join(("-" if sign < 0 else "") + find.table.names[index] for index, sign in parts)
    if ROLES[role] != "position" and role != "time":
        values = np.sum(arrays, axis=0)
    elif role == "cop" and loads is not None and len(loads) == len(arrays) > 1:
        total = np.sum(loads, axis=0)
        with np.errstate(all="ignore"):
            values = np.sum([load * x for load, x in zip(loads, arrays, strict=True)], axis=0) / total
        values = np.where(total == 0, 0.0, values)
        find.said.append("CoP of the plates together: weighted by their loads")
    else:
        values = np.mean(arrays, axis=0)
    return Quantity(values=values, columns=label, unit=unit, sure=sure)


def _parts(find: _Finder, role: str, parts: Parts) -> list[Array]:
    arrays = []
    for index, sign in parts:
        _check_cells(find, role, index)
        unit, _ = _unit(find, role, index)
        arrays.append(sign * FACTORS[ROLES[role]][unit] * find.table.values[:, index])
    return arrays


def _check_cells(find: _Finder, role: str, index: int) -> None:
    fault, name = find.table.faults.get(index), find.table.names[index]
    if fault is None:
        return
    if fault.count >= len(find.table.values):
        other = ", or give --rate HZ" if role == "time" else ""
        message = f"holds no numbers; choose another with --columns{other}; the file's: {listed(find.table.names)}"
        raise BadInput(message, file=find.table.origin, key=f"column {name}")
    if find.how.allow_gaps:
        return
    what = f"is {fault.text[:40]!r}" if fault.text else "is empty"
    more = f" (and {fault.count - 1} more such cells)" if fault.count > 1 else ""
    message = f"{what}; needs a number{more}; mend it, or mask such rows with --allow-gaps"
    raise BadInput(message, file=find.table.origin, key=f"{find.table.place} {fault.line}, column {name}")


def _unit(find: _Finder, role: str, index: int) -> tuple[str, bool]:
    """The unit of a column, and whether the user or the file states it."""
    kind, name = ROLES[role], find.table.names[index]
    wish = find.wishes.get(role)
    known = find.known.get(index)
    stated = find.table.units[index] or (known.unit if known else None)
    if stated and factor(stated, kind) is None:
        message = f"is in {stated}, and {role} is a {kind}; allowed: {', '.join(FACTORS[kind])}"
        raise BadInput(message, file=find.table.origin, key=f"column {name}")
    said = wish.unit if wish else None
    odd = bracketed(name)
    if odd and not stated and not said:
        message = (
            f"states the unit {odd[1]!r}, which is not known; {role} needs one of {units_listed(kind)}: give"
            f" --columns '{role}={name}:UNIT', or convert the column"
        )
        raise BadInput(message, file=find.table.origin, key=f"column {name}")
    if said and stated and said != stated:
        message = f"is in {stated} by the file, and --columns says {said}; leave the unit out, or correct the header"
        raise BadInput(message, file=find.table.origin, key=f"column {name}")
    return said or stated or next(iter(FACTORS[kind])), bool(said or stated)
