"""Settling, overshoot and what is left, on runs whose answers are known."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from design.analysis.simulate import simulate
from design.analysis.transient import transient
from design.analysis.verdict import judge
from design.model.closed_loop import closed_loop
from design.model.environment import constant_force, slope
from design.model.laws import Gains
from design.spec.load import load
from design.spec.setting import setting

SLOPE = setting(load("slope").spec)
LOOP = closed_loop(SLOPE.biped, "force")
GAINS = Gains(3500.0, 600.0, 4.0)


def _of(scenario, gains=GAINS):
    run = simulate(LOOP, scenario, gains, 1e-3)
    return transient(LOOP, scenario, run), run


def test_mirrored_runs_have_the_same_transient():
    for angle, rate in ((0.0, 20.0), (3.0, 0.0), (-2.0, 5.0)):
        pair = []
        for side in (1, -1):
            mirrored = {"angle": side * math.radians(angle), "omega0": side * math.radians(rate)}
            pair.append(_of(slope(SLOPE.biped, name="s", ramp=0.0, duration=5.0, **mirrored))[0])
        assert pair[0].overshoot == pytest.approx(pair[1].overshoot, abs=1e-12)
        assert pair[0].settling == pair[1].settling


def test_it_stays_within_the_band_from_the_settling_time_on():
    found, run = _of(SLOPE.scenarios[0])
    band = 0.02 * abs(run.theta + math.radians(30.0)).max()
    after = run.t >= found.settled_at
    assert abs(run.theta[after] + math.radians(30.0)).max() <= band
    assert found.settled_at == pytest.approx(5.0 + found.settling)


def test_a_run_that_is_cut_short_does_not_settle():
    found, _ = _of(replace(SLOPE.scenarios[0], duration=5.01), Gains(3500.0, 1200.0, 1.0))
    assert math.isinf(found.settling)


def test_a_force_that_still_changes_at_the_end_leaves_settling_undecided():
    ramp = replace(SLOPE.scenarios[0], duration=3.0)
    rows = {row.id: row for row in judge(replace(SLOPE, scenarios=(ramp,)), GAINS, "all").rows}
    for row in ("settling", "overshoot"):
        assert rows[row].status == "undecided"
        assert "still changes" in rows[row].note


def _force(kind, t, size, ramp):
    """F_x, F_y at time ``t`` of the three scenarios below, written out."""
    grown = min(t / ramp, 1.0) if ramp else 1.0
    if kind == "slope":
        angle = size * grown
        return SLOPE.biped.M * 9.81 * math.sin(angle), SLOPE.biped.M * 9.81 * (1 - math.cos(angle))
    return size * grown, 0.0


@pytest.mark.parametrize(
    ("kind", "size", "ramp", "theta0"),
    [("slope", 0.1, 1.0, 0.0), ("force", -15.0, 0.5, 0.0), ("slope", -0.05, 0.0, 0.02), ("force", 10.0, 0.0, -0.01)],
)
def test_rows_are_the_definition_on_a_run_by_another_integrator(kind, size, ramp, theta0):
    biped, end = SLOPE.biped, 6.0
    made = slope(biped, name="s", angle=size, ramp=ramp, duration=end, theta0=theta0)
    if kind == "force":
        made = constant_force(name="s", F_x=size, F_y=0.0, ramp=ramp, duration=end, theta0=theta0)
    rng = np.random.default_rng(3)
    for _ in range(4):
        K = Gains(rng.uniform(900, 3500), rng.uniform(150, 700), rng.uniform(0.3, 3.0))

        def rate(t, y, K=K):
            theta, omega, s = y
            F_x, F_y = _force(kind, t, size, ramp)
            tau = -K.K_p * theta - K.K_d * omega + K.K_f * s
            fall = (biped.M * 9.81 - F_y) * biped.L * math.sin(theta) + F_x * biped.L * math.cos(theta)
            return [omega, (fall + tau) / biped.I, tau / biped.ell]

        t = np.arange(6001) * 1e-3
        early, late = t[t <= ramp], t[t >= ramp]
        theta = np.array([theta0])
        state = [theta0, 0.0, 0.0]
        for part in (early, late) if ramp else (t,):  # no step across the corner
            run = solve_ivp(rate, (part[0], part[-1]), state, "DOP853", t_eval=part, rtol=1e-11, atol=1e-13)
            theta, state = np.concatenate([theta, run.y[0, 1:]]), run.y[:, -1]
        F_x, F_y = _force(kind, end, size, ramp)
        e = theta - math.atan2(-F_x, biped.M * 9.81 - F_y)
        band, corner = 0.02 * np.abs(e).max(), round(1000 * ramp)
        outside = [k for k in range(corner, 6001) if abs(e[k]) > band]
        settling = math.inf if outside and outside[-1] == 6000 else (outside[-1] + 1 - corner if outside else 0) * 1e-3
        past = max(0.0, *(-np.sign(e[corner]) * e[corner:]))
        rows = {row.id: row for row in judge(replace(SLOPE, scenarios=(made,)), K, "all").rows}
        assert (rows["settling"].value or math.inf) == pytest.approx(settling or math.inf, abs=1.001e-3)
        assert rows["overshoot"].value == pytest.approx(math.degrees(past), abs=1e-7)
        assert rows["posture-error"].value == pytest.approx(math.degrees(abs(e[-1])), abs=1e-7)
