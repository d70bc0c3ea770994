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
from design.analysis.slabs import SLAB, mapped, marched
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


@lru_cache(maxsize=64)
def _runner(loop: ClosedLoop, scenario: Scenario, step: float) -> tuple[Steps, ca.Function]:
    """The samples, and a function (K, s at t = 0) -> z, tau, F_T, F_H at all of them (n + 3, N+1).

    Built once with the scenario inside: CasADi does not give back what it builds, and handing it large arrays at every
    call takes longer than the run.
    """
    steps = scenario.steps(step)
    count = len(steps.h)
    K, s0 = ca.MX.sym("K", 3), ca.MX.sym("s0")
    z0 = ca.vertcat(*loop.start(scenario.theta0, scenario.omega0, s0))
    inputs = ca.DM(np.vstack([steps.h, steps.start, steps.middle, steps.end]))
    z = ca.horzcat(z0, loop.march(count)(z0, inputs, ca.repmat(K, 1, count)))
    y = loop.readout.map(count + 1)(z, ca.DM(steps.force), ca.repmat(K, 1, count + 1))
    return steps, ca.Function("run", [K, s0], [ca.vertcat(z, y)])


def _in_slabs(loop: ClosedLoop, scenario: Scenario, gains: Gains, step: float, s0: float) -> tuple[Steps, Array]:
    """The same for many samples, of which nothing is kept."""
    steps = scenario.steps(step)
    deadline.check()
    start = np.array(loop.start(scenario.theta0, scenario.omega0, s0), dtype=float)
    z = marched(loop.step, start, steps, np.array(gains))
    K = np.broadcast_to(np.array(gains)[:, None], (3, z.shape[1]))
    return steps, np.vstack([z, mapped(loop.readout, [z, steps.force, K])])


def simulate(loop: ClosedLoop, scenario: Scenario, gains: Gains, step: float, s0: float = 0.0) -> Trajectory:
    """Run ``loop`` with ``gains`` through ``scenario``, with Runge-Kutta steps of ``step`` [s].

    ``s0`` is the law's integral at t = 0, in the unit of its kind (N s, or m s for ``cop``). Raises ``OutOfTime`` where
    a deadline is set and has passed.
    """
    deadline.check()
    if scenario.duration / step > SLAB:
        steps, found = _in_slabs(loop, scenario, gains, step, s0)
    else:
        steps, run = _runner(loop, scenario, step)
        found = run(ca.DM(gains), s0).full()
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
