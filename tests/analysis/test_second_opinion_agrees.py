"""Two simulations that share no code agree to a millionth of the weight, and only on the same gains.

One is the Runge-Kutta march of the CasADi graph; the other writes the equations out
and integrates with DOP853.
"""

import math
from functools import cache

import numpy as np
import pytest

from design.analysis.recheck import second_opinion
from design.analysis.simulate import FALLEN, simulate
from design.model.body import Biped
from design.model.closed_loop import closed_loop
from design.model.environment import constant_force, platform, profile, slope
from design.model.laws import Gains

PAPER = Biped(M=50.0, L=0.75, I=50.0 * 0.75**2 / 4, m=0.1, ell=0.1)
ADULT = Biped(M=72.5, L=0.93, I=84.0, m=2.4, ell=0.12, g=9.80665)
GAINS = {"paper": Gains(3500.0, 1200.0, 1.0), "adult": Gains(3200.0, 900.0, 0.6)}
BIPEDS = {"paper": PAPER, "adult": ADULT}
THETA_D = 0.02
STEP = 0.0005  # at the paper's 1 ms the Runge-Kutta method itself is off by two millionths

JUMPS = np.array([[0.0, 0.0, 0.0], [0.4003, 20.0, 30.0], [0.4003, -25.0, 0.0], [1.1, -25.0, -40.0]])
BUS = np.array([[0.1, 0.0], [0.35, 0.5], [0.9, 0.5], [0.9, -0.3]])
SCENARIOS = {
    "slope": lambda biped: slope(biped, name="slope", angle=math.radians(12), ramp=1.2345, duration=2.0),
    "sudden": lambda biped: slope(biped, name="sudden", angle=math.radians(3), ramp=0.0, duration=1.5),
    "push": lambda biped: constant_force(
        name="push", F_x=25.0, F_y=-60.0, ramp=0.3, duration=1.5, theta0=0.03, omega0=-0.05
    ),
    "bus": lambda biped: platform(biped, name="bus", points=BUS, duration=1.5),
    "jumps": lambda biped: profile(name="jumps", points=JUMPS, duration=1.6, omega0=0.04),
}


@cache
def _first(name, body, kind):
    biped = BIPEDS[body]
    return simulate(closed_loop(biped, kind, THETA_D), SCENARIOS[name](biped), GAINS[body], STEP)


def _second(name, body, kind, gains=None):
    biped = BIPEDS[body]
    return second_opinion(biped, kind, THETA_D, gains or GAINS[body], SCENARIOS[name](biped), STEP)


def _apart(first, second, weight):
    """The largest difference of the contact forces, in weights."""
    return max(np.abs(first.F_T - second.F_T).max(), np.abs(first.F_H - second.F_H).max()) / weight


@pytest.mark.parametrize("kind", ["pd", "force", "cop"])
@pytest.mark.parametrize("body", BIPEDS)
@pytest.mark.parametrize("name", SCENARIOS)
def test_both_simulations_agree_at_every_sample(name, body, kind):
    first, second = _first(name, body, kind), _second(name, body, kind)
    assert second.finished
    assert np.array_equal(first.t, second.t)
    assert _apart(first, second, BIPEDS[body].weight) < 1e-6
    assert np.abs(first.theta - second.theta).max() < 1e-8
    assert np.abs(first.tau - second.tau).max() < 1e-6 * BIPEDS[body].weight * BIPEDS[body].ell
    assert np.ptp(first.F_H) > 0.02 * BIPEDS[body].weight  # there was something to agree on


@pytest.mark.parametrize(("kind", "adapt"), [("cop", math.inf), ("force", 0.3)])
def test_both_agree_on_a_law_that_reckons_with_another_body(kind, adapt):
    real = Biped(M=51.0, L=0.76, I=7.2, m=0.2, ell=0.095)
    world = SCENARIOS["slope"](real)
    first = simulate(closed_loop(real, kind, THETA_D, adapt, PAPER), world, GAINS["paper"], STEP)
    second = second_opinion(real, kind, THETA_D, GAINS["paper"], world, STEP, adapt, known=PAPER)
    assert _apart(first, second, real.weight) < 1e-6
    unaware = second_opinion(real, kind, THETA_D, GAINS["paper"], world, STEP, adapt)
    assert _apart(first, unaware, real.weight) > 1e-4


@pytest.mark.parametrize(("gain", "factor"), [(0, 1.001), (1, 1.001), (2, 1.005)])
@pytest.mark.parametrize("kind", ["force", "cop"])
def test_they_disagree_as_soon_as_a_gain_differs_a_little(kind, gain, factor):
    changed = list(GAINS["paper"])
    changed[gain] *= factor
    second = _second("slope", "paper", kind, Gains(*changed))
    assert _apart(_first("slope", "paper", kind), second, PAPER.weight) > 1e-5


def test_the_other_law_is_told_apart():
    assert _apart(_first("slope", "paper", "force"), _second("slope", "paper", "cop"), PAPER.weight) > 1e-3


def test_what_separates_them_is_the_error_of_the_fixed_step():
    biped, gains, loop = PAPER, GAINS["paper"], closed_loop(PAPER, "force", THETA_D)
    tilted = SCENARIOS["slope"](biped)
    apart = [
        _apart(
            simulate(loop, tilted, gains, step),
            second_opinion(biped, "force", THETA_D, gains, tilted, step),
            biped.weight,
        )
        for step in (0.002, 0.001)
    ]
    assert 12 < apart[0] / apart[1] < 24  # a method of order 4


def test_both_see_the_same_fall():
    weak, tilted = Gains(200.0, 50.0, 0.1), slope(PAPER, name="tilted", angle=0.2, ramp=0.5, duration=6.0)
    first = simulate(closed_loop(PAPER, "force"), tilted, weak, STEP)
    second = second_opinion(PAPER, "force", 0.0, weak, tilted, STEP)
    n = len(first.t)
    assert first.fallen is not None
    assert second.t[np.argmax(np.abs(second.theta) >= FALLEN)] == pytest.approx(first.fallen, abs=1e-9)
    assert np.abs(first.theta - second.theta[:n]).max() < 1e-7


@pytest.mark.parametrize(("kind", "gains"), [("force", (100.0, 10.0, 300.0)), ("pd", (100.0, -1000.0, 0.0))])
def test_a_blow_up_is_reported_and_nothing_is_claimed_beyond_it(kind, gains):
    """It happens on the first of two pieces; the second is never reached."""
    tilted = slope(PAPER, name="tilted", angle=0.6, ramp=0.5, duration=2.0)
    found = second_opinion(PAPER, kind, 0.0, Gains(*gains), tilted, STEP)
    assert not found.finished
    assert np.isnan(found.F_H[found.t > 0.5]).all()


def test_an_integration_that_fails_is_reported():
    """Law cop divides by the load on the foot, which this lift takes away."""
    lifted = constant_force(name="lifted", F_x=0.0, F_y=2 * PAPER.weight, ramp=1.0, duration=2.0, theta0=0.05)
    found = second_opinion(PAPER, "cop", 0.0, GAINS["paper"], lifted, STEP)
    assert not found.finished
