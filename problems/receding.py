"""Receding horizon: estimate, plan, apply the first torque; and what is done when no plan comes back.

A ``Planner`` poses and solves one prediction. ``Receding`` makes a ``Controller`` of it. Whatever the planner's solver
does, the plant gets a finite torque within the actuator's limits: a step that is not solved, or whose answer fails the
recheck, takes the tail of the previous plan as long as that lasts, and then law (20), within what contact allows by the
load that is measured. Each is counted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from design.analysis.observer import Belief, Informant, Seen
from design.model.actuator import Actuator
from design.model.body import Biped
from design.model.laws import Gains, Measurement, SampledLaw
from design.solvers.outcome import Outcome, Status

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class Plan:
    """Torques (N,) [N m], each held for ``step`` [s], from ``start`` [s] on; ``states`` (2, N+1) theta and omega."""

    start: float
    step: float
    torque: Array
    states: Array

    def at(self, t: float) -> float | None:
        """The torque planned for ``t`` [s]; None when the plan has ended."""
        k = int((t - self.start) / self.step + 1e-9)
        return float(self.torque[k]) if 0 <= k < len(self.torque) else None


class Planner(Protocol):
    """One prediction: posed, solved, and rechecked."""

    def plan(self, t: float, belief: Belief, before: float, previous: Plan | None) -> Outcome[Plan]:
        """The plan from ``t`` [s] on; ``before`` [N m] is the torque until now, ``previous`` the last plan."""
        ...


class Tally(NamedTuple):
    """How many steps were planned, took the previous plan's tail, and took law (20)."""

    planned: int = 0
    tail: int = 0
    law: int = 0


class Memory(NamedTuple):
    """What a receding horizon hands from step to step; ``integral`` is law (20)'s while that is in charge."""

    seen: Seen | None
    torques: tuple[float, ...]
    plan: Plan | None
    integral: float | None
    tally: Tally
    said: str


@dataclass(frozen=True, eq=False, kw_only=True)
class Receding:
    """A ``Controller`` that plans anew at every call.

    ``delay`` counts the periods by which measurements are late. ``fallback`` are the gains of law (20).
    """

    biped: Biped
    planner: Planner
    informant: Informant
    actuator: Actuator
    fallback: Gains
    delay: int = 0

    def start(self) -> Memory:
        """The memory at t = 0: no torque has been given."""
        return Memory(self.informant.start(), (0.0,) * (self.delay + 1), None, None, Tally(), "")

    def __call__(self, t: float, measurement: Measurement, memory: Memory) -> tuple[float, Memory]:
        """The torque [N m] until the next call, and the memory to hand to it."""
        before = memory.torques[-1]
        belief, seen = self.informant(t, measurement, memory.torques, memory.seen)
        outcome = self._planned(t, belief, before, memory.plan)
        tally, plan, integral = memory.tally, memory.plan, None
        if outcome.status is Status.SOLVED:
            plan = outcome.value
            tau, tally = float(plan.torque[0]), tally._replace(planned=tally.planned + 1)
        elif plan is not None and (tail := plan.at(t)) is not None:
            tau, tally = tail, tally._replace(tail=tally.tail + 1)
        else:
            plan = None
            tau, integral = self._by_law(t, measurement, before, memory.integral)
            tally = tally._replace(law=tally.law + 1)
        tau = self.actuator.given(tau, before)
        torques = (*memory.torques[1:], tau)
        return tau, Memory(seen, torques, plan, integral, tally, outcome.detail)

    def _planned(self, t: float, belief: Belief, before: float, previous: Plan | None) -> Outcome[Plan]:
        """What the planner says, if it is a number for every step; a planner that raises has not solved."""
        if not all(map(math.isfinite, belief[:4])):
            return Outcome(status=Status.STALLED, detail="the estimate is not finite")
        try:
            outcome = self.planner.plan(t, belief, before, previous)
        except (ArithmeticError, ValueError, RuntimeError) as error:
            return Outcome(status=Status.STALLED, detail=f"{type(error).__name__}: {error}")
        if outcome.status is Status.SOLVED and not np.isfinite(outcome.value.torque).all():
            return Outcome(status=Status.DISAGREEMENT, detail="a planned torque is not finite")
        return outcome

    def _by_law(self, t: float, measurement: Measurement, before: float, integral: float | None) -> tuple[float, float]:
        """Law (20), taken over without a jump, within the torque that the measured load bears."""
        law = SampledLaw(kind="cop", biped=self.biped, gains=self.fallback, period=self.actuator.period)
        if integral is None:
            without, _ = law(t, measurement, 0.0)
            gain = self.fallback.K_f * self.biped.weight / self.biped.ell
            integral = (before - without) / gain if gain > 0 else 0.0
        tau, integral = law(t, measurement, integral)
        load = measurement.F_T + measurement.F_H
        most = self.biped.ell * load if math.isfinite(load) and load > 0 else 0.0
        if not math.isfinite(tau):
            tau, integral = 0.0, 0.0
        return min(max(tau, -most), most), integral
