"""The nonlinear prediction as a program, by direct multiple shooting, and the numbers it is posed with.

minimise    the cost of ``problems.prediction``, e_k = theta_k - theta_f(F_k), and Omega, A L, P of the posture of F_0
over        v_0 .. v_{N-1}, x_1 .. x_N, sigma >= 0               tau_k = v_k - K (e_k, omega_k)
subject to  x_{k+1} = one Runge-Kutta step of (1)-(2) from x_k under tau_k, the force linear from F_k to F_{k+1}
            margin(x_k, tau_k, F_k) + sigma scale >= 0           for each limit, k < N
            margin(x, tau_h, F_N) + sigma scale >= 0             at x = x_N and x = (theta_f,N + xi_N, 0)
            |tau_k| <= tau_max,  |tau_k - tau_{k-1}| <= rate times the step (times the period for k = 0)
            |tau_h| and |tau_h - tau_{N-1}| likewise, to within sigma (M + m) g ell

tau in the cost and tau_h count from the torque tau_0 that holds the posture theta_f,k; the paper's foot needs none. And
with xi_N = e_N + omega_N/Omega and tau_h = -A L xi_N. Limits that are infinite give no row. v is what the torque
differs by from LQR's: the same program as one in tau, but its states do not run away from a wrong v, and eliminating
them leaves a Hessian that is nearly the identity (exactly, where the model is linear: completing the square). Unknowns
and rows are scaled to order one. One step of Runge-Kutta is enough: 20 ms at Omega = 7.2/s err by 5e-7 rad/s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design.analysis.observer import Belief
from design.model.plant import plant
from design.model.standing import standing
from design.solvers.sqp import Explicit
from problems.prediction import Horizon, Posture, posture, stationary

Array = NDArray[np.float64]

SIZE = 0.1
"""A typical e [rad]; omega's is SIZE Omega, the torque's SIZE M g L, sigma's SIZE."""
GRID = 0.002
"""Ratio between neighbouring values of A between which P and K are interpolated; M g is one of them."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Posed:
    """The ``program``, and the scales of ``torque`` [N m] and ``states`` (2) in it."""

    program: Explicit
    torque: float
    states: Array


def posed(horizon: Horizon) -> Posed:
    """The program in CasADi's symbols."""
    biped, tuning, actuator = horizon.biped, horizon.tuning, horizon.actuator
    N, body, foot = tuning.horizon, plant(horizon.biped), biped.weight * biped.ell
    states = np.array([SIZE, SIZE * math.sqrt(biped.M * biped.g * biped.L / biped.I)])
    torque = SIZE * biped.M * biped.g * biped.L

    head, theta_f, F = ca.SX.sym("head", 11), ca.SX.sym("theta_f", N + 1), ca.SX.sym("F", 2, N + 1)
    # the torque that holds each posture is a parameter only where there is one
    held = ca.SX.zeros(N + 1) if horizon.plain else ca.SX.sym("held", N + 1)
    x0, AL, Omega, P, K, before = head[:2], head[2], head[3], ca.reshape(head[4:8], 2, 2), head[8:10], head[10]
    v, s, X = ca.SX.sym("v", N), ca.SX.sym("s"), ca.SX.sym("X", 2, N)
    sigma = SIZE * s
    x = ca.horzcat(x0, X * states)
    away = ca.vertcat(x[0, :] - theta_f.T, x[1, :])
    pull = torque * v.T - K.T @ away[:, :N]
    tau = pull + held[:N].T

    dynamics = _runge_kutta(body.dynamics, tuning.step)
    following = [dynamics(x[:, k], tau[k], F[:, k], F[:, k + 1]) / states for k in range(N)]
    cost = ca.sumsqr(away[0, :N]) + tuning.rate * ca.sumsqr(away[1, :N] / Omega) + tuning.torque * ca.sumsqr(pull / AL)
    cost += ca.bilin(P, away[:, N]) + horizon.penalty * sigma

    xi = away[0, N] + away[1, N] / Omega
    hold = held[N] - AL * xi
    points = [(x[:, k], tau[k], F[:, k]) for k in range(N)]
    points += [(x[:, N], hold, F[:, N]), (ca.vertcat(theta_f[N] + xi, 0), hold, F[:, N])]
    rows = [s]
    for point in points:
        rows += [limit.margin(limit.quantity(*point), level) / limit.scale + sigma for limit, level in horizon.rows]
    torques = ca.horzcat(tau, hold)
    changes = torques - ca.horzcat(before, tau)
    soft = ca.horzcat(ca.SX.zeros(1, N), sigma)
    reach = np.full(N + 1, actuator.rate * tuning.step)
    reach[0] = actuator.rate * actuator.period
    for values, most in ((torques, np.full(N + 1, actuator.torque)), (changes, reach)):
        if np.isfinite(most).all():
            rows += [((ca.DM(most).T + sign * values) / foot + soft).T for sign in (1, -1)]

    level = posture(biped, tuning, biped.M * biped.g)
    unit = 0.5 / (level.R + level.Bd @ level.P @ level.Bd) / torque**2  # the Hessian in v is then near one
    numbers = [head, theta_f, ca.vec(F), *([] if horizon.plain else [held])]
    program = Explicit(
        v=ca.vertcat(v, s), X=ca.vec(X), p=ca.vertcat(*numbers), phi=ca.vertcat(*following),
        f=unit * cost, g=ca.vertcat(*rows), damp=np.append(np.zeros(N), 1e-4 * horizon.penalty * SIZE**2 * unit),
    )  # fmt: skip
    return Posed(program=program, torque=torque, states=states)


class Numbers:
    """The parameters of one call: theta_f and held (N+1), x (2), A L, Omega, K (2), and the vector ``p`` of all.

    ``model`` is a posture of nearly the same size.
    """

    def __init__(self, horizon: Horizon, belief: Belief, before: float) -> None:
        biped, N = horizon.biped, horizon.tuning.horizon
        F = np.tile([[belief.F_x], [belief.F_y]], N + 1) if belief.ahead is None else belief.ahead
        if horizon.plain:
            A, _ = stationary(biped, F[0, 0], F[1, 0])
            self.theta_f, self.held = np.arctan2(-F[0], biped.M * biped.g - F[1]), np.zeros(N + 1)
        else:
            each = standing(biped, F, horizon.target)
            if not (each.A > 0).all():
                message = "no posture has its CoP at the target"
                raise ArithmeticError(message)
            A, self.theta_f, self.held = float(each.A[0]), each.theta, each.tau
        self.x = np.array([belief.theta, belief.omega])
        self.AL, self.Omega = A * biped.L, math.sqrt(A * biped.L / biped.I)
        self.model, P, self.K = _weights(horizon, A)
        head = (*self.x, self.AL, self.Omega, *P.ravel(), *self.K, before)
        self.p = np.concatenate([head, self.theta_f, F.ravel(order="F"), *([] if horizon.plain else [self.held])])


def _weights(horizon: Horizon, A: float) -> tuple[Posture, Array, Array]:
    """A posture near, and P and K, of that of size ``A`` [N]; solving for them takes longer than the rest of a step."""
    weight = horizon.biped.M * horizon.biped.g
    place = math.log(A / weight) / GRID
    low = round(place) if abs(place - round(place)) < 1e-6 else math.floor(place)
    part = place - low
    first = posture(horizon.biped, horizon.tuning, weight * math.exp(GRID * low))
    if abs(part) < 1e-6:
        return first, first.P, first.K
    second = posture(horizon.biped, horizon.tuning, weight * math.exp(GRID * (low + 1)))
    return first, first.P + part * (second.P - first.P), first.K + part * (second.K - first.K)


def _runge_kutta(rate: ca.Function, h: float) -> Any:
    """(x, tau, F now, F then) -> x after ``h`` [s] of the classical fourth-order method, the force linear between."""

    def following(x: Any, tau: Any, now: Any, then: Any) -> Any:
        middle = (now + then) / 2
        k1 = rate(x, tau, now)
        k2 = rate(x + h / 2 * k1, tau, middle)
        k3 = rate(x + h / 2 * k2, tau, middle)
        k4 = rate(x + h * k3, tau, then)
        return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

    return following
