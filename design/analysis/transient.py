"""How a run ends: settling to the stationary posture, overshoot, the error left, and how fast the torque moves.

With e = theta - theta_f, theta_f the posture of the force at the end, and t_c the last corner of the force:

    settling <= T       |e(t)| <= BAND max|e|     at every sample from t_c + T on, the largest |e| being the run's own
    overshoot <= x      -sign(e(t_c)) e(t) <= x   at every sample from t_c on; |e(t)| <= x where e(t_c) is 0
    posture-error <= x  |e| <= x                  at the last sample

``Approach`` says which samples these are. The report reads its rows by it, and gain synthesis poses its constraints.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

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


AT_REST, PART_AT_REST = 1e-9, 1e-6
"""|e| [rad], and part of the largest |e|, up to which a posture is taken for theta_f."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Approach:
    """The final posture ``theta_f`` [rad] of a scenario, and the samples at which the approach to it is judged.

    ``elapsed`` (n,): time of each sample after the last corner of the force [s]; ``first``: the number of the first
    sample that is not before the corner, n where there is none.
    """

    theta_f: float
    elapsed: Array
    first: int

    def settled_from(self, T: float) -> int:
        """The sample from which on e must lie within the band for a settling time of at most ``T`` [s].

        The settling time is that of a sample, so it is the last one at t_c + T or before.
        """
        return max(int(np.searchsorted(self.elapsed, T, side="right")) - 1, min(self.first, len(self.elapsed) - 1))

    def settled(self, e: Array, band: float) -> int | None:
        """The sample from which on ``e`` (n,) stays within ``band`` [rad]; None if it leaves it at the last one."""
        outside = self.first + np.flatnonzero(np.abs(e[self.first :]) > band)
        if not len(outside):
            return self.first
        return None if outside[-1] == len(e) - 1 else int(outside[-1]) + 1

    def side(self, e: Array) -> float:
        """The sign of ``e`` (n,) at the corner, from which it comes; 0 where that is theta_f, to within rounding."""
        start = float(e[self.first])
        return 0.0 if abs(start) <= AT_REST + PART_AT_REST * float(np.abs(e).max()) else math.copysign(1.0, start)


def approach(loop: ClosedLoop, scenario: Scenario, t: Array, F: Array) -> Approach:
    """The approach to the posture under the last of the forces ``F`` (2, n) [N] at the samples ``t`` (n,) [s].

    That posture is theta_f (4), or the one with the CoP at its target.
    """
    theta_f = posture(loop.biped, float(F[0, -1]), float(F[1, -1]), loop.law.target)
    elapsed = np.round(t - scenario.steady_from, 12)  # so that 5.8 s are 0.8 s after 5 s, not less
    return Approach(theta_f=theta_f, elapsed=elapsed, first=int(np.searchsorted(elapsed, 0.0)))


class Transient(NamedTuple):
    """The approach to the final theta_f.

    ``settling`` [s] after the last corner of the force, infinite if it does not settle; ``overshoot`` past theta_f and
    ``error`` at the end [rad]; the times [s] of the first two.
    """

    settling: float
    settled_at: float
    overshoot: float
    overshoot_at: float
    error: float


def transient(loop: ClosedLoop, scenario: Scenario, run: Trajectory, band: float | None = None) -> Transient:
    """The approach of ``run`` to its final posture; ``band`` [rad] instead of ``BAND`` of the largest distance."""
    to = approach(loop, scenario, run.t, run.F)
    e = run.theta - to.theta_f
    settling, settled_at = math.inf, float(run.t[-1])
    overshoot, overshoot_at = 0.0, 0.0
    if to.first < len(e):
        settled = to.settled(e, BAND * float(np.abs(e).max()) if band is None else band)
        if settled is not None and run.fallen is None:
            settling, settled_at = float(to.elapsed[settled]), float(run.t[settled])
        side, after = to.side(e), e[to.first :]
        past = -side * after if side else np.abs(after)
        at = int(np.argmax(past))
        overshoot, overshoot_at = max(float(past[at]), 0.0), float(run.t[to.first + at])
    return Transient(settling, settled_at, overshoot, overshoot_at, error=abs(float(e[-1])))


def torque_rate(loop: ClosedLoop, gains: Gains, run: Trajectory) -> Array:
    """dtau/dt along a run (n,) [N m/s], by the chain rule through (10) and (13)."""
    count = len(run.t)
    along = torque_rate_of(loop).map(count)
    states = loop.states(run.theta, run.omega, run.s, run.theta_d)
    return np.asarray(along(states, run.F, ca.repmat(ca.DM(gains), 1, count)).full().ravel())


@lru_cache(maxsize=16)
def torque_rate_of(loop: ClosedLoop) -> ca.Function:
    """dtau/dt [N m/s] as a function (z (n), F (2), K (3))."""
    z, F, K = ca.SX.sym("z", loop.size), ca.SX.sym("F", 2), ca.SX.sym("K", 3)
    rate = ca.jtimes(loop.torque(z, K), z, loop.rate(z, F, K))
    return ca.Function("torque_rate", [z, F, K], [rate], {"cse": True})
