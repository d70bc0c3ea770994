"""Rows: each limit in each scenario, its value, what is required, the margin, and whether it is met.

A row's status is decided here and nowhere else. The verdict is over the hard rows that require something; a row that
requires nothing informs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from design.analysis.further import LINEAR_IDS, RUN_IDS, STEP_IDS, loop_rows, run_rows, survival_rows
from design.analysis.rows import Basis, Row, Series, Verdict
from design.analysis.simulate import Trajectory, components, simulate
from design.model.closed_loop import ClosedLoop
from design.model.deciding import deciding_places
from design.model.environment import Scenario, constant_force
from design.model.laws import Gains
from design.model.limits import Limit, Required, limits
from design.model.stability import (
    characteristic,
    closed_loop_matrix,
    decay_rate,
    is_hurwitz,
    polynomial_map,
    routh_hurwitz,
    shortest_adaptation,
)
from design.model.standing import Place
from design.spec.setting import Setting

Array = NDArray[np.float64]

RUNGE_KUTTA_LIMIT = 2.5
"""|lambda| h beyond which the fourth-order Runge-Kutta method is not trusted; it is unstable from 2.78 on."""

NOTHING_STANDS = "where the force leaves no weight to speak of, no posture has its CoP at the target"


def judge(
    setting: Setting,
    gains: Gains,
    extent: Literal["required", "all"] = "required",
    also: Sequence[str] = (),
    *,
    drawn: bool = False,
) -> Verdict:
    """Check ``gains`` against every requirement of ``setting`` in every scenario.

    ``all`` adds what the spec does not require: transients, loop margins, and the distance from the physical limit;
    ``also`` those kinds of row that hold one of these ids. Runs and series are kept only to be ``drawn``: a thousand
    scenarios would fill the memory.
    """
    everything = extent == "all"

    def wanted(ids: Sequence[str]) -> bool:
        return everything or any(row in setting.required or row in also for row in ids)

    rows: list[Row] = []
    trajectories: list[Trajectory] = []
    series: list[Series] = []
    unstable = ""
    for scenario in setting.scenarios:
        world = setting.under(scenario)
        loop = world.loop()
        stability = stability_rows(world, scenario, gains)
        rows += stability
        here = instability(stability)
        unstable = unstable or here
        trajectory = simulate(loop, scenario, gains, setting.step)
        if drawn:
            trajectories.append(trajectory)
        distrust = coarse_step(loop, scenario, gains, setting.step)
        bounds = limits(loop.plant, setting.required, field=scenario.field)
        found = components(bounds, trajectory)
        for limit, quantity in zip(bounds, found, strict=True):
            rows.append(limit_row(limit, quantity, trajectory, distrust))
            if drawn:
                series.append(_series(limit, quantity, trajectory))
        if wanted(RUN_IDS):
            rows += run_rows(world, loop, scenario, gains, trajectory, distrust, here)
    if wanted(LINEAR_IDS):
        rows += loop_rows(setting, gains, unstable)
    if wanted(STEP_IDS):
        unstable = unstable or unstable_at_rest(setting, gains)
        distrusts = [
            coarse_step(setting.under(scenario).loop(), scenario, gains, setting.step) for scenario in setting.scenarios
        ]
        rows += survival_rows(setting, gains, unstable or next(filter(None, distrusts), ""))
    return Verdict(rows=tuple(rows), trajectories=tuple(trajectories), series=tuple(series))


def instability(rows: Sequence[Row]) -> str:
    """Why rows that presuppose stability (``design.analysis.further``) have no value; empty where the loop is stable.

    ``rows`` are those of ``stability_rows``, of one scenario.
    """
    row = next(row for row in rows if row.id == "decay-rate")
    if row.value is not None and row.value > 0:
        return ""
    return f"the loop is not stable: its decay rate is {row.value:.4g} 1/s in scenario {row.scenario!r}"


def unstable_at_rest(setting: Setting, gains: Gains) -> str:
    """Why ``step-slope`` and ``push``, which begin on level ground, have no value, as ``instability`` does."""
    place = deciding_places(setting.biped, setting.law, np.zeros((2, 1)), setting.adapt, setting.target)
    level = constant_force(name="level ground", F_x=0.0, F_y=0.0, ramp=0.0, duration=1.0)
    sigma = min(decay_rate(p) for p in _polynomials(setting, level, gains, place))
    return "" if sigma > 0 else f"the loop is not stable: its decay rate is {sigma:.4g} 1/s on level ground"


def stability_rows(setting: Setting, scenario: Scenario, gains: Gains) -> list[Row]:
    """(27)-(29) and the decay rate, at the environment of ``scenario`` that is worst for each."""
    biped, kind, environments = setting.biped, setting.law, setting.places(scenario)
    gains = setting.felt(gains)
    # between the environments looked at nothing is known, unless all depends on A alone
    basis: Basis = "exact" if setting.plain or kind == "pd" or len(environments) == 1 else "sampled"
    note = "" if all(place.A > 0 for place in environments) else NOTHING_STANDS
    equations = {"stiffness": "(27)", "damping": "(28)", "routh": "(29)"}
    units = {"stiffness": "N m/rad", "damping": "N m s/rad" if kind == "pd" else "m/s", "routh": "N² m² s"}
    worst: dict[str, tuple[float, float]] = {}
    for place in environments:
        for row, pairs in routh_hurwitz(biped, kind, gains, *place).items():
            pair = min(pairs, key=lambda pair: pair[0] - pair[1]) if row == "damping" else pairs[0]
            pair = next((other for other in pairs if other[0] <= other[1]), pair)
            if row not in worst or pair[0] - pair[1] < worst[row][0] - worst[row][1]:
                worst[row] = pair
    rows = [
        Row(
            id=row, equation=equations[row], scenario=scenario.name, unit=units[row], value=float(left),
            required=float(right), margin=float(left - right), status="met" if left > right else "violated",
            time_s=None, basis=basis, note=note,
        )
        for row, (left, right) in worst.items()
    ]  # fmt: skip
    if math.isfinite(setting.adapt):
        rows.append(_adaptation_row(setting, scenario, gains, environments))
    sigma = min(decay_rate(p) for p in _polynomials(setting, scenario, gains, environments))
    required = setting.required.get("decay-rate", Required(level=0.0))
    met = sigma > 0 and sigma >= required.level
    rows.append(
        Row(
            id="decay-rate", equation="(24)", scenario=scenario.name, unit="1/s", value=sigma,
            required=required.level, margin=sigma - required.level, status="met" if met else "violated",
            time_s=None, basis=basis, soft=required.soft and sigma > 0, note=note,
        )
    )  # fmt: skip
    return rows


def _polynomials(
    setting: Setting, scenario: Scenario, gains: Gains, places: Sequence[Place]
) -> Iterator[Sequence[float]]:
    """The characteristic polynomials over the scenario; a law that adapts may reckon with another body."""
    if setting.known in (None, setting.biped) or not math.isfinite(setting.adapt):
        for A, load, beta in places:
            yield characteristic(setting.biped, setting.law, gains, A, load, setting.adapt, beta)
        return
    for F_x, F_y in np.unique(scenario.operating_forces(setting.biped), axis=1).T.tolist():
        offset, slope = polynomial_map(setting.loop(), F_x, F_y)
        yield tuple(float(c) for c in offset + slope @ np.array(gains))


def _adaptation_row(setting: Setting, scenario: Scenario, gains: Gains, places: Sequence[Place]) -> Row:
    """Whether theta_d may follow the estimate so fast: T_a against the shortest that is stable, over the scenario."""
    biped = setting.biped
    facts: dict[str, Any] = {"id": "adapt-time", "equation": "(15)", "scenario": scenario.name, "unit": "s",
                             "value": setting.adapt, "time_s": None,
                             "basis": "exact" if len(places) == 1 else "sampled"}  # fmt: skip
    try:
        shortest = max(shortest_adaptation(biped, gains, A, setting.adapt, beta) for A, _, beta in places)
    except ValueError:
        note = "the loop is unstable without adaptation"
        return Row(**facts, required=None, margin=None, status="undecided", note=note)
    stable = all(
        is_hurwitz(characteristic(biped, setting.law, gains, A, biped.weight, setting.adapt, beta))
        for A, _, beta in places
    )
    return Row(
        **facts, required=shortest, margin=setting.adapt - shortest, status="met" if stable else "violated",
        note="" if shortest else "theta_d may follow the estimate as fast as it likes",
    )  # fmt: skip


def coarse_step(loop: ClosedLoop, scenario: Scenario, gains: Gains, step: float) -> str:
    """Why the Runge-Kutta ``step`` [s] cannot be trusted with these gains, or an empty string."""
    biped, law = loop.biped, loop.law
    places = deciding_places(biped, law.kind, scenario.operating_forces(biped), law.adapt, law.target)
    with np.errstate(all="ignore"):
        matrices = [
            closed_loop_matrix(biped, law.kind, gains, A, load, law.adapt, beta=beta) for A, load, beta in places
        ]
    if not all(np.isfinite(matrix).all() for matrix in matrices):
        return "the linearised loop is not finite"
    fastest = max(float(np.abs(np.linalg.eigvals(matrix)).max()) for matrix in matrices)
    if fastest * step <= RUNGE_KUTTA_LIMIT:
        return ""
    return (
        f"the time step of {step:g} s is too coarse for a pole at {fastest:.4g} 1/s;"
        f" set simulation.time_step_s to at most {0.5 * RUNGE_KUTTA_LIMIT / fastest:.2g}"
    )


def limit_row(limit: Limit, quantity: Array, trajectory: Trajectory, distrust: str = "") -> Row:
    """The row of ``limit``, its ``quantity`` (c, n) along ``trajectory``: the worst sample, and whether it is met."""
    values = limit.value(quantity)
    required = limit.required
    level = required.level if required else 0.0
    facts: dict[str, Any] = {
        "id": limit.id, "equation": limit.equation, "scenario": trajectory.scenario, "unit": limit.unit,
        "required": required.level if required else None, "basis": "sampled",
        "soft": bool(required and required.soft),
    }  # fmt: skip
    finite = np.isfinite(values)
    if distrust or not finite.any():
        return Row(
            **facts, value=None, margin=None, status="undecided", time_s=None, note=distrust or "no finite value"
        )
    margins = np.where(finite, limit.margin(values, level), np.inf)
    at = int(np.argmin(margins))
    value, margin = float(values[at]), float(margins[at])
    notes = []
    if trajectory.fallen is not None:
        notes.append(f"falls at {trajectory.fallen:.3f} s")
    if not finite.all():
        notes.append(f"no load on the foot at {trajectory.t[int(np.argmin(finite))]:.3f} s")
    met = margin >= 0 and not notes
    if limit.floor is not None and (limit.margin(value, limit.floor) < 0 or notes):
        facts["soft"] = False
    return Row(
        **facts, value=value, margin=margin if required else None, status="met" if met else "violated",
        time_s=float(trajectory.t[at]), note="; ".join(notes),
    )  # fmt: skip


def _series(limit: Limit, quantity: Array, run: Trajectory) -> Series:
    level = limit.required.level if limit.required else None
    return Series(
        id=limit.id, scenario=run.scenario, unit=limit.unit, sense=limit.sense, t=run.t, value=limit.value(quantity),
        level=level,
    )  # fmt: skip


def worst(rows: Sequence[Row], id: str) -> Row:
    """The row of this ``id`` with the smallest margin over the scenarios."""
    return min((row for row in rows if row.id == id), key=lambda row: -np.inf if row.margin is None else row.margin)
