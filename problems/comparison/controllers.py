"""The controllers of a study, built from their names: the paper's laws, and predictive ones that know more or less."""

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
from design.model.laws import Controller, Gains, LawKind, SampledLaw
from design.spec.setting import Setting
from problems.mpc_linear import LinearPlanner
from problems.prediction import Horizon, horizon, posture
from problems.receding import Planner, Receding

Array = NDArray[np.float64]

LAWS: dict[str, LawKind] = {"pd": "pd", "force": "force", "cop": "cop"}
SYNTHESIZED: dict[str, LawKind] = {f"{name}-synthesized": kind for name, kind in LAWS.items()}
PREDICTIVE = ("mpc", "nmpc", "mpc-oracle", "mpc-preview")
NAMES = (*LAWS, *SYNTHESIZED, *PREDICTIVE)


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
        return SampledLaw(
            kind=kind, biped=setting.biped, gains=gains, period=ankle.period, theta_d=setting.theta_d
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
        planner=_planner(name == "nmpc", prediction(setting, preview=name == "mpc-preview")),
        informant=informant,
        actuator=ankle,
        feedback=_lqr(setting),
        fallback=setting.gains or Gains(*_lqr(setting), 0.0),
        delay=informant.delay,
    )


@lru_cache(maxsize=8)
def prediction(setting: Setting, *, preview: bool = False) -> Horizon:
    """What the predictive controllers of ``setting`` predict with; ``preview`` is for who knows the force ahead."""
    tuning = setting.tuning
    if preview:
        tuning = replace(tuning, torque=tuning.preview_torque)
    return horizon(setting.biped, tuning, actuator(setting), setting.required)


def _lqr(setting: Setting) -> tuple[float, float]:
    """K_p and K_d of LQR about the upright posture."""
    upright = posture(setting.biped, setting.tuning, setting.biped.M * setting.biped.g)
    return float(upright.K[0]), float(upright.K[1])


def _planner(nonlinear: bool, ahead: Horizon) -> Planner:
    if nonlinear:
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
