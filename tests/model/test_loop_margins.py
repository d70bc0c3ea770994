"""Loop margins from polynomials: against python-control, against grids that miss, and against simulated loops."""

import math

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.model.broken_loop import Break, breaks
from design.model.laws import Gains
from design.model.margins import delay_margin, loop_margins
from design.model.sampling import longest_period, sampled_matrix
from design.model.stability import closed_loop_matrix
from design.spec.load import load
from design.spec.setting import setting

BIPED = setting(load("slope").spec).biped
A, LOAD = BIPED.M * BIPED.g, BIPED.weight
PAPER = Gains(3500.0, 1200.0, 1.0)
DESIGNS = [PAPER, Gains(3500.0, 902.6, 8.457), Gains(3500.0, 606.2, 5.6137), Gains(1500.0, 300.0, 1.0)]


def _loop(K):
    broken = breaks(BIPED, "force", K, A, LOAD)["actuator"]
    return control.tf(broken.Q.coef[::-1], broken.P.coef[::-1])


def _fine(K, function, w):
    broken = breaks(BIPED, "force", K, A, LOAD)["actuator"]
    L = broken.Q(1j * w) / broken.P(1j * w)
    return function(L)


@pytest.mark.parametrize("K", DESIGNS)
def test_gain_and_phase_margin_are_those_of_python_control(K):
    ours = loop_margins(BIPED, "force", K, A, LOAD)
    gain, phase, *_ = control.stability_margins(_loop(K))
    assert math.degrees(ours.phase) == pytest.approx(phase, rel=1e-4)
    assert ours.gain_down == pytest.approx(gain, rel=1e-4)  # the only crossing lies below one
    assert ours.gain_up == math.inf


@pytest.mark.parametrize("K", DESIGNS)
def test_disk_and_modulus_margin_are_those_of_a_very_fine_sweep(K):
    w = np.logspace(-3, 5, 400_001)
    ours = loop_margins(BIPED, "force", K, A, LOAD)
    half = _fine(K, lambda L: np.abs((1 - L) / (1 + L)).max() / 2, w)
    assert ours.disk == pytest.approx(1 / half, rel=1e-5)
    assert ours.disk <= 1 / half * (1 + 1e-12)  # a grid can only miss the peak
    modulus = _fine(K, lambda L: np.abs(1 + L).min(), w)
    assert ours.modulus == pytest.approx(modulus, rel=1e-4)


def test_disk_margin_is_that_of_python_control():
    w = np.logspace(-2, 3, 4001)
    theirs, _, _ = control.disk_margins(_loop(PAPER), w, 0.0)
    assert loop_margins(BIPED, "force", PAPER, A, LOAD).disk == pytest.approx(float(theirs), rel=1e-4)


def test_a_usual_grid_misses_a_narrow_resonance():
    # lightly damped: (K_d ell - K_f I) K_p just above K_d ell A L, so that the peak is a few mrad/s wide
    K_p, K_d = 3500.0, 600.0
    edge = BIPED.ell * K_d / BIPED.I * (1 - A * BIPED.L / K_p)
    K = Gains(K_p, K_d, edge * (1 - 1e-4))
    exact = loop_margins(BIPED, "force", K, A, LOAD).disk
    grid = _fine(K, lambda L: 2 / np.abs((1 - L) / (1 + L)).max(), np.logspace(-1, 3, 1000))
    assert grid > 3 * exact
    w = np.sqrt((K_p - A * BIPED.L) / BIPED.I)  # where the pole pair crosses
    close = _fine(K, lambda L: 2 / np.abs((1 - L) / (1 + L)).max(), np.linspace(0.99 * w, 1.01 * w, 400_001))
    assert exact == pytest.approx(close, rel=1e-3)


@pytest.mark.parametrize("K", DESIGNS)
def test_gain_margin_down_has_a_closed_form(K):
    c = K.K_d - K.K_f * BIPED.I / BIPED.ell
    expected = A * BIPED.L * K.K_d / (c * K.K_p)
    assert loop_margins(BIPED, "force", K, A, LOAD).gain_down == pytest.approx(expected, rel=1e-9)


@given(
    K_p=st.floats(500, 5000), K_d=st.floats(50, 1500), share=st.floats(0.05, 0.9), outside=st.sampled_from([0.99, 1.01])
)
def test_the_loop_is_stable_inside_the_gain_margin_and_not_outside(K_p, K_d, share, outside):
    K = Gains(K_p, K_d, share * BIPED.ell * K_d / BIPED.I * (1 - A * BIPED.L / K_p))
    margins = loop_margins(BIPED, "force", K, A, LOAD)
    broken = breaks(BIPED, "force", K, A, LOAD)["actuator"]
    roots = (broken.P + margins.gain_down / outside * broken.Q).roots()
    assert bool(roots.real.max() < 0) is (outside < 1)


@given(K_p=st.floats(500, 5000), K_d=st.floats(50, 1500), share=st.floats(0.05, 0.9))
def test_a_delay_margin_puts_a_root_on_the_axis_and_no_shorter_delay_does(K_p, K_d, share):
    K = Gains(K_p, K_d, share * BIPED.ell * K_d / BIPED.I * (1 - A * BIPED.L / K_p))
    for broken in breaks(BIPED, "force", K, A, LOAD).values():
        T = delay_margin(broken)
        if math.isinf(T):
            continue
        crossings = np.roots((_square(broken.Q) - _square(broken.P))[::-1])
        w = np.sqrt(crossings.real[(np.abs(crossings.imag) < 1e-6 * np.abs(crossings)) & (crossings.real > 0)])
        values = broken.P(1j * w) + broken.Q(1j * w) * np.exp(-1j * w * T)
        assert np.abs(values / np.abs(broken.P(1j * w))).min() < 1e-5
        for earlier in np.linspace(0, 0.999 * T, 50):
            values = broken.P(1j * w) + broken.Q(1j * w) * np.exp(-1j * w * earlier)
            assert np.abs(values / np.abs(broken.P(1j * w))).min() > 1e-7


def _square(p):
    """|p(i w)|² in rising powers of w², by multiplying p(s) p(-s)."""
    flipped = p.coef * (-1.0) ** np.arange(len(p.coef))
    product = np.convolve(p.coef, flipped)[0::2]
    return np.pad(product * (-1.0) ** np.arange(len(product)), (0, 4 - len(product)))


def _delayed_run(K, T, where, duration, h):
    """Amplitude early and late of the nonlinear loop on level ground with one signal delayed by T; Heun's method."""
    M, L, I, ell, g = BIPED.M, BIPED.L, BIPED.I, BIPED.ell, BIPED.g
    lag = round(T / h)
    h = T / lag
    count = int(duration / h)
    theta, omega, s = 1e-3, 0.0, 0.0
    past_pd, past_tau = [-K.K_p * theta] * (lag + 1), [0.0] * (lag + 1)
    trace = np.empty(count)
    for k in range(count):
        trace[k] = theta
        late = k % (lag + 1)
        nxt = (k + 1) % (lag + 1)

        def law(theta, omega, s, slot, past_pd=past_pd):
            pd = -K.K_p * theta - K.K_d * omega
            return (past_pd[slot] if where == "angle" else pd) + K.K_f * s

        # slots hold what was computed lag steps ago; they are overwritten below
        commanded = law(theta, omega, s, nxt)
        applied = past_tau[nxt] if where == "actuator" else commanded
        sensed = past_tau[nxt] if where == "force" else applied
        rates = (omega, (M * g * L * math.sin(theta) + applied) / I, sensed / ell)
        there = (theta + h * rates[0], omega + h * rates[1], s + h * rates[2])
        after = (k + 2) % (lag + 1)
        commanded_2 = law(*there, after)
        applied_2 = past_tau[after] if where == "actuator" else commanded_2
        sensed_2 = past_tau[after] if where == "force" else applied_2
        rates_2 = (there[1], (M * g * L * math.sin(there[0]) + applied_2) / I, sensed_2 / ell)
        past_pd[late] = -K.K_p * theta - K.K_d * omega
        past_tau[late] = commanded if where == "actuator" else applied
        theta += 0.5 * h * (rates[0] + rates_2[0])
        omega += 0.5 * h * (rates[1] + rates_2[1])
        s += 0.5 * h * (rates[2] + rates_2[2])
        if abs(theta) > 1.0:
            return 1.0, 10.0
    third = count // 3
    return np.abs(trace[third : 2 * third]).max(), np.abs(trace[2 * third :]).max()


@pytest.mark.parametrize(
    ("where", "duration", "h"), [("actuator", 6.0, 1e-4), ("angle", 6.0, 1e-4), ("force", 120.0, 5e-3)]
)
def test_the_delayed_loop_is_stable_just_below_the_delay_margin_and_not_just_above(where, duration, h):
    margins = loop_margins(BIPED, "force", PAPER, A, LOAD)
    T = {"actuator": margins.delay, "angle": margins.angle_delay, "force": margins.force_delay}[where]
    early, late = _delayed_run(PAPER, 0.95 * T, where, duration, h)
    assert late < 0.9 * early
    early, late = _delayed_run(PAPER, 1.05 * T, where, duration, h)
    assert late > 1.1 * early


def test_the_held_loop_is_stable_just_below_the_longest_period_and_not_just_above():
    limit = longest_period(BIPED, "force", PAPER, A, LOAD)
    for factor, stable in ((0.99, True), (1.01, False)):
        period = factor * limit
        theta, omega, s, sizes = 1e-4, 0.0, 0.0, []
        h = period / 20
        for _ in range(900):
            tau = -PAPER.K_p * theta - PAPER.K_d * omega + PAPER.K_f * s
            for _ in range(20):  # torque held, the plate's integral goes on
                turn = (BIPED.M * BIPED.g * BIPED.L * math.sin(theta) + tau) / BIPED.I
                theta, omega, s = theta + h * omega + 0.5 * h * h * turn, omega + h * turn, s + h * tau / BIPED.ell
            sizes.append(abs(omega))
        assert (max(sizes[-100:]) < max(sizes[300:400])) is stable


@pytest.mark.parametrize("kind", ["pd", "force", "cop"])
def test_sampling_ever_faster_gives_the_continuous_loop(kind):
    K = PAPER if kind != "pd" else Gains(3500.0, 1200.0, 0.0)
    F_y = 40.0
    load = BIPED.weight - F_y
    continuous = np.linalg.eigvals(closed_loop_matrix(BIPED, kind, K, A, load))
    h = 1e-6
    held = np.linalg.eigvals(sampled_matrix(BIPED, kind, K, A, load, h))
    assert np.sort(np.log(held).real / h) == pytest.approx(np.sort(continuous.real), rel=1e-3, abs=1e-2)


def test_an_unstable_loop_has_no_margins():
    with pytest.raises(ValueError, match="not stable"):
        loop_margins(BIPED, "force", Gains(300.0, 1200.0, 1.0), A, LOAD)
    with pytest.raises(ValueError, match="not stable"):
        longest_period(BIPED, "force", Gains(300.0, 1200.0, 1.0), A, LOAD)


@settings(max_examples=30)
@given(T=st.floats(0.01, 1.0), a=st.floats(0.1, 5.0))
def test_delay_margin_of_an_integrator_is_a_quarter_turn(T, a):
    from numpy.polynomial import Polynomial

    assert delay_margin(Break(P=Polynomial([0.0, 1.0]), Q=Polynomial([a]))) == pytest.approx(math.pi / (2 * a))
