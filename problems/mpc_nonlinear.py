"""Nonlinear MPC: the prediction of ``problems.prediction`` with the full model, posed in ``problems.shooting``.

A plan counts as solved only where its residuals, evaluated anew, agree; where those of ``Sqp`` do not, IPOPT has a
second try, which the detail names. It starts from the previous plan, shifted, with the torque that holds appended; or
from the LQR response of the linear model.

In real time (``tuning.real_time``) each plan is one iteration from the shifted previous one. It is not optimal, so what
counts is that it misses no row and no state by more than ``BROKEN``, else iterations go on as without it; stationarity
is not asked for.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design.analysis.observer import Belief
from design.solvers.nlp import Ipopt, Nlp
from design.solvers.outcome import Outcome, Status
from design.solvers.sqp import Measure, Sqp
from problems.prediction import Horizon
from problems.receding import Plan
from problems.shooting import SIZE, Numbers, Posed, posed

Array = NDArray[np.float64]

BROKEN = 1e-2
"""How far a plan of a single iteration may miss a row or a state, in their scales."""
ROUGH = 1e-4
"""The residuals up to which an answer of IPOPT's is taken; the Hessian is near one, so a torque is off by 4e-3 N m."""
LONGEST = 100
"""Steps up to which states are eliminated, which takes room and time with their square; more steps are IPOPT's."""


@dataclass(frozen=True, eq=False, kw_only=True)
class NonlinearPlanner:
    """Plans with ``fast``, and where its answer fails the ``measure`` or it is None, with ``slow``."""

    horizon: Horizon
    posed: Posed
    measure: Measure
    fast: Sqp | None
    slow: Ipopt

    def plan(self, t: float, belief: Belief, before: float, previous: Plan | None) -> Outcome[Plan]:
        """See ``problems.receding.Planner``; numbers that are not finite are not planned for."""
        N = self.horizon.tuning.horizon
        if belief.ahead is not None and belief.ahead.shape != (2, N + 1):
            message = f"ahead has shape {belief.ahead.shape}; needs {(2, N + 1)}"
            raise ValueError(message)
        try:
            numbers = Numbers(self.horizon, belief, before)
        except (ArithmeticError, ValueError) as error:  # a force that cancels gravity among them
            return Outcome(status=Status.STALLED, detail=f"no stationary posture: {error}")
        if not np.isfinite(numbers.p).all():
            return Outcome(status=Status.STALLED, detail="the belief or the torque until now is not finite")
        v, X = self._start(t, numbers, previous)
        detail = ""
        if self.fast is not None:
            if self.horizon.tuning.real_time:
                answer = self.fast.solve(v, X, numbers.p, once=True)
                if max(answer.residuals.defect, answer.residuals.violation) <= BROKEN:
                    return self._outcome(t, numbers, answer.v, answer.X, "SQP: one iteration")
            answer = self.fast.solve(v, X, numbers.p)
            detail = f"SQP: {answer.said} in {answer.iterations}"
            if answer.solved:
                return self._outcome(t, numbers, answer.v, answer.X, detail)
            if SIZE * answer.v[-1] > 1:
                return Outcome(status=Status.STALLED, detail=f"{detail}; limits are broken by more than their scale")
        return self._second_try(t, numbers, v, X, detail)

    def _second_try(self, t: float, numbers: Numbers, v: Array, X: Array, detail: str) -> Outcome[Plan]:
        """The answer of IPOPT, which counts as solved only if the measure agrees."""
        answer = self.slow.solve(np.concatenate([v, X]), p=numbers.p)
        v, X = answer.x[: len(v)], answer.x[len(v) :]
        residuals = self.measure(v, X, np.maximum(-answer.multiplier[len(X) :], 0.0), numbers.p)
        detail = f"{detail}; IPOPT: {answer.said}".lstrip("; ")
        if max(residuals) <= ROUGH:
            return self._outcome(t, numbers, v, X, detail)
        status = Status.DISAGREEMENT if answer.solved else Status.STALLED
        return Outcome(status=status, detail=f"{detail}, residuals up to {max(residuals):.1e}")

    def _start(self, t: float, numbers: Numbers, previous: Plan | None) -> tuple[Array, Array]:
        """The start (v, s) (N+1) and X (2N): the previous plan from ``t`` on, held at its end, or LQR's response."""
        tuning, theta_f, Omega = self.horizon.tuning, numbers.theta_f, numbers.Omega
        N, h = tuning.horizon, tuning.step
        v = np.zeros(N + 1)
        if previous is None or not 0 <= t - previous.start <= previous.step * len(previous.torque):
            away, closed = np.empty((2, N + 1)), numbers.model.Ad - np.outer(numbers.model.Bd, numbers.model.K)
            away[:, 0] = numbers.x - [theta_f[0], 0.0]
            for k in range(N):
                away[:, k + 1] = closed @ away[:, k]
        else:
            times = t + h * np.arange(N + 1)
            own = previous.start + previous.step * np.arange(len(previous.torque) + 1)
            theta, omega = (np.interp(times, own, state) for state in previous.states)
            xi = previous.states[0, -1] - theta_f[N] + previous.states[1, -1] / Omega
            after = np.maximum(times - own[-1], 0.0)
            tail, decay = after > 0, previous.states[1, -1] * np.exp(-Omega * after)
            away = np.stack([np.where(tail, xi - decay / Omega, theta - theta_f), np.where(tail, decay, omega)])
            torque = np.interp(times[:N], own[:-1], previous.torque)
            torque[times[:N] > own[-1] - 1e-9] = numbers.held[N] - numbers.AL * xi
            away[:, 0] = numbers.x - [theta_f[0], 0.0]
            v[:N] = (torque - numbers.held[:N] + numbers.K @ away[:, :N]) / self.posed.torque
        away[0] += theta_f
        return v, (away[:, 1:].T / self.posed.states).ravel()

    def _outcome(self, t: float, numbers: Numbers, v: Array, X: Array, detail: str) -> Outcome[Plan]:
        """The plan in physical units."""
        states = np.column_stack([numbers.x, (X.reshape(-1, 2) * self.posed.states).T])
        away = states - np.stack([numbers.theta_f, np.zeros_like(numbers.theta_f)])
        torque = self.posed.torque * v[:-1] - numbers.K @ away[:, :-1] + numbers.held[:-1]
        if not np.isfinite(torque).all():
            return Outcome(status=Status.DISAGREEMENT, detail=f"{detail}, but a torque is not finite")
        if SIZE * v[-1] > 1e-6:
            detail = f"{detail}; limits broken by up to {SIZE * v[-1]:.2g} of their scale"
        plan = Plan(start=t, step=self.horizon.tuning.step, torque=torque, states=states)
        return Outcome(status=Status.SOLVED, detail=detail, found=plan)


@lru_cache(maxsize=16)
def planner(horizon: Horizon) -> NonlinearPlanner:
    """The planner for ``horizon``, with everything built."""
    made = posed(horizon)
    program = made.program
    fast = Sqp(program) if horizon.tuning.horizon <= LONGEST else None
    m, r, n = program.X.numel(), program.g.numel(), program.v.numel()
    free = np.full(n + m, np.inf)
    whole = Nlp(
        x=ca.vertcat(program.v, program.X), f=program.f, g=ca.vertcat(program.phi - program.X, program.g), p=program.p,
        x_lower=-free, x_upper=free, lower=np.zeros(m + r), upper=np.append(np.zeros(m), np.full(r, np.inf)),
    )  # fmt: skip
    slow = Ipopt(whole, seconds=1.0, iterations=100)
    slow.build()
    measure = fast.measure if fast is not None else Measure(program)
    return NonlinearPlanner(horizon=horizon, posed=made, measure=measure, fast=fast, slow=slow)
