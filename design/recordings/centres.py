"""The CoP of each plate: as its columns say it, or from its moment, about an origin that must be known or shared."""

from __future__ import annotations

from dataclasses import replace

from design.errors import BadInput
from design.recordings import checks
from design.recordings.ankle import position
from design.recordings.columns import Columns
from design.recordings.plates import UNLOADED, Flags, Plate, Quantity, added
from design.recordings.reading import Reading
from design.recordings.remarks import Remarks, Subject, note
from design.recordings.remedies import Misfit, Remedy
from design.recordings.table import Array, Table


def with_origins(plates: tuple[Plate, ...], how: Reading, file: str) -> tuple[Plate, ...]:
    """The plates with the forward positions of their origins, as the user gives them."""
    if how.origins is None:
        return plates
    if not any(plate.my for plate in plates):
        message = "is where moments are about, and none is read; leave it out, or give my=COLUMN"
        raise BadInput(message, file=file, key="--origins")
    text, _, unit = how.origins.partition(":")
    places = [position(part + (f":{unit}" if unit else ""), "--origins") for part in text.split(",")]
    if len(places) != len(plates):
        message = (
            f"gives {len(places)} position{'s' * (len(places) != 1)}, and {len(plates)} plates bear load"
            f" ({', '.join(plate.name for plate in plates)}); needs one of each, in this order"
        )
        raise BadInput(message, file=file, key="--origins")
    return tuple(replace(plate, origin=place) for plate, place in zip(plates, places, strict=True))


def centres_of(
    plates: tuple[Plate, ...], good: Flags, usual: float, columns: Columns, subject: Subject, file: str, say: Remarks
) -> tuple[tuple[str, Quantity] | None, list[Array] | None]:
    """The role and columns that the CoP follows from, and the CoP of each plate (n,) [m]; None if it has none."""
    cops = [plate.cop for plate in plates if plate.cop]
    moments = [plate.my for plate in plates if plate.my]
    labels = {"cop": "+".join(each.option for each in cops), "my": "+".join(each.option for each in moments)}
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
        note(found, say)
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
    together = added([plate.my for plate in plates if plate.my])
    for cop, loaded in zip(centres, rows, strict=True):
        if loaded.any():  # a moment in another unit is none about another point
            checks.reach(cop[loaded], "my", together, ell, 0.0, file)
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
        given = "+".join(plate.my.option for plate in plates if plate.my)
        remedy = Remedy(options={"my": given}, when=" if these are at one forward position (else --origins X1,X2:UNIT)")
        raise Misfit(
            message, file=file, key=key, remedies=[remedy], otherwise="give the CoP of each plate, or --origins"
        )
    say.assumed.append(f"the moments {label} are about points at one forward position (give --origins)")


def say_together(
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
