"""A second opinion on a design, from code that shares nothing with the optimiser's graph.

The equations are written out again in plain numbers, from Newton's and Euler's laws rather than from (2) and (7); the
integrator is an adaptive one of order 8 (DOP853) in place of the fixed Runge-Kutta step; and the poles are eigenvalues
of (23). If this disagrees with a solver, this wins.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.model.body import Biped
from design.model.environment import Scenario
from design.model.laws import Gains, LawKind

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class SecondOpinion:
    """Toe and heel force and torque (n,) at sample times ``t`` (n,) [N, N m, s].

    ``finished`` is False if the integrator failed, crawled, or the state blew up: the samples from that piece of the
    scenario on are NaN.
    """

    t: Array
    theta: Array
    tau: Array
    F_T: Array
    F_H: Array
    finished: bool


LONGEST = 0.05
"""Longest step [s]: what the integrator reads between its steps is of a lower order than they are."""
EVALUATIONS = 300_000
"""Evaluations of the right-hand side after which the integrator counts as crawling, as it does where load vanishes."""


class _TooManySteps(Exception):
    """The evaluations are used up."""


def load_integrator() -> Any:
    """SciPy's ``solve_ivp``; its import takes long enough to be worth beginning early."""
    from scipy.integrate import solve_ivp

    return solve_ivp


def second_opinion(
    biped: Biped,
    kind: LawKind,
    theta_d: float,
    gains: Gains,
    scenario: Scenario,
    step: float,
    adapt: float = math.inf,
    target: float = 0.0,
    s0: float = 0.0,
    known: Biped | None = None,
) -> SecondOpinion:
    """Run the loop again, to a relative tolerance of 1e-10, and read it at the samples of ``step`` [s].

    The states are theta, omega, s, and theta_d itself, which follows the estimate within ``adapt`` [s]. ``target``: P_d
    [m]; ``s0``: s at t = 0; ``known``: the body that the law reckons with, where it is another than ``biped``; both
    then with the paper's foot.
    """
    believed = known or biped
    solve_ivp = load_integrator()
    samples = scenario.steps(step)
    z = np.full((4, len(samples.t)), np.nan)
    state = np.array([scenario.theta0, scenario.omega0, s0, theta_d])
    finished = True
    budget = EVALUATIONS
    for start, end in scenario.pieces():
        ends = scenario.signal_on((start, end), np.array([start, end]))
        first, growth = ends[:, :1], (ends[:, 1:] - ends[:, :1]) / (end - start)

        def slope_of(
            t: float, z: Array, start: float = start, first: Array = first, growth: Array = growth
        ) -> list[float]:
            nonlocal budget
            budget -= 1
            if budget < 0:
                raise _TooManySteps
            F_x, F_y = scenario.to_force(first + (t - start) * growth)[:, 0]
            return _rate(biped, believed, kind, adapt, target, gains, z, float(F_x), float(F_y))

        inside = np.flatnonzero((samples.t >= start) & (samples.t <= end))
        times = np.unique(samples.t[inside])
        try:
            run = solve_ivp(
                slope_of,
                (start, end),
                state,
                method="DOP853",
                rtol=1e-10,
                atol=1e-12,
                t_eval=times,
                events=_blow_up,
                max_step=LONGEST,
            )
        except _TooManySteps:
            finished = False
            break
        if not run.success or run.status == 1:
            finished = False
            break
        z[:, inside] = run.y[:, np.searchsorted(run.t, samples.t[inside])]
        state = run.y[:, -1]
    tau, F_T, F_H = _reactions(biped, believed, kind, gains, z, samples.force)
    return SecondOpinion(t=samples.t, theta=z[0], tau=tau, F_T=F_T, F_H=F_H, finished=finished)


def _blow_up(t: float, z: Array) -> float:
    return 10.0 - abs(float(z[0]))


_blow_up.terminal = True  # type: ignore[attr-defined]


def _factor(believed: Biped, kind: LawKind, gains: Gains) -> float:
    """Of the integral in the torque."""
    weight = (believed.M + believed.m) * believed.g
    return {"pd": 0.0, "force": gains.K_f, "cop": gains.K_f * weight / believed.ell}[kind]


def _reactions(
    biped: Biped, believed: Biped, kind: LawKind, gains: Gains, z: Array, force: Array
) -> tuple[Array, Array, Array]:
    """Torque, toe and heel force: the centre of gravity's vertical motion, then the foot's moment balance."""
    theta, omega = z[0], z[1]
    tau = np.asarray(gains.K_p * (z[3] - theta) - gains.K_d * omega + _factor(believed, kind, gains) * z[2])
    turning = _turning(biped, np.sin(theta), np.cos(theta), tau, force[0], force[1])
    rising = -biped.L * (turning * np.sin(theta) + omega**2 * np.cos(theta))  # second derivative of L cos(theta)
    pressing = biped.M * (rising + biped.g) - force[1]  # of the body on the foot
    weight = _foot_weight(biped, force[1])
    total = pressing + weight
    if biped.plain:
        return tau, 0.5 * (total - tau / biped.ell), 0.5 * (total + tau / biped.ell)
    sliding = biped.L * (turning * np.cos(theta) - omega**2 * np.sin(theta))  # second derivative of L sin(theta)
    about_heel = _about_ankle(biped, tau, biped.M * sliding - force[0], weight) + biped.heel * total
    F_T = about_heel / (biped.toe + biped.heel)
    return tau, F_T, total - F_T


def _foot_weight(biped: Biped, F_y: Any) -> Any:
    """What the foot weighs [N]: under gravity, or in the field that gives the body the force ``F_y`` besides."""
    return biped.m * (biped.g - F_y / biped.M) if biped.ground_loads else biped.m * biped.g


def _about_ankle(biped: Biped, tau: Any, shear: Any, weight: Any) -> Any:
    """l_T F_T - l_H F_H [N m], from the foot's balance of moments.

    ``shear``: what the ground holds the body with, horizontally [N]; ``weight`` of the foot [N].
    """
    middle = 0.5 * (biped.toe - biped.heel)
    return -tau + middle * weight - biped.height * shear


def _turning(biped: Biped, sine: Array, cosine: Array, tau: Array, F_x: Array, F_y: Array) -> Array:
    """Angular acceleration: the moments about the ankle of weight, external force and torque."""
    lever_x, lever_y = biped.L * sine, biped.L * cosine
    return np.asarray(((biped.M * biped.g - F_y) * lever_x + F_x * lever_y + tau) / biped.I)


def _rate(
    biped: Biped,
    believed: Biped,
    kind: LawKind,
    adapt: float,
    target: float,
    gains: Gains,
    z: Array,
    F_x: float,
    F_y: float,
) -> list[float]:
    theta, omega, s, theta_d = (float(part) for part in z)
    ell, L = biped.ell, biped.L
    tau = gains.K_p * (theta_d - theta) - gains.K_d * omega + _factor(believed, kind, gains) * s
    sine, cosine = math.sin(theta), math.cos(theta)
    turning = ((biped.M * biped.g - F_y) * L * sine + F_x * L * cosine + tau) / biped.I
    if kind != "pd" and not (biped.plain and target == 0.0):
        weight = _foot_weight(biped, F_y)
        total = biped.M * (biped.g - L * (turning * sine + omega**2 * cosine)) - F_y + weight
        shear = biped.M * L * (turning * cosine - omega**2 * sine) - F_x
        short = target * total - _about_ankle(biped, tau, shear, weight)  # the load times how far the CoP is behind P_d
        gathering = (short / total if total else math.inf) if kind == "cop" else short / ell
        # the moments about the point under the ankle say where the body would rest with the CoP at P_d
        ground = biped.I + biped.M * L * biped.height
        leaning = theta + (short - ground * turning) / (biped.M * biped.g * L)
        return [omega, turning, gathering, (leaning - theta_d) / adapt]
    if kind == "cop":
        total = biped.M * (biped.g - L * (turning * sine + omega**2 * cosine)) - F_y + _foot_weight(biped, F_y)
        gathering = tau * (believed.ell / ell) / total if total else math.inf
    else:
        gathering = 0.0 if kind == "pd" else tau / ell
    # where the moments, the ankle's by the contact forces, say that the body which it believes in would rest
    moment = believed.I * turning - believed.ell / ell * tau
    leaning = theta - moment / (believed.M * believed.g * believed.L)
    return [omega, turning, gathering, (leaning - theta_d) / adapt]
