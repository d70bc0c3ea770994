"""Which column is what: as the user gives it, else by usual names, in SI units and along the file's axes.

Both ways lead to the same ``Plate`` records; what is judged about plates is judged on these.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from design.errors import BadInput
from design.recordings import names as usual
from design.recordings.axes import axes, by_axis
from design.recordings.balance_board import LOAD, PLACE
from design.recordings.finder import Finder, check_alike, check_cells, quantity_of
from design.recordings.names import Known
from design.recordings.plate_columns import (
    OF_A_PLATE,
    PlateColumns,
    candidates,
    foot_plate,
    left_out,
    plate_columns,
    usual_columns,
    usual_sign,
)
from design.recordings.plates import UNLOADED, Plate, Quantity, some
from design.recordings.reading import Reading
from design.recordings.remedies import Misfit, Remedy
from design.recordings.selection import ROLES, Parts, joined, listed, parse
from design.recordings.table import Array, Table
from design.recordings.units import FACTORS, Kind, bracketed
from design.recordings.units import listed as units_listed

EXAMPLE = "--columns time=NAME:s,fz=NAME:N,cop=NAME:cm"
KINDS: dict[str, Kind] = {
    "force": "force", "moment": "moment", "cop": "position", "com": "position", "ankle": "position",
}  # fmt: skip


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
    warnings: tuple[str, ...]
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


def assign(table: Table, how: Reading) -> Columns:
    """The quantities in ``table``; raises ``BadInput`` that lists the columns and shows the option to give."""
    selected = parse(how.columns, table)
    known = _known(table)
    notes: list[str] = []
    find = Finder(
        table=table, how=how, selected=selected, known=known, notes=notes,
        axes=axes(table, how, selected, known, notes),
    )  # fmt: skip
    parts = _single(find)
    foot = {"toe", "heel"} <= set(parts)
    plates = foot_plate(find) if foot else plate_columns(find)
    _check_enough(find, set(parts), plates)
    quantities = {role: quantity_of(find, role, each) for role, each in parts.items()}
    if how.rate is not None and (stamps := quantities.get("time")) and not np.isfinite(stamps.values).all():
        del quantities["time"]
    for role, quantity in quantities.items():
        _check_cells(find, role, parts[role], ~np.isfinite(quantity.values))
    records, cop = _records(find, plates, quantities if foot else None)
    along = [each.parts[role][0] for each in plates for role in ("cop", "fx", "my") if role in each.parts]
    if find.axes.assumed and ("com_x" in parts or any(not known[k].role for k in along if k in known)):
        find.assumed.append(f"{find.axes.forward} points forward, to the toes (give --forward){_beside(find, records)}")
    missing = [] if foot else left_out(find, plates)
    if missing and any("cop" in each.selected or "fz" in each.selected for each in plates):
        find.warnings.append(f"other plates bear load too, and are left out: {', '.join(missing)}")
    return Columns(
        quantities=quantities, plates=records, cop=cop, notes=tuple(find.notes), assumed=tuple(find.assumed),
        warnings=tuple(find.warnings),
        selected=frozenset(role for role, choice in selected.items() if choice),
        usual=tuple(usual_columns(find, plates)),
    )  # fmt: skip


def _known(table: Table) -> dict[int, Known]:
    """What the names of columns say; a weight is the vertical force where there is no other."""
    known = {index: found for index, name in enumerate(table.names) if (found := usual.recognise(name))}
    if {"toe_force_n", "heel_force_n"} <= set(table.names):  # our own CSV
        return {index: found for index, found in known.items() if found.role or not found.kind}
    if any(each.kind == "force" or each.role in ("fz", "toe") for each in known.values()):
        return known
    if LOAD in table.names and not any(each.kind == "cop" or each.role == "cop" for each in known.values()):
        return {
            **known, table.names.index(LOAD): Known(role="fz", tag="board"),
            table.names.index(PLACE): Known(role="cop", tag="board"),
        }  # fmt: skip
    weights = [index for index, name in enumerate(table.names) if usual.is_weight(name)]
    if len(weights) == 1:
        known[weights[0]] = Known(role="fz", unit=usual.unit_after(table.names[weights[0]]))
    return known


def _beside(find: Finder, plates: tuple[Plate, ...]) -> str:
    """A remark where the plates' CoPs are further apart along the axis assumed to point forward than across it."""
    apart = {}
    most = max((abs(plate.load) for plate in plates), default=0.0)
    loaded = [plate for plate in plates if abs(plate.load) >= UNLOADED * most]
    across = next(axis for axis in "xyz" if axis not in (find.axes.up, find.axes.forward))
    for axis in (find.axes.forward, across):
        columns = [by_axis(find.known, "cop", [plate.tag]).get(axis, []) for plate in loaded]
        if len(loaded) < 2 or not all(columns):
            return ""
        cops = [some(find.table.values[:, each[0]]) for each in columns]
        if not all(map(len, cops)):
            return ""
        apart[axis] = float(np.ptp([np.median(cop) for cop in cops]))
    forward = find.axes.forward
    if apart[forward] <= apart[across]:
        return ""
    return f", though the plates' CoPs are further apart along {forward} than along {across}: feet side by side?"


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
                    check_alike(find, role, columns)
                    columns = columns[:1]
                roles[role] = tuple((index, sign) for index in columns)
    for role, choice in find.selected.items():
        if choice is not None and role not in OF_A_PLATE:
            roles[role] = choice.parts
    if not {"toe", "heel"} <= set(roles):
        roles.pop("toe", None)
        roles.pop("heel", None)
    return roles


def _check_enough(find: Finder, roles: set[str], plates: list[PlateColumns]) -> None:
    """Raise ``BadInput`` unless contact forces, a CoP, or the posture follow from the columns."""
    if {"toe", "heel"} <= roles or {"com_x", "com_y", "ankle_x", "ankle_y"} <= roles:
        return
    table, forces = find.table, [plate for plate in plates if "fz" in plate.parts]
    if forces and all("fz" in plate.parts and {"cop", "my"} & set(plate.parts) for plate in plates):
        return
    give = f"give {EXAMPLE}; its columns: {listed(table.names)}{_means(table)}"
    remedies = usual_columns(find, plates)
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
            several = " of each plate" if len(forces) > 1 else ""
            one = (
                "cop=NAME:cm" if len(forces) == 1 else f"cop={'+'.join(f'NAME{k + 1}' for k in range(len(forces)))}:cm"
            )
            give = f"give --columns {one}, or my=... of the moment; its columns: {listed(table.names)}"
            message = f"has a vertical force ({names}) but neither cop nor my{several} was found"
            if len(forces) > 1 and (of_all := candidates(find, "cop").get("", [])):
                message += f"; {table.names[of_all[0]]} is perhaps that of all: then add the forces up in one column"
        raise Misfit(message, file=table.origin, remedies=remedies, otherwise=give)
    _check_units(find)
    if len(plates) == 1 and "cop" in plates[0].parts:
        return
    message = (
        "holds no columns that are known by name; needs toe and heel force, or vertical force and CoP (or moment), or"
        " centre of gravity and ankles"
    )
    raise Misfit(message, file=table.origin, remedies=remedies, otherwise=give)


def _means(table: Table) -> str:
    """The mean of each column, for a message about a file that names none: the vertical force is told by its size."""
    if not all(name == f"column {index}" for index, name in enumerate(table.names, start=1)) or len(table.names) > 24:
        return ""
    known = [some(column) for column in table.values.T]
    means = ", ".join(f"{column.mean():.3g}" if len(column) else "none" for column in known)
    return f" (means: {means}), given by their numbers, as fz=3"


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
        own = {role: quantity_of(find, role, (part,)) for role, part in plate.parts.items()}
        if foot is not None:
            toe, heel = foot["toe"], foot["heel"]
            own["fz"] = replace(toe, values=toe.values + heel.values, columns=f"{toe.columns}+{heel.columns}")
        if "fz" not in own:
            return tuple(records), own.get("cop")
        fz, fx = own["fz"], own.get("fx")
        if fx is not None and fz.sure and not fx.sure:  # both forces of a plate are written in one unit
            scale = FACTORS["force"][fz.unit] / FACTORS["force"][fx.unit]
            own["fx"] = replace(fx, values=scale * fx.values, unit=fz.unit)
        negated = plate.parts.get("fz", (0, 1))[1] < 0 and "fz" in plate.selected
        records.append(
            Plate(
                tag=plate.tag, fz=own["fz"], fx=own.get("fx"), my=own.get("my"), cop=own.get("cop"),
                selected=plate.selected, negated=negated,
                kept=frozenset(
                    role for role in plate.selected & {"fx", "my"}
                    if negated and plate.parts[role][1] == usual_sign(find, role, plate.parts[role][0])
                ),
            )
        )  # fmt: skip
    return tuple(records), None


def _check_cells(find: Finder, role: str, parts: Parts, missing: np.ndarray) -> None:
    for index, _ in parts:
        check_cells(find.table, find.how, role, find.table.names[index], missing)
