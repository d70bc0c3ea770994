"""Weights of the controllers that have a model, tuned by the objective for which the gains are synthesized.

maximise    the spec's objective over the closed loops of the nominal body in the spec's scenarios, the worst counts
over        torque_weight and rate_weight of [mpc], on a logarithmic scale; those that the spec writes are kept
subject to  contact in every scenario, then the requirements that a run shows

The loops are those of the study: control period, delay, torque limits, and the sensors' noise, of a stream that no
trial has. The search is a compass search from the default weights (Kolda, Lewis and Torczon 2003) with steps of a
decade at first: it compares values only, and is the same wherever it runs. An objective that no run shows, such as a
delay margin, is replaced by the smallest contact force.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from design.errors import BadInput
from design.model.laws import Gains
from design.spec.setting import Setting
from problems.comparison.controllers import LQR, PREDICTIVE, actuator, controller
from problems.comparison.measures import measures
from problems.comparison.trial import World, run

Merit = tuple[float, float, float]
"""Part of the scenarios' time with contact, the worst violation (negative), and the objective: more is better."""

STREAM = 0x7475_6E65
"""First word of the noise's seed; a trial's begins with the study's own."""
STEPS = {"mpc-preview": 17_000}
USUAL_STEPS = 60_000
"""Control steps that tuning a controller may take, some 5 s; a prediction with a preview takes eight times as long."""
FEWEST, MOST = 6, 40
"""Evaluations of a tuning; each is one run of every scenario."""
DECADES = {"torque_weight": (-4.0, 3.0), "rate_weight": (-3.0, 2.0)}
"""Decimal logarithms between which weights are sought."""
FINEST = 0.06
"""The compass's last step, as a decimal logarithm."""
SHARED = {"nmpc": "mpc"}
"""Controllers that take the weights of another one with the same cost."""
TUNABLE = (LQR, *PREDICTIVE)

SHOWN = {
    "contact-force": ("contact_force_n", "N", 1.0),
    "cop-margin": ("cop_margin_m", "m", 1.0),
    "torque": ("torque_peak_nm", "N m", -1.0),
    "settling": ("settling_s", "s", -1.0),
    "posture-error": ("posture_error_deg", "deg", -1.0),
}
"""Objectives that a run shows: the measure in a row, its unit, and 1 where more is better."""


class Weights(NamedTuple):
    """Weights of (tau/(A L))² and of (omega/Omega)², by the keys of [mpc]; e² has 1."""

    torque_weight: float
    rate_weight: float


@dataclass(frozen=True, kw_only=True)
class Tuned:
    """The ``weights`` of a controller, from ``evaluations`` (0: not tuned) of the loops ``of`` a controller.

    ``fixed``: weights that the spec writes. ``value`` of the objective with these weights and, ``before``, with those
    that the search began from; None where it was not evaluated or a run did not show it.
    """

    weights: Weights
    of: str
    fixed: tuple[str, ...]
    evaluations: int
    value: float | None = None
    before: float | None = None


def criterion(problem: Setting) -> str:
    """The objective by which weights are tuned: the spec's, where a run shows it."""
    return problem.objective if problem.objective in SHOWN else "contact-force"


def initial(problem: Setting, name: str) -> Weights:
    """The weights of the spec, or its defaults."""
    tuning = problem.tuning
    return Weights(tuning.preview_torque if name == "mpc-preview" else tuning.torque, tuning.rate)


def weighted(problem: Setting, name: str, weights: Weights | None) -> Setting:
    """``problem`` with the ``weights`` of the controller ``name``."""
    if weights is None:
        return problem
    torque, rate = weights
    tuning = replace(problem.tuning, rate=rate)
    tuning = replace(tuning, preview_torque=torque) if name == "mpc-preview" else replace(tuning, torque=torque)
    return replace(problem, tuning=tuning)


def worlds(problem: Setting) -> list[World]:
    """The nominal body in each scenario, with the sensors' noise of a stream that no trial has."""
    found = []
    for k, scenario in enumerate(problem.scenarios):
        draws = None
        if not problem.sensors.exact:
            periods = max(1, math.ceil(scenario.duration / problem.study.control_period_s - 1e-6))
            draws = np.random.default_rng([STREAM, problem.study.seed, k]).standard_normal((periods, 4))
        found.append(
            World(
                biped=problem.biped, scenario=scenario, sensors=problem.sensors, draws=draws, target=problem.target
            )
        )  # fmt: skip
    return found


def merit(problem: Setting, name: str, gains: Gains | None, weights: Weights | None) -> Merit:
    """What a controller reaches in ``worlds``; comparable between controllers."""
    posed = weighted(problem, name, weights)
    measure, _, sign = SHOWN[criterion(problem)]
    kept, violation, value = 0.0, 0.0, math.inf
    for world in worlds(problem):
        ended = run(world, controller(name, posed, gains, world.scenario), actuator(posed), posed.step)
        row = measures(world, ended)
        kept += 1.0 if row["status"] == "kept" else len(ended.t) / (1 + len(ended.t))
        violation = max(violation, _violation(problem, row))
        value = min(value, -math.inf if row[measure] is None else sign * row[measure])
    return kept / len(problem.scenarios), -violation, value


def _violation(problem: Setting, row: dict[str, Any]) -> float:
    """By how much a run breaks a hard requirement that it shows, as a part of the level."""
    worst = 0.0
    for id, (measure, _, sign) in SHOWN.items():
        required = problem.required.get(id)
        if required is None or required.soft:
            continue
        if row[measure] is None:
            worst = max(worst, 1.0)
        else:
            worst = max(worst, sign * (required.level - row[measure]) / max(abs(required.level), 1e-9))
    return worst


def value_of(problem: Setting, found: Merit) -> float | None:
    """The objective in its unit; None where contact was lost or a run did not show it."""
    kept, _, value = found
    return SHOWN[criterion(problem)][2] * value if kept >= 1.0 and math.isfinite(value) else None


def tuned(problem: Setting, name: str) -> Tuned:
    """The best weights of the controller ``name`` that a search of limited length finds."""
    start = initial(problem, name)
    fixed = tuple(key for key in Weights._fields if _written(name, key) in problem.fixed_weights)
    free = [key for key in Weights._fields if key not in fixed]
    steps = sum(math.ceil(scenario.duration / problem.study.control_period_s) for scenario in problem.scenarios)
    budget = min(max(STEPS.get(name, USUAL_STEPS) // steps, FEWEST), MOST)

    def weights_at(point: Sequence[float]) -> Weights:
        """Weights of four digits: what is printed is what is used."""
        return start._replace(**{key: float(f"{10**x:.4g}") for key, x in zip(free, point, strict=True)})

    tried: dict[Weights, Merit] = {}

    def evaluate(point: Sequence[float]) -> Merit:
        weights = weights_at(point)
        if weights not in tried:
            try:
                tried[weights] = merit(problem, name, None, weights)
            except (ArithmeticError, ValueError):  # a Riccati equation without a numerical solution
                if not tried:
                    raise
                tried[weights] = (-math.inf, -math.inf, -math.inf)
        return tried[weights]

    box = [DECADES[key] for key in free]
    begin = [min(max(math.log10(max(getattr(start, key), 1e-9)), low), high) for key, (low, high) in
             zip(free, box, strict=True)]  # fmt: skip
    first = evaluate(begin)
    best = search(evaluate, begin, box, lambda: budget - len(tried)) if free else begin
    return Tuned(
        weights=weights_at(best), of=name, fixed=fixed, evaluations=len(tried), value=value_of(problem, evaluate(best)),
        before=value_of(problem, first),
    )  # fmt: skip


def search(
    evaluate: Callable[[Sequence[float]], Merit],
    begin: Sequence[float],
    box: Sequence[tuple[float, float]],
    left: Callable[[], int],
) -> list[float]:
    """The best point found by a compass search: to the first better neighbour, or else the steps are halved.

    ``left`` says how many evaluations are left; ``box`` holds the lower and upper end of each coordinate.
    """
    best = list(begin)
    step = 1.0
    while step > FINEST:
        for k, sign in ((k, sign) for k in range(len(box)) for sign in (1.0, -1.0)):
            if left() <= 0:
                return best
            point = list(best)
            point[k] = min(max(point[k] + sign * step, box[k][0]), box[k][1])
            if evaluate(point) > evaluate(best):
                best = point
                break
        else:
            step /= 2
    return best


def all_tuned(
    problem: Setting, names: Sequence[str], say: Callable[[str], None], *, tune: bool
) -> tuple[dict[str, Tuned], dict[str, str]]:
    """The weights of each of ``names`` that has some, and why others cannot be built.

    If not to ``tune``, the weights are those of the spec or its defaults.
    """
    found: dict[str, Tuned] = {}
    left_out: dict[str, str] = {}
    by_source: dict[str, Tuned] = {}
    for name in (name for name in names if name in TUNABLE):
        source = SHARED.get(name, name)
        if not tune:
            found[name] = Tuned(weights=initial(problem, name), of=source, fixed=(), evaluations=0)
            continue
        try:
            if source not in by_source:
                say(f"tuning the weights of {source} ...")
                by_source[source] = tuned(problem, source)
            found[name] = by_source[source]
        except (BadInput, ArithmeticError, ValueError) as error:
            left_out[name] = f"it cannot be built: {error}"
    return found, left_out


def _written(name: str, key: str) -> str:
    """The key of [mpc] that holds a controller's weight."""
    return "preview_torque_weight" if (name, key) == ("mpc-preview", "torque_weight") else key
