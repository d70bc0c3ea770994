"""The body's dynamics and the ground reactions, (1)-(7) and (18), as CasADi functions of (x, tau, F).

x = (theta, omega), F = (F_x, F_y). The foot does not move as long as F_T, F_H > 0 and the friction is large
enough. The foot's weight enters (5) and (6) as m g / 2; (18) is read with its bracket,
P = (F_T - F_H) ell / (F_T + F_H).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from design.model.body import Biped


@dataclass(frozen=True, eq=False, kw_only=True)
class Plant:
    """The biped's equations.

    ``dynamics``: (x (2), tau, F (2)) -> x' (2) [rad/s, rad/s²]. ``forces``: (x, tau, F) -> (F_T, F_H) [N].
    ``cop``: (x, tau, F) -> P [m]. ``friction``: (x, tau, F) -> horizontal force of the ground on the foot [N].
    """

    biped: Biped
    dynamics: ca.Function
    forces: ca.Function
    cop: ca.Function
    friction: ca.Function


def plant(biped: Biped) -> Plant:
    """Build the equations of ``biped`` once."""
    M, L, I, m, ell, g = biped.M, biped.L, biped.I, biped.m, biped.ell, biped.g
    x, tau, F = ca.SX.sym("x", 2), ca.SX.sym("tau"), ca.SX.sym("F", 2)
    theta, omega = ca.vertsplit(x)
    F_x, F_y = ca.vertsplit(F)

    acceleration = ((M * g - F_y) * L * ca.sin(theta) + F_x * L * ca.cos(theta) + tau) / I  # (2)
    f_y = -M * L * acceleration * ca.sin(theta) - M * L * omega**2 * ca.cos(theta) + M * g - F_y  # (7)
    F_T = -tau / (2 * ell) + m * g / 2 + f_y / 2  # (5)
    F_H = tau / (2 * ell) + m * g / 2 + f_y / 2  # (6)
    P = (F_T - F_H) * ell / (F_T + F_H)  # (18)
    f_x = M * L * (acceleration * ca.cos(theta) - omega**2 * ca.sin(theta)) - F_x  # Newton, forward, foot at rest

    arguments, names = [x, tau, F], ["x", "tau", "F"]
    return Plant(
        biped=biped,
        dynamics=ca.Function("dynamics", arguments, [ca.vertcat(omega, acceleration)], names, ["xdot"]),
        forces=ca.Function("forces", arguments, [ca.vertcat(F_T, F_H)], names, ["F_T_F_H"]),
        cop=ca.Function("cop", arguments, [P], names, ["P"]),
        friction=ca.Function("friction", arguments, [f_x], names, ["f_x"]),
    )
