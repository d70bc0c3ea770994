"""The body's dynamics and the ground reactions, (1)-(7) and (18), as CasADi functions of (x, tau, F).

x = (theta, omega), F = (F_x, F_y). The foot does not move as long as F_T, F_H > 0 and the friction is large
enough. The foot's weight enters (5) and (6) as m g / 2; (18) is read with its bracket,
P = (F_T - F_H) ell / (F_T + F_H).

A foot that is not symmetric, with levers l_T and l_H and its weight at c = (l_T - l_H)/2, and an ankle at height h,
on which the horizontal force f_x of the ground has an arm too: with N = F_T + F_H = m g + f_y and the moments about the
ankle

    l_T F_T - l_H F_H = -tau + c m g - h f_x,    P = (l_T F_T - l_H F_H)/N

F_T = (l_H N - tau + c m g - h f_x)/(l_T + l_H) and F_H = (l_T N + tau - c m g + h f_x)/(l_T + l_H). f_x is the
body's: what a slope does to the foot itself along the ground acts at the ground and has no arm. Where it counts what a
slope does to the foot's weight (``Biped.ground_loads``), m g - kappa F_y takes the place of m g. The formulas are
written such that for the paper's foot they are (5), (6) and (18) to the last digit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from design.model.body import Biped


@dataclass(frozen=True, eq=False, kw_only=True)
class Plant:
    """The biped's equations.

    ``dynamics``: (x (2), tau, F (2)) -> x' (2) [rad/s, rad/s²]. ``forces``: (x, tau, F) -> (F_T, F_H) [N].
    ``cop``: (x, tau, F) -> P [m]. ``friction``: (x, tau, F) -> horizontal force of the ground that holds the body [N].
    """

    biped: Biped
    dynamics: ca.Function
    forces: ca.Function
    cop: ca.Function
    friction: ca.Function


def plant(biped: Biped) -> Plant:
    """Build the equations of ``biped`` once."""
    x, tau, F = ca.SX.sym("x", 2), ca.SX.sym("tau"), ca.SX.sym("F", 2)
    numbers = body_numbers(biped)
    xdot, reaction, P, f_x = _equations(numbers, x, tau, F)
    arguments, names = [x, tau, F], ["x", "tau", "F"]
    return Plant(
        biped=biped,
        dynamics=ca.Function("dynamics", arguments, [xdot], names, ["xdot"]),
        forces=ca.Function("forces", arguments, [reaction], names, ["F_T_F_H"]),
        cop=ca.Function("cop", arguments, [P], names, ["P"]),
        friction=ca.Function("friction", arguments, [f_x], names, ["f_x"]),
    )


def body_numbers(biped: Biped) -> tuple[float, ...]:
    """(M, L, I, m, ell, g, skew, height, kappa): what ``held`` and ``reactions`` take for a body."""
    return biped.M, biped.L, biped.I, biped.m, biped.ell, biped.g, biped.skew, biped.height, biped.kappa


def held(count: int) -> ca.Function:
    """Any biped under a held torque: (x (2), tau, body (9), drive (7 count + 2)) -> after (5), contact (3, count).

    ``body`` is ``body_numbers``. The drive is ``count`` steps of (h, F at its start, middle and end), by the classical
    fourth-order Runge-Kutta method, and then the force that comes afterwards. After is x, F_T and F_H [N] under that
    force, and 1 where neither end of the foot was ever pulled, else 0. Contact on the way: the smaller of the values at
    both ends of each step of F_T, F_H [N], and the distance of P from the nearer end of the foot [m].
    """
    x, tau, body, drive = ca.SX.sym("x", 2), ca.SX.sym("tau"), ca.SX.sym("body", 9), ca.SX.sym("drive", 7 * count + 2)
    numbers = ca.vertsplit(body)
    toe, heel = body[4] * (1 + body[6]), body[4] * (1 - body[6])
    following, along, kept = x, [], ca.SX(1)
    for k in range(count):
        u = drive[7 * k : 7 * k + 7]
        h, start, middle, end = u[0], u[1:3], u[3:5], u[5:7]
        k1, first, P_first, _ = _equations(numbers, following, tau, start)
        k2, *_ = _equations(numbers, following + h / 2 * k1, tau, middle)
        k3, *_ = _equations(numbers, following + h / 2 * k2, tau, middle)
        k4, *_ = _equations(numbers, following + h * k3, tau, end)
        following = following + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        _, last, P_last, _ = _equations(numbers, following, tau, end)
        least = ca.fmin(first, last)
        inside = ca.fmin(toe - ca.fmax(P_first, P_last), heel + ca.fmin(P_first, P_last))
        along += [least, inside]
        kept *= (least[0] >= 0) * (least[1] >= 0)
    after = ca.vertcat(following, _equations(numbers, following, tau, drive[7 * count :])[1], kept)
    names = ["x", "tau", "body", "drive"], ["after", "contact"]
    return ca.Function("held", [x, tau, body, drive], [after, ca.vertcat(*along)], *names, {"cse": True})


def reactions() -> ca.Function:
    """Any biped's (x (2), tau, body (9), F (2)) -> (F_T, F_H) [N]; ``body`` as in ``held``."""
    x, tau, body, F = ca.SX.sym("x", 2), ca.SX.sym("tau"), ca.SX.sym("body", 9), ca.SX.sym("F", 2)
    reaction = _equations(ca.vertsplit(body), x, tau, F)[1]
    return ca.Function("reactions", [x, tau, body, F], [reaction], ["x", "tau", "body", "F"], ["forces"])


def _equations(numbers: Any, x: Any, tau: Any, F: Any) -> tuple[Any, Any, Any, Any]:
    """x', (F_T, F_H), P and the horizontal force on the foot, for a body of ``numbers`` (``body_numbers``)."""
    M, L, I, m, ell, g, skew, height, kappa = numbers
    theta, omega = ca.vertsplit(x)
    F_x, F_y = ca.vertsplit(F)
    acceleration = ((M * g - F_y) * L * ca.sin(theta) + F_x * L * ca.cos(theta) + tau) / I  # (2)
    f_y = -M * L * acceleration * ca.sin(theta) - M * L * omega**2 * ca.cos(theta) + M * g - F_y  # (7)
    f_x = M * L * (acceleration * ca.cos(theta) - omega**2 * ca.sin(theta)) - F_x  # Newton, forward, foot at rest
    field = kappa * F_y  # on the foot
    turn = tau - (ell * skew * m * g - ell * skew * field - height * f_x)  # l_H F_H - l_T F_T
    F_T = -turn / (2 * ell) + ((1 - skew) * m * g / 2 - (1 - skew) * field / 2) + (1 - skew) * f_y / 2  # (5)
    F_H = turn / (2 * ell) + ((1 + skew) * m * g / 2 - (1 + skew) * field / 2) + (1 + skew) * f_y / 2  # (6)
    P = ((1 + skew) * F_T - (1 - skew) * F_H) * ell / (F_T + F_H)  # (18)
    return ca.vertcat(omega, acceleration), ca.vertcat(F_T, F_H), P, f_x
