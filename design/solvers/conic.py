"""Conic programs, QPs and SDPs among them: a posed record, and Clarabel.

minimise ½ xᵀP x + qᵀx over x, subject to A x + s = b, s in a product of cones. Clarabel's "Solved" is not believed:
what it returns is measured again here, in the units of the program. It is run without iterative refinement first, which
is twice as fast on small programs, and again with everything on where the measure is not met.

A semidefinite cone holds the upper triangle of a symmetric matrix, column by column, off-diagonals times √2
(``triangle`` and ``matrix`` translate).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Cone(NamedTuple):
    """A cone of ``size`` rows; for ``semidefinite`` the order n of the matrix, which takes n (n + 1)/2 rows."""

    kind: Literal["zero", "nonnegative", "second order", "semidefinite"]
    size: int

    @property
    def rows(self) -> int:
        """Rows of s that it takes."""
        return self.size * (self.size + 1) // 2 if self.kind == "semidefinite" else self.size


@dataclass(frozen=True, eq=False, kw_only=True)
class ConicProgram:
    """A posed program: sparse ``P`` (n, n) symmetric and ``A`` (r, n), ``q`` (n), ``b`` (r), and the rows' ``cones``.

    Raises ``ValueError`` for shapes that do not fit, and for entries that are not finite: Clarabel checks neither.
    """

    P: Any
    q: Array
    A: Any
    b: Array
    cones: Sequence[Cone]

    def __post_init__(self) -> None:
        n, r = len(self.q), len(self.b)
        if self.P.shape != (n, n) or self.A.shape != (r, n) or sum(cone.rows for cone in self.cones) != r:
            message = f"P {self.P.shape}, q ({n},), A {self.A.shape}, b ({r},) and the cones do not fit each other"
            raise ValueError(message)
        for name in ("P", "A"):
            _finite(name, getattr(self, name).data)
        _finite("q", self.q)
        _finite("b", self.b)
        if abs(self.P - self.P.T).max() > 0:
            message = "P is not symmetric"
            raise ValueError(message)


@dataclass(frozen=True, eq=False, kw_only=True)
class ConicAnswer:
    """Where Clarabel stopped.

    ``x`` (n), slack ``s`` and multipliers ``z`` (r), meaningless unless ``solved``: Clarabel says so *and* the largest
    residual of feasibility, stationarity and gap, ``primal``, ``dual`` and ``gap``, each relative to what it is made
    from, agrees. ``infeasible``: Clarabel has a certificate, and it was checked. ``said``: its own word.
    """

    x: Array
    s: Array
    z: Array
    value: float
    solved: bool
    infeasible: bool
    said: str
    primal: float
    dual: float
    gap: float
    iterations: int


DENSE = 20_000
"""Entries up to which A and P are multiplied as dense matrices when an answer is measured: ten times as fast."""
QUICK: dict[str, Any] = {
    "iterative_refinement_enable": False,
    "direct_solve_method": "qdldl",
    "max_step_fraction": 0.995,
}
CAREFUL: dict[str, Any] = {"max_iter": 500}


class Clarabel:
    """Clarabel on one program: set up once, its numbers updated, solved as often as wanted.

    Scaled when it is set up: what it returns depends on that program and the present one, on nothing between. Answers
    are measured by ``tolerance``, and Clarabel is asked for a tenth of it; of the gap for ``gap``, where that is given.
    """

    def __init__(
        self, program: ConicProgram, *, tolerance: float = 1e-6, gap: float | None = None, seconds: float = math.inf
    ) -> None:
        self._tolerance, self._seconds = tolerance, seconds
        self._gap = 0.1 * tolerance if gap is None else gap
        self._upper = sp.triu(program.P, format="csc")
        self._set(program)
        self._solver = self._set_up()

    def _set(self, program: ConicProgram) -> None:
        self._A = program.A.tocsc(copy=True)
        self._q, self._b, self._cones = program.q.copy(), program.b.copy(), tuple(program.cones)
        dense = program.A.shape[0] * program.A.shape[1] <= DENSE
        self._P_times = program.P.toarray() if dense else program.P.tocsc()
        self._A_times = program.A.toarray() if dense else self._A
        self._place = (self._A.indices, np.repeat(np.arange(len(self._q)), np.diff(self._A.indptr))) if dense else None

    def update(self, *, q: Array | None = None, A: Array | None = None, b: Array | None = None) -> None:
        """New numbers in the same pattern: ``A`` (nnz) are its entries by columns; raises ``ValueError``.

        The program is the same until all of them are checked.
        """
        for name, new, old in (("q", q, self._q), ("A", A, self._A.data), ("b", b, self._b)):
            if new is not None:
                if new.shape != old.shape:
                    message = f"{name} has shape {new.shape}; needs {old.shape}"
                    raise ValueError(message)
                _finite(name, new)
        fresh = {}
        if q is not None and not np.array_equal(q, self._q):
            fresh["q"] = self._q = q.copy()
        if b is not None:
            fresh["b"] = self._b = b.copy()
        if A is not None and not np.array_equal(A, self._A.data):
            fresh["A"] = A.copy()
            self._A.data[:] = A
            if self._place is not None:
                self._A_times[self._place] = A
        if self._solver is not None:
            try:
                self._solver.update(**fresh)
            except Exception:  # a solver that failed to update is in no known state
                self._solver = None

    def _set_up(self) -> Any:
        """The solver, scaled for the program as it stands, or None where Clarabel panics."""
        try:
            return self._built(QUICK, updatable=True)
        except (KeyboardInterrupt, SystemExit):
            raise
        except BaseException:
            return None

    def product(self, x: Array) -> Array:
        """A x (r,) of the program as it stands."""
        return np.asarray(self._A_times @ x)

    def solve(self) -> ConicAnswer:
        """Solve the program as it stands; never raises for what the solver does."""
        answer = self._run(QUICK, keep=True)
        if answer.solved or answer.infeasible:
            return answer
        again = self._run(CAREFUL, keep=False)
        return again if again.solved or again.infeasible else answer

    def _run(self, options: dict[str, Any], *, keep: bool) -> ConicAnswer:
        try:
            solver = self._solver if keep and self._solver is not None else self._built(options, updatable=keep)
            if keep:
                self._solver = solver
            raw = solver.solve()
            x, s, z = np.array(raw.x), np.array(raw.s), np.array(raw.z)
            said, iterations = str(raw.status), int(raw.iterations)
        except (KeyboardInterrupt, SystemExit):
            raise
        except BaseException as error:  # a panic of Clarabel's is no Exception
            self._solver = None
            nothing = np.full(len(self._q), np.nan), np.full(len(self._b), np.nan), np.full(len(self._b), np.nan)
            return self._measured(*nothing, f"{type(error).__name__}: {error}", 0)
        return self._measured(x, s, z, said, iterations)

    def _built(self, options: dict[str, Any], *, updatable: bool) -> Any:
        import clarabel

        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.max_threads = 1
        settings.time_limit = self._seconds
        settings.tol_feas, settings.tol_gap_abs, settings.tol_gap_rel = 0.1 * self._tolerance, self._gap, self._gap
        if updatable:
            settings.presolve_enable = False
            settings.chordal_decomposition_enable = False
            settings.input_sparse_dropzeros = False
        for name, value in options.items():
            if not hasattr(settings, name):
                message = f"this Clarabel has no setting {name}"
                raise AttributeError(message)
            setattr(settings, name, value)
        kinds = {
            "zero": clarabel.ZeroConeT, "nonnegative": clarabel.NonnegativeConeT,
            "second order": clarabel.SecondOrderConeT, "semidefinite": clarabel.PSDTriangleConeT,
        }  # fmt: skip
        cones = [kinds[cone.kind](cone.size) for cone in self._cones]
        return clarabel.DefaultSolver(self._upper, self._q, self._A, self._b, cones, settings)

    def _measured(self, x: Array, s: Array, z: Array, said: str, iterations: int) -> ConicAnswer:
        q, b = self._q, self._b
        with np.errstate(all="ignore"):
            Px, Ax, ATz = self._P_times @ x, self._A_times @ x, self._A_times.T @ z
            quadratic, linear, offered = float(x @ Px), float(q @ x), float(b @ z)
            off, *of = np.abs([Ax + s - b, Ax, b, s]).max(axis=1, initial=0.0).tolist()
            primal = max(off, _outside(self._cones, s), _outside(self._cones, z, dual=True)) / (1 + max(of))
            slope, *of = np.abs([Px + ATz + q, Px, ATz, q]).max(axis=1, initial=0.0).tolist()
            dual = slope / (1 + max(of))
            gap = abs(quadratic + linear + offered) / (1 + min(abs(0.5 * quadratic + linear), abs(offered)))
            agrees = primal <= self._tolerance and dual <= self._tolerance and gap <= 10 * self._tolerance
            impossible = said == "PrimalInfeasible" and self._certified(z, offered, ATz)
        return ConicAnswer(
            x=x, s=s, z=z, value=0.5 * quadratic + linear, solved=said in ("Solved", "AlmostSolved") and agrees,
            infeasible=impossible, said=said, primal=primal, dual=dual, gap=gap, iterations=iterations,
        )  # fmt: skip

    def _certified(self, z: Array, offered: float, ATz: Array) -> bool:
        """Whether z proves that no x exists: Aᵀz = 0 and bᵀz < 0 with z in the dual cone."""
        small = self._tolerance * abs(offered)
        return offered < 0 and _largest(ATz) <= small and _outside(self._cones, z, dual=True) <= small


def triangle(matrix: Array) -> Array:
    """The entries of a symmetric ``matrix`` (n, n) as a semidefinite cone holds them."""
    n = len(matrix)
    return np.concatenate([np.append(math.sqrt(2) * matrix[:k, k], matrix[k, k]) for k in range(n)])


def matrix(entries: Array) -> Array:
    """The symmetric matrix whose ``triangle`` are these ``entries``."""
    n = (math.isqrt(8 * len(entries) + 1) - 1) // 2
    found = np.zeros((n, n))
    rows, columns = np.tril_indices(n)
    values = np.where(rows == columns, entries, entries / math.sqrt(2))
    found[columns, rows] = found[rows, columns] = values
    return found


def _outside(cones: Sequence[Cone], point: Array, *, dual: bool = False) -> float:
    """How far ``point`` lies outside the cones, or their duals."""
    worst, at = 0.0, 0
    for cone in cones:
        part = point[at : at + cone.rows]
        at += cone.rows
        if not len(part):
            continue
        if cone.kind == "zero":
            away = 0.0 if dual else _largest(part)
        elif cone.kind == "nonnegative":
            away = -float(part.min())
        elif cone.kind == "second order":
            away = float(np.linalg.norm(part[1:]) - part[0])
        else:
            away = -float(np.linalg.eigvalsh(matrix(part))[0]) if np.isfinite(part).all() else math.inf
        if not away <= worst:
            worst = away
    return worst


def _largest(values: Array) -> float:
    return float(np.abs(values).max(initial=0.0))


def _finite(name: str, values: Array) -> None:
    if not np.isfinite(values).all():
        message = f"{name} has an entry that is not finite"
        raise ValueError(message)
