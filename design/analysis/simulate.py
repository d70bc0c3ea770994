"""One closed-loop run: the Runge-Kutta method at the spec's step, as the paper does it.

Contact forces may go negative, as in the paper; the first instant of lost contact is a fact of the trajectory, and so
is a fall, at which the trajectory ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design import deadline
from design.analysis.estimate import static_estimate
from design.analysis.slabs import mapped
from design.model.closed_loop import ClosedLoop
from design.model.environment import Scenario, Steps
from design.model.laws import Gains
from design.model.limits import Limit

Array = NDArray[np.float64]

FALLEN = 0.5 * np.pi
"""|theta| at which the body counts as fallen [rad]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Trajectory:
    """Samples of one run, each array (n,) but F and F_estimate (2, n), in SI units; ``theta_d`` the desired angle.

    ``alpha`` is None where the scenario is not a slope. ``fallen`` is the time of the fall, after which nothing is
    stored, or None.
    """

    scenario: str
    t: Array
    theta: Array
    omega: Array
    s: Array
    theta_d: Array
    tau: Array
    F_T: Array
    F_H: Array
    P: Array
    F: Array
    F_estimate: Array
    alpha: Array | None
    fallen: float | None

    @property
    def lost_contact(self) -> tuple[float, str] | None:
        """The first instant [s] at which a contact force is negative, and which (``toe`` or ``heel``)."""
        lost = np.flatnonzero((self.F_T < 0) | (self.F_H < 0))
        if not len(lost):
            return None
        first = int(lost[0])
        return float(self.t[first]), "toe" if self.F_T[first] < 0 else "heel"


MARCH = 2000
"""Steps that are marched in one call: memory for more buys no speed."""


@lru_cache(maxsize=32)
def _march(loop: ClosedLoop, count: int) -> ca.Function:
    """(z (n), u (7, count), F (2, count) after each step, K (3)) -> z, tau, F_T, F_H after each step (n + 3, count)."""
    z, u, F, K = ca.MX.sym("z", loop.size), ca.MX.sym("u", 7, count), ca.MX.sym("F", 2, count), ca.MX.sym("K", 3)
    gains = ca.repmat(K, 1, count)
    after = loop.march(count)(z, u, gains)
    return ca.Function("march", [z, u, F, K], [ca.vertcat(after, loop.readout.map(count)(after, F, gains))])


def _marched(loop: ClosedLoop, scenario: Scenario, steps: Steps, gains: Gains, s0: float) -> Array:
    """z, tau, F_T, F_H at all samples (n + 3, N+1), or up to a fall and some samples on.

    In blocks of one size; the last is filled up with steps of no length, which are left out. Raises ``OutOfTime``
    between two blocks if the deadline has passed.
    """
    count = len(steps.h)
    block = min(MARCH, -(-count // 250) * 250)
    march, n, K = _march(loop, block), loop.size, ca.DM(gains)
    found = np.empty((n + 3, count + 1))
    found[:n, 0] = loop.start(scenario.theta0, scenario.omega0, s0)
    found[n:, 0] = loop.readout(found[:n, 0], steps.force[:, 0], K).full()[:, 0]
    for begin in range(0, count, block):
        deadline.check()
        end = min(begin + block, count)
        u, F = np.zeros((7, block)), np.zeros((2, block))
        within = np.s_[begin:end]
        u[:, : end - begin] = np.vstack(
            [steps.h[within], steps.start[:, within], steps.middle[:, within], steps.end[:, within]]
        )
        F[:, : end - begin] = steps.force[:, begin + 1 : end + 1]
        found[:, begin + 1 : end + 1] = march(found[:n, begin], u, F, K).full()[:, : end - begin]
        if not np.abs(found[0, end]) < FALLEN:
            return found[:, : end + 1]
    return found


def simulate(loop: ClosedLoop, scenario: Scenario, gains: Gains, step: float, s0: float = 0.0) -> Trajectory:
    """Run ``loop`` with ``gains`` through ``scenario``, with Runge-Kutta steps of ``step`` [s].

    ``s0`` is the law's integral at t = 0, in the unit of its kind (N s, or m s for ``cop``). Raises ``OutOfTime`` where
    a deadline is set and has passed.
    """
    steps = scenario.steps(step)
    found = _marched(loop, scenario, steps, gains, s0)
    upright = np.all(np.isfinite(found), axis=0) & (np.abs(found[0]) < FALLEN)
    fallen = None
    if not upright.all():
        end = max(int(np.argmin(upright)), 1)
        fallen = float(steps.t[min(end, len(steps.t) - 1)])
        found = found[:, :end]
    z, (tau, F_T, F_H) = found[:-3], found[-3:]
    theta, omega, s = z[:3]
    n = len(theta)
    with np.errstate(all="ignore"):
        P = loop.biped.pressure(F_T, F_H)
    return Trajectory(
        scenario=scenario.name,
        t=steps.t[:n],
        theta=theta,
        omega=omega,
        s=s,
        theta_d=loop.theta_d(z),
        tau=tau,
        F_T=F_T,
        F_H=F_H,
        P=P,
        F=steps.force[:, :n],
        F_estimate=np.vstack(static_estimate(loop.biped, theta, F_T, F_H, loop.law.target)),
        alpha=scenario.angle * steps.signal[0, :n] if scenario.kind == "slope" else None,
        fallen=fallen,
    )


def components(limits: Sequence[Limit], trajectory: Trajectory) -> list[Array]:
    """Each limit's quantity along a trajectory, (c, n)."""
    x = np.vstack([trajectory.theta, trajectory.omega])
    found = mapped(_stacked(tuple(limit.quantity for limit in limits)), [x, trajectory.tau[None, :], trajectory.F])
    ends = np.cumsum([limit.quantity.size1_out(0) for limit in limits])
    return np.vsplit(found, ends[:-1])


@lru_cache(maxsize=64)
def _stacked(quantities: tuple[ca.Function, ...]) -> ca.Function:
    return all_quantities(quantities)


def all_quantities(quantities: Sequence[ca.Function]) -> ca.Function:
    """(x, tau, F) -> the components of all ``quantities``, one below the other."""
    x, tau, F = ca.SX.sym("x", 2), ca.SX.sym("tau"), ca.SX.sym("F", 2)
    stacked = ca.vertcat(*[quantity(x, tau, F) for quantity in quantities])
    return ca.Function("quantities", [x, tau, F], [stacked], {"cse": True})
