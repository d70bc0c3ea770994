"""The L1 bound from slope rate to CoP: attained by its own profile, exceeded by none."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.linalg import expm

from design.analysis.simulate import simulate
from design.analysis.slope_rate import _response, peak_gain, worst_profile
from design.model.closed_loop import closed_loop
from design.model.environment import Scenario, slope_force
from design.model.laws import Gains
from design.spec.load import load
from design.spec.setting import setting

BIPED = setting(load("slope").spec).biped
PAPER = Gains(3500.0, 1200.0, 1.0)
BEST = Gains(3500.0, 902.6033, 8.4571)
TRIPLE = Gains(3500.0, 500.1978112721891, 3.4582803907025883)  # a triple pole
RATE = math.radians(0.05)  # slow enough for the linear loop


def _ground(points, duration):
    return Scenario(
        name="ground", kind="slope", duration=duration, times=points[:, 0], signal=points[:, 1:].T,
        to_force=slope_force(BIPED),
    )  # fmt: skip


def _largest_cop(gains, points, duration):
    run = simulate(closed_loop(BIPED, "force"), _ground(points, duration), gains, 1e-3)
    return float(np.abs(run.P).max())


@pytest.mark.parametrize("gains", [PAPER, BEST, TRIPLE])
def test_its_own_worst_profile_attains_the_bound(gains):
    peak = peak_gain(BIPED, "force", gains)
    points = worst_profile(peak, RATE)
    assert np.abs(np.diff(points[:, 1]) / np.diff(points[:, 0])) == pytest.approx(RATE)
    assert _largest_cop(gains, points, float(points[-1, 0])) == pytest.approx(peak.gain * RATE, rel=1e-3)


@pytest.mark.parametrize("gains", [PAPER, BEST, TRIPLE, Gains(3500.0, 606.2, 5.6137), Gains(900.0, 80.0, 0.4)])
def test_the_norm_is_the_integral_between_sign_changes(gains):
    peak = peak_gain(BIPED, "force", gains)
    A, B, C = _response(BIPED, "force", gains)
    edges = [0.0, *peak.switches, peak.horizon]
    parts = [quad(lambda t: C @ expm(A * t) @ B, a, b, epsabs=1e-12, limit=400)[0] for a, b in pairwise(edges)]
    assert sum(map(abs, parts)) == pytest.approx(peak.gain, rel=1e-6)
    signs = np.sign([p for p in parts if abs(p) > 1e-12])
    assert np.all(signs[1:] == -signs[:-1])
    assert peak.error <= 1e-6 * peak.gain


@settings(max_examples=25, deadline=None)
@given(data=st.data())
def test_no_profile_of_that_rate_exceeds_it(data):
    peak = peak_gain(BIPED, "force", BEST)
    count = data.draw(st.integers(1, 12))
    lengths = data.draw(st.lists(st.floats(0.05, 1.0), min_size=count, max_size=count))
    rates = data.draw(st.lists(st.floats(-1.0, 1.0), min_size=count, max_size=count))
    times = np.concatenate([[0.0], np.cumsum(lengths)])
    slopes = np.concatenate([[0.0], np.cumsum(np.array(rates) * RATE * np.array(lengths))])
    largest = _largest_cop(BEST, np.column_stack([times, slopes]), float(times[-1]) + 1.0)
    assert largest <= (peak.gain + peak.error) * RATE * (1 + 1e-4)


def test_law_pd_and_unstable_loops_have_no_bound():
    with pytest.raises(ValueError, match="pd"):
        peak_gain(BIPED, "pd", PAPER)
    with pytest.raises(ValueError, match="not stable"):
        peak_gain(BIPED, "force", Gains(300.0, 1200.0, 1.0))
