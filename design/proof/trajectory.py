"""Approximate trajectories of several bodies and worlds: collocation on pieces as long as accuracy lets them be.

On each piece the states are polynomials of degree ``STAGES`` in v from -1 to 1, whose derivative is the loop's rate at
the Radau points (Hairer and Wanner, Solving Ordinary Differential Equations II, IV.5). The method is stable however
fast a pole is, so that the length of a piece depends on how the motion bends, not on the poles and not on the spec's
time step. Nothing here needs to be right: the defect of the polynomials is bounded afterwards (``design.proof.tube``,
``design.checking.tube``).
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre, polynomial
from numpy.typing import NDArray

from design.proof.case import NAMES, Case, NotProved, OutOfTime

Array = NDArray[np.float64]

STAGES = 7
TOLERANCE = 1e-9
"""Of the defect that the highest term leaves, in what it does to the torque, in parts of weight times half length."""
FIRST = 1e-3
"""The length of the first piece after a corner that is tried [s]."""
UNITS = 1 << 40
"""The shortest piece is one of so many of its segment."""
MOST = 20_000
"""Pieces, at most."""
ITERATIONS = 12
NOISE = 1e-14
"""Of the rates, by rounding; a shorter piece makes it no smaller."""
FARTHEST = 1.5
"""Beyond this angle the body has fallen [rad]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Trajectory:
    """Polynomials of n pieces in w worlds: the middle of the box, then both ends of each parameter that moves.

    ``edges`` (n + 1,) [s], for the ramp of the middle; ``c`` (n, w, states, STAGES + 1) [SI]; ``weights``: for each
    segment between corners of the signal the shares of its pieces, in ``UNITS``.
    """

    edges: Array
    c: Array
    weights: list[list[int]]


class _Loops:
    """The loop (1), (3), (8)-(12), (18), (20) of several bodies and worlds: each number an array (w, 1)."""

    def __init__(self, case: Case) -> None:
        self.case, self.size = case, case.size
        ends = [{}, *({k: sign} for k in case.moving for sign in (1.0, -1.0))]
        drawn = [case.at(end) for end in ends]
        self.scenarios = [scenario for _, scenario in drawn]
        numbers = np.array([[biped.M, biped.L, biped.I, biped.m, biped.ell, biped.g] for biped, _ in drawn])
        self.M, self.L, self.I, self.m, self.ell, self.g = numbers.T[:, :, None]
        ramps = np.array([float(scenario.times[-1]) for scenario in self.scenarios])
        self.stretch = ramps / ramps[0] if "ramp" in (NAMES[k] for k in case.moving) else np.ones(len(ends))
        self.gathering = float(case.gathering)
        self.following = tuple(map(float, case.following)) if self.size > 3 else (0.0, 0.0, 0.0)

    def ends(self, piece: tuple[float, float]) -> tuple[Array, Array]:
        """The signals (w, j) at both ends of a segment ``piece`` of the middle's."""
        found = []
        for scenario, stretch in zip(self.scenarios, self.stretch, strict=True):
            last = float(self.scenarios[0].times[-1])
            at = np.array([t * stretch if t <= last else t - last + last * stretch for t in piece])
            found.append(scenario.signal_by(np.full(2, 0.5 * (at[0] + at[1])), at))
        return np.stack([each[:, 0] for each in found]), np.stack([each[:, 1] for each in found])

    def forces(self, signal: Array) -> Array:
        """(2, w, q) [N] of the signals (w, j, q)."""
        pairs = zip(self.scenarios, signal, strict=True)
        return np.stack([scenario.to_force(part) for scenario, part in pairs], axis=1)

    def rate(self, x: Array, F: Array) -> Array:
        """The rates x' (w, q, n) at the states ``x`` (w, q, n) under the forces ``F`` (2, w, q)."""
        K, theta, omega = self.case.gains, x[..., 0], x[..., 1]
        sine, cosine = np.sin(theta), np.cos(theta)
        tau = K.K_p * ((x[..., 3] if self.size > 3 else self.case.theta_d) - theta) - K.K_d * omega
        if self.size > 2:
            tau = tau + K.K_f * x[..., 2]
        down = self.M * self.g - F[1]
        turning = (self.L * (down * sine + F[0] * cosine) + tau) / self.I
        flow = np.empty_like(x)
        flow[..., 0], flow[..., 1] = omega, turning
        if self.case.kind == "cop":
            foot = self.m * self.g - (self.m / self.M * F[1] if self.case.biped.ground_loads else 0.0)
            load = foot + down - self.M * self.L * (turning * sine + omega * omega * cosine)
            flow[..., 2] = self.gathering * tau / (self.ell * load)
        elif self.size > 2:
            flow[..., 2] = tau / self.ell
        if self.size > 3:
            a, swing, lever = self.following
            flow[..., 3] = a * (theta - x[..., 3]) + lever * tau / self.ell - swing * turning
        return flow

    def jacobian(self, x: Array, F: Array) -> Array:
        """The Jacobian dx'/dx (n, n) of the middle at the state ``x`` (n,), by differences; ``F`` (2,)."""
        step = 1e-6 * np.array([1.0, 1.0, 10.0, 1.0])[: self.size]
        moved = np.broadcast_to(x, (1 + self.size, self.size)).copy()
        moved[1:] += np.diag(step)
        middle = np.broadcast_to(moved, (len(self.M), *moved.shape))
        rates = self.rate(middle, np.broadcast_to(F[:, None, None], (2, 1, 1)))[0]
        return np.asarray((rates[1:] - rates[0]).T / step)


def _radau() -> tuple[Array, Array]:
    """The points (q,), and the matrix (STAGES + 1, q) from rates there to coefficients of their integral from -1."""
    points = np.sort(legendre.legroots([0.0] * (STAGES - 1) + [-1.0, 1.0]).real)
    points[-1] = 1.0
    columns = []
    for i, at in enumerate(points):
        others = np.delete(points, i)
        basis = polynomial.polyfromroots(others) / np.prod(at - others)
        columns.append(polynomial.polyint(basis, lbnd=-1))
    return points, np.array(columns).T


POINTS, INTEGRAL = _radau()
STEPS = np.vander(POINTS, STAGES + 1, increasing=True) @ INTEGRAL
"""Runge and Kutta's matrix of the method, for v from -1 to 1."""


def trajectory(case: Case, deadline: float) -> Trajectory:
    """The trajectories of the middle and the ends of a box; raises ``NotProved`` where a body falls, ``OutOfTime``."""
    loops = _Loops(case)
    scenario, n = case.scenario, case.size
    tolerance = TOLERANCE * case.biped.weight * case.biped.ell
    x = np.tile(np.array([scenario.theta0, scenario.omega0, 0.0, case.theta_d])[:n], (len(loops.M), 1))
    edges = [0.0]
    found: list[Array] = []
    weights: list[list[int]] = []
    h = FIRST
    for start, end in scenario.pieces():
        first, last = loops.ends((start, end))
        grows = loops.stretch if end <= float(scenario.times[-1]) else np.ones(len(loops.M))
        done, h = 0, min(h, FIRST)
        shares: list[int] = []
        before: Array | None = None
        while done < UNITS:
            if time.monotonic() > deadline or len(found) >= MOST:
                raise OutOfTime if len(found) < MOST else NotProved("the motion has too many bends")
            weight = min(max(int(h / (end - start) * UNITS), 1), UNITS - done)
            after = end if done + weight == UNITS else start + (end - start) * ((done + weight) / UNITS)
            real = after - edges[-1]
            if not real > 0:  # shorter than what floats tell apart
                done, h = done + weight, 2 * h
                continue
            share = (done + 0.5 * weight * (1 + POINTS)) / UNITS
            F = loops.forces(first[:, :, None] + share * (last - first)[:, :, None])
            c, left = _piece(loops, x, F, real * grows, before, tolerance)
            h = real * min(max(0.9 * (tolerance / max(left, 1e-300)) ** (1 / (STAGES + 1)), 0.2), 3.0)
            if left > 2 * tolerance and weight > 1:
                continue
            if not (np.isfinite(c).all() and (np.abs(c[:, 0, 0]) < FARTHEST).all()):
                message = "the body falls"
                raise NotProved(message)
            done += weight
            edges.append(after)
            shares.append(weight)
            found.append(c)
            before, x = c[:, :, 1:] / real, c.sum(axis=2)
        weights.append(shares)
    return Trajectory(edges=np.array(edges), c=np.stack(found), weights=weights)


@np.errstate(all="ignore")  # of a body that falls
def _piece(loops: _Loops, x: Array, F: Array, h: Array, before: Array | None, tolerance: float) -> tuple[Array, float]:
    """Coefficients (w, n, STAGES + 1) from the states ``x`` (w, n) on, and about the defect in torque [N m]."""
    n, half = x.shape[1], 0.5 * h[:, None, None]
    J = loops.jacobian(x[0], F[:, 0, STAGES // 2])
    newton = np.linalg.inv(np.eye(STAGES * n) - 0.5 * h[0] * np.kron(STEPS, J))
    rates = np.repeat(loops.rate(x[:, None, :], F[:, :, :1]), STAGES, axis=1)
    felt = loops.case.felt
    size, moved = np.inf, np.inf
    for _ in range(ITERATIONS):
        states = x[:, None, :] + half * (STEPS @ rates)
        wrong = loops.rate(states, F) - rates
        change = (newton @ wrong.reshape(len(x), -1, 1)).reshape(wrong.shape)
        rates = rates + change
        size, moved = float((np.abs(change) * felt).max()) * float(h[0]), size
        if not size < 1e6 * max(moved, 1.0) or size < 1e-4 * tolerance or (size < tolerance and size > 0.3 * moved):
            break
    c = half * np.einsum("dq,wqn->wnd", INTEGRAL, rates)
    c[:, :, 0] += x
    rounding = NOISE * float((np.abs(c).sum(axis=2) @ np.abs(J.T) * half[:, :, 0] * felt).max())
    if not size < max(tolerance, rounding):
        return c, 1e6 * tolerance if np.isfinite(size) else np.inf
    last = np.abs(c[:, :, -1])
    left = np.maximum(last, np.abs(c[:, :, -1] @ J.T) * half[:, :, 0])
    return c, max(float((left * felt).max()) - rounding, 0.0)
