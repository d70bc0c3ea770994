"""Contact forces and CoP of a recording: from its plates, or from the toe and heel force that it has.

Toe and heel force follow from F_T + F_H = load and F_T - F_H = P load / ell, (18), unless the file has them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from design.errors import BadInput
from design.model.body import Biped
from design.recordings import checks
from design.recordings.ankle import from_ankle
from design.recordings.centres import centres_of, say_together, with_origins
from design.recordings.columns import Columns
from design.recordings.finder import check_cells
from design.recordings.plates import (
    UNLOADED,
    Flags,
    Plate,
    Quantity,
    added,
    check_one_sign,
    dropped,
    lost_cop,
    mixed_signs,
    together,
    unreadable,
    upright,
    usual_load,
    with_load,
)
from design.recordings.reading import Reading
from design.recordings.remarks import Remarks, Subject, note
from design.recordings.table import Array, Table

FEWEST = 8
"""The smallest number of rows that a recording may have."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Contact:
    """Contact of the table's rows (n,); ``empty``: rows without load; ``lost``: unreadable, or without a CoP.

    ``taken``: the columns of each role that were used; ``plates``: these with load.
    """

    biped: Biped
    empty: Flags
    lost: Flags
    load: Array | None = None
    F_T: Array | None = None
    F_H: Array | None = None
    P: Array | None = None
    cop: Array | None = None
    horizontal: Array | None = None
    ankle_assumed: bool = False
    taken: dict[str, Quantity] = field(default_factory=dict)
    plates: tuple[Plate, ...] = ()


def contact(
    table: Table, columns: Columns, how: Reading, gaps: Flags, subject: Subject, seconds: float, say: Remarks
) -> Contact:
    """The contact in ``table``, checked against the body and against itself.

    ``gaps`` (n,): rows that are unreadable in another column; ``seconds``: how long the recording lasts.
    """
    if not columns.plates:
        return _cop_alone(table, columns, how, gaps, subject, say)
    file = table.origin

    # each plate by itself: does somebody stand on it, is it the force on the foot?
    plates = _judged(columns, how, file, say)
    total = added([plate.fz for plate in plates])
    usual = abs(usual_load(total.values))

    # rows that are readable, loaded, and have a CoP
    for plate in plates:
        _check_readable(table, how, plate, usual)
    lost, empty = _unusable(plates, total, usual, gaps, say)
    good = ~(gaps | lost | empty)
    _check_rows(good, total, "load and a CoP", file)
    if good.mean() < 0.5:
        say.warnings.append(f"only {100 * good.mean():.0f} % of the rows can be used")

    # the load of all, compared with the body; the CoP of each plate, compared with its moment
    biped = _body(float(total.values[good].mean()), total, columns, subject, file, say)
    if not subject.given:
        say.warnings += checks.sways_up_and_down(total.values, good, seconds, biped.M + biped.m, biped)
    for plate in plates:
        check_one_sign(plate, file)
    sources, centres = centres_of(plates, good, usual, columns, subject, file, say)
    say_together(table, plates, good, sources, say)

    # the sum
    parts = {
        role: added([each for each in quantities if each])
        for role, quantities in (("my", [plate.my for plate in plates]), ("fx", [plate.fx for plate in plates]))
        if all(quantities)
    }
    shared = Contact(
        biped=biped, empty=empty, lost=lost, load=total.values, plates=plates,
        horizontal=parts["fx"].values if "fx" in parts else None,
        taken={"fz": total, **({sources[0]: sources[1]} if sources else {}), **parts},
        cop=None if centres is None else together(plates, centres, total.values, usual),
    )  # fmt: skip
    if {"toe", "heel"} <= set(columns.quantities):
        return _toe_and_heel(shared, columns, subject, good, file, say)
    assert sources is not None
    confirmed = all(plate.my and plate.cop for plate in plates)
    say.warnings += checks.reach(_cop(shared)[good], *sources, biped.ell, seconds, file, confirmed=confirmed)
    return _under_the_foot(shared, columns, how, subject, good, file, say)


def _judged(columns: Columns, how: Reading, file: str, say: Remarks) -> tuple[Plate, ...]:
    """The plates with load, with the forces on the foot; toe and heel force keep their sign."""
    plates = with_load(columns.plates, file, say.notes)
    if "toe" not in columns.quantities:
        plates = tuple(upright(plate, say.notes, say.warnings) for plate in plates)
    if (mixed := mixed_signs(plates)) and len({plate.negated for plate in plates}) == 1:
        say.warnings.append(f"fx={mixed} turns the force of some plates and not of others: do they differ in sign?")
    return with_origins(plates, how, file)


def _unusable(
    plates: tuple[Plate, ...], total: Quantity, usual: float, gaps: Flags, say: Remarks
) -> tuple[Flags, Flags]:
    """Rows without a number or a CoP that the sum needs, and rows without load: drop-outs."""
    lost = unreadable(plates, usual)
    with np.errstate(invalid="ignore"):
        empty = ~gaps & ~lost & ((total.values < UNLOADED * usual) | dropped(plates, total.values, usual))
    for plate in plates:
        if plate.cop is None:
            continue
        loaded = ~(gaps | lost | empty) & (plate.fz.values > UNLOADED * usual)
        gone = lost_cop(plate.cop.values, loaded)
        if gone.any():
            rows = f"{int(gone.sum())} row{'s' * (int(gone.sum()) != 1)}"
            say.notes.append(f"CoP of exactly 0 under load, far from the others, in {rows}: masked")
            lost = lost | gone
    return lost, empty


def _body(mean: float, total: Quantity, columns: Columns, subject: Subject, file: str, say: Remarks) -> Biped:
    """The body that the ``mean`` vertical force [N] fits; its mass follows from it where no spec gives it."""
    foot: dict[str, str] = {
        role: columns.quantities[role].columns for role in ("toe", "heel") if role in columns.quantities
    }
    say.warnings += checks.weight(
        mean, total, subject.biped, given=subject.given, file=file, forces=foot or {"fz": total.option},
        usual=columns.usual,
    )  # fmt: skip
    if subject.given:
        return subject.biped
    biped = replace(subject.biped, M=mean / subject.biped.g - subject.biped.m)
    say.assumed.append(
        f"mass {biped.M + biped.m:.4g} kg from the mean vertical force, so that the mean of F_y is zero (give --spec)"
    )
    return biped


def _cop(shared: Contact) -> Array:
    assert shared.cop is not None
    return shared.cop


def _under_the_foot(
    shared: Contact, columns: Columns, how: Reading, subject: Subject, good: Flags, file: str, say: Remarks
) -> Contact:
    """Toe and heel force from load and CoP, (18), once it is known where the ankle is."""
    biped, load = shared.biped, shared.load
    assert load is not None
    if not subject.given:
        say.assumed.append(_assumed_foot(biped))
    P, place, unknown = from_ankle(_cop(shared), good, how, columns, subject, say, load)
    checks.within(P[good], max(biped.toe, biped.heel), place, file)
    difference = (P - biped.ell * biped.skew) * load / biped.ell
    return replace(shared, F_T=0.5 * (load + difference), F_H=0.5 * (load - difference), P=P, ankle_assumed=unknown)


def _check_readable(table: Table, how: Reading, plate: Plate, usual: float) -> None:
    """Raise ``BadInput`` for cells of a plate that are no numbers, unless nobody stands on it: then none has a CoP."""
    with np.errstate(invalid="ignore"):
        unloaded = plate.fz.values < UNLOADED * usual
    for role, quantity in (("fz", plate.fz), ("cop", plate.cop), ("my", plate.my), ("fx", plate.fx)):
        if quantity is None:
            continue
        missing = np.isnan(quantity.values) & (~unloaded if role in ("cop", "my") else True)
        for name in table.names if "+" in quantity.columns else ():
            if missing.any() and name in quantity.columns.split("+"):
                check_cells(table, how, role, name, missing)
        name = quantity.columns.removeprefix("-")
        if missing.any() and name in table.names:
            check_cells(table, how, role, name, missing)


def _check_rows(good: Flags, total: Quantity, what: str, file: str) -> None:
    if good.sum() < FEWEST:
        message = f"has only {int(good.sum())} rows with {what}; needs at least {FEWEST}"
        raise BadInput(message, file=file, key=f"column{'s' * ('+' in total.columns)} {total.columns}")


def _toe_and_heel(shared: Contact, columns: Columns, subject: Subject, good: Flags, file: str, say: Remarks) -> Contact:
    """The contact with the toe and heel force that the file has; its CoP, if it has one, must agree."""
    toe, heel = columns.get("toe"), columns.get("heel")
    assert toe is not None and heel is not None and shared.load is not None
    biped, cop = shared.biped, shared.cop
    foot = f"foot of the built-in adult-slope, {biped.ell:g} m from ankle to toe and heel"
    with np.errstate(all="ignore"):
        P: Array = np.where(good & (shared.load != 0), biped.pressure(toe, heel), np.nan)
    if cop is not None:
        if not subject.given and (ratio := _foot_ratio(cop, P, good)) is not None:
            biped, P = replace(biped, ell=ratio * biped.ell), ratio * P
            foot = f"{biped.ell:.4g} m from ankle to toe and heel, as toe force, heel force and CoP say"
        formula = "(F_T - F_H) ell / (F_T + F_H)" if not biped.skew else "(F_T toe - F_H heel) / (F_T + F_H)"
        quantity = shared.taken["cop"]
        note(checks.agreement(cop[good], P[good], None, quantity, formula, file, labels={"cop": quantity.columns}), say)
    if not subject.given:
        say.assumed.append(f"{foot} (give --spec)")
    taken = {role: each for role, each in shared.taken.items() if role != "fz"}
    return replace(shared, biped=biped, F_T=toe, F_H=heel, P=P, cop=P if cop is None else cop, taken=taken)


def _cop_alone(table: Table, columns: Columns, how: Reading, gaps: Flags, subject: Subject, say: Remarks) -> Contact:
    """What a CoP without a vertical force tells: where it is, and how near the foot's ends."""
    nothing = np.zeros(len(gaps), dtype=bool)
    quantity = columns.cop
    if quantity is None:
        return Contact(biped=subject.biped, empty=nothing, lost=nothing)
    lost = np.isnan(quantity.values)
    check_cells(table, how, "cop", quantity.columns.removeprefix("-"), lost)
    good = ~(gaps | lost)
    _check_rows(good, quantity, "a CoP", table.origin)
    say.warnings.append(
        "the vertical force is missing: contact forces and the external force need it (fz=COLUMN); the CoP alone is"
        " given"
    )
    say.warnings += checks.reach(quantity.values[good], "cop", quantity, subject.biped.ell, float("inf"), table.origin)
    if not subject.given:
        say.assumed.append(_assumed_foot(subject.biped))
    P, place, unknown = from_ankle(quantity.values, good, how, columns, subject, say, None)
    checks.within(P[good], max(subject.biped.toe, subject.biped.heel), place, table.origin)
    return Contact(
        biped=subject.biped, empty=nothing, lost=lost, P=P, cop=quantity.values, ankle_assumed=unknown,
        taken={"cop": quantity},
    )  # fmt: skip


def _assumed_foot(biped: Biped) -> str:
    return f"foot of the built-in adult-slope, {biped.ell:g} m from ankle to toe and heel (give --spec)"


def _foot_ratio(cop: Array, P: Array, good: Flags) -> float | None:
    """How many times the file's CoP is ``P``, that of the assumed foot by (18); None where that says no foot."""
    if P[good].std() < 1e-6:
        return None
    ratio = float(np.polyfit(P[good], cop[good], 1)[0])
    return ratio if 0.2 < ratio < 5 else None
