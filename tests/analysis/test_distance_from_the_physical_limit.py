"""Sudden slope and push survived, and what no controller survives."""

import math
from dataclasses import replace

import numpy as np
import pytest

from design.analysis.obstacles import obstacles
from design.analysis.recheck import second_opinion
from design.analysis.survival import push, push_limit, slope_limit, step_slope
from design.model.closed_loop import closed_loop
from design.model.environment import slope
from design.model.laws import Gains
from design.spec.load import load
from design.spec.setting import setting

SLOPE = setting(load("slope").spec)
LOOP = closed_loop(SLOPE.biped, "force")


@pytest.mark.parametrize(
    ("gains", "degrees"), [(Gains(3500.0, 1200.0, 1.0), 7.04), (Gains(3500.0, 902.6, 8.457), 3.15)]
)
def test_sudden_slope_survived(gains, degrees):
    assert math.degrees(step_slope(LOOP, gains, 1e-3).survived) == pytest.approx(degrees, abs=0.005)


@pytest.mark.parametrize("gains", [Gains(3500.0, 1200.0, 1.0), Gains(3500.0, 902.6, 8.457)])
def test_contact_is_kept_just_inside_and_lost_just_outside(gains):
    survived = step_slope(LOOP, gains, 1e-3).survived
    for factor, kept in ((0.999, True), (1.001, False)):
        for sign in (1, -1):
            step = slope(SLOPE.biped, name="s", angle=sign * factor * survived, ramp=0.0, duration=10.0)
            run = second_opinion(SLOPE.biped, "force", 0.0, gains, step, 1e-3)
            assert bool(min(run.F_T.min(), run.F_H.min()) >= 0) is kept


def test_push_is_kept_just_inside_and_lost_just_outside():
    gains = Gains(3500.0, 400.0, 2.0)
    survived = push(LOOP, gains, 1e-3).survived
    for factor, kept in ((0.999, True), (1.001, False)):
        rate = factor * survived * SLOPE.biped.L / SLOPE.biped.I
        still = slope(SLOPE.biped, name="s", angle=0.0, ramp=0.0, duration=10.0, omega0=rate)
        run = second_opinion(SLOPE.biped, "force", 0.0, gains, still, 1e-3)
        assert bool(min(run.F_T.min(), run.F_H.min()) >= 0) is kept


def test_the_slope_limit_is_where_infeasibility_is_proved():
    limit = slope_limit(SLOPE.biped)
    assert math.degrees(limit) == pytest.approx(7.6098, abs=1e-3)
    assert math.degrees(slope_limit(replace(SLOPE.biped, m=0.0))) == pytest.approx(7.5946, abs=1e-3)  # tan = ell/L
    for factor, blocked in ((0.9999, False), (1.0001, True)):
        step = slope(SLOPE.biped, name="s", angle=factor * limit, ramp=0.0, duration=10.0)
        assert bool(obstacles(replace(SLOPE, scenarios=(step,)))) is blocked


def test_a_push_beyond_the_limit_defeats_even_the_best_ankle():
    # the torque that holds the CoP at the toe from the first instant, F_H = 0, is the best there is
    b = SLOPE.biped

    def falls(impulse):
        theta, omega, h = 0.0, impulse * b.L / b.I, 2e-4
        for _ in range(20_000):
            k = b.M * b.L * math.sin(theta) / b.I
            drive = b.M * b.g * b.L * math.sin(theta)
            base = b.weight - b.M * b.L * omega**2 * math.cos(theta)
            tau = -b.ell * (base - k * drive) / (1 - b.ell * k)
            omega += h * (drive + tau) / b.I
            theta += h * omega
            if theta > 1.0:
                return True
            if omega < 0:
                return False
        return False

    assert falls(1.02 * push_limit(b))


def test_a_desired_angle_makes_the_directions_differ_and_the_worse_one_counts():
    leaning = closed_loop(SLOPE.biped, "force", math.radians(1.0))
    gains = Gains(3500.0, 1200.0, 1.0)
    survived = step_slope(leaning, gains, 1e-3).survived
    assert survived < step_slope(LOOP, gains, 1e-3).survived
    lost = []
    for sign in (1, -1):
        step = slope(SLOPE.biped, name="s", angle=sign * 1.002 * survived, ramp=0.0, duration=10.0)
        run = second_opinion(SLOPE.biped, "force", math.radians(1.0), gains, step, 1e-3)
        lost.append(bool(min(run.F_T.min(), run.F_H.min()) < 0))
    assert np.any(lost)
