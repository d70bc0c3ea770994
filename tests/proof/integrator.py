"""An integrator written anew from the paper's equations, for holding what is proved against.

It takes numbers, not the package's records: scipy's DOP853 (order 8) at a relative tolerance of 1e-11, one run for each
piece on which the force is linear, read densely. Degrees, newtons and metres, as a spec has them.
"""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp


@dataclass(frozen=True, kw_only=True)
class World:
    """A body in a scenario: ``kind`` slope or profile; ``points`` (t, F_x, F_y); g = 9.81 m/s²."""

    M: float
    L: float
    I: float
    m: float
    ell: float
    kind: str = "slope"
    angle_deg: float = 0.0
    ramp_s: float = 0.0
    points: tuple = ()
    theta0_deg: float = 0.0
    omega0_deg: float = 0.0


def run(world, gains, duration, *, per_piece=400):
    """(t, toe, heel, tau, cop_margin) at dense samples, each piece with both of its ends; law (8)."""
    g, (K_p, K_d, K_f) = 9.81, gains
    M, L, I, m, ell = world.M, world.L, world.I, world.m, world.ell

    def force(t, piece):
        if world.kind == "slope":
            share = 1.0 if world.ramp_s == 0 else min(max(t / world.ramp_s, 0.0), 1.0)
            alpha = math.radians(world.angle_deg) * share
            return M * g * math.sin(alpha), M * g * (1.0 - math.cos(alpha))  # (21)
        middle = 0.5 * (piece[0] + piece[1])
        before = max((p for p in world.points if p[0] <= middle), key=lambda p: p[0], default=world.points[0])
        after = min((p for p in world.points if p[0] > middle), key=lambda p: p[0], default=None)
        if after is None or before[0] > middle:
            return before[1], before[2]
        before = [p for p in world.points if p[0] == before[0]][-1]
        share = (t - before[0]) / (after[0] - before[0])
        return before[1] + share * (after[1] - before[1]), before[2] + share * (after[2] - before[2])

    def reactions(t, z, piece):
        F_x, F_y = force(t, piece)
        theta, omega, s = z
        tau = -K_p * theta - K_d * omega + K_f * s  # (8)
        acceleration = ((M * g - F_y) * L * np.sin(theta) + F_x * L * np.cos(theta) + tau) / I  # (1)
        f_y = M * (g - L * (acceleration * np.sin(theta) + omega**2 * np.cos(theta))) - F_y  # (7)
        return tau, acceleration, f_y

    corners = [world.ramp_s] if world.kind == "slope" else [point[0] for point in world.points]
    edges = sorted({0.0, duration, *(t for t in corners if 0 < t < duration)})
    z = np.array([math.radians(world.theta0_deg), math.radians(world.omega0_deg), 0.0])
    columns = []
    for piece in pairwise(edges):

        def rate(t, z, piece=piece):
            tau, acceleration, _ = reactions(t, z, piece)
            return [z[1], acceleration, tau / ell]  # (11)

        t = np.linspace(*piece, per_piece)
        ran = solve_ivp(rate, piece, z, method="DOP853", rtol=1e-11, atol=1e-13, t_eval=t, max_step=0.02)
        assert ran.success
        z = ran.y[:, -1]
        for k, instant in enumerate(t):
            tau, _, f_y = reactions(instant, ran.y[:, k], piece)
            heel = 0.5 * (f_y + m * g + tau / ell)  # (5)
            toe = 0.5 * (f_y + m * g - tau / ell)  # (6)
            columns.append((instant, toe, heel, tau, ell - abs(toe - heel) * ell / (toe + heel)))  # (18)
    return np.array(columns).T


def worst(world, gains, duration):
    """The least toe and heel force [N] and CoP margin [m], and the largest torque [N m], by row id."""
    _, toe, heel, tau, cop = run(world, gains, duration)
    return {"toe-force": toe.min(), "heel-force": heel.min(), "cop-margin": cop.min(), "torque": np.abs(tau).max()}
