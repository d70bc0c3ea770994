"""The limits of a linear prediction: affine about the stationary posture, in the first step about the state itself.

A ``Limit`` is linearised with its own CasADi function; f_y depends on the torque through theta'' (7), and so do F_T and
F_H beyond their -+tau/(2 ell). In the first step they are affine in the torque as they stand, and exact. Rows of the
first step are scaled so that their slopes in tau are those of the others, for they have no other unknown: the matrix
then stays the same as long as the force believed does. Where the slopes have little to do with each other (a limit that
the torque hardly moves) the row is left as it is. Torques of points count from tau_0, which holds the posture: of a
foot that is not the paper's, and 0 of the paper's, where the expressions do not ask for it.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from problems.flat import Pattern
from problems.prediction import Horizon

Array = NDArray[np.float64]


class Rows:
    """The limits at this moment, over points (.., 3) of e, omega and tau.

    ``slopes`` (each, 3) and ``levels``, (each,) or (N+2, each): their slopes, and margins at rest. ``first`` (each, 4):
    slopes and constant in the first step. ``before`` [N m]: the torque until now, which like all torques counts from
    ``hold`` [N m].
    """

    def __init__(
        self, pattern: Pattern, slopes: Array, levels: Array, first: Array, before: float, hold: float
    ) -> None:
        self._pattern, self.slopes, self._levels, self.before, self.hold = pattern, slopes, levels, before, hold
        self._first, self._first_level = first[:, :3], first[:, 3]

    def margins(self, points: Array) -> Array:
        """Each limit's (N+2, each) at ``points`` (N+2, 3)."""
        found: Array = points @ self.slopes.T
        found += self._levels
        found[0] = self._first @ points[0] + self._first_level
        return found

    def room(self, points: Array, margins: Array) -> Array:
        """How far each row is from its bound."""
        return self._pattern.room(points, margins, self.before, self.hold)

    def broken(self, points: Array, sigma: float) -> float:
        """By how much the worst row is broken, given ``sigma``."""
        return -float((self.room(points, self.margins(points)) + self._pattern.give * sigma).min())


@lru_cache(maxsize=8)
def linearised(horizon: Horizon, count: int) -> ca.Function:
    """(now (7), response (3 count, 2)) -> slopes (3, each), levels (each), first (4, each), points (3, count), kept.

    ``now`` is theta_f, theta, omega, tau, F_x, F_y, tau_0. Slopes, levels and first are what ``Rows`` takes, transposed
    and by the limits' scales. Points are the response to (e, omega), and ``kept`` is 1 if every limit's margin there is
    a number and not negative, else 0.
    """
    x, tau, F = ca.SX.sym("x", 2), ca.SX.sym("tau"), ca.SX.sym("F", 2)
    table = _table(horizon, x, tau, F)
    now, response = ca.SX.sym("now", 7), ca.SX.sym("response", 3 * count, 2)
    hold = 0 if horizon.plain else now[6]
    there, here = (
        ca.substitute(table, ca.vertcat(x, tau, F), ca.vertcat(*at, now[4], now[5]))
        for at in ((now[0], 0, hold), (now[1], now[2], now[3]))
    )
    e, omega = now[1] - now[0], now[2]
    slopes, levels = there[:, 1:], there[:, 0]
    factor = there[:, 3] / here[:, 3]
    steep = ca.if_else(ca.logic_and(factor > 0.5, factor < 2.0), factor, 1.0)
    level = here[:, 0] - ca.mtimes(here[:, 1:], ca.vertcat(e, omega, now[3] - hold))
    first = ca.horzcat(here[:, 1:], level) * ca.repmat(steep, 1, 4)
    points = ca.reshape(ca.mtimes(response, ca.vertcat(e, omega)), 3, count)
    later = ca.mtimes(slopes, points[:, 1:]) + ca.repmat(levels, 1, count - 1)
    kept = ca.SX(1)
    for margin in ca.vertsplit(ca.vertcat(ca.mtimes(first, ca.vertcat(points[:, 0], 1)), ca.vec(later))):
        kept *= margin >= 0
    made = [ca.densify(each) for each in (slopes.T, levels, first.T, points, kept)]
    names = ["slopes", "levels", "first", "points", "kept"]
    return ca.Function("linearised", [now, response], made, ["now", "response"], names, {"cse": True})


@lru_cache(maxsize=8)
def at_rest(horizon: Horizon, count: int) -> ca.Function:
    """``theta`` and ``tau`` at rest and ``F`` (2, count) -> ``margins`` (each, count) by the limits' scales."""
    x, tau, F = ca.SX.sym("x", 2), ca.SX.sym("tau"), ca.SX.sym("F", 2)
    level = ca.Function("level", [x, tau, F], [_table(horizon, x, tau, F)[:, 0]], {"cse": True})
    theta, hold, along = ca.MX.sym("theta"), ca.MX.sym("tau"), ca.MX.sym("F", 2, count)
    margins = level.map(count)(ca.repmat(ca.vertcat(theta, 0), 1, count), ca.repmat(hold, 1, count), along)
    return ca.Function("at_rest", [theta, hold, along], [ca.densify(margins)], ["theta", "tau", "F"], ["margins"])


def _table(horizon: Horizon, x: ca.SX, tau: ca.SX, F: ca.SX) -> ca.SX:
    """Each limit component's margin, and its slopes in theta, omega and tau (each, 4), by its scale."""
    margins = ca.vertcat(
        *[limit.margin(limit.quantity(x, tau, F), level) / limit.scale for limit, level in horizon.rows]
    )
    return ca.horzcat(margins, ca.densify(ca.jacobian(margins, ca.vertcat(x, tau))))
