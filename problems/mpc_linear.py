"""CoP-constrained linear MPC: the prediction of ``problems.prediction`` as a small QP.

minimise    over the deviation from the LQR response          the same cost, quadratic
subject to  the same limits, linearised about the stationary posture, in the first step about the state itself

*Rows.* Those of ``problems.linear_rows``. *Coordinates.* Those of ``problems.flat``: N + 1 unknowns, no equalities,
banded. *Shortcuts.* Where the LQR response keeps every limit it is the optimum, and no QP is solved. Where it breaks
none after a part of the horizon, that part is solved first, and continued by LQR: a program with fewer rows, so that
its optimum, if it keeps them all, is the whole one's (Scokaert and Rawlings 1998). *Model.* A is taken from a grid of
half a per cent; theta_f is exact, so that nothing is offset at rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from design.analysis.observer import Belief
from design.buffered import Buffered
from design.model.standing import standing
from design.solvers.conic import Clarabel, Cone, ConicAnswer, ConicProgram
from design.solvers.outcome import Outcome, Status
from problems.flat import Pattern, bands, with_end
from problems.linear_rows import Rows, at_rest, linearised
from problems.prediction import GRID, Horizon, Posture, posture, resting
from problems.receding import Plan

Array = NDArray[np.float64]

CURVATURE = 3e4
"""The objective is scaled until torque curves it this much: near rest costs are tiny, and Clarabel's tolerances are
absolute as well as relative."""
GAP = 1e-11
"""The gap that Clarabel is asked for. It stops on the central path, where limits that do not bind still push in
proportion to the gap: at 1e-8 the torque was seen 2e-5 N m from LQR's with nothing active, at this less than 1e-8."""
BROKEN = 1e-5
"""How far a row of the answer may be broken, by its scale."""
PART = 0.4
"""The part of the horizon that is solved first."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LinearPlanner:
    """Plans with the QP; ``shortcut`` is whether what needs no QP, or a part of it only, is tried first.

    Its ``solvers``, by the size of A and the length, are its own: Clarabel's last digits depend on what it solved
    before.
    """

    horizon: Horizon
    shortcut: bool = True
    solvers: dict[tuple[int, int], Clarabel] = field(default_factory=dict)

    def plan(self, t: float, belief: Belief, before: float, previous: Plan | None) -> Outcome[Plan]:
        """See ``problems.receding.Planner``."""
        A, theta_f, tau_0 = resting(self.horizon, belief.F_x, belief.F_y)
        steps = round(math.log(max(A / self.horizon.biped.weight, 1e-3)) / GRID)

        def solver(program: _Program) -> Clarabel:
            key = (steps, program.count)
            if key not in self.solvers:
                self.solvers[key] = Clarabel(program.posed, tolerance=1e-7, gap=GAP, seconds=1.0)
            return self.solvers[key]

        return _prediction(self.horizon, steps).plan(
            solver, t, belief, (theta_f, tau_0), before, shortcut=self.shortcut
        )


@lru_cache(maxsize=64)
def _prediction(horizon: Horizon, steps: int) -> _Prediction:
    return _Prediction(horizon, horizon.biped.weight * float(np.exp(GRID * steps)))


class _Program:
    """The QP over the deviation in the first ``count`` steps; ``slopes`` (each, 3) of the limits are an example."""

    def __init__(self, horizon: Horizon, model: Posture, count: int, slopes: Array, *, ends: bool) -> None:
        self.count, along = count, bands(model, count)
        self.bands = along
        size = horizon.biped.weight * horizon.biped.ell
        points = along.points if ends else along.points[:count]
        self.pattern = Pattern(points, len(slopes), horizon.actuator, horizon.tuning.step, size)
        self.unit = CURVATURE / (model.R * np.abs(along.tau).max() ** 2)
        self.q = self.unit * np.append(np.zeros(count), horizon.penalty)
        cost = along.e[:count].T @ along.e[:count] + model.R * along.tau.T @ along.tau
        cost += model.Q[1, 1] * along.omega[:count].T @ along.omega[:count]
        cost += along.turn.T @ model.P @ along.turn
        whole = np.zeros((count + 1, count + 1))
        whole[:count, :count] = self.unit * (cost + cost.T)
        self.pattern.entries(slopes)
        matrix = self.pattern.matrix()
        rows = matrix.shape[0]
        self.posed = ConicProgram(
            P=sp.csc_matrix(whole), q=self.q, A=matrix, b=np.zeros(rows), cones=[Cone("nonnegative", rows)]
        )

    def solve(self, solver: Clarabel, slopes: Array, q: Array, b: Array) -> ConicAnswer:
        """Solve it with these numbers."""
        solver.update(q=q, A=self.pattern.entries(slopes), b=b)
        return solver.solve()


class _Prediction:
    """The prediction for one value of A: what does not change from step to step, built once."""

    def __init__(self, horizon: Horizon, A: float) -> None:
        tuning, biped = horizon.tuning, horizon.biped
        self._horizon, self._model, self._count = horizon, posture(biped, tuning, A), tuning.horizon
        model, N = self._model, self._count
        closed = model.Ad - np.outer(model.Bd, model.K)
        response = [np.eye(2)]
        for _ in range(N):
            response.append(closed @ response[-1])
        states = np.array(response)
        self._free = states

        def response_over(count: int) -> Array:
            """The points (count + 2, 3, 2) of LQR's response to a state."""
            return with_end(model, states[: count + 1, 0], states[: count + 1, 1], -(model.K @ states[:count]))

        self._limits = Buffered(linearised(horizon, N + 2))
        self._limits.given["response"][:] = response_over(N).reshape(-1, 2).ravel("F")
        self._pushed = np.zeros((N + 1, 2, N))  # what an extra torque at one step does to the states after it
        for k in range(N):
            self._pushed[k + 1 :, :, k] = states[: N - k] @ model.Bd
        self._at_rest = Buffered(at_rest(horizon, N + 1))
        level = [0.0, biped.M * biped.g - A]  # a force that makes gravity A: what the solver is scaled by
        slopes = self._limits(now=[0.0, 0.0, 0.0, 0.0, *level, 0.0])["slopes"].reshape(-1, 3)
        self._whole = _Program(horizon, model, N, slopes, ends=True)
        self._part = _Program(horizon, model, round(PART * N), slopes, ends=False)
        self._tail = response_over(N - self._part.count)

    def plan(
        self,
        solver: Callable[[_Program], Clarabel],
        t: float,
        belief: Belief,
        rest: tuple[float, float],
        before: float,
        *,
        shortcut: bool,
    ) -> Outcome[Plan]:
        """Pose the numbers of this step, solve, recheck; ``rest`` is the posture to be reached and its torque."""
        theta_f, hold = rest
        self._limits.given["now"][:] = theta_f, belief.theta, belief.omega, before, belief.F_x, belief.F_y, hold
        limits = self._limits.run()
        points, levels, whole = limits["points"].reshape(-1, 3).copy(), limits["levels"], self._whole
        held, since = belief.ahead is None, before - hold
        if shortcut and held and limits["kept"][0] and whole.pattern.reached(points, since, hold):
            return self._planned(t, rest, points, "LQR's response keeps every limit")
        q = whole.q
        if belief.ahead is not None:
            points, q = self._foreseen(belief.ahead, rest, np.array([belief.theta - theta_f, belief.omega]))
            levels = self._at_rest(theta=theta_f, tau=hold, F=belief.ahead.T.ravel())["margins"]
            levels = levels.reshape(self._count + 1, -1)
            levels = np.vstack([levels, levels[-1:]])
        slopes, first = limits["slopes"].reshape(-1, 3), limits["first"].reshape(-1, 4)
        rows = Rows(whole.pattern, slopes, levels, first, since, hold)
        margins = rows.margins(points)
        if shortcut and held:
            begun = self._begun(solver, rows, points, margins)
            if begun is not None:
                return self._planned(t, rest, *begun)
        answer = whole.solve(solver(whole), rows.slopes, q, rows.room(points, margins))
        detail = f"Clarabel: {answer.said}"
        if not answer.solved:
            return Outcome(status=Status.STALLED, detail=detail)
        points = points + whole.bands.points @ answer.x[:-1]
        if rows.broken(points, float(answer.x[-1])) > BROKEN:
            return Outcome(status=Status.DISAGREEMENT, detail=f"{detail}, but a row is broken")
        return self._planned(t, rest, points, detail)

    def _begun(
        self, solver: Callable[[_Program], Clarabel], rows: Rows, points: Array, margins: Array
    ) -> tuple[Array, str] | None:
        """The optimum, by a deviation in the first part only; None where that does not give it."""
        part = self._part
        n = part.count
        if (margins[n:] < 0).any():
            return None
        b = part.pattern.room(points[:n], margins[:n], rows.before, rows.hold)
        answer = part.solve(solver(part), rows.slopes, part.q, b)
        if not answer.solved:
            return None
        continued = self._continued(points, answer.x[:-1])
        if rows.broken(continued, float(answer.x[-1])) > BROKEN:
            return None
        return continued, f"Clarabel: {answer.said}, then LQR"

    def _continued(self, points: Array, y: Array) -> Array:
        """The points (N+2, 3) with the deviation ``y`` in the first part, and from there on by LQR."""
        n, along = self._part.count, self._part.bands
        state = points[n, :2] + along.turn @ y
        return np.concatenate([points[:n] + along.points[:n] @ y, self._tail @ state])

    def _planned(self, t: float, rest: tuple[float, float], points: Array, detail: str) -> Outcome[Plan]:
        """The plan of these ``points``, which become its own."""
        N = self._count
        points[:, 0] += rest[0]
        if rest[1]:
            points[:, 2] += rest[1]
        plan = Plan(start=t, step=self._horizon.tuning.step, torque=points[:N, 2], states=points[: N + 1, :2].T)
        return Outcome(status=Status.SOLVED, detail=detail, found=plan)

    def _foreseen(self, ahead: Array, rest: tuple[float, float], here: Array) -> tuple[Array, Array]:
        """For a force that changes: the points of a response (N+2, 3), and the cost's gradient there (N+1,)."""
        biped, model, N, along = self._horizon.biped, self._model, self._count, self._whole.bands
        theta_f, hold = rest
        if self._horizon.plain:
            goal, held = np.arctan2(-ahead[0], biped.M * biped.g - ahead[1]) - theta_f, np.zeros(N + 1)
        else:
            each = standing(biped, ahead, self._horizon.target)
            if not (each.A > 0).all():
                message = "no posture has its CoP at the target"
                raise ArithmeticError(message)
            goal, held = each.theta - theta_f, each.tau - hold
        change = ahead - ahead[:, :1]
        turning = biped.L * (change[0] * np.cos(theta_f) - change[1] * np.sin(theta_f))  # as a torque [N m]
        push = 0.5 * (turning[:-1] + turning[1:])
        lead = model.K[0] * goal[:N] + held[:N]
        states = self._free @ here + self._pushed @ (push + lead)
        torque = lead - states[:N] @ model.K
        away, omega = states[:, 0] - goal, states[:, 1]
        end = model.P @ [away[N], omega[N]]
        gradient = along.e[:N].T @ away[:N] + model.Q[1, 1] * along.omega[:N].T @ omega[:N]
        gradient += model.R * along.tau.T @ (torque - held[:N]) + along.e[N] * end[0] + along.omega[N] * end[1]
        points = with_end(model, states[:, 0], omega, torque, float(goal[N]), float(held[N]))
        return points, self._whole.unit * np.append(2 * gradient, self._horizon.penalty)
