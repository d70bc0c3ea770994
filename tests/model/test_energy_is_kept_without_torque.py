"""What must be conserved is: the energy without torque, and with the PD law all that it does not damp away.

Under a constant force, E = I omega²/2 + M g L cos(theta) - F·r with r = L (sin theta, cos theta) does not change
while tau = 0. Under law pd, V = E + K_p (theta - theta_d)²/2 falls at exactly K_d omega².
"""

import math

import numpy as np
import pytest
from scipy.integrate import simpson

from design.model.body import Biped
from design.model.closed_loop import closed_loop
from design.model.environment import constant_force
from design.model.laws import Gains

PAPER = Biped(M=50.0, L=0.75, I=50.0 * 0.75**2 / 4, m=0.1, ell=0.1)
ADULT = Biped(M=72.5, L=0.93, I=84.0, m=2.4, ell=0.12, g=9.80665)
NO_TORQUE = Gains(0.0, 0.0, 0.0)
PUSHES = [(0.0, 0.0), (120.0, -60.0), (-300.0, 250.0)]


def march(loop, scenario, gains, steps):
    """States (3, N+1) at the samples, one call of ``loop.step`` after the other."""
    z = [np.array([scenario.theta0, scenario.omega0, 0.0])]
    for u in np.vstack([steps.h, steps.start, steps.middle, steps.end]).T:
        z.append(loop.step(z[-1], u, gains).full().ravel())
    return np.column_stack(z)


def _run(biped, gains, push, step, *, theta0, omega0, theta_d=0.0, duration=2.0):
    scenario = constant_force(
        name="push", F_x=push[0], F_y=push[1], ramp=0.0, duration=duration, theta0=theta0, omega0=omega0
    )
    steps = scenario.steps(step)
    return steps.t, march(closed_loop(biped, "pd", theta_d), scenario, gains, steps)


def _energy(biped, z, push):
    theta, omega = z[0], z[1]
    work = biped.L * (push[0] * np.sin(theta) + push[1] * np.cos(theta))
    return 0.5 * biped.I * omega**2 + biped.M * biped.g * biped.L * np.cos(theta) - work


@pytest.mark.parametrize("push", PUSHES)
@pytest.mark.parametrize("biped", [PAPER, ADULT], ids=["paper", "adult"])
def test_energy_is_kept_to_the_order_of_the_method(biped, push):
    drifts = []
    for step in (0.02, 0.01, 0.005):
        _, z = _run(biped, NO_TORQUE, push, step, theta0=0.3, omega0=-0.4)
        energy = _energy(biped, z, push)
        drifts.append(np.abs(energy - energy[0]).max() / (biped.M * biped.g * biped.L))
    assert np.ptp(z[0]) > 1.0  # it did swing
    assert drifts[-1] < 1e-5
    assert np.log2(np.array(drifts[:-1]) / drifts[1:]).min() > 3.7


def test_energy_is_not_kept_once_the_force_changes():
    _, z = _run(PAPER, NO_TORQUE, (120.0, -60.0), 0.005, theta0=0.3, omega0=-0.4)
    energy = _energy(PAPER, z, (0.0, 0.0))
    assert np.abs(energy - energy[0]).max() > 1.0


@pytest.mark.parametrize("push", PUSHES)
def test_the_pd_law_takes_out_what_its_damping_says(push):
    gains, theta_d = Gains(700.0, 45.0, 0.0), 0.1
    t, z = _run(PAPER, gains, push, 1e-3, theta0=0.25, omega0=0.5, theta_d=theta_d)
    V = _energy(PAPER, z, push) + 0.5 * gains.K_p * (z[0] - theta_d) ** 2
    lost = simpson(gains.K_d * z[1] ** 2, x=t)
    assert np.all(np.diff(V) <= 1e-10 * PAPER.weight)
    assert V[0] - V[-1] == pytest.approx(lost, rel=1e-7)
    assert lost > 1.0


def test_from_the_unstable_posture_a_body_without_torque_does_not_move():
    push = (120.0, -60.0)
    theta_f = math.atan2(-push[0], PAPER.M * PAPER.g - push[1])  # (4)
    _, z = _run(PAPER, NO_TORQUE, push, 0.01, theta0=theta_f, omega0=0.0, duration=1.0)
    assert np.abs(z[0] - theta_f).max() < 1e-12
