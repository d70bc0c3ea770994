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
    file = table.origin
    if not columns.plates:
        return _cop_alone(table, columns, how, gaps, subject, say)

    # each plate by itself: is there a load on it, is it the force on the foot, are its cells readable?
    plates = with_load(columns.plates, file, say.notes)
    if columns.get("toe") is None:
        plates = tuple(upright(plate, say.notes, say.warnings) for plate in plates)
    plates = with_origins(plates, how, file)
    total = added([plate.fz for plate in plates])
    usual = abs(usual_load(total.values))
    for plate in plates:
        _check_readable(table, how, plate, usual)
    lost = unreadable(plates, usual)
    with np.errstate(invalid="ignore"):
        empty = ~gaps & ~lost & ((total.values < UNLOADED * usual) | dropped(plates, total.values, usual))
    good = ~(gaps | lost | empty)
    _check_rows(good, total, "load", file)

    # the CoP of each plate, compared with its moment
    sources, centres = centres_of(plates, good, usual, columns, subject, file, say)
    for plate, cop in zip(plates, centres or [], strict=False):
        gone = lost_cop(cop, good & (plate.fz.values > UNLOADED * usual))
        if gone.any():
            count = int(gone.sum())
            say.notes.append(
                f"CoP of exactly 0 under load, far from the others, in {count} row{'s' * (count != 1)}: masked"
            )
            lost, good = lost | gone, good & ~gone
    _check_rows(good, total, "load and a CoP", file)
    if good.mean() < 0.5:
        say.warnings.append(f"only {100 * good.mean():.0f} % of the rows can be used")

    if (mixed := mixed_signs(plates)) and len({plate.negated for plate in plates}) == 1:
        say.warnings.append(f"fx={mixed} turns the force of some plates and not of others: do they differ in sign?")

    # the sum of the plates, compared with the body
    horizontal = added([plate.fx for plate in plates if plate.fx]) if all(plate.fx for plate in plates) else None
    taken = {"fz": total, **({sources[0]: sources[1]} if sources else {})}
    if all(plate.my for plate in plates):
        taken["my"] = added([plate.my for plate in plates if plate.my])
    if horizontal is not None:
        taken["fx"] = horizontal
    mean = float(total.values[good].mean())
    say.warnings += checks.weight(mean, total, subject.biped, given=subject.given, file=file, usual=columns.usual)
    biped = subject.biped
    if not subject.given:
        biped = replace(biped, M=mean / biped.g - biped.m)
        say.assumed.append(
            f"mass {biped.M + biped.m:.4g} kg from the mean vertical force, so that the mean of F_y is zero"
            " (give --spec)"
        )
    say_together(table, plates, good, sources, say)
    fx = None if horizontal is None else horizontal.values
    combined = None if centres is None else together(plates, centres, total.values, usual)
    shared = Contact(
        biped=biped,
        empty=empty,
        lost=lost,
        load=total.values,
        horizontal=fx,
        taken=taken,
        plates=plates,
        cop=combined,
    )
    if columns.get("toe") is not None and columns.get("heel") is not None:
        return _toe_and_heel(shared, columns, subject, good, file, say)
    if not subject.given:
        say.assumed.append(
            f"foot of the built-in adult-slope, {biped.ell:g} m from ankle to toe and heel (give --spec)"
        )
    assert combined is not None
    assert sources is not None
    confirmed = all(plate.my and plate.cop for plate in plates)
    say.warnings += checks.reach(combined[good], *sources, biped.ell, seconds, file, confirmed=confirmed)
    P, place, unknown = from_ankle(combined, good, how, columns, subject, say, total.values)
    checks.within(P[good], max(biped.toe, biped.heel), place, file)
    difference = (P - biped.ell * biped.skew) * total.values / biped.ell  # (18)
    return replace(
        shared, F_T=0.5 * (total.values + difference), F_H=0.5 * (total.values - difference), P=P,
        ankle_assumed=unknown,
    )  # fmt: skip


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
