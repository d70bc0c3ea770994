"""The SQP solves small programs whose optimum is known, and calls nothing solved that its measure denies."""

import casadi as ca
import numpy as np
import pytest

from design.solvers.sqp import Explicit, Measure, Sqp


def posed(f, g, phi, v, X, p=None):
    return Explicit(v=v, X=X, p=ca.SX.sym("p", 0) if p is None else p, phi=phi, f=f, g=g, damp=np.zeros(v.numel()))


def two_states(a):
    """Minimise v_0² + v_1² + (X_1 - 3)² with X_0 = sin v_0, X_1 = X_0 + v_1 and X_1 <= a."""
    v, X, p = ca.SX.sym("v", 2), ca.SX.sym("X", 2), ca.SX.sym("p")
    f = ca.sumsqr(v) + (X[1] - 3) ** 2
    program = posed(f, p - X[1], ca.vertcat(ca.sin(v[0]), X[0] + v[1]), v, X, p)
    return program, Sqp(program).solve(np.zeros(2), np.zeros(2), np.array([a]))


@pytest.mark.parametrize("a", [0.5, 1.0, 10.0])
def test_the_optimum_of_a_small_program_is_found(a):
    _, answer = two_states(a)
    v_0, v_1 = answer.v
    assert answer.solved
    assert answer.X == pytest.approx([np.sin(v_0), np.sin(v_0) + v_1], abs=1e-7)
    assert v_0 == pytest.approx(v_1 * np.cos(v_0), abs=1e-7)  # both ways of raising X_1 cost the same
    free = v_1 == pytest.approx(3 - answer.X[1], abs=1e-7)
    assert free if answer.multiplier[0] < 1e-9 else answer.X[1] == pytest.approx(a, abs=1e-7)


def test_the_measure_sees_a_spoilt_answer():
    program, answer = two_states(1.0)
    measure, p = Measure(program), np.array([1.0])
    assert max(measure(answer.v, answer.X, answer.multiplier, p)) < 1e-7
    assert measure(answer.v, answer.X + 1e-3, answer.multiplier, p).defect > 5e-4
    assert measure(answer.v + 1e-3, answer.X, answer.multiplier, p).stationarity > 1e-4
    assert measure(answer.v, answer.X, answer.multiplier + 1, p).stationarity > 1e-2
    assert measure(answer.v, answer.X, answer.multiplier, p - 0.1).violation > 0.05
    assert measure(answer.v, answer.X, answer.multiplier, p + 0.1).complementarity > 0.01
    assert measure(answer.v * np.nan, answer.X, answer.multiplier, p).defect == np.inf


def test_what_has_no_solution_is_not_called_solved():
    v, X = ca.SX.sym("v"), ca.SX.sym("X")
    answer = Sqp(posed(v**2, ca.vertcat(X - 1, -X), v, v, X)).solve(np.zeros(1), np.zeros(1), np.zeros(0))
    assert not answer.solved
    unbounded = Sqp(posed(-(v**2), X + 1, v, v, X)).solve(np.ones(1), np.ones(1), np.zeros(0))
    assert not unbounded.solved


def test_states_that_depend_on_later_ones_are_refused():
    v, X = ca.SX.sym("v"), ca.SX.sym("X", 2)
    with pytest.raises(ValueError, match="j >= i"):
        posed(v**2, v, ca.vertcat(X[1], v), v, X)
