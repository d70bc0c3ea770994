"""What a trial leaves of an error in its start: rho(T), against (23), the equations written out, and its own limits."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from design.analysis.contraction import box, contraction, ratios
from design.analysis.estimate import static_estimate
from design.analysis.leftover import exponential, factor, iteration, stays_below
from design.model.body import Biped
from design.model.laws import Gains
from design.model.sensing import Sensors
from design.model.stability import closed_loop_matrix
from design.model.uncertainty import Spread, Tolerances
from design.spec.load import load
from design.spec.setting import setting

STEP = setting(load("slope-step").spec)
BIPED, GAINS = STEP.biped, STEP.gains
A, LOAD = BIPED.M * BIPED.g, BIPED.weight
CASES = [GAINS, Gains(3500.0, 902.6, 8.457), Gains(900.0, 300.0, 0.5)]


def _left(kind, K, T, e, theta_f=-0.1, biped=BIPED, adapt=None):
    """theta(T) - theta_f by (2), (5)-(10) and (20) as the paper prints them, from (theta_f + e, 0, 0)."""
    M, L, I, m, ell, g = biped.M, biped.L, biped.I, biped.m, biped.ell, biped.g
    F_x, F_y = -M * g * math.sin(theta_f), M * g * (1 - math.cos(theta_f))

    def rate(t, z):
        theta, omega, s = z[:3]
        theta_d = theta_f + e
        if adapt:
            theta_d = z[3] - I / (M * g * L * adapt) * omega
        gain = {"pd": 0.0, "force": K.K_f, "cop": K.K_f * (M + m) * g / ell}[kind]
        tau = -K.K_d * omega + K.K_p * (theta_d - theta) + gain * s
        turn = ((M * g - F_y) * L * math.sin(theta) + F_x * L * math.cos(theta) + tau) / I
        f_y = -M * L * turn * math.sin(theta) - M * L * omega**2 * math.cos(theta) + M * g - F_y
        F_T, F_H = (sign * tau / (2 * ell) + m * g / 2 + f_y / 2 for sign in (-1, 1))
        gathered = -(F_T - F_H) / (F_T + F_H) * ell if kind == "cop" else F_H - F_T
        more = [(theta + ell * (F_H - F_T) / (M * g * L) - theta_d) / adapt] if adapt else []
        return [omega, turn, gathered, *more]

    start = [theta_f + e, 0.0, 0.0, *([theta_f + e] if adapt else [])]
    found = solve_ivp(rate, (0.0, T), start, method="DOP853", rtol=1e-11, atol=1e-14)
    return found.y[0, -1] - theta_f


@pytest.mark.parametrize("K", CASES)
@pytest.mark.parametrize("T", [0.1, 0.7, 3.0])
def test_the_factor_is_that_of_23_with_the_integral_off_its_rest(K, T):
    carried = expm(closed_loop_matrix(BIPED, "force", K, A, LOAD) * T) @ [1.0, 0.0, K.K_p / K.K_f]
    assert factor(BIPED, "force", K, A, LOAD, T) == pytest.approx(carried[0], rel=1e-9, abs=1e-12)
    load = 1.1 * LOAD
    own = K.K_f * BIPED.weight / BIPED.ell
    carried = expm(closed_loop_matrix(BIPED, "cop", K, A, load) * T) @ [1.0, 0.0, K.K_p / own]
    assert factor(BIPED, "cop", K, A, load, T) == pytest.approx(carried[0], rel=1e-9, abs=1e-12)


def test_the_exponentials_are_those_of_scipy():
    rng = np.random.default_rng(5)
    mixed = rng.normal(size=(40, 4, 4)) * 10.0 ** rng.uniform(-3, 1.5, (40, 1, 1))
    for mine, its in zip(exponential(mixed), expm(mixed), strict=True):
        assert np.abs(mine - its).max() <= 1e-11 * np.abs(its).max()
    stiff = np.array([iteration(BIPED, "force", K, A, LOAD)[0] for K in CASES])
    for T in (0.01, 1.0, 30.0):
        for mine, its in zip(exponential(T * stiff), expm(T * stiff), strict=True):
            assert np.abs(mine - its).max() <= 1e-8 * np.abs(its).max() + 1e-12


@pytest.mark.parametrize("kind", ["pd", "force", "cop"])
@pytest.mark.parametrize("T", [0.1, 0.7, 3.0])
def test_the_paper_s_equations_leave_that_part_of_a_small_error(kind, T):
    theta_f = -0.1
    load = BIPED.weight - BIPED.M * BIPED.g * (1 - math.cos(theta_f))
    for K in CASES:
        for e in (1e-4, -1e-4):
            left = _left(kind, K, T, e, theta_f)
            assert left / e == pytest.approx(factor(BIPED, kind, K, A, load, T), rel=2e-3, abs=1e-5)


def test_so_they_do_where_the_law_adapts():
    for T in (0.1, 1.0, 4.0):
        left = _left("force", GAINS, T, 1e-4, adapt=1.5)
        assert left / 1e-4 == pytest.approx(factor(BIPED, "force", GAINS, A, LOAD, T, 1.5), rel=1e-4, abs=1e-6)


@given(
    theta=st.floats(-1.2, 1.2), toe=st.floats(1.0, 1e3), heel=st.floats(1.0, 1e3), mass=st.floats(1.0, 200.0),
    foot=st.floats(0.0, 1e-2),
)  # fmt: skip
@settings(max_examples=200, deadline=None)
def test_16_and_17_put_into_15_are_the_angle_itself_whoever_computes_them(theta, toe, heel, mass, foot):
    told = Biped(M=mass, L=0.8, I=30.0, m=foot, ell=0.1)
    F_x, F_y = static_estimate(told, np.array([theta]), np.array([toe]), np.array([heel]))
    theta_d = math.atan(F_x.item() / (F_y.item() - told.M * told.g))  # (15)
    assert theta_d == pytest.approx(theta, abs=1e-9)


def test_a_trial_that_is_too_short_carries_away():
    h = 1e-4
    near = [factor(BIPED, "force", GAINS, A, LOAD, T) for T in (0.0, h, 2 * h)]
    assert near[0] == 1.0
    assert (near[2] - 2 * near[1] + near[0]) / h**2 == pytest.approx(A * BIPED.L / BIPED.I, rel=0.05)
    assert factor(BIPED, "force", GAINS, A, LOAD, 0.05) > 1.0


@pytest.mark.parametrize("K", [*CASES, Gains(3500.0, 300.0, 3.0)])
@pytest.mark.parametrize("level", [1.0, 0.1])
def test_from_the_length_that_is_given_on_it_stays_below(K, level):
    B, start = iteration(BIPED, "force", K, A, LOAD)
    T = stays_below(B[None], start[None], level)
    assert abs(factor(BIPED, "force", K, A, LOAD, T)) == pytest.approx(level, rel=1e-2)
    later = T + np.linspace(1e-3, 30.0, 600)
    assert np.abs(exponential(B * later[:, None, None])[:, 0] @ start).max() < level


def test_pd_never_contracts():
    found = contraction(STEP.with_law("pd"), GAINS._replace(K_f=0.0), STEP.scenarios)
    AL = A * BIPED.L
    assert found.limit == pytest.approx(GAINS.K_p / (GAINS.K_p - AL))
    assert found.limit > 1
    assert factor(BIPED, "pd", GAINS, A, LOAD, 60.0) == pytest.approx(found.limit, rel=1e-9)
    assert found.below_from == {1.0: None, 0.1: None}
    assert not found.contracts
    assert found.check.ratio > 1
    assert _left("pd", GAINS, 10.0, 0.01) == pytest.approx(0.01 * found.limit, rel=1e-3)


def test_law_8_without_its_gain_is_pd():
    bare = GAINS._replace(K_f=0.0)
    found = contraction(STEP.with_law("force", bare), bare, STEP.scenarios)
    assert found.factor == pytest.approx(factor(BIPED, "pd", bare, A, LOAD, 10.0))
    assert found.limit == pytest.approx(GAINS.K_p / (GAINS.K_p - A * BIPED.L))
    assert found.below_from[1.0] is None


def test_an_unstable_loop_has_no_length():
    found = contraction(STEP, Gains(3500.0, 100.0, 5.0), STEP.scenarios)
    assert found.below_from[1.0] is None
    assert not found.contracts


@pytest.mark.parametrize("kind", ["force", "cop"])
def test_simulated_trials_leave_what_rho_says_at_finite_errors_too(kind):
    found = contraction(STEP.with_law(kind, GAINS), GAINS, STEP.scenarios)
    assert found.contracts
    assert found.check.runs >= 4
    assert found.check.off < 1e-3
    (point, *_), _, _ = box(STEP.with_law(kind, GAINS), GAINS, STEP.scenarios)
    e, T = 0.03, found.below_from[0.1]
    measured = ratios(STEP.with_law(kind, GAINS), point, e, T, 2)
    theta_f = -math.acos((point.load - BIPED.m * BIPED.g) / point.A)
    one = _left(kind, GAINS, T, e, -theta_f)
    two = _left(kind, GAINS, T, one, -theta_f)
    assert measured == pytest.approx([one / e, two / one], abs=1e-6)


def test_the_largest_of_the_box_is_no_less_than_elsewhere_in_it_and_where_it_is_said_to_be():
    wide = replace(STEP, tolerances=Tolerances(M=Spread(part=0.1), L=Spread(part=0.1), I=Spread(part=0.1)))
    short = [replace(scenario, duration=1.0) for scenario in STEP.scenarios]
    found = contraction(wide, GAINS, short)
    assert found.corners == 8
    assert found.factor > contraction(STEP, GAINS, short).factor
    at = found.at
    assert found.factor == pytest.approx(abs(factor(at.biped, "force", GAINS, at.A, at.load, 1.0)))
    rng = np.random.default_rng(3)
    for shares in rng.uniform(-1, 1, (60, 7)):
        biped, world = wide.tolerances.drawn(BIPED, short[0], shares.tolist())
        size = world.operating_points(biped)[0].max()
        assert abs(factor(biped, "force", GAINS, size, LOAD, 1.0)) <= found.factor * (1 + 1e-9)


def test_from_noisy_sensors_the_largest_of_the_last_half_second_is_given():
    short = [replace(scenario, duration=2.0) for scenario in STEP.scenarios]
    noisy = contraction(replace(STEP, sensors=Sensors(angle=1e-3)), GAINS, short)
    along = [abs(factor(BIPED, "force", GAINS, A, LOAD, T)) for T in np.linspace(1.5, 2.0, 26)]
    assert max(along) * (1 - 1e-3) <= noisy.factor <= max(along) * (1 + 1e-9)
    assert abs(np.mean(along)) < noisy.factor
    exact = contraction(STEP, GAINS, short)
    assert exact.factor == pytest.approx(along[-1])
    assert noisy.below_from[0.1] == pytest.approx(exact.below_from[0.1] + 0.5)


def test_the_nominal_law_around_another_body_is_what_law_cop_s_gain_becomes():
    from design.analysis.contraction import true_gains

    cop = STEP.with_law("cop", GAINS)
    real = replace(BIPED, M=55.0, ell=0.09)
    its = true_gains(cop, GAINS, real)
    # K_f W/ell ∫ (F_H - F_T) ell/(F_T + F_H), with the nominal W and ell
    nominal = GAINS.K_f * BIPED.weight / BIPED.ell * BIPED.ell
    assert its.K_f * real.weight / real.ell * real.ell == pytest.approx(nominal)
    assert true_gains(STEP, GAINS, real) == GAINS
