"""What the checker's arithmetic must hold, of whichever modules are handed in: also of mutants."""

import itertools
import random
from fractions import Fraction

import mpmath
import numpy as np
from scipy.linalg import solve_continuous_lyapunov


def value(balls, ball, v, p, share):
    """The function that lies at ``share`` of the rest, exactly, in units."""
    rows = [sum(c * Fraction(v) ** d for d, c in enumerate(row)) for row in ball.rows]
    return rows[0] + sum(a * b for a, b in zip(p, rows[1:], strict=True)) + Fraction(share) * ball.rest


def holds(balls, ball, truth, v, p):
    return abs(truth - value(balls, ball, v, p, 0)) <= ball.rest


def some(balls, rng, k, rest):
    size = balls.ONE // 2

    def row(scale):
        return [int(rng.uniform(-1, 1) * size * scale * 0.3**d) for d in range(rng.choice([1, 3, 9]))]

    return balls.Ball([row(1.0), *(row(0.1) for _ in range(k))], int(rest * balls.ONE))


def places(rng, k):
    return rng.choice([-1, 1, Fraction(1, 3)]), [rng.choice([-1, 1, Fraction(1, 2)]) for _ in range(k)]


def check_balls(balls, rounds=12):
    one = balls.ONE
    rng = random.Random(3)
    for turn in range(rounds):
        k = turn % 3
        a, b = some(balls, rng, k, rng.choice([0, 1e-3])), some(balls, rng, k, rng.choice([0, 1e-6]))
        for _ in range(4):
            v, p = places(rng, k)
            for first in (-1, 1):
                for second in (-1, 1):
                    x, y = value(balls, a, v, p, first), value(balls, b, v, p, second)
                    assert holds(balls, a + b, x + y, v, p)
                    assert holds(balls, a - b, x - y, v, p)
                    assert holds(balls, a * b, x * y / one, v, p)
                    assert holds(balls, a.over(7), x / 7, v, p)
                    assert a.low() <= x <= -((-a).low())
                    assert abs(x) <= a.size()
        assert (a * b).rest <= (a.size() * b.rest + b.size() * a.rest) // one + one // (100 if k < 2 else 5)
        plain = balls.Ball(a.rows)
        tangent = plain.slope()
        for v in (-1, 1, Fraction(1, 3)):
            rate = [sum(d * c * Fraction(v) ** (d - 1) for d, c in enumerate(row) if d) for row in plain.rows]
            assert [sum(c * Fraction(v) ** d for d, c in enumerate(row)) for row in tangent.rows] == rate
        assert plain.ends(-1) == [sum(c * (-1) ** d for d, c in enumerate(row)) for row in plain.rows]
    parabola = balls.Ball([[one, one // 2, one]])
    assert 0 <= Fraction(15 * one, 16) - parabola.low() <= 2
    assert balls.Ball([[one, 3 * one, one]]).low() == -one
    assert balls.Ball([[one, one // 4, -one]]).low() == -one // 4
    try:
        balls.Ball([[one]], 1).slope()
    except Exception as error:
        assert "derivative" in str(error)
    else:
        raise AssertionError


def check_numbers(balls):
    one = balls.ONE
    assert one == 2**64
    with mpmath.workdps(60):
        assert 0 < mpmath.pi - mpmath.mpf(balls.PI.numerator) / balls.PI.denominator < mpmath.mpf(10) ** -37
        pi = Fraction(int(mpmath.pi * 10**50), 10**50)
    for number in (Fraction(2), Fraction(1, 7), Fraction(0), Fraction(5, 2**130), Fraction(3**40, 7)):
        for up, exact in ((balls.root(number), number), (balls.root(number**2), number**2)):
            assert exact <= Fraction(up, one) ** 2
            assert (Fraction(max(up - 2, 0), one)) ** 2 <= exact
        assert 0 <= Fraction(balls.above(number), one) - number < Fraction(1, one)
        assert 0 <= balls.up(int(number * one)) - Fraction(int(number * one), one) < 1
    parts = [Fraction(1, 30), Fraction(-1, 50)]
    for p in ([1, 1], [-1, 1], [-1, -1], [1, Fraction(1, 2)]):
        moved = Fraction(1, 3) + p[0] * parts[0] + p[1] * parts[1]
        for ball, truth in (
            (balls.constant(Fraction(1, 3), parts), moved),
            (balls.inverse(Fraction(1, 3), parts), 1 / moved),
            (balls.radians(Fraction(1, 3), parts), moved * pi / 180),
        ):
            assert holds(balls, ball, truth * one, 0, p)
    assert balls.inverse(Fraction(1, 3), parts).rest < one
    assert balls.radians(Fraction(1, 3), parts).rest < 10
    for value_, part in ((Fraction(1), [Fraction(1)]), (Fraction(-1), [Fraction(0)]), (Fraction(1), [Fraction(-2)])):
        try:
            balls.inverse(value_, part)
        except Exception as error:
            assert "length" in str(error)
        else:
            raise AssertionError


def check_sines(balls, digits=40):
    """Against mpmath, to 40 digits."""
    one = balls.ONE
    rng = random.Random(7)
    with mpmath.workdps(digits):
        for x in (0.0, 1e-9, 0.3, -1.2, 1.999, -2.0, 2.0, *(rng.uniform(-2, 2) for _ in range(10))):
            at = int(x * one)
            for got, exact in zip(balls.series(at), (mpmath.sin, mpmath.cos), strict=True):
                assert abs(mpmath.mpf(got) - exact(mpmath.mpf(at) / one) * one) <= balls.SERIES_ERROR / 8
        for size in (1e-3, 0.05, 0.4):
            for middle in (0.0, 0.7, -1.4):
                rows = [[int(middle * one), int(size * 0.5 * one), int(size * 0.2 * one)], [int(size * 0.3 * one)]]
                ball = balls.Ball(rows, int(1e-7 * one))
                pair = balls.sine_and_cosine(ball)
                for v in (-1, 1, Fraction(1, 3)):
                    for p in (-1, 1):
                        for share in (-1, 1):
                            x = value(balls, ball, v, [p], share) / one
                            angle = mpmath.mpf(x.numerator) / x.denominator
                            for got, exact in zip(pair, (mpmath.sin(angle), mpmath.cos(angle)), strict=True):
                                truth = Fraction(int(exact * mpmath.mpf(10) ** 35), 10**35) * one
                                assert holds(balls, got, truth, v, [p])
                if size < 0.1:  # of second order in p at most
                    assert max(each.rest for each in pair) < (size**2 + 1e-6) * one
        for v in (-1, 1):  # without parameters nothing but the series is left out
            for size in (0.1, 0.5, -0.5):
                x = mpmath.mpf(0.3) + v * mpmath.mpf(size)
                ball = balls.Ball([[int(0.3 * one), int(size * one)]])
                for got, exact in zip(balls.sine_and_cosine(ball), (mpmath.sin(x), mpmath.cos(x)), strict=True):
                    assert holds(balls, got, Fraction(int(exact * mpmath.mpf(10) ** 35), 10**35) * one, v, [])
                    assert got.rest < size**6 / 500 * one
    assert balls.sine_and_cosine(balls.Ball([[]]))[1].rows[0][0] in range(one - 9, one + 1)
    for bad in (2.1, -2.1):
        try:
            balls.sine_and_cosine(balls.Ball([[int(bad * one)]]))
        except Exception as error:
            assert "2 rad" in str(error)
        else:
            raise AssertionError


def check_linear(linear):
    """Against numpy's eigenvalues and inverse."""
    rng = np.random.default_rng(5)
    for n in (2, 3):
        for _ in range(30):
            A = np.round(rng.standard_normal((n, n)), 2)
            S = np.round(A @ A.T - rng.choice([0.0, 0.6]) * np.eye(n), 4)
            exact = [[Fraction(repr(float(each))) for each in row] for row in S]
            least = np.linalg.eigvalsh(S).min()
            if abs(least) > 1e-6:
                assert linear.positive(exact) == (least > 0)
            if least > 1e-2:
                found = np.array([[float(each) for each in row] for row in linear.inverted(exact)])
                assert np.allclose(found, np.linalg.inv(S), rtol=1e-9)
    assert not linear.positive([[Fraction(0)]])
    for K_f, refused in ((None, False), (5.61, False), (9.0, True), (0.0, None)):
        gains = [Fraction(3500), Fraction(606), *([Fraction(repr(K_f))] if K_f is not None else [])]
        I, ell, AL = Fraction(7), Fraction(1, 10), Fraction(368)
        J = np.array([[float(each) for each in row] for row in linear.loop(gains, AL, 1 / I, 1 / ell)])
        K = [float(each) for each in gains]
        truth = [[0.0, 1.0, 0.0][: len(K)], np.array([368 - K[0], -K[1], *K[2:]]) / 7]
        truth = truth if len(K) == 2 else [*truth, np.array([-K[0], -K[1], K[2]]) * 10]
        assert np.allclose(J, np.array(truth))
        decay = -np.linalg.eigvals(J).real.max()
        ranges = ((AL, AL), (I, I), (ell, ell))
        for share in (0.999, 1.001):
            wanted = max(decay * share, 0.0)
            kept = True
            try:
                linear.check_decay(Fraction(repr(float(wanted))), gains, ranges)
            except Exception as error:
                assert "decay" in str(error)
                kept = False
            assert kept == (decay > 1e-9 and share < 1)
        if refused is False:
            P = solve_continuous_lyapunov((J + 0.5 * decay * np.eye(len(K))).T, -np.eye(len(K)))
            P = 0.5 * (P + P.T)
            root = np.linalg.inv(np.linalg.cholesky(P).T)
            rate = -0.5 * np.linalg.eigvalsh(root.T @ (P @ J + J.T @ P) @ root).max()
            exact = [[Fraction(float(each)) for each in row] for row in P]
            for share in (0.999, 1.001, 0.0, -1.0):
                kept = True
                try:
                    linear.check_contraction(exact, Fraction(float(share * rate)), gains, ranges)
                except Exception as error:
                    assert "contract" in str(error)
                    kept = False
                assert kept == (share == 0.999)
    ends = [(Fraction(1), Fraction(2)), (Fraction(3), Fraction(4)), (Fraction(5), Fraction(6))]
    assert set(linear.corners(*ends)) == {(G, 1 / I, 1 / ell) for G in ends[0] for I in ends[1] for ell in ends[2]}


def check_errors(tube):
    """Each way in which a state that is off moves the load is counted: in turn one is nearly all that counts."""
    rng = np.random.default_rng(13)
    one, (M, L, I, m, ell) = tube.ONE, (50.0, 0.75, 7.03125, 2.0, 0.1)
    numbers = {"M": M, "L": L, "I": I, "m": m, "ell": ell, "slope": 0.0, "ramp": 0.0}
    box = {name: (Fraction(repr(each)), Fraction(0)) for name, each in numbers.items()}
    wide, narrow = Fraction(1), Fraction(10**10)
    for metric, middle, K in (
        ((wide, narrow), (1.2, 100.0), (400.0, 10.0)),  # omega² cos theta, by theta
        ((narrow, wide), (0.02, 100.0), (400.0, 1.0)),  # by omega
        ((wide, narrow), (0.0, 0.0), (9000.0, 10.0)),  # theta'' sin theta, by sin theta
        ((wide, narrow), (1.2, 0.0), (9000.0, 10.0)),  # by theta''
        ((narrow, wide), (1.2, 0.0), (400.0, 900.0)),
    ):
        P = [[metric[0], Fraction(0)], [Fraction(0), metric[1]]]
        gains = [Fraction(repr(each)) for each in K]
        loop = tube._Loop(
            {"law": {"desired_angle_deg": Fraction(40)}}, {"kind": "force"}, gains, Fraction("9.81"), box, P
        )
        x = [tube.Ball(tube.constant(Fraction(repr(each))).rows) for each in middle]
        parts = loop.parts(x, [tube.constant(Fraction(0))] * 2)

        def load(theta, omega, K=K):
            tau = K[0] * (np.radians(40.0) - theta) - K[1] * omega
            turning = (M * 9.81 * L * np.sin(theta) + tau) / I
            return tau, m * 9.81 + M * 9.81 - M * L * (turning * np.sin(theta) + omega**2 * np.cos(theta))

        for radius in (1e-4, 1e-2):
            tau_off, load_off = (each / one for each in loop.errors(x, parts, int(radius * one)))
            far = [0.0, 0.0]
            for way in rng.standard_normal((200, 2)):
                y = np.array(middle) + way / np.linalg.norm(way) * radius / np.sqrt([float(each) for each in metric])
                off = np.abs(np.subtract(load(*y), load(*middle)))
                far = np.maximum(far, off)
            assert far[0] <= tau_off
            assert far[1] <= load_off < 4 * far[1] + 1e-6


def check_tube(tube):
    """The bounds in a wide tube hold at states on its edge, by the equations written out in floats."""
    rng = np.random.default_rng(11)
    spec = {"law": {"desired_angle_deg": Fraction(1)}}
    M, L, I, m, ell, g = 50.0, 0.75, 7.03125, 2.0, 0.1, 9.81
    P = [[Fraction(3), Fraction("0.2"), Fraction(0)], [Fraction("0.2"), Fraction("0.05"), Fraction("0.001")],
         [Fraction(0), Fraction("0.001"), Fraction("0.0004")]]  # fmt: skip
    metric = np.array([[float(each) for each in row] for row in P])
    one = tube.ONE
    worlds = (("slope", [1.0]), ("force", [20.0, -30.0]), ("platform", [0.4]))
    for (kind, signal), loaded in itertools.product(worlds, (False, True)):
        spec["foot"] = {"ground_loads": loaded}
        for n in (2, 3):
            K = [3500.0, 600.0, 5.0][:n]
            numbers = {"M": M, "L": L, "I": I, "m": m, "ell": ell, "slope": 5.0 if kind == "slope" else 0.0, "ramp": 0}
            box = {name: (Fraction(repr(each)), Fraction(0)) for name, each in numbers.items()}
            metric_n = metric[:n, :n]
            toward = np.linalg.inv(np.linalg.cholesky(metric_n).T)
            gains = [Fraction(repr(each)) for each in K]
            loop = tube._Loop(spec, {"kind": kind}, gains, Fraction("9.81"), box, [row[:n] for row in P[:n]])
            middle = [0.3, 3.0, 20.0][:n]
            x = [tube.constant(Fraction(repr(each))) for each in middle]
            x = [tube.Ball(each.rows) for each in x]
            parts = loop.parts(x, [tube.constant(Fraction(repr(each))) for each in signal])

            def quantities(y, kind=kind, signal=signal, K=K, loaded=loaded):
                theta, omega = y[0], y[1]
                tau = K[0] * (np.radians(1.0) - theta) - K[1] * omega + (K[2] * y[2] if len(y) == 3 else 0.0)
                if kind == "slope":
                    alpha = np.radians(5.0) * signal[0]
                    side, down = M * g * np.sin(alpha), M * g * np.cos(alpha)
                elif kind == "platform":
                    side, down = -M * signal[0], M * g
                else:
                    side, down = signal[0], M * g - signal[1]
                turning = (L * (down * np.sin(theta) + side * np.cos(theta)) + tau) / I
                foot = m / M * down if loaded and kind == "slope" else m * g
                load = foot + down - M * L * (turning * np.sin(theta) + omega**2 * np.cos(theta))
                G = L * (down * np.cos(theta) - side * np.sin(theta))
                return np.array([(load - tau / ell) / 2, (load + tau / ell) / 2, tau, load, G, turning])

            at = quantities(np.array(middle))
            found_at = [parts.tau, parts.load, parts.stiffness, parts.turning]
            assert np.allclose([ball.rows[0][0] / one for ball in found_at], at[[2, 3, 4, 5]], rtol=1e-10)
            assert all(ball.rest < 1e-6 * one for ball in found_at)
            assert np.allclose([ball.rows[0][0] / one for ball in parts.flow], [middle[1], at[5], at[2] / ell][:n])
            for radius in (1e-3, 3e-2):
                found = tube.Found(toe=[], heel=[], cop=[], torque=[], G=[])
                reach = int(radius / np.sqrt(1 / np.linalg.inv(metric_n)[0, 0]) * one) + 9
                loop.read(x, parts, int(radius * one), Fraction("0.01"), reach, found)
                for _ in range(200):
                    way = rng.standard_normal(n)
                    y = np.array(middle) + toward @ way / np.linalg.norm(way) * radius
                    toe, heel, tau, load, G, _ = quantities(y)
                    assert min(found.toe) / one <= toe
                    assert min(found.heel) / one <= heel
                    assert max(found.torque) / one >= abs(tau)
                    assert min(found.cop) / one <= (ell - 0.01) * load - abs(tau)
                    assert min(found.G) / one <= G <= max(found.G) / one
                    assert abs(y[0] - middle[0]) * one <= found.reach
            few = [3, 1, 2][:n]
            least = sum(a * b * size for a, row in zip(few, loop.sizes) for b, size in zip(few, row))  # noqa: B905
            assert least <= loop.norm(few) ** 2 << 64 <= least + (8 * loop.norm(few) << 64)
            off = np.abs(rng.standard_normal(n))
            bound = loop.norm([int(each * one) for each in off]) / one
            assert np.sqrt(off @ np.abs(metric_n) @ off) <= bound * (1 + 1e-12) < 1.001 * bound
