"""Speed as ratios to a peer in the same run; skipped unless asked for with ``--benchmark-only``.

Each test prints what it measured, and fails if the ratio that users were promised is missed.
"""

import resource
import subprocess
import sys
import time
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from design.analysis.simulate import simulate
from design.model.closed_loop import closed_loop
from design.model.laws import Gains
from design.spec.load import load
from design.spec.setting import setting
from problems import gains as question

SLOPE = setting(load("slope").spec)
PAPER = Gains(3500.0, 1200.0, 1.0)
ROOT = Path(__file__).resolve().parents[2]


def _best(function, repeats=3):
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


def test_simulation_against_python_control(benchmark, capsys):
    control = pytest.importorskip("control")
    loop = closed_loop(SLOPE.biped, "force")
    b, scenario = SLOPE.biped, SLOPE.scenarios[0]
    t = scenario.steps(SLOPE.step).t
    alpha = np.radians(30.0) * np.minimum(t / 5.0, 1.0)

    def rate(_t, x, u, _params):
        tau = -1200.0 * x[1] - 3500.0 * x[0] + x[2]
        force_x, force_y = b.M * b.g * np.sin(u[0]), b.M * b.g * (1 - np.cos(u[0]))
        turn = ((b.M * b.g - force_y) * b.L * np.sin(x[0]) + force_x * b.L * np.cos(x[0]) + tau) / b.I
        return np.array([x[1], turn, tau / b.ell])

    system = control.NonlinearIOSystem(rate, None, inputs=1, outputs=3, states=3)
    theirs = _best(lambda: control.input_output_response(system, t, alpha, np.zeros(3)), 2)
    benchmark(lambda: simulate(loop, scenario, PAPER, SLOPE.step))
    ours = benchmark.stats.stats.median
    with capsys.disabled():
        sys.stdout.write(f"\n10 s at 1 ms: {ours:.4f} s; python-control {theirs:.3f} s; ratio {theirs / ours:.1f}\n")
    assert theirs / ours >= 15


def test_synthesis_against_all_rows_at_once(benchmark, capsys):
    def ours():
        return question.solve(SLOPE, starts=1).outcome.value.value

    value = benchmark.pedantic(ours, rounds=3, warmup_rounds=1)
    mine = benchmark.stats.stats.median
    start = time.perf_counter()
    theirs_value = _all_rows_at_once()
    theirs = time.perf_counter() - start
    with capsys.disabled():
        sys.stdout.write(f"\none start: {mine:.2f} s ({value:.4f} N); all rows at once {theirs:.1f} s")
        sys.stdout.write(f" ({theirs_value:.4f} N); ratio {theirs / mine:.1f}\n")
    assert value == pytest.approx(theirs_value, abs=1e-3)
    assert theirs / mine >= 10


def _all_rows_at_once():
    """The plain formulation: one IPOPT call that sees both forces at all 10,001 samples."""
    loop, scenario = closed_loop(SLOPE.biped, "force"), SLOPE.scenarios[0]
    steps = scenario.steps(SLOPE.step)
    scale = np.array([3500.0, 1200.0, 17.0])
    u, v = ca.MX.sym("u", 3), ca.MX.sym("v")
    K, count = u * scale, len(steps.h)
    inputs = ca.DM(np.vstack([steps.h, steps.start, steps.middle, steps.end]))
    z = loop.step.mapaccum("march", count)(ca.DM.zeros(3), inputs, ca.repmat(K, 1, count))
    y = loop.readout.map(count)(z, ca.DM(steps.force[:, 1:]), ca.repmat(K, 1, count))
    rows = ca.vec(y[1:, :]) / SLOPE.biped.weight - v
    posed = {"x": ca.vertcat(u, v), "f": -v, "g": rows}
    solver = ca.nlpsol("plain", "ipopt", posed, {"ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes"})
    start = [0.9, 0.8, 0.3, 0.1]
    answer = solver(x0=start, lbx=[1e-3, 1e-3, 1e-3, 0], ubx=[1, 1, 1, 1], lbg=0, ubg=np.inf)
    return float(answer["x"][3]) * SLOPE.biped.weight


def test_help_is_quick(benchmark, capsys):
    def run():
        subprocess.run([sys.executable, "cli.py", "--help"], cwd=ROOT, check=True, capture_output=True)

    def bare():
        subprocess.run([sys.executable, "-c", "import typer"], cwd=ROOT, check=True, capture_output=True)

    benchmark.pedantic(run, rounds=5, warmup_rounds=1)
    mine, theirs = benchmark.stats.stats.median, _best(bare)
    with capsys.disabled():
        sys.stdout.write(f"\npoise --help: {mine:.3f} s; python importing typer: {theirs:.3f} s; {mine / theirs:.2f}\n")
    assert mine < 0.5


def test_synthesize_slope_as_a_command(benchmark, capsys):
    def run():
        subprocess.run([sys.executable, "cli.py", "synthesize", "slope"], cwd=ROOT, check=True, capture_output=True)

    def bare():
        code = "import casadi, scipy.integrate, pydantic, typer"
        subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True, capture_output=True)

    benchmark.pedantic(run, rounds=3, warmup_rounds=1)
    mine, theirs = benchmark.stats.stats.median, _best(bare)
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    with capsys.disabled():
        sys.stdout.write(f"\nsynthesize slope: {mine:.2f} s; its imports alone {theirs:.2f} s; peak {peak:.0f} MiB\n")
    assert mine < 5.0
    assert peak < 600
