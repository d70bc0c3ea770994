"""A scenario is called beyond every ankle only where it is: tried against ankles that push as hard as the foot allows.

The right values come from Newton's and Euler's laws written out here for body and foot, a feedback of the centre of
pressure that saturates at the end of the foot, and SciPy's integrator.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from design.analysis.beyond import beyond
from design.analysis.capture import Ankle, Variant, falls, falls_to
from design.model.body import Biped
from design.model.environment import constant_force, platform, profile, slope


def reactions(b, theta, omega, tau, F_x, F_y):
    """theta'', F_T and F_H [rad/s², N], from the balances of forces and moments of body and foot."""
    turning = (b.L * ((b.M * b.g - F_y) * math.sin(theta) + F_x * math.cos(theta)) + tau) / b.I
    up = b.M * (b.g + b.L * (-turning * math.sin(theta) - omega**2 * math.cos(theta))) - F_y
    foot = b.m * (b.g - F_y / b.M) if b.ground_loads else b.m * b.g
    along = b.M * b.L * (turning * math.cos(theta) - omega**2 * math.sin(theta)) - F_x
    # moments on the foot about the ankle: -tau, its weight in the middle, the ground's forces at toe, heel and below
    middle = 0.5 * (b.toe - b.heel)
    F_T, F_H = np.linalg.solve(
        [[1.0, 1.0], [b.toe, -b.heel]], [up + foot, -tau + middle * foot - b.height * along]
    )  # fmt: skip
    return turning, float(F_T), float(F_H)


def strongest(b, ankle, theta, omega, F_x, F_y):
    """The torque that moves the CoP as the divergent motion asks, as far as contact and torque allow; None if none."""
    free, unit = (np.array(reactions(b, theta, omega, tau, F_x, F_y)) for tau in (0.0, 1.0))
    unit = unit - free
    low, high = -ankle.torque, ankle.torque
    for force, change in zip(free[1:], unit[1:], strict=True):
        edge = (ankle.level - force) / change
        low, high = (max(low, edge), high) if change > 0 else (low, min(high, edge))
    if low > high:
        return None
    A = math.hypot(b.M * b.g - F_y, F_x)
    away = theta - math.atan2(-F_x, b.M * b.g - F_y) + omega / math.sqrt(A * b.L / b.I)
    return min(max(-3.0 * A * b.L * away, low), high)


def survives(b, scenario, ankle):
    """Whether that ankle keeps contact and the body up to the end of the scenario."""
    state = [scenario.theta0, scenario.omega0]
    for piece in scenario.pieces():

        def rate(t, x, piece=piece):
            F_x, F_y = scenario.force_on(piece, np.array([t]))[:, 0]
            tau = strongest(b, ankle, x[0], x[1], F_x, F_y)
            return [x[1], 0.0 if tau is None else reactions(b, x[0], x[1], tau, F_x, F_y)[0]]

        def up(t, x, piece=piece):
            F_x, F_y = scenario.force_on(piece, np.array([t]))[:, 0]
            return min(1.4 - abs(x[0]), -1.0 if strongest(b, ankle, x[0], x[1], F_x, F_y) is None else 1.0)

        up.terminal = True
        if up(piece[0], state) < 0:
            return False
        run = solve_ivp(rate, piece, state, events=up, max_step=0.02, rtol=1e-6, atol=1e-9)
        if run.status == 1:
            return False
        state = run.y[:, -1]
    return True


def drawn(rng, *, unequal=True):
    """A body with a foot, and what its ankle keeps."""
    M, L = rng.uniform(20, 90), rng.uniform(0.5, 1.1)
    ell = rng.uniform(0.06, 0.14)
    biped = Biped(
        M=M, L=L, I=M * L**2 * rng.uniform(1.02, 1.4), m=rng.uniform(0.0, 3.0), ell=ell,
        skew=rng.uniform(-0.6, 0.6) if unequal else 0.0, height=rng.uniform(0.0, 0.1) if unequal else 0.0,
    )  # fmt: skip
    torque = math.inf if rng.random() < 0.5 else rng.uniform(0.3, 1.2) * ell * M * 9.81
    level = 0.0 if rng.random() < 0.5 else rng.uniform(0.0, 0.1) * M * 9.81
    return biped, Ankle(level=level, torque=torque, at_rest=False)


def disturbed(rng, b, kind, size=1.0):
    """A scenario of that kind, ``size`` in units of what linear capturability allows from rest."""
    part = b.ell / b.L * size * rng.choice([-1.0, 1.0])
    name, duration = "s", 4.0
    force = part * b.M * b.g
    if kind == "sudden slope":
        return slope(b, name=name, angle=part, ramp=0.0, duration=duration)
    if kind == "ramp":
        return slope(b, name=name, angle=3 * part, ramp=rng.uniform(0.05, 2.0), duration=duration)
    if kind == "force":
        return constant_force(name=name, F_x=force, F_y=0.2 * abs(force), ramp=0.0, duration=duration)
    if kind == "lean":
        return slope(b, name=name, angle=0.0, ramp=0.0, duration=duration, theta0=part)
    if kind == "rate":
        rate = part * math.sqrt(b.M * b.g * b.L / b.I)
        return slope(b, name=name, angle=0.0, ramp=0.0, duration=duration, omega0=rate)
    width = rng.uniform(0.02, 0.3)
    if kind == "push":
        peak = force / (math.sqrt(b.M * b.g * b.L / b.I) * width)
        points = np.array([[0.0, peak, 0.0], [width, peak, 0.0], [width, 0.0, 0.0]])
        return profile(name=name, points=points, duration=duration)
    points = np.array([[0.0, 4 * part * b.g], [width, 4 * part * b.g], [2 * width, 0.0]])
    return platform(b, name=name, points=points, duration=duration)


KINDS = ("sudden slope", "ramp", "force", "lean", "rate", "push", "platform")
SUDDEN = ("sudden slope", "force", "lean", "rate", "push")


@pytest.mark.parametrize("kind", KINDS)
def test_what_an_ankle_survives_is_never_called_impossible(kind):
    rng = np.random.default_rng(KINDS.index(kind))
    survived = claimed = 0
    for k in range(12):
        biped, ankle = drawn(rng)
        scenario = disturbed(rng, biped, kind, rng.uniform(0.3, 2.5))
        biped = replace(biped, ground_loads=scenario.field and k % 2 == 1)
        beyond_all = falls_to(biped, scenario, ankle) != 0
        kept = survives(biped, scenario, ankle)
        assert not (beyond_all and kept)
        survived, claimed = survived + kept, claimed + beyond_all
    assert survived
    assert claimed


@pytest.mark.parametrize("kind", SUDDEN)
def test_a_disturbance_just_below_the_limit_is_survived_by_the_strongest_ankle(kind):
    rng = np.random.default_rng(10 + KINDS.index(kind))
    for _ in range(3):
        biped, ankle = drawn(rng, unequal=False)
        scenario = disturbed(rng, biped, kind, 3.0)
        side = falls_to(biped, scenario, ankle)
        sizes = np.geomspace(0.03, 1.0, 700)
        start = kind in ("lean", "rate")
        shapes = [Variant(ankle=ankle, **{"start" if start else "signal": float(size)}) for size in sizes]
        limit = float(sizes[falls(biped, scenario, side, shapes)].min())
        assert survives(biped, scaled(scenario, 0.97 * limit, start=start), ankle)
        assert not survives(biped, scaled(scenario, limit, start=start), ankle)


def scaled(scenario, factor, *, start):
    """The scenario with its signal, or its initial state, multiplied."""
    if start:
        return replace(scenario, theta0=factor * scenario.theta0, omega0=factor * scenario.omega0)
    return replace(scenario, signal=factor * scenario.signal)


def test_the_foot_and_the_torque_that_are_named_are_needed_and_just_more_is_enough():
    biped = Biped(M=31.1, L=0.58, I=13.0, m=0.9, ell=0.10)
    pushed = profile(
        name="push", points=np.array([[0.5, 0, 0], [0.5, 300, 0], [0.6, 300, 0], [0.6, 0, 0.0]]), duration=6.0
    )
    ankle = Ankle(level=5.0, torque=45.0)
    found = beyond(biped, pushed, ankle, falls_to(biped, pushed, ankle))
    assert found.size == pytest.approx(30.0)
    late = replace(pushed, times=pushed.times[1:] - 0.5, signal=pushed.signal[:, 1:])  # nobody knows of it before
    late = replace(late, times=np.append(0.0, late.times[1:]), duration=5.5)
    assert survives(biped, scaled(late, 0.97 * found.survivable / found.size, start=False), ankle)
    for foot, torque, kept in ((1.03, 1.03, True), (1.03, 0.97, False), (0.97, 1.03, False)):
        other = replace(biped, ell=foot * found.foot)
        assert survives(other, late, replace(ankle, torque=torque * found.torque)) is kept
