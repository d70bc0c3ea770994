"""The loop about its stationary posture as vertices of a differential inclusion, in ranges of rationals.

With e = theta - theta_f, tau = -K_p e - K_d omega + w, and w [N m] the law's integral K_f s from its stationary value,

    e' = omega,    I omega' = A L sin e + tau,    w' = (K_f/ell) tau                                       (8), (11)

(A L sin e: weight and force together, (3)-(4)). Foot and ground ask, for both signs,

    +-tau/r + M L (theta'' sin theta + omega² cos theta) <= room                                           (5)-(7)

with r = ell and room = (M + m) g - F_y - 2 level for F_T, F_H >= level; r = ell - c and room = (M + m) g - F_y for the
centre of pressure c within the foot.

*Sector of the sine.* sin is concave on [0, pi] and 0 at 0, so that it lies above its chords from 0: sin(e)/e falls from
1 to sin(e_max)/e_max on (0, e_max], and is even. Hence for |e| <= e_max <= pi

    sin e = sigma e,    sin(e_max)/e_max <= sigma <= 1,    and    cos(e_max) <= cos e <= 1.

*Vertices.* x' = A(sigma) x is affine in sigma: a Lyapunov inequality at both ends of sigma holds between them. The left
side of the second inequality is, with sin theta = sin theta_f cos e + cos theta_f sin e and rho = cos e,

    h x + xᵀ S x = +-tau/r + (M L/I)(A L sigma e + tau)(sin theta_f rho + cos theta_f sigma e) + M L omega² cos theta

For each x it is affine in rho, and convex in sigma (its square has the factor A L cos theta_f e² >= 0): it is largest
at a corner of their ranges. cos theta is at most 1, and at most cos theta_f + |sin theta_f| e_max.

*Numbers* hold both the float and the decimal that it prints as; a root, a sine, or a cosine is enclosed by rationals.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from fractions import Fraction
from itertools import product
from typing import cast

import numpy as np

from design.model.environment import Scenario
from design.model.laws import Gains
from design.proof.box import levels
from design.proof.case import goes_on
from design.proof.exact import Range, decimal, point
from design.spec.setting import Setting

FINE = 2**96
"""Enclosures end at multiples of one over this."""
Matrix = list[list[Range]]


class NoRegion(Exception):
    """There is none, or none was found; the text says why."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Demand:
    """``h`` x + xᵀ ``S`` x <= ``room``, wherever the state is: ``h`` (3,), ``S`` (3, 3)."""

    h: list[Range]
    S: Matrix
    room: Range


@dataclass(frozen=True, eq=False, kw_only=True)
class Loop:
    """The numbers of one loop at rest: of the body, its gains, A [N], sine and cosine of theta_f, the load [N].

    ``level`` [N] of F_T and F_H, ``cop`` [m] and ``torque`` [N m] (None: no limit) as the spec requires them.
    """

    M: Range
    L: Range
    I: Range
    ell: Range
    K_p: Range
    K_d: Range
    K_f: Range
    A: Range
    sine: Range
    cosine: Range
    load: Range
    level: Range
    cop: Range
    torque: Range | None
    theta_f: float

    def vertices(self, e_max: Fraction) -> list[Matrix]:
        """A(1) and A(sigma) (3, 3) at the smallest sigma on |e| <= ``e_max`` [rad], of the states (e, omega, w)."""
        zero, one = point(0), point(1)
        k = self.tau()
        gather = self.K_f / self.ell
        found = []
        for sigma in (one, point(sector(e_max))):
            turning = [(k[0] + self.A * self.L * sigma) / self.I, k[1] / self.I, k[2] / self.I]
            found.append([[zero, one, zero], turning, [gather * part for part in k]])
        return found

    def tau(self) -> list[Range]:
        """The torque's row (3,) over (e, omega, w)."""
        return [-self.K_p, -self.K_d, point(1)]

    def demands(self, e_max: Fraction) -> list[Demand]:
        """What foot, ground and actuator ask on |e| <= ``e_max`` [rad], at every vertex."""
        level = self.sine.low == 0 == self.sine.high  # rho is not felt
        one = Fraction(1)
        ends = [[one, sector(e_max)], [one] if level else [one, cosine(e_max).low]]
        steep = abs(max(self.sine.high, -self.sine.low, key=abs))
        flat = point(min(Fraction(1), self.cosine.high + steep * e_max))
        asked = [(self.ell, self.load - self.level - self.level)]
        if self.cop.high > 0:
            asked.append((self.ell - self.cop, self.load))
        found = [
            self._contact(point(sign), reach, room, point(sigma), point(rho), flat)
            for reach, room in asked for sign in (1, -1) for sigma, rho in product(*ends)
        ]  # fmt: skip
        if self.torque is not None:
            nothing = [[point(0)] * 3] * 3
            found += [Demand(h=[point(s) * part for part in self.tau()], S=nothing, room=self.torque) for s in (1, -1)]
        return found

    def _contact(self, sign: Range, reach: Range, room: Range, sigma: Range, rho: Range, flat: Range) -> Demand:
        k = self.tau()
        u = [k[0] + self.A * self.L * sigma, k[1], k[2]]
        inertia = self.M * self.L / self.I
        h = [sign / reach * a + inertia * self.sine * rho * b for a, b in zip(k, u, strict=True)]
        half = [point(Fraction(1, 2)) * inertia * self.cosine * sigma * part for part in u]
        zero = point(0)
        S = [[half[0] + half[0], half[1], half[2]], [half[1], self.M * self.L * flat, zero], [half[2], zero, zero]]
        return Demand(h=h, S=S, room=room)


def posed(setting: Setting, scenario: Scenario, gains: Gains) -> Loop:
    """The loop at the force that ``scenario`` ends with; raises ``NoRegion`` for what this certificate cannot hold."""
    if setting.law != "force" or math.isfinite(setting.adapt):
        message = "the region is bounded for law force with a fixed desired angle only"
        raise NoRegion(message)
    if goes_on(scenario):
        message = f"the force of {scenario.name} does not come to rest"
        raise NoRegion(message)
    biped, demanded = setting.biped, levels(setting)
    M, L, I, m, ell, g = (number(part) for part in (biped.M, biped.L, biped.I, biped.m, biped.ell, biped.g))
    weight = M * g
    last = [float(part) for part in scenario.signal[:, -1]]
    if scenario.kind == "slope":
        A, sine, cosine_ = weight, -_around(scenario.angle * last[0], _sine), _around(scenario.angle * last[0], cosine)
        down = weight * cosine_
    else:
        F_x, F_y = (-(M * number(last[0])), point(0)) if scenario.kind == "platform" else map(number, last)
        down = weight - F_y
        A = _root(_square(F_x) + _square(down))
        if A.low <= 0:
            message = "the force cancels the weight"
            raise NoRegion(message)
        sine, cosine_ = -F_x / A, down / A
    if cosine_.low <= 0:
        message = "the force lifts the body, or the ground is vertical"
        raise NoRegion(message)
    level = number(demanded["toe-force"])
    load = m * g + down
    if (load - level - level).low <= 0:
        message = f"at rest toe and heel carry {float(load.low) / 2:.6g} N each; needs more than {float(level.high):g}"
        raise NoRegion(message)
    K_p, K_d, K_f = (number(gain) for gain in gains)
    theta_f = math.atan2(float(sine.low), float(cosine_.low))
    torque = number(demanded["torque"]) if "torque" in demanded else None
    if torque is not None and torque.low <= 0:
        message = "no torque is allowed"
        raise NoRegion(message)
    cop = number(demanded["cop-margin"])
    if (ell - cop).low <= 0:
        message = f"a margin of {float(cop.high):g} m for the centre of pressure is more than the foot has"
        raise NoRegion(message)
    return Loop(
        M=M, L=L, I=I, ell=ell, K_p=K_p, K_d=K_d, K_f=K_f, A=A, sine=sine, cosine=cosine_, load=load, level=level,
        cop=cop, torque=torque, theta_f=theta_f,
    )  # fmt: skip


def number(value: float) -> Range:
    """The float, the decimal that it prints as, and what lies between."""
    own, printed = Fraction(float(value)), decimal(value)
    return Range(min(own, printed), max(own, printed))


def coarse(loop: Loop) -> Loop:
    """The same loop with floats in place of rationals, twenty times as fast: for a search, never for a proof."""

    def rounded(part: object) -> object:
        if not isinstance(part, Range):
            return part
        value = cast(Fraction, float((part.low + part.high) / 2))  # what ranges do, floats do too
        return Range(value, value)

    return replace(loop, **{each.name: rounded(getattr(loop, each.name)) for each in fields(loop)})  # type: ignore[arg-type]


def middle(matrix: Matrix) -> np.ndarray:
    """The same in floats."""
    return np.array([[float((entry.low + entry.high) / 2) for entry in row] for row in matrix])


def sector(e_max: Fraction) -> Fraction:
    """A lower bound of sin(e)/e on |e| <= ``e_max`` <= 3 [rad]."""
    if not 0 < e_max <= 3:
        message = f"{float(e_max)} is no bound of an angle from 0 to 3"
        raise ValueError(message)
    return _outward(_sine(e_max) / point(e_max)).low


def _sine(x: Fraction) -> Range:
    return _series(x, 1)


def cosine(x: Fraction) -> Range:
    """The cosine of ``x`` [rad], enclosed."""
    return _series(x, 0)


def _series(x: Fraction, first: int) -> Range:
    """Taylor's polynomial from the power ``first`` on in steps of two, and its remainder after the last one."""
    total, term, k = Fraction(0), x if first else Fraction(1), first
    while abs(term) > Fraction(1, FINE * 16) or k < 8:
        total += term
        term = -term * x * x / ((k + 1) * (k + 2))
        k += 2
    rest = abs(x) ** k / math.factorial(k)  # the next derivative is at most 1
    return _outward(Range(max(total - rest, Fraction(-1)), min(total + rest, Fraction(1))))


def _around(value: float, function: Callable[[Fraction], Range]) -> Range:
    """``function``, whose slope is at most 1, over ``number(value)``."""
    x = number(value)
    found = function(x.low)
    width = x.high - x.low
    return _outward(Range(found.low - width, found.high + width)) if value else found


def _outward(x: Range) -> Range:
    return Range(Fraction(math.floor(x.low * FINE), FINE), Fraction(math.ceil(x.high * FINE), FINE))


def _square(x: Range) -> Range:
    ends = (x.low * x.low, x.high * x.high)
    return Range(Fraction(0) if x.low <= 0 <= x.high else min(ends), max(ends))


def _root(square: Range) -> Range:
    """All square roots of a range of squares."""
    low = math.isqrt(math.floor(square.low * FINE * FINE))
    high = math.isqrt(math.ceil(square.high * FINE * FINE)) + 1
    return Range(Fraction(low, FINE), Fraction(high, FINE))
