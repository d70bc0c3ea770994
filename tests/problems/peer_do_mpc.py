"""The nonlinear prediction posed in do-mpc, for a force that is held and limits that can be met."""

import casadi as ca
import numpy as np

from design.model.plant import plant
from problems.prediction import PENALTY, posture, stationary


def do_mpc_of(do_mpc, posed, force, ipopt=None, *, keep=False):
    """do-mpc's controller, ready but for its initial state; its slacks are one a row instead of one for all.

    ``keep``: its predictions can be asked for.
    """
    biped, tuning = posed.biped, posed.tuning
    A, theta_f = stationary(biped, *force)
    about, rate, F = posture(biped, tuning, A), plant(biped).dynamics, ca.DM(list(force))

    model = do_mpc.model.Model("discrete", "SX")
    theta, omega = model.set_variable("_x", "theta"), model.set_variable("_x", "omega")
    tau = model.set_variable("_u", "tau")
    x, h = ca.vertcat(theta, omega), tuning.step
    k1 = rate(x, tau, F)
    k2 = rate(x + h / 2 * k1, tau, F)
    k3 = rate(x + h / 2 * k2, tau, F)
    k4 = rate(x + h * k3, tau, F)
    following = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    model.set_rhs("theta", following[0])
    model.set_rhs("omega", following[1])
    model.setup()

    mpc = do_mpc.controller.MPC(model)
    mpc.settings.n_horizon = tuning.horizon
    mpc.settings.t_step = h
    mpc.settings.state_discretization = "discrete"
    mpc.settings.store_full_solution = keep
    mpc.settings.nlpsol_opts = {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": 0, **(ipopt or {})}
    scale = np.array([0.1, 0.7])
    mpc.scaling["_x", "theta"], mpc.scaling["_x", "omega"], mpc.scaling["_u", "tau"] = *scale, 37.0

    theta, omega, tau = model.x["theta"], model.x["omega"], model.u["tau"]
    e, Omega, AL = theta - theta_f, about.Omega, about.AL
    away = ca.vertcat(e, omega)
    stage = e**2 + tuning.rate * (omega / Omega) ** 2 + tuning.torque * (tau / AL) ** 2
    mpc.set_objective(mterm=100 * ca.bilin(ca.DM(about.P), away), lterm=100 * stage)
    mpc.set_rterm(tau=0.0)
    for limit, level in posed.rows:
        margin = limit.margin(limit.quantity(ca.vertcat(theta, omega), tau, F), level) / limit.scale
        mpc.set_nl_cons(limit.id, -margin, ub=0, soft_constraint=True, penalty_term_cons=100 * PENALTY)
    mpc.prepare_nlp()
    end = mpc.opt_x["_x", -1, 0, -1] * scale
    xi = end[0] - theta_f + end[1] / Omega
    for limit, level in posed.rows:
        for at in (end, ca.vertcat(theta_f + xi, 0)):
            mpc.nlp_cons.append(limit.margin(limit.quantity(at, -AL * xi, F), level) / limit.scale)
            mpc.nlp_cons_lb.append(np.zeros((1, 1)))
            mpc.nlp_cons_ub.append(np.full((1, 1), np.inf))
    mpc.create_nlp()
    return mpc
