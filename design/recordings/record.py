"""A recording as a ``Record``: contact forces and CoP of a measured trial in SI units, checked, with drop-outs masked.

Toe and heel force follow from F_T + F_H = load and F_T - F_H = P load / ell, (18), unless the file has them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from design.errors import BadInput
from design.model.body import Biped
from design.recordings import checks
from design.recordings.clock import Clock, clock
from design.recordings.columns import Columns, assign
from design.recordings.horizontal import CLEAR, against_cop
from design.recordings.reading import Reading
from design.recordings.table import Array, Table, read
from design.recordings.units import FACTORS, factor, unit_of

UNLOADED = 0.05
"""The part of the median load below which a row is a drop-out."""
WINDOW = 0.2
"""Width of the window in which an angle is differentiated [s]; a recording must be longer."""
FEWEST = 8

Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False, kw_only=True)
class Record:
    """One measured trial of ``biped``; arrays (n,) in SI units, those that were not measured None.

    ``load`` = F_T + F_H; ``P``: CoP from the ankle, toe side positive; ``cop``: CoP in the file's frame;
    ``horizontal``: forward force of the ground on the foot. ``valid``: samples with every needed number and load;
    ``dropouts``: samples without load; ``gaps``: samples with an unreadable or a missing value. ``given``: ``biped`` is
    the user's spec, not an assumption; ``ankle_assumed``: nobody said where the ankle is, and the mean of ``P`` is 0.
    ``notes``: what was read and detected; ``assumed``: what nobody said; ``warnings``.
    """

    origin: str
    sha256: str
    biped: Biped
    given: bool
    ankle_assumed: bool
    t: Array
    rate: float
    valid: Flags
    dropouts: Flags
    gaps: Flags
    load: Array | None
    F_T: Array | None
    F_H: Array | None
    P: Array | None
    cop: Array | None
    theta: Array | None
    omega: Array | None
    torque: Array | None
    horizontal: Array | None
    height: Array | None
    columns: dict[str, str]
    notes: tuple[str, ...]
    assumed: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def contact(self) -> bool:
        """Whether contact forces were measured."""
        return self.load is not None

    def spans(self, flags: Flags) -> list[tuple[float, float, int]]:
        """First and last time [s] of each run of samples for which ``flags`` holds, and their number."""
        edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
        return [
            (float(self.t[a]), float(self.t[b - 1]), int(b - a)) for a, b in zip(edges[::2], edges[1::2], strict=True)
        ]


def open_record(path: str, how: Reading, biped: Biped, *, given: bool) -> Record:
    """The recording in the file at ``path``, of ``biped``; raises ``BadInput`` for whatever does not fit.

    ``given`` False: only the foot of ``biped`` is taken, and the mass follows from the mean vertical force.
    """
    table = read(path, how)
    columns = assign(table, how)
    return Trial(table=table, columns=columns, how=how, time=clock(table, columns, how)).record(biped, given)


@dataclass(frozen=True, eq=False, kw_only=True)
class Trial:
    """A table whose columns and times are known; ``record`` makes the ``Record``."""

    table: Table
    columns: Columns
    how: Reading
    time: Clock

    def record(self, biped: Biped, given: bool) -> Record:
        """The checked record."""
        file, t = self.table.origin, self.time.t
        if len(t) < FEWEST or t[-1] - t[0] < WINDOW:
            span = t[-1] - t[0] if len(t) else 0.0
            message = (
                f"is too short: {len(t)} samples over {span:.3g} s; needs at least {FEWEST} samples and {WINDOW:g} s,"
                " the window in which angles are differentiated"
            )
            raise BadInput(message, file=file)
        used = {role: q for role, q in self.columns.quantities.items() if role != "time"}
        gaps = np.zeros(len(self.table.values), dtype=bool)
        for quantity in used.values():
            gaps |= ~np.isfinite(quantity.values)
        if gaps.all():
            message = f"has no row in which every needed column ({', '.join(used)}) holds a number"
            raise BadInput(message, file=file)
        notes, assumed, warnings = [*self.columns.said, *self.time.said], list(self.columns.assumed), list[str]()
        contact = self._contact(gaps, biped, given, notes, assumed, warnings)
        body = contact.biped
        gaps |= contact.lost
        bad = gaps | contact.empty
        good = ~bad
        theta, height = self._posture(good, body, given, notes, warnings)
        if contact.load is not None and contact.P is not None and self.columns.get("angle") is not None:
            assert theta is not None
            angle = self.columns.quantities["angle"]
            rate = self.columns.quantities.get("rate")
            confirmed = "angle" in self.columns.told or (rate is not None and rate.sure)
            checks.posture(theta[good], contact.load[good], contact.P[good], angle, body, file, confirmed=confirmed)
        tau = self.columns.get("torque")
        if tau is not None and contact.F_T is not None and contact.F_H is not None:
            implied = body.behind(contact.F_T, contact.F_H) + body.tilt
            checks.torque(
                tau[good], implied[good], self.columns.quantities["torque"], file,
                size_known=given or not {"toe", "heel"} <= set(used) or "cop" in used,
                place_known=not contact.ankle_assumed,
            )  # fmt: skip
        taken = {role: f"{q.columns} [{q.unit}]" for role, q in self.columns.quantities.items()}
        horizontal = self._sampled(contact.horizontal, good)
        if horizontal is not None and theta is None:
            horizontal = self._signed(horizontal, self._sampled(contact.cop, good), taken, notes, assumed, warnings)
        omega = self._sampled(self.columns.get("rate"), good)
        at_theta = self._sampled(theta, good)
        if at_theta is not None:
            slope = derivative(t, at_theta)
            if omega is None:
                omega = slope
            elif self.columns.get("angle") is not None:
                names = (self.columns.quantities["angle"].columns, self.columns.quantities["rate"].columns)
                _check_rates(slope, omega, names, file)
        if theta is not None and contact.load is not None and not given:
            assumed.append(
                f"height {body.L:g} m of the centre of gravity and inertia {body.I:g} kg m2 of the built-in adult-slope"
                " (give --spec)"
            )
        plates = any(role in used for role in ("fz", "toe"))
        for role, q in used.items():
            if not q.sure:
                assumed.append(f"{role} (column {q.columns}) is in {q.unit}, as nothing is said")
        at = self._sampled
        return Record(
            origin=file, sha256=self.table.sha256, biped=body, given=given,
            ankle_assumed=contact.ankle_assumed, t=t, rate=self.time.rate,
            valid=self.time.all_true(good), dropouts=self.time.any_true(contact.empty),
            gaps=self.time.any_true(gaps) | ~self.time.near(), load=at(contact.load, good), F_T=at(contact.F_T, good),
            F_H=at(contact.F_H, good), P=at(contact.P, good), cop=at(contact.cop, good) if plates else None,
            theta=at_theta, omega=omega, torque=at(self.columns.get("torque"), good),
            horizontal=horizontal, height=at(height, good), columns=taken,
            notes=(*self.table.detected, *notes), assumed=tuple(assumed), warnings=tuple(warnings),
        )  # fmt: skip

    def _sampled(self, values: Array | None, good: Flags) -> Array | None:
        """A quantity at the record's times, bridged linearly over rows that are not ``good``."""
        if values is None:
            return None
        if not good.all():
            rows = np.arange(len(values), dtype=float)
            values = np.where(good, values, np.interp(rows, rows[good], values[good]))
        return self.time.at(values)

    def _signed(
        self,
        force: Array,
        cop: Array | None,
        taken: dict[str, str],
        notes: list[str],
        assumed: list[str],
        warnings: list[str],
    ) -> Array:
        """The horizontal force (n,) with the sign of the force on the foot, which the CoP (n,) tells."""
        label = self.columns.quantities["fx"].columns
        other = label[1:] if label.startswith("-") else f"-{label}"
        told = "fx" in self.columns.told
        likeness = None if cop is None else against_cop(force, cop, self.time.rate)
        if likeness is not None and likeness > CLEAR:
            if told:
                warnings.append(
                    f"fx (column {label}) moves with the CoP (correlation {likeness:.2f}), as the force on the plate"
                    f" does: should it be fx={other}?"
                )
                return force
            notes.append(
                f"{label} is the force on the plate: it moves with the CoP (correlation {likeness:.2f}); its sign was"
                " turned"
            )
            taken["fx"] = taken["fx"].replace(label, other, 1)
            return -force
        if not told and (likeness is None or likeness > -CLEAR):
            why = "the recording does not tell" if likeness is None else f"correlation with the CoP {likeness:.2f}"
            assumed.append(
                f"{label} is the ground's force on the foot, not the force on the plate ({why}); else give fx={other}"
            )
        return force

    def _contact(
        self, gaps: Flags, biped: Biped, given: bool, notes: list[str], assumed: list[str], warnings: list[str]
    ) -> _Contact:
        """Load, toe and heel force and CoP of the rows, checked against the body and against each other."""
        get, file = self.columns.get, self.table.origin
        toe, heel, fz, my = get("toe"), get("heel"), get("fz"), get("my")
        horizontal, cop = get("fx"), get("cop")
        load = toe + heel if toe is not None and heel is not None else fz
        if load is None or (toe is None and cop is None and my is None):
            nothing = np.zeros(len(gaps), dtype=bool)
            return _Contact(biped=biped, empty=nothing, lost=nothing)
        quantity = self.columns.quantities["toe" if toe is not None and heel is not None else "fz"]
        loaded = load[~gaps & (load != 0)]
        if not len(loaded):
            message = "is zero in every row; needs the vertical force of a loaded plate"
            raise BadInput(message, file=file, key=f"column {quantity.columns}")
        usual = float(np.median(loaded))
        if usual < 0 and toe is None and float((loaded > 0).mean()) < 0.01:
            load, usual = -load, -usual
            my = None if my is None else -my
            horizontal = None if horizontal is None else -horizontal
            notes.append("the vertical force is negative throughout: the force on the plate; all its signs were turned")
        with np.errstate(invalid="ignore"):
            empty = ~gaps & (load < UNLOADED * abs(usual))
        good = ~gaps & ~empty
        if good.sum() < FEWEST:
            message = f"has only {int(good.sum())} rows with load; needs at least {FEWEST}"
            raise BadInput(message, file=file, key=f"column {quantity.columns}")
        if good.mean() < 0.5:
            warnings.append(f"only {100 * good.mean():.0f} % of the rows can be used")
        lost = np.zeros(len(gaps), dtype=bool) if cop is None else _lost_cop(cop, good)
        if lost.any():
            count = int(lost.sum())
            notes.append(
                f"CoP of exactly 0 under load, far from the others, in {count} row{'s' * (count != 1)}: masked"
            )
            good &= ~lost
        if good.sum() < FEWEST:
            message = f"has only {int(good.sum())} rows with load and a CoP; needs at least {FEWEST}"
            raise BadInput(message, file=file, key=f"column {quantity.columns}")
        mean = float(load[good].mean())
        warnings += checks.weight(mean, quantity, biped, given=given, file=file)
        if not given:
            biped = replace(biped, M=mean / biped.g - biped.m)
            assumed.append(
                f"mass {biped.M + biped.m:.4g} kg from the mean vertical force, so that the mean of F_y is zero"
                f" (give --spec)"
            )
        foot = None if given else f"foot of the built-in adult-slope, {biped.ell:g} m from ankle to toe and heel"
        seconds = float(self.time.t[-1] - self.time.t[0])
        if toe is not None and heel is not None:
            with np.errstate(all="ignore"):
                P = np.where(good & (load != 0), biped.pressure(toe, heel), np.nan)
            if cop is not None:
                if not given and (ratio := _foot_ratio(cop, P, good)) is not None:
                    biped, P = replace(biped, ell=ratio * biped.ell), ratio * P
                    foot = f"{biped.ell:.4g} m from ankle to toe and heel, as toe force, heel force and CoP say"
                formula = "(F_T - F_H) ell / (F_T + F_H)" if not biped.skew else "(F_T toe - F_H heel) / (F_T + F_H)"
                said = checks.agreement(cop[good], P[good], None, self.columns.quantities["cop"], formula, file)
                _note(said, notes, warnings)
            assumed += [f"{foot} (give --spec)"] if foot else []
            return _Contact(
                biped=biped, empty=empty, lost=lost, load=load, F_T=toe, F_H=heel, P=P,
                cop=P if cop is None else cop, horizontal=horizontal,
            )  # fmt: skip
        assumed += [f"{foot} (give --spec)"] if foot else []
        if my is not None:
            with np.errstate(all="ignore"):
                moment = np.where(good, -my / np.where(load == 0, np.nan, load), np.nan)
            if cop is not None:
                tilt = None if horizontal is None else (horizontal / np.where(load == 0, np.nan, load))[good]
                said = checks.agreement(cop[good], moment[good], tilt, self.columns.quantities["cop"], "-my / fz", file)
                _note(said, notes, warnings)
            else:
                cop = moment
                notes.append("CoP from the moment: -my / fz")
        assert cop is not None
        source = self.columns.quantities.get("cop") or self.columns.quantities["my"]
        confirmed = my is not None and "cop" in self.columns.quantities
        warnings += checks.reach(cop[good], source, biped.ell, seconds, file, confirmed=confirmed)
        P, place, unknown = self._from_ankle(cop, good, assumed)
        checks.within(P[good], max(biped.toe, biped.heel), place, file)
        difference = (P - biped.ell * biped.skew) * load / biped.ell  # (18)
        return _Contact(
            biped=biped, empty=empty, lost=lost, load=load, F_T=0.5 * (load + difference),
            F_H=0.5 * (load - difference), P=P, cop=cop, horizontal=horizontal, ankle_assumed=unknown,
        )  # fmt: skip

    def _from_ankle(self, cop: Array, good: Flags, assumed: list[str]) -> tuple[Array, str, bool]:
        """The CoP from the ankle, where this is, in words, and whether it is assumed."""
        wish, ankle = self.how.ankle, self.columns.get("ankle_x")
        if wish is not None:
            place = _place(wish)
            return cop - place, f"at {place:g} m by --ankle", False
        if ankle is not None:
            return cop - ankle, "from the file's ankle columns", False
        place = float(cop[good].mean())
        assumed.append(
            f"ankle taken at {place:.4g} m, under the mean CoP, so that the mean of toe and heel force is equal;"
            " give --ankle"
        )
        return cop - place, f"at {place:.4g} m, under the mean CoP", True

    def _posture(
        self, good: Flags, biped: Biped, given: bool, notes: list[str], warnings: list[str]
    ) -> tuple[Array | None, Array | None]:
        """The ankle's angle [rad] and the height of the centre of gravity above it [m], as far as measured."""
        get, file = self.columns.get, self.table.origin
        theta, height = get("angle"), None
        if theta is not None:
            warnings += checks.angle(theta[good], self.columns.quantities["angle"], file)
        parts = [get(role) for role in ("com_x", "com_y", "ankle_x", "ankle_y")]
        if all(part is not None for part in parts):
            com_x, com_y, ankle_x, ankle_y = (part for part in parts if part is not None)
            height = com_y - ankle_y
            warnings += checks.height(float(height[good].mean()), biped.L, given=given, file=file)
            if theta is None:
                theta = np.arctan2(com_x - ankle_x, height)
                notes.append("angle from the ankles to the centre of gravity, from the vertical")
        return theta, height


@dataclass(frozen=True, eq=False, kw_only=True)
class _Contact:
    """Contact forces of the table's rows; ``empty``: rows without load; ``lost``: without a CoP under load."""

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


def _foot_ratio(cop: Array, P: Array, good: Flags) -> float | None:
    """How many times the file's CoP is ``P``, that of the assumed foot by (18); None where that says no foot."""
    if P[good].std() < 1e-6:
        return None
    ratio = float(np.polyfit(P[good], cop[good], 1)[0])
    return ratio if 0.2 < ratio < 5 else None


def _note(found: checks.Agreement | None, notes: list[str], warnings: list[str]) -> None:
    if found is not None:
        (notes if found.close else warnings).append(found.said)


def _lost_cop(cop: Array, good: Flags) -> Flags:
    """Loaded rows whose CoP (n,) is exactly 0 between others that are far from it: the plate did not say one."""
    lost = np.zeros(len(cop), dtype=bool)
    zero = np.flatnonzero(good & (cop == 0))
    told = np.flatnonzero(good & (cop != 0))
    if not len(zero) or len(told) < FEWEST:
        return lost
    usual = float(np.percentile(np.abs(np.diff(cop[told])), 90.0))
    place = np.searchsorted(told, zero)
    before, after = told[np.maximum(place - 1, 0)], told[np.minimum(place, len(told) - 1)]
    nearest = np.minimum(np.abs(cop[before]), np.abs(cop[after]))
    lost[zero[nearest > max(10 * usual, 2e-3)]] = True
    return lost


def _place(text: str) -> float:
    number, _, said = text.partition(":")
    unit = unit_of(said) if said else "m"
    scale = factor(unit, "position") if unit else None
    try:
        value = float(number)
    except ValueError:
        value = np.nan
    if scale is None or not np.isfinite(value) or abs(value * scale) > 100:
        message = f"is {text[:40]!r}; needs a position as 0.21 or 21:cm ({', '.join(FACTORS['position'])})"
        raise BadInput(message, key="--ankle")
    return value * scale


def derivative(t: Array, values: Array) -> Array:
    """The rate of change of regularly sampled ``values`` (n,): slope of the parabola fitted in a ``WINDOW`` [s]."""
    period = float(t[-1] - t[0]) / (len(t) - 1)
    half = max(1, min(round(0.5 * WINDOW / period), (len(t) - 1) // 2))
    offsets = np.arange(-half, half + 1)
    padded = np.concatenate([
        2 * values[0] - values[half:0:-1], values, 2 * values[-1] - values[-2 : -half - 2 : -1]
    ])  # fmt: skip
    kernel = offsets / (period * float((offsets**2).sum()))
    return np.convolve(padded, kernel[::-1], mode="valid")


def _check_rates(slope: Array, omega: Array, names: tuple[str, str], file: str) -> None:
    if slope.std() < 1e-9 or omega.std() < 1e-9:
        return
    correlation = float(np.corrcoef(slope, omega)[0, 1])
    factor = float(omega.std() / slope.std()) * float(np.sign(correlation))
    checks.rates(factor, correlation, names, file)
