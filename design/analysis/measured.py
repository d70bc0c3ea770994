"""The contact rows of a report on a measured trial: read off the valid samples of a recording instead of a run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from design.analysis.recorded import thinned
from design.analysis.rows import Row, Series, Verdict
from design.errors import BadInput
from design.model.limits import Limit, limits
from design.model.plant import plant
from design.recordings.record import Record
from design.spec.setting import Setting

Array = NDArray[np.float64]


def judge_record(setting: Setting, record: Record) -> Verdict:
    """Contact forces, CoP margin, and torque and friction where they were measured, against the requirements.

    Raises ``BadInput`` for a recording without contact forces. What needs a simulation is left out.
    """
    if record.F_T is None or record.F_H is None or record.P is None or record.load is None:
        message = "has no contact forces; a report needs toe and heel force, or a vertical force and its CoP"
        raise BadInput(message, file=record.origin)
    foot = record.biped
    components: dict[str, Array] = {
        "toe-force": record.F_T[None, :],
        "heel-force": record.F_H[None, :],
        "cop-margin": np.vstack([foot.toe - record.P, foot.heel + record.P]),
    }
    if record.torque is not None:
        components["torque"] = np.vstack([record.torque, -record.torque])
    if record.horizontal is not None:
        slip = record.horizontal / np.where(record.valid, record.load, np.nan)
        components["friction"] = np.vstack([slip, -slip])
    bounds = {limit.id: limit for limit in limits(plant(setting.biped), setting.required)}
    rows, series = [], []
    for row, parts in components.items():
        limit = bounds[row]
        value = np.where(record.valid, limit.value(parts), np.nan)
        rows.append(_row(limit, value, record))
        t, drawn = thinned(record.t, value)
        series.append(
            Series(
                id=row, scenario=_name(record), unit=limit.unit, sense=limit.sense, t=t, value=drawn,
                level=limit.required.level if limit.required else None,
            )
        )  # fmt: skip
    return Verdict(rows=tuple(rows), trajectories=(), series=tuple(series))


def left_out(setting: Setting, record: Record) -> list[str]:
    """Requirements of the spec that this recording cannot answer."""
    answered = {"contact-force", "cop-margin"}
    answered |= {"torque"} if record.torque is not None else set()
    answered |= {"friction"} if record.horizontal is not None else set()
    return [row for row in setting.required if row not in answered]


def _name(record: Record) -> str:
    return Path(record.origin).name


def _row(limit: Limit, value: Array, record: Record) -> Row:
    level = limit.required.level if limit.required else 0.0
    usable = np.isfinite(value)
    margins = np.where(usable, limit.margin(value, level), np.inf)
    at = int(np.argmin(margins))
    lost = [(int(record.dropouts.sum()), "drop-outs"), (int(record.gaps.sum()), "unreadable rows")]
    note = ", ".join(f"{count} {what}" for count, what in lost if count)
    soft = bool(limit.required and limit.required.soft)
    if limit.floor is not None and limit.margin(float(value[at]), limit.floor) < 0:
        soft = False
    return Row(
        id=limit.id, equation=limit.equation, scenario=_name(record), unit=limit.unit, value=float(value[at]),
        required=limit.required.level if limit.required else None,
        margin=float(margins[at]) if limit.required else None, status="met" if margins[at] >= 0 else "violated",
        time_s=float(record.t[at]), basis="measured", soft=soft, note=f"{note} masked" if note else "",
    )  # fmt: skip
