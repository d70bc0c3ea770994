"""Receding horizon: estimate, plan, apply the first torque; and what is done when no plan comes back.

A ``Planner`` poses and solves one prediction. ``Receding`` makes a ``Controller`` of it. Whatever the planner's solver
does, the plant gets a finite torque within the actuator's limits: a step that is not solved, or whose answer fails the
recheck, takes the tail of the previous plan as long as that lasts, and then law (20), both within what contact allows
by the load that is measured. Each is counted. The tail is followed with LQR's feedback on what the state has strayed
from it: followed blindly, a plan of one second lets an unstable body stray e^(Omega 1 s), a thousandfold.
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


CARRIED = 0.02
"""The part of the load that each end of the foot keeps, doubled, where no plan takes care of it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Plan:
    """Torques (N,) [N m], each held for ``step`` [s], from ``start`` [s] on; ``states`` (2, N+1) theta and omega."""

    start: float
    step: float
    torque: Array
    states: Array

    def at(self, t: float) -> tuple[float, float, float] | None:
        """Torque, theta and omega planned for ``t`` [s]; None when the plan has ended."""
        place = (t - self.start) / self.step + 1e-9
        k = int(place)
        if not 0 <= k < len(self.torque):
            return None
        theta, omega = self.states[:, k] + (place - k) * (self.states[:, k + 1] - self.states[:, k])
        return float(self.torque[k]), float(theta), float(omega)


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
    """What a receding horizon hands from step to step; ``integral`` is law (20)'s while that is in charge.

    ``reasons`` counts why steps were not planned, by the first words of the planner's detail.
    """

    seen: Seen | None
    torques: tuple[float, ...]
    plan: Plan | None
    integral: float | None
    tally: Tally
    reasons: tuple[tuple[str, int], ...]


def _counted(reasons: tuple[tuple[str, int], ...], outcome: Outcome[Plan]) -> tuple[tuple[str, int], ...]:
    """``reasons`` with the one of ``outcome`` counted."""
    why = (outcome.detail or outcome.status.name.lower())[:80]
    counts = dict(reasons)
    return tuple({**counts, why: counts.get(why, 0) + 1}.items())


@dataclass(frozen=True, eq=False, kw_only=True)
class Receding:
    """A ``Controller`` that plans anew at every call.

    ``delay`` counts the periods by which measurements are late. ``feedback`` (K_p, K_d) [N m/rad, N m s/rad] holds the
    state to a plan's tail; ``fallback`` are the gains of law (20), ``target`` [m] its P_d.
    """

    biped: Biped
    planner: Planner
    informant: Informant
    actuator: Actuator
    feedback: tuple[float, float]
    fallback: Gains
    delay: int = 0
    target: float = 0.0

    def start(self) -> Memory:
        """The memory at t = 0: no torque has been given."""
        return Memory(self.informant.start(), (0.0,) * (self.delay + 1), None, None, Tally(), ())

    def __call__(self, t: float, measurement: Measurement, memory: Memory) -> tuple[float, Memory]:
        """The torque [N m] until the next call, and the memory to hand to it."""
        before = memory.torques[-1]
        belief, seen = self._believed(t, measurement, memory)
        outcome = self._planned(t, belief, before, memory.plan)
        planned, tail, law = memory.tally
        if outcome.status is Status.SOLVED:
            tau = self.actuator.given(outcome.value.torque.item(0), before)
            tally = Tally(planned + 1, tail, law)
            return tau, Memory(seen, (*memory.torques[1:], tau), outcome.value, None, tally, memory.reasons)
        plan, integral = memory.plan, None
        if plan is not None and (left := plan.at(t)) is not None:
            tau, tally = self._held_to(left, belief), Tally(planned, tail + 1, law)
        else:
            plan, tally = None, Tally(planned, tail, law + 1)
            tau, integral = self._by_law(t, measurement, before, memory.integral)
        tau = self.actuator.given(self._in_contact(tau, measurement, memory.torques[0]), before)
        reasons = _counted(memory.reasons, outcome)
        return tau, Memory(seen, (*memory.torques[1:], tau), plan, integral, tally, reasons)

    def _believed(self, t: float, measurement: Measurement, memory: Memory) -> tuple[Belief | None, Seen | None]:
        """The belief, None where the measurement allows none; the estimate is then left as it was."""
        try:
            belief, seen = self.informant(t, measurement, memory.torques, memory.seen)
        except (ArithmeticError, ValueError):
            return None, memory.seen
        return (belief, seen) if all(map(math.isfinite, (*seen, *belief[:4]))) else (None, memory.seen)

    def _planned(self, t: float, belief: Belief | None, before: float, previous: Plan | None) -> Outcome[Plan]:
        """What the planner says, if it is a number for every step; a planner that raises has not solved."""
        if belief is None:
            return Outcome(status=Status.STALLED, detail="the measurement is not usable")
        try:
            outcome = self.planner.plan(t, belief, before, previous)
        except (ArithmeticError, ValueError, RuntimeError) as error:
            return Outcome(status=Status.STALLED, detail=f"{type(error).__name__}: {error}")
        if outcome.status is Status.SOLVED and not np.isfinite(outcome.value.torque).all():
            return Outcome(status=Status.DISAGREEMENT, detail="a planned torque is not finite")
        return outcome

    def _held_to(self, planned: tuple[float, float, float], belief: Belief | None) -> float:
        torque, theta, omega = planned
        if belief is None:
            return torque
        K_p, K_d = self.feedback
        return torque + K_p * (theta - belief.theta) + K_d * (omega - belief.omega)

    def _by_law(self, t: float, measurement: Measurement, before: float, integral: float | None) -> tuple[float, float]:
        """Law (20), taken over without a jump: its torque and its integral."""
        law = SampledLaw(
            kind="cop", biped=self.biped, gains=self.fallback, period=self.actuator.period, target=self.target
        )
        if integral is None:
            without, _ = law(t, measurement, 0.0)
            gain = self.fallback.K_f * self.biped.weight / self.biped.ell
            integral = (before - without) / gain if gain > 0 else 0.0
        tau, after = law(t, measurement, integral)
        return (tau, after) if math.isfinite(tau) and math.isfinite(after) else (0.0, 0.0)

    def _in_contact(self, tau: float, measurement: Measurement, before: float) -> float:
        """The torque, as far as both ends of the foot then carry a part of the load that is measured.

        ``before`` is the torque under which it was measured: a foot that is not the paper's tells by it where its CoP
        goes, which a torque moves by (1 + h M L/I)/load.
        """
        load = measurement.F_T + measurement.F_H
        if not self.biped.plain:
            return self._in_contact_from(tau, measurement, load, before)
        most = (1 - CARRIED) * self.biped.ell * load if math.isfinite(load) and load > 0 else 0.0
        return min(max(tau, -most), most) if math.isfinite(tau) else 0.0

    def _in_contact_from(self, tau: float, measurement: Measurement, load: float, before: float) -> float:
        biped = self.biped
        turned = -float(biped.behind(measurement.F_T, measurement.F_H))  # P load
        if not (math.isfinite(load) and load > 0 and math.isfinite(turned) and math.isfinite(tau)):
            return 0.0
        middle, room = biped.ell * biped.skew * load, (1 - CARRIED) * biped.ell * load
        moved = 1 + biped.height * biped.M * biped.L / biped.I
        return min(max(tau, before + (turned - middle - room) / moved), before + (turned - middle + room) / moved)
