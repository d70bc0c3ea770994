"""Sequential quadratic programming for unknowns v and states X that follow from them one after another.

minimise f(v, X, p) over v, X, subject to X = phi(v, X, p) and g(v, X, p) >= 0, where phi_i depends on X_j with j < i
only. Direct multiple shooting is of this kind: phi are the ends of the shooting intervals.

Each iteration eliminates the step of the states, dX = Z dv + d, inside one CasADi function (condensing), and hands the
dense, strictly convex QP that is left to DAQP. The Hessian is that of the Lagrangian; where DAQP finds it not convex,
it is the cost's alone. Steps are full ones. What is called solved was measured: ``Residuals`` are evaluated anew at
the answer.

Chosen by measurement, on the prediction of a standing biped over 40 steps: ``sqpmethod`` with qrqp takes 2 to 5 times
as long, and qrqp reports convergence at violations of 1e-2; with qpOASES 8 times; with OSQP, ProxQP, HiGHS, and fatrop
itself, it stalls; IPOPT takes 20 times as long.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design.buffered import Buffered

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class Explicit:
    """A posed program: CasADi SX expressions ``v`` (n), ``X`` (m), ``p`` (q), ``phi`` (m), ``f`` (scalar), ``g`` (r).

    ``damp`` (n) is added to the Hessian's diagonal: a proximal term, which is zero at the solution.
    """

    v: Any
    X: Any
    p: Any
    phi: Any
    f: Any
    g: Any
    damp: Array

    def __post_init__(self) -> None:
        if self.phi.numel() != self.X.numel() or self.f.numel() != 1 or len(self.damp) != self.v.numel():
            message = f"phi {self.phi.shape}, X {self.X.shape}, f {self.f.shape} and damp do not fit each other"
            raise ValueError(message)
        rows, columns = ca.jacobian_sparsity(self.phi, self.X).get_triplet()
        if any(i <= j for i, j in zip(rows, columns, strict=True)):
            message = "phi_i depends on X_j with j >= i"
            raise ValueError(message)


class Residuals(NamedTuple):
    """How far a point is from an optimum; infinite where it is not a number.

    The largest |phi - X|, -g, entry of the Lagrangian's gradient, by one and a thousandth of the largest multiplier
    (its last digits are lost in sums of those), and smaller one of a multiplier and its g.
    """

    defect: float
    violation: float
    stationarity: float
    complementarity: float


NOWHERE = Residuals(np.inf, np.inf, np.inf, np.inf)


@dataclass(frozen=True, eq=False, kw_only=True)
class SqpAnswer:
    """Where it stopped: ``v`` (n), ``X`` (m), ``multiplier`` (r) >= 0 of g, and the ``residuals`` there."""

    v: Array
    X: Array
    multiplier: Array
    solved: bool
    said: str
    residuals: Residuals
    iterations: int


class Measure:
    """The residuals of one posed program: built once, at a cost that is linear in its size."""

    def __init__(self, program: Explicit) -> None:
        v, X, mu = program.v, program.X, ca.SX.sym("mu", program.g.numel())
        _, slope = _lagrangian(program, mu)
        residuals = [program.phi - X, ca.fmin(program.g, 0), slope, ca.fmin(program.g, mu)]
        names = ["v", "X", "mu", "p"], list(Residuals._fields)
        made = [ca.densify(residual) for residual in residuals]
        self._measured = Buffered(ca.Function("measured", [v, X, mu, program.p], made, *names, {"cse": True}))

    def __call__(self, v: Array, X: Array, multiplier: Array, p: Array) -> Residuals:
        """The residuals at a point."""
        found = self._measured(v=v, X=X, mu=multiplier, p=p)
        worst = [float(np.abs(found[name]).max(initial=0.0)) for name in Residuals._fields]
        worst[2] /= 1 + 1e-3 * float(multiplier.max(initial=0.0))
        return Residuals(*worst) if np.isfinite(worst).all() else NOWHERE


class Sqp:
    """The method on one posed program: built once, run for many parameters."""

    def __init__(self, program: Explicit, *, tolerance: float = 2e-8, iterations: int = 25) -> None:
        self._tolerance, self._iterations = tolerance, iterations
        self._n, self._r = program.v.numel(), program.g.numel()
        self.measure, self._condensed = Measure(program), Buffered(_condensed(program))
        shape = {"h": ca.Sparsity.dense(self._n, self._n), "a": ca.Sparsity.dense(self._r, self._n)}
        self._qp = Buffered(ca.conic("qp", "daqp", shape, {"error_on_fail": False, "daqp": {"primal_tol": 1e-9}}))
        for name, bound in (("uba", np.inf), ("lbx", -np.inf), ("ubx", np.inf)):
            self._qp.given[name][:] = bound

    def solve(self, v: Array, X: Array, p: Array, multiplier: Array | None = None, *, once: bool = False) -> SqpAnswer:
        """Run from ``v`` (n), ``X`` (m) and ``multiplier`` (r); ``once`` takes a single step. Never raises."""
        mu = np.zeros(self._r) if multiplier is None else multiplier
        said, count, residuals = "iterations exhausted", 0, NOWHERE
        with np.errstate(all="ignore"):
            while count < (1 if once else self._iterations) and not self._good(residuals):
                step = self._step(v, X, mu, p, 1.0) or self._step(v, X, mu, p, 0.0)
                if step is None:
                    said = "DAQP finds no step"
                    break
                v, X, mu = step
                residuals = self.measure(v, X, mu, p)
                count += 1
        good = self._good(residuals)
        return SqpAnswer(
            v=v, X=X, multiplier=mu, solved=good, said="converged" if good else said, residuals=residuals,
            iterations=count,
        )  # fmt: skip

    def _good(self, residuals: Residuals) -> bool:
        return max(residuals) <= self._tolerance  # false for NaN too

    def _step(self, v: Array, X: Array, mu: Array, p: Array, curved: float) -> tuple[Array, Array, Array] | None:
        """The point and the multipliers after a full step, or None where DAQP has no answer that is finite."""
        found = self._condensed(v=v, X=X, mu=mu, p=p, curved=curved)
        if not np.isfinite(found["H"].sum() + found["A"].sum() + found["b"].sum() + found["c"].sum()):
            return None
        answer = self._qp(h=found["H"], g=found["c"], a=found["A"], lba=-found["b"])
        dv, multiplier = answer["x"], np.maximum(-answer["lam_a"], 0.0)
        if not (self._qp.stats()["success"] and np.isfinite(dv).all() and np.isfinite(multiplier).all()):
            return None
        Z = found["Z"].reshape(self._n, -1)  # transposed
        return v + dv, X + dv @ Z + found["d"], multiplier


def _lagrangian(program: Explicit, mu: Any) -> tuple[Any, Any]:
    """The multipliers (m) of X = phi for which the Lagrangian does not depend on X, and its gradient in v (n)."""
    v, X, phi, f, g = program.v, program.X, program.phi, program.f, program.g
    backward = _substitution(ca.jacobian(phi, X), transposed=True)
    adjoint = backward(ca.gradient(f, X) - ca.jacobian(g, X).T @ mu)
    return adjoint, ca.gradient(f, v) - ca.jacobian(g, v).T @ mu + ca.jacobian(phi, v).T @ adjoint


def _condensed(program: Explicit) -> ca.Function:
    """(v, X, mu, p, curved) -> H, c, A, b, Z, d of the QP: minimise ½ dvᵀH dv + cᵀdv subject to A dv + b >= 0."""
    v, X, p, phi, f, g = program.v, program.X, program.p, program.phi, program.f, program.g
    n = v.numel()
    mu, curved, adjoint = ca.SX.sym("mu", g.numel()), ca.SX.sym("curved"), ca.SX.sym("adjoint", X.numel())
    lagrangian = f + curved * (ca.dot(adjoint, phi) - ca.dot(mu, g))
    hessian = ca.substitute(ca.hessian(lagrangian, ca.vertcat(v, X))[0], adjoint, _lagrangian(program, mu)[0])
    H_vv, H_vX, H_XX = hessian[:n, :n], hessian[:n, n:], hessian[n:, n:]

    phi_v, phi_X, g_X = ca.jacobian(phi, v), ca.jacobian(phi, X), ca.jacobian(g, X)
    forward, backward = _substitution(phi_X), _substitution(phi_X, transposed=True)
    Z, d = forward(phi_v), forward(phi - X)
    H = H_vv + H_vX @ Z + phi_v.T @ backward(H_vX.T + H_XX @ Z)
    H = ca.triu2symm(ca.triu(H)) + ca.diag(ca.DM(program.damp))
    c = ca.gradient(f, v) + H_vX @ d + phi_v.T @ backward(ca.gradient(f, X) + H_XX @ d)
    made = [ca.densify(part) for part in (H, c, ca.jacobian(g, v) + g_X @ Z, g + g_X @ d, Z, d)]
    names = ["v", "X", "mu", "p", "curved"], ["H", "c", "A", "b", "Z", "d"]
    return ca.Function("condensed", [v, X, mu, p, curved], made, *names, {"cse": True})


def _substitution(slope: Any, *, transposed: bool = False) -> Any:
    """The solution Y of Y = slope Y + R as a function of R (m, ...), or of Y = slopeᵀ Y + R; slope strictly lower."""
    m = slope.shape[0]
    needs: list[list[tuple[int, Any]]] = [[] for _ in range(m)]
    for i, j in zip(*slope.sparsity().get_triplet(), strict=True):
        needs[j if transposed else i].append((i if transposed else j, slope[i, j]))

    def solved(right: Any) -> Any:
        rows: list[Any] = [None] * m
        for i in range(m - 1, -1, -1) if transposed else range(m):
            rows[i] = right[i, :] + sum((entry * rows[j] for j, entry in needs[i]), ca.SX(1, right.shape[1]))
        return ca.vertcat(*rows)

    return solved
