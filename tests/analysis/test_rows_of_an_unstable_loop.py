"""A row that presupposes a stable loop has no value where the loop is not, and says why; other rows have theirs."""

import math
from dataclasses import replace

import numpy as np
import pytest

from design.analysis.verdict import judge
from design.model.body import Biped
from design.model.environment import constant_force, slope
from design.model.laws import Gains
from design.spec.load import load
from design.spec.setting import setting

SLOPE = setting(load("slope").spec)
PRESUPPOSE = {
    "settling", "overshoot", "gain-margin-up", "gain-margin-down", "phase-margin", "delay-margin",
    "force-delay-margin", "angle-delay-margin", "disk-margin", "sample-time", "slope-rate", "step-slope", "push",
}  # fmt: skip


def _growth(biped, kind, gains, F):
    """The largest real part of the loop's poles at rest under ``F``, by differences of its equations."""
    size, theta_f = math.hypot(biped.M * biped.g - F[1], F[0]), math.atan2(-F[0], biped.M * biped.g - F[1])
    load = (biped.M + biped.m) * biped.g - F[1]
    strong = gains.K_f * biped.weight / load if kind == "cop" else gains.K_f

    def rate(z):
        theta, omega, q = z  # q = K_f s, with s' = tau/ell (11), over the load times (M + m) g in law (20)
        tau = -gains.K_p * theta - gains.K_d * omega + q + gains.K_p * theta_f
        return np.array([omega, (size * biped.L * math.sin(theta - theta_f) + tau) / biped.I, strong * tau / biped.ell])

    at, h = np.array([theta_f, 0.0, 0.0]), 1e-6
    columns = [(rate(at + h * way) - rate(at - h * way)) / (2 * h) for way in np.eye(3)]
    return float(np.linalg.eigvals(np.array(columns).T).real.max())


def _random(rng):
    L = rng.uniform(0.5, 1.1)
    M = rng.uniform(30.0, 100.0)
    biped = Biped(M=M, L=L, I=M * L**2 * rng.uniform(1.0, 1.4), m=rng.uniform(0.5, 3.0), ell=rng.uniform(0.08, 0.15))
    kind = ("force", "cop")[int(rng.integers(2))]
    stiff = M * biped.g * L
    gains = Gains(stiff * rng.uniform(0.3, 3.0), stiff * rng.uniform(0.02, 1.0), rng.uniform(0.01, 6.0))
    F = rng.uniform(-10.0, 10.0), rng.uniform(-30.0, 30.0)
    ramp = slope(biped, name="ramp", angle=math.radians(rng.uniform(1.0, 5.0)), ramp=1.0, duration=4.0)
    wind = constant_force(name="wind", F_x=F[0], F_y=F[1], ramp=1.0, duration=4.0)
    problem = replace(SLOPE, biped=biped, law=kind, scenarios=(ramp, wind), step=0.005, gains=gains)
    angle = float(ramp.signal[0, -1])
    hill = M * biped.g * math.sin(angle), M * biped.g * (1 - math.cos(angle))
    return problem, max(_growth(biped, kind, gains, force) for force in ((0.0, 0.0), hill, F))


def test_no_row_that_presupposes_stability_has_a_value_in_an_unstable_loop():
    rng = np.random.default_rng(5)
    unstable = 0
    for _ in range(40):
        problem, growth = _random(rng)
        if abs(growth) < 1e-3:
            continue
        rows = judge(problem, problem.gains, "all").rows
        ids = {row.id for row in rows}
        assert ids >= PRESUPPOSE
        if growth < 0:
            assert all(row.value is not None for row in rows if row.id in ("step-slope", "push"))
            continue
        unstable += 1
        for row in rows:
            if row.id in ("settling", "overshoot"):
                continue  # of a scenario: the loop may be stable in this one
            if row.id in PRESUPPOSE:
                assert row.value is None and row.status == "undecided"
                assert "not stable" in row.note
    assert unstable > 10


@pytest.mark.parametrize("gains", [Gains(300.0, 1200.0, 1.0), Gains(3500.0, 100.0, 17.0), Gains(3500.0, 1200.0, 0.0)])
def test_nothing_settles_in_an_unstable_loop(gains):
    rows = {row.id: row for row in judge(SLOPE, gains, "all").rows}
    for id in PRESUPPOSE:
        assert rows[id].value is None and rows[id].margin is None and rows[id].time_s is None
        assert "not stable" in rows[id].note
    assert rows["posture-error"].value is not None or "falls" in rows["posture-error"].note
