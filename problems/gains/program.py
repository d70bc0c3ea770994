"""``pose``: the program of gain synthesis for the samples that it sees, and ``Read`` between its vector and names.

Statement and reasons: see ``problems.gains``. Rows, objective and decay rates are scaled to order one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design.model.laws import Gains
from design.model.stability import characteristic, normalised_slacks, shifted
from design.solvers.nlp import Nlp
from problems.gains.question import BACKOFF, Goal, Grid, Instants, Question, limit_margins, objective_rows

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class Point:
    """A point of the program: gains, and the objective ``v`` in its scale."""

    gains: Gains
    v: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Read:
    """Between named quantities and the solver's vector: x = (K/scale, v, factors of each environment)."""

    question: Question
    goal: Goal

    def point(self, x: Array) -> Point:
        """The gains and the objective in ``x``."""
        K = np.clip(x[:3] * self.question.scale, self.question.lower, self.question.upper)
        return Point(gains=Gains(*map(float, K)), v=float(x[3]))

    def start(self, point: Point) -> Array:
        """A vector whose factors fit the poles of ``point`` as well as they can."""
        question = self.question
        rate = _sigma(question, self.goal, point.v)
        factors: list[float] = []
        for A, load in question.environments:
            p = characteristic(
                question.setting.biped, question.setting.law, point.gains, A, load, question.setting.adapt
            )
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


def _sigma(question: Question, goal: Goal, v: Any) -> Any:
    """The decay rate that the poles must have [1/s]."""
    if goal == "decay-rate":
        return v * question.pace
    if goal == "feasibility":
        return question.decay + v * question.pace
    return question.decay * (1 + BACKOFF)


def pose(grid: Grid, goal: Goal, instants: Instants, shift: Array | None = None) -> tuple[Nlp, Read]:
    """The program that sees the samples ``instants`` of each scenario; ``shift`` is added to its sampled rows.

    The sampled rows come first: by scenario, then by sample, then in the order of ``Grid.margins``.
    """
    question = grid.question
    setting, loop = question.setting, question.loop
    u, v = ca.MX.sym("u", 3), ca.MX.sym("v")
    K = u * ca.DM(question.scale)
    rows: list[Any] = []
    equal: list[Any] = []

    for motion, chosen in grid.motions(instants):
        if not chosen:
            continue
        n = len(chosen)
        z = motion.states(chosen)(K)
        F = ca.DM(motion.steps.force[:, chosen])
        tau = loop.torque.map(n)(z, ca.repmat(K, 1, n))
        parts = [
            part
            for limit in question.limits
            for part in limit_margins(limit, limit.quantity.map(n)(z[:2, :], tau, F), goal, v)
        ]
        if parts:
            rows.append(ca.vec(ca.vertcat(*parts)))
    if shift is not None and rows:
        rows = [ca.vertcat(*rows) + ca.DM(shift)]

    factors = []
    for A, load in question.environments:
        p = characteristic(setting.biped, setting.law, ca.vertsplit(K), A, load, setting.adapt)
        q = shifted(p, _sigma(question, goal, v))
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
        if goal == "routh-margin":
            rows += [slack - v for slack in normalised_slacks(setting.biped, setting.law, ca.vertsplit(K), A, load)]

    free = len(factors)
    low, high = objective_range(question, goal)
    smallest = np.where(question.lower > 0, question.lower, 1e-9 * question.upper)  # poles and slacks divide by gains
    count = sum(row.numel() for row in rows)
    program = Nlp(
        x=ca.vertcat(u, v, *factors),
        f=-v,
        g=ca.vertcat(*rows, *equal),
        x_lower=np.array([*(smallest / question.scale), low, *np.zeros(free)]),
        x_upper=np.array([*(question.upper / question.scale), high, *np.full(free, np.inf)]),
        lower=np.zeros(count + len(equal)),
        upper=np.array([*np.full(count, np.inf), *np.zeros(len(equal))]),
    )
    return program, Read(question=question, goal=goal)


def objective_range(question: Question, goal: Goal) -> tuple[float, float]:
    """Bounds of v: below, what is required of the objective itself; above, where more needs no effort."""
    if goal == "decay-rate":
        return question.decay / question.pace * (1 + BACKOFF), np.inf
    if goal == "feasibility":
        return -np.inf, 1e-3
    if goal == "routh-margin":
        return 0.0, 1.0
    levels = [(limit.hard_level or 0.0) / limit.scale for limit in question.limits if limit.id in objective_rows(goal)]
    return max(levels) + BACKOFF, np.inf
