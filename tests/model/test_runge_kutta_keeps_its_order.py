"""The integration is of order 4 although the force has corners and jumps, because no step crosses one.

The breakpoints are not multiples of any step used. The peer is DOP853 with the forces written out piece by piece.
"""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from design.analysis.simulate import simulate
from design.model.body import Biped
from design.model.closed_loop import closed_loop
from design.model.environment import Steps, profile, slope
from design.model.laws import Gains

PAPER = Biped(M=50.0, L=0.75, I=50.0 * 0.75**2 / 4, m=0.1, ell=0.1)
GAINS = Gains(900.0, 80.0, 0.3)  # poles of some 10 1/s: no step here is near the limit of stability
DURATION = 1.5
STEPS = (0.02, 0.01, 0.005, 0.0025)
CORNER, TILT = math.pi / 7, 0.2
JUMP = 0.31371


def march(loop, scenario, gains, steps):
    """States (3, N+1) at the samples, one call of ``loop.step`` after the other."""
    z = [np.array([scenario.theta0, scenario.omega0, 0.0])]
    for u in np.vstack([steps.h, steps.start, steps.middle, steps.end]).T:
        z.append(loop.step(z[-1], u, gains).full().ravel())
    return np.column_stack(z)


def _on_slope(alpha):
    return PAPER.M * PAPER.g * np.array([math.sin(alpha), 1.0 - math.cos(alpha)])


CASES = {
    "corner": (
        slope(PAPER, name="corner", angle=TILT, ramp=CORNER, duration=DURATION, theta0=0.02, omega0=-0.1),
        [(0.0, CORNER, lambda t: _on_slope(TILT * t / CORNER)), (CORNER, DURATION, lambda t: _on_slope(TILT))],
    ),
    "jump": (
        profile(
            name="jump", duration=DURATION, theta0=0.02, omega0=-0.1,
            points=np.array([[0, 0, 0], [JUMP, 40, 10], [JUMP, -30, 0], [0.9001, -30, 20]]),
        ),
        [
            (0.0, JUMP, lambda t: np.array([40.0, 10.0]) * t / JUMP),
            (JUMP, 0.9001, lambda t: np.array([-30.0, 20.0 * (t - JUMP) / (0.9001 - JUMP)])),
            (0.9001, DURATION, lambda t: np.array([-30.0, 20.0])),
        ],
    ),
}  # fmt: skip


def _peer(loop, scenario, pieces):
    z = np.array([scenario.theta0, scenario.omega0, 0.0])
    for start, end, force in pieces:
        run = solve_ivp(
            lambda t, z, force=force: loop.rate(z, force(t), GAINS).full().ravel(),
            (start, end), z, method="DOP853", rtol=3e-14, atol=1e-15,
        )  # fmt: skip
        z = run.y[:, -1]
    return z


def _steps_that_cross(scenario, h):
    """Even steps over corners and jumps alike, as a simulation without breakpoints takes them."""
    t = h * np.arange(round(scenario.duration / h) + 1)
    times = scenario.times + 1e-12 * np.arange(len(scenario.times))  # np.interp wants them to grow

    def signal(at):
        return np.vstack([np.interp(at, times, row) for row in scenario.signal])

    force = [scenario.to_force(signal(at)) for at in (t[:-1], t[:-1] + h / 2, t[1:], t)]
    return Steps(t=t, h=np.diff(t), start=force[0], middle=force[1], end=force[2], force=force[3], signal=signal(t))


@pytest.mark.parametrize("case", CASES)
def test_the_simulation_is_this_march(case):
    """What holds of ``loop.step`` over ``scenario.steps`` holds of ``simulate``."""
    scenario, _ = CASES[case]
    loop = closed_loop(PAPER, "force")
    run = simulate(loop, scenario, GAINS, STEPS[0])
    expected = march(loop, scenario, GAINS, scenario.steps(STEPS[0]))
    assert np.vstack([run.theta, run.omega, run.s]) == pytest.approx(expected, rel=1e-12, abs=1e-14)


@pytest.mark.parametrize("kind", ["pd", "force", "cop"])
@pytest.mark.parametrize("case", CASES)
def test_halving_the_step_divides_the_error_by_sixteen(case, kind):
    scenario, pieces = CASES[case]
    loop = closed_loop(PAPER, kind)
    exact = _peer(loop, scenario, pieces)
    errors = [np.abs(march(loop, scenario, GAINS, scenario.steps(h))[:, -1] - exact).max() for h in STEPS]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.abs(exact[:2]).max() > 1e-3
    assert orders.min() > 3.6, (errors, orders)
    assert orders[-1] < 4.5, (errors, orders)  # a fourth-order method, no more


@pytest.mark.parametrize("case", CASES)
def test_a_step_across_a_corner_or_a_jump_would_cost_the_order(case):
    scenario, pieces = CASES[case]
    loop = closed_loop(PAPER, "force")
    exact = _peer(loop, scenario, pieces)
    h = STEPS[-1]
    ours = march(loop, scenario, GAINS, scenario.steps(h))[:, -1]
    crossing = march(loop, scenario, GAINS, _steps_that_cross(scenario, h))[:, -1]
    assert np.abs(crossing - exact).max() > 100 * np.abs(ours - exact).max()
