"""What a study's rows say together: per controller, and paired against a reference, never as a bare mean."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Row = dict[str, Any]

PAIRED = {
    "contact_force_n": "N",
    "cop_margin_m": "m",
    "settling_s": "s",
    "posture_error_deg": "deg",
    "torque_rms_nm": "N m",
    "torque_variation_nm": "N m",
}
"""Measures that are compared in pairs, and their units."""
CONFIDENCE = 0.95
RESAMPLES = 4000
FEW = 10
"""Pairs below which the bootstrap covers too seldom, and Student's t is taken."""


def summary(rows: Sequence[Row], reference: str | None, *, repeated: bool = False) -> dict[str, Any]:
    """Per controller what its trials come to, and its differences from the ``reference`` over the pairs both have.

    ``repeated``: trials are repetitions of the same world, of which one counts for differences.
    """
    names = list(dict.fromkeys(row["controller"] for row in rows))
    found = {name: _controller([row for row in rows if row["controller"] == name]) for name in names}
    distinct = [row for row in rows if not row["trial"]] if repeated else rows
    if reference in names:
        for name in names:
            if name != reference:
                found[name]["against"] = against(distinct, name, str(reference))
    return found


def _controller(rows: Sequence[Row]) -> dict[str, Any]:
    trials = [row for row in rows if row["trial"] is not None]
    through = [row for row in trials if row["status"] not in ("failed", "crashed")]
    disturbances = {row["scenario"]: row for row in rows if row["trial"] is None and row["status"] == "found"}
    worst = _values(through, "contact_force_n")
    times = [row["seconds"] for row in through if row.get("seconds")]
    return {
        "trials": len(trials),
        "lost": sum(row["status"] in ("lost", "fallen") for row in trials),
        "failed": sum(row["status"] in ("failed", "crashed") for row in trials),
        "contact_force_n": {"min": _or_none(worst, np.min), "median": _or_none(worst, np.median)},
        **{name: _or_none(_values(through, name), np.median) for name in PAIRED if name != "contact_force_n"},
        "torque_peak_nm": _or_none(_values(through, "torque_peak_nm"), np.max),
        "settled": sum(row.get("settling_s") is not None for row in through),
        "unsolved": sum(row["tail_steps"] + row["law_steps"] for row in through),
        "tail_steps": sum(row["tail_steps"] for row in through),
        "law_steps": sum(row["law_steps"] for row in through),
        "unplanned": dict(sum((Counter(row.get("unplanned") or {}) for row in through), Counter()).most_common(3)),
        "steps": sum(row["steps"] for row in through),
        "step_ms": {
            "median": _or_none([each["median_ms"] for each in times], np.median),
            "p99": _or_none([each["p99_ms"] for each in times], np.median),
            "max": _or_none([each["max_ms"] for each in times], np.max),
        },
        "step_slope_deg": disturbances.get("step-slope", {}).get("survived"),
        "push_ns": disturbances.get("push", {}).get("survived"),
        "step_slope_share": _share(disturbances.get("step-slope")),
        "push_share": _share(disturbances.get("push")),
    }


def against(rows: Sequence[Row], name: str, reference: str) -> dict[str, Any]:
    """Differences ``name`` - ``reference`` over the trials that both have: mean, 95 % interval, number of pairs.

    The smallest contact force counts in every pair (a lost trial has what it had when it ended); the other measures
    only where both kept contact to the end. ``lost`` is the difference of the shares of trials that lost contact.
    """
    ours, theirs = (
        {
            (row["scenario"], row["trial"]): row
            for row in rows
            if row["controller"] == who and row["trial"] is not None and row["status"] not in ("failed", "crashed")
        }
        for who in (name, reference)
    )
    pairs = [(ours[key], theirs[key]) for key in sorted(ours.keys() & theirs.keys())]
    found = {}
    for measure in PAIRED:
        of = [pair for pair in pairs if measure == "contact_force_n" or all(row["status"] == "kept" for row in pair)]
        both = [(a.get(measure), b.get(measure)) for a, b in of]
        found[measure] = interval(np.array([a - b for a, b in both if a is not None and b is not None], dtype=float))
    lost = [(a["status"] in ("lost", "fallen")) - (b["status"] in ("lost", "fallen")) for a, b in pairs]
    found["lost"] = interval(np.array(lost, dtype=float))
    return found


def interval(differences: Array) -> dict[str, Any]:
    """Mean of ``differences`` (n,) and its 95 % interval: bootstrap (BCa), below ``FEW`` pairs Student's t.

    Low and high are None where there are fewer than three pairs, or where all are the same and have no spread to tell
    the uncertainty from.
    """
    n = len(differences)
    if n == 0:
        return {"mean": None, "low": None, "high": None, "pairs": 0}
    mean = float(differences.mean())
    if n < 3 or float(np.ptp(differences)) <= 1e-9 * max(1.0, abs(mean)):
        return {"mean": mean, "low": None, "high": None, "pairs": n}
    from scipy.stats import bootstrap, t

    if n < FEW:
        half = float(t.ppf(0.5 + CONFIDENCE / 2, n - 1) * differences.std(ddof=1) / math.sqrt(n))
        return {"mean": mean, "low": mean - half, "high": mean + half, "pairs": n}
    with np.errstate(all="ignore"):
        found = bootstrap(
            (differences,), np.mean, n_resamples=RESAMPLES, confidence_level=CONFIDENCE, method="BCa",
            rng=np.random.default_rng(0), vectorized=True,
        ).confidence_interval  # fmt: skip
    low, high = float(found.low), float(found.high)
    finite = bool(np.isfinite([low, high]).all())
    return {"mean": mean, "low": low if finite else None, "high": high if finite else None, "pairs": n}


def _values(rows: Sequence[Row], name: str) -> list[float]:
    return [row[name] for row in rows if row.get(name) is not None]


def _or_none(values: Sequence[float], of: Any) -> float | None:
    return float(of(values)) if len(values) else None


def _share(row: Row | None) -> float | None:
    return row["survived"] / row["limit"] if row else None
