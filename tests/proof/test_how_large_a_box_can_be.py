"""The largest box that is proved lies below the smallest that simulation breaks, and many bodies march as one does."""

import math
from dataclasses import replace

import numpy as np
import pytest

from design.analysis.many import extremes, least_forces
from design.analysis.simulate import simulate
from design.model.closed_loop import closed_loop
from design.model.environment import constant_force, platform, profile, slope
from design.model.laws import Gains
from design.model.uncertainty import Spread, Tolerances
from design.proof.box import prove
from design.proof.largest import largest
from design.spec.load import load
from design.spec.setting import setting

PROBLEM = setting(load("slope").spec)
BODY = PROBLEM.biped
CALM = Gains(3500.0, 606.2, 5.61)
WIDE = Tolerances(
    M=Spread(part=0.05), L=Spread(part=0.05), I=Spread(part=0.05), m=Spread(absolute=0.05), ell=Spread(part=0.05),
    slope=Spread(absolute=math.radians(2.0)), ramp=Spread(absolute=0.5),
)  # fmt: skip
WORLDS = {
    "ramp": slope(BODY, name="w", angle=math.radians(10), ramp=1.5, duration=3.0),
    "flat": slope(BODY, name="w", angle=0.0, ramp=0.0, duration=2.0),
    "wind": constant_force(name="w", F_x=-40.0, F_y=25.0, ramp=1.0, duration=2.0),
    "train": platform(BODY, name="w", points=np.array([[0.0, 0.0], [0.5, 0.6], [0.5, -0.3]]), duration=2.0),
    "push": profile(name="w", points=np.array([[0.0, 0.0, 0.0], [0.3, 30.0, -20.0], [0.4, 0.0, 0.0]]), duration=1.0),
}


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize(("kind", "adapt"), [("force", math.inf), ("pd", math.inf), ("cop", math.inf), ("force", 0.2)])
def test_many_bodies_at_once_are_what_each_is_alone(world, kind, adapt):
    shares = np.random.default_rng(2).uniform(-1, 1, (3, 7))
    gains = Gains(3500.0, 900.0, 0.0) if kind == "pd" else CALM
    found = extremes(BODY, kind, gains, WORLDS[world], WIDE, shares, step=1e-3, adapt=adapt)
    for k, share in enumerate(shares):
        body, scenario = WIDE.drawn(BODY, WORLDS[world], share)
        loop = closed_loop(body, kind, 0.0, adapt, BODY)
        run = simulate(loop, scenario, gains, 1e-3)
        assert (found.toe[k], found.heel[k]) == pytest.approx((run.F_T.min(), run.F_H.min()), abs=0.2)
        assert found.cop[k] == pytest.approx((body.ell - np.abs(run.P)).min(), abs=1e-4)
        assert found.torque[k] == pytest.approx(np.abs(run.tau).max(), abs=0.02)
        x = np.vstack([run.theta, run.omega])
        share = body.m / body.M if scenario.field else 0.0  # of the force, on the foot
        along = loop.plant.friction.map(run.t.size)(x, run.tau[None], run.F).full().ravel() - share * run.F[0]
        slip = along / (run.F_T + run.F_H - share * run.F[1])
        assert found.friction[k] == pytest.approx(np.abs(slip).max(), abs=2e-3)


def test_a_body_that_falls_has_lost_contact():
    toe, heel = least_forces(
        BODY, "force", Gains(300.0, 50.0, 1.0), WORLDS["ramp"], Tolerances(), np.zeros((1, 7)), step=1e-3
    )
    assert min(toe[0], heel[0]) < 0


@pytest.mark.slow
def test_what_is_proved_lies_below_what_is_broken():
    step = replace(
        PROBLEM, scenarios=(slope(BODY, name="w", angle=math.radians(1.5), ramp=0.0, duration=1.0),),
        tolerances=Tolerances(L=Spread(part=0.02), slope=Spread(absolute=math.radians(0.5))),
    )  # fmt: skip
    found = largest(step, CALM, "w", seconds=8.0)
    assert 0 < found.proved <= found.unbroken
    assert not found.beyond
    assert prove(step, CALM, "w", scale=0.99 * found.proved).answer == "proved"
    broken = step.tolerances.scaled(1.1 * found.unbroken)
    corners = [[0, a, 0, 0, 0, b, 0] for a in (-1, 1) for b in (-1, 1)]
    toe, heel = least_forces(BODY, "force", CALM, step.scenarios[0], broken, corners, step=1e-3)
    assert min(toe.min(), heel.min()) < 0
    assert prove(step, CALM, "w", scale=1.1 * found.unbroken, seconds=10.0).answer != "proved"


def test_without_a_box_there_is_nothing_to_seek():
    with pytest.raises(ValueError, match="no box"):
        largest(PROBLEM, CALM, "ramp")
