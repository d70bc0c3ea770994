"""Whatever a planner does, the ankle gets a finite torque within its limits, and each failure is counted."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.analysis.observer import observer
from design.model.actuator import Actuator
from design.model.body import Biped
from design.model.environment import slope
from design.model.laws import Gains, Measurement
from design.model.limits import Required
from design.model.sensing import Sensors
from design.model.tuning import Tuning
from design.solvers.outcome import Outcome, Status
from problems.comparison.trial import World, run
from problems.mpc_linear import LinearPlanner
from problems.prediction import horizon
from problems.receding import Plan, Receding, Tally

PAPER = Biped(M=50.0, L=0.75, I=7.03125, m=0.1, ell=0.1)
GAINS = Gains(3500.0, 1200.0, 1.0)
ANKLE = Actuator(period=0.01, torque=45.0, rate=2000.0)
GENTLE = slope(PAPER, name="gentle", angle=math.radians(4.0), ramp=0.5, duration=1.5)

FAULTS = [*[status for status in Status if status is not Status.SOLVED], "nan", "inf", "raises", "runtime", "overflow"]


@dataclass
class Faulty:
    """A planner that fails as told at the steps that are told."""

    planner: LinearPlanner
    faults: dict
    asked: list = field(default_factory=list)

    def plan(self, t, belief, before, previous):
        fault = self.faults.get(len(self.asked))
        self.asked.append(fault)
        if fault is None:
            return self.planner.plan(t, belief, before, previous)
        if isinstance(fault, Status):
            return Outcome(status=fault, detail=fault.name)
        if fault in ("nan", "inf"):
            torque = np.full(20, 1.0)
            torque[-1 if fault == "nan" else 0] = float(fault)
            plan = Plan(start=t, step=0.02, torque=torque, states=np.zeros((2, 21)))
            return Outcome(status=Status.SOLVED, found=plan)
        raise {"raises": ValueError, "runtime": RuntimeError, "overflow": OverflowError}[fault]("injected")


def _receding(faults, sensors=None, actuator=ANKLE):
    tuning = Tuning(horizon=25)
    sensors = sensors or Sensors()
    inner = LinearPlanner(horizon=horizon(PAPER, tuning, actuator, {"contact-force": Required(level=0.0)}))
    informant = observer(PAPER, sensors, period=actuator.period, walk=5.0)
    planner = Faulty(inner, faults)
    return planner, Receding(
        biped=PAPER, planner=planner, informant=informant, actuator=actuator, feedback=(2600.0, 190.0),
        fallback=GAINS, delay=informant.delay,
    )  # fmt: skip


def _through(control, scenario=GENTLE, sensors=None, actuator=ANKLE):
    world = World(biped=PAPER, scenario=scenario, sensors=sensors or Sensors(), draws=None)
    return run(world, control, actuator, 0.001)


@given(st.dictionaries(st.integers(0, 149), st.sampled_from(FAULTS), max_size=60))
@settings(max_examples=25, deadline=None)
def test_failures_at_random_steps_are_counted_and_the_torque_stays_within_its_limits(faults):
    planner, control = _receding(faults)
    ended = _through(control)
    failed = sum(fault is not None for fault in planner.asked)
    tally = ended.memory.tally
    assert not ended.failed
    assert np.isfinite(ended.torque).all()
    assert np.abs(ended.torque).max() <= ANKLE.torque
    assert np.abs(np.diff(ended.torque, prepend=0.0)).max() <= ANKLE.rate * ANKLE.period + 1e-9
    assert sum(tally) == len(ended.t)
    assert tally.tail + tally.law == failed


@pytest.mark.parametrize("fault", FAULTS, ids=str)
def test_a_failure_is_answered_by_the_tail_of_the_last_plan(fault):
    _, control = _receding({3: fault})
    ended = _through(control)
    _, sound = _receding({})
    good = _through(sound)
    assert ended.memory.tally == Tally(planned=len(ended.t) - 1, tail=1, law=0)
    assert ended.torque[:3] == pytest.approx(good.torque[:3])
    assert not ended.lost
    assert ended.states[0, -1] == pytest.approx(good.states[0, -1], abs=1e-4)


def test_when_the_plan_has_ended_law_20_takes_over_without_a_jump_and_stands():
    _, control = _receding(dict.fromkeys(range(5, 10_000), Status.TIME_LIMIT))
    long = replace(GENTLE, duration=4.0)
    ended = _through(control, long)
    tally = ended.memory.tally
    assert tally.planned == 5
    assert tally.tail == 49  # what was left of 25 steps of 20 ms, in periods of 10 ms
    assert tally.law == len(ended.t) - 54
    assert not ended.lost
    assert abs(ended.torque[54] - ended.torque[53]) < 1.0
    assert ended.states[0, -1] == pytest.approx(-math.radians(4.0), abs=0.01)


def test_without_any_plan_it_is_law_20_from_the_start():
    _, control = _receding(dict.fromkeys(range(10_000), "raises"))
    ended = _through(control)
    assert ended.memory.tally == Tally(planned=0, tail=0, law=len(ended.t))
    assert not ended.lost


@given(st.sampled_from([math.nan, math.inf, -math.inf, 1e300]), st.integers(0, 3), st.floats(-50.0, 50.0))
@settings(max_examples=40, deadline=None)
def test_a_measurement_that_is_no_number_gives_a_torque_that_is_one(bad, which, before):
    _, control = _receding({})
    seen = [0.01, 0.1, 240.0, 250.0]
    seen[which] = bad
    memory = control.start()
    _, memory = control(0.0, Measurement(0.0, 0.0, 245.0, 245.0), memory)
    with np.errstate(all="ignore"):
        tau, _ = control(0.01, Measurement(*seen), memory)
    assert math.isfinite(tau)
    assert abs(tau) <= ANKLE.torque


def test_late_measurements_are_brought_up_to_now():
    late = Sensors(delay=0.03)
    _, aware = _receding({}, late)
    assert aware.delay == 3
    ended = _through(aware, sensors=late)
    _, prompt = _receding({})
    assert not ended.lost
    assert ended.states[0, -1] == pytest.approx(_through(prompt).states[0, -1], abs=1e-3)


def test_the_same_call_has_the_same_answer_whatever_was_called_between():
    _, control = _receding({})
    memory = control.start()
    for k in range(5):
        _, memory = control(0.01 * k, Measurement(0.01, -0.05, 230.0, 260.0), memory)
    first = control(0.05, Measurement(0.02, 0.1, 200.0, 290.0), memory)
    control(0.05, Measurement(-0.1, 1.0, 20.0, 400.0), memory)
    again = control(0.05, Measurement(0.02, 0.1, 200.0, 290.0), memory)
    assert first[0] == again[0]
    assert first[1].torques == again[1].torques
