"""What trials come to, as plain numbers: for JSON, and for words and pictures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

import numpy as np

from design.analysis.contraction import Contraction, contraction
from design.analysis.simulate import Trajectory
from design.analysis.transient import BAND
from design.model.laws import Gains
from design.present.store import gains_json
from design.spec.setting import Setting
from problems.trials.series import Series, Trial, looped, plans, run
from problems.trials.start import Start
from problems.trials.survives import change


@dataclass(frozen=True, eq=False, kw_only=True)
class Found:
    """The ``facts``, and what pictures are drawn of: of each series M g [N] and its ``runs``.

    Each run comes with the one from an estimate that was not used, or None.
    """

    facts: dict[str, Any]
    pictures: list[tuple[float, list[tuple[Trajectory, Trajectory | None]]]]


def conduct(
    setting: Setting,
    *,
    trials: int | None = None,
    scenario: str | None = None,
    sequence: str | None = None,
    seed: int | None = None,
    blind: bool = False,
) -> Found:
    """Run ``trials`` of every scenario, or one, or one trial of each in the ``sequence``; raises ``BadInput``."""
    setting.must_be_plain("the start of a next trial")
    setting.must_not_load_the_foot("the start of a next trial")
    gains = setting.given_gains()
    seed = setting.study.seed if seed is None else seed
    planned = plans(setting, trials, scenario, sequence)
    found = [run(setting, gains, each, seed=seed, blind=blind) for each in planned]
    return Found(
        facts=facts(setting, gains, found, sequence=sequence is not None, seed=seed),
        pictures=[
            (
                series.biped.M * series.biped.g,
                [(trial.run, trial.refused[1] if trial.refused else None) for trial in series.trials],
            )
            for series in found
        ],
    )


def facts(setting: Setting, gains: Gains, found: Sequence[Series], *, sequence: bool, seed: int) -> dict[str, Any]:
    """Everything but the samples; ``verdict`` is met, violated or undecided."""
    every = [trial for series in found for trial in series.trials]
    undecided = next(filter(None, (trial.distrust for trial in every)), "")
    verdict = "undecided" if undecided else "met" if all(trial.kept for trial in every) else "violated"
    names = {trial.run.scenario for trial in every}
    return {
        "status": "simulated",
        "verdict": verdict,
        "why": undecided,
        "law": setting.law,
        "adapt_s": setting.adapt,
        "gains": gains_json(gains),
        "seed": seed,
        "sequence": sequence,
        "estimate_from": _estimate_from(setting),
        "trials": [_trial(trial, number) for number, series in enumerate(found, 1) for trial in series.trials],
        "series": [_series(series) for series in found],
        "contraction": _contraction(
            contraction(setting, gains, [scenario for scenario in setting.scenarios if scenario.name in names])
        ),
        "survives": [each for series in found for each in _survives(setting, series)],
    }


def _estimate_from(setting: Setting) -> str:
    if setting.sensors.exact:
        return "the last sample; whether it rests, from the last 0.5 s"
    return f"means over the last 0.5 s, one noisy sample every {setting.study.control_period_s:g} s"


def _trial(trial: Trial, series: int) -> dict[str, Any]:
    happened, reading, true = trial.run, trial.reading, trial.run.F[:, -1]
    return {
        "series": series,
        "trial": trial.number,
        "scenario": happened.scenario,
        "start": "the last estimate" if trial.start.estimated else "as the spec says",
        "reason": trial.start.why,
        "blindly": trial.start.blindly,
        "desired_angle_deg": math.degrees(trial.start.theta_d),
        "start_angle_deg": math.degrees(trial.start.theta0),
        "start_away_deg": None if trial.start.away is None else math.degrees(trial.start.away),
        "integral": trial.start.s0,
        **_contact(happened),
        "settling_s": trial.approach.settling,
        "transient_deg": math.degrees(float(np.abs(happened.theta - trial.theta_f).max())),
        "overshoot_deg": math.degrees(trial.approach.overshoot),
        "posture_error_deg": math.degrees(trial.approach.error),
        "fx_n": float(true[0]),
        "fy_n": float(true[1]),
        "fx_estimate_n": reading.F[0] if reading else None,
        "fy_estimate_n": reading.F[1] if reading else None,
        "fx_error_n": reading.F[0] - float(true[0]) if reading else None,
        "fy_error_n": reading.F[1] - float(true[1]) if reading else None,
        "fx_bound_n": reading.bound[0] if reading else None,
        "fy_bound_n": reading.bound[1] if reading else None,
        "stationary": reading.stationary if reading else False,
        "not_stationary_because": reading.why if reading else "contact was lost",
        "refused": None if trial.refused is None else _refused(*trial.refused),
    }


def _contact(run: Trajectory) -> dict[str, Any]:
    """The smallest contact force, at which end and when; lost contact and fall."""
    toe, heel = int(np.argmin(run.F_T)), int(np.argmin(run.F_H))
    end, at = ("toe", toe) if run.F_T[toe] <= run.F_H[heel] else ("heel", heel)
    lost = run.lost_contact
    return {
        "contact_force_n": float(min(run.F_T[toe], run.F_H[heel])),
        "contact_at": end,
        "contact_time_s": float(run.t[at]),
        "lost_contact": None if lost is None else {"time_s": lost[0], "at": lost[1]},
        "fallen_s": run.fallen,
    }


def _refused(start: Start, run: Trajectory) -> dict[str, Any]:
    return {"desired_angle_deg": math.degrees(start.theta_d), **_contact(run)}


def _series(series: Series) -> dict[str, Any]:
    """The band that settling is measured by, and what the second trial has over the first in the same world."""
    body = series.biped
    first, *rest = series.trials
    second = rest[0] if rest else None
    gain = None
    if second and second.start.estimated and second.run.scenario == first.run.scenario:
        one, two = (_contact(trial.run)["contact_force_n"] for trial in (first, second))
        gain = {
            "contact_force_n": [one, two, two - one],
            "settling_s": [
                first.approach.settling, second.approach.settling, first.approach.settling - second.approach.settling
            ],
        }  # fmt: skip
    return {
        "scenarios": [trial.run.scenario for trial in series.trials],
        "settling_band_deg": math.degrees(series.band),
        "settling_band": f"{100 * BAND:g} % of trial 1's largest distance from theta_f, at least 0.01 deg",
        "body": {
            "mass_kg": body.M, "com_height_m": body.L, "inertia_kgm2": body.I, "foot_mass_kg": body.m,
            "half_length_m": body.ell,
        },
        "second_over_first": gain,
    }  # fmt: skip


def _contraction(found: Contraction) -> dict[str, Any]:
    at, check = found.at, found.check
    return {
        "contracts": found.contracts,
        "factor": found.factor,
        "at": {
            "scenario": at.scenario, "where": at.where, "trial_s": at.duration, "a_n": at.A, "load_n": at.load,
            "mass_kg": at.biped.M, "com_height_m": at.biped.L, "inertia_kgm2": at.biped.I,
            "half_length_m": at.biped.ell,
        },
        "limit": found.limit,
        "stays_below_1_from_s": found.below_from[1.0],
        "stays_below_0.1_from_s": found.below_from[0.1],
        "box": {"points": found.points, "corners": found.corners, "drawn": found.samples},
        "checked": {
            "points": check.points, "trials": check.runs, "error_deg": math.degrees(check.start),
            "largest_ratio": check.ratio, "largest_difference_from_factor": check.off,
        },
    }  # fmt: skip


def _survives(setting: Setting, series: Series) -> list[dict[str, Any]]:
    """After each trial that is followed by another scenario, and after the last: what its estimate's start survives.

    ``next`` and whether contact is kept in it are None after the last. Nothing is said of an end that is not at rest.
    """
    found = []
    for trial, after in zip_longest(series.trials, series.trials[1:]):
        same = after is not None and after.run.scenario == trial.run.scenario
        if same or trial.reading is None or not trial.reading.stationary:
            continue
        most = change(looped(setting, series.biped, trial.reading.theta), series.gains, trial.scenario, setting.step)
        unit, scale = ("deg", math.degrees(1.0)) if most.slope else ("N", 1.0)
        used = None
        if after is not None:
            used = after.refused[1] if after.refused else after.run if after.start.estimated else None
        found.append(
            {
                "after_trial": trial.number, "scenario": trial.run.scenario,
                "next": after.run.scenario if after else None,
                "of": "slope" if most.slope else "horizontal force", "unit": unit,
                "from": scale * most.start, "up": scale * most.up, "down": scale * most.down,
                "kept_from_the_estimate": None if used is None else used.lost_contact is None and used.fallen is None,
                "kept": after.kept if after else None,
            }
        )  # fmt: skip
    return found
