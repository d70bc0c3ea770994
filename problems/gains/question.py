"""What does not change while gains are sought: loop, limits, environments, bounds, scales; and the time grids.

``Question`` is built once of a setting, a ``Grid`` once for each resolution.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design.analysis.motion import Motion
from design.analysis.rows import Verdict
from design.analysis.simulate import FALLEN, all_quantities
from design.errors import BadInput
from design.model.closed_loop import ClosedLoop
from design.model.environment import Steps
from design.model.laws import Gains
from design.model.limits import Limit, Required, limits
from design.model.stability import characteristic, deciding_points, normalised_slacks
from design.spec.setting import Setting

Array = NDArray[np.float64]
Goal = Literal["decay-rate", "contact-force", "cop-margin", "routh-margin", "feasibility"]
Instants = tuple[tuple[int, ...], ...]

BACKOFF = 1e-8
"""How far inside a requirement, in its scale, the program stays, so that rounding does not break it."""
COARSEST = 0.01
"""Longest step of the coarse time grid [s]."""


class Question:
    """The parts of the program that do not change: loop, limits, environments, bounds, scales."""

    def __init__(self, setting: Setting) -> None:
        if setting.bounds is None:
            message = (
                "is missing; give [synthesis.bounds] with kp, kd, kf as [lower, upper]: nothing else limits the gains"
            )
            raise BadInput(message, key="synthesis.bounds")
        self.setting = setting
        self.loop: ClosedLoop = setting.loop()
        self.limits: list[Limit] = limits(self.loop.plant, setting.required)
        bounds = setting.bounds.copy()
        if setting.law == "pd":
            bounds[2] = 0.0
        elif np.isnan(bounds[2]).any():
            message = f"is missing; law {setting.law} needs it as [lower, upper]"
            raise BadInput(message, key="synthesis.bounds.kf")
        self.upper: Array = bounds[:, 1]
        self.lower: Array = bounds[:, 0]
        self.scale: Array = np.where(self.upper > 0, self.upper, 1.0)
        biped = setting.biped
        A, load = (
            np.concatenate(part)
            for part in zip(*(scenario.operating_points(biped) for scenario in setting.scenarios), strict=True)
        )
        self.environments: list[tuple[float, float]] = list(
            zip(*deciding_points(setting.law, A, load, setting.adapt), strict=True)
        )
        self.pace: float = float(np.sqrt(max(self.upper[0], 1e-9) / biped.I))
        """A typical frequency of the loop [1/s], the scale of decay rates."""

    @property
    def decay(self) -> float:
        """The decay rate that must be kept [1/s]; a trace above 0, since poles on the axis are not stable."""
        wish = self.setting.required.get("decay-rate", Required(level=0.0))
        return max(0.0 if wish.soft else wish.level, 1e-7 * self.pace)

    @property
    def coarse_step(self) -> float:
        """A longer integration step that the fastest loop within the bounds allows [s]."""
        biped = self.setting.biped
        fastest = max(self.upper[1] / biped.I, self.pace, self.upper[2] / biped.ell)
        return float(max(self.setting.step, min(COARSEST, 2.0 / fastest)))

    def grid(self, step: float) -> Grid:
        """The scenarios on time grids of ``step`` [s]."""
        return Grid(question=self, step=step)

    def score(self, goal: Goal, gains: Gains, verdict: Verdict) -> float:
        """The objective's value at ``gains``, from the rows of its verdict."""
        if goal == "decay-rate":
            return min(row.value for row in verdict.rows if row.id == "decay-rate" and row.value is not None)
        if goal == "routh-margin":
            return min(
                float(slack)
                for A, load in self.environments
                for slack in normalised_slacks(self.setting.biped, self.setting.law, gains, A, load)
            )
        ids = objective_rows(goal)
        values = [row.value for row in verdict.rows if row.id in ids]
        return min((float("-inf") if value is None else value) for value in values)


@dataclass(frozen=True, eq=False)
class Grid:
    """Samples of every scenario, ``step`` apart, at which rows are checked, and the meshes that programs march on.

    At full resolution a program marches with the coarse step and lands on the samples it sees; the difference that
    this makes to a row (some 1e-7 of its scale) is measured at each answer and added to the row in the next round.
    """

    question: Question
    step: float

    @cached_property
    def samples(self) -> list[Steps]:
        """The samples of each scenario."""
        return [scenario.steps(self.step) for scenario in self.question.setting.scenarios]

    @cached_property
    def whole(self) -> list[Motion]:
        """Each scenario's trajectory on the samples themselves."""
        return [
            Motion(self.question.loop, scenario, steps)
            for scenario, steps in zip(self.question.setting.scenarios, self.samples, strict=True)
        ]

    @property
    def exact(self) -> bool:
        """Whether programs march on the samples themselves."""
        return self.step >= self.question.coarse_step

    def motions(self, instants: Instants) -> list[tuple[Motion, list[int]]]:
        """Each scenario's trajectory as a function of the gains, and where the samples ``instants`` are on its mesh."""
        if self.exact:
            return [(motion, list(chosen)) for motion, chosen in zip(self.whole, instants, strict=True)]
        found = []
        for scenario, steps, chosen in zip(self.question.setting.scenarios, self.samples, instants, strict=True):
            seen = list(chosen)
            times = np.concatenate([scenario.steps(self.question.coarse_step).t, steps.t[seen]])
            mesh = scenario.steps_at(times)
            after_jump = np.array([k > 0 and steps.t[k] == steps.t[k - 1] for k in seen], dtype=bool)
            at = np.searchsorted(mesh.t, steps.t[seen]) + after_jump
            found.append((Motion(self.question.loop, scenario, mesh), [int(k) for k in at]))
        return found

    def thinned(self, count: int = 12) -> Instants:
        """``count`` samples of each scenario, evenly spread."""
        return tuple(tuple(sorted({int(k) for k in np.linspace(0, len(steps.t) - 1, count)})) for steps in self.samples)

    @cached_property
    def quantities(self) -> list[ca.Function]:
        """For each scenario: K -> theta and the quantities of all limits, a row each, at all samples."""
        question = self.question
        K = ca.MX.sym("K", 3)
        stacked = all_quantities([limit.quantity for limit in question.limits])
        found = []
        for motion in self.whole:
            z = motion.all_states(K)
            n = z.size2()
            tau = question.loop.torque.map(n)(z, ca.repmat(K, 1, n))
            rows = stacked.map(n)(z[:2, :], tau, ca.DM(motion.steps.force))
            found.append(ca.Function("quantities", [K], [ca.vertcat(z[0, :], rows)]))
        return found

    def margins(self, gains: Gains, goal: Goal, v: float) -> list[Array] | None:
        """All rows of the program at all samples, scaled, per scenario (rows, n); None if the biped falls."""
        question = self.question
        ends = np.cumsum([1, *(limit.quantity.size1_out(0) for limit in question.limits)])
        found = []
        for function in self.quantities:
            theta, *parts = np.vsplit(function(np.array(gains)).full(), ends[:-1])
            if not (np.isfinite(theta).all() and np.abs(theta).max() < FALLEN):
                return None
            rows = [
                row
                for limit, quantity in zip(question.limits, parts, strict=True)
                for row in limit_margins(limit, quantity, goal, v)
            ]
            found.append(np.vstack(rows))
        return found


def objective_rows(goal: Goal) -> tuple[str, ...]:
    """Ids of the limits whose smallest value the ``goal`` maximises."""
    return {"contact-force": ("toe-force", "heel-force"), "cop-margin": ("cop-margin",)}.get(goal, ())


def limit_margins(limit: Limit, quantity: Any, goal: Goal, v: Any) -> list[Any]:
    """Rows >= 0 that ``limit`` gives the program, scaled: against what is required, and against the objective ``v``."""
    rows = []
    level = limit.hard_level
    if limit.id in objective_rows(goal):
        rows.append(quantity / limit.scale - v)  # v itself is bounded below by the hard level
    elif level is not None and not (limit.id == "cop-margin" and level <= 0):  # contact >= 0 says the same, smoothly
        relax = v if goal == "feasibility" else BACKOFF
        rows.append(limit.margin(quantity, level) / limit.scale - relax)
    return rows


def question_decay(question: Question, K: Array) -> float:
    """The decay rate over all environments, from plain eigenvalues: quick, for the survey."""
    rates = []
    for A, load in question.environments:
        p = characteristic(question.setting.biped, question.setting.law, K, A, load, question.setting.adapt)
        rates.append(-float(np.roots([1.0, *p]).real.max()))
    return min(rates)


def in_unit(question: Question, goal: Goal, v: float) -> float:
    """The objective ``v``, which the program has in its scale, in its unit."""
    scales = {limit.id: limit.scale for limit in question.limits}
    scale = {"decay-rate": question.pace, "contact-force": scales["toe-force"], "cop-margin": scales["cop-margin"]}
    return v * scale.get(goal, 1.0)
