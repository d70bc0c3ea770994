"""(16)-(17) are exact in the stationary posture, and an approximation on the way there."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from design.analysis.estimate import static_estimate
from design.analysis.simulate import simulate
from design.model.body import Biped
from design.model.closed_loop import closed_loop
from design.model.environment import constant_force, slope
from design.model.laws import Gains
from design.model.plant import plant

PAPER = Biped(M=50.0, L=0.75, I=50.0 * 0.75**2 / 4, m=0.1, ell=0.1)
ADULT = Biped(M=72.5, L=0.93, I=84.0, m=2.4, ell=0.12, g=9.80665)
PLANTS = {"paper": plant(PAPER), "adult": plant(ADULT)}
PAPER_RUN = slope(PAPER, name="slope", angle=math.pi / 6, ramp=5.0, duration=10.0)


@pytest.mark.parametrize("body", PLANTS.values(), ids=PLANTS)
@given(F_x=st.floats(-900.0, 900.0), F_y=st.floats(-900.0, 900.0))
@settings(max_examples=200, deadline=None)
def test_the_estimate_is_exact_in_the_stationary_posture(body, F_x, F_y):
    biped = body.biped
    down = biped.M * biped.g - F_y
    assume(abs(down) > 1.0)
    theta_f = math.atan2(-F_x, down)  # (4)
    F_T, F_H = body.forces([theta_f, 0.0], 0.0, [F_x, F_y]).full().ravel()
    assert F_T == F_H
    found = static_estimate(biped, np.array([theta_f]), np.array([F_T]), np.array([F_H]))
    size = biped.weight + abs(F_x) + abs(F_y)
    assert found[0].item() == pytest.approx(F_x, rel=1e-9, abs=1e-11 * size * (1 + abs(F_x / down)))
    assert found[1].item() == pytest.approx(F_y, rel=1e-12, abs=1e-12 * size)


@pytest.mark.parametrize("kind", ["force", "cop"])
def test_a_run_that_comes_to_rest_reads_its_force_exactly(kind):
    wind = constant_force(name="wind", F_x=-45.0, F_y=30.0, ramp=1.0, duration=14.0)
    run = simulate(closed_loop(PAPER, kind, 0.05), wind, Gains(3500.0, 902.6, 5.0), 0.002)
    assert run.F_estimate[:, -1] == pytest.approx([-45.0, 30.0], abs=1e-6)
    assert run.tau[-1] == pytest.approx(0.0, abs=1e-6)
    theta_d = math.atan(run.F_estimate[0, -1] / (run.F_estimate[1, -1] - PAPER.M * PAPER.g))  # (15)
    assert theta_d == pytest.approx(run.theta[-1], abs=1e-8)


def test_at_the_end_of_the_paper_s_run_the_estimate_is_near_and_on_the_way_it_is_not():
    run = simulate(closed_loop(PAPER, "force"), PAPER_RUN, Gains(3500.0, 1200.0, 1.0), 0.001)
    error = np.abs(run.F_estimate - run.F)
    assert error[0, -1] < 0.05
    assert error[1, -1] < 0.005
    assert error[0, run.t < 6.0].max() > 5.0
    assert run.F_estimate[:, -1] == pytest.approx([245.209, 65.7178], abs=5e-4)


def test_pd_control_does_not_find_the_force():
    run = simulate(closed_loop(PAPER, "pd"), PAPER_RUN, Gains(3500.0, 1200.0, 0.0), 0.001)
    assert abs(run.F_estimate[0, -1] - run.F[0, -1]) > 100.0
