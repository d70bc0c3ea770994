"""The controllers of a study, built from their names: the paper's laws, clipped LQR, and predictive controllers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.analysis.observer import Observer, observer
from design.model.actuator import Actuator
from design.model.environment import Scenario
from design.model.laws import AdaptingLaw, Controller, Gains, LawKind, SampledLaw
from design.model.limits import Required
from design.spec.setting import Setting
from problems.lqr import ClippedLqr
from problems.mpc_linear import LinearPlanner
from problems.prediction import Horizon, horizon, posture
from problems.receding import Planner, Receding

Array = NDArray[np.float64]

LAWS: dict[str, LawKind] = {"pd": "pd", "force": "force", "cop": "cop"}
SYNTHESIZED: dict[str, LawKind] = {f"{name}-synthesized": kind for name, kind in LAWS.items()}
PREDICTIVE = ("mpc", "nmpc", "mpc-oracle", "mpc-preview")
ROOM = 0.08
"""What a prediction keeps to move in: part of the weight at each end of the foot; for the CoP and friction likewise."""
LQR = "lqr"
NAMES = (*LAWS, *SYNTHESIZED, LQR, *PREDICTIVE)


def actuator(setting: Setting) -> Actuator:
    """The ankle of a study: the spec's hard torque and torque rate, where it limits them, for every controller."""
    levels = {row: required.level for row, required in setting.required.items() if not required.soft}
    return Actuator(
        period=setting.study.control_period_s,
        torque=levels.get("torque", np.inf),
        rate=levels.get("torque-rate", np.inf),
    )


def controller(name: str, setting: Setting, gains: Gains | None, scenario: Scenario) -> Controller[Any]:
    """The controller of this ``name``; ``gains`` are those of a law, ``scenario`` what mpc-oracle and -preview know."""
    ankle = actuator(setting)
    if name in LAWS or name in SYNTHESIZED:
        if gains is None:
            message = f"{name} has no gains"
            raise ValueError(message)
        kind = LAWS.get(name) or SYNTHESIZED[name]
        if kind == "force" and np.isfinite(setting.adapt):
            return AdaptingLaw(
                biped=setting.biped, gains=gains, period=ankle.period, adapt=setting.adapt, theta_d=setting.theta_d,
                target=setting.target,
            )  # fmt: skip
        return SampledLaw(
            kind=kind, biped=setting.biped, gains=gains, period=ankle.period, theta_d=setting.theta_d,
            target=setting.target,
        )  # fmt: skip
    known, future = _foretold(name, setting, scenario)
    informant: Observer = observer(
        setting.biped,
        setting.sensors,
        period=ankle.period,
        walk=setting.tuning.walk * setting.biped.weight,
        known=known,
        future=future,
    )
    return Receding(
        biped=setting.biped,
        planner=_planner(name, prediction(setting, preview=name == "mpc-preview")),
        informant=informant,
        actuator=ankle,
        feedback=_lqr(setting),
        fallback=setting.gains or Gains(*_lqr(setting), 0.0),
        delay=informant.delay,
        target=setting.target,
    )


@lru_cache(maxsize=8)
def prediction(setting: Setting, *, preview: bool = False) -> Horizon:
    """What the predictive controllers of ``setting`` predict with; ``preview`` is for who knows the force ahead."""
    tuning = setting.tuning
    if preview:
        tuning = replace(tuning, torque=tuning.preview_torque)
    required = {**setting.required, **eased(setting)}
    return horizon(
        setting.biped, tuning, actuator(setting), required, setting.target,
        field=any(scenario.field for scenario in setting.scenarios),
    )  # fmt: skip


def eased(setting: Setting) -> dict[str, Required]:
    """Required levels that a standing body cannot keep, or only if it does not move, at what leaves it ``ROOM``.

    A prediction that must first of all do what cannot be done lets go of what can: at rest the CoP is at its target, in
    the middle of the paper's foot, each end bears its share of the load, there a half, and friction is needed as the
    force is inclined.
    """
    biped, found = setting.biped, {}
    points = [scenario.force_at(np.append(scenario.times, scenario.duration)) for scenario in setting.scenarios]
    F_x, F_y = np.concatenate(points, axis=1)
    share = biped.foot_share if any(scenario.field for scenario in setting.scenarios) else 0.0
    pressed = np.maximum(biped.weight - (1 + share) * F_y, 1e-9 * biped.weight)
    down = np.maximum(biped.weight - F_y, 1e-9 * biped.weight)
    near = min(biped.toe - setting.target, biped.heel + setting.target)
    limits = {
        "contact-force": float(near / (2 * biped.ell) * down.min() - ROOM * biped.weight),
        "cop-margin": (1 - 2.5 * ROOM) * near,
        "friction": float(((1 + share) * np.abs(F_x) / pressed).max() + 0.5 * ROOM),
    }
    for row, limit in limits.items():
        asked = setting.required.get(row)
        hard = asked is not None and not asked.soft
        if hard and asked is not None and (asked.level < limit if row == "friction" else asked.level > limit):
            found[row] = Required(level=max(limit, 0.0))
    return found


def _lqr(setting: Setting) -> tuple[float, float]:
    """K_p and K_d of LQR about the upright posture."""
    upright = posture(setting.biped, setting.tuning, setting.biped.M * setting.biped.g)
    return float(upright.K[0]), float(upright.K[1])


def _planner(name: str, ahead: Horizon) -> Planner:
    if name == LQR:
        return ClippedLqr(horizon=ahead)
    if name == "nmpc":
        from problems.mpc_nonlinear import planner

        return planner(ahead)
    return LinearPlanner(horizon=ahead)


def _foretold(
    name: str, setting: Setting, scenario: Scenario
) -> tuple[Callable[[float], tuple[float, float]] | None, Callable[[float], Array] | None]:
    """The force at a time, and over the prediction that begins then, as far as the controller is told."""
    if name not in ("mpc-oracle", "mpc-preview"):
        return None, None
    offsets = setting.tuning.step * np.arange(setting.tuning.horizon + 1)

    def known(t: float) -> tuple[float, float]:
        F = scenario.force_at(np.array([t]))
        return float(F[0, 0]), float(F[1, 0])

    def future(t: float) -> Array:
        return scenario.force_at(np.asarray(t + offsets))

    return known, future if name == "mpc-preview" else None
