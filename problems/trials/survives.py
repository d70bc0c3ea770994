"""What a start from the estimate survives: the largest sudden change of the world that keeps toe and heel down.

The robot stands at rest in the posture theta_f of the world that it knows, theta_d = theta_f, its integral as (14) has
it. At t = 0 the slope changes by a jump (or, where the world is no slope, the horizontal force). Survived is a run in
which toe and heel force stay >= 0 at every sample and the body does not fall. Sought in each direction by itself, as
they are not alike on inclined ground: a scan from small changes on, so that all smaller ones are survived too, then
bisection.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design.analysis.simulate import FALLEN
from design.analysis.survival import HORIZON, slope_limit
from design.model.closed_loop import ClosedLoop
from design.model.environment import Scenario, slope_force
from design.model.laws import Gains

Array = NDArray[np.float64]

SCAN = 10
"""Changes that are tried before bisection, each a fifth of what a body at rest on level ground can survive at all."""
FINE = 1e-4


@dataclass(frozen=True, kw_only=True)
class Change:
    """The largest sudden change survived ``up`` (>= 0) and ``down`` (<= 0) from ``start``.

    In rad of slope (``slope``) or N of horizontal force.
    """

    slope: bool
    start: float
    up: float
    down: float


def change(loop: ClosedLoop, gains: Gains, scenario: Scenario, step: float) -> Change:
    """What is survived by who stands at the theta_d of ``loop`` in the world at the end of ``scenario``."""
    real, theta_d = loop.biped, loop.law.theta_d
    watched = _watched(loop, step)
    end = scenario.force_at(np.array([scenario.duration]))[:, 0]
    sloping = scenario.kind == "slope"
    limit = slope_limit(real)
    at_end = np.array([scenario.duration])
    now = scenario.angle * float(scenario.signal_by(at_end, at_end)[0, 0]) if sloping else float(end[0])
    unit = limit if sloping else math.tan(limit) * (real.M * real.g - float(end[1]))
    to_force = slope_force(real)

    def kept(size: float) -> bool:
        F = to_force(np.array([[now + size]]))[:, 0] if sloping else end + np.array([size, 0.0])
        lowest, farthest = watched(theta_d, ca.DM(F), ca.DM(gains)).full().ravel()
        return bool(np.isfinite(lowest) and lowest >= 0 and farthest < FALLEN)

    return Change(slope=sloping, start=now, up=_largest(kept, unit), down=-_largest(lambda d: kept(-d), unit))


def _largest(kept: Callable[[float], bool], unit: float) -> float:
    """The end of the interval from 0 on which all are kept, to ``FINE`` of ``unit``; up to two units."""
    low, high = 0.0, None
    for k in range(1, SCAN + 1):
        size = 2 * unit * k / SCAN
        if not kept(size):
            high = size
            break
        low = size
    while high is not None and high - low > FINE * unit:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if kept(middle) else (low, middle)
    return low


def _watched(loop: ClosedLoop, step: float) -> ca.Function:
    """(theta0, F, K) -> the smallest contact force and the largest |theta| under a constant force, from rest."""
    count = max(1, math.ceil(HORIZON / step))
    theta0, F, K = ca.MX.sym("theta0"), ca.MX.sym("F", 2), ca.MX.sym("K", 3)
    z0 = ca.vertcat(*loop.start(theta0, 0.0))
    u = ca.vertcat(step, F, F, F)
    z = ca.horzcat(z0, loop.march(count)(z0, ca.repmat(u, 1, count), ca.repmat(K, 1, count)))
    y = loop.readout.map(count + 1)(z, ca.repmat(F, 1, count + 1), ca.repmat(K, 1, count + 1))
    lowest = ca.mmin(ca.vec(y[1:, :]))
    return ca.Function("watched", [theta0, F, K], [ca.vertcat(lowest, ca.mmax(ca.fabs(z[0, :])))])
