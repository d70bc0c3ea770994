"""Force plates: each one is judged by itself, and only those with load are added up.

Force on the foot, forward x and upward y of the paper; of a plate ``my`` is the moment for which CoP = -my / fz. A
plate that measures the force on itself is turned whole: forces and moment, not the CoP.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from design.errors import BadInput
from design.recordings.selection import negated
from design.recordings.table import Array

UNLOADED = 0.05
"""The part of the usual load below which a row, or a plate, is without load."""
LIFTED = 0.02
"""The part of the whole load below which the CoP of one of several plates counts for nothing: it is noise."""

MOST = 200_000
"""Rows by which the usual load of a plate is judged."""

Flags = NDArray[np.bool_]


def some(values: Array) -> Array:
    """The numbers among ``values`` (n,); of a long recording every second, third, ... one."""
    part = values[:: -(-len(values) // MOST)]
    return part[np.isfinite(part)]


def usual_load(force: Array) -> float:
    """The median of a vertical force (n,) [N] where it is more than ``UNLOADED`` times the largest."""
    known = some(force)
    most = float(np.percentile(np.abs(known), 99.0)) if len(known) else 0.0
    standing = known[np.abs(known) > UNLOADED * most]
    return float(np.median(standing)) if len(standing) else 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Quantity:
    """One quantity in SI units (n,), the ``columns`` it comes from, and its ``unit`` there; ``sure``: it is stated.

    ``as_given``: the columns with their signs before the whole plate was turned, if it was. Who gives them in
    ``--columns`` gets this quantity, since the plate is turned then too.
    """

    values: Array
    columns: str
    unit: str
    sure: bool
    as_given: str = ""

    @property
    def option(self) -> str:
        """The columns as they are to be given in ``--columns``."""
        return self.as_given or self.columns

    def turned(self) -> Quantity:
        """With the other sign."""
        return replace(self, values=-self.values, columns=negated(self.columns))

    def turned_with_plate(self) -> Quantity:
        """With the other sign, as every force and moment of its plate."""
        return replace(self.turned(), as_given=self.option)


@dataclass(frozen=True, eq=False, kw_only=True)
class Plate:
    """One force plate.

    ``tag``: its number or side, as the columns' names tell; ``fz``, ``fx``, ``my``, ``cop``: vertical and forward force
    [N], moment [N m] and CoP [m], None if not measured; ``origin``: forward position [m] of the point that the moment
    is about; ``selected``: the roles whose columns the user gave; ``negated``: the user gave fz with a minus; ``kept``:
    the roles that were given then with the sign of a plate that is not turned.
    """

    tag: str
    fz: Quantity
    fx: Quantity | None = None
    my: Quantity | None = None
    cop: Quantity | None = None
    origin: float | None = None
    selected: frozenset[str] = frozenset()
    negated: bool = False
    kept: frozenset[str] = frozenset()

    @property
    def name(self) -> str:
        """How messages call it."""
        return f"plate {self.tag}" if self.tag else f"plate of {self.fz.columns.removeprefix('-')}"

    @property
    def load(self) -> float:
        """The load [N] of a row in which somebody stands on it."""
        return usual_load(self.fz.values)

    @property
    def columns(self) -> str:
        """Its columns by role."""
        parts = {"fz": self.fz, "cop": self.cop, "my": self.my, "fx": self.fx}
        return ", ".join(f"{role}={each.columns}" for role, each in parts.items() if each is not None)

    def from_moment(self) -> Array | None:
        """CoP = -my / fz (n,) [m] from the file's origin if the plate's is known, else from the plate's."""
        if self.my is None:
            return None
        with np.errstate(all="ignore"):
            return (self.origin or 0.0) - self.my.values / np.where(self.fz.values == 0, np.nan, self.fz.values)


def with_load(plates: tuple[Plate, ...], file: str, notes: list[str]) -> tuple[Plate, ...]:
    """The plates that somebody stands on; the others are named in ``notes``. Raises ``BadInput`` if there is none."""
    most = max(abs(plate.load) for plate in plates)
    if most == 0:
        where = f"column{'s' * (len(plates) > 1)} {'+'.join(plate.fz.columns for plate in plates)}"
        message = "is zero in every row, or no number; needs the vertical force of a loaded plate"
        raise BadInput(message, file=file, key=where)
    kept = []
    for plate in plates:
        if abs(plate.load) >= UNLOADED * most:
            kept.append(plate)
        else:
            notes.append(f"{plate.name} is empty ({plate.fz.columns} about {plate.load:.3g} N): left out")
    return tuple(kept)


def check_one_sign(plate: Plate, file: str) -> None:
    """Raise ``BadInput`` for a vertical force that is large in both directions."""
    force = some(plate.fz.values)
    part = float(np.mean(force < -0.5 * abs(plate.load))), float(np.mean(force > 0.5 * abs(plate.load)))
    if min(part) > 0.01:
        message = (
            f"is large and negative in {100 * part[0]:.0f} % of the rows, and positive in {100 * part[1]:.0f} %; needs"
            " the vertical force of a plate, which has one sign; keep one part of the recording, or mend its signs"
        )
        raise BadInput(message, file=file, key=f"column {plate.fz.columns}")


def upright(plate: Plate, notes: list[str], warnings: list[str]) -> Plate:
    """The plate with the forces on the foot: turned whole if its vertical force is negative throughout.

    What the user gave with its own sign, beside a vertical force that the user turned, is kept with a warning.
    """
    if plate.negated:
        for role, each in (("fx", plate.fx), ("my", plate.my)):
            if each is not None and role in plate.kept:
                warnings.append(
                    f"fz={plate.fz.columns} is turned, and {role}={each.columns} keeps its sign as given: a plate that"
                    f" measures the force on itself has both turned, {role}={negated(each.columns)}"
                )
        taken = [
            (role, each) for role, each in (("fx", plate.fx), ("my", plate.my))
            if each is not None and role not in plate.selected
        ]  # fmt: skip
        if taken:
            notes.append(f"turned together with fz={plate.fz.columns}: {', '.join(each.columns for _, each in taken)}")
        roles = {role for role, _ in taken}
        plate = replace(
            plate, fx=plate.fx.turned() if plate.fx and "fx" in roles else plate.fx,
            my=plate.my.turned() if plate.my and "my" in roles else plate.my,
        )  # fmt: skip
    known = some(plate.fz.values)
    standing = known[np.abs(known) > UNLOADED * abs(plate.load)]
    if plate.load >= 0 or float((standing > 0).mean()) > 0.01:
        return plate
    notes.append(
        f"the vertical force {plate.fz.columns} is negative throughout: the force on the plate; all its signs were"
        " turned"
    )
    return replace(
        plate, fz=plate.fz.turned_with_plate(), fx=plate.fx and plate.fx.turned_with_plate(),
        my=plate.my and plate.my.turned_with_plate(),
    )  # fmt: skip


def mixed_signs(plates: tuple[Plate, ...]) -> str:
    """Columns of the forward force of which the user turned some and not others; else empty."""
    parts = [plate.fx.columns for plate in plates if plate.fx and "fx" in plate.selected]
    return "+".join(parts) if len({part.startswith("-") for part in parts}) > 1 else ""


def dropped(plates: tuple[Plate, ...], total: Array, usual: float) -> Flags:
    """Rows in which one of several plates drops out: exactly 0, and the whole load (n,) lacks what it usually bears."""
    lacking = np.zeros(len(total), dtype=bool)
    for plate in plates if len(plates) > 1 else ():
        with np.errstate(invalid="ignore"):
            lacking |= (plate.fz.values == 0) & (total < usual - 0.5 * abs(plate.load))
    return lacking


def lost_cop(cop: Array, loaded: Flags) -> Flags:
    """Loaded rows whose CoP (n,) is exactly 0 between others that are far from it: the plate did not measure one."""
    lost = np.zeros(len(cop), dtype=bool)
    zero = np.flatnonzero(loaded & (cop == 0))
    other = np.flatnonzero(loaded & (cop != 0) & np.isfinite(cop))
    if not len(zero) or len(other) < 8:
        return lost
    usual = float(np.percentile(np.abs(np.diff(cop[other])), 90.0))
    place = np.searchsorted(other, zero)
    before, after = other[np.maximum(place - 1, 0)], other[np.minimum(place, len(other) - 1)]
    nearest = np.minimum(np.abs(cop[before]), np.abs(cop[after]))
    lost[zero[nearest > max(10 * usual, 2e-3)]] = True
    return lost


def together(plates: tuple[Plate, ...], centres: list[Array], total: Array, usual: float) -> Array:
    """The CoP (n,) of all plates: the ``centres`` weighted by the load of their own plate; NaN where none has load."""
    if len(plates) == 1:
        return centres[0]
    moment, load = np.zeros(len(total)), np.zeros(len(total))
    for plate, cop in zip(plates, centres, strict=True):
        with np.errstate(invalid="ignore"):
            bears = plate.fz.values > LIFTED * usual
        load += np.where(bears, plate.fz.values, 0.0)
        moment += np.where(bears, plate.fz.values * cop, 0.0)
    with np.errstate(all="ignore"):
        return np.where(load > 0, moment / load, np.nan)


def added(parts: list[Quantity]) -> Quantity:
    """The sum of a quantity over plates."""
    values = parts[0].values if len(parts) == 1 else np.sum([part.values for part in parts], axis=0)
    return Quantity(
        values=values, columns="+".join(part.columns for part in parts),
        as_given="+".join(part.option for part in parts), unit=parts[0].unit, sure=all(part.sure for part in parts),
    )  # fmt: skip


def _bears(plates: tuple[Plate, ...], plate: Plate, usual: float) -> Flags:
    """Rows in which the CoP of a plate counts."""
    with np.errstate(invalid="ignore"):
        return np.asarray(plate.fz.values > (UNLOADED if len(plates) == 1 else LIFTED) * usual)


def unreadable(plates: tuple[Plate, ...], usual: float) -> Flags:
    """Rows without a number that the sum needs."""
    lost = np.zeros(len(plates[0].fz.values), dtype=bool)
    for plate in plates:
        lost |= np.isnan(plate.fz.values)
        if plate.fx is not None:
            lost |= np.isnan(plate.fx.values)
        bears = _bears(plates, plate, usual)
        for quantity in (plate.cop, plate.my):
            if quantity is not None:
                lost |= bears & np.isnan(quantity.values)
    return lost
