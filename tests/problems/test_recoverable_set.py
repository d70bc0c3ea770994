"""From every state of a region the loop recovers, and nothing is called a region that was not proved.

The equations are written out here and integrated by SciPy; nothing of the region's own forms is used for that.
"""

import json
import math
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from design.model.body import Biped
from design.model.environment import constant_force, platform, slope
from design.model.laws import Gains
from design.model.limits import Required
from design.model.stability import closed_loop_matrix
from design.present import region as present
from design.spec.load import load
from design.spec.setting import setting
from problems.region import NoRegion, broken, command, posed, solve
from problems.region.loop import cosine, sector
from problems.region.program import multipliers
from problems.region.samples import recovered
from problems.region.search import _floats, _lyapunov, best

SLOPE = setting(load("slope").spec)
PAPER = SLOPE.biped
ADULT = Biped(M=70.0, L=0.95, I=4 / 3 * 70.0 * 0.95**2, m=2.0, ell=0.12)
LOOPS = {
    "paper": (PAPER, Gains(3500.0, 1200.0, 1.0)),
    "fast": (PAPER, Gains(3500.0, 606.2, 5.61)),
    "adult": (ADULT, Gains(2500.0, 900.0, 0.3)),
}

HEAVY = {"contact-force": Required(level=300.0)}


def _world(body, degrees):
    return slope(body, name="w", angle=math.radians(degrees), ramp=0.0, duration=5.0)


@lru_cache(maxsize=32)
def _found(name, degrees=0.0, level=0.0):
    body, gains = LOOPS[name]
    return solve(_setting(body, level), _world(body, degrees), gains)


def _setting(body, level=0.0, **required):
    wanted = {"contact-force": Required(level=level), **required}
    return replace(SLOPE, biped=body, required=wanted)


def _force(body, world):
    """(F_x, F_y) at the end, by (21) or as it is given."""
    last = world.signal[:, -1]
    if world.kind == "slope":
        return body.M * body.g * math.sin(world.angle), body.M * body.g * (1 - math.cos(world.angle))
    return (-body.M * last[0], 0.0) if world.kind == "platform" else (last[0], last[1])


def _run(body, gains, force, theta_f, starts, T, tight=1e-8):
    """t (k,), (e, omega, w) (3, n, k), and the smaller contact force (n, k), by (2), (5)-(9) from ``starts`` (3, n)."""
    (F_x, F_y), (M, L, I, m, ell, g) = force, (body.M, body.L, body.I, body.m, body.ell, body.g)
    n = starts.shape[1]

    def everything(x):
        e, omega, w = x
        theta = theta_f + e
        tau = -gains.K_p * e - gains.K_d * omega + w
        turn = ((M * g - F_y) * L * np.sin(theta) + F_x * L * np.cos(theta) + tau) / I
        f_y = -M * L * turn * np.sin(theta) - M * L * omega**2 * np.cos(theta) + M * g - F_y
        return turn, -tau / (2 * ell) + m * g / 2 + f_y / 2, tau / (2 * ell) + m * g / 2 + f_y / 2

    def rate(t, x):
        x = x.reshape(3, n)
        turn, F_T, F_H = everything(x)
        return np.concatenate([x[1], turn, gains.K_f * (F_H - F_T)])

    ran = solve_ivp(rate, (0.0, T), starts.ravel(), method="DOP853", rtol=tight, atol=1e-3 * tight, max_step=0.02)
    x = ran.y.reshape(3, n, -1)
    _, F_T, F_H = everything(x)
    return ran.t, x, np.minimum(F_T, F_H)


def _boundary(region, count, seed=0):
    """States (3, count) on the boundary of the region."""
    z = np.random.default_rng(seed).normal(size=(3, count))
    return np.linalg.cholesky(region.Q) @ (z / np.linalg.norm(z, axis=0))


def _recovers(region, body, gains, world, count=40, level=0.0, seed=0):
    """Contact is kept, V falls at the rate that is proved, and nearly all of the way to rest is seen."""
    starts = _boundary(region, count, seed)
    T = 4.0 / region.decay
    t, x, contact = _run(body, gains, _force(body, world), region.theta_f, starts, T)
    V = np.einsum("ink,ij,jnk->nk", x, region.P, x)
    assert contact.min() >= level
    assert (V <= np.exp(-2 * region.alpha * t) * (1 + 1e-6) + 1e-9).all()
    assert (np.diff(V, axis=1) < 1e-9).all()
    assert (V[:, -1] < 0.5).all()
    assert np.abs(x[0]).max() <= region.e_max
    return contact.min()


@pytest.mark.parametrize(("name", "degrees"), [("paper", 0.0), ("paper", 30.0), ("fast", -7.0), ("adult", 12.0)])
def test_from_every_state_of_the_boundary_contact_is_kept_and_v_falls(name, degrees):
    body, gains = LOOPS[name]
    region = _found(name, degrees)
    least = _recovers(region, body, gains, _world(body, degrees))
    assert least < 0.1 * body.weight  # and the region is not small: some state comes near to losing contact
    assert region.share <= 1 and region.turn < region.strip  # no torque can do more
    assert region.scaled > 5
    assert region.volume == pytest.approx(max(volume for _, volume in region.tried), rel=1e-3)
    assert np.allclose(region.P @ region.Q, np.eye(3), atol=1e-6)


def test_a_force_that_rests_and_what_else_the_spec_limits():
    body, gains = LOOPS["fast"]
    wind = constant_force(name="w", F_x=-60.0, F_y=25.0, ramp=0.5, duration=2.0)
    free = solve(_setting(body), wind, gains)
    _recovers(free, body, gains, wind)
    tight = _setting(body, 60.0, torque=Required(level=20.0), **{"cop-margin": Required(level=0.03)})
    region = solve(tight, wind, gains)
    assert region.volume < free.volume
    _recovers(region, body, gains, wind, level=60.0)
    _, x, contact = _run(body, gains, _force(body, wind), region.theta_f, _boundary(region, 60), 1.0)
    tau = np.abs(-gains.K_p * x[0] - gains.K_d * x[1] + x[2])
    load = 2 * contact + tau / body.ell
    assert tau.max() <= 20.0
    assert (tau / load).max() <= body.ell - 0.03


def test_a_floor_that_speeds_up_is_a_force():
    body, gains = LOOPS["fast"]
    floor = platform(body, points=np.array([[0.0, 0.0], [0.5, 0.4]]), name="w", duration=2.0)
    force = constant_force(name="w", F_x=-0.4 * body.M, F_y=0.0, ramp=0.0, duration=2.0)
    one, other = (posed(_setting(body), world, gains) for world in (floor, force))
    for name in ("A", "sine", "cosine", "load"):
        a, b = getattr(one, name), getattr(other, name)
        assert a.low <= b.high and b.low <= a.high and abs(a.low - b.high) < 1e-12
    assert one.theta_f == pytest.approx(math.atan(0.4 / body.g))


@settings(max_examples=3, deadline=None, derandomize=True)
@given(
    st.floats(1.05, 6.0),
    st.floats(0.5, 3.0),
    st.floats(0.02, 0.9),
    st.floats(-25.0, 25.0),
    st.sampled_from(list(LOOPS)),
)
def test_no_simulated_state_breaks_a_region_of_a_random_design(stiffness, damping, share, degrees, name):
    body = LOOPS[name][0]
    K_p = stiffness * body.M * body.g * body.L
    K_d = damping * math.sqrt(K_p * body.I)
    gains = Gains(K_p, K_d, share * K_d * body.ell / body.I)
    try:
        region = solve(_setting(body), _world(body, degrees), gains)
    except NoRegion:
        return
    _recovers(region, body, gains, _world(body, degrees))


def test_an_ellipsoid_that_is_not_one_is_refused():
    body, gains = LOOPS["paper"]
    region, loop = _found("paper"), posed(_setting(body), _world(body, 0.0), gains)
    P, e_max, alpha, lam = region.P, region.e_max, region.alpha, region.multipliers
    assert broken(loop, P, e_max, alpha, lam) == ""
    _, demands = _floats(loop, e_max)

    def any_multipliers(P, e_max=e_max, alpha=alpha):
        T = np.linalg.inv(np.linalg.cholesky(P)).T
        best = multipliers(T, demands)[0]
        return [broken(loop, P, e_max, alpha, each) for each in (lam, best)]

    for factor in (1.0001, 1.05, 2.0):  # Q inflated
        assert all("e|" in why or "contact" in why for why in any_multipliers(P / factor))
    assert broken(loop, 1.1 * P, e_max, alpha, multipliers(np.linalg.inv(np.linalg.cholesky(P)).T, demands)[0]) == ""
    assert "contact" in broken(loop, P / 1.05, 1.1 * e_max, 0.0, lam)  # not for the angle's sake alone
    assert "fall" in broken(loop, P, e_max, 1.01 * alpha + 0.01 * region.decay, lam)
    assert "reaches" in broken(loop, P, 0.99 * e_max, alpha, lam)
    assert "contact" in broken(loop, P, e_max, alpha, 0.2 * lam)
    assert "contact" in broken(loop, P, e_max, alpha, -lam)
    assert "multipliers" in broken(loop, P, e_max, alpha, lam[:-1])
    assert "positive" in broken(loop, -P, e_max, alpha, lam)
    assert broken(loop, P + np.triu(np.ones((3, 3)), 1), e_max, alpha, lam)
    assert broken(loop, P * np.nan, e_max, alpha, lam) and broken(loop, P, 3.1, alpha, lam)
    assert broken(loop, P, e_max, -alpha, lam)
    turned = P.copy()
    turned[0, 1] = turned[1, 0] = 0.9 * P[0, 1]
    assert broken(loop, turned, e_max, alpha, lam)
    for other in (30.0, -30.0):  # and it is for its own ground, whose sine and load these are
        assert broken(posed(_setting(body), _world(body, other), gains), P, e_max, alpha, np.tile(lam, 2))
    assert broken(posed(_setting(body, 5.0), _world(body, 0.0), gains), P, e_max, alpha, lam)


@pytest.mark.parametrize(("name", "degrees", "e_max"), [("paper", 0.0, 0.1), ("fast", 20.0, 0.2)])
def test_no_search_finds_a_larger_ellipsoid_for_the_same_bound(name, degrees, e_max):
    body, gains = LOOPS[name]
    loop = posed(_setting(body), _world(body, degrees), gains)
    alpha, rng = 0.1, np.random.default_rng(1)
    vertices, demands = _floats(loop, e_max)

    def size(T):
        """log det of the largest feasible ellipsoid of this shape."""
        Q = T @ T.T
        turn = np.linalg.inv(T)
        for A in vertices:
            if np.linalg.eigvalsh(turn @ (A @ Q + Q @ A.T) @ turn.T).max() > -2 * alpha:
                return -math.inf
        low, high = 0.0, e_max / np.linalg.norm(T[0])
        for _ in range(14):
            half = 0.5 * (low + high)
            low, high = (half, high) if multipliers(half * T, demands, 4)[1].max() <= 1 else (low, half)
        return 3 * math.log(low) + np.linalg.slogdet(T)[1]

    start = _lyapunov(loop, alpha)
    T = best(loop, e_max, alpha, start)
    found = np.linalg.slogdet(T)[1]
    assert found > size(start) + 0.5
    for spread in (0.3, 0.03, 0.003):
        tries = [size(T @ (np.eye(3) + spread * rng.normal(size=(3, 3)))) for _ in range(25)]
        assert max(tries) <= found + 1e-3
    climbed, shape = size(start), start  # and from afar, by chance
    for k in range(150):
        other = shape @ (np.eye(3) + 0.3 * 0.97**k * rng.normal(size=(3, 3)))
        if (reached := size(other)) > climbed:
            climbed, shape = reached, other
    assert climbed <= found + 1e-3
    assert climbed > size(start)  # the search is one


def test_the_best_multiplier_loses_nothing():
    loop = posed(_setting(PAPER), _world(PAPER, 20.0), LOOPS["fast"][1])
    region = _found("fast", -7.0)
    _, demands = _floats(loop, region.e_max)
    T = np.linalg.cholesky(region.Q)
    z = np.random.default_rng(0).normal(size=(3, 400_000))
    z /= np.linalg.norm(z, axis=0)
    for k, demand in enumerate(demands):

        def most(scale, demand=demand):
            x = scale * T @ z
            return float((demand.h @ x + np.einsum("in,ij,jn->n", x, demand.S, x)).max())

        for scale in (0.3, 1.0, 2.0):
            mu = multipliers(scale * T, [demand])[1][0]
            assert (mu <= 1) == (most(scale) <= demand.room) or abs(most(scale) / demand.room - 1) < 1e-3, k


@given(st.floats(1e-3, 3.0), st.floats(0.0, 1.0))
def test_the_sector_holds_the_sine_and_is_no_wider_than_needed(e_max, share):
    bound = Fraction(e_max)
    with mpmath.workdps(60):
        e = mpmath.mpf(e_max) * mpmath.mpf(share)
        low = mpmath.mpf(sector(bound).numerator) / sector(bound).denominator
        assert low * e**2 <= e * mpmath.sin(e) <= e**2
        assert abs(low - mpmath.sin(e_max) / e_max) < mpmath.mpf(10) ** -24
        near = cosine(bound)
        ends = [mpmath.mpf(end.numerator) / end.denominator for end in (near.low, near.high)]
        assert ends[0] <= mpmath.cos(e_max) <= ends[1] <= ends[0] + mpmath.mpf(10) ** -25


@settings(max_examples=40, deadline=None)
@given(st.floats(-60.0, 60.0), st.floats(0.01, 1.2), st.tuples(*[st.floats(-1.0, 1.0)] * 3))
def test_the_vertices_bound_what_foot_and_ground_ask(degrees, e_max, at):
    body, gains = LOOPS["fast"]
    world = _world(body, degrees)
    loop = posed(_setting(body, 20.0), world, gains)
    x = np.array(at) * [e_max, 3.0, 400.0]
    worst = max(float(each.h @ x + x @ each.S @ x - each.room) for each in _floats(loop, e_max)[1])
    _, _, contact = _run(body, gains, _force(body, world), loop.theta_f, x[:, None], 1e-9)
    assert worst >= 2 * (20.0 - contact[0, 0]) - 1e-6 * body.weight
    for A, sigma in zip(_floats(loop, e_max)[0], (1.0, math.sin(e_max) / e_max), strict=True):
        linear = closed_loop_matrix(body, "force", gains, body.M * body.g * sigma, body.weight)
        change = np.diag([1.0, 1.0, gains.K_f])
        assert np.allclose(A, change @ linear @ np.linalg.inv(change), rtol=1e-12)


@pytest.mark.parametrize(
    ("changed", "world", "gains", "why"),
    [
        ({}, _world(PAPER, 0.0), Gains(3500.0, 1200.0, 0.0), "not stable"),
        ({}, _world(PAPER, 0.0), Gains(300.0, 1200.0, 1.0), "not stable"),
        ({}, _world(PAPER, 0.0), Gains(3500.0, 200.0, 5.0), "not stable"),
        ({"law": "pd"}, _world(PAPER, 0.0), Gains(3500.0, 1200.0, 0.0), "law force"),
        ({"adapt": 0.3}, _world(PAPER, 0.0), Gains(3500.0, 1200.0, 1.0), "fixed desired angle"),
        ({"required": HEAVY}, _world(PAPER, 0.0), Gains(3500.0, 1200.0, 1.0), "carry"),
        ({}, platform(PAPER, points=np.array([[0.0, 0.0], [9.0, 1.0]]), name="w", duration=2.0),
         Gains(3500.0, 1200.0, 1.0), "does not come to rest"),
        ({}, constant_force(name="w", F_x=9.0, F_y=600.0, ramp=0.0, duration=2.0), Gains(3500.0, 1200.0, 1.0), "lifts"),
    ],
)  # fmt: skip
def test_none_is_said_with_the_reason(changed, world, gains, why):
    with pytest.raises(NoRegion, match=why):
        solve(replace(SLOPE, **changed), world, gains)


def test_the_command_says_what_is_proved_and_draws_it(capsys, tmp_path):
    picture = tmp_path / "region.svg"
    gains = "3500,606.2,5.61"
    assert command.region("slope-step", None, gains, None, "json", str(picture), None, strict=False) == "proved"
    said = json.loads(capsys.readouterr().out)
    found = said["regions"][0]
    assert said["status"] == found["status"] == "proved"
    assert said["command"] == "region"
    assert found["largest_turn_deg"] < found["largest_turn_simulated_deg"] < found["strip_deg"]
    assert np.allclose(np.array(found["P"]) @ found["Q"], np.eye(3), atol=1e-6)
    drawn = picture.read_text()
    assert "capturable strip" in drawn and "[deg/s]" in drawn
    text = present.as_text(said, lambda text, style: text)
    assert all(len(line) <= 80 for line in text.splitlines()) and "PROVED" in text
    assert command.region("slope", None, "300,1200,1", None, "text", None, None, strict=False) == "unknown"
    assert "NONE FOUND" in capsys.readouterr().out


def test_a_state_inside_the_region_is_never_tried_and_lost():
    body, gains = LOOPS["fast"]
    region, world = _found("fast", -7.0), _world(body, -7.0)
    inside = 0.999 * _boundary(region, 300)
    assert recovered(region, body, gains, world, inside).all()
    outside = 1.2 * _boundary(region, 60)
    back = recovered(region, body, gains, world, outside)
    _, _, contact = _run(body, gains, _force(body, world), region.theta_f, outside, 12.0 / region.decay)
    least = contact.min(axis=1)
    assert (back == (least >= 0))[np.abs(least) > 0.5].all()
    assert back.any() and not back.all()


def test_numbers_far_apart_give_a_reason_and_not_a_crash():
    for gains in (Gains(1e9, 1e9, 1.0), Gains(3500.0, 200.0, 1e-9), Gains(368.0, 1200.0, 1e-3)):
        with pytest.raises(NoRegion, match="none"):
            solve(_setting(PAPER), _world(PAPER, 0.0), gains)
    with pytest.raises(NoRegion, match="asked"):
        solve(_setting(PAPER), _world(PAPER, 0.0), LOOPS["fast"][1], alpha=9.0)


def test_on_level_ground_at_its_middle_nothing_is_lost_by_the_vertices():
    body, gains = LOOPS["adult"]
    world = _world(body, 0.0)
    loop = posed(_setting(body, 20.0), world, gains)
    for x in np.random.default_rng(0).normal(size=(8, 3)) * [0.0, 2.0, 100.0]:
        worst = max(float(each.h @ x + x @ each.S @ x - each.room) for each in _floats(loop, 0.3)[1])
        _, _, contact = _run(body, gains, _force(body, world), 0.0, x[:, None], 1e-9)
        assert worst == pytest.approx(2 * (20.0 - contact[0, 0]), abs=1e-5)
