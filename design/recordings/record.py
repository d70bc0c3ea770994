"""A recording as a ``Record``: contact forces and CoP of a trial in SI units, checked, with drop-outs masked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.errors import BadInput, one_line
from design.model.body import Biped
from design.recordings import posture_checks
from design.recordings.balance_board import PLACE, with_board
from design.recordings.clock import Clock, clock
from design.recordings.columns import Columns, assign
from design.recordings.contact import FEWEST, Contact, contact
from design.recordings.files import read_bytes, table_of
from design.recordings.horizontal import CLEAR, against_cop
from design.recordings.plates import Flags, Plate, Quantity
from design.recordings.reading import Reading
from design.recordings.remarks import Remarks, Subject
from design.recordings.remedies import Misfit
from design.recordings.selection import negated
from design.recordings.table import Array, Table

WINDOW = 0.2
"""Width of the window in which an angle is differentiated [s]; a recording must be longer."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Record:
    """One measured trial of ``biped``; arrays (n,) in SI units, those that were not measured None.

    ``load`` = F_T + F_H; ``P``: CoP from the ankle, toe side positive; ``cop``: CoP in the file's frame;
    ``horizontal``: forward force of the ground on the foot. ``valid``: samples with every needed number and load;
    ``dropouts``: samples without load; ``gaps``: samples with an unreadable or a missing value. ``given``: ``biped`` is
    the user's spec, not an assumption; ``ankle_assumed``: nobody stated where the ankle is, and the mean of ``P`` is
    the law's target. ``plates``: those with load, in words. ``notes``: what was read and detected;
    ``assumed``: what nobody stated; ``warnings``.
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
    plates: tuple[str, ...]
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


def open_record(path: str, how: Reading, biped: Biped, *, given: bool, target: float = 0.0) -> Record:
    """The recording in the file at ``path``, of ``biped``; raises ``BadInput`` for whatever does not fit.

    ``given`` False: only the foot of ``biped`` is taken, and the mass follows from the mean vertical force. ``target``:
    P_d [m], where the law would hold the CoP. What a message proposes was tried on the file.
    """
    subject = Subject(biped=biped, given=given, target=target)
    content = read_bytes(path) if path == "-" else None  # which can be read only once
    tables: dict[tuple[object, ...], Table] = {}

    def read(way: Reading) -> Record:
        form = (way.delimiter, way.decimal, way.skip_rows, way.allow_gaps)
        if form not in tables:
            tables.clear()  # a long one fills the memory
            tables[form] = table_of(read_bytes(path) if content is None else content, path, way)
        return recorded(tables[form], way, subject)

    try:
        return read(how)
    except Misfit as misfit:
        raise misfit.advised(lambda way: len(read(way).warnings), how) from None


def recorded(table: Table, how: Reading, subject: Subject) -> Record:
    """The checked record in a ``table``."""
    table, board = with_board(table)
    columns = assign(table, how)
    time = clock(table, columns, how)
    if not any(PLACE in plate.columns for plate in columns.plates):
        board = []
    return Trial(table=table, columns=columns, how=how, time=time, say=Remarks(assumed=board)).record(subject)


@dataclass(frozen=True, eq=False, kw_only=True)
class Trial:
    """A table whose columns and times are known; ``record`` makes the ``Record``."""

    table: Table
    columns: Columns
    how: Reading
    time: Clock
    say: Remarks

    def record(self, subject: Subject) -> Record:
        """The checked record."""
        file, t, say = self.table.origin, self.time.t, self.say
        say.notes += [*self.columns.notes, *self.time.said]
        say.assumed += self.columns.assumed
        say.warnings += self.columns.warnings
        gaps = self._gaps()

        # contact: load, toe and heel force, CoP
        seconds = float(t[-1] - t[0])
        stood = contact(self.table, self.columns, self.how, gaps, subject, seconds, say)
        gaps = gaps | stood.lost
        good = ~(gaps | stood.empty)

        # posture, compared with the forces
        theta, height = self._posture(good, stood.biped, subject)
        self._compare(stood, theta, good, subject)

        # everything at the record's times
        used = {**{r: q for r, q in self.columns.quantities.items() if r != "time"}, **stood.taken}
        every = {**({"time": self.columns.quantities["time"]} if "time" in self.columns.quantities else {}), **used}
        taken = {role: f"{quantity.columns} [{quantity.unit}]" for role, quantity in every.items()}
        horizontal = self._sampled(stood.horizontal, good)
        if horizontal is not None and theta is None:
            horizontal = self._signed(horizontal, self._sampled(stood.cop, good), stood.taken["fx"], taken)
        at_theta, omega = self._motion(theta, good)
        if theta is not None and stood.load is not None and not subject.given:
            say.assumed.append(
                f"height {stood.biped.L:g} m of the centre of gravity and inertia {stood.biped.I:g} kg m2 of the"
                " built-in adult-slope (give --spec)"
            )
        say.assumed += [
            f"{role} (column{'s' * ('+' in q.columns)} {q.columns}) is in {q.unit}, as nothing is said"
            for role, q in used.items() if not q.sure
        ]  # fmt: skip
        at = self._sampled
        return Record(
            origin=one_line(file), sha256=self.table.sha256, biped=stood.biped, given=subject.given,
            ankle_assumed=stood.ankle_assumed, t=t, rate=self.time.rate,
            valid=self.time.all_true(good), dropouts=self.time.any_true(stood.empty),
            gaps=self.time.any_true(gaps) | ~self.time.near(), load=at(stood.load, good), F_T=at(stood.F_T, good),
            F_H=at(stood.F_H, good), P=at(stood.P, good), cop=at(stood.cop, good), theta=at_theta, omega=omega,
            torque=at(self.columns.get("torque"), good), horizontal=horizontal, height=at(height, good), columns=taken,
            plates=tuple(map(_described, stood.plates)), notes=(*self.table.detected, *say.notes),
            assumed=tuple(say.assumed), warnings=tuple(say.warnings),
        )  # fmt: skip

    def _gaps(self) -> Flags:
        """Rows without a number in a column of no plate; raises ``BadInput`` for a recording that is too short."""
        file, t = self.table.origin, self.time.t
        if len(t) < FEWEST or t[-1] - t[0] < WINDOW:
            span = t[-1] - t[0] if len(t) else 0.0
            message = (
                f"is too short: {len(t)} samples over {span:.3g} s; needs at least {FEWEST} samples and {WINDOW:g} s,"
                " the window in which angles are differentiated"
            )
            raise BadInput(message, file=file)
        gaps = np.zeros(len(self.table.values), dtype=bool)
        used = {role: quantity for role, quantity in self.columns.quantities.items() if role != "time"}
        for quantity in used.values():
            gaps |= ~np.isfinite(quantity.values)
        if gaps.all():
            message = f"has no row in which every needed column ({', '.join(used)}) holds a number"
            raise BadInput(message, file=file)
        return gaps

    def _sampled(self, values: Array | None, good: Flags) -> Array | None:
        """A quantity at the record's times, bridged linearly over rows that are not ``good``."""
        if values is None:
            return None
        if not good.all():
            rows = np.arange(len(values), dtype=float)
            values = np.where(good, values, np.interp(rows, rows[good], values[good]))
        return self.time.at(values)

    def _compare(self, stood: Contact, theta: Array | None, good: Flags, subject: Subject) -> None:
        """Compare angle and ankle torque with the contact forces."""
        quantities, file = self.columns.quantities, self.table.origin
        if stood.load is not None and stood.P is not None and "angle" in quantities:
            assert theta is not None
            rate = quantities.get("rate")
            confirmed = "angle" in self.columns.selected or (rate is not None and rate.sure)
            posture_checks.posture(
                theta[good], stood.load[good], stood.P[good], quantities["angle"], stood.biped, file,
                confirmed=confirmed,
            )  # fmt: skip
        tau = self.columns.get("torque")
        if tau is not None and stood.F_T is not None and stood.F_H is not None:
            implied = stood.biped.behind(stood.F_T, stood.F_H) + stood.biped.tilt
            posture_checks.torque(
                tau[good], implied[good], quantities["torque"], file,
                size_known=subject.given or "toe" not in quantities or "cop" in stood.taken,
                place_known=not stood.ankle_assumed,
            )  # fmt: skip

    def _motion(self, theta: Array | None, good: Flags) -> tuple[Array | None, Array | None]:
        """Angle and angular rate at the record's times; the rate is the angle's derivative if none was measured."""
        omega, at_theta = self._sampled(self.columns.get("rate"), good), self._sampled(theta, good)
        if at_theta is None:
            return None, omega
        slope = derivative(self.time.t, at_theta)
        if omega is None:
            return at_theta, slope
        if self.columns.get("angle") is not None:
            names = (self.columns.quantities["angle"].columns, self.columns.quantities["rate"].columns)
            _check_rates(slope, omega, names, self.table.origin)
        return at_theta, omega

    def _signed(self, force: Array, cop: Array | None, fx: Quantity, taken: dict[str, str]) -> Array:
        """The horizontal ``force`` (n,) of ``fx`` with the sign of the force on the foot, which the CoP (n,) tells."""
        label, other = fx.columns, negated(fx.option)
        selected = "fx" in self.columns.selected
        likeness = None if cop is None else against_cop(force, cop, self.time.rate)
        if likeness is not None and likeness > CLEAR:
            if selected:
                self.say.warnings.append(
                    f"fx (column {label}) moves with the CoP (correlation {likeness:.2f}), as the force on the plate"
                    f" does: should it be fx={other}?"
                )
                return force
            self.say.notes.append(
                f"{label} is the force on the plate: it moves with the CoP (correlation {likeness:.2f}); its sign was"
                " turned"
            )
            taken["fx"] = taken["fx"].replace(label, negated(label), 1)
            return -force
        if not selected and (likeness is None or likeness > -CLEAR):
            why = "the recording does not tell" if likeness is None else f"correlation with the CoP {likeness:.2f}"
            why += ", and fx is turned with its plate" * (fx.option != label)
            self.say.assumed.append(
                f"{label} is the ground's force on the foot, not the force on the plate ({why}); else give fx={other}"
            )
        return force

    def _posture(self, good: Flags, biped: Biped, subject: Subject) -> tuple[Array | None, Array | None]:
        """The ankle's angle [rad] and the height of the centre of gravity above it [m], as far as measured."""
        get, file, say = self.columns.get, self.table.origin, self.say
        theta, height = get("angle"), None
        if theta is not None:
            say.warnings += posture_checks.angle(theta[good], self.columns.quantities["angle"], file)
        parts = [get(role) for role in ("com_x", "com_y", "ankle_x", "ankle_y")]
        if all(part is not None for part in parts):
            com_x, com_y, ankle_x, ankle_y = (part for part in parts if part is not None)
            height = com_y - ankle_y
            say.warnings += posture_checks.height(float(height[good].mean()), biped.L, given=subject.given, file=file)
            if theta is None:
                theta = np.arctan2(com_x - ankle_x, height)
                say.notes.append("angle from the ankles to the centre of gravity, from the vertical")
        return theta, height


def _described(plate: Plate) -> str:
    """A plate in words: its columns and its usual load."""
    return f"{plate.name}: {plate.columns}, usually {plate.load:.4g} N"


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
    posture_checks.rates(factor, correlation, names, file)
