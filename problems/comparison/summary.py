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
LOST = ("lost", "fallen")
FEW = 10
"""Draws below which the bootstrap covers too seldom, and Student's t is taken."""


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
        "lost": sum(row["status"] in LOST for row in trials),
        "lost_in": {
            scenario: count
            for scenario in dict.fromkeys(row["scenario"] for row in trials)
            if (count := sum(row["status"] in LOST for row in trials if row["scenario"] == scenario))
        },
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
    """Differences ``name`` - ``reference`` by measure: ``interval`` over all scenarios, and of each ``by_scenario``.

    A pair is one draw in one scenario that both controllers have. ``lost`` is 1 for a trial that lost contact, else 0.
    Lost trials and the smallest contact force count in every pair (a lost trial has what it had when it ended); the
    other measures only where both kept contact to the end.
    """
    ours, theirs = (
        {
            (row["scenario"], row["trial"]): row
            for row in rows
            if row["controller"] == who and row["trial"] is not None and row["status"] not in ("failed", "crashed")
        }
        for who in (name, reference)
    )
    keys = sorted(ours.keys() & theirs.keys())
    scenarios = list(dict.fromkeys(row["scenario"] for row in rows if row["trial"] is not None))
    draws = sorted({trial for _, trial in keys})
    found = {}
    for measure in ("lost", *PAIRED):
        table = np.full((len(draws), len(scenarios)), np.nan)
        for scenario, trial in keys:
            difference = _difference(measure, ours[scenario, trial], theirs[scenario, trial])
            table[draws.index(trial), scenarios.index(scenario)] = np.nan if difference is None else difference
        found[measure] = {
            **interval(table),
            "by_scenario": {scenario: interval(table[:, [k]]) for k, scenario in enumerate(scenarios)},
        }
    return found


def _difference(measure: str, ours: Row, theirs: Row) -> float | None:
    """One pair's difference; None where one of the two has no such value."""
    if measure == "lost":
        return float((ours["status"] in LOST) - (theirs["status"] in LOST))
    if measure != "contact_force_n" and not ours["status"] == theirs["status"] == "kept":
        return None
    a, b = ours.get(measure), theirs.get(measure)
    return None if a is None or b is None else float(a - b)


def interval(table: Array) -> dict[str, Any]:
    """The mean over scenarios of paired differences, and its 95 % interval.

    ``table`` (draws, scenarios) holds a difference in each cell, NaN where there is no pair; (draws,) is one scenario.
    Scenarios are strata: fixed, each with the same weight, and no further pairs. The mean is that of the scenarios'
    means. Draws are resampled whole, by a bootstrap (BCa); below ``FEW`` draws the interval is Student's t by
    linearisation. Low and high are None where a scenario has fewer than three draws, or where all differences of each
    are the same and have no spread to tell the uncertainty from. ``pairs`` counts draws, ``scenarios`` those that have
    a pair.
    """
    table = np.asarray(table, dtype=float)
    table = table[:, np.newaxis] if table.ndim == 1 else table
    table = table[:, np.isfinite(table).any(axis=0)]
    table = table[np.isfinite(table).any(axis=1)]
    n, strata = table.shape if table.size else (0, 0)
    if n == 0:
        return {"mean": None, "low": None, "high": None, "pairs": 0, "scenarios": 0}
    counts = np.isfinite(table).sum(axis=0)
    means = np.nanmean(table, axis=0)
    mean = float(means.mean())
    spread = float((np.nanmax(table, axis=0) - np.nanmin(table, axis=0)).max())
    if counts.min() < 3 or spread <= 1e-9 * max(1.0, float(np.abs(means).max())):
        return {"mean": mean, "low": None, "high": None, "pairs": n, "scenarios": strata}
    low, high = (_bootstrap if n >= FEW else _student)(table, mean)
    finite = bool(np.isfinite([low, high]).all())
    return {
        "mean": mean,
        "low": low if finite else None,
        "high": high if finite else None,
        "pairs": n,
        "scenarios": strata,
    }


def _student(table: Array, mean: float) -> tuple[float, float]:
    """Student's t of each draw's influence on the mean; with every pair there, that of the draws' averages."""
    from scipy.stats import t

    n, strata = table.shape
    counts = np.isfinite(table).sum(axis=0)
    influence = np.nansum((table - np.nanmean(table, axis=0)) * (n / (counts * strata)), axis=1)
    half = float(t.ppf(0.5 + CONFIDENCE / 2, counts.min() - 1)) * math.sqrt(float((influence**2).sum()) / (n * (n - 1)))
    return mean - half, mean + half


def _bootstrap(table: Array, mean: float) -> tuple[float, float]:
    """The bootstrap of whole draws (BCa), and Student's t where a resample leaves a scenario without a pair."""
    from scipy.stats import bootstrap

    def statistic(chosen: Array, axis: int = -1) -> Array:
        sampled = table[np.moveaxis(chosen, axis, -1)]
        there = np.isfinite(sampled)
        means = np.where(there, sampled, 0.0).sum(axis=-2) / there.sum(axis=-2)
        return np.asarray(means.mean(axis=-1))

    with np.errstate(all="ignore"):
        found = bootstrap(
            (np.arange(len(table)),), statistic, n_resamples=RESAMPLES, confidence_level=CONFIDENCE, method="BCa",
            rng=np.random.default_rng(0), vectorized=True,
        ).confidence_interval  # fmt: skip
    ends = float(found.low), float(found.high)
    return ends if np.isfinite(ends).all() else _student(table, mean)


def _values(rows: Sequence[Row], name: str) -> list[float]:
    return [row[name] for row in rows if row.get(name) is not None]


def _or_none(values: Sequence[float], of: Any) -> float | None:
    return float(of(values)) if len(values) else None


def _share(row: Row | None) -> float | None:
    return row["survived"] / row["limit"] if row else None
