"""What does not change while gains are sought: bodies, scenarios, requirements, bounds, poles, scales.

A question is asked about one body, or about several at once (``beside``): every requirement then holds for each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design.analysis.motion import Sized
from design.analysis.objectives import OBJECTIVES, shortfall
from design.analysis.rows import Verdict
from design.analysis.survival import HORIZON, lopsided, push_limit, slope_limit
from design.analysis.transient import torque_rate_of
from design.errors import BadInput
from design.model.closed_loop import ClosedLoop
from design.model.environment import Scenario, slope
from design.model.laws import Gains
from design.model.limits import Limit, Required, limits
from design.model.stability import characteristic, normalised_slacks, polynomial_map
from design.model.standing import Place, standing
from design.spec.setting import Setting
from problems.gains.goal import FEASIBILITY, MORE, Goal, goal_of
from problems.gains.working_box import working_upper

Array = NDArray[np.float64]

COARSEST = 0.01
"""Longest step of the coarse time grid [s]."""
SURVIVALS = ("step-slope", "push")
APPROACH = ("settling", "overshoot", "posture-error")
"""Rows of the approach to the final posture (``problems.gains.approach``)."""
RESOLUTION = 1.1e-4
"""Part of the physical limit by which the report's largest disturbance may be below the true one: it is bisected."""
KNOWN = 9
"""Environments that are looked at where the law knows another body and its two ends do not decide."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Case:
    """One body in one scenario, or under a disturbance that is ``sized`` by the program.

    ``limits``: what is asked of (x, tau, F) along the trajectory; ``rate``: of the torque's rate, a function of the
    whole state, (z (n), F (2), K (3)) -> dtau/dt and its negative. ``marks``: times [s] that a coarse grid has as
    samples too.
    """

    name: str
    loop: ClosedLoop
    limits: tuple[Limit, ...]
    scenario: Scenario
    sized: Sized | None = None
    rate: Limit | None = None
    marks: tuple[float, ...] = ()

    @property
    def along(self) -> tuple[Limit, ...]:
        """All that is asked along the trajectory."""
        return self.limits if self.rate is None else (*self.limits, self.rate)


@dataclass(frozen=True, eq=False, kw_only=True)
class Environment:
    """Where the poles of one body's loop are looked at; ``affine`` (offset, slope) where the law knows another body."""

    world: Setting
    place: Place
    affine: tuple[Array, Array] | None = None

    def coefficients(self, K: Any) -> tuple[Any, ...]:
        """Of the characteristic polynomial (24)-(25), for gains ``K`` (numbers or CasADi expressions)."""
        world, (A, load, beta) = self.world, self.place
        if self.affine is None:
            return characteristic(world.biped, world.law, K, A, load, world.adapt, beta)
        offset, slope = self.affine
        return tuple(
            offset[k] + sum(float(slope[k, j]) * K[j] for j in range(3) if slope[k, j]) for k in range(len(offset))
        )

    def slacks(self, K: Any) -> tuple[Any, ...]:
        """(27)-(29) without units."""
        return normalised_slacks(self.world.biped, self.world.law, K, *self.place)


class Question:
    """The parts of the program that do not change: bodies, limits, environments, bounds, scales.

    ``lower``, ``upper`` (3,): the working box of gains, which lies within the spec's bounds ``lower``, ``widest``; see
    ``problems.gains.working_box`` for ``reach``.
    """

    def __init__(self, setting: Setting, beside: Sequence[Setting] = (), reach: float = 1.0) -> None:
        self.setting, self.reach = setting, reach
        self.worlds = (setting, *beside)
        self.environments: list[Environment] = [each for world in self.worlds for each in environments(world)]
        self.lower, self.widest = _bounds(setting)
        self.upper: Array = working_upper(setting, self.environments, self.lower, self.widest, reach)
        self.scale: Array = np.where(self.upper > 0, self.upper, 1.0)
        biped = setting.biped
        self.pace: float = float(np.sqrt(max(self.upper[0], 1e-9) / biped.I))
        """A typical frequency of the loop [1/s], the scale of decay rates."""
        self.limits: list[Limit] = limits(setting.loop().plant, setting.required)

    def asking(self, setting: Setting) -> Question:
        """The same question about a ``setting`` that differs in levels and objective: bodies and scales stay."""
        return Question(setting, self.worlds[1:], self.reach)

    def level(self, id: str) -> float | None:
        """The hard level of a row in its unit; None where nothing hard is asked."""
        wish = self.setting.required.get(id)
        return None if wish is None or wish.soft else wish.level

    def wish(self, id: str) -> float | None:
        """The soft level of a row."""
        wish = self.setting.required.get(id)
        return wish.level if wish is not None and wish.soft else None

    def asks(self, goal: Goal, id: str) -> bool:
        """Whether row ``id`` is in the program of that ``goal``."""
        return self.level(id) is not None or id == goal.id or (goal.id == "goals" and self.wish(id) is not None)

    @property
    def decay(self) -> float:
        """The decay rate that must be kept [1/s]; a trace above 0, since poles on the axis are not stable."""
        return max(self.level("decay-rate") or 0.0, 1e-7 * self.pace)

    @property
    def coarse_step(self) -> float:
        """A longer integration step that the fastest loop within the bounds allows [s]."""
        biped = self.setting.biped
        fastest = max(self.upper[1] / biped.I, self.pace, self.upper[2] / biped.ell)
        return float(max(self.setting.step, min(COARSEST, 2.0 / fastest)))

    def scale_of(self, id: str) -> float:
        """A typical size of a row's value, in its unit."""
        biped = self.setting.biped
        usual = OBJECTIVES[id].usual if id in OBJECTIVES else None
        if usual is not None:
            return usual
        sizes: dict[str, float] = {
            "decay-rate": self.pace,
            "contact-force": biped.weight,
            "cop-margin": biped.ell,
            "torque": biped.weight * biped.ell,
            "torque-rate": biped.weight * biped.ell * self.pace,
            "step-slope": float(np.degrees(slope_limit(biped))),
            "push": push_limit(biped),
            **dict(zip(("kp", "kd", "kf"), self.scale.tolist(), strict=True)),
        }
        return sizes[id.rstrip(MORE)]

    def scale_or_one(self, id: str) -> float:
        """A typical size of any row's value; 1 for a row that cannot be an objective, such as (27)-(29)."""
        return self.scale_of(id) if id in OBJECTIVES else 1.0

    def size_of(self, id: str) -> float:
        """What a requirement's shortfall is measured in: its level, or a typical size where that is 0."""
        wish = self.setting.required.get(id)
        return abs(float(wish.level)) if wish is not None and wish.level else self.scale_of(id)

    def goal(self, id: str) -> Goal:
        """The goal of that row; raises ``BadInput`` if there is nothing to make of it."""
        if id == "goals" and not any(wish.soft for wish in self.setting.required.values()):
            message = 'is "goals", but no requirement is soft; write one as { min = ..., soft = true }'
            raise BadInput(message, key="synthesis.minimise")
        if id == FEASIBILITY.id:
            return FEASIBILITY
        return goal_of(id, self.scale_of(id))

    def cases(self, goal: Goal) -> list[Case]:
        """Every body in every scenario, and under the disturbances that it must survive, or that are to be large."""
        found = []
        settled = self.level("settling")
        for world in self.worlds:
            loops = {False: world.loop(), True: world.in_a_field().loop()}
            own = {field: self._limits(loop, world.required, field=field) for field, loop in loops.items()}
            rates = {field: self._rate(loop) for field, loop in loops.items()}
            found += [
                Case(
                    name=each.name, loop=loops[each.field], limits=own[each.field], scenario=each,
                    rate=rates[each.field] if self.asks(goal, "torque-rate") else None,
                    marks=() if settled is None else (each.steady_from + settled,),
                )
                for each in world.scenarios
            ]  # fmt: skip
            watched = slope(world.biped, name="", angle=0.1, ramp=0.0, duration=HORIZON)
            for kind in SURVIVALS:
                loop = loops[kind == "step-slope"]
                for side in (1.0, -1.0) if lopsided(loop) else (1.0,):
                    sized = self._sized(kind, goal, side)
                    if sized is not None:
                        bare = self._limits(loop, {}, field=False)
                        found.append(Case(name=kind, loop=loop, limits=bare, scenario=watched, sized=sized))
        return found

    def _limits(self, loop: ClosedLoop, required: dict[str, Required], *, field: bool) -> tuple[Limit, ...]:
        scales = {limit.id: limit.scale for limit in self.limits}
        return tuple(replace(limit, scale=scales[limit.id]) for limit in limits(loop.plant, required, field=field))

    def _rate(self, loop: ClosedLoop) -> Limit:
        z, F, K = ca.SX.sym("z", loop.size), ca.SX.sym("F", 2), ca.SX.sym("K", 3)
        rate = torque_rate_of(loop)(z, F, K)
        return Limit(
            id="torque-rate", equation="(10)", unit="N m/s", scale=self.scale_of("torque-rate"), sense="at most",
            quantity=ca.Function("rate", [z, F, K], [ca.vertcat(rate, -rate)]),
            required=self.setting.required.get("torque-rate"), why="the actuator cannot follow",
        )  # fmt: skip

    def _sized(self, kind: str, goal: Goal, side: float) -> Sized | None:
        unit = side * (np.pi / 180 if kind == "step-slope" else 1.0)
        level, wish = self.level(kind), self.wish(kind)
        base, rate = 0.0 if level is None else level + RESOLUTION * self.scale_of(kind), 0.0
        if goal.id == kind:
            base, rate = 0.0, goal.scale
        elif goal.id == "goals" and wish is not None:
            base, rate = wish, self.size_of(kind)
        elif level is None and not (goal.id == "feasibility" and self._goes_on(kind, wish)):
            return None
        return Sized(kind=kind, base=float(unit * base), rate=float(unit * rate))  # type: ignore[arg-type]

    def _goes_on(self, kind: str, wish: float | None) -> bool:
        """Whether what follows the search for a feasible point has this disturbance in it: both have the same cases."""
        return self.setting.objective == kind or (self.setting.objective == "goals" and wish is not None)

    def score(self, goal: Goal, gains: Gains, verdict: Verdict) -> float:
        """The objective's value at ``gains``, from the rows of its verdict; infinitely bad where one is missing."""
        if goal.gain is not None:
            return float(gains[goal.gain])
        if goal.id == "routh-margin":
            return min(float(slack) for each in self.environments for slack in each.slacks(gains))
        bad = goal.sign * -np.inf
        if goal.id == "goals":
            return max((self._shortfall(row.id, row.value) for row in verdict.rows if self._soft(row.id)), default=bad)
        ids = goal.limits or (goal.id,)
        values = [bad if row.value is None else row.value for row in verdict.rows if row.id in ids]
        return bad if not values else float(min(values) if goal.sign > 0 else max(values))

    def _soft(self, id: str) -> bool:
        return self.wish("contact-force" if id in ("toe-force", "heel-force") else id) is not None

    def _shortfall(self, row: str, value: float | None) -> float:
        id = "contact-force" if row in ("toe-force", "heel-force") else row
        level = self.wish(id)
        if value is None or level is None:
            return np.inf
        return shortfall(OBJECTIVES[id], value, level, self.size_of(id))


def _bounds(setting: Setting) -> tuple[Array, Array]:
    if setting.bounds is None:
        message = "is missing; give [synthesis.bounds] with kp, kd, kf as [lower, upper]: nothing else limits the gains"
        raise BadInput(message, key="synthesis.bounds")
    bounds = setting.bounds.copy()
    if setting.law == "pd":
        bounds[2] = 0.0
    elif np.isnan(bounds[2]).any():
        message = f"is missing; law {setting.law} needs it as [lower, upper]"
        raise BadInput(message, key="synthesis.bounds.kf")
    return bounds[:, 0], bounds[:, 1]


def environments(world: Setting) -> list[Environment]:
    """The environments that decide the linear stability of one body over its scenarios."""
    known = world.known is not None and world.known != world.biped
    if known and (world.law == "cop" or np.isfinite(world.adapt) or not world.plain):
        forces = np.unique(np.concatenate([_marked(scenario, world) for scenario in world.scenarios], axis=1), axis=1)
        some = sorted({int(k) for k in np.linspace(0, forces.shape[1] - 1, KNOWN)})
        bodies = {0.0: world, 1.0: world.in_a_field()}
        return [
            Environment(world=world, place=place, affine=polynomial_map(body.loop(), *map(float, forces[:2, k])))
            for k in some
            for body in [bodies[float(forces[2, k])]]
            for place in standing(body.biped, forces[:2, [k]], world.target).places
        ]
    found: list[Place] = []
    for place in (place for scenario in world.scenarios for place in world.places(scenario)):
        if not any(np.allclose(place, other, rtol=1e-11, atol=0.0) for other in found):  # the same but for rounding
            found.append(place)
    return [Environment(world=world, place=place) for place in found]


def _marked(scenario: Scenario, world: Setting) -> Array:
    """The forces (2, j) of the scenario, and below them 1 where they load the foot too, else 0."""
    F = scenario.operating_forces(world.biped)
    return np.vstack([F, np.full(F.shape[1], float(world.ground_loads and scenario.field))])


def question_decay(question: Question, K: Array) -> float:
    """The decay rate over all environments, from plain eigenvalues: quick, for the survey."""
    return min(-float(np.roots([1.0, *each.coefficients(K)]).real.max()) for each in question.environments)
