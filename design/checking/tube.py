"""Contact at every time: the true trajectories stay in a tube around the given ones, and in the tube the foot stands.

x~(t, p) is piecewise polynomial in time, linear in the parameters p of a box, and need not be a solution. Its defect
is x~' - f(x~, t, p), with f written out in ``_Loop.parts``: (1), (3), (8), (9), (11). In a norm in which the loop
contracts at a rate (``linear``), D(t) bounds |x - x~|_P where D' = -rate D + |defect|_P; the rate holds while theta is
within a *reach* of theta~, and D never takes it there. Then toe and heel force, (5)-(7), differ from those of x~ by no
more than ``_Loop.errors`` says. At the end, where the signal rests, x~(T) itself is a trajectory for ever after.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NamedTuple

from design.checking import need
from design.checking.balls import (
    BITS,
    DEGREE,
    ONE,
    Ball,
    above,
    constant,
    inverse,
    radians,
    root,
    sine_and_cosine,
    up,
)
from design.checking.linear import Matrix, check_contraction, inverted, positive
from design.checking.world import Box, segments

STORED = 52
"""Coefficients are stored in units of 2^-52."""


@dataclass(kw_only=True)
class Found:
    """The least and largest over all times and the box: forces [N], torque [N m], and how far off theta~ may be [rad].

    ``cop``: the least of (ell - claimed margin) (F_T + F_H) - |tau| [N m], not to be below 0. In units of 2^-64.
    """

    toe: list[int]
    heel: list[int]
    cop: list[int]
    torque: list[int]
    G: list[int]
    reach: int = 0
    pieces: int = 0
    for_ever: bool = False


class Parts(NamedTuple):
    """What the equations are made of at x~: tau, theta'', its flow, and the rest as the paper has it."""

    tau: Ball
    turning: Ball
    flow: list[Ball]
    sine: Ball
    moment: Ball  # A L sin(theta - theta_f)
    stiffness: Ball  # A L cos(theta - theta_f)
    load: Ball  # F_T + F_H


class _Loop:
    """The loop in one scenario over one box, and the norm."""

    def __init__(
        self,
        spec: dict[str, Any],
        scenario: dict[str, Any],
        gains: Sequence[Fraction],
        g: Fraction,
        box: Box,
        P: Matrix,
    ) -> None:
        self.moving = [name for name, (_, half) in box.items() if half]
        self.kind, self.box, self.gains, self.P = scenario["kind"], box, gains, P
        number = {name: constant(box[name][0], self.at(name)) for name in ("M", "L", "m", "ell")}
        self.M, self.L, self.m, self.ell = number.values()
        self.per_I, self.per_ell = (inverse(box[name][0], self.at(name)) for name in ("I", "ell"))
        self.ML, self.Mg, self.mg = self.M * self.L, self.M * self.just(g), self.m * self.just(g)
        # on a slope the foot then weighs m g cos(alpha)
        self.loaded = spec.get("foot", {}).get("ground_loads", False) is True
        self.aim = radians(spec["law"].get("desired_angle_deg", Fraction(0)), [Fraction(0)] * len(self.moving))
        self.K = [self.just(each) for each in gains]
        self.tilt = radians(box["slope"][0], self.at("slope"))
        inverse_P = inverted(P)
        self.spread = [root(inverse_P[j][j]) for j in range(len(P))]  # |x_j| <= spread |x|_P
        felt = [Fraction(-gains[0]), -gains[1], *gains[2:]]
        squares = (
            a * b * entry for a, row in zip(felt, inverse_P, strict=True) for b, entry in zip(felt, row, strict=True)
        )
        self.felt = root(sum(squares, Fraction(0)))  # |tau| <= felt |x|_P
        self.sizes = [[above(abs(entry)) for entry in row] for row in P]

    def at(self, name: str) -> list[Fraction]:
        """How ``name`` goes with each parameter that moves."""
        return [self.box[name][1] if each == name else Fraction(0) for each in self.moving]

    def just(self, value: Fraction) -> Ball:
        """A number that does not go with the parameters."""
        return constant(value, [Fraction(0)] * len(self.moving))

    def parts(self, x: list[Ball], signal: list[Ball]) -> Parts:
        """The equations of motion, the law, and the load, at the states ``x`` under the ``signal``."""
        theta, omega = x[:2]
        sine, cosine = sine_and_cosine(theta)
        tau = self.K[0] * (self.aim - theta) - self.K[1] * omega
        if len(x) == 3:
            tau = tau + self.K[2] * x[2]  # (8), x[2] the integral of F_H - F_T
        if self.kind == "slope":  # (21): A = M g, theta_f = -alpha
            alpha = signal[0] * self.tilt
            across, along = sine_and_cosine(theta + alpha)
            upright = sine_and_cosine(alpha)[1]
            down, foot = self.Mg * upright, self.mg * upright if self.loaded else self.mg
            moment, stiffness = self.Mg * across, self.Mg * along
        else:
            foot = self.mg
            x_force = -(self.M * signal[0]) if self.kind == "platform" else signal[0]
            down = self.Mg if self.kind == "platform" else self.Mg - signal[1]
            moment, stiffness = down * sine + x_force * cosine, down * cosine - x_force * sine
        moment, stiffness = self.L * moment, self.L * stiffness
        turning = self.per_I * (moment + tau)
        load = foot + down - self.ML * (turning * sine + omega * omega * cosine)
        flow = [omega, turning, self.per_ell * tau][: len(x)]
        return Parts(tau, turning, flow, sine, moment, stiffness, load)

    def norm(self, vector: Sequence[int]) -> int:
        """A bound of |x|_P for |x_j| <= ``vector``."""
        square = sum(
            a * size * b for a, row in zip(vector, self.sizes, strict=True) for size, b in zip(row, vector, strict=True)
        )
        return math.isqrt(square >> BITS) + 1

    def errors(self, x: list[Ball], parts: Parts, D: int) -> tuple[int, int]:
        """How far tau and F_T + F_H may be from those of x~, at states within ``D`` of it."""
        r0, r1 = (up(each * D) for each in self.spread[:2])
        tau = up(self.felt * D)
        AL = parts.moment.size() + parts.stiffness.size()
        turning = up(self.per_I.size() * (up(AL * r0) + tau))
        S, W = min(ONE, parts.sine.size() + r0), x[1].size()
        moved = up(turning * S) + up(parts.turning.size() * r0)  # theta'' sin theta
        turned = up(r1 * (2 * W + r1)) + up(up(W * W) * r0)  # omega² cos theta
        return tau, up(self.ML.size() * (moved + turned))

    def read(self, x: list[Ball], parts: Parts, D: int, margin: Fraction, reach: int, found: Found) -> None:
        """Note what holds within ``D`` of ``x``."""
        tau, load = self.errors(x, parts, D)
        lever = self.per_ell * parts.tau
        half = (load + up(self.per_ell.size() * tau)) // 2 + 1
        found.toe.append((parts.load - lever).over(2).low() - half)
        found.heel.append((parts.load + lever).over(2).low() - half)
        left = self.ell - self.just(margin)
        slack = up(left.size() * load) + tau
        found.cop += [(left * parts.load + side).low() - slack for side in (parts.tau, -parts.tau)]
        need(parts.load.low() > load, "the foot may lose all its load")
        found.torque.append(max(-parts.tau.low(), -(-parts.tau).low()) + tau)
        widen = up((parts.moment.size() + up((parts.moment.size() + parts.stiffness.size()) * reach)) * reach)
        found.G += [parts.stiffness.low() - widen, -(-parts.stiffness).low() + widen]
        found.reach = max(found.reach, up(self.spread[0] * D))
        found.pieces += 1


def walk(
    spec: dict[str, Any], scenario: dict[str, Any], gains: Sequence[Fraction], g: Fraction, box: Box,
    part: dict[str, Any], margin: Fraction,
) -> Found:  # fmt: skip
    """What the ``part`` of a certificate shows of a box; ``margin`` is the claimed one of the CoP [m]."""
    lower, rate = [[Fraction(entry) for entry in row] for row in part["norm"]], Fraction(part["rate"])
    P = [[lower[max(a, b)][min(a, b)] for b in range(len(gains))] for a in range(len(gains))]
    need(positive(P), "the norm's matrix is not positive definite")
    loop = _Loop(spec, scenario, gains, g, box, P)
    reach = above(Fraction(part["reach"]))
    found = Found(toe=[], heel=[], cop=[], torque=[], G=[])
    wanted, rests = segments(scenario, box)
    after = Fraction(part["after_s"])
    need(len(wanted) == len(part["segments"]) and all(part["segments"]), "the trajectory lacks a part of the signal")
    need(after == 0 or (after > 0 and rests is not None), "it goes on after an end at which the signal does not rest")
    none = [Fraction(0)] * len(loop.moving)
    start = [radians(scenario.get(key, Fraction(0)), none) for key in ("initial_angle_deg", "initial_rate_deg_per_s")]
    last = [*start, loop.just(Fraction(0))][: len(gains)]
    D = 0
    for number, (segment, pieces) in enumerate(zip(wanted, part["segments"], strict=True)):
        length = segment.length + (after if number + 1 == len(wanted) else 0)
        total, done = sum(piece[0] for piece in pieces), 0
        for weight, *states in pieces:
            whole = type(weight) is int and weight > 0 and len(states) == len(gains)
            need(whole, "a piece of the trajectory has no length or lacks states")
            x = [_stored(rows, len(loop.moving)) for rows in states]
            h, begin, end = length * Fraction(weight, total), Fraction(done, total), Fraction(done + weight, total)
            done += weight
            stretch = box["ramp"][1] / box["ramp"][0] if segment.grows else Fraction(0)
            half = constant(h / 2, [h / 2 * stretch if name == "ramp" else Fraction(0) for name in loop.moving])
            ends = [(a + begin * (b - a), a + end * (b - a)) for a, b in zip(segment.first, segment.last, strict=True)]
            parts = loop.parts(x, [_line(a, b, loop) for a, b in ends])
            defect = [(each.slope() - half * f).size() for each, f in zip(x, parts.flow, strict=True)]
            D += loop.norm([_gap(a, b) for a, b in zip(last, x, strict=True)])
            added = 2 * loop.norm(defect)
            loop.read(x, parts, D + added, margin, reach, found)
            fallen = rate * h * (1 - stretch)  # e^y >= 1 + y + y²/2
            D = above(Fraction(D, ONE) / (1 + fallen + fallen**2 / 2)) + added
            last = [Ball([[value] for value in each.ends(1)]) for each in x]
    if rests is not None:
        parts = loop.parts(last, [loop.just(value) for value in rests])
        D = max(D, above(Fraction(loop.norm([f.size() for f in parts.flow]), ONE) / rate))
        loop.read(last, parts, D, margin, reach, found)
        found.for_ever = True
    need(found.reach < reach, f"the tube is wider than its reach: {found.reach / ONE:.3g} rad")
    G = Fraction(min(found.G), ONE), Fraction(max(found.G), ONE)
    check_contraction(P, rate, gains, (G, _ends(box["I"]), _ends(box["ell"])))
    return found


def _ends(part: tuple[Fraction, Fraction]) -> tuple[Fraction, Fraction]:
    return part[0] - part[1], part[0] + part[1]


def _stored(rows: list[list[int]], k: int) -> Ball:
    """A polynomial as a certificate has it; rows that it leaves out are zero."""
    whole = all(len(row) <= DEGREE + 1 and all(type(c) is int for c in row) for row in rows)
    need(whole and 0 < len(rows) <= 1 + k, "the coefficients are not integers, or not as many as there can be")
    scaled = [[c << BITS - STORED for c in row] for row in rows]
    return Ball([*scaled, *([] for _ in range(1 + k - len(rows)))])


def _line(first: Fraction, last: Fraction, loop: _Loop) -> Ball:
    """From ``first`` at v = -1 to ``last`` at v = 1."""
    middle, climb = loop.just((first + last) / 2), loop.just((last - first) / 2)
    return Ball([[middle.rows[0][0], climb.rows[0][0]], *middle.rows[1:]], middle.rest + climb.rest)


def _gap(before: Ball, x: Ball) -> int:
    """How far the beginning of ``x`` is from what was ``before``."""
    return (before - Ball([[value] for value in x.ends(-1)])).size()
