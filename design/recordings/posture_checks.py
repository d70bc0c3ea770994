"""Whether the posture of a recording fits the body and the forces: angle, rate, torque and height."""

from __future__ import annotations

import math

import numpy as np

from design.errors import BadInput
from design.model.body import Biped
from design.recordings.plates import Quantity
from design.recordings.remedies import Misfit, Remedy
from design.recordings.selection import negated
from design.recordings.table import Array
from design.recordings.units import FACTORS

FAR, NEAR = 2.0, 0.15
"""Beyond this factor a height is refused; beyond this part it is remarked upon."""
WITHOUT = Remedy(options={"torque": "none"}, when=" to leave it out", last=True)
TORQUE, STILL = 1.5, 0.05
"""By what factor a measured torque may differ, and the standard deviation [N m] below which none is compared."""
HELD, LEAN = 0.5, 0.35
"""A posture that needs a larger part of the weight as a horizontal force, or leans further [rad] under an even load, is
none."""


def angle(theta: Array, quantity: Quantity, file: str) -> list[str]:
    """Compare the angle's range [rad] with a standing body's."""
    most = float(np.abs(theta).max())
    where = f"column {quantity.columns}"
    if most > math.pi / 2:
        message = (
            f"ankle angle (read in {quantity.unit}) reaches {most:.4g} rad = {math.degrees(most):.4g} deg; needs less"
            " than 90 deg from the vertical"
        )
        raise Misfit(message, file=file, key=where, remedies=_in_units("angle", quantity, ["deg"]))
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
                " Give --columns torque=COLUMN of the ankle's"
            )
            raise Misfit(message, file=file, key=where, remedies=[WITHOUT])
        if ratio < 0:
            message = f"ankle torque is minus {formula}: the other sign"
            remedy = Remedy(options={"torque": negated(quantity.columns)})
            raise Misfit(message, file=file, key=where, remedies=[remedy, WITHOUT])
        if size_known and not 1 / TORQUE <= ratio <= TORQUE:
            half = "; is it one leg's of two? Join them: torque=COLUMN1+COLUMN2" if 0.3 < ratio < 0.7 else ""
            message = f"ankle torque (read in {quantity.unit}) is {ratio:.4g} times {formula}; needs 1{half}"
            now = FACTORS["moment"][quantity.unit]
            units = [unit for unit, scale in FACTORS["moment"].items() if abs(math.log(ratio * scale / now)) < 0.4]
            remedies = [*_in_units("torque", quantity, units), WITHOUT]
            raise Misfit(message, file=file, key=where, remedies=remedies)
    off = float(tau.mean() - implied.mean())
    if size_known and place_known and abs(off) > max(0.5 * abs(float(implied.mean())), 3 * theirs, 5.0):
        message = (
            f"ankle torque (read in {quantity.unit}) is {float(tau.mean()):.4g} N m in the mean, and {formula} is"
            f" {float(implied.mean()):.4g} N m; check its unit and sign, and --ankle"
        )
        raise Misfit(message, file=file, key=where, remedies=[WITHOUT])


def _in_units(role: str, quantity: Quantity, units: list[str]) -> list[Remedy]:
    return [Remedy(options={role: f"{quantity.columns}:{unit}"}) for unit in units if unit != quantity.unit]


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
    remedies = _in_units("angle", quantity, ["deg"])
    if not heavy:
        remedies.append(Remedy(options={"angle": f"{quantity.columns}:rad"}, when=" if it is rad indeed"))
    message = (
        f"ankle angle (read in rad) reaches {lean:.4g} rad = {math.degrees(lean):.3g} deg, which at rest needs a force"
        f" of {needed:.4g} N, {needed / biped.weight:.2g} times the weight, by (17); needs a lean that a standing body"
        f" holds; the column is perhaps in deg (then angle={quantity.columns}:deg, and correct the header)"
    )
    raise Misfit(message, file=file, key=f"column {quantity.columns}", remedies=remedies)


def rates(slope: float, correlation: float, names: tuple[str, str], file: str) -> None:
    """Raise ``BadInput`` where the stated angular rate is a multiple of the angle's derivative."""
    if abs(correlation) < 0.9 or 0.5 < slope < 2:
        return
    message = (
        f"angular rate (column {names[1]}) is {slope:.4g} times the derivative of the angle (column {names[0]});"
        " needs 1; one is in degrees, or has the other sign"
    )
    remedies = [
        Remedy(options={"rate": f"{names[1]}:deg/s"}), Remedy(options={"angle": f"{names[0]}:deg"}),
        Remedy(options={"rate": negated(names[1])}),
    ]  # fmt: skip
    raise Misfit(message, file=file, remedies=remedies, otherwise="give angle=...:UNIT,rate=...:UNIT")


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
