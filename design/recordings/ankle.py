"""Where the ankle is: as the user or the file says, else where the law would hold the mean CoP."""

from __future__ import annotations

import numpy as np

from design.errors import BadInput
from design.recordings.columns import Columns
from design.recordings.plates import Flags
from design.recordings.reading import Reading
from design.recordings.remarks import Remarks, Subject
from design.recordings.table import Array
from design.recordings.units import FACTORS, factor, unit_of


def from_ankle(
    cop: Array, good: Flags, how: Reading, columns: Columns, subject: Subject, say: Remarks, load: Array | None
) -> tuple[Array, str, bool]:
    """The CoP from the ankle (n,) [m], where the ankle is, in words, and whether it is assumed.

    Where nothing tells, the ankle is where a law would have it that holds the CoP at its target P_d in the mean.
    """
    stated, ankle = how.ankle, columns.get("ankle_x")
    if stated is not None:
        place = position(stated, "--ankle")
        return cop - place, f"at {place:g} m by --ankle", False
    if ankle is not None:
        return cop - ankle, "from the file's ankle columns", False
    biped, target = subject.biped, subject.target
    mean = float(cop[good].mean())
    place = round(mean - target, 12) + 0.0
    where = f"{1e3 * target:g} mm behind the mean CoP, the law's target" if target else "under the mean CoP"
    if load is None:
        follows = ""
    elif biped.skew == 0 and target == 0:
        follows = ", so that the mean of toe and heel force is equal"
    else:
        F = float(load[good].mean())
        share = target / biped.ell - biped.skew  # (F_T - F_H) / (F_T + F_H) of a CoP at the target, (18)
        follows = f", so that toe and heel bear about {0.5 * F * (1 + share):.4g} and {0.5 * F * (1 - share):.4g} N"
    say.assumed.append(f"ankle taken at {place:.4g} m, {where}{follows}; give --ankle")
    return cop - place, f"at {place:.4g} m, {where}", True


def position(text: str, option: str) -> float:
    """The position [m] that an ``option`` gives, as ``0.21`` or ``21:cm``."""
    number, _, written = text.partition(":")
    unit = unit_of(written) if written else "m"
    scale = factor(unit, "position") if unit else None
    try:
        value = float(number)
    except ValueError:
        value = np.nan
    if scale is None or not np.isfinite(value) or abs(value * scale) > 100:
        message = f"is {text[:40]!r}; needs a position as 0.21 or 21:cm ({', '.join(FACTORS['position'])})"
        raise BadInput(message, key=option)
    return value * scale
