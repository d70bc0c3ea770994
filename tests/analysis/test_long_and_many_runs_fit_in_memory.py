"""Memory is for one run at a time: more scenarios take no more, and results are written as they come."""

import csv
import io
import json
import tracemalloc
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from design.analysis.simulate import MARCH, simulate
from design.analysis.verdict import judge
from design.present import simulation, store, text
from design.spec.load import load
from design.spec.setting import setting

SLOPE = setting(load("slope").spec)


def _scenarios(count, duration):
    first = SLOPE.scenarios[0]
    return tuple(
        replace(first, name=f"s{k}", angle=first.angle * (k + 1) / count, duration=duration) for k in range(count)
    )


def _peak(act):
    act()  # what is built once is not counted
    tracemalloc.start()
    act()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


@pytest.mark.parametrize("steps", [1, 2, 249, 250, 251, MARCH, MARCH + 1, 2 * MARCH + 7])
def test_a_run_in_blocks_is_the_steps_one_after_the_other(steps):
    scenario = replace(SLOPE.scenarios[0], duration=1e-3 * steps)
    loop, gains = SLOPE.loop(), SLOPE.given_gains()
    run = simulate(loop, scenario, gains, 1e-3)
    parts = scenario.steps(1e-3)
    z = np.array(loop.start(scenario.theta0, scenario.omega0))
    for k, h in enumerate(parts.h):
        tau, F_T, F_H = loop.readout(z, parts.force[:, k], ca.DM(gains)).full().ravel()
        assert (run.theta[k], run.omega[k], run.s[k]) == tuple(z)
        assert (run.tau[k], run.F_T[k], run.F_H[k]) == (tau, F_T, F_H)
        z = loop.step(z, [h, *parts.start[:, k], *parts.middle[:, k], *parts.end[:, k]], ca.DM(gains)).full().ravel()
    assert len(run.t) == len(parts.h) + 1
    assert (run.theta[-1], run.omega[-1], run.s[-1]) == tuple(z)


@pytest.mark.slow
def test_a_verdict_on_five_times_the_scenarios_takes_no_more_memory():
    few, many = (replace(SLOPE, scenarios=_scenarios(count, 2.0)) for count in (3, 15))
    small, large = (_peak(lambda each=each: judge(each, SLOPE.given_gains())) for each in (few, many))
    assert large < 1.5 * small


def test_a_verdict_keeps_its_runs_where_they_are_to_be_drawn():
    kept = judge(SLOPE, SLOPE.given_gains(), drawn=True)
    assert [run.scenario for run in kept.trajectories] == [scenario.name for scenario in SLOPE.scenarios]
    assert kept.series
    assert judge(SLOPE, SLOPE.given_gains()).rows == kept.rows


@pytest.mark.slow
@pytest.mark.parametrize("form", ["text", "csv", "json"])
def test_simulated_scenarios_are_written_one_by_one(form, tmp_path):
    source = load("slope").text.split("[[scenarios]]")[0]
    sizes = []
    for count in (2, 8):
        names = "".join(
            f'[[scenarios]]\nname = "s{k}"\nkind = "slope"\nangle_deg = {k + 1}\nramp_s = 1.0\nduration_s = 2.0\n'
            for k in range(count)
        )
        place = tmp_path / f"{count}.toml"
        body = load("slope").text
        rest = body[body.index("[law]") :]
        place.write_text(source + names + rest)

        def written(place=place):
            return sum(len(part) for part in simulation.render(str(place), None, None, None, form, None, None, None))

        sizes.append(_peak(written))
    assert sizes[1] < 1.3 * sizes[0]


def test_columns_in_blocks_are_the_whole_columns(monkeypatch):
    runs = [simulate(SLOPE.loop(), each, SLOPE.given_gains(), 1e-2) for each in _scenarios(2, 0.5)]
    monkeypatch.setattr(text, "BLOCK", 7)
    rows = list(csv.DictReader(io.StringIO("".join(text.csv_parts(runs, several=True)))))
    assert [row["scenario"] for row in rows] == [run.scenario for run in runs for _ in run.t]
    for name, get in (("time_s", "t"), ("theta_rad", "theta"), ("heel_force_n", "F_H"), ("slope_rad", "alpha")):
        assert [float(row[name]) for row in rows] == np.concatenate([getattr(run, get) for run in runs]).tolist()


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner, max_size=4),
    max_leaves=12,
)


@given(document=st.dictionaries(st.text(max_size=4), JSON, max_size=4))
def test_json_in_parts_is_what_the_standard_library_writes(document):
    assert store.dumps(document) == json.dumps(document, indent=1, ensure_ascii=False) + "\n"


@pytest.mark.parametrize("count", [0, 1, 6, 7, 8, 21])
def test_json_of_arrays_and_of_what_comes_one_by_one_is_that_of_lists(count, monkeypatch):
    monkeypatch.setattr(store, "BLOCK", 7)
    values = np.arange(count) / 3
    for given_, plain in (
        (values, values.tolist()),
        (np.where(values > 1, np.nan, values), [None if x > 1 else x for x in values.tolist()]),
        (values.astype(int), values.astype(int).tolist()),
        (values > 1, (values > 1).tolist()),
        (np.outer(values, values), np.outer(values, values).tolist()),
        (iter(values.tolist()), values.tolist()),
        ((), []),
        (np.float64(0.5), 0.5),
        (np.array(2), 2),
    ):
        assert store.dumps({"a": [given_]}) == json.dumps({"a": [plain]}, indent=1) + "\n"
