"""Nonlinear programs: a posed record, and IPOPT.

minimise f(x) over x, subject to lower <= g(x) <= upper and x_lower <= x <= x_upper; f and g may hold parameters p.
Derivatives are CasADi's, exact to second order. IPOPT's "acceptable" level is switched off, its bounds are not relaxed,
where a tolerance of 1e-9 or less is asked for, constraints are held far tighter still (one more Newton step; the roots
of a polynomial feel its coefficients' last digits), and what it returns is measured again here: the largest violation,
and the stationarity of the Lagrangian with its multipliers.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LONGEST = 1e6
"""Time limit where none is set [s]: IPOPT takes no infinity."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Nlp:
    """A posed program: CasADi expressions ``x`` (n), ``f`` (scalar), ``g`` (r), parameters ``p``; numeric bounds."""

    x: Any
    f: Any
    g: Any
    x_lower: Array
    x_upper: Array
    lower: Array
    upper: Array
    p: Any = None

    def __post_init__(self) -> None:
        sizes = {
            "x": (self.x.numel(), self.x_lower.size, self.x_upper.size),
            "g": (self.g.numel(), self.lower.size, self.upper.size),
        }
        for name, found in sizes.items():
            if len(set(found)) != 1:
                message = f"{name}: expression, lower and upper bound have {found} entries"
                raise ValueError(message)
        if self.f.numel() != 1:
            message = f"f has {self.f.numel()} entries; needs 1"
            raise ValueError(message)
        if any(np.isnan(bound).any() for bound in (self.x_lower, self.x_upper, self.lower, self.upper)):
            message = "a bound is NaN"
            raise ValueError(message)


@dataclass(frozen=True, eq=False, kw_only=True)
class NlpAnswer:
    """Where IPOPT stopped.

    ``x`` (n), ``f``, ``g`` (r), multipliers ``x_multiplier`` (n) and ``multiplier`` (r) (positive at an upper bound).
    ``solved``: IPOPT says optimal and the residuals agree. ``violation`` and ``stationarity`` are those residuals.
    """

    x: Array
    f: float
    g: Array
    x_multiplier: Array
    multiplier: Array
    solved: bool
    said: str
    violation: float
    stationarity: float
    iterations: int


@contextmanager
def _interruptible() -> Iterator[None]:
    """Raise a Ctrl-C that came meanwhile: CasADi makes a stop of IPOPT, or a failed evaluation, of it and goes on."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []

    def handler(number: int, frame: object) -> None:
        came.append(number)
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if came:
        raise KeyboardInterrupt


class Ipopt:
    """IPOPT on one posed program: built once, run from many starts."""

    def __init__(self, program: Nlp, *, tolerance: float = 1e-9, seconds: float = 60.0, iterations: int = 300) -> None:
        self._program = program
        self._tolerance = tolerance
        self._options: dict[str, Any] = {
            "print_time": False,
            "ipopt.print_level": 0,
            "ipopt.sb": "yes",
            "ipopt.tol": tolerance,
            "ipopt.constr_viol_tol": 1e-4 * tolerance if tolerance <= 1e-9 else tolerance,
            "ipopt.acceptable_iter": 0,
            "ipopt.bound_relax_factor": 0.0,
            "ipopt.max_iter": iterations,
            "ipopt.max_wall_time": min(seconds, LONGEST),
            "show_eval_warnings": False,
        }

    def _built(self, **more: float) -> Any:
        program = self._program
        options = {**self._options, **{f"ipopt.{key}": value for key, value in more.items()}}
        posed = {"x": program.x, "f": program.f, "g": program.g, **({} if program.p is None else {"p": program.p})}
        return ca.nlpsol("ipopt", "ipopt", posed, options)

    @cached_property
    def _cold(self) -> Any:
        return self._built(mu_init=1e-3)

    @cached_property
    def _warm(self) -> Any:
        return self._built(mu_init=1e-7, bound_push=1e-8, bound_frac=1e-8, slack_bound_push=1e-8, slack_bound_frac=1e-8)

    def build(self) -> None:
        """Build now what the first ``solve`` would build."""
        _ = self._cold

    def solve(self, start: Array, *, near: bool = False, p: Array | tuple[()] = ()) -> NlpAnswer:
        """Run from ``start`` (n) for the parameters ``p``; ``near`` says that it is close to an optimum."""
        program = self._program
        solver = self._warm if near else self._cold
        start = np.clip(start, program.x_lower, program.x_upper)
        with _interruptible():
            raw = solver(x0=start, p=p, lbx=program.x_lower, ubx=program.x_upper, lbg=program.lower, ubg=program.upper)
        stats = solver.stats()
        x, g = raw["x"].full().ravel(), raw["g"].full().ravel()
        x_multiplier, multiplier = raw["lam_x"].full().ravel(), raw["lam_g"].full().ravel()
        violation, stationarity = self._residuals(solver, x, x_multiplier, multiplier, p)
        allowed = 10 * self._tolerance
        scale = 1 + max(np.abs(multiplier).max(initial=0.0), np.abs(x_multiplier).max(initial=0.0))
        good = violation <= allowed and stationarity <= 1e3 * allowed * scale
        return NlpAnswer(
            x=x, f=float(raw["f"]), g=g, x_multiplier=x_multiplier, multiplier=multiplier,
            solved=bool(stats["success"]) and bool(good), said=str(stats["return_status"]), violation=violation,
            stationarity=stationarity, iterations=int(stats["iter_count"]),
        )  # fmt: skip

    def _residuals(
        self, solver: Any, x: Array, x_multiplier: Array, multiplier: Array, p: Array | tuple[()]
    ) -> tuple[float, float]:
        """Largest violation of a bound, and largest entry of the Lagrangian's gradient; infinite if not finite."""
        program = self._program
        _, gradient = solver.get_function("nlp_grad_f")(x, p)
        g, jacobian = solver.get_function("nlp_jac_g")(x, p)
        g = g.full().ravel()
        lagrangian = gradient.full().ravel() + jacobian.full().T @ multiplier + x_multiplier
        violation = max(
            (program.lower - g).max(initial=0.0),
            (g - program.upper).max(initial=0.0),
            (program.x_lower - x).max(initial=0.0),
            (x - program.x_upper).max(initial=0.0),
        )
        free = program.x_lower < program.x_upper
        stationarity = float(np.abs(lagrangian[free]).max(initial=0.0))
        finite = np.isfinite(g).all() and np.isfinite(lagrangian).all()
        return (float(violation), stationarity) if finite else (np.inf, np.inf)
