"""The time base: the file's stamps if they are regular, a stated rate, or a regular grid that the user asks for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.errors import BadInput
from design.recordings.columns import Columns
from design.recordings.reading import Reading
from design.recordings.remedies import Misfit, Remedy
from design.recordings.table import Array, Table

IRREGULAR = 0.25
"""The part of the sampling period by which a step may differ from it: stamps are rounded."""
SLOWEST, FASTEST = 1.0, 20_000.0
"""Sampling rates of recordings [Hz]; what lies outside is in another unit."""
EXACT = 0.05
"""How exactly the rate must follow from stamps that were rounded."""
MOST_SAMPLES = 20_000_000


@dataclass(frozen=True, eq=False, kw_only=True)
class Clock:
    """When the samples were taken.

    Times ``t`` (n,) [s] and their ``rate`` [Hz]; ``rows`` (m,) of the table in the order of their ``stamps`` (m,),
    between which quantities are interpolated where ``resampled``.
    """

    t: Array
    rate: float
    rows: NDArray[np.int64] | slice
    stamps: Array
    resampled: bool
    said: tuple[str, ...]

    def at(self, values: Array) -> Array:
        """A quantity of the table's rows at the times ``t``."""
        own = values[self.rows]
        return np.interp(self.t, self.stamps, own) if self.resampled else own

    def all_true(self, flags: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Whether the rows on both sides of each time are true, and near."""
        own = flags[self.rows]
        if not self.resampled:
            return own
        right, left = self._beside()
        return np.asarray(own[left] & own[right] & self.near())

    def near(self) -> NDArray[np.bool_]:
        """Whether each time lies between rows that are near: where it does not, rows are missing."""
        if not self.resampled:
            return np.ones(len(self.t), dtype=bool)
        right, left = self._beside()
        usual = float(np.median(np.diff(self.stamps)))
        return np.asarray(self.stamps[right] - self.stamps[left] <= 5 * max(usual, 1 / self.rate))

    def any_true(self, flags: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Whether a row beside each time is true, where there are rows."""
        own = flags[self.rows]
        if not self.resampled:
            return own
        right, left = self._beside()
        return np.asarray((own[left] | own[right]) & self.near())

    def _beside(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The places of the stamps at or after each time, and at or before it."""
        right = np.clip(np.searchsorted(self.stamps, self.t - 1e-9), 0, len(self.stamps) - 1)
        exact = np.abs(self.stamps[right] - self.t) < 1e-9
        return right, np.where(exact, right, np.maximum(right - 1, 0))


def clock(table: Table, columns: Columns, how: Reading) -> Clock:
    """The times of the samples; raises ``BadInput`` for stamps that are not regular, unless ``how`` says what to do."""
    for name, rate in (("--rate", how.rate), ("--resample", how.resample)):
        if rate is not None and not SLOWEST / 100 <= rate <= 10 * FASTEST:
            message = f"is {rate:g}; needs a sampling rate from {SLOWEST / 100:g} to {10 * FASTEST:g} Hz"
            raise BadInput(message, key=name)
    n = len(table.values)
    stamps = columns.get("time")
    if how.rate is not None or stamps is None:
        rate = how.rate or table.rate
        if rate is None:
            message = "has no time column that is known by name; give --columns time=NAME:s, or the sampling --rate HZ"
            raise BadInput(message, file=table.origin)
        source = f"time from the sampling rate of {rate:g} Hz" + ("" if how.rate else ", stated in the file")
        if stamps is not None:
            source += f"; column {columns.quantities['time'].columns} is not used"
        even: Array = np.arange(n) / rate
        return _resampled(even, np.arange(n), how, table, [source]) if how.resample else _plain(even, rate, [source])
    blank = _blank(columns)
    stamps, filled = _filled(np.where(blank, np.nan, stamps) if blank.any() else stamps, table)
    steps = np.diff(stamps)
    if how.resample:
        order = np.argsort(stamps, kind="stable")
        keep = np.concatenate([[True], np.diff(stamps[order]) > 0])
        said = list(filled)
        if (steps <= 0).any():
            said.append(f"{int((steps <= 0).sum())} duplicate or backward time stamps: sorted, duplicates dropped")
        return _resampled(stamps[order][keep], order[keep], how, table, said)
    if (rounded := _rounded_rate(stamps)) is not None:
        rate, quantum = rounded
        even = float(stamps[0]) + np.arange(n) / rate
        return _plain(even, rate, [*filled, f"time stamps are rounded to {quantum:g} s: {rate:g} Hz from their number"])
    return _plain(stamps, _regular_rate(stamps, steps, columns, table), filled)


def _plain(t: Array, rate: float, said: list[str]) -> Clock:
    return Clock(t=t, rate=rate, rows=slice(None), stamps=t, resampled=False, said=tuple(said))


def _blank(columns: Columns) -> NDArray[np.bool_]:
    """Rows but the first that are zero throughout, time included, where most rows are not: drop-outs of all columns."""
    quantities = columns.every()
    zero = np.logical_and.reduce([quantity.values == 0 for quantity in quantities])
    zero[:1] = False
    return np.asarray(zero & (zero.mean() < 0.5) & (len(quantities) > 1))


def _filled(stamps: Array, table: Table) -> tuple[Array, list[str]]:
    missing = ~np.isfinite(stamps)
    if not missing.any():
        return stamps, []
    if missing.all():
        message = "has no readable time stamps; give the sampling --rate HZ"
        raise BadInput(message, file=table.origin)
    rows = np.arange(len(stamps), dtype=float)
    inside = np.interp(rows, rows[~missing], stamps[~missing])
    first, last = np.flatnonzero(~missing)[[0, -1]]
    period = (stamps[last] - stamps[first]) / max(last - first, 1)
    inside[:first] = stamps[first] - period * np.arange(first, 0, -1)
    inside[last + 1 :] = stamps[last] + period * np.arange(1, len(stamps) - last)
    return inside, [f"{int(missing.sum())} missing time stamps filled in between their neighbours"]


def _rounded_rate(stamps: Array) -> tuple[float, float] | None:
    """The rate [Hz] of even stamps that were rounded to fewer digits than it needs, and their last digit [s].

    Rounded stamps are multiples of this digit, and lie within it of a straight line; a stamp that comes twice, or is
    missing, in even stamps is no rounding: their period is a multiple of the digit.
    """
    steps = np.diff(stamps)
    if len(steps) < 20 or (steps < 0).any() or not (steps > 0).any():
        return None
    scaled = ((digits, 10.0**digits * stamps) for digits in range(7))
    places = next((digits for digits, each in scaled if np.abs(each - np.rint(each)).max() < 1e-5), None)
    if places is None:
        return None
    quantum, period = 10.0**-places, float(stamps[-1] - stamps[0]) / len(steps)
    if not EXACT * (stamps[-1] - stamps[0]) > quantum > 0.25 * period:
        return None
    if abs(period / quantum - max(round(period / quantum), 1)) < 0.02:
        return None
    index = np.arange(len(stamps))
    period = float(np.polyfit(index, stamps - stamps[0], 1)[0])
    off = stamps - stamps[0] - period * index
    if float(off.max() - off.min()) > 1.2 * quantum:
        return None
    return float(f"{1 / period:.4g}"), float(f"{quantum:.6g}")


def _regular_rate(stamps: Array, steps: Array, columns: Columns, table: Table) -> float:
    name = columns.quantities["time"].columns
    if not len(steps):
        message = "has one row; needs a recording with one row a sample"
        raise BadInput(message, file=table.origin)
    usual = float(np.median(steps))
    odd = steps <= 0
    if not odd.any():
        odd = np.abs(steps - usual) > IRREGULAR * usual
    if odd.any():
        k = int(np.argmax(odd))
        step = float(steps[k])
        what = "repeats the time before" if step == 0 else "goes back" if step < 0 else f"comes {step:.6g} s later"
        usually = "" if step <= 0 else f" (usually {usual:.6g} s)"
        more = f"; {int(odd.sum())} such steps" if odd.sum() > 1 else ""
        span = float(stamps.max() - stamps.min())
        guess = 1 / usual if usual > 0 and odd.mean() < 0.02 else len(steps) / span if span > 0 else 0.0
        if stamps[k + 1] <= stamps[0] + 0.5 * usual:
            message = (
                f"begins again, {stamps[k]:.9g} to {stamps[k + 1]:.9g} s: more than one trial in the file; keep one"
                " (of `poise simulate`: --scenario NAME)"
            )
            raise BadInput(message, file=table.origin, key=f"{table.place} {table.lines[k + 1]}, column {name}")
        message = (
            f"{what}, {stamps[k]:.9g} to {stamps[k + 1]:.9g} s{usually}{more}; needs regular time stamps; mend them"
        )
        remedies = [
            Remedy(options={"--resample": f"{guess:.4g}"}),
            Remedy(options={"--rate": f"{guess:.4g}"}, when=" if only the stamps are wrong"),
        ] if guess > 0 else []  # fmt: skip
        key = f"{table.place} {table.lines[k + 1]}, column {name}"
        raise Misfit(message, file=table.origin, key=key, remedies=remedies)
    rate = (len(stamps) - 1) / float(stamps[-1] - stamps[0])
    if not SLOWEST <= rate <= FASTEST:
        unit = columns.quantities["time"].unit
        likely = ["ms", "us"] if rate < SLOWEST and unit == "s" else ["s"] if rate > FASTEST and unit != "s" else []
        perhaps = f"; it is perhaps in {likely[0]}" if likely else ""
        message = f"read in {unit} gives a sampling rate of {rate:.4g} Hz; needs {SLOWEST:g} to {FASTEST:g} Hz{perhaps}"
        remedies = [Remedy(options={"time": f"{name}:{unit}"}) for unit in likely]
        raise Misfit(
            message, file=table.origin, key=f"column {name}", remedies=remedies,
            otherwise=f"give --columns time={name}:UNIT, or --rate HZ",
        )  # fmt: skip
    multiple = rate / table.rate if table.rate else 1.0  # plates are often sampled at a multiple of the cameras' rate
    if abs(multiple / max(round(multiple), 1) - 1) > 0.02 or multiple > 50:
        message = f"gives a sampling rate of {rate:.5g} Hz, and the header states {table.rate:g} Hz"
        units = ("ms", "us") if columns.quantities["time"].unit == "s" else ()
        remedies = [
            *(Remedy(options={"time": f"{name}:{unit}"}) for unit in units),
            Remedy(options={"--rate": f"{table.rate:.6g}"}, when=" if only the stamps are wrong"),
        ]  # fmt: skip
        raise Misfit(
            message, file=table.origin, key=f"column {name}", remedies=remedies,
            otherwise=f"give the unit of time with --columns time={name}:UNIT, or the right --rate",
        )  # fmt: skip
    return round(rate, 6)


def _resampled(stamps: Array, rows: NDArray[np.int64], how: Reading, table: Table, said: list[str]) -> Clock:
    assert how.resample is not None
    rate = how.resample
    count = int((stamps[-1] - stamps[0]) * rate + 1e-9) + 1
    if count > MOST_SAMPLES:
        message = f"gives {count:,} samples; at most {MOST_SAMPLES:,}; choose a lower rate"
        raise BadInput(message, file=table.origin, key="--resample")
    t = stamps[0] + np.arange(count) / rate
    said = [*said, f"resampled to {rate:g} Hz: {len(stamps):,} rows to {count:,} samples, by linear interpolation"]
    return Clock(t=t, rate=rate, rows=rows, stamps=stamps, resampled=True, said=tuple(said))
