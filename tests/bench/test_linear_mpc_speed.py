"""A step of the linear prediction against do-mpc's for the same problem; skipped unless asked for."""

import math
import sys
import time

import casadi as ca
import numpy as np
import pytest

from design.analysis.observer import Belief
from design.model.actuator import Actuator
from design.model.body import Biped
from design.model.limits import Required
from design.model.plant import plant
from design.model.tuning import Tuning
from design.solvers.outcome import Status
from problems.mpc_linear import LinearPlanner
from problems.prediction import PENALTY, horizon, posture, stationary

PAPER = Biped(M=50.0, L=0.75, I=7.03125, m=0.1, ell=0.1)
TUNING = Tuning()
ANGLE = math.radians(6.5)
FORCE = (PAPER.M * PAPER.g * math.sin(ANGLE), PAPER.M * PAPER.g * (1 - math.cos(ANGLE)))


def _do_mpc(do_mpc, model, theta_f):
    """The same cost, dynamics and contact rows; the terminal set, which does not bind here, is left out."""
    plan = do_mpc.model.Model("discrete")
    x = plan.set_variable("_x", "x", shape=(2, 1))
    tau = plan.set_variable("_u", "tau")
    plan.set_rhs("x", ca.DM(model.Ad) @ x + ca.DM(model.Bd) * tau)
    plan.setup()
    mpc = do_mpc.controller.MPC(plan)
    mpc.settings.supress_ipopt_output()
    mpc.set_param(n_horizon=TUNING.horizon, t_step=TUNING.step, store_full_solution=False)
    mpc.set_objective(lterm=x.T @ ca.DM(model.Q) @ x + model.R * tau**2, mterm=x.T @ ca.DM(model.P) @ x)
    mpc.set_rterm(tau=0.0)
    forces = plant(PAPER).forces
    step = 1e-6
    base = forces([theta_f, 0.0], 0.0, FORCE)
    d_theta = (forces([theta_f + step, 0.0], 0.0, FORCE) - base) / step
    d_tau = forces([theta_f, 0.0], 1.0, FORCE) - base
    rows = base + d_theta * x[0] + d_tau * tau - TUNING.contact * PAPER.weight
    for k in range(2):
        mpc.set_nl_cons(f"contact{k}", -rows[k] / PAPER.weight, ub=0.0, soft_constraint=True, penalty_term_cons=PENALTY)
    mpc.scaling["_u", "tau"] = PAPER.weight * PAPER.ell
    mpc.setup()
    return mpc


@pytest.mark.filterwarnings("ignore")
def test_linear_step_against_do_mpc(benchmark, capsys):
    do_mpc = pytest.importorskip("do_mpc", reason="do-mpc is not installed")
    A, theta_f = stationary(PAPER, *FORCE)
    model = posture(PAPER, TUNING, PAPER.weight * math.exp(0.005 * round(math.log(A / PAPER.weight) / 0.005)))
    ours = LinearPlanner(
        horizon=horizon(PAPER, TUNING, Actuator(period=TUNING.step), {"contact-force": Required(level=0.0)}),
        shortcut=False,  # the QP is solved at every step
    )
    peer = _do_mpc(do_mpc, model, theta_f)

    def closed(step):
        """Times and torques along the closed loop of the linear model from rest."""
        e, before, times, torques = np.array([-theta_f, 0.0]), 0.0, [], []
        for _ in range(60):
            began = time.perf_counter()
            before = step(e, before)
            times.append(time.perf_counter() - began)
            torques.append(before)
            e = model.Ad @ e + model.Bd * before
        return np.array(times), np.array(torques)

    def our_step(e, before):
        outcome = ours.plan(0.0, Belief(theta_f + e[0], e[1], *FORCE), before, None)
        assert outcome.status is Status.SOLVED
        return float(outcome.value.torque[0])

    peer.x0 = np.array([-theta_f, 0.0])
    peer.set_initial_guess()
    theirs, their_torques = closed(lambda e, _: float(peer.make_step(e.reshape(2, 1))[0, 0]))
    closed(our_step)
    rounds = benchmark.pedantic(lambda: [closed(our_step) for _ in range(10)], rounds=1)
    mine = np.concatenate([times for times, _ in rounds])
    ratio = np.median(theirs) / np.median(mine)
    p99 = 1e3 * np.quantile(mine, 0.99)
    differing = np.abs(rounds[0][1] - their_torques).max()
    with capsys.disabled():
        sys.stdout.write(
            f"\nlinear step, 50 x 20 ms: {1e3 * np.median(mine):.3f} ms, 99 % {p99:.3f} ms; do-mpc"
            f" {1e3 * np.median(theirs):.1f} ms; ratio {ratio:.0f}; torques differ by at most {differing:.1e} N m\n"
        )
    assert differing < 0.5  # the first row is linearised at the state by us, at the posture by the peer
    assert ratio >= 25
    assert p99 < 1.0
