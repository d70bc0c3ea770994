"""Clipped LQR: the linear prediction's own feedback without its constraints, its torque clipped to what keeps contact.

    tau = tau_0 - K (theta - theta_f, omega)       K: discrete-time LQR of ``problems.prediction.posture``
    clipped to [low, high]                         F_T >= margin, F_H >= margin under the state and force estimated now

Toe and heel force (5)-(7) are affine in the torque, so that the interval is exact. Where it is empty the torque that
loads toe and heel equally, relative to their margins, is taken. Model, weights, observer, period and delay are those
of the predictive controllers: where no limit is active ``mpc`` gives the same torque, and what ``mpc`` gains over this
controller is what looking ahead is worth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from design.analysis.observer import Belief
from design.buffered import Buffered
from design.model.body import Biped
from design.model.plant import body_numbers, reactions
from design.solvers.outcome import Outcome, Status
from problems.prediction import GRID, Horizon, posture, resting
from problems.receding import Plan


@lru_cache(maxsize=1)
def _contact_forces() -> Buffered:
    return Buffered(reactions())


def contact_interval(
    biped: Biped, x: tuple[float, float], F: tuple[float, float], margin: float
) -> tuple[float, float]:
    """The torques (low, high) [N m] under which F_T and F_H are at least ``margin`` [N] in state ``x`` under ``F``.

    ``x``: theta [rad] and omega [rad/s]; ``F``: F_x and F_y [N]. low > high where no torque keeps both.
    """
    forces = _contact_forces()
    body = body_numbers(biped)
    at_zero = forces(x=x, tau=0.0, body=body, F=F)["forces"].copy()
    toe, heel = at_zero - margin
    toe_slope, heel_slope = forces(x=x, tau=1.0, body=body, F=F)["forces"] - at_zero
    # F_T falls and F_H grows with the torque, as long as the body does not lean by tens of degrees
    return float(-heel / heel_slope), float(-toe / toe_slope)


@dataclass(frozen=True, eq=False, kw_only=True)
class ClippedLqr:
    """A planner (``problems.receding.Planner``) whose plan is one step of clipped LQR."""

    horizon: Horizon

    def plan(self, t: float, belief: Belief, before: float, previous: Plan | None) -> Outcome[Plan]:
        """The torque for the state and force estimated now; ``before`` and ``previous`` do not matter."""
        biped, tuning = self.horizon.biped, self.horizon.tuning
        # the equilibrium under the estimated external force, and the feedback about it
        A, theta_f, tau_0 = resting(self.horizon, belief.F_x, belief.F_y)
        size = round(math.log(max(A / biped.weight, 1e-3)) / GRID)
        model = posture(biped, tuning, biped.weight * math.exp(GRID * size))
        wanted = tau_0 - float(model.K @ [belief.theta - theta_f, belief.omega])
        # clip to the torques that keep contact
        state, force = (belief.theta, belief.omega), (belief.F_x, belief.F_y)
        low, high = contact_interval(biped, state, force, tuning.contact * biped.weight)
        tau = min(max(wanted, low), high) if low <= high else 0.5 * (low + high)
        if not math.isfinite(tau):
            return Outcome(status=Status.STALLED, detail="the torque is not finite")
        away = np.array([belief.theta - theta_f, belief.omega])
        after = model.Ad @ away + model.Bd * (tau - tau_0)
        states = np.array([[belief.theta, theta_f + after[0]], [belief.omega, after[1]]])
        detail = "LQR" if tau == wanted else "LQR, clipped"
        plan = Plan(start=t, step=tuning.step, torque=np.array([tau]), states=states)
        return Outcome(status=Status.SOLVED, detail=detail, found=plan)
