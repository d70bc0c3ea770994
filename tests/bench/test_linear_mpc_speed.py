"""A step of the linear prediction against do-mpc's for the same problem; skipped unless asked for."""

import math
import sys
import time
from functools import partial

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
    ahead = horizon(PAPER, TUNING, Actuator(period=TUNING.step), {"contact-force": Required(level=0.0)})
    planners = {"as it is": LinearPlanner(horizon=ahead), "QP always": LinearPlanner(horizon=ahead, shortcut=False)}
    peer = _do_mpc(do_mpc, model, theta_f)

    def our_step(e, before, which="QP always"):
        outcome = planners[which].plan(0.0, Belief(theta_f + e[0], e[1], *FORCE), before, None)
        assert outcome.status is Status.SOLVED
        return float(outcome.value.torque[0])

    states, torques = [np.array([-theta_f, 0.0])], [0.0]
    for _ in range(60):  # the closed loop from rest, by the linear model
        torques.append(our_step(states[-1], torques[-1]))
        states.append(model.Ad @ states[-1] + model.Bd * torques[-1])

    def along(step):
        """Times and torques at each state of that loop."""
        times, found = [], []
        for e, before in zip(states[:-1], torques[:-1], strict=True):
            began = time.perf_counter()
            found.append(step(e, before))
            times.append(time.perf_counter() - began)
        return np.array(times), np.array(found)

    peer.x0 = np.array([-theta_f, 0.0])
    peer.set_initial_guess()
    theirs, their_torques = along(lambda e, _: float(peer.make_step(e.reshape(2, 1))[0, 0]))
    along(our_step)

    def run():
        return {which: [along(partial(our_step, which=which)) for _ in range(10)] for which in planners}

    rounds = benchmark.pedantic(run, rounds=1, warmup_rounds=3)
    differing = max(np.abs(each[0][1] - their_torques).max() for each in rounds.values())
    with capsys.disabled():
        sys.stdout.write(f"\nlinear step, 50 x 20 ms, from rest on 6.5 degrees; do-mpc {1e3 * theirs.mean():.1f} ms\n")
        ratios, longest = {}, {}
        for which, each in rounds.items():
            mine = np.concatenate([times for times, _ in each])
            ratios[which], longest[which] = theirs.mean() / mine.mean(), 1e3 * np.quantile(mine, 0.99)
            sys.stdout.write(
                f"  {which}: mean {1e3 * mine.mean():.3f} ms, 99 % {longest[which]:.3f} ms, ratio {ratios[which]:.0f}\n"
            )
        sys.stdout.write(f"  torques differ by at most {differing:.1e} N m\n")
    assert differing < 0.5  # the first row is linearised at the state by us, at the posture by the peer
    assert ratios["as it is"] >= 25
    assert ratios["QP always"] >= 15
    assert longest["as it is"] < 1.0
