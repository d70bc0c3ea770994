"""Whether the contact of a recording fits the body, and itself: a wrong unit, axis or sign is refused by its name."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from design.errors import BadInput
from design.model.body import Biped
from design.recordings.plates import Flags, Plate, Quantity
from design.recordings.remedies import Misfit, Remedy
from design.recordings.selection import negated
from design.recordings.table import Array
from design.recordings.units import FACTORS, Kind

NEAR = 0.15
"""A mean force further than this part from the weight is remarked upon."""
LIGHT, HEAVY = 0.6, 1.6
"""A mean force beyond these parts of the weight of the spec is refused: one of two plates, or another unit."""
SWAY = 0.02
"""How far the CoP of a standing person usually moves [m]: the order in which units are proposed."""
BAND = (0.1, 0.5)
"""Frequencies [Hz] at which the load of a standing body hardly changes, and that of one foot does."""
MASSES = (20.0, 200.0)
"""Masses of a standing person [kg], where no spec says another."""
WITHOUT = Remedy(options={"my": "none"}, when=" to leave the moment out", last=True)


def in_units(columns: dict[str, str], kind: Kind, now: str, ratio: float, most: float) -> list[Remedy]:
    """The unit in which ``columns``, by role, would be about ``ratio`` times smaller: within a factor e^``most``."""
    off = {
        unit: abs(math.log(abs(ratio) * scale / FACTORS[kind][now])) if ratio else math.inf
        for unit, scale in FACTORS[kind].items() if unit != now
    }  # fmt: skip
    near = sorted((unit for unit in off if off[unit] < most), key=lambda unit: off[unit])[:1]
    return [
        Remedy(
            options={role: f"{label}:{unit}" for role, label in columns.items()},
            when=f" (it fits if the column is in {unit})",
        )
        for unit in near
    ]


def weight(
    mean: float, quantity: Quantity, biped: Biped, *, given: bool, file: str, forces: dict[str, str],
    usual: tuple[Remedy, ...] = (),
) -> list[str]:  # fmt: skip
    """Compare the ``mean`` vertical force [N] with the weight of ``biped``, or (not ``given``) with a person's.

    ``forces``: the columns that it is the sum of, by role; ``usual``: those that usual names select, if the user
    selected others.
    """
    where = f"column{'s' * ('+' in quantity.columns)} {quantity.columns}"
    if not given:
        low, high = MASSES
        if low <= mean / biped.g <= high:
            return []
        message = (
            f"mean vertical force {mean:.5g} N (read in {quantity.unit}) is the weight of {mean / biped.g:.4g} kg;"
            f" needs a standing person's, {low:g} to {high:g} kg, or another body's given by --spec"
        )
        raise _unlike(message, where, mean / (70 * biped.g), quantity, file, forces, usual)
    ratio = mean / biped.weight
    body = f"the weight (M+m) g = {biped.weight:.5g} N of the spec"
    if not LIGHT <= ratio <= HEAVY:
        message = (
            f"mean vertical force {mean:.5g} N (read in {quantity.unit}) is {ratio:.3g} times {body}; needs"
            f" {LIGHT:g} to {HEAVY:g} times"
        )
        raise _unlike(message, where, ratio, quantity, file, forces, usual)
    if abs(ratio - 1) > NEAR:
        return [
            f"mean vertical force {mean:.5g} N is {100 * (ratio - 1):+.0f} % off {body}: is it this body's recording?"
        ]
    return []


def sways_up_and_down(load: Array, good: Flags, seconds: float, mass: float, biped: Biped) -> list[str]:
    """A remark where a vertical ``load`` (n,) changes as if the CoG went up and down too far: one foot's load does.

    m y'' = load - weight, so that the part of the load at a frequency w moves the CoG by load / (m w^2). ``BAND``
    leaves out slower parts, which the drift of an amplifier makes.
    """
    if seconds < 1 / BAND[0] or good.mean() < 0.5:
        return []
    every = max(1, int((len(load) - 1) / seconds / (20 * BAND[1])))  # means of so many samples hold all of the band
    n = len(load) // every
    known = np.where(good, load, float(load[good].mean()))[: n * every].reshape(n, every).mean(axis=1)
    ramp = np.linspace(-1.0, 1.0, n)
    spectrum = np.fft.rfft((known - np.polyval(np.polyfit(ramp, known, 1), ramp)) * np.hanning(n))
    w = 2 * np.pi * np.fft.rfftfreq(n, seconds * every / (len(load) - 1))
    inside = (w >= 2 * np.pi * BAND[0]) & (w <= 2 * np.pi * BAND[1])
    height = float(np.ptp(np.fft.irfft(np.where(inside, spectrum / (mass * np.maximum(w, 1e-9) ** 2), 0.0), n)))
    if height < 0.5 * biped.L:
        return []
    return [
        f"the vertical force changes as if the centre of gravity went up and down over {height:.2g} m: is it the load"
        " of one foot of two? Give the columns of both plates, fz=COLUMN1+COLUMN2, or a --spec with the body's weight"
    ]


def _unlike(
    message: str, where: str, ratio: float, quantity: Quantity, file: str, forces: dict[str, str],
    usual: tuple[Remedy, ...],
) -> Misfit:  # fmt: skip
    """The refusal of a vertical force that is ``ratio`` times the weight, with its likely reasons."""
    units = in_units(forces, "force", quantity.unit, ratio, 0.35)
    remedies = [*units, *(replace(remedy, last=True) for remedy in usual)]
    otherwise = "give the right column and unit: --columns fz=COLUMN:UNIT, or another --spec"
    if ratio < 0:
        message += "; it is negative and positive by turns: no plate's load is"
    elif ratio < 0.09:
        message += "" if units else "; it looks like a horizontal component"
        otherwise = "give --up, or fz=COLUMN of the vertical one, or another --spec"
    elif 0.09 <= ratio < 0.7:
        message += "; is it one of two plates, or another body's?"
        otherwise = "join the plates, fz=COLUMN1+COLUMN2, or give that body's --spec"
    return Misfit(message, file=file, key=where, remedies=remedies, otherwise=otherwise)


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """How two centres of pressure agree, in a ``sentence``; ``close``: in size as well as a unit can be told."""

    sentence: str
    close: bool


def agreement(
    cop: Array, other: Array, tilt: Array | None, quantity: Quantity, formula: str, file: str, *,
    labels: dict[str, str], moment: Quantity | None = None,
) -> Agreement | None:  # fmt: skip
    """Compare the file's CoP [m] with ``other`` [m], the one by ``formula``; a constant offset is none of a unit.

    ``tilt`` = f_x / load: the lever of a plate's cover or of its origin adds a multiple of it. ``labels``: the columns
    of all plates by role; ``moment``: the one in the formula. None if neither CoP moves.
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
        explained = max(0.0, 100 * (1 - left / max(float(cop.std()), 1e-12)))
        message = (
            f"does not move with {formula}: only {explained:.0f} % of its motion is explained; another axis, plate or"
            " column? Give --forward, or --columns cop=...,my=..."
        )
        raise Misfit(message, file=file, key=where, remedies=[WITHOUT] if moment else [])
    if 0.8 < slope < 1.25:
        offset = float((cop - other).mean())
        most = float(np.abs(cop - other - offset).max())
        apart = f", {1e3 * offset:+.1f} mm apart" if abs(offset) > 1e-3 else ""
        close = 0.97 < slope < 1.03
        off = "" if close else f", though {slope:.3g} times as large"
        return Agreement(sentence=f"CoP equals {formula} within {1e3 * most:.2g} mm{apart}{off}", close=close)
    if -1.25 < slope < -0.8:
        message = f"CoP is minus {formula}: the sign of the moment, or of the axis"
        remedies = [Remedy(options={"my": negated(labels["my"])}), WITHOUT] if moment else []
        if moment and moment.option != labels["my"]:  # one plate's alone
            parts = [negated(part) if part == moment.option else part for part in labels["my"].split("+")]
            remedies.insert(1, Remedy(options={"my": "+".join(parts)}))
        raise Misfit(message, file=file, key=where, remedies=remedies, otherwise="give --forward with the other sign")
    message = f"CoP (read in {quantity.unit}) is {plain:.4g} times {formula}; needs 1"
    remedies = in_units({"cop": labels["cop"]}, "position", quantity.unit, plain, 0.25)
    if moment is not None:
        remedies += in_units({"my": labels["my"]}, "moment", moment.unit, 1 / plain, 0.25) if plain else []
        remedies.append(WITHOUT)
    raise Misfit(
        message, file=file, key=where, remedies=remedies, otherwise="give the units of cop, my and fz with --columns"
    )


def reach(
    cop: Array, role: str, quantity: Quantity, ell: float, seconds: float, file: str, *, confirmed: bool = False
) -> list[str]:
    """Refuse a CoP [m] that moves over more than two feet, or less than any person's can; remark on more than one.

    ``quantity``: the columns that it follows from, of ``role`` cop or my. ``confirmed``: its unit agrees with the
    moment's.
    """
    low, high = np.percentile(cop, [2.0, 98.0])
    spread = float(high - low)
    where = f"column{'s' * ('+' in quantity.columns)} {quantity.columns}"
    what = f"CoP (read in {quantity.unit})" if role == "cop" else f"CoP = -my / fz (my read in {quantity.unit})"
    kind: Kind = "position" if role == "cop" else "moment"
    if spread > 4 * ell:
        message = f"{what} moves over {spread:.4g} m, and the foot is {2 * ell:g} m long"
        smaller = [unit for unit, scale in FACTORS[kind].items() if scale < FACTORS[kind][quantity.unit]]
        sway = {unit: spread * FACTORS[kind][unit] / FACTORS[kind][quantity.unit] for unit in smaller}
        likely = sorted((unit for unit in sway if sway[unit] <= 2 * ell), key=lambda u: abs(math.log(sway[u] / SWAY)))
        remedies = [
            Remedy(
                options={role: f"{quantity.option}:{unit}"},
                when=f" (it fits if the column is in {unit}: then the CoP moves over {1e3 * sway[unit]:.3g} mm)",
            )
            for unit in likely[:2] if sway[unit] > 0.01 * ell
        ]  # fmt: skip
        raise Misfit(message, file=file, key=where, remedies=remedies, otherwise="check columns and units")
    if 1e-9 < spread < 0.01 * ell and seconds > 2 and quantity.unit != "m" and role == "cop" and not confirmed:
        message = f"{what} moves over only {1e3 * spread:.3g} mm, which no standing person's does; is it in m?"
        remedies = [Remedy(options={"cop": f"{quantity.columns}:m"})]
        raise Misfit(
            message, file=file, key=where, remedies=remedies, otherwise="correct the header, or check the column"
        )
    if role == "my" and 1e-9 < spread < 0.01 * ell and seconds > 2 and not (quantity.sure or confirmed):
        message = f"{what} moves over only {1e3 * spread:.3g} mm, which no standing person's does"
        remedies = [Remedy(options={"my": f"{quantity.option}:{unit}"}) for unit in ("kN m", quantity.unit)]
        raise Misfit(message, file=file, key=where, remedies=remedies, otherwise="state the unit of the moment")
    if spread > 2 * ell:
        return [
            f"{what.replace('(', f'(column {quantity.columns}, ', 1)} moves over {spread:.4g} m, more than the foot's"
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


def apart(plates: tuple[Plate, ...], centres: list[Array], loaded: list[np.ndarray], ell: float) -> str:
    """Where the mean CoP of each plate is, if two are further apart than a foot is long; else empty."""
    means = [
        float(np.nanmean(cop[rows])) if rows.any() else math.nan for cop, rows in zip(centres, loaded, strict=True)
    ]
    if not np.isfinite(means).any() or np.nanmax(means) - np.nanmin(means) <= 2 * ell:
        return ""
    return ", ".join(f"{plate.name} {1e3 * mean:.4g} mm" for plate, mean in zip(plates, means, strict=True))
