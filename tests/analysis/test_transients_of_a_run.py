"""Settling, overshoot and what is left, on runs whose answers are known."""

import math
from dataclasses import replace

import pytest

from design.analysis.simulate import simulate
from design.analysis.transient import transient
from design.analysis.verdict import judge
from design.model.closed_loop import closed_loop
from design.model.environment import slope
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
