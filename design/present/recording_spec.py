"""A spec whose one scenario is the external force of a recording, so that gains are found against what was measured."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from design.analysis.recorded import Estimates
from design.errors import BadInput
from design.recordings.record import Record
from design.spec.load import Source

MOST_POINTS = 100_000
LONGEST = 3600.0
"""The longest scenario [s]."""
EVERY = 0.05
"""The usual interval between points [s]: standing sways below a few hertz."""

Array = np.ndarray[Any, np.dtype[np.float64]]


@dataclass(frozen=True, kw_only=True)
class Profile:
    """The ``text`` of a spec, and what is ``said`` of it."""

    text: str
    said: str


def as_toml(source: Source, record: Record, found: Estimates, every: float | None = None) -> Profile:
    """The spec of ``source`` with the measured force as its one scenario, points ``every`` [s]."""
    F_x, F_y = found.F_x, found.F_y
    if F_x is None or F_y is None:
        message = f"needs both forces; F_x is {found.how_x}; give the angle's column, or the horizontal force's"
        raise BadInput(message, file=record.origin, key="--as-spec")
    duration = float(record.t[-1] - record.t[0])
    if duration > LONGEST:
        message = f"lasts {duration:.5g} s; a scenario lasts at most {LONGEST:g} s; cut the recording"
        raise BadInput(message, file=record.origin, key="--as-spec")
    step = max(EVERY, duration / (MOST_POINTS - 2), 1 / record.rate) if every is None else every
    if not 0 < step < duration or duration / step > MOST_POINTS - 2:
        message = f"is {step:g} s; needs more than {duration / (MOST_POINTS - 2):.3g} s and less than {duration:g} s"
        raise BadInput(message, key="--every")
    known = record.valid & np.isfinite(F_x) & np.isfinite(F_y)
    times, points = averaged(record.t - record.t[0], np.vstack([F_x, F_y]), known, step)
    data = source.spec.model_dump(mode="json", exclude_unset=True)
    scenario: dict[str, Any] = {"name": "measured", "kind": "profile", "duration_s": round(duration, 9)}
    if record.theta is not None:
        scenario["initial_angle_deg"] = _plain(math.degrees(record.theta[0]))
    if record.omega is not None:
        scenario["initial_rate_deg_per_s"] = _plain(math.degrees(record.omega[0]))
    scenario["points"] = [[round(float(t), 9), _plain(x), _plain(y)] for t, x, y in zip(times, *points, strict=True)]
    data["scenarios"] = [scenario]
    data["name"] = _name(record.origin)
    data["source"] = f"{data.get('source', '')}; force measured, sha256 {record.sha256}".removeprefix("; ")[:2000]
    if not record.given:
        data["body"]["mass_kg"] = _plain(record.biped.M)
        if "inertia_kgm2" in data["body"]:
            data["body"]["inertia_kgm2"] = _plain(record.biped.I * record.biped.M / source.spec.body.mass_kg)
    gaps = record.spans(~record.valid)
    longest = max((b - a + 1 / record.rate for a, b, _ in gaps), default=0.0)
    bridged = f"; {len(gaps)} gaps bridged, the longest {longest:g} s" if gaps else ""
    said = f"{len(times)} points every {step:g} s from {len(record.t)} samples, averaged between{bridged}"
    head = [
        "# Written by `poise estimate --as-spec` from a recording: its external force as a profile.",
        f"# {said}",
        f"# F_x {found.how_x}",
        f"# F_y {found.how_y}",
        f"# body of {source.spec.name}"
        + ("" if record.given else ", which nobody gave, with the mass of the recording"),
        *(f"# WARNING: {each}" for each in record.warnings),
        *(f"# assumed: {each}" for each in record.assumed),
    ]
    clean = ["".join(c if c.isprintable() else " " for c in line) for line in head]
    return Profile(text="\n".join([*clean, toml(data)]), said=said)


def _name(origin: str) -> str:
    """The recording's file name as the name of a spec."""
    plain = re.sub(r"[^A-Za-z0-9_. -]", "-", Path(origin).stem).lstrip("_. -")[:64].rstrip()
    return plain or "recording"


def averaged(t: Array, values: Array, valid: np.ndarray[Any, np.dtype[np.bool_]], step: float) -> tuple[Array, Array]:
    """Points every ``step`` [s]: means of the (c, n) ``values`` in a window of this width, invalid ones bridged.

    At the ends the window is as narrow on both sides as the end allows, so that a straight line stays one.
    """
    bridged = np.vstack([np.interp(t, t[valid], row[valid]) for row in values])
    count = math.floor(float(t[-1]) / step + 1e-9)
    times: Array = np.arange(count + 1, dtype=np.float64) * step
    if t[-1] - times[-1] > 1e-6 * step:
        times = np.concatenate([times, t[-1:]])
    period = float(t[-1]) / (len(t) - 1)
    centre = np.rint(times / period).astype(int)
    half = np.minimum.reduce([np.full(len(times), int(0.5 * step / period)), centre, len(t) - 1 - centre])
    sums = np.hstack([np.zeros((len(values), 1)), np.cumsum(bridged, axis=1)])
    means: Array = (sums[:, centre + half + 1] - sums[:, centre - half]) / (2 * half + 1)
    return times, means


def _plain(value: float) -> float:
    """Rounded to what a sensor tells, and never -0.0."""
    return float(f"{value:.9g}") + 0.0


def toml(data: dict[str, Any]) -> str:
    """``data`` as TOML: plain values first, then tables and arrays of tables."""
    return "\n".join(_table(data, "")) + "\n"


def _table(data: dict[str, Any], path: str) -> list[str]:
    lines, later = [], []
    for key, value in data.items():
        name = f"{path}{key}"
        if isinstance(value, dict) and path.count(".") < 1:
            later += ["", f"[{name}]", *_table(value, f"{name}.")]
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            for each in value:
                later += ["", f"[[{name}]]", *_table(each, f"{name}.")]
        elif value is not None:
            lines.append(f"{key} = {_value(value)}")
    return lines + later


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        escaped = "".join(c if c.isprintable() and c not in '"\\' else f"\\u{ord(c):04x}" for c in value)
        return f'"{escaped}"'
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_value(part)}" for key, part in value.items() if part is not None) + " }"
    if isinstance(value, list):
        if value and isinstance(value[0], list):
            return "[\n" + "".join(f"  {_value(part)},\n" for part in value) + "]"
        return "[" + ", ".join(map(_value, value)) + "]"
    return repr(value)
