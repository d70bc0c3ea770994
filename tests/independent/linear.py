"""The loop linearised about where it comes to rest: poles, delay margin, disk margin, sampling period.

At rest R_x = -F_x, so that the moments about the ankle give tau_0 = c m g + h F_x - P_d N, and
A L sin(theta_0 - theta_f) = -tau_0. About it, with a = A L cos(theta_0 - theta_f),
beta = M L (h cos theta_0 - P_d sin theta_0), and k = K_f/ell (law force) or K_f (M + m) g/(N ell) (law cop),

    (I s² - a) Theta = T,    T = -(K_d s + K_p) Theta + (k/s)(T + beta s² Theta)

Broken at the actuator this is P + Q = 0 with P = s (I s² - a), Q = s (K_d s + K_p) - k ((I + beta) s² - a). For law pd
P = I s² - A L and Q = K_d s + K_p. An *operating point* is a row (a, beta, N).
"""

import math
from fractions import Fraction

import numpy as np


def equilibrium(problem, F):
    """The posture theta_0 (n,) [rad] under forces ``F`` (2, n) [N], and the operating points (n, 3); a = 0: none."""
    M, L, _, m, toe, heel, h, g = problem.body
    down = M * g - F[1]
    size, upright = np.hypot(down, F[0]), np.arctan2(-F[0], down)  # A and theta_f, (3)-(4)
    load = (M + m) * g - F[1]
    if problem.kind == "pd":  # at its stiffest demand, theta = theta_f
        return upright, np.column_stack([size * L, 0.0 * load, load])
    torque = 0.5 * (toe - heel) * m * g + h * F[0] - problem.target * load
    sine = -torque / (size * L)
    stands = np.abs(sine) <= 1.0
    lean = np.arcsin(np.where(stands, sine, 0.0))
    theta = upright + lean
    beta = M * L * (h * np.cos(theta) - problem.target * np.sin(theta))
    a = np.where(stands & (load > 0), size * L * np.cos(lean), 0.0)
    return np.where(stands, theta, np.nan), np.column_stack([a, beta, load])


def equilibrium_angle(problem, F_x, F_y):
    """Where the body comes to rest under one force [rad]; theta_f where the CoP cannot rest at its target."""
    down = problem.body[0] * problem.body[7] - F_y
    if problem.is_paper_foot:
        return math.atan2(-F_x, down)
    M, L, _, m, toe, heel, h, g = problem.body
    torque = 0.5 * (toe - heel) * m * g + h * F_x - problem.target * ((M + m) * g - F_y)
    sine = -torque / (math.hypot(down, F_x) * L)
    upright = math.atan2(-F_x, down)
    return upright + math.asin(sine) if abs(sine) <= 1 else upright


def operating_points(problem, per_piece=17):
    """The operating points (n, 3) that the scenarios pass through.

    ``per_piece`` instants on each linear piece, its ends among them, and the instant where A is least. For the paper's
    foot under law pd or force only the extremes of A matter, since all tests are affine in A.
    """
    from .simulator import force_of

    points = []
    for scenario in problem.scenarios:
        for t0, t1, *ends in scenario.pieces.tolist():
            share = np.linspace(0.0, 1.0, per_piece if t1 > t0 else 1)
            if not scenario.is_slope:
                share = np.append(share, _share_of_least_pull(problem, ends))
            signal = [ends[k] + share * (ends[k + 2] - ends[k]) for k in (0, 1)]
            points.append(equilibrium(problem, force_of(problem, scenario, *signal))[1])
    stacked = np.concatenate(points)
    if problem.kind == "pd" or (problem.is_paper_foot and problem.kind == "force"):
        return stacked[[np.argmin(stacked[:, 0]), np.argmax(stacked[:, 0])]]
    return np.unique(stacked.round(10), axis=0)


def _share_of_least_pull(problem, ends):
    """Where on a piece A = |(M g - F_y, F_x)| is least, as a share of the piece."""
    start = np.array([ends[0], ends[1] - problem.body[0] * problem.body[7]])
    way = np.array([ends[2] - ends[0], ends[3] - ends[1]])
    length = float(way @ way)
    return min(max(-float(start @ way) / length, 0.0), 1.0) if length > 0 else 0.0


def loop_polynomials(problem, gains, points):
    """P and Q, coefficients of rising powers, (n, 4), or (n, 3) for law pd."""
    K_p, K_d, K_f = gains
    I = problem.body[2]
    a, beta, load = points.T
    zero, one = np.zeros(len(a)), np.ones(len(a))
    if problem.kind == "pd":
        return np.stack([-a, zero, I * one], axis=1), np.stack([K_p * one, K_d * one, zero], axis=1)
    k = K_f / problem.ell * one
    if problem.kind == "cop":
        k = k * problem.weight / load
    P = np.stack([zero, -a, zero, I * one], axis=1)
    return P, np.stack([k * a, K_p * one, K_d - k * (I + beta), zero], axis=1)


def poles(problem, gains, points):
    """Poles (n, degree) of the loop at each operating point, by companion matrices."""
    P, Q = loop_polynomials(problem, gains, points)
    return roots(P + Q)


def roots(rising):
    """Roots (n, degree) of polynomials with coefficients of rising powers (n, degree + 1), the last not 0."""
    degree = rising.shape[1] - 1
    companion = np.zeros((len(rising), degree, degree))
    companion[:, np.arange(1, degree), np.arange(degree - 1)] = 1.0
    companion[:, :, -1] = -rising[:, :-1] / rising[:, -1:]
    return np.linalg.eigvals(companion)


def decay_rate(problem, gains, points):
    """The least distance of a pole from the imaginary axis [1/s], negative if unstable; a third of its digits where
    poles coincide."""
    if np.any(points[:, 0] <= 0):
        return -math.inf
    return float(-poles(problem, gains, points).real.max())


def exact_decay_rate(problem, gains, points):
    """The same to all digits of the polynomial: bisection on Hurwitz's criterion, shifted, in rational numbers."""
    if np.any(points[:, 0] <= 0):
        return -math.inf
    P, Q = loop_polynomials(problem, gains, points)
    rates = -poles(problem, gains, points).real.max(axis=1)
    near = np.flatnonzero(rates <= rates.min() + 1e-3 * abs(rates.min()))
    return min(_exact_rate((P + Q)[k], float(rates[k])) for k in near)


def _exact_rate(rising, estimate):
    coefficients = [Fraction(float(c)) / Fraction(float(rising[-1])) for c in rising]
    scale = max(abs(float(c)) ** (1.0 / (len(rising) - 1 - k)) for k, c in enumerate(coefficients[:-1]))
    width = 1e-8 * scale
    while not _hurwitz(_shifted(coefficients, Fraction(estimate - width))):
        width *= 4.0
    low, high = estimate - width, estimate + width
    while _hurwitz(_shifted(coefficients, Fraction(high))):
        high += width
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _hurwitz(_shifted(coefficients, Fraction(middle))) else (low, middle)
    return low


def _shifted(rising, sigma):
    """Coefficients in mu = lambda + sigma, by repeated synthetic division at -sigma."""
    rest, shifted = list(rising), []
    while rest:
        for k in range(len(rest) - 2, -1, -1):
            rest[k] -= sigma * rest[k + 1]
        shifted.append(rest.pop(0))
    return shifted


def hurwitz_branches(problem, gains, points, sigma, unit):
    """What must be positive at every operating point for a decay rate above ``sigma``; ``unit``: a frequency [1/s]."""
    P, Q = loop_polynomials(problem, gains, points)
    scaled = ((P + Q) / problem.body[2]).T * unit ** np.arange(P.shape[1])[:, None] / unit ** (P.shape[1] - 1)
    q = _shifted(scaled, sigma / unit)
    return np.concatenate([q[0], q[1]] if len(q) == 3 else [q[0], q[2], q[2] * q[1] - q[0]])


def _hurwitz(rising):
    positive = all(c > 0 for c in rising)
    return positive and (len(rising) == 3 or rising[2] * rising[1] > rising[0] * rising[3])


def delay_margin(problem, gains, points):
    """The least delay of the torque [s] that puts a root of P + Q exp(-s T) on the imaginary axis; stable loops only.

    Crossings are the positive roots in w² of |P(jw)|² = |Q(jw)|².
    """
    P, Q = loop_polynomials(problem, gains, points)
    squares = roots(_squared_size(P) - _squared_size(Q))
    real = (np.abs(squares.imag) <= 1e-9 * np.abs(squares)) & (squares.real > 0)
    if not real.any():
        return math.inf
    w = np.sqrt(squares.real[real])
    powers = (1j * w)[:, None] ** np.arange(P.shape[1])
    which = np.nonzero(real)[0]
    ratio = -(powers * Q[which]).sum(axis=1) / (powers * P[which]).sum(axis=1)
    lag = np.angle(ratio) % (2.0 * math.pi)
    return float((np.where(lag > 0, lag, 2.0 * math.pi) / w).min())


def _squared_size(rising):
    """|p(jw)|² as coefficients of rising powers of w², (n, degree + 1)."""
    degree = rising.shape[1] - 1
    square = np.zeros(rising.shape)
    for i in range(degree + 1):
        for j in range(degree + 1):
            if (i + j) % 2 == 0:
                square[:, (i + j) // 2] += rising[:, i] * rising[:, j] * (-1.0) ** ((j - i) // 2)
    return square


def disk_margin(problem, gains, points):
    """1/max |(P - Q)/(2 (P + Q))| over the imaginary axis: by a grid of frequencies, refined about its peak."""
    P, Q = loop_polynomials(problem, gains, points)
    size = np.abs(poles(problem, gains, points))
    grid = np.geomspace(1e-3 * size.min(), 1e3 * size.max(), 1500)
    peak = 0.5
    for p, q in zip(P, Q, strict=True):
        frequencies = grid
        for _ in range(4):
            s = 1j * frequencies
            p_s, q_s = np.polyval(p[::-1], s), np.polyval(q[::-1], s)
            values = np.abs((p_s - q_s) / (2.0 * (p_s + q_s)))
            at = int(np.argmax(values))
            low, high = frequencies[max(at - 1, 0)], frequencies[min(at + 1, len(frequencies) - 1)]
            frequencies = np.linspace(low, high, 101)
        peak = max(peak, float(values.max()))
    return 1.0 / peak


def sample_time(problem, gains, points):
    """The longest period [s] up to which the loop with the torque held is stable at every shorter one.

    With Omega² = a/I the body moves exactly; the law's integral goes on by itself, s' = (tau + beta theta'')/ell.
    """
    K_p, K_d, K_f = gains
    I = problem.body[2]
    longest = math.inf
    for a, beta, load in points:
        gather = 1.0 / (load if problem.kind == "cop" else problem.ell)
        gain = K_f * problem.weight / problem.ell if problem.kind == "cop" else K_f
        feedback = np.array([-K_p, -K_d, gain])

        def radius(T, a=a, beta=beta, gather=gather, feedback=feedback):
            Omega = math.sqrt(a / I)
            c, sh = np.cosh(Omega * T), np.sinh(Omega * T)
            free = np.zeros((len(T), 3, 3))
            free[:, 0, 0], free[:, 0, 1], free[:, 1, 0], free[:, 1, 1] = c, sh / Omega, Omega * sh, c
            push = np.stack([(c - 1.0) / a, sh / (Omega * I), 0.0 * T], axis=1)
            free[:, 2, 0], free[:, 2, 1], free[:, 2, 2] = gather * beta * Omega * sh, gather * beta * (c - 1.0), 1.0
            push[:, 2] = gather * (T + beta * push[:, 1])
            size = 2 if problem.kind == "pd" else 3
            matrix = free + push[:, :, None] * feedback[None, None, :]
            return np.abs(np.linalg.eigvals(matrix[:, :size, :size])).max(axis=1)

        fastest = float(np.abs(poles(problem, gains, np.array([[a, beta, load]]))).max())
        longest_tried = min(1e3 / fastest, 30.0 / math.sqrt(a / I))  # an unstable body falls within a few 1/Omega
        periods = np.geomspace(1e-3 / fastest, longest_tried, 3000)
        beyond = np.flatnonzero(radius(periods) >= 1.0)
        if len(beyond):
            low, high = periods[max(beyond[0] - 1, 0)], periods[beyond[0]]
            for _ in range(60):
                middle = 0.5 * (low + high)
                low, high = (middle, high) if radius(np.array([middle]))[0] < 1.0 else (low, middle)
            longest = min(longest, float(low))
    return longest
