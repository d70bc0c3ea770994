"""What `poise estimate` says of a recording: words, JSON, CSV, a picture, and a spec with the measured force."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from design.analysis.measured import judge_record, left_out
from design.analysis.recorded import Estimates, Least, cop_margin, estimates, least
from design.errors import BadInput
from design.present import opening, plots, recording_plots, recording_spec, store, terminal
from design.present.report import Report
from design.present.text import bound, number, table, wrapped
from design.recordings.reading import Reading
from design.recordings.record import Record, open_record
from design.recordings.table import printable
from design.spec.load import Source, load
from design.spec.setting import setting

Array = np.ndarray[Any, np.dtype[np.float64]]

ROWS = 20_000
"""Rows of CSV that are made at a time."""

ASSUMED_SPEC = "adult-slope"
"""Whose foot is taken where no spec is given."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Measured:
    """A record, what is estimated from it, and the spec that it is read against."""

    source: Source
    record: Record
    found: Estimates


def measured(file: str, how: Reading, spec: str | None, *, strict: bool = False) -> Measured:
    """Read and check the recording in ``file``; warnings go to standard error, ``strict`` makes the first an error."""
    source = opening.opened(spec, strict=strict)[0] if spec else load(ASSUMED_SPEC)
    problem = setting(source.spec)
    problem.must_not_load_the_foot("a recording")
    record = open_record(file, how, problem.biped, given=spec is not None, target=problem.target)
    _remark(record, strict=strict)
    return Measured(source=source, record=record, found=estimates(record, problem))


def judged(file: str, how: Reading, spec: str, *, strict: bool = False) -> Report:
    """The report on a recording against the requirements of ``spec``."""
    source, problem = opening.opened(spec, strict=strict)
    problem.must_not_load_the_foot("a recording")
    record = open_record(file, how, problem.biped, given=True, target=problem.target)
    _remark(record, strict=strict)
    verdict = judge_record(problem, record)
    span = float(record.t[-1] - record.t[0])
    remarks = [f"measured: {int(record.valid.sum()):,} of {len(record.t):,} samples over {span:g} s"]
    remarks += [f"assumed: {said}" for said in record.assumed]
    remarks += dropouts_said(record)
    missing = left_out(problem, record)
    besides = f"; among them these requirements of the spec: {', '.join(missing)}" if missing else ""
    remarks.append(
        f"left out, as a recording does not tell them: rows of the linear loop and of simulated runs{besides}"
    )
    return Report(source=source, setting=problem, gains=None, verdict=verdict, record=record, remarks=tuple(remarks))


def _remark(record: Record, *, strict: bool) -> None:
    for remark in record.warnings:
        if strict:
            message = f"{remark} (--strict)"
            raise BadInput(message, file=record.origin)
        terminal.note(f"warning: {printable(record.origin)}: {remark}")


def render(
    file: str,
    how: Reading,
    form: str,
    spec: str | None,
    plot: str | None,
    as_spec: str | None,
    every: float | None,
    output: str | None,
    *,
    strict: bool = False,
) -> str | Iterator[str]:
    """The recording in a ``form``: text, json or (in parts) csv; picture and spec are written where they are wanted."""
    picture = plots.format_of(plot) if plot else None
    check_apart(file, spec, {"--plot": plot, "--as-spec": as_spec, "-o": output})
    store.check_writable(plot, as_spec, output)
    if every is not None and as_spec is None:
        message = "is the interval of the profile that --as-spec writes; give --as-spec OUT.toml too"
        raise BadInput(message, key="--every")
    result = measured(file, how, spec, strict=strict)
    written = as_csv(result) if form == "csv" else {"text": as_text, "json": as_json}[form](result)
    profile = recording_spec.as_toml(result.source, result.record, result.found, every) if as_spec else None
    if plot and picture:
        store.write(plot, plots.figure_bytes(recording_plots.figure(result.record, result.found), picture))
    if as_spec and profile:
        store.write(as_spec, profile.text)
        terminal.note(f"{as_spec}: {profile.said}")
    return written


def check_apart(file: str, spec: str | None, written: dict[str, str | None]) -> None:
    """Raise ``BadInput`` where a file to be written is one that is read, or is named twice."""
    taken = [(place, what) for place, what in ((file, "the recording itself"), (spec, "the spec")) if place]
    for option, place in written.items():
        if place is None or (place == "-" and option == "-o"):
            continue
        for other, what in taken:
            if other != "-" and _same(place, other):
                message = f"names {place}, which is {what}; it would be lost: choose another place"
                raise BadInput(message, key=option)
        taken.append((place, f"the file of {option} too"))


def _same(one: str, other: str) -> bool:
    """Whether two paths are one regular file, now or once it is written."""
    a, b = Path(one), Path(other)
    try:
        if a.exists() and b.exists():
            return a.is_file() and a.samefile(b)
        return a.resolve() == b.resolve()
    except (OSError, ValueError, RuntimeError):
        return False


def dropouts_said(record: Record, most: int = 6) -> list[str]:
    """Drop-outs and unreadable samples in sentences: how many, and when."""
    found = []
    for flags, name in ((record.dropouts, "without load (drop-outs)"), (record.gaps, "without a readable value")):
        if not flags.any():
            continue
        spans = record.spans(flags)
        times = [f"{a:g} s" if count == 1 else f"{a:g} to {b:g} s ({count})" for a, b, count in spans[:most]]
        more = f" and {len(spans) - most} more spans" if len(spans) > most else ""
        count = int(flags.sum())
        found.append(f"{count} row{'s' * (count != 1)} {name}, masked: {', '.join(times)}{more}")
    return found


def as_text(result: Measured) -> str:
    """The words for a terminal."""
    record, found = result.record, result.found
    span = float(record.t[-1] - record.t[0])
    lines = wrapped(f"{printable(record.origin)}: {len(record.t):,} samples, {span:g} s at {record.rate:g} Hz")
    lines += wrapped(f"read: {'; '.join(record.notes)}", "  ")
    lines += wrapped("taken: " + ", ".join(f"{role} = {said}" for role, said in record.columns.items()), "  ")
    lines += [line for said in record.assumed for line in wrapped(f"ASSUMED: {said}", "  ")]
    dropped = dropouts_said(record) or ["no drop-outs"]
    lines += [line for said in dropped for line in wrapped(said, "  ")]
    lines.append("")
    load = least(record, record.load)
    if load is not None:
        weight = record.biped.weight
        body = f"{result.source.spec.name}'s weight" if record.given else "the weight assumed"
        lines += [
            f"mean vertical force {load.mean:.2f} N; {body} {weight:.2f} N ({100 * (load.mean / weight - 1):+.2f} %)",
            "",
        ]
    rows = [
        (name, least(record, values), scale, unit)
        for name, values, scale, unit in (
            ("toe force", record.F_T, 1.0, "N"),
            ("heel force", record.F_H, 1.0, "N"),
            ("CoP in the file", record.cop, 1e3, "mm"),
            ("CoP from the ankle", record.P, 1e3, "mm"),
            ("CoP to foot's end", cop_margin(record), 1e3, "mm"),
            ("ankle angle", record.theta, math.degrees(1.0), "deg"),
            ("CoG above ankle", record.height, 1e3, "mm"),
            ("ankle torque", record.torque, 1.0, "N m"),
            ("estimate of F_x", found.F_x, 1.0, "N"),
            ("estimate of F_y", found.F_y, 1.0, "N"),
        )
    ]
    body_rows = [
        [
            name,
            number(scale * each.value),
            number(each.time, 5),
            number(scale * each.mean),
            number(scale * each.most),
            unit,
        ]
        for name, each, scale, unit in rows
        if each is not None
    ]
    lines += table(["", "least", "at s", "mean", "most", "unit"], body_rows, right=(1, 2, 3, 4))
    lines.append("")
    lost = _lost(record)
    if lost:
        lines += wrapped(lost)
    if found.how_x == found.how_y:
        lines += wrapped(f"F_x and F_y {found.how_x}")
    else:
        lines += [*wrapped(f"F_x {found.how_x}"), *wrapped(f"F_y {found.how_y}")]
    if found.spread is not None:
        bias = found.bias or (math.nan, math.nan)
        parts = zip(("F_x", "F_y"), found.spread, bias, strict=True)
        errors = ", ".join(
            f"{name} ± {number(spread, 3)} N by noise"
            + ("" if math.isnan(off) else f", {bound(off, 3, up=True)} N by the body")
            for name, spread, off in parts
            if not math.isnan(spread)
        )
        what = (
            "noise: standard deviation, a mean over time; tolerances: none given"
            if found.bias is None
            else "noise: standard deviation, a mean over time; body: the most that a body within [uncertainty] moves"
            " the estimate by at any time; how late a changing force is read comes on top"
        )
        lines += wrapped(f"errors: {errors} ({what})")
    return "\n".join(lines) + "\n"


def _lost(record: Record) -> str:
    """What of contact is lost, in a sentence; empty if nothing is."""
    if record.F_T is None or record.F_H is None:
        return ""
    broken = record.valid & ((record.F_T < 0) | (record.F_H < 0))
    if not broken.any():
        return ""
    first = int(np.argmax(broken))
    return (
        f"CONTACT LOST: {int(broken.sum())} samples have their CoP beyond the foot, the first at {record.t[first]:g} s;"
        " or the ankle's place or the foot's length is another"
    )


def as_json(result: Measured) -> str:
    """The recording's figures as stored."""
    record, found = result.record, result.found
    load = least(record, record.load)
    facts = store.document(
        "estimate",
        result.source,
        status="estimated",
        spec_assumed=not record.given,
        **store.record_json(record),
        dropout_spans_s=[[a, b] for a, b, _ in record.spans(record.dropouts)],
        start_s=float(record.t[0]),
        duration_s=float(record.t[-1] - record.t[0]),
        rate_hz=record.rate,
        weight_n=record.biped.weight,
        mean_vertical_force_n=None if load is None else load.mean,
        toe_force_n=_figures(least(record, record.F_T)),
        heel_force_n=_figures(least(record, record.F_H)),
        cop_m=_figures(least(record, record.cop)),
        cop_from_ankle_m=_figures(least(record, record.P)),
        cop_margin_m=_figures(least(record, cop_margin(record))),
        angle_deg=_figures(least(record, None if record.theta is None else np.degrees(record.theta))),
        com_height_m=_figures(least(record, record.height)),
        torque_nm=_figures(least(record, record.torque)),
        fx_n=_figures(least(record, found.F_x)),
        fy_n=_figures(least(record, found.F_y)),
        fx_static_n=_figures(least(record, found.static_x)),
        estimate_error_n=None
        if found.spread is None
        else {
            "fx_spread": found.spread[0],
            "fy_spread": found.spread[1],
            "fx_bias": found.bias and found.bias[0],
            "fy_bias": found.bias and found.bias[1],
        },
        fx_method=found.how_x,
        fy_method=found.how_y,
    )
    return store.dumps(facts)


def _figures(found: Least | None) -> dict[str, float] | None:
    return None if found is None else {
        "min": found.value, "min_time_s": found.time, "max": found.most, "mean": found.mean
    }  # fmt: skip


def as_csv(result: Measured) -> Iterator[str]:
    """The samples, ``ROWS`` at a time; what was not measured is an empty column, what is not valid an empty cell."""
    record, found = result.record, result.found
    columns: dict[str, Array | None] = {
        "vertical_force_n": record.load, "toe_force_n": record.F_T, "heel_force_n": record.F_H, "cop_m": record.cop,
        "cop_from_ankle_m": record.P, "cop_margin_m": cop_margin(record), "theta_rad": record.theta,
        "rate_rad_per_s": record.omega, "torque_nm": record.torque, "fx_estimate_n": found.F_x,
        "fy_estimate_n": found.F_y,
    }  # fmt: skip
    yield ",".join(["time_s", *columns, "valid"]) + "\n"
    for first in range(0, len(record.t), ROWS):
        part = slice(first, first + ROWS)
        usable = record.valid[part]
        cells: list[Iterable[str]] = [map(repr, record.t[part].tolist())]
        for values in columns.values():
            known = usable & np.isfinite(values[part]) if values is not None else np.zeros_like(usable)
            if values is None or not known.any():
                cells.append([""] * len(usable))
            elif known.all():
                cells.append(map(repr, values[part].tolist()))
            else:
                both = zip(values[part].tolist(), known.tolist(), strict=True)
                cells.append([repr(x) if ok else "" for x, ok in both])
        cells.append(map(str, usable.astype(int).tolist()))
        yield "\n".join(map(",".join, zip(*cells, strict=True))) + "\n"
