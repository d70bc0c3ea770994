"""The external force, read off a foot whose levers are unequal and whose ankle has a height."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.analysis.estimate import Signals, at_rest, dynamic, evenly, off, static, static_estimate
from design.analysis.simulate import simulate
from design.model.body import Biped
from design.model.plant import plant
from design.model.sensing import Sensors
from design.model.standing import standing
from design.model.uncertainty import Spread, Tolerances
from design.spec.load import load
from design.spec.setting import setting

FEET = setting(load("adult-foot").spec)
RUN = simulate(FEET.loop(), FEET.scenarios[0], FEET.given_gains(), 1e-3)
SIGNALS = evenly(Signals(RUN.t, RUN.theta, RUN.omega, RUN.F_T, RUN.F_H), 2e-3)
NONE = Tolerances()

feet = st.builds(
    lambda toe, heel, height: Biped(
        M=68.0, L=0.92, I=70.0, m=2.0, ell=(toe + heel) / 2, skew=(toe - heel) / (toe + heel), height=height
    ),
    st.floats(0.05, 0.3), st.floats(0.05, 0.3), st.floats(0.0, 0.2),
)  # fmt: skip
shares, forces = st.floats(-0.6, 0.6), st.floats(-150.0, 150.0)


@given(foot=feet, share=shares, F_x=forces, F_y=forces)
@settings(max_examples=60, deadline=None)
def test_at_a_true_equilibrium_the_static_estimate_is_exact(foot, share, F_x, F_y):
    target = foot.ell * (foot.skew + share)
    rest = standing(foot, np.array([[F_x], [F_y]]), target)
    F_T, F_H = plant(foot).forces([rest.theta[0], 0.0], rest.tau[0], [F_x, F_y]).full()
    assert foot.pressure(F_T, F_H)[0] == pytest.approx(target, abs=1e-9)
    found = static_estimate(foot, rest.theta, F_T, F_H, target)
    assert np.ravel(found) == pytest.approx([F_x, F_y], rel=1e-9, abs=1e-7)


@given(foot=feet, share=shares, F_x=forces, F_y=forces, theta=st.floats(-0.5, 0.5), omega=st.floats(-2, 2),
       tau=st.floats(-100, 100))  # fmt: skip
@settings(max_examples=60, deadline=None)
def test_what_motion_does_to_the_static_estimate_is_said_exactly(foot, share, F_x, F_y, theta, omega, tau):
    target = foot.ell * (foot.skew + share)
    F_T, F_H = plant(foot).forces([theta, omega], tau, [F_x, F_y]).full()
    acceleration = plant(foot).dynamics([theta, omega], tau, [F_x, F_y]).full()[1]
    found = np.ravel(static_estimate(foot, np.array([theta]), F_T, F_H, target))
    wrong = off(foot, np.array([theta]), np.array([omega]), acceleration, foot.behind(F_T, F_H, target))
    assert found - np.ravel(wrong) == pytest.approx([F_x, F_y], rel=1e-9, abs=1e-7)


def test_the_dynamic_estimate_follows_the_force_while_the_foot_is_leant_on():
    later = SIGNALS.t > 0.1
    truth = FEET.scenarios[0].force_at(SIGNALS.t)
    found = dynamic(FEET.biped, SIGNALS, Sensors(), NONE, walk=5.0)
    assert np.abs(found.F - truth)[:, later].max() < 0.05
    still = static(FEET.biped, SIGNALS, Sensors(), NONE, FEET.target)
    assert np.abs(still.F - truth)[:, later].max() > 10.0


def test_at_the_end_it_rests_and_says_so():
    rest = at_rest(FEET.biped, SIGNALS, Sensors(), NONE, FEET.target)
    assert rest.stationary
    assert rest.F == pytest.approx(tuple(RUN.F[:, -1]), abs=0.2)
    assert not at_rest(FEET.biped, SIGNALS, Sensors(), NONE, 0.0).stationary  # its CoP is not under the ankle


@pytest.mark.parametrize("estimate", ["static", "dynamic"])
def test_noise_spreads_the_estimates_as_predicted(estimate):
    sensors = Sensors(angle=1e-3, rate=1e-2, force=2.0)
    signals = Signals(*(part[::5] for part in SIGNALS))

    def found(signals):
        if estimate == "static":
            return static(FEET.biped, signals, sensors, NONE, FEET.target)
        return dynamic(FEET.biped, signals, sensors, NONE, walk=5.0)

    clean, errors = found(signals), []
    for seed in range(20):
        draw = np.random.default_rng(seed).standard_normal((4, len(signals.t)))
        deviations = np.array([sensors.angle, sensors.rate, sensors.force, sensors.force])[:, None]
        noisy = Signals(signals.t, *(np.array(signals[1:]) + deviations * draw))
        errors.append(found(noisy).F - clean.F)
    window = slice(500, 1000)
    measured = np.sqrt((np.array(errors)[:, :, window] ** 2).mean(axis=(0, 2)))
    assert measured == pytest.approx(np.sqrt((clean.spread[:, window] ** 2).mean(axis=1)), rel=0.2)


def test_a_body_within_its_tolerances_makes_no_larger_error_than_said():
    wide = Tolerances(M=Spread(part=0.01), I=Spread(part=0.02), ell=Spread(absolute=0.001))
    for corner in ([1, 0, 1, 0, 1], [-1, 0, 1, 0, -1], [1, 0, -1, 0, -1]):
        real, _ = wide.drawn(FEET.biped, FEET.scenarios[0], [*corner, 0.0, 0.0])
        for said, true in (
            (static(FEET.biped, SIGNALS, Sensors(), wide, 0.03), static(real, SIGNALS, Sensors(), NONE, 0.03)),
            (
                dynamic(FEET.biped, SIGNALS, Sensors(), wide, walk=5.0),
                dynamic(real, SIGNALS, Sensors(), NONE, walk=5.0),
            ),
        ):
            assert (np.abs(said.F - true.F)[:, 5:] <= 1.06 * said.bias[:, 5:] + 1e-2).all()


def test_a_mirrored_foot_reads_the_mirrored_force():
    mirror = Biped(M=68.0, L=0.92, I=70.0, m=2.0, ell=0.12, skew=-0.5, height=0.08)
    turned = Signals(SIGNALS.t, -SIGNALS.theta, -SIGNALS.omega, SIGNALS.F_H, SIGNALS.F_T)
    one = dynamic(FEET.biped, SIGNALS, Sensors(), NONE, walk=5.0).F
    other = dynamic(mirror, turned, Sensors(), NONE, walk=5.0).F
    assert other[0] == pytest.approx(-one[0], abs=1e-6)
    assert other[1] == pytest.approx(one[1], abs=1e-6)
    assert math.isclose(mirror.toe, FEET.biped.heel)
