"""The derivatives that ``Motion`` claims are those of the trajectory it gives: finite differences of plain marches.

What is differenced is ``loop.step``, called step by step; it knows nothing of sensitivities.
"""

import math
from functools import cache

import casadi as ca
import numpy as np
import pytest

from design.analysis.motion import Motion
from design.analysis.simulate import simulate
from design.model.body import Biped
from design.model.closed_loop import closed_loop
from design.model.environment import constant_force, platform, profile, slope
from design.model.laws import Gains

PAPER = Biped(M=50.0, L=0.75, I=50.0 * 0.75**2 / 4, m=0.1, ell=0.1)
AT = np.array([2400.0, 500.0, 1.3])
SCALE = np.array([1e3, 1e2, 1.0])  # of each gain: derivatives are compared per scale
STEP = 0.005
JUMPS = np.array([[0.0, 0.0, 0.0], [0.2003, 20.0, 30.0], [0.2003, -25.0, 0.0], [0.4, -25.0, -40.0]])
SCENARIOS = {
    "slope": slope(PAPER, name="slope", angle=0.2, ramp=0.3011, duration=0.6),
    "sudden": slope(PAPER, name="sudden", angle=0.1, ramp=0.0, duration=0.5),
    "push": constant_force(name="push", F_x=25.0, F_y=-60.0, ramp=0.1, duration=0.5, theta0=0.05, omega0=-0.1),
    "bus": platform(PAPER, name="bus", points=np.array([[0.1, 0.0], [0.2, 0.5], [0.3, -0.3]]), duration=0.5),
    "jumps": profile(name="jumps", points=JUMPS, duration=0.6, omega0=0.04),
}
KINDS = ["pd", "force", "cop"]
CASES = [(name, kind) for name in SCENARIOS for kind in KINDS]
every_case = pytest.mark.parametrize(("name", "kind"), CASES)


def _loop(kind):
    return closed_loop(PAPER, kind, 0.02)


@cache
def _motion(name, kind):
    return Motion(_loop(kind), SCENARIOS[name], SCENARIOS[name].steps(STEP))


@cache
def _instants(name):
    """The first sample, early ones, both sides of the last breakpoint, the last sample; not in order, one twice."""
    scenario = SCENARIOS[name]
    steps = scenario.steps(STEP)
    last = len(steps.h)
    corner = int(np.flatnonzero(steps.t == scenario.breakpoints[-1])[0]) if scenario.breakpoints else last // 2
    return (0, 1, corner, last, corner + 1, corner - 1, 7, last)


def _marched(name, kind, gains):
    """(3, n) states at the instants."""
    scenario, step = SCENARIOS[name], _loop(kind).step
    steps = scenario.steps(STEP)
    z = [np.array([scenario.theta0, scenario.omega0, 0.0])]
    for u in np.vstack([steps.h, steps.start, steps.middle, steps.end]).T:
        z.append(step(z[-1], u, gains).full().ravel())
    return np.column_stack(z)[:, list(_instants(name))]


@cache
def _functions(name, kind):
    """Values, Jacobian, and the Jacobian of the Jacobian, all as functions of the scaled gains."""
    k = ca.MX.sym("k", 3)
    Z = ca.vec(_motion(name, kind).states(_instants(name))(k * SCALE))
    jacobian = ca.jacobian(Z, k)
    return [ca.Function("f", [k], [each]) for each in (Z, jacobian, ca.jacobian(ca.vec(jacobian), k))]


def _central(function, k, by):
    columns = [(function(k + by * e) - function(k - by * e)) / (2 * by) for e in np.eye(3)]
    return np.column_stack(columns)


def _flat(array):
    return np.asarray(array).ravel(order="F")


def assert_close(found, expected, tolerance):
    """Row by row of the states, against the largest derivative of its column."""
    assert found.shape == expected.shape
    assert np.all(np.isfinite(found))
    assert np.abs(found - expected).max() <= tolerance * np.abs(expected).max()


@every_case
def test_the_states_are_those_of_the_simulation(name, kind):
    found = _motion(name, kind).states(_instants(name))(AT).full()
    run = simulate(_loop(kind), SCENARIOS[name], Gains(*AT), STEP)
    chosen = list(_instants(name))
    expected = np.vstack([run.theta, run.omega, run.s])[:, chosen]
    assert run.fallen is None
    assert found == pytest.approx(expected, rel=1e-11, abs=1e-13)


@every_case
def test_chosen_states_are_columns_of_all_states(name, kind):
    K, motion = ca.MX.sym("K", 3), _motion(name, kind)
    everything = ca.Function("all", [K], [motion.all_states(K)])(AT).full()
    assert everything.shape == (3, len(motion.steps.h) + 1)
    found = motion.states(_instants(name))(AT).full()
    assert found == pytest.approx(everything[:, list(_instants(name))], rel=1e-12, abs=1e-14)


@every_case
def test_the_jacobian_is_that_of_finite_differences(name, kind):
    _, jacobian, _ = _functions(name, kind)
    differences = _central(lambda k: _flat(_marched(name, kind, k * SCALE)), AT / SCALE, 1e-4)
    found = jacobian(AT / SCALE).full()
    assert_close(found, differences, 1e-6)
    n = len(_instants(name))
    for state in range(3 if kind != "pd" else 2):  # each on its own scale
        assert_close(found.reshape(n, 3, 3)[:, state], differences.reshape(n, 3, 3)[:, state], 1e-5)


@every_case
def test_the_second_derivatives_are_those_of_finite_differences_of_the_first(name, kind):
    _, jacobian, hessian = _functions(name, kind)
    differences = _central(lambda k: _flat(jacobian(k).full()), AT / SCALE, 1e-4)
    found = hessian(AT / SCALE).full()
    assert_close(found, differences, 1e-6)
    n = len(_instants(name))
    for state in range(3 if kind != "pd" else 2):
        assert_close(found.reshape(3, n, 3, 3)[:, :, state], differences.reshape(3, n, 3, 3)[:, :, state], 1e-5)


@every_case
def test_second_derivatives_do_not_depend_on_the_order_of_the_gains(name, kind):
    _, _, hessian = _functions(name, kind)
    n = len(_instants(name))
    tensor = hessian(AT / SCALE).full().reshape(3, 3 * n, 3)  # first gain, state, second gain
    assert_close(tensor, tensor.transpose(2, 1, 0), 1e-12)


@pytest.mark.parametrize(("name", "kind"), [("jumps", "force"), ("slope", "cop"), ("push", "pd")])
def test_functions_made_of_the_states_have_exact_hessians(name, kind):
    """The contact forces, which the optimiser constrains, weighted: chain rule through gains and states."""
    loop, motion, instants = _loop(kind), _motion(name, kind), _instants(name)
    k = ca.MX.sym("k", 3)
    Z = motion.states(instants)(k * SCALE)
    force = motion.steps.force[:, list(instants)]
    y = loop.readout.map(len(instants))(Z, force, ca.repmat(k * SCALE, 1, len(instants)))
    weights = np.cos(np.arange(2 * len(instants)))
    scalar = ca.dot(weights, ca.vec(y[1:, :])) / 100 + ca.sumsqr(Z[0, :]) * 1e3
    hessian, gradient = ca.hessian(scalar, k)
    value, first, second = (ca.Function("f", [k], [each]) for each in (scalar, gradient, hessian))

    def plainly(k):
        z = _marched(name, kind, k * SCALE)
        forces = np.column_stack(
            [loop.readout(z[:, j], force[:, j], k * SCALE).full()[1:, 0] for j in range(len(instants))]
        )
        return weights @ forces.ravel(order="F") / 100 + 1e3 * np.sum(z[0] ** 2)

    at = AT / SCALE
    assert float(value(at)) == pytest.approx(plainly(at), rel=1e-10)
    assert_close(first(at).full().ravel(), _central(lambda k: np.array([plainly(k)]), at, 1e-4).ravel(), 1e-6)
    assert_close(second(at).full(), _central(lambda k: first(k).full().ravel(), at, 1e-4), 1e-6)


def test_what_lies_after_the_last_instant_is_not_marched():
    """Gains that blow up late do no harm to an early instant."""
    late = slope(PAPER, name="late", angle=math.radians(40), ramp=0.1, duration=60.0)
    motion = Motion(_loop("pd"), late, late.steps(0.01))
    unstable = [100.0, -1200.0, 0.0]
    K = ca.MX.sym("K", 3)
    early = motion.states([3, 10])
    slopes = ca.Function("slopes", [K], [ca.jacobian(ca.vec(early(K)), K)])
    assert not np.isfinite(ca.Function("all", [K], [motion.all_states(K)])(unstable).full()).all()
    assert np.isfinite(early(unstable).full()).all()
    assert np.isfinite(slopes(unstable).full()).all()
