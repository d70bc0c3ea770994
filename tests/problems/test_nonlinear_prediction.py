"""The nonlinear plan is the optimum of the prediction as it is stated, and nothing else is ever called solved."""

import math
import runpy
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
import scipy.integrate
import scipy.linalg

from design.analysis.observer import Belief
from design.model.actuator import Actuator
from design.model.body import Biped
from design.model.limits import Required
from design.model.tuning import Tuning
from design.solvers.outcome import Status
from problems.mpc_linear import GRID, LinearPlanner
from problems.mpc_nonlinear import planner
from problems.prediction import horizon, posture, stationary

BIPED = Biped(M=50.0, L=0.75, I=7.03125, m=0.1, ell=0.1)
HELD = Actuator(period=0.02)
WEAK = Actuator(period=0.005, torque=47.0, rate=1500.0)
SHORT = horizon(BIPED, Tuning(horizon=20), HELD, {})
SHORT_WEAK = horizon(BIPED, Tuning(horizon=20), WEAK, {})
SHORT_MANY = horizon(
    BIPED, Tuning(horizon=20), WEAK,
    {"contact-force": Required(level=20.0), "cop-margin": Required(level=0.02), "friction": Required(level=0.15)},
)  # fmt: skip
USUAL = horizon(BIPED, Tuning(horizon=40), HELD, {})


def slope(degrees):
    alpha = math.radians(degrees)
    return BIPED.M * BIPED.g * math.sin(alpha), BIPED.M * BIPED.g * (1 - math.cos(alpha))


def gust(count):
    rise = 60.0 * np.sin(np.linspace(0.0, 2.5, count + 1))
    return np.stack([rise, 0.3 * rise])


STATES = {
    "falls forward": Belief(0.04, 0.05, 0.0, 0.0),
    "moves backward": Belief(-0.03, -0.1, 0.0, 0.0),
    "slope of 3 degrees": Belief(0.0, 0.0, *slope(3)),
    "slope of 6 degrees": Belief(0.0, 0.0, *slope(6)),
    "slope of 9 degrees": Belief(0.0, 0.0, *slope(9)),
    "wind and load": Belief(-0.05, 0.1, 23.0, -41.0),
    "gust ahead": Belief(-0.01, 0.0, 0.0, 0.0, gust(20)),
}


def single_shooting(posed, belief, before):
    """The same statement with the equations of the paper written out, torques as the only unknowns, solved by IPOPT."""
    M, L, I, m, ell, g = BIPED.M, BIPED.L, BIPED.I, BIPED.m, BIPED.ell, BIPED.g
    tuning, actuator, N = posed.tuning, posed.actuator, posed.tuning.horizon
    required = {limit.id: level for limit, level in posed.rows}
    F = np.tile([[belief.F_x], [belief.F_y]], N + 1) if belief.ahead is None else belief.ahead
    size = math.hypot(M * g - F[1, 0], F[0, 0])
    lean = np.arctan2(-F[0], M * g - F[1])
    Omega = math.sqrt(size * L / I)
    A = np.array([[0, 1, 0], [Omega**2, 0, 1 / I], [0, 0, 0]])
    exact = scipy.linalg.expm(A * tuning.step)
    Q, R = np.diag([1.0, tuning.rate / Omega**2]), tuning.torque / (size * L) ** 2
    P = scipy.linalg.solve_discrete_are(exact[:2, :2], exact[:2, 2:], Q, [[R]])
    K = np.linalg.solve(R + exact[:2, 2:].T @ P @ exact[:2, 2:], exact[:2, 2:].T @ P @ exact[:2, :2]).ravel()

    def turning(theta, tau, F_x, F_y):
        return ((M * g - F_y) * L * ca.sin(theta) + F_x * L * ca.cos(theta) + tau) / I

    def margins(theta, omega, tau, F_x, F_y):
        acceleration = turning(theta, tau, F_x, F_y)
        along = M * L * (acceleration * ca.cos(theta) - omega**2 * ca.sin(theta)) - F_x
        f_y = M * g - F_y - M * L * (acceleration * ca.sin(theta) + omega**2 * ca.cos(theta))
        toe, heel = (m * g + f_y) / 2 - tau / (2 * ell), (m * g + f_y) / 2 + tau / (2 * ell)
        weight, load = (M + m) * g, toe + heel
        found = [(toe - required["toe-force"]) / weight, (heel - required["heel-force"]) / weight]
        if len(required) > 2:  # wishes: contact itself by a hundredth of its scale
            found += [(force - 0.01 * weight) / (0.01 * weight) for force in (toe, heel)]
        if "cop-margin" in required:
            P_cop = (toe - heel) * ell / load
            found += [(ell - P_cop - required["cop-margin"]) / ell, (ell + P_cop - required["cop-margin"]) / ell]
        if "friction" in required:
            found += [required["friction"] - along / load, required["friction"] + along / load]
        return found

    # torques are u less LQR's: the optimum is the same, and IPOPT finds it from zero
    u, sigma = ca.SX.sym("u", N), ca.SX.sym("sigma")
    theta, omega, last, cost, rows, torques = belief.theta, belief.omega, before, 0, [sigma], []
    foot, h = (M + m) * g * ell, tuning.step

    def limited(values, most):
        return [(most - value) / foot for value in (values, -values)] if math.isfinite(most) else []

    for k in range(N):
        tau = 40 * u[k] - K[0] * (theta - lean[k]) - K[1] * omega
        torques.append(tau)
        rows += [margin + sigma for margin in margins(theta, omega, tau, F[0, k], F[1, k])]
        rows += limited(tau, actuator.torque)
        rows += limited(tau - last, actuator.rate * (actuator.period if k == 0 else h))
        cost += (theta - lean[k]) ** 2 + tuning.rate * (omega / Omega) ** 2 + tuning.torque * (tau / (size * L)) ** 2
        forces = F[:, k], (F[:, k] + F[:, k + 1]) / 2, (F[:, k] + F[:, k + 1]) / 2, F[:, k + 1]
        slopes = []
        for part, force in zip((0, 0.5, 0.5, 1), forces, strict=True):
            a, b = (
                (theta, omega) if not slopes else (theta + part * h * slopes[-1][0], omega + part * h * slopes[-1][1])
            )
            slopes.append((b, turning(a, tau, *force)))
        theta, omega = (
            old + h / 6 * sum(w * s[i] for w, s in zip((1, 2, 2, 1), slopes, strict=True))
            for i, old in enumerate((theta, omega))
        )
        last = tau
    end = ca.vertcat(theta - lean[N], omega)
    xi = end[0] + end[1] / Omega
    hold = -size * L * xi
    for a, b in ((theta, omega), (lean[N] + xi, 0)):
        rows += [margin + sigma for margin in margins(a, b, hold, F[0, N], F[1, N])]
    rows += [row + sigma for row in limited(hold, actuator.torque) + limited(hold - last, actuator.rate * h)]
    cost += ca.bilin(ca.DM(P), end) + (1.0 if len(required) > 2 else 1000.0) * sigma
    options = {
        "ipopt.tol": 1e-10, "ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": False, "ipopt.mu_target": 0.0,
        "ipopt.bound_relax_factor": 0.0, "ipopt.compl_inf_tol": 1e-12, "ipopt.max_iter": 1000,
    }  # fmt: skip
    solver = ca.nlpsol("peer", "ipopt", {"x": ca.vertcat(u, sigma), "f": 1e4 * cost, "g": ca.vertcat(*rows)}, options)
    answer = solver(x0=np.append(np.zeros(N), 1.0), lbg=0)
    assert solver.stats()["return_status"] in ("Solve_Succeeded", "Search_Direction_Becomes_Too_Small")
    torque = ca.Function("torque", [u], [ca.vertcat(*torques)])
    return torque(answer["x"][:N]).full().ravel(), float(answer["x"][N])


@pytest.mark.parametrize("posed", [SHORT, SHORT_WEAK, SHORT_MANY], ids=["contact", "weak actuator", "many limits"])
@pytest.mark.parametrize("state", STATES)
def test_an_independent_single_shooting_gives_the_same_torques(posed, state):
    belief = STATES[state]
    torque, sigma = single_shooting(posed, belief, before=-35.0)
    outcome = planner(posed).plan(0.0, belief, -35.0, None)
    assert outcome.value.torque == pytest.approx(torque, abs=1e-4)
    assert ("broken" in outcome.detail) == (sigma > 1e-6)


def test_near_the_stationary_posture_the_torque_is_that_of_lqr():
    force = slope(4)
    A, theta_f = stationary(BIPED, *force)
    K = posture(BIPED, USUAL.tuning, A).K
    off = []
    for size in (0.08, 0.02, 0.005):
        x = np.array([size, -6 * size])
        first = planner(USUAL).plan(0.0, Belief(theta_f + x[0], x[1], *force), 0.0, None).value.torque[0]
        off.append(abs(first / -(K @ x) - 1))
    assert off[0] > 3 * off[1] > 6 * off[2]
    assert off[-1] < 1e-5


def margins_along(posed, plan, belief):
    """The least margin of any limit along a plan, by its scale."""
    F = ca.DM([belief.F_x, belief.F_y])
    return min(
        float(ca.mmin(limit.margin(limit.quantity(plan.states[:, k], plan.torque[k], F), level))) / limit.scale
        for limit, level in posed.rows
        for k in range(len(plan.torque))
    )


@pytest.mark.parametrize("degrees", [0.0, 2.0, 5.0, 7.0])
def test_limits_that_can_be_met_are_met(degrees):
    belief = Belief(0.0, 0.0, *slope(degrees))
    outcome = planner(USUAL).plan(0.0, belief, 0.0, None)
    assert margins_along(USUAL, outcome.value, belief) >= -1e-6
    assert "broken" not in outcome.detail


def test_limits_are_broken_as_little_as_can_be_where_they_cannot_be_met():
    belief = Belief(0.0, 0.0, *slope(9))  # beyond the 7.59 degrees of capturability
    outcome = planner(USUAL).plan(0.0, belief, 0.0, None)
    worst = margins_along(USUAL, outcome.value, belief)
    assert "broken" in outcome.detail
    assert -0.15 < worst < -0.01
    harder = Belief(0.0, 0.0, *slope(10))
    assert margins_along(USUAL, planner(USUAL).plan(0.0, harder, 0.0, None).value, harder) < worst


@pytest.mark.parametrize("ahead", [None, gust(40)], ids=["held", "gust"])
def test_the_planned_states_are_where_the_body_goes(ahead):
    force = slope(5) if ahead is None else (0.0, 0.0)
    plan = planner(USUAL).plan(0.0, Belief(0.0, 0.0, *force, ahead), 0.0, None).value
    forces = np.tile(np.array(force)[:, None], 41) if ahead is None else ahead
    on, h = plan.states[:, 0], plan.step
    for k, tau in enumerate(plan.torque):

        def rate(t, x, k=k, tau=tau):
            F_x, F_y = forces[:, k] + t / h * (forces[:, k + 1] - forces[:, k])
            down = BIPED.M * BIPED.g - F_y
            return [x[1], (BIPED.L * (down * math.sin(x[0]) + F_x * math.cos(x[0])) + tau) / BIPED.I]

        def after(x, rate=rate):
            return scipy.integrate.solve_ivp(rate, (0, h), x, method="DOP853", rtol=1e-11, atol=1e-13).y[:, -1]

        on = after(on)
        assert after(plan.states[:, k]) == pytest.approx(plan.states[:, k + 1], abs=1e-6)
    assert on == pytest.approx(plan.states[:, -1], abs=1e-3)  # e^(Omega N h) = 300 times as much


@pytest.mark.parametrize("late", [0.02, 0.005, 0.1])
@pytest.mark.parametrize("degrees", [3.0, 6.0])
def test_a_warm_start_ends_where_a_cold_one_does(late, degrees):
    make, force = planner(USUAL), slope(degrees)
    first = make.plan(1.0, Belief(0.0, 0.0, *force), 0.0, None).value
    x = [np.interp(late, first.step * np.arange(41), state) for state in first.states] + np.array([1e-3, -5e-3])
    belief = Belief(*x, *force)
    warm = make.plan(1.0 + late, belief, first.torque[0], first)
    cold = make.plan(1.0 + late, belief, first.torque[0], None)
    assert warm.value.torque == pytest.approx(cold.value.torque, abs=1e-4)
    assert int(warm.detail.split()[-1]) <= int(cold.detail.split()[-1])


def test_a_previous_plan_of_another_time_or_length_does_no_harm():
    belief = Belief(0.02, 0.0, 0.0, 0.0)
    other = planner(SHORT).plan(0.0, STATES["slope of 6 degrees"], 0.0, None).value
    cold = planner(USUAL).plan(0.1, belief, 0.0, None).value
    for t in (0.1, 0.39, 7.0, -1.0):
        assert planner(USUAL).plan(t, belief, 0.0, other).value.torque == pytest.approx(cold.torque, abs=1e-4)


NOT = float("nan")
HOSTILE = {
    "far away": (Belief(1.2, 0.0, 0.0, 0.0), 0.0),
    "fast": (Belief(0.0, 40.0, 0.0, 0.0), 0.0),
    "huge": (Belief(1e8, -1e9, 0.0, 0.0), 0.0),
    "huge force": (Belief(0.0, 0.0, 1e7, -1e7), 0.0),
    "weightless": (Belief(0.0, 0.0, 0.0, BIPED.M * BIPED.g), 0.0),
    "pulled up": (Belief(0.0, 0.0, 0.0, 2 * BIPED.M * BIPED.g), 0.0),
    "before is NaN": (Belief(0.0, 0.0, 0.0, 0.0), NOT),
    "before is infinite": (Belief(0.0, 0.0, 0.0, 0.0), math.inf),
    "before is out of reach": (Belief(0.0, 0.0, 0.0, 0.0), 1e6),
    "state is NaN": (Belief(NOT, 0.0, 0.0, 0.0), 0.0),
    "force ahead is NaN": (Belief(0.0, 0.0, 0.0, 0.0, np.full((2, 21), NOT)), 0.0),
}


@pytest.mark.parametrize("posed", [SHORT, SHORT_WEAK, SHORT_MANY], ids=["contact", "weak actuator", "many limits"])
@pytest.mark.parametrize("case", HOSTILE)
def test_nothing_that_is_not_a_number_is_called_solved(posed, case):
    belief, before = HOSTILE[case]
    outcome = planner(posed).plan(0.0, belief, before, None)
    if outcome.status is Status.SOLVED:
        assert np.isfinite(outcome.value.torque).all()
        assert np.abs(outcome.value.torque).max() <= posed.actuator.torque + 1e-3
    if "NaN" in case or "infinite" in case:
        assert outcome.status is not Status.SOLVED
    again = planner(posed).plan(0.0, STATES["falls forward"], -20.0, None)
    assert again.status is Status.SOLVED, "a failed step must not spoil the next"


def test_a_forecast_of_another_length_is_refused():
    with pytest.raises(ValueError, match=r"shape \(2, 5\); needs \(2, 21\)"):
        planner(SHORT).plan(0.0, Belief(0.0, 0.0, 0.0, 0.0, np.zeros((2, 5))), 0.0, None)


def test_a_long_horizon_is_planned_too():
    long = horizon(BIPED, Tuning(horizon=101), HELD, {})
    outcome = planner(long).plan(0.0, STATES["slope of 6 degrees"], 0.0, None)
    shorter = planner(USUAL).plan(0.0, STATES["slope of 6 degrees"], 0.0, None)
    assert "IPOPT" in outcome.detail
    assert outcome.value.torque[:5] == pytest.approx(shorter.value.torque[:5], abs=1e-2)


def test_one_iteration_a_period_keeps_near_the_optimum():
    force = slope(5)
    once = planner(horizon(BIPED, Tuning(horizon=40, real_time=True), HELD, {}))
    belief, previous, before, off = Belief(0.0, 0.0, *force), None, 0.0, []
    for k in range(30):
        plan = once.plan(0.02 * k, belief, before, previous).value
        best = planner(USUAL).plan(0.02 * k, belief, before, None).value
        off.append(abs(plan.torque[0] - best.torque[0]))
        previous, before = plan, plan.torque[0]
        belief = Belief(*(best.states[:, 1] + 1e-4 * np.sin([k, 2 * k])), *force)
    assert max(off) < 0.5
    assert off[-1] < 0.05


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("degrees", [3.0, 6.0])
def test_do_mpc_gives_the_same_torques(degrees):
    do_mpc = pytest.importorskip("do_mpc")
    make = runpy.run_path(str(Path(__file__).with_name("peer_do_mpc.py")))["do_mpc_of"]
    peer = make(do_mpc, USUAL, slope(degrees), {"ipopt.tol": 1e-11, "ipopt.bound_relax_factor": 0.0}, keep=True)
    x = np.array([-0.01, 0.02])
    peer.x0 = x
    peer.set_initial_guess()
    first = float(peer.make_step(x.reshape(-1, 1))[0, 0])
    plan = planner(USUAL).plan(0.0, Belief(*x, *slope(degrees)), 0.0, None).value
    assert plan.torque[0] == pytest.approx(first, abs=1e-3)
    theirs = peer.data.prediction(("_u", "tau")).ravel()[: len(plan.torque)]
    assert theirs == pytest.approx(plan.torque, abs=1e-3)


def test_linear_and_nonlinear_plans_agree_as_the_state_goes_to_the_stationary_posture():
    """A tenth of the distance, less than a tenth of the difference; on a value of A that both have."""
    linear, nonlinear = LinearPlanner(horizon=USUAL), planner(USUAL)
    F = _on_the_grid()
    _, theta_f = stationary(BIPED, *F)
    differing = []
    for size in (0.02, 0.002, 0.0002):
        belief = Belief(theta_f + size, -2.0 * size, *F)
        first, second = (each.plan(0.0, belief, 0.0, None).value.torque for each in (linear, nonlinear))
        differing.append(np.abs(first - second).max())
    assert differing[1] < 0.1 * differing[0]
    assert differing[2] < 0.2 * differing[1]
    assert differing[0] < 1e-3  # [N m], of 50


def _on_the_grid():
    """A vertical force for which the linear planner's A is exact."""
    gravity = BIPED.M * BIPED.g
    steps = round(math.log(0.9 * gravity / BIPED.weight) / GRID)
    return 0.0, gravity - BIPED.weight * math.exp(GRID * steps)
