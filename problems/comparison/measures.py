"""What a trial comes to, as a row of plain numbers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.analysis.transient import BAND
from design.model.environment import Scenario
from design.model.standing import posture
from problems.comparison.trial import Run, World
from problems.receding import Memory

Array = NDArray[np.float64]

TRACE = 250
"""Samples that are kept of a run for its picture."""


def measures(world: World, run: Run) -> dict[str, Any]:
    """One trial: ``status`` (kept, lost, fallen, failed), contact, the end of the run, torque, and steps.

    What only a run to the end has (settling, posture error) is None where the trial ended before. Computing times are
    apart, under ``seconds``: they are all that differs when a trial is run again.
    """
    lost, ended = run.lost, not (run.lost or run.fallen or run.failed)
    status = "kept" if ended else "lost" if lost else "fallen" if run.fallen else "failed"
    torque = run.torque[np.isfinite(run.torque)]
    change = np.diff(torque, prepend=0.0)
    settling, error = _end(world, run) if ended else (None, None)
    toe, heel, inside = (_least(row) for row in run.contact)
    tally = run.memory.tally if isinstance(run.memory, Memory) else None
    return {
        "status": status,
        "why": run.failed,
        "lost_s": lost[0] if lost else None,
        "lost_at": lost[1] if lost else None,
        "fallen_s": run.fallen,
        "toe_force_n": toe,
        "heel_force_n": heel,
        "contact_force_n": None if toe is None or heel is None else min(toe, heel),
        "cop_margin_m": inside,
        "settling_s": settling,
        "posture_error_deg": error,
        "torque_rms_nm": _rounded(math.sqrt(float(np.mean(torque**2)))) if len(torque) else None,
        "torque_peak_nm": _rounded(float(np.abs(torque).max())) if len(torque) else None,
        "torque_variation_nm": _rounded(float(np.abs(change).sum())),
        "steps": len(run.t),
        "tail_steps": tally.tail if tally else 0,
        "law_steps": tally.law if tally else 0,
        "unplanned": _reasons(run.memory) if tally else {},
        "seconds": _times(run.seconds[np.isfinite(run.seconds)]),
    }


def _reasons(memory: Memory) -> dict[str, int]:
    """The commonest reasons why steps were not planned."""
    return dict(sorted(memory.reasons, key=lambda pair: -pair[1])[:3])


def trace(run: Run) -> dict[str, list[float | None]]:
    """About ``TRACE`` samples of a run, for its picture: the least of each force between them."""
    edges = np.unique(np.linspace(0, len(run.t), min(TRACE, len(run.t)) + 1).astype(int))
    starts = edges[:-1]
    least = np.fmin.reduceat(run.contact[:2], starts, axis=1)
    columns = {
        "t_s": run.t[starts],
        "theta_deg": np.degrees(run.states[0, starts]),
        "toe_force_n": least[0],
        "heel_force_n": least[1],
        "torque_nm": run.torque[starts],
    }
    return {name: [_rounded(value) for value in values] for name, values in columns.items()}


def final_posture(world: World) -> float:
    """theta_f (4) [rad] of the force at the end of the scenario, for the real body; with the CoP at its target."""
    scenario: Scenario = world.scenario
    F_x, F_y = scenario.force_at(np.array([scenario.duration]))[:, 0]
    return posture(world.biped, float(F_x), float(F_y), world.target)


def _end(world: World, run: Run) -> tuple[float | None, float]:
    """Settling [s] after the last corner of the force, None if it does not settle, and the error at the end [deg]."""
    away = run.states[0, :-1] - final_posture(world)
    corner = world.scenario.steady_from
    outside = np.flatnonzero((run.t >= corner) & (np.abs(away) > BAND * np.abs(away).max()))
    if not len(outside):
        settling: float | None = 0.0
    elif outside[-1] + 1 >= len(run.t):
        settling = None
    else:
        settling = float(run.t[outside[-1] + 1]) - corner
    return settling, _rounded(abs(math.degrees(float(run.states[0, -1]) - final_posture(world)))) or 0.0


def _times(seconds: Array) -> dict[str, float] | None:
    if not len(seconds):
        return None
    median, p99 = np.quantile(seconds, [0.5, 0.99])
    return {"median_ms": 1e3 * float(median), "p99_ms": 1e3 * float(p99), "max_ms": 1e3 * float(seconds.max())}


def _least(values: Array) -> float | None:
    finite = values[np.isfinite(values)]
    return _rounded(float(finite.min())) if len(finite) else None


def _rounded(value: float) -> float | None:
    """Ten digits: enough for every use, and the same on every machine that runs the same libraries."""
    return float(f"{value:.10g}") if math.isfinite(value) else None
