"""Linear stability is that of the loop that is simulated: (23) is its linearisation, (24)-(29) follow from (23).

Eigenvalues, NumPy's polynomials and finite differences are the peers.
"""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from design.model.body import Biped
from design.model.closed_loop import closed_loop
from design.model.deciding import deciding_points
from design.model.laws import Gains
from design.model.stability import (
    characteristic,
    closed_loop_matrix,
    decay_rate,
    is_hurwitz,
    normalised_slacks,
    routh_hurwitz,
    shifted,
)

PAPER = Biped(M=50.0, L=0.75, I=50.0 * 0.75**2 / 4, m=0.1, ell=0.1)
ADULT = Biped(M=72.5, L=0.93, I=84.0, m=2.4, ell=0.12, g=9.80665)
KINDS = ["pd", "force", "cop"]
FORCES = [(0.0, 0.0), (245.25, 65.7145), (-80.0, 0.0), (60.0, -120.0), (-150.0, 210.0)]
several = settings(max_examples=120, deadline=None)

gains_ = st.builds(Gains, st.floats(10.0, 6000.0), st.floats(1.0, 2000.0), st.floats(-5.0, 25.0))
bipeds = st.sampled_from([PAPER, ADULT])
environments = st.tuples(st.floats(50.0, 1500.0), st.floats(200.0, 1500.0))  # A, load [N]
coefficients = st.lists(st.floats(-60.0, 60.0), min_size=2, max_size=3)


def environment(biped, force):
    """A, theta_f (3)-(4) and the load at rest."""
    F_x, F_y = force
    down = biped.M * biped.g - F_y
    return math.hypot(down, F_x), math.atan2(-F_x, down), biped.weight - F_y


def stationary(biped, kind, gains, theta_d, force):
    """(14), with K_F in place of K_f for law cop."""
    _, theta_f, _ = environment(biped, force)
    if kind == "pd":
        return np.array([theta_f, 0.0, 0.0])
    K = gains.K_f * (biped.weight / biped.ell if kind == "cop" else 1.0)
    return np.array([theta_f, 0.0, -gains.K_p / K * (theta_d - theta_f)])


def slowest(p):
    return float(np.roots([1.0, *p]).real.max())


def size(p):
    return max((abs(c) ** (1 / (k + 1)) for k, c in enumerate(p)), default=0.0)


# ---- (23) and the loop


@pytest.mark.parametrize("force", FORCES)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("biped", [PAPER, ADULT], ids=["paper", "adult"])
def test_the_matrix_is_the_loop_linearised_about_its_stationary_posture(biped, kind, force):
    gains, (A, theta_f, load) = Gains(2600.0, 700.0, 1.7), environment(biped, force)
    theta_d = theta_f if kind == "pd" else 0.07  # a pd law rests at theta_f only if it is told to
    loop = closed_loop(biped, kind, theta_d)
    rest = stationary(biped, kind, gains, theta_d, force)
    assert np.abs(loop.rate(rest, force, gains).full()).max() < 1e-8

    found = closed_loop_matrix(biped, kind, gains, A, load)
    n, by = len(found), 1e-5
    columns = [
        (loop.rate(rest + by * e, force, gains) - loop.rate(rest - by * e, force, gains)).full().ravel()[:n] / (2 * by)
        for e in np.eye(3)[:n]
    ]
    differences = np.column_stack(columns)
    for row, expected in zip(found, differences, strict=True):  # states in the order of the loop: theta, omega, s
        assert row == pytest.approx(expected, rel=1e-6, abs=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("theta_d", [-0.3, 0.0, 0.25])
def test_pd_is_judged_where_its_stiffness_must_be_greatest(theta_d):
    """At its true stationary posture a pd law has at least the stiffness of the matrix that judges it."""
    gains, force = Gains(2600.0, 700.0, 0.0), FORCES[1]
    A, theta_f, load = environment(PAPER, force)
    theta = theta_d
    for _ in range(200):  # A L sin(theta - theta_f) = K_p (theta - theta_d), a contraction as A L < K_p
        theta = theta_d + A * PAPER.L * math.sin(theta - theta_f) / gains.K_p
    loop, by = closed_loop(PAPER, "pd", theta_d), 1e-5
    ahead, behind = (float(loop.rate([theta + d, 0, 0], force, gains)[1]) for d in (by, -by))
    assert ahead + behind == pytest.approx(0.0, abs=1e-6)
    assert (ahead - behind) / (2 * by) <= closed_loop_matrix(PAPER, "pd", gains, A, load)[1, 0] + 1e-6


@pytest.mark.parametrize("kind", KINDS)
@given(biped=bipeds, gains=gains_, place=environments)
@several
def test_the_characteristic_polynomial_is_that_of_the_matrix(kind, biped, gains, place):
    matrix = closed_loop_matrix(biped, kind, gains, *place)
    expected = np.poly(matrix)
    found = characteristic(biped, kind, gains, *place)
    norm = np.linalg.norm(matrix / (1 + np.abs(matrix).max())) * (1 + np.abs(matrix).max())
    assert len(found) == len(matrix)
    for power, (ours, theirs) in enumerate(zip(found, expected[1:], strict=True), start=1):
        assert ours == pytest.approx(theirs, rel=1e-7, abs=1e-13 * norm**power)


@given(gains=gains_, A=st.floats(50.0, 1500.0))
@several
def test_the_coefficients_are_the_printed_ones(gains, A):
    K_p, K_d, K_f = gains
    I, L, ell = PAPER.I, PAPER.L, PAPER.ell
    printed = ((K_d * ell - K_f * I) / (I * ell), (K_p - A * L) / I, K_f * A * L / (I * ell))  # (25)
    assert characteristic(PAPER, "force", gains, A, None) == pytest.approx(printed, rel=1e-9, abs=1e-9)


# ---- (26)-(29)


@given(p=coefficients)
@several
def test_hurwitz_if_and_only_if_every_root_is_in_the_left_half_plane(p):
    assume(abs(slowest(p)) > 1e-4 * size(p))
    assert is_hurwitz(p) is (slowest(p) < 0)


@pytest.mark.parametrize("kind", KINDS)
@given(biped=bipeds, gains=gains_, place=environments)
@several
def test_a_loop_is_hurwitz_if_and_only_if_its_eigenvalues_are_in_the_left_half_plane(kind, biped, gains, place):
    eigenvalues = np.linalg.eigvals(closed_loop_matrix(biped, kind, gains, *place))
    assume(abs(eigenvalues.real.max()) > 1e-6 * np.abs(eigenvalues).max())
    stable = bool(eigenvalues.real.max() < 0)
    assert is_hurwitz(characteristic(biped, kind, gains, *place)) is stable


@pytest.mark.parametrize("p", [(0.0, 1.0, 0.0), (1.0, 1.0, 1.0), (2.0, 1.0, 0.0), (0.0, 4.0), (3.0, 0.0)])
def test_a_root_on_the_imaginary_axis_is_not_hurwitz(p):
    assert slowest(p) == pytest.approx(0.0, abs=1e-12)
    assert not is_hurwitz(p)


@pytest.mark.parametrize("kind", KINDS)
@given(biped=bipeds, gains=gains_, place=environments)
@several
def test_the_printed_inequalities_hold_together_if_and_only_if_the_loop_is_stable(kind, biped, gains, place):
    rows = routh_hurwitz(biped, kind, gains, *place)
    pairs = [pair for row in rows.values() for pair in row]
    assume(all(abs(left - right) > 1e-9 * (abs(left) + abs(right)) for left, right in pairs))
    assert all(left > right for left, right in pairs) is is_hurwitz(characteristic(biped, kind, gains, *place))


@pytest.mark.parametrize("kind", KINDS)
@given(biped=bipeds, gains=gains_, place=environments)
@several
def test_the_slacks_without_units_say_the_same(kind, biped, gains, place):
    slacks = normalised_slacks(biped, kind, gains, *place)
    assume(min(abs(slack) for slack in slacks) > 1e-9)
    stable = is_hurwitz(characteristic(biped, kind, gains, *place))
    assert min(slacks) < 1
    assert (min(slacks) > 0) is stable
    assert not stable or max(slacks) < 1


def test_the_inequalities_for_the_paper_s_gains():
    A = PAPER.M * PAPER.g
    rows = routh_hurwitz(PAPER, "force", Gains(3500.0, 1200.0, 1.0), A, PAPER.weight)
    assert rows["stiffness"] == [(3500.0, pytest.approx(367.875)), (pytest.approx(367.875), 0.0)]  # (27)
    assert rows["damping"] == [(pytest.approx(0.1 / 7.03125 * 1200.0), 1.0), (1.0, 0.0)]  # (28)
    assert rows["routh"] == [(pytest.approx((120.0 - 7.03125) * 3500.0), pytest.approx(120.0 * 367.875))]  # (29)


# ---- the decay rate


@given(p=coefficients, sigma=st.floats(-20.0, 20.0))
@several
def test_shifting_is_substituting_mu_minus_sigma(p, sigma):
    expected = np.polynomial.Polynomial([*reversed(p), 1.0])(np.polynomial.Polynomial([-sigma, 1.0]))
    scale = (size(p) + abs(sigma)) ** np.arange(1, len(p) + 1)
    found = np.array(shifted(p, sigma))
    assert np.all(np.abs(found - expected.coef[-2::-1]) <= 1e-13 * (scale + 1e-9))


@given(p=coefficients)
@several
def test_the_decay_rate_is_that_of_the_slowest_eigenvalue(p):
    roots = np.roots([1.0, *p])
    apart = min(abs(a - b) for k, a in enumerate(roots) for b in roots[k + 1 :])
    assume(apart > 1e-2 * size(p) > 0)
    assert decay_rate(p) == pytest.approx(-roots.real.max(), rel=0, abs=1e-9 * size(p))


@pytest.mark.parametrize("kind", KINDS)
@given(biped=bipeds, gains=gains_, place=environments)
@several
def test_the_decay_rate_is_positive_if_and_only_if_the_loop_is_stable(kind, biped, gains, place):
    p = characteristic(biped, kind, gains, *place)
    rate = decay_rate(p)
    assume(abs(rate) > 1e-11 * size(p))
    assert (rate > 0) is is_hurwitz(p)


@given(numerator=st.integers(-4000, 4000).filter(bool), halvings=st.integers(0, 8))
@several
def test_the_decay_rate_at_a_multiple_pole_keeps_all_its_digits(numerator, halvings):
    """(lambda + a)³ and (lambda + a)² with coefficients that are exact; a solver of eigenvalues keeps a third."""
    a = numerator / 2**halvings
    assert Fraction(a) ** 3 == Fraction(a**3)
    assert decay_rate((3 * a, 3 * a**2, a**3)) == pytest.approx(a, rel=0, abs=1e-9)
    assert decay_rate((2 * a, a**2)) == pytest.approx(a, rel=0, abs=1e-9)


def test_eigenvalues_alone_would_lose_the_multiple_pole():
    a = 12.1875
    p = (3 * a, 3 * a**2, a**3)
    assert abs(-slowest(p) - a) > 1e-6
    assert abs(decay_rate(p) - a) < 1e-11


@given(gains=gains_, low=st.floats(50.0, 700.0), more=st.floats(1.0, 700.0), kind=st.sampled_from(["force", "pd"]))
@settings(max_examples=40, deadline=None)
def test_over_a_range_of_environments_the_two_ends_decide(kind, gains, low, more):
    A = np.linspace(low, low + more, 41)
    rates = [decay_rate(characteristic(PAPER, kind, gains, each, PAPER.weight)) for each in A]
    ends, loads = deciding_points(kind, A[np.random.default_rng(3).permutation(41)], np.full(41, PAPER.weight))
    assert set(ends) == {A[0], A[-1]}
    at_ends = min(decay_rate(characteristic(PAPER, kind, gains, *place)) for place in zip(ends, loads, strict=True))
    assert min(rates) >= at_ends - 1e-9 * (1 + abs(at_ends))


def test_for_law_20_every_environment_that_differs_decides():
    A, load = np.array([500.0, 490.5, 500.0, 480.0]), np.array([400.0, 491.5, 400.0, 600.0])
    found = deciding_points("cop", A, load)
    assert set(zip(*found, strict=True)) == {(500.0, 400.0), (490.5, 491.5), (480.0, 600.0)}


def test_law_20_under_a_lighter_load_is_law_8_with_more_feedback():
    light = 0.8 * PAPER.weight
    cop = characteristic(PAPER, "cop", Gains(3500.0, 1200.0, 1.0), 480.0, light)
    force = characteristic(PAPER, "force", Gains(3500.0, 1200.0, 1.25), 480.0, light)
    assert cop == pytest.approx(force, rel=1e-12)
