"""Speed of predictive control as a ratio to a peer in the same run; skipped unless asked for with ``--benchmark-only``.

Each test prints what it measured, and fails if the ratio that users were promised is missed.
"""

import runpy
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import scipy.integrate

from design.analysis.observer import Belief
from design.model.actuator import Actuator
from design.model.body import Biped
from design.model.tuning import Tuning
from problems.mpc_nonlinear import planner
from problems.prediction import horizon

BIPED = Biped(M=50.0, L=0.75, I=7.03125, m=0.1, ell=0.1)
USUAL = horizon(BIPED, Tuning(step=0.02, horizon=40), Actuator(period=0.02), {})
FORCE = BIPED.M * BIPED.g * np.sin(np.radians(5)), BIPED.M * BIPED.g * (1 - np.cos(np.radians(5)))
PERIODS = 60


def _afterwards(x, tau):
    """The state after a step, and a push that keeps the planners at work."""

    def rate(_t, x):
        down = BIPED.M * BIPED.g - FORCE[1]
        return [x[1], (BIPED.L * (down * np.sin(x[0]) + FORCE[0] * np.cos(x[0])) + tau) / BIPED.I]

    return scipy.integrate.solve_ivp(rate, (0, 0.02), x, method="DOP853", rtol=1e-9, atol=1e-12).y[:, -1]


def _along(step, states=None):
    """Seconds a step, torques, and states of a closed-loop run; ``states`` are the run's where given."""
    pushes = np.random.default_rng(0).normal(size=(PERIODS, 2)) * [2e-4, 2e-3]
    x, times, torques, passed = np.zeros(2), [], [], []
    for k in range(PERIODS):
        x = x if states is None else states[k]
        start = time.perf_counter()
        tau = step(0.02 * k, x)
        times.append(time.perf_counter() - start)
        torques.append(tau)
        passed.append(x)
        x = _afterwards(x, tau) + pushes[k]
    return np.array(times), np.array(torques), passed


@pytest.mark.filterwarnings("ignore")
def test_nonlinear_step_against_do_mpc(benchmark, capsys):
    do_mpc = pytest.importorskip("do_mpc")
    ours = planner(USUAL)

    def run(states=None):
        memory = {"previous": None, "before": 0.0}

        def step(t, x):
            plan = ours.plan(t, Belief(*x, *FORCE), memory["before"], memory["previous"]).value
            memory.update(previous=plan, before=plan.torque[0])
            return float(plan.torque[0])

        return _along(step, states)

    _, torques, states = run()
    peer = runpy.run_path(str(Path(__file__).parents[1] / "problems" / "peer_do_mpc.py"))["do_mpc_of"](
        do_mpc, USUAL, FORCE
    )
    peer.x0 = states[0]
    peer.set_initial_guess()
    theirs, their_torques, _ = _along(lambda _t, x: float(peer.make_step(x.reshape(-1, 1))[0, 0]), states)
    mine = benchmark.pedantic(lambda: run(states)[0], rounds=3, warmup_rounds=1)
    usual, longest = np.median(mine), mine.max()
    ratio = np.median(theirs) / usual
    with capsys.disabled():
        sys.stdout.write(f"\nnonlinear step, 40 x 20 ms: {1e3 * usual:.2f} ms (longest {1e3 * longest:.2f} ms);")
        sys.stdout.write(f" do-mpc {1e3 * np.median(theirs):.1f} ms (longest {1e3 * theirs.max():.1f} ms);")
        sys.stdout.write(f" ratio {ratio:.1f}; torques differ by {np.abs(torques - their_torques).max():.1e} N m\n")
    assert torques == pytest.approx(their_torques, abs=0.02)  # do-mpc's own tolerance is IPOPT's 1e-8
    assert ratio >= 15
