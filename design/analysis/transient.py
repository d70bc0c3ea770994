"""How a run ends: settling to the stationary posture, overshoot, the error left, and how fast the torque moves."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design.analysis.simulate import Trajectory
from design.model.closed_loop import ClosedLoop
from design.model.environment import Scenario
from design.model.laws import Gains
from design.model.standing import posture

Array = NDArray[np.float64]

BAND = 0.02
"""A posture has settled when it stays within this part of its largest distance from the final theta_f."""


@dataclass(frozen=True, kw_only=True)
class Transient:
    """The approach to the final theta_f.

    ``settling`` [s] after the last corner of the force, infinite if it does not settle; ``overshoot`` past theta_f and
    ``error`` at the end [rad]; the times [s] of both.
    """

    settling: float
    settled_at: float
    overshoot: float
    overshoot_at: float
    error: float


def transient(loop: ClosedLoop, scenario: Scenario, run: Trajectory, band: float | None = None) -> Transient:
    """The approach to the posture theta_f (4) of the force at the end of ``run``, or that with the CoP at its target.

    ``band`` [rad] around it is where it has settled; left out, ``BAND`` of the run's largest distance.
    """
    F_x, F_y = run.F[:, -1]
    theta_f = posture(loop.biped, float(F_x), float(F_y), loop.law.target)
    corner = scenario.steady_from
    away = run.theta - theta_f
    after = np.flatnonzero(run.t >= corner)
    outside = after[np.abs(away[after]) > (BAND * np.abs(away).max() if band is None else band)]
    if run.fallen is not None or (len(outside) and outside[-1] == len(run.t) - 1) or not len(after):
        settling, settled_at = math.inf, float(run.t[-1])
    else:
        settled_at = float(run.t[outside[-1] + 1]) if len(outside) else corner
        settling = settled_at - corner
    past = np.zeros(1)
    if len(after):
        first = float(away[after[0]])
        at_rest = abs(first) <= 1e-9 + 1e-6 * float(np.abs(away).max())  # it starts there: either side is past it
        past = np.abs(away[after]) if at_rest else -math.copysign(1.0, first) * away[after]
    at = int(np.argmax(past))
    return Transient(
        settling=settling,
        settled_at=settled_at,
        overshoot=max(float(past[at]), 0.0),
        overshoot_at=float(run.t[after[at]]) if len(after) else 0.0,
        error=abs(float(away[-1])),
    )


def torque_rate(loop: ClosedLoop, gains: Gains, run: Trajectory) -> Array:
    """dtau/dt along a run (n,) [N m/s], by the chain rule through (10) and (13)."""
    z, F, K = ca.SX.sym("z", loop.size), ca.SX.sym("F", 2), ca.SX.sym("K", 3)
    rate = ca.jtimes(loop.torque(z, K), z, loop.rate(z, F, K))
    count = len(run.t)
    along = ca.Function("torque_rate", [z, F, K], [rate]).map(count)
    states = loop.states(run.theta, run.omega, run.s, run.theta_d)
    return np.asarray(along(states, run.F, ca.repmat(ca.DM(gains), 1, count)).full().ravel())
