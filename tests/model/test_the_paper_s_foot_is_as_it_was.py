"""For the paper's foot and P_d = 0 forces, laws and runs are those of its equations, to the last digit.

(5), (6), (9), (11), (18) and (20) are written out here as they stand in the paper, with (2) and (7), and marched by the
same Runge-Kutta step.
"""

import math

import casadi as ca
import numpy as np
import pytest

from design.analysis.estimate import static_estimate
from design.analysis.simulate import simulate
from design.analysis.verdict import judge
from design.model import closed_loop as loops
from design.model.broken_loop import breaks
from design.model.limits import limits
from design.model.plant import plant
from design.model.stability import characteristic, closed_loop_matrix, routh_hurwitz
from design.spec.load import builtin_names, load
from design.spec.setting import setting

PLAIN = [name for name in builtin_names() if name != "adult-foot"]


def printed(b):
    """(x, tau, F) -> theta'', F_T, F_H, P, f_x as printed."""
    x, tau, F = ca.SX.sym("x", 2), ca.SX.sym("tau"), ca.SX.sym("F", 2)
    theta, omega = ca.vertsplit(x)
    acceleration = ((b.M * b.g - F[1]) * b.L * ca.sin(theta) + F[0] * b.L * ca.cos(theta) + tau) / b.I
    f_y = -b.M * b.L * acceleration * ca.sin(theta) - b.M * b.L * omega**2 * ca.cos(theta) + b.M * b.g - F[1]
    F_T = -tau / (2 * b.ell) + b.m * b.g / 2 + f_y / 2
    F_H = tau / (2 * b.ell) + b.m * b.g / 2 + f_y / 2
    P = (F_T - F_H) * b.ell / (F_T + F_H)
    f_x = b.M * b.L * (acceleration * ca.cos(theta) - omega**2 * ca.sin(theta)) - F[0]
    return ca.Function("printed", [x, tau, F], [acceleration, F_T, F_H, P, f_x])


def march(b, kind, theta_d, K, scenario, step):
    """theta, omega, s, F_T and F_H (5, N+1) of the printed loop."""
    z, F, u = ca.SX.sym("z", 3), ca.SX.sym("F", 2), ca.SX.sym("u", 7)
    posture = -K.K_d * z[1] + K.K_p * (theta_d - z[0])
    pull = {"pd": 0.0, "force": K.K_f, "cop": K.K_f * (b.weight / b.ell)}[kind]
    tau = posture if kind == "pd" else posture + pull * z[2]
    acceleration, F_T, F_H, _, _ = printed(b)(z[:2], tau, F)
    gathering = {"pd": 0.0 * F_T, "force": F_H - F_T, "cop": -(F_T - F_H) * b.ell / (F_T + F_H)}[kind]
    rate = ca.Function("rate", [z, F], [ca.vertcat(z[1], acceleration, gathering)], {"cse": True})
    h = u[0]
    k1 = rate(z, u[1:3])
    k2 = rate(z + h / 2 * k1, u[3:5])
    k3 = rate(z + h / 2 * k2, u[3:5])
    k4 = rate(z + h * k3, u[5:7])
    following = ca.Function("step", [z, u], [z + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)], {"cse": True})
    seen = ca.Function("seen", [z, F], [ca.vertcat(z, F_T, F_H)], {"cse": True})
    steps = scenario.steps(step)
    state, found = np.array([scenario.theta0, scenario.omega0, 0.0]), []
    for k in range(len(steps.h) + 1):
        found.append(seen(state, steps.force[:, k]).full().ravel())
        if k < len(steps.h):
            column = np.concatenate([[steps.h[k]], steps.start[:, k], steps.middle[:, k], steps.end[:, k]])
            state = following(state, column).full().ravel()
    return np.array(found).T


@pytest.mark.parametrize("name", PLAIN)
def test_forces_and_rows_are_the_printed_ones_to_the_last_digit(name):
    biped = setting(load(name).spec).biped
    body, as_printed = plant(biped), printed(biped)
    rows = {limit.id: limit.quantity for limit in limits(body, {})}
    draw = np.random.default_rng(1)
    for _ in range(200):
        x, tau, F = draw.normal(size=2) * [0.3, 1.0], float(draw.normal() * 60), draw.normal(size=2) * 100
        acceleration, F_T, F_H, P, f_x = (float(part) for part in as_printed(x, tau, F))
        assert body.dynamics(x, tau, F).full().ravel().tolist() == [x[1], acceleration]
        assert body.forces(x, tau, F).full().ravel().tolist() == [F_T, F_H]
        assert float(body.cop(x, tau, F)) == P == biped.pressure(F_T, F_H)
        assert float(body.friction(x, tau, F)) == f_x
        assert rows["cop-margin"](x, tau, F).full().ravel().tolist() == [biped.ell - P, biped.ell + P]
        assert biped.behind(F_T, F_H) == biped.ell * (F_H - F_T)


@pytest.mark.parametrize("name", PLAIN)
@pytest.mark.parametrize("kind", ["pd", "force", "cop"])
def test_a_run_is_the_printed_loop_s_to_the_last_digit(name, kind):
    its = setting(load(name).spec)
    gains, scenario = its.given_gains(), its.scenarios[0]
    gains = gains._replace(K_f=0.0) if kind == "pd" else gains
    found = march(its.biped, kind, its.theta_d, gains, scenario, 5e-3)
    run = simulate(loops.closed_loop(its.biped, kind, its.theta_d), scenario, gains, 5e-3)
    n = len(run.t)
    for mine, expected in zip((run.theta, run.omega, run.s, run.F_T, run.F_H), found, strict=True):
        assert np.array_equal(mine, expected[:n])
    ratio = -(run.F_H + run.F_T - its.biped.m * its.biped.g) * np.tan(run.theta)
    assert np.array_equal(np.vstack(static_estimate(its.biped, run.theta, run.F_T, run.F_H))[0], ratio)


@pytest.mark.parametrize("name", PLAIN)
def test_the_linear_loop_is_the_printed_one_to_the_last_digit(name):
    its = setting(load(name).spec)
    b, K = its.biped, its.given_gains()
    for scenario in its.scenarios:
        for A, load_, beta in its.places(scenario):
            assert beta == 0.0
            expected = K.K_d / b.I - K.K_f / b.ell, (K.K_p - A * b.L) / b.I, K.K_f * (A * b.L / (b.I * b.ell))
            assert characteristic(b, "force", K, A, load_, math.inf, beta) == expected
            torque = np.array([-K.K_p, -K.K_d, K.K_f])
            matrix = np.array([[0, 1, 0], torque / b.I + np.array([A * b.L / b.I, 0, 0]), torque * (1.0 / b.ell)])
            assert np.array_equal(closed_loop_matrix(b, "force", K, A, load_), matrix)
            pairs = routh_hurwitz(b, "force", K, A, load_, beta)
            assert pairs["routh"] == [((K.K_d * b.ell - K.K_f * b.I) * K.K_p, K.K_d * b.ell * (A * b.L))]
            assert pairs["damping"][0] == (b.ell / b.I * K.K_d, K.K_f)
            force = breaks(b, "force", K, A, load_, math.inf, beta)["force"].Q.coef
            assert force.tolist() == [-(K.K_f / b.ell) * -(A * b.L), 0.0, -(K.K_f / b.ell) * b.I]


def test_a_report_names_no_row_of_the_paper_s_foot_otherwise():
    its = setting(load("slope").spec)
    rows = {row.id: row for row in judge(its, its.given_gains()).rows}
    assert (rows["damping"].basis, rows["damping"].note) == ("exact", "")
