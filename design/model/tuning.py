"""The numbers by which a predictive controller and its observer are tuned."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Tuning:
    """Prediction over ``horizon`` steps of ``step`` [s]; cost (e/1 rad)² + rate (omega/Omega)² + torque (tau/(A L))².

    ``contact``: by which part of the weight toe and heel force are planned above the required level. ``walk`` [1/√s]:
    how fast the observer lets the external force change, by its part of the weight. ``preview_torque``: ``torque`` of a
    prediction that knows the force ahead. ``real_time``: one iteration of the nonlinear program a period.
    """

    step: float = 0.02
    horizon: int = 50
    rate: float = 0.02
    torque: float = 0.0135
    contact: float = 0.01
    preview_torque: float = 100.0
    walk: float = 0.01
    real_time: bool = False
