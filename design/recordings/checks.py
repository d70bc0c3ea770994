"""Whether a recording fits the body, and itself: a wrong unit, axis or sign is refused with the mismatch named."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from design.errors import BadInput
from design.model.body import Biped
from design.recordings.columns import Quantity
from design.recordings.table import Array
from design.recordings.units import FACTORS, KILOPOND, POUND

FAR, NEAR = 2.0, 0.15
"""Beyond this factor a height is refused; beyond this part a height or a mean force is remarked upon."""
LIGHT, HEAVY = 0.6, 1.6
"""A mean force beyond these parts of the weight of the spec is refused: one of two plates, or another unit."""
TORQUE, STILL = 1.5, 0.05
"""By what factor a measured torque may differ, and the standard deviation [N m] below which none is compared."""
HELD, LEAN = 0.5, 0.35
"""A posture that needs a larger part of the weight as a horizontal force, or leans further [rad] under an even load, is
none."""
MASSES = (20.0, 200.0)
"""Masses of a standing person [kg], where no spec says another."""


def weight(mean: float, quantity: Quantity, biped: Biped, *, given: bool, file: str) -> list[str]:
    """Compare the ``mean`` vertical force [N] with the weight of ``biped``, or (not ``given``) with a person's."""
    where = f"column{'s' * ('+' in quantity.columns)} {quantity.columns}"
    if not given:
        low, high = MASSES
        if low <= mean / biped.g <= high:
            return []
        message = (
            f"mean vertical force {mean:.5g} N (read in {quantity.unit}) is the weight of {mean / biped.g:.4g} kg;"
            f" needs a standing person's, {low:g} to {high:g} kg, or another body's given by --spec"
            f"{_why(mean / (70 * biped.g), quantity)}"
        )
        raise BadInput(message, file=file, key=where)
    ratio = mean / biped.weight
    body = f"the weight (M+m) g = {biped.weight:.5g} N of the spec"
    if not LIGHT <= ratio <= HEAVY:
        message = (
            f"mean vertical force {mean:.5g} N (read in {quantity.unit}) is {ratio:.3g} times {body}; needs"
            f" {LIGHT:g} to {HEAVY:g} times{_why(ratio, quantity)}"
        )
        raise BadInput(message, file=file, key=where)
    if abs(ratio - 1) > NEAR:
        return [
            f"mean vertical force {mean:.5g} N is {100 * (ratio - 1):+.0f} % off {body}: is it this body's recording?"
        ]
    return []


def _why(ratio: float, quantity: Quantity) -> str:
    """The likely reason of a vertical force that is ``ratio`` times the weight."""
    if ratio < 0:
        return "; it is negative: the sign of a plate that measures the force on itself; give fz=-COLUMN"
    now = {"N": 1.0, "kN": 1e3, "kgf": KILOPOND, "lbf": POUND}[quantity.unit]
    fits = []
    for unit, newton in (("N", 1.0), ("kgf", KILOPOND), ("lbf", POUND), ("kN", 1e3)):
        off = abs(math.log(ratio * newton / now)) if ratio > 0 else math.inf
        if unit != quantity.unit and off < 0.35:
            fits.append((off, unit))
    if fits:
        return f"; it fits if the column is in {min(fits)[1]}: give fz={quantity.columns}:{min(fits)[1]}"
    if ratio < 0.1:
        return "; it looks like a horizontal component: give --up, or fz=COLUMN of the vertical one"
    if ratio < 0.7:
        return "; is it one of two plates? Join them: fz=COLUMN1+COLUMN2"
    return "; give the right column and unit: --columns fz=COLUMN:UNIT"


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """How two centres of pressure agree, as ``said``; ``close``: in size as well as a unit can be told."""

    said: str
    close: bool


def agreement(
    cop: Array, other: Array, tilt: Array | None, quantity: Quantity, formula: str, file: str
) -> Agreement | None:
    """Compare the file's CoP [m] with ``other`` [m], the one by ``formula``; a constant offset is none of a unit.

    ``tilt`` = f_x / load: the lever of a plate's cover or of its origin adds a multiple of it. None if neither moves.
    """
    where = f"column {quantity.columns}"
    if max(cop.std(), other.std()) < 1e-6:
        return None
    base = [other - other.mean()] + ([] if tilt is None or tilt.std() < 1e-9 else [tilt - tilt.mean()])
    coefficients, *_ = np.linalg.lstsq(np.column_stack(base), cop - cop.mean(), rcond=None)
    slope = float(coefficients[0])
    left = float((cop - cop.mean() - np.column_stack(base) @ coefficients).std())
    plain = float(np.polyfit(other, cop, 1)[0]) if other.std() > 1e-9 else 0.0
    fits = left < 0.4 * float(cop.std()) if cop.std() > 0 else False
    if not fits:
        message = (
            f"does not move with {formula}: only {max(0.0, 100 * (1 - left / max(float(cop.std()), 1e-12))):.0f} % of"
            " its motion is explained; another axis, plate or column? Give --forward, or --columns cop=...,my=..."
            " (my=none leaves the moment out)"
        )
        raise BadInput(message, file=file, key=where)
    if 0.8 < slope < 1.25:
        offset = float((cop - other).mean())
        most = float(np.abs(cop - other - offset).max())
        apart = f", {1e3 * offset:+.1f} mm apart" if abs(offset) > 1e-3 else ""
        close = 0.97 < slope < 1.03
        off = "" if close else f", though {slope:.3g} times as large"
        return Agreement(said=f"CoP equals {formula} within {1e3 * most:.2g} mm{apart}{off}", close=close)
    if -1.25 < slope < -0.8:
        message = (
            f"CoP is minus {formula}: the sign of the moment, or of the axis; give my=-COLUMN, or --forward with the"
            " other sign"
        )
        raise BadInput(message, file=file, key=where)
    message = f"CoP (read in {quantity.unit}) is {plain:.4g} times {formula}; needs 1{_position_unit(plain, quantity)}"
    raise BadInput(message, file=file, key=where)


def _position_unit(ratio: float, quantity: Quantity) -> str:
    now = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}[quantity.unit]
    for unit, metres in (("m", 1.0), ("cm", 1e-2), ("mm", 1e-3)):
        if unit != quantity.unit and abs(math.log(abs(ratio) * metres / now or 1e-300)) < 0.25:
            return f"; it fits if the column is in {unit}: give cop={quantity.columns}:{unit}, or the moment's unit"
    return "; give the units of cop, my and fz with --columns"


def reach(
    cop: Array, quantity: Quantity, ell: float, seconds: float, file: str, *, confirmed: bool = False
) -> list[str]:
    """Refuse a CoP [m] that moves over more than two feet, or less than any person's can; remark on more than one.

    ``confirmed``: its unit agrees with the moment's.
    """
    low, high = np.percentile(cop, [2.0, 98.0])
    spread = float(high - low)
    where = f"column {quantity.columns}"
    if spread > 4 * ell:
        now = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}.get(quantity.unit, 0.0)
        likely = next((u for u, f in (("cm", 1e-2), ("mm", 1e-3)) if f < now and spread * f <= 2 * ell * now), "")
        fits = f"it fits if the column is in {likely}: give cop={quantity.columns}:{likely}" if likely else ""
        message = (
            f"CoP (read in {quantity.unit}) moves over {spread:.4g} m, and the foot is {2 * ell:g} m long;"
            f" {fits or 'check columns and units'}"
        )
        raise BadInput(message, file=file, key=where)
    if 1e-9 < spread < 0.01 * ell and seconds > 2 and quantity.unit != "m" and not confirmed:
        message = (
            f"CoP (read in {quantity.unit}) moves over only {1e3 * spread:.3g} mm, which no standing person's does;"
            f" is it in m? Give cop={quantity.columns}:m"
        )
        raise BadInput(message, file=file, key=where)
    if spread > 2 * ell:
        return [
            f"CoP (column {quantity.columns}, read in {quantity.unit}) moves over {spread:.4g} m, more than the foot's"
            f" {2 * ell:g} m: is the unit right?"
        ]
    return []


def within(P: Array, ell: float, ankle: str, file: str) -> None:
    """Raise ``BadInput`` for a CoP that lies beyond the foot on the whole: the ankle is elsewhere."""
    mean = float(P.mean())
    if abs(mean) > 2 * ell:
        message = (
            f"mean CoP is {mean:.4g} m from the ankle ({ankle}), and the foot ends at {ell:g} m; check the ankle's"
            " place and unit, as --ankle 0.21 or --ankle 21:cm"
        )
        raise BadInput(message, file=file, key="--ankle")


def angle(theta: Array, quantity: Quantity, file: str) -> list[str]:
    """Compare the angle's range [rad] with a standing body's."""
    most = float(np.abs(theta).max())
    where = f"column {quantity.columns}"
    if most > math.pi / 2:
        likely = "deg" if quantity.unit == "rad" and most <= 90 else ""
        fits = f"; it fits if the column is in deg: give angle={quantity.columns}:deg" if likely else ""
        message = (
            f"ankle angle (read in {quantity.unit}) reaches {most:.4g} rad = {math.degrees(most):.4g} deg; needs less"
            f" than 90 deg from the vertical{fits}"
        )
        raise BadInput(message, file=file, key=where)
    if quantity.unit == "deg" and 0 < most < math.radians(0.05):
        return [f"ankle angle stays within {math.degrees(most):.2g} deg: is column {quantity.columns} in rad?"]
    return []


def torque(tau: Array, implied: Array, quantity: Quantity, file: str, *, size_known: bool, place_known: bool) -> None:
    """Compare a measured ankle torque [N m] with ``implied`` = ell (F_H - F_T), (11).

    Without ``size_known`` (the foot is assumed) only the sign counts; a difference of the means counts with
    ``place_known`` (the ankle's).
    """
    where, formula = f"column {quantity.columns}", "ell (F_H - F_T) of (11)"
    spread, theirs = float(tau.std()), float(implied.std())
    if theirs > STILL:
        alike = float(np.corrcoef(tau, implied)[0, 1]) if spread > 1e-9 else 0.0
        ratio = spread / theirs * (math.copysign(1.0, alike))
        if abs(alike) < 0.6:
            message = (
                f"ankle torque does not move with {formula} (correlation {alike:.2f}); another joint's?"
                " Give --columns torque=COLUMN, or torque=none"
            )
            raise BadInput(message, file=file, key=where)
        if ratio < 0:
            other = quantity.columns[1:] if quantity.columns.startswith("-") else f"-{quantity.columns}"
            message = f"ankle torque is minus {formula}: the other sign; give torque={other}"
            raise BadInput(message, file=file, key=where)
        if size_known and not 1 / TORQUE <= ratio <= TORQUE:
            message = (
                f"ankle torque (read in {quantity.unit}) is {ratio:.4g} times {formula}; needs 1"
                f"{_moment_unit(ratio, quantity)}"
            )
            raise BadInput(message, file=file, key=where)
    off = float(tau.mean() - implied.mean())
    if size_known and place_known and abs(off) > max(0.5 * abs(float(implied.mean())), 3 * theirs, 5.0):
        message = (
            f"ankle torque (read in {quantity.unit}) is {float(tau.mean()):.4g} N m in the mean, and {formula} is"
            f" {float(implied.mean()):.4g} N m; check its unit and sign, --ankle, or give torque=none"
        )
        raise BadInput(message, file=file, key=where)


def _moment_unit(ratio: float, quantity: Quantity) -> str:
    now = FACTORS["moment"][quantity.unit]
    for unit, scale in FACTORS["moment"].items():
        if unit != quantity.unit and abs(math.log(ratio * scale / now)) < 0.4:
            return f"; it fits if the column is in {unit}: give torque={quantity.columns}:{unit}"
    half = "; is it one leg's of two? Join them: torque=COLUMN1+COLUMN2" if 0.3 < ratio < 0.7 else ""
    return half or "; give torque=COLUMN:UNIT, or torque=none"


def posture(
    theta: Array, load: Array, P: Array, quantity: Quantity, biped: Biped, file: str, *, confirmed: bool
) -> None:
    """Raise ``BadInput`` for an angle [rad] that only a force as large as the weight would hold, by (17): it is in deg.

    An even ``load`` (the CoP ``P`` near the ankle) holds no body that leans far, unless a large steady force acts: so
    the lean alone does not count where the unit is ``confirmed``, by the user or by a rate whose unit is stated.
    """
    if quantity.unit != "rad":
        return
    needed = float(np.median(np.abs((load - biped.m * biped.g) * np.tan(theta))))
    lean = float(np.percentile(np.abs(theta), 90.0))
    even = abs(float(P.mean())) < 0.5 * biped.ell
    heavy = needed > HELD * biped.weight
    if not heavy and (confirmed or not even or lean <= LEAN):
        return
    otherwise = "" if heavy else f", or angle={quantity.columns}:rad if it is rad indeed"
    message = (
        f"ankle angle (read in rad) reaches {lean:.4g} rad = {math.degrees(lean):.3g} deg, which at rest needs a force"
        f" of {needed:.4g} N, {needed / biped.weight:.2g} times the weight, by (17); needs a lean that a standing body"
        f" holds; the column is perhaps in deg: give angle={quantity.columns}:deg (and correct the header){otherwise}"
    )
    raise BadInput(message, file=file, key=f"column {quantity.columns}")


def rates(slope: float, correlation: float, names: tuple[str, str], file: str) -> None:
    """Raise ``BadInput`` where the stated angular rate is a multiple of the angle's derivative."""
    if abs(correlation) < 0.9 or 0.5 < slope < 2:
        return
    message = (
        f"angular rate (column {names[1]}) is {slope:.4g} times the derivative of the angle (column {names[0]});"
        " needs 1; one is in degrees, or has the other sign: give angle=...:UNIT,rate=...:UNIT"
    )
    raise BadInput(message, file=file)


def height(mean: float, L: float, *, given: bool, file: str) -> list[str]:
    """Compare the height of the centre of gravity above the ankles [m] with the spec's L."""
    low, high = (L / FAR, L * FAR) if given else (0.3, 2.0)
    if not low <= mean <= high:
        likely = next((u for u, f in (("cm", 1e-2), ("mm", 1e-3)) if low <= mean * f <= high), "")
        fits = f"; it fits if positions are in {likely}" if likely else "; is the right axis up? Give --up, or the unit"
        needed = f"the spec's {L:g} m within a factor 2" if given else f"{low:g} to {high:g} m"
        message = f"the centre of gravity is {mean:.4g} m above the ankles; needs {needed}{fits}"
        raise BadInput(message, file=file)
    if given and abs(mean / L - 1) > NEAR:
        return [f"the centre of gravity is {mean:.4g} m above the ankles, and the spec says {L:g} m"]
    return []
