"""``pose``: the program of gain synthesis for the samples that it sees, and ``Read`` between its vector and names.

Statement and reasons: see ``problems.gains``. Rows, objective and decay rates are scaled to order one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design.model.laws import Gains
from design.model.stability import shifted
from design.solvers.nlp import Nlp
from problems.gains.goal import BACKOFF, Goal
from problems.gains.grid import Branches, Grid, Instants, Point
from problems.gains.model import Model
from problems.gains.modelled import rows as model_rows
from problems.gains.question import SURVIVALS, Environment, Question

Array = NDArray[np.float64]

VANISHING = ("overshoot", "posture-error")
"""Objectives of which there may be none, over a whole region of gains."""
NONE = 1e-6
"""How much of them, in their scale, counts as none."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Read:
    """Between named quantities and the solver's vector: x = (K/scale, v, factors of each polynomial)."""

    question: Question
    goal: Goal

    def point(self, x: Array) -> Point:
        """The gains and the objective in ``x``."""
        K = np.clip(x[:3] * self.question.scale, self.question.lower, self.question.upper)
        return Point(gains=Gains(*map(float, K)), v=float(x[3]))

    def start(self, point: Point) -> Array:
        """A vector whose factors fit the poles of ``point`` as well as they can."""
        question = self.question
        factors: list[float] = []
        for each, rate in pole_sets(question, self.goal, point.v):
            p = each.coefficients(point.gains)
            roots = np.roots([1.0, *shifted([float(c) for c in p], rate)]) / question.pace
            roots = np.minimum(roots.real, -1e-3) + 1j * roots.imag
            if len(p) == 2:
                factors += [-float(roots.sum().real), float(roots.prod().real)]
            elif len(p) == 4:
                ordered = roots[np.argsort(-np.abs(roots.imag))]  # complex pairs stay together
                for pair in (ordered[:2], ordered[2:]):
                    factors += [-float(pair.sum().real), float(pair.prod().real)]
            else:
                real = int(np.argmin(np.abs(roots.imag)))
                rest = np.delete(roots, real)
                factors += [-float(roots[real].real), -float(rest.sum().real), float(rest.prod().real)]
        return np.array([*(np.array(point.gains) / question.scale), point.v, *factors])


def pole_sets(question: Question, goal: Goal, v: Any) -> list[tuple[Environment, Any]]:
    """The environments, and the decay rate that the poles must have there [1/s]."""
    if goal.id == "decay-rate":
        sigma = v * question.pace
    elif goal.id == "feasibility":
        sigma = question.decay + v * question.pace
    else:
        sigma = question.decay * (1 + BACKOFF)
    found = [(each, sigma) for each in question.environments]
    wish = question.wish("decay-rate")
    if goal.id == "goals" and wish is not None:
        found += [(each, wish + v * question.size_of("decay-rate")) for each in question.environments]
    return found


def pose(
    grid: Grid,
    instants: Instants,
    shift: Array | None = None,
    models: Sequence[Model] = (),
    reach: tuple[Array, float] | None = None,
    branches: Branches | None = None,
) -> tuple[Nlp, Read]:
    """The program that sees the samples ``instants`` of each case; ``shift`` is added to its sampled rows.

    The sampled rows come first: by case, then by sample, then in the order of ``Grid.margins``. ``models`` are of
    the rows that are not sampled; with ``reach`` = (u, radius) the gains stay so near to u, in their scale.
    ``branches`` of the approach to the final posture, where something is asked of it.
    """
    question, goal = grid.question, grid.goal
    u, v = ca.MX.sym("u", 3), ca.MX.sym("v")
    K = u * ca.DM(question.scale)
    rows = _sampled(grid, instants, branches or tuple(None for _ in instants), K, v)
    if shift is not None and rows:
        rows = [ca.vertcat(*rows) + ca.DM(shift)]
    rows += [row for each in models for row in model_rows(question, goal, each, u, v)]
    if goal.gain is not None:
        rows.append(goal.sign * u[goal.gain] * question.scale[goal.gain] / goal.scale - v)
    if goal.id == "routh-margin":
        rows += [slack - v for each in question.environments for slack in each.slacks(ca.vertsplit(K))]
    factors, equal = _factored(question, goal, K, v)

    low, high = objective_range(question, goal)
    lower = np.where(question.lower > 0, question.lower, 1e-9 * question.upper) / question.scale  # poles divide by K
    upper = question.upper / question.scale
    if reach is not None:
        centre, radius = reach
        lower, upper = np.clip(centre - radius, lower, upper), np.clip(centre + radius, lower, upper)
    count = sum(row.numel() for row in rows)
    program = Nlp(
        x=ca.vertcat(u, v, *factors),
        f=-v,
        g=ca.vertcat(*rows, *equal),
        x_lower=np.array([*lower, low, *np.zeros(len(factors))]),
        x_upper=np.array([*upper, high, *np.full(len(factors), np.inf)]),
        lower=np.zeros(count + len(equal)),
        upper=np.array([*np.full(count, np.inf), *np.zeros(len(equal))]),
    )
    return program, Read(question=question, goal=goal)


def _sampled(grid: Grid, instants: Instants, branches: Branches, K: ca.MX, v: ca.MX) -> list[Any]:
    """The rows of the limits at ``instants``, a column of them for each case."""
    rows, p = [], ca.vertcat(K, v)
    motions = grid.motions(instants, branches)
    for (case, motion, at), chosen, path, branch in zip(motions, instants, grid.paths, branches, strict=True):
        if not chosen:
            continue
        n = len(chosen)
        states = motion.states(at)(p[: motion.free])
        z, F = states[:, :n], motion.force(at[:n], p)
        tau = case.loop.torque.map(n)(z, ca.repmat(K, 1, n))
        parts = [
            part for limit in case.limits for part in grid.rows(case, limit, limit.quantity.map(n)(z[:2, :], tau, F), v)
        ]
        if case.rate is not None:
            parts += grid.rows(case, case.rate, case.rate.quantity.map(n)(z, F, ca.repmat(K, 1, n)), v)
        if path is not None and branch is not None:
            e = states[0, :] - path.to.theta_f
            moved = grid.question.level("settling") not in (None, branch.T)
            parts += path.rows(
                branch, np.array(chosen), e[:, :n], z[1, :] if moved else None, e[:, n], e[:, n + 1], v
            )  # fmt: skip
        if parts:
            rows.append(ca.vec(ca.vertcat(*parts)))
    return rows


def _factored(question: Question, goal: Goal, K: ca.MX, v: ca.MX) -> tuple[list[Any], list[Any]]:
    """Variables >= 0, and equations by which the shifted polynomials are products of stable factors of them."""
    factors: list[Any] = []
    equal: list[Any] = []
    for each, sigma in pole_sets(question, goal, v):
        q = shifted(each.coefficients(ca.vertsplit(K)), sigma)
        a, b, c, d = (ca.MX.sym(name) for name in "abcd")
        if len(q) == 2:
            factors += [b, c]
            product: tuple[Any, ...] = (b, c)
        elif len(q) == 4:
            factors += [a, b, c, d]
            product = (a + c, b + d + a * c, a * d + b * c, b * d)  # (mu² + a mu + b)(mu² + c mu + d)
        else:
            factors += [a, b, c]
            product = (a + b, a * b + c, a * c)
        equal += [q[k] / question.pace ** (k + 1) - product[k] for k in range(len(q))]
    return factors, equal


def objective_range(question: Question, goal: Goal) -> tuple[float, float]:
    """Bounds of v: below, what is required of the objective itself; above, where more needs no effort."""
    if goal.id == "decay-rate":
        return question.decay / question.pace * (1 + BACKOFF), np.inf
    if goal.id == "feasibility":
        return -np.inf, 1e-3
    if goal.id == "routh-margin":
        return 0.0, 1.0
    if goal.id == "goals":
        return -1e3, np.inf
    if goal.id in ("contact-force", "cop-margin"):
        return (question.level(goal.id) or 0.0) / goal.scale + BACKOFF, np.inf
    level = question.level(goal.id)
    least, most = (0.0, 1.5) if goal.id in SURVIVALS else (-np.inf, np.inf)  # in parts of the physical limit
    if goal.id in VANISHING:
        most = -NONE if level is None else max(-NONE, 0.5 * goal.v(level))
    return (least, most) if level is None else (max(least, goal.v(level) + BACKOFF), most)
