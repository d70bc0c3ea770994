"""Contact forces and CoP of a recording: from its plates, or from the toe and heel force that it has.

Toe and heel force follow from F_T + F_H = load and F_T - F_H = P load / ell, (18), unless the file has them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from design.errors import BadInput
from design.model.body import Biped
from design.recordings import checks
from design.recordings.columns import Columns, check_cells
from design.recordings.plates import (
    LIFTED,
    UNLOADED,
    Flags,
    Plate,
    Quantity,
    added,
    dropped,
    lost_cop,
    mixed_signs,
    some,
    together,
    upright,
    with_load,
)
from design.recordings.reading import Reading
from design.recordings.remedies import Misfit, Remedy
from design.recordings.table import Array, Table
from design.recordings.units import FACTORS, factor, unit_of

FEWEST = 8
"""The smallest number of rows that a recording may have."""


@dataclass(eq=False, kw_only=True)
class Remarks:
    """What is said about a recording: what was noted, what was assumed, and what warns."""

    notes: list[str] = field(default_factory=list)
    assumed: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


@dataclass(frozen=True, eq=False, kw_only=True)
class Subject:
    """Who stands on the plates: ``biped``, whether it is the user's spec (``given``), and where the law holds the CoP.

    ``target``: P_d [m] from the ankle.
    """

    biped: Biped
    given: bool
    target: float = 0.0


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
    plates = _with_origins(plates, how, file)
    total = added([plate.fz for plate in plates])
    usual = _usual_load(total.values)
    for plate in plates:
        _check_readable(table, how, plate, usual)
    lost = _unreadable(plates, usual)
    with np.errstate(invalid="ignore"):
        empty = ~gaps & ~lost & ((total.values < UNLOADED * usual) | dropped(plates, total.values, usual))
    good = ~(gaps | lost | empty)
    _check_rows(good, total, "load", file)

    # the CoP of each plate, compared with its moment
    sources, centres = _centres(plates, good, usual, columns, subject, file, say)
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
    _say_together(table, plates, good, sources, say)
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


def _usual_load(total: Array) -> float:
    known = some(total)
    most = float(np.percentile(np.abs(known), 99.0)) if len(known) else 0.0
    standing = known[np.abs(known) > UNLOADED * most]
    return abs(float(np.median(standing))) if len(standing) else 0.0


def _bears(plates: tuple[Plate, ...], plate: Plate, usual: float) -> Flags:
    """Rows in which the CoP of a plate counts."""
    with np.errstate(invalid="ignore"):
        return np.asarray(plate.fz.values > (UNLOADED if len(plates) == 1 else LIFTED) * usual)


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


def _unreadable(plates: tuple[Plate, ...], usual: float) -> Flags:
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


def _check_rows(good: Flags, total: Quantity, what: str, file: str) -> None:
    if good.sum() < FEWEST:
        message = f"has only {int(good.sum())} rows with {what}; needs at least {FEWEST}"
        raise BadInput(message, file=file, key=f"column{'s' * ('+' in total.columns)} {total.columns}")


def _centres(
    plates: tuple[Plate, ...], good: Flags, usual: float, columns: Columns, subject: Subject, file: str, say: Remarks
) -> tuple[tuple[str, Quantity] | None, list[Array] | None]:
    """The role and columns that the CoP follows from, and the CoP of each plate (n,) [m]; None if it has none."""
    cops = [plate.cop for plate in plates if plate.cop]
    moments = [plate.my for plate in plates if plate.my]
    labels = {"cop": "+".join(each.columns for each in cops), "my": "+".join(each.columns for each in moments)}
    for plate in plates:
        rows = good & (plate.fz.values > UNLOADED * usual)
        moment = plate.from_moment()
        if plate.cop is None or moment is None or not rows.any():
            continue
        tilt = None if plate.fx is None else plate.fx.values[rows] / plate.fz.values[rows]
        formula = "-my / fz" if len(plates) == 1 else f"-my / fz of {plate.name}"
        found = checks.agreement(
            plate.cop.values[rows], moment[rows], tilt, plate.cop, formula, file, labels=labels, moment=plate.my
        )
        _note(found, say)
    if len(cops) == len(plates):
        return ("cop", added(cops)), [each.values for each in cops]
    if len(moments) == len(plates):
        _check_origins(plates, good, usual, columns, subject.biped.ell, file, say)
        say.notes.append(f"CoP from the moment{'s' * (len(plates) > 1)}: -my / fz")
        return ("my", added(moments)), [each for plate in plates if (each := plate.from_moment()) is not None]
    if columns.get("toe") is not None:
        return None, None
    lacking = ", ".join(plate.name for plate in plates if plate.cop is None)
    message = f"has no CoP of {lacking}, which bears load; needs the CoP, or the moment, of every plate with load"
    raise BadInput(message, file=file)


def _check_origins(
    plates: tuple[Plate, ...], good: Flags, usual: float, columns: Columns, ell: float, file: str, say: Remarks
) -> None:
    """Raise ``BadInput`` for moments of several plates, each about its own origin, unless these are known or near."""
    if len(plates) == 1 or all(plate.origin is not None for plate in plates):
        return
    centres = [each for plate in plates if (each := plate.from_moment()) is not None]
    rows = [good & (plate.fz.values > UNLOADED * usual) for plate in plates]
    # feet stand side by side: what is further apart than a foot is long was measured about different points
    apart = checks.apart(plates, centres, rows, ell)
    label = "+".join(plate.my.columns for plate in plates if plate.my)
    key = f"columns {label}"
    if apart:
        message = (
            f"CoP is missing, and -my / fz puts it at {apart}: the moments are each about the origin of their own"
            " plate; give the CoP of each plate, or --origins X1,X2:UNIT, where these origins are on the forward axis"
        )
        raise BadInput(message, file=file, key=key)
    if "my" not in columns.selected:
        message = "CoP is missing; the moments are each about the origin of their own plate"
        remedy = Remedy(options={"my": label}, when=" if these are at one forward position (else --origins X1,X2:UNIT)")
        raise Misfit(
            message, file=file, key=key, remedies=[remedy], otherwise="give the CoP of each plate, or --origins"
        )
    say.assumed.append(f"the moments {label} are about points at one forward position (give --origins)")


def _with_origins(plates: tuple[Plate, ...], how: Reading, file: str) -> tuple[Plate, ...]:
    """The plates with the forward positions of their origins, as the user gives them."""
    if how.origins is None:
        return plates
    text, _, unit = how.origins.partition(":")
    places = [_position(part + (f":{unit}" if unit else ""), "--origins") for part in text.split(",")]
    if len(places) != len(plates):
        message = (
            f"gives {len(places)} position{'s' * (len(places) != 1)}, and {len(plates)} plates bear load"
            f" ({', '.join(plate.name for plate in plates)}); needs one of each, in this order"
        )
        raise BadInput(message, file=file, key="--origins")
    return tuple(replace(plate, origin=place) for plate, place in zip(plates, places, strict=True))


def _say_together(
    table: Table, plates: tuple[Plate, ...], good: Flags, sources: tuple[str, Quantity] | None, say: Remarks
) -> None:
    """Say which plates were added, which load weights which CoP, and that their CoPs are in one frame."""
    if len(plates) == 1:
        return
    loads = "; ".join(f"{plate.name}: {plate.columns}, {float(plate.fz.values[good].mean()):.4g} N" for plate in plates)
    say.notes.append(f"{len(plates)} plates added, each CoP weighted by the load of its plate ({loads})")
    named = all(plate.fz.columns.lower().lstrip("-").find("ground_force") >= 0 for plate in plates)
    if sources is not None and sources[0] == "cop" and not (table.one_frame or named):
        say.assumed.append(f"the CoPs {sources[1].columns} are in one frame, not each in that of its plate")


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
        _note(
            checks.agreement(cop[good], P[good], None, quantity, formula, file, labels={"cop": quantity.columns}), say
        )
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


def from_ankle(
    cop: Array, good: Flags, how: Reading, columns: Columns, subject: Subject, say: Remarks, load: Array | None
) -> tuple[Array, str, bool]:
    """The CoP from the ankle (n,) [m], where the ankle is, in words, and whether it is assumed.

    Where nothing tells, the ankle is where a law would have it that holds the CoP at its target P_d in the mean.
    """
    stated, ankle = how.ankle, columns.get("ankle_x")
    if stated is not None:
        place = _position(stated, "--ankle")
        return cop - place, f"at {place:g} m by --ankle", False
    if ankle is not None:
        return cop - ankle, "from the file's ankle columns", False
    biped, target = subject.biped, subject.target
    mean = float(cop[good].mean())
    place = round(mean - target, 12) + 0.0
    where = f"{1e3 * target:g} mm behind the mean CoP, the law's target" if target else "under the mean CoP"
    if load is None:
        follows = ""
    elif biped.skew == 0 and target == 0:
        follows = ", so that the mean of toe and heel force is equal"
    else:
        F = float(load[good].mean())
        share = target / biped.ell - biped.skew  # (F_T - F_H) / (F_T + F_H) of a CoP at the target, (18)
        follows = f", so that toe and heel bear about {0.5 * F * (1 + share):.4g} and {0.5 * F * (1 - share):.4g} N"
    say.assumed.append(f"ankle taken at {place:.4g} m, {where}{follows}; give --ankle")
    return cop - place, f"at {place:.4g} m, {where}", True


def _position(text: str, option: str) -> float:
    number, _, written = text.partition(":")
    unit = unit_of(written) if written else "m"
    scale = factor(unit, "position") if unit else None
    try:
        value = float(number)
    except ValueError:
        value = np.nan
    if scale is None or not np.isfinite(value) or abs(value * scale) > 100:
        message = f"is {text[:40]!r}; needs a position as 0.21 or 21:cm ({', '.join(FACTORS['position'])})"
        raise BadInput(message, key=option)
    return value * scale


def _assumed_foot(biped: Biped) -> str:
    return f"foot of the built-in adult-slope, {biped.ell:g} m from ankle to toe and heel (give --spec)"


def _foot_ratio(cop: Array, P: Array, good: Flags) -> float | None:
    """How many times the file's CoP is ``P``, that of the assumed foot by (18); None where that says no foot."""
    if P[good].std() < 1e-6:
        return None
    ratio = float(np.polyfit(P[good], cop[good], 1)[0])
    return ratio if 0.2 < ratio < 5 else None


def _note(found: checks.Agreement | None, say: Remarks) -> None:
    if found is not None:
        (say.notes if found.close else say.warnings).append(found.sentence)
