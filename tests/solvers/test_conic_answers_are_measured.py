"""A conic answer is believed for its residuals, never for the solver's word."""

import numpy as np
import pytest
import scipy.optimize
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from design.solvers import conic
from design.solvers.conic import Clarabel, Cone, ConicProgram, matrix, triangle


def _random_qp(seed, n=8, r=14):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(n, n))
    inside = rng.normal(size=n)
    A = rng.normal(size=(r, n))
    return ConicProgram(
        P=sp.csc_matrix(root @ root.T + 0.1 * np.eye(n)),
        q=rng.normal(size=n),
        A=sp.csc_matrix(A),
        b=A @ inside + rng.uniform(0, 1, r),
        cones=[Cone("nonnegative", r)],
    )


@given(seed=st.integers(0, 10**6))
@settings(max_examples=25, deadline=None)
def test_a_qp_has_the_optimum_of_another_solver_and_meets_its_conditions(seed):
    program = _random_qp(seed)
    answer = Clarabel(program).solve()
    P, A = program.P.toarray(), program.A.toarray()
    other = scipy.optimize.minimize(
        lambda x: 0.5 * x @ P @ x + program.q @ x,
        np.linalg.lstsq(A, program.b - 1, rcond=None)[0],
        jac=lambda x: P @ x + program.q,
        constraints={"type": "ineq", "fun": lambda x: program.b - A @ x, "jac": lambda x: -A},
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 500},
    )
    assert answer.solved
    assert answer.value == pytest.approx(other.fun, rel=1e-6, abs=1e-7)
    slack = program.b - A @ answer.x
    assert slack.min() >= -1e-6
    assert answer.z.min() >= -1e-9
    assert np.abs(P @ answer.x + program.q + A.T @ answer.z).max() < 1e-5
    assert np.abs(answer.z * slack).max() < 1e-5


@given(seed=st.integers(0, 10**6))
@settings(max_examples=25, deadline=None)
def test_updated_numbers_give_what_a_new_solver_gives(seed):
    first, second = _random_qp(seed), _random_qp(seed + 1)
    again = ConicProgram(P=first.P, q=second.q, A=second.A, b=second.b, cones=first.cones)
    solver = Clarabel(first)
    assert solver.solve().solved
    solver.update(q=second.q, A=second.A.data, b=second.b)
    assert solver.solve().x == pytest.approx(Clarabel(again).solve().x, rel=1e-4, abs=1e-4)


def test_infeasibility_is_said_only_with_a_certificate():
    program = ConicProgram(
        P=sp.csc_matrix((1, 1)),
        q=np.array([1.0]),
        A=sp.csc_matrix([[1.0], [-1.0]]),
        b=np.array([-1.0, -1.0]),
        cones=[Cone("nonnegative", 2)],
    )
    answer = Clarabel(program).solve()
    assert answer.infeasible
    assert not answer.solved
    assert answer.z.min() >= 0
    assert program.b @ answer.z < 0


def test_the_smallest_matrix_above_two_others_is_found():
    """min trace X, X >= A and X >= B: a semidefinite program with a known optimum, X = A + (B - A)+."""
    rng = np.random.default_rng(4)
    parts = [part + part.T for part in rng.normal(size=(2, 3, 3))]
    program = ConicProgram(
        P=sp.csc_matrix((6, 6)),
        q=triangle(np.eye(3)),
        A=sp.csc_matrix(np.vstack([-np.eye(6), -np.eye(6)])),
        b=np.concatenate([-triangle(part) for part in parts]),
        cones=[Cone("semidefinite", 3), Cone("semidefinite", 3)],
    )
    answer = Clarabel(program).solve()
    values, vectors = np.linalg.eigh(parts[1] - parts[0])
    expected = parts[0] + vectors @ np.diag(np.maximum(values, 0)) @ vectors.T
    assert answer.solved
    assert matrix(answer.x) == pytest.approx(expected, abs=1e-5)


@given(entries=st.lists(st.floats(-10, 10), min_size=10, max_size=10))
def test_triangle_and_matrix_are_inverse_and_keep_the_inner_product(entries):
    values = np.array(entries)
    assert triangle(matrix(values)) == pytest.approx(values, abs=1e-12)
    assert np.sum(matrix(values) ** 2) == pytest.approx(values @ values, abs=1e-9)


@pytest.mark.parametrize("part", ["P", "q", "A", "b"])
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_entries_that_are_not_finite_never_reach_the_solver(part, bad):
    program = _random_qp(1)
    parts = {name: getattr(program, name).copy() for name in ("P", "q", "A", "b")}
    data = parts[part].data if part in "PA" else parts[part]
    data[0] = bad
    with pytest.raises(ValueError, match=f"{part} has an entry"):
        ConicProgram(**parts, cones=program.cones)
    if part in "qb":
        with pytest.raises(ValueError, match=part):
            Clarabel(program).update(**{part: parts[part]})


class _Lies:
    """A solver that returns what it is told."""

    def __init__(self, x, s, z, status="Solved", error=None):
        self.x, self.s, self.z, self.status, self.iterations, self.error = x, s, z, status, 3, error

    def solve(self):
        if self.error:
            raise self.error
        return self


@pytest.mark.parametrize("lie", ["x", "s", "z", "nan", "status", "panic"])
def test_a_solver_that_says_solved_without_being_so_is_not_believed(lie, monkeypatch):
    program = _random_qp(2)
    true = Clarabel(program).solve()
    parts = {"x": true.x.copy(), "s": true.s.copy(), "z": true.z.copy()}
    status = "Solved"
    if lie in parts:
        parts[lie][0] += 0.01
    if lie == "nan":
        parts["x"][0] = np.nan
    if lie == "status":
        status = "InsufficientProgress"
    panic = type("PanicException", (BaseException,), {})("index out of bounds") if lie == "panic" else None
    monkeypatch.setattr(conic.Clarabel, "_built", lambda *_, **__: _Lies(**parts, status=status, error=panic))
    answer = Clarabel(program).solve()
    assert not answer.solved
    assert not answer.infeasible
    if panic:
        assert "PanicException" in answer.said


def test_ctrl_c_is_not_taken_for_a_panic(monkeypatch):
    program = _random_qp(2)
    monkeypatch.setattr(conic.Clarabel, "_built", lambda *_, **__: _Lies(0, 0, 0, error=KeyboardInterrupt()))
    with pytest.raises(KeyboardInterrupt):
        Clarabel(program).solve()
