"""CoP-constrained linear MPC: the prediction of ``problems.prediction`` as a small QP.

minimise    over the deviation from the LQR response          the same cost, quadratic
subject to  the same limits, linearised about the stationary posture, in the first step about the state itself

*Rows.* A ``Limit`` is linearised with its own CasADi function; f_y depends on the torque through theta'' (7), and so do
F_T and F_H beyond their -+tau/(2 ell). In the first step they are affine in the torque as they stand, and exact.
*Coordinates.* Those of ``problems.flat``: N + 1 unknowns, no equalities, banded. *Shortcut.* Where the LQR response
keeps every limit it is the optimum, and no QP is solved. *Model.* A is taken from a grid of half a per cent; theta_f is
exact, so that nothing is offset at rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache

import casadi as ca
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from design.analysis.observer import Belief
from design.buffered import Buffered
from design.solvers.conic import Clarabel, Cone, ConicProgram
from design.solvers.outcome import Outcome, Status
from problems.flat import Pattern, bands, with_end
from problems.prediction import Horizon, posture, stationary
from problems.receding import Plan

Array = NDArray[np.float64]

GRID = 0.005
"""Ratio between neighbouring values of A for which a model is built."""
CURVATURE = 3e5
"""The objective is scaled until torque curves it this much: near rest costs are tiny, and Clarabel's tolerances are
absolute as well as relative."""
BROKEN = 1e-5
"""How far a row of the answer may be broken, by its scale."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LinearPlanner:
    """Plans with the QP; ``shortcut`` is whether the LQR response is taken without solving where it is the optimum.

    Its ``solvers``, by the size of A, are its own: Clarabel's last digits depend on what it solved before.
    """

    horizon: Horizon
    shortcut: bool = True
    solvers: dict[int, Clarabel] = field(default_factory=dict)

    def plan(self, t: float, belief: Belief, before: float, previous: Plan | None) -> Outcome[Plan]:
        """See ``problems.receding.Planner``."""
        A, theta_f = stationary(self.horizon.biped, belief.F_x, belief.F_y)
        steps = round(math.log(max(A / self.horizon.biped.weight, 1e-3)) / GRID)
        program = _program(self.horizon, steps)
        if steps not in self.solvers:
            self.solvers[steps] = Clarabel(program.posed, tolerance=1e-7, seconds=1.0)
        return program.plan(self.solvers[steps], t, belief, theta_f, before, shortcut=self.shortcut)


@lru_cache(maxsize=64)
def _program(horizon: Horizon, steps: int) -> _Program:
    return _Program(horizon, horizon.biped.weight * float(np.exp(GRID * steps)))


class _Program:
    """The QP for one value of A: what does not change from step to step, built once."""

    def __init__(self, horizon: Horizon, A: float) -> None:
        tuning, biped = horizon.tuning, horizon.biped
        self._horizon, self._model, self._count = horizon, posture(biped, tuning, A), tuning.horizon
        model, N = self._model, self._count
        self._bands = bands(model, N)
        closed = model.Ad - np.outer(model.Bd, model.K)
        response = [np.eye(2)]
        for _ in range(N):
            response.append(closed @ response[-1])
        states = np.array(response)
        self._free = states
        self._response = with_end(model, states[:, 0], states[:, 1], -(model.K @ states[:N]))
        self._pushed = np.zeros((N + 1, 2, N))  # what an extra torque at one step does to the states after it
        for k in range(N):
            self._pushed[k + 1 :, :, k] = states[: N - k] @ model.Bd
        linearised = _linearised(horizon)
        self._limits = Buffered(linearised)
        self._levels = Buffered(_levels(linearised, N + 1))
        each = sum(limit.quantity.size1_out(0) for limit, _ in horizon.rows)
        self._pattern = Pattern(self._bands, each, horizon.actuator, tuning.step, biped.weight * biped.ell)
        self._unit = CURVATURE / (model.R * np.abs(self._bands.tau).max() ** 2)
        self._q = self._unit * np.append(np.zeros(N), horizon.penalty)
        level = np.array([0.0, biped.M * biped.g - A])  # a force that makes gravity A: what the solver is scaled by
        self._pattern.entries(self._table(np.zeros(2), 0.0, level)[:, 1:])
        matrix = self._pattern.matrix()
        cones = [Cone("nonnegative", matrix.shape[0])]
        self.posed = ConicProgram(P=self._cost(), q=self._q, A=matrix, b=np.zeros(matrix.shape[0]), cones=cones)

    def _table(self, x: Array, tau: float, F: Array) -> Array:
        """Each limit component's margin and its slopes in theta, omega and tau (each, 4)."""
        return self._limits(x=x, tau=tau, F=F)["table"].reshape(4, -1).T.copy()

    def _cost(self) -> sp.csc_matrix:
        model, N, along = self._model, self._count, self._bands
        cost = along.e[:N].T @ along.e[:N] + model.R * along.tau.T @ along.tau
        cost += model.Q[1, 1] * along.omega[:N].T @ along.omega[:N]
        end = np.vstack([along.e[N], along.omega[N]])
        cost += end.T @ model.P @ end
        whole = np.zeros((N + 1, N + 1))
        whole[:N, :N] = self._unit * (cost + cost.T)
        return sp.csc_matrix(whole)

    def plan(
        self, solver: Clarabel, t: float, belief: Belief, theta_f: float, before: float, *, shortcut: bool
    ) -> Outcome[Plan]:
        """Pose the numbers of this step, solve, recheck."""
        N, along = self._count, self._bands
        F = np.array([belief.F_x, belief.F_y])
        now = self._table(np.array([belief.theta, belief.omega]), before, F)
        there = self._table(np.array([theta_f, 0.0]), 0.0, F)
        here = np.array([belief.theta - theta_f, belief.omega])
        if belief.ahead is None:
            points, q = self._response @ here, self._q
            margins = points @ there[:, 1:].T + there[:, 0]
        else:
            points, q = self._foreseen(belief.ahead, theta_f, here)
            at_rest = self._levels(x=[theta_f, 0.0], tau=0.0, F=belief.ahead.T.ravel())
            levels = at_rest["margins"].reshape(N + 1, -1)
            margins = points @ there[:, 1:].T + np.vstack([levels, levels[-1:]])
        margins[0] = (now[:, 0] + now[:, 1:] @ (points[0] - [*here, before])) * _as_steep(now[:, 3], there[:, 3])
        b = self._pattern.room(points, margins, before)
        states, torque = points[: N + 1, :2].T.copy(), points[:N, 2]
        detail = "LQR's response keeps every limit"
        if not (shortcut and belief.ahead is None and b.min() >= 0):
            solver.update(q=q, A=self._pattern.entries(there[:, 1:]), b=b)
            answer = solver.solve()
            detail = f"Clarabel: {answer.said}"
            if not answer.solved:
                return Outcome(status=Status.STALLED, detail=detail)
            if (solver.product(answer.x) - b).max() > BROKEN:
                return Outcome(status=Status.DISAGREEMENT, detail=f"{detail}, but a row is broken")
            y = answer.x[:N]
            states += [along.e @ y, along.omega @ y]
            torque = torque + along.tau @ y
        states[0] += theta_f
        plan = Plan(start=t, step=self._horizon.tuning.step, torque=torque, states=states)
        return Outcome(status=Status.SOLVED, detail=detail, found=plan)

    def _foreseen(self, ahead: Array, theta_f: float, here: Array) -> tuple[Array, Array]:
        """For a force that changes: the points of a response (N+2, 3), and the cost's gradient there (N+1,)."""
        biped, model, N, along = self._horizon.biped, self._model, self._count, self._bands
        goal = np.arctan2(-ahead[0], biped.M * biped.g - ahead[1]) - theta_f
        change = ahead - ahead[:, :1]
        turning = biped.L * (change[0] * np.cos(theta_f) - change[1] * np.sin(theta_f))  # as a torque [N m]
        push = 0.5 * (turning[:-1] + turning[1:])
        lead = model.K[0] * goal[:N]
        states = self._free @ here + self._pushed @ (push + lead)
        torque = lead - states[:N] @ model.K
        away, omega = states[:, 0] - goal, states[:, 1]
        end = model.P @ [away[N], omega[N]]
        gradient = along.e[:N].T @ away[:N] + model.Q[1, 1] * along.omega[:N].T @ omega[:N]
        gradient += model.R * along.tau.T @ torque + along.e[N] * end[0] + along.omega[N] * end[1]
        points = with_end(model, states[:, 0], omega, torque, float(goal[N]))
        return points, self._unit * np.append(2 * gradient, self._horizon.penalty)


def _as_steep(now: Array, there: Array) -> Array:
    """Factors that give rows with the slopes ``now`` in tau those of ``there``: the first step's have no other unknown.

    So the matrix stays the same as long as the force believed does. Where the slopes have little to do with each other
    (a limit that the torque hardly moves) the row is left as it is.
    """
    with np.errstate(all="ignore"):
        factors = there / now
    return np.where((factors > 0.5) & (factors < 2.0), factors, 1.0)


def _linearised(horizon: Horizon) -> ca.Function:
    """(x, tau, F) -> each limit component's margin, and its slopes in theta, omega and tau, by its scale."""
    x, tau, F = ca.SX.sym("x", 2), ca.SX.sym("tau"), ca.SX.sym("F", 2)
    margins = ca.vertcat(
        *[limit.margin(limit.quantity(x, tau, F), level) / limit.scale for limit, level in horizon.rows]
    )
    table = ca.horzcat(margins, ca.densify(ca.jacobian(margins, ca.vertcat(x, tau))))
    return ca.Function("linearised", [x, tau, F], [ca.densify(table)], ["x", "tau", "F"], ["table"], {"cse": True})


def _levels(linearised: ca.Function, count: int) -> ca.Function:
    """(x, tau, F (2, count)) -> the margins at each force (each, count)."""
    x, tau, F = ca.MX.sym("x", 2), ca.MX.sym("tau"), ca.MX.sym("F", 2, count)
    table = linearised.map(count)(ca.repmat(x, 1, count), ca.repmat(tau, 1, count), F)
    return ca.Function("levels", [x, tau, F], [ca.densify(table[:, 0::4])], ["x", "tau", "F"], ["margins"])
