"""Distance from the physical limit: the largest sudden slope and push survived from rest, and what any ankle allows.

From rest at theta = 0 the ground tilts at once, or a push of J [N s] on the centre of gravity gives the rate J L/I. The
loop survives if toe and heel force stay >= 0 at every sample and the body does not fall. Both directions count; the
smaller is given. Survival is sought below the physical limit, as a zero of the smallest contact force, from a scan that
makes sure that all smaller disturbances are survived too.

Physical limits. *Slope*: from rest no ankle torque holds a body whose weight's line misses the foot: with the foot's
own weight, M L sin(alpha) <= ell (M cos(alpha) + m); tan(alpha) = ell/L where m is small. *Push*: capturability (Hof,
Gazendam and Sinke 2005; Koolen et al. 2012), |omega|/Omega <= ell (M + m) g/(A L) with Omega² = A L/I and A = M g;
of the linear model, true to some per cent.

Where foot or target are not the paper's, rest is the posture on level ground whose CoP is at the target, theta_0, with
the torque that holds it (law pd, and K_f = 0: theta = 0), and both limits are the smaller of the two directions. With
the CoP at the end of the foot, the toe say, the moments about the point under the ankle, of inertia I + M L h, leave
M L sin(theta_0 + alpha) + M h sin(alpha) <= l_T (M cos(alpha) + m) - c m for the slope, and for the push, about level
ground, Omega² = M g L/(I + M L h) and |omega|/Omega <= (l_T (M + m) g - c m g)/(M g L) - theta_0.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design.analysis.simulate import FALLEN
from design.model.body import Biped
from design.model.closed_loop import ClosedLoop
from design.model.environment import slope_force
from design.model.laws import Gains
from design.model.standing import met, standing

Array = NDArray[np.float64]

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


def slope_limit(biped: Biped, theta: float = 0.0) -> float:
    """The steepest sudden slope [rad], downhill to toe or heel, on which any ankle can keep contact from rest.

    ``theta`` [rad] is the posture before.
    """
    return min(_slope_limit(biped, theta), _slope_limit(mirrored(biped), -theta))


def _slope_limit(biped: Biped, theta: float) -> float:
    """The limit of slopes that go down on the toe side."""
    low, high = 0.0, 0.5 * math.pi
    for _ in range(80):
        middle = 0.5 * (low + high)
        falls = biped.M * biped.L * math.sin(theta + middle) + biped.M * biped.height * math.sin(middle)
        foot = math.cos(middle) if biped.ground_loads else 1.0
        held = falls <= biped.toe * (biped.M * math.cos(middle) + biped.m * foot) - biped.tilt / biped.g * foot
        low, high = (middle, high) if held else (low, middle)
    return low


def push_limit(biped: Biped, theta: float = 0.0) -> float:
    """The largest push [N s] at the centre of gravity, to and fro, after which any ankle can keep contact.

    ``theta`` [rad] is the posture before.
    """
    AL = biped.M * biped.g * biped.L
    if biped.plain and theta == 0.0:
        return math.sqrt(AL / biped.I) * biped.ell * biped.weight / AL * biped.I / biped.L
    Omega = math.sqrt(AL / (biped.I + biped.M * biped.L * biped.height))
    room = min(biped.toe * biped.weight - biped.tilt - AL * theta, biped.heel * biped.weight + biped.tilt + AL * theta)
    return Omega * max(room, 0.0) / AL * biped.I / biped.L


def mirrored(biped: Biped) -> Biped:
    """The biped with toe and heel in each other's place."""
    return replace(biped, skew=-biped.skew)


def at_rest(loop: ClosedLoop, gains: Gains) -> tuple[float, float, float]:
    """theta, s and theta_d with which ``loop`` stands on level ground; 0, 0 and the law's own for the paper's foot."""
    biped, law = loop.biped, loop.law
    if (biped.plain and law.target == 0.0) or law.kind == "pd" or gains.K_f == 0:
        return 0.0, 0.0, law.theta_d
    theta, tau = rest(loop)
    if not math.isfinite(theta):
        return 0.0, 0.0, law.theta_d
    theta_d = theta if math.isfinite(law.adapt) else law.theta_d
    return theta, (tau - gains.K_p * (theta_d - theta)) / (gains.K_f * pull(loop)), theta_d


def rest(loop: ClosedLoop) -> tuple[float, float]:
    """Posture [rad] and torque [N m] in which an integrating law stands on level ground."""
    found = standing(loop.biped, np.zeros((2, 1)), met(loop.biped, loop.law.target, loop.law.biped))
    return float(found.theta[0]), float(found.tau[0])


def pull(loop: ClosedLoop) -> float:
    """What K_f s is multiplied by in the torque."""
    return loop.law.biped.weight / loop.law.biped.ell if loop.law.kind == "cop" else 1.0


def step_slope(loop: ClosedLoop, gains: Gains, step: float) -> Survival:
    """The largest sudden slope [rad] survived from rest, in the worse direction."""
    to_force, (theta, s, theta_d) = slope_force(loop.biped), at_rest(loop, gains)

    def smallest_force(angle: float) -> float:
        F = to_force(np.array([[angle]]))[:, 0]
        return _smallest_force(loop, gains, step, loop.start(theta, 0.0, s, theta_d), F)

    return _largest(smallest_force, slope_limit(loop.biped, theta), both=lopsided(loop))


def push(loop: ClosedLoop, gains: Gains, step: float) -> Survival:
    """The largest push [N s] survived from rest on level ground, in the worse direction."""
    biped, (theta, s, theta_d) = loop.biped, at_rest(loop, gains)

    def smallest_force(impulse: float) -> float:
        pushed = loop.start(theta, impulse * biped.L / biped.I, s, theta_d)
        return _smallest_force(loop, gains, step, pushed, np.zeros(2))

    return _largest(smallest_force, push_limit(biped, theta), both=lopsided(loop))


def lopsided(loop: ClosedLoop) -> bool:
    """Whether the two directions are not alike."""
    return loop.law.theta_d != 0.0 or loop.law.target != 0.0 or not loop.biped.plain


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


def _smallest_force(loop: ClosedLoop, gains: Gains, step: float, z0: list[float], F: Array) -> float:
    """The smallest contact force [N] of the run from ``z0``, negative where the body falls."""
    lowest, farthest = _watched(loop, step)(ca.DM(z0), ca.DM(F), ca.DM(gains)).full().ravel()
    return float(lowest) if np.isfinite(lowest) and farthest < FALLEN else -loop.biped.weight


@lru_cache(maxsize=16)
def _watched(loop: ClosedLoop, step: float) -> ca.Function:
    """(z at t = 0, F, K) -> the smallest contact force, and the largest |theta|, under a constant force."""
    count = max(1, math.ceil(HORIZON / step))
    z0, F, K = ca.MX.sym("z0", loop.size), ca.MX.sym("F", 2), ca.MX.sym("K", 3)
    u = ca.vertcat(step, F, F, F)
    z = ca.horzcat(z0, loop.march(count)(z0, ca.repmat(u, 1, count), ca.repmat(K, 1, count)))
    y = loop.readout.map(count + 1)(z, ca.repmat(F, 1, count + 1), ca.repmat(K, 1, count + 1))
    lowest = ca.mmin(ca.vec(y[1:, :]))
    farthest = ca.mmax(ca.fabs(ca.vec(z[0, :])))
    return ca.Function("watched", [z0, F, K], [ca.vertcat(lowest, farthest)])
