"""Rows that go beyond one run's samples: transients, loop margins, every slope, and the physical limit.

The loop margins and the sampling period are those of the frozen linear loop at the environment that is worst for each;
``scenario`` names where that is met. What cannot be computed is an undecided row that says why.

Rows that presuppose a stable loop, and are undecided where ``design.analysis.verdict`` finds that it is not:

- ``settling``, ``overshoot``: an unstable loop leaves every posture again, and how far it goes past one depends on how
  long it is watched;
- the loop margins, ``sample-time``, ``slope-rate``: how far the loop is from losing the stability that it has;
- ``step-slope``, ``push``: a disturbance is survived where the body comes to rest, not where contact holds for as long
  as is watched. They begin on level ground, so that the loop must be stable there too.

``posture-error``, ``torque-rate`` and the limits along a run are facts of the samples, whatever becomes of it later.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from design.analysis.rows import Row, RowStatus
from design.analysis.simulate import Trajectory
from design.analysis.slope_rate import peak_gain
from design.analysis.survival import Survival, push, step_slope
from design.analysis.transient import torque_rate, transient
from design.model.closed_loop import ClosedLoop
from design.model.deciding import bearing
from design.model.environment import Scenario
from design.model.laws import Gains
from design.model.limits import Required
from design.model.margins import LoopMargins, loop_margins
from design.model.sampling import longest_period
from design.model.standing import Place
from design.spec.setting import Setting

MARGINS: tuple[tuple[str, str, str, Callable[[LoopMargins], float]], ...] = (
    ("gain-margin-up", "at least", "1", lambda m: m.gain_up),
    ("gain-margin-down", "at most", "1", lambda m: m.gain_down),
    ("phase-margin", "at least", "deg", lambda m: math.degrees(m.phase)),
    ("delay-margin", "at least", "s", lambda m: m.delay),
    ("force-delay-margin", "at least", "s", lambda m: m.force_delay),
    ("angle-delay-margin", "at least", "s", lambda m: m.angle_delay),
    ("disk-margin", "at least", "1", lambda m: m.disk),
)
"""Id, sense, unit, and how to read it."""

STEP_IDS = ("step-slope", "push")
LINEAR_IDS = (*(row for row, *_ in MARGINS), "sample-time", "slope-rate")
RUN_IDS = ("torque-rate", "settling", "overshoot", "posture-error")


def run_rows(
    setting: Setting, loop: ClosedLoop, scenario: Scenario, gains: Gains, run: Trajectory, distrust: str, unstable: str
) -> list[Row]:
    """``torque-rate``, ``settling``, ``overshoot`` and ``posture-error`` of one run.

    ``distrust``: why the time step is too coarse; ``unstable``: why nothing settles. Empty where that is not so.
    """
    common: dict[str, Any] = {"scenario": scenario.name, "basis": "sampled", "sense": "at most"}
    if distrust:
        units = dict(zip(RUN_IDS, ("N m/s", "s", "deg", "deg"), strict=True))
        return [
            _row(setting, id=row, equation="", unit=units[row], value=None, note=distrust, **common) for row in RUN_IDS
        ]
    rates = np.abs(torque_rate(loop, gains, run))
    fastest = int(np.argmax(rates))
    end = transient(loop, scenario, run)
    fell = f"falls at {run.fallen:.3f} s" if run.fallen is not None else ""
    late = "" if math.isfinite(end.settling) else fell or "does not settle within the scenario's duration"
    last = scenario.pieces()[-1]
    moving = bool(np.ptp(scenario.signal_on(last, np.array(last)), axis=1).any())
    settling: float | None = end.settling
    overshoot: float | None = math.degrees(end.overshoot)
    blank = "the force still changes at the end of the scenario; lengthen duration_s" if moving else unstable
    if blank:  # there is no final posture to settle to
        settling, overshoot = None, None
        late = "; ".join(filter(None, (fell, blank)))
    return [
        _row(setting, id="torque-rate", equation="(10)", unit="N m/s", value=float(rates[fastest]),
             time_s=float(run.t[fastest]), note=fell, fails=run.fallen is not None, **common),
        _row(setting, id="settling", equation="(14)", unit="s", value=settling,
             time_s=None if blank else end.settled_at, note=late, **common),
        _row(setting, id="overshoot", equation="(14)", unit="deg", value=overshoot,
             time_s=None if blank else end.overshoot_at,
             note=late if blank else fell, fails=run.fallen is not None, **common),
        _row(setting, id="posture-error", equation="(14)", unit="deg", value=math.degrees(end.error),
             time_s=float(run.t[-1]), note=fell, fails=run.fallen is not None, **common),
    ]  # fmt: skip


def loop_rows(setting: Setting, gains: Gains, unstable: str = "") -> list[Row]:
    """Loop margins, the sampling period, and the slope rate, of the linear loop; none where it is ``unstable``."""
    biped, kind, gains = setting.biped, setting.law, setting.felt(gains)
    places: dict[Place, str] = {}
    for scenario in setting.scenarios:
        for place in loop_places(setting, scenario):
            places.setdefault(place, scenario.name)
    environments = _spread(sorted(places))
    basis = "exact" if len(places) == 1 else "sampled"  # between the environments looked at nothing is known
    rows = []
    try:
        if unstable:
            raise ValueError(unstable)
        found = [
            (loop_margins(biped, kind, gains, A, load, setting.adapt, beta), places[Place(A, load, beta)])
            for A, load, beta in environments
        ]
        periods = [
            (longest_period(biped, kind, gains, A, load, setting.adapt, beta), places[Place(A, load, beta)])
            for A, load, beta in environments
        ]
    except (ValueError, np.linalg.LinAlgError) as error:
        undecided: list[tuple[str, str, str]] = [(row, sense, unit) for row, sense, unit, _ in MARGINS]
        rows += [
            _row(setting, id=row, equation="(24)", scenario=None, unit=unit, value=None, basis="exact", sense=sense,
                 note=str(error))
            for row, sense, unit in [*undecided, ("sample-time", "at least", "s")]
        ]  # fmt: skip
    else:
        for row, sense, unit, read in MARGINS:
            pick = min if sense == "at least" else max
            value, where = pick(((read(m), name) for m, name in found), key=lambda pair: pair[0])
            rows.append(
                _row(setting, id=row, equation="(24)", scenario=where, unit=unit, value=value, basis=basis,
                     sense=sense, note="" if math.isfinite(value) else "without limit")
            )  # fmt: skip
        period, where = min(periods)
        rows.append(
            _row(setting, id="sample-time", equation="(23)", scenario=where, unit="s", value=period, basis=basis,
                 sense="at least")
        )  # fmt: skip
    return [*rows, _slope_rate(setting, gains, unstable)]


def loop_places(setting: Setting, scenario: Scenario) -> list[Place]:
    """All environments of ``scenario`` as the linear loop meets them; those between ends of A too."""
    setting = setting.under(scenario)
    biped, kind = setting.biped, setting.law
    if not setting.plain and kind != "pd":
        return setting.places(scenario)
    A, load = scenario.operating_points(biped)
    pairs = zip(np.round(A, 9).tolist(), np.round(bearing(load), 9).tolist(), strict=True)
    return [Place(a, b if kind == "cop" else biped.weight) for a, b in pairs]


def _spread(places: list[Place], most: int = 80) -> list[Place]:
    """At most ``most`` environments, evenly through the sorted ones, with both ends."""
    chosen = sorted({int(k) for k in np.linspace(0, len(places) - 1, most)})
    return [places[k] for k in chosen]


def _slope_rate(setting: Setting, gains: Gains, unstable: str) -> Row:
    facts: dict[str, Any] = {
        "id": "slope-rate", "equation": "(18)", "scenario": None, "unit": "deg/s", "basis": "exact",
        "sense": "at least",
    }  # fmt: skip
    if math.isfinite(setting.adapt):
        return _row(setting, **facts, value=None, note="not computed for a law that adapts (law.adapt_s)")
    if not setting.plain:
        return _row(setting, **facts, value=None, note="not computed for this foot: " + setting.unlike)
    if unstable:
        return _row(setting, **facts, value=None, note=unstable)
    try:
        peak = peak_gain(setting.biped, setting.law, gains)
    except (ValueError, np.linalg.LinAlgError) as error:
        return _row(setting, **facts, value=0.0 if setting.law == "pd" else None, note=str(error))
    gain = peak.gain + peak.error
    ell = setting.biped.ell
    turns = ", ".join(f"{t:.3g}" for t in peak.switches[:4])
    note = (
        f"for any slope profile up to r deg/s the linear loop's CoP stays within {1e3 * gain * math.pi / 180:.4g} r mm;"
        f" the end of the foot is {1e3 * ell:.4g} mm away; attained by a slope at that rate which reverses"
        f" {turns or 'never'}{' ...' if len(peak.switches) > 4 else ''} s before the end"
    )
    return _row(setting, **facts, value=math.degrees(ell / gain), note=note)


def survival_rows(setting: Setting, gains: Gains, distrust: str) -> list[Row]:
    """``step-slope`` and ``push``, each with its share of what any ankle controller can survive."""
    if distrust:
        units = {"step-slope": "deg", "push": "N s"}
        return [
            _row(setting, id=row, equation="(6)", scenario=None, unit=unit, value=None, basis="sampled",
                 sense="at least", note=distrust)
            for row, unit in units.items()
        ]  # fmt: skip
    slope = step_slope(setting.in_a_field().loop(), gains, setting.step)
    impulse = push(setting.loop(), gains, setting.step)
    biped = setting.biped
    light = math.atan(biped.ell / biped.L)
    foot = ""
    if setting.plain:
        foot = f"; {100 * slope.survived / light:.1f} % of the {math.degrees(light):.2f} deg of a massless foot"
    return [
        _row(setting, id="step-slope", equation="(6)", scenario=None, unit="deg", value=math.degrees(slope.survived),
             basis="sampled", sense="at least",
             note=f"{100 * slope.share:.1f} % of the {math.degrees(slope.limit):.2f} deg that any ankle controller can"
                  f" survive{foot}"),
        _row(setting, id="push", equation="(6)", scenario=None, unit="N s", value=impulse.survived, basis="sampled",
             sense="at least", note=_share(impulse)),
    ]  # fmt: skip


def _share(found: Survival) -> str:
    return f"{100 * found.share:.1f} % of the {found.limit:.4g} N s that linear capturability allows"


def _row(
    setting: Setting, *, id: str, sense: str, value: float | None, note: str = "", fails: bool = False, **facts: Any
) -> Row:
    """A row against what the spec requires of ``id``; infinite values are kept as None with the note that says so."""
    required: Required | None = setting.required.get(id)
    level = required.level if required else None
    margin = None
    if value is not None and level is not None:
        margin = value - level if sense == "at least" else level - value
    status: RowStatus
    if fails:
        status = "violated"
    elif value is None:
        status = "undecided"
    else:
        status = "met" if margin is None or margin >= 0 else "violated"
    finite = value is not None and math.isfinite(value)
    return Row(
        id=id, value=value if finite else None, required=level,
        margin=margin if margin is not None and math.isfinite(margin) else None,
        status=status, soft=bool(required and required.soft), note=note, time_s=facts.pop("time_s", None), **facts,
    )  # fmt: skip
