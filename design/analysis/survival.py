"""Distance from the physical limit: the largest sudden slope and push survived from rest, and what any ankle allows.

From rest at theta = 0 the ground tilts at once, or a push of J [N s] on the centre of gravity gives the rate J L/I. The
loop survives if toe and heel force stay >= 0 at every sample and the body does not fall. Both directions count; the
smaller is given. Survival is sought below the physical limit, as a zero of the smallest contact force, from a scan that
makes sure that all smaller disturbances are survived too.

Physical limits. *Slope*: from rest no ankle torque holds a body whose weight's line misses the foot: with the foot's
own weight, M L sin(alpha) <= ell (M cos(alpha) + m); tan(alpha) = ell/L where m is small. *Push*: capturability (Hof,
Gazendam and Sinke 2005; Koolen et al. 2012), |omega|/Omega <= ell (M + m) g/(A L) with Omega² = A L/I and A = M g;
of the linear model, true to some per cent.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from design.analysis.simulate import FALLEN
from design.model.body import Biped
from design.model.closed_loop import ClosedLoop
from design.model.environment import slope_force
from design.model.laws import Gains

HORIZON = 10.0
"""How long survival is watched [s]."""
SCAN = 8


@dataclass(frozen=True, kw_only=True)
class Survival:
    """The largest disturbance survived, and the physical ``limit``, in rad (slope) or N s (push)."""

    survived: float
    limit: float

    @property
    def share(self) -> float:
        """``survived`` as a part of ``limit``."""
        return self.survived / self.limit


def slope_limit(biped: Biped) -> float:
    """The steepest sudden slope [rad] on which any ankle controller can keep contact from rest."""
    low, high = 0.0, 0.5 * math.pi
    for _ in range(80):
        middle = 0.5 * (low + high)
        held = biped.M * biped.L * math.sin(middle) <= biped.ell * (biped.M * math.cos(middle) + biped.m)
        low, high = (middle, high) if held else (low, middle)
    return low


def push_limit(biped: Biped) -> float:
    """The largest push [N s] at the centre of gravity after which any ankle controller can keep contact."""
    AL = biped.M * biped.g * biped.L
    return math.sqrt(AL / biped.I) * biped.ell * biped.weight / AL * biped.I / biped.L


def step_slope(loop: ClosedLoop, gains: Gains, step: float) -> Survival:
    """The largest sudden slope [rad] survived from rest, in the worse direction."""
    to_force = slope_force(loop.biped)

    def smallest_force(angle: float) -> float:
        F = to_force(np.array([[angle]]))[:, 0]
        return _smallest_force(loop, gains, step, 0.0, F)

    return _largest(smallest_force, slope_limit(loop.biped), both=loop.law.theta_d != 0.0)


def push(loop: ClosedLoop, gains: Gains, step: float) -> Survival:
    """The largest push [N s] survived from rest on level ground, in the worse direction."""
    biped = loop.biped

    def smallest_force(impulse: float) -> float:
        return _smallest_force(loop, gains, step, impulse * biped.L / biped.I, np.zeros(2))

    return _largest(smallest_force, push_limit(biped), both=loop.law.theta_d != 0.0)


def _largest(smallest_force: Callable[[float], float], limit: float, *, both: bool) -> Survival:
    """The end of the interval from 0 on which all are survived; ``both`` directions where they are not alike."""

    def force(size: float) -> float:
        ahead = smallest_force(size)
        return min(ahead, smallest_force(-size)) if both else ahead

    low, at_low = 1e-6 * limit, force(1e-6 * limit)
    if at_low < 0:
        return Survival(survived=0.0, limit=limit)
    high = at_high = None
    for k in range(1, SCAN + 1):
        size = limit * k / SCAN
        found = force(size)
        if found < 0:
            high, at_high = size, found
            break
        low, at_low = size, found
    if high is None or at_high is None:
        return Survival(survived=limit, limit=limit)
    return Survival(survived=_crossing(force, (low, at_low), (high, at_high), 1e-4 * limit), limit=limit)


def _crossing(
    force: Callable[[float], float], kept: tuple[float, float], lost: tuple[float, float], width: float
) -> float:
    """A size with force >= 0, at most ``width`` below one without; regula falsi in Illinois' form."""
    (low, at_low), (high, at_high) = kept, lost
    side = 0
    while high - low > width:
        secant = low + (high - low) * at_low / (at_low - at_high)
        # a step inside: from a secant that is nearly there, the next one closes the bracket from the other side
        middle = min(max(secant, low + 0.4 * width), high - 0.4 * width)
        found = force(middle)
        if found >= 0:
            low, at_low, at_high = middle, found, at_high / (2 if side > 0 else 1)
            side = 1
        else:
            high, at_high, at_low = middle, found, at_low / (2 if side < 0 else 1)
            side = -1
    return low


def _smallest_force(loop: ClosedLoop, gains: Gains, step: float, omega0: float, F: np.ndarray) -> float:
    """The smallest contact force [N] of the run, negative where the body falls."""
    lowest, farthest = _watched(loop, step)(omega0, ca.DM(F), ca.DM(gains)).full().ravel()
    return float(lowest) if np.isfinite(lowest) and farthest < FALLEN else -loop.biped.weight


@lru_cache(maxsize=16)
def _watched(loop: ClosedLoop, step: float) -> ca.Function:
    """(omega0, F, K) -> the smallest contact force, and the largest |theta|, under a constant force."""
    count = max(1, math.ceil(HORIZON / step))
    omega0, F, K = ca.MX.sym("omega0"), ca.MX.sym("F", 2), ca.MX.sym("K", 3)
    z0 = ca.vertcat(*loop.start(0.0, omega0))
    u = ca.vertcat(step, F, F, F)
    z = ca.horzcat(z0, loop.march(count)(z0, ca.repmat(u, 1, count), ca.repmat(K, 1, count)))
    y = loop.readout.map(count + 1)(z, ca.repmat(F, 1, count + 1), ca.repmat(K, 1, count + 1))
    lowest = ca.mmin(ca.vec(y[1:, :]))
    farthest = ca.mmax(ca.fabs(ca.vec(z[0, :])))
    return ca.Function("watched", [omega0, F, K], [ca.vertcat(lowest, farthest)])
