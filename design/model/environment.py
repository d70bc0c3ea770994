"""What the biped stands through: an external force over time whose corners are known.

Every scenario is a piecewise linear *signal* (the slope angle, a force, or a floor's acceleration) and a map from
the signal to the force (F_x, F_y) on the centre of gravity. Integration takes its steps from ``steps``: none
crosses a breakpoint, and each step sees one piece only, so that a jump is not smeared over a step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from design.model.body import Biped

Array = NDArray[np.float64]
Kind = Literal["slope", "force", "platform", "profile"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Steps:
    """Integration steps of a scenario; N steps, N + 1 samples.

    ``t`` (N+1,) sample times [s], with an equal pair where the force jumps; ``h`` (N,) steps [s]; ``start``,
    ``middle``, ``end`` (2, N) force (F_x, F_y) within each step [N]; ``force`` (2, N+1) at the samples; ``signal``
    (k, N+1) at the samples.
    """

    t: Array
    h: Array
    start: Array
    middle: Array
    end: Array
    force: Array
    signal: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Scenario:
    """A force over time and the state at its beginning.

    ``times`` (n,) [s] begin at 0 and do not fall; equal neighbours are a jump. ``signal`` (k, n); ``to_force`` maps
    (k, j) to (2, j) [N]. ``theta0`` [rad], ``omega0`` [rad/s]. The last value is held until ``duration`` [s].
    """

    name: str
    kind: Kind
    duration: float
    times: Array
    signal: Array
    to_force: Callable[[Array], Array]
    theta0: float = 0.0
    omega0: float = 0.0

    @property
    def field(self) -> bool:
        """Whether the force is an acceleration field, which acts on the foot too: a slope, or a moving floor."""
        return self.kind in ("slope", "platform")

    @property
    def breakpoints(self) -> list[float]:
        """Instants in (0, duration) at which the signal has a corner or jumps [s]."""
        return sorted({float(t) for t in self.times if 0.0 < t < self.duration})

    @property
    def steady_from(self) -> float:
        """When the signal has come to the value that it keeps to the end [s]; the duration if it never does."""
        last = self.signal_by(np.array([self.duration]), np.array([self.duration]))
        moved = np.flatnonzero(np.any(self.signal != last, axis=0))
        if not len(moved):
            return 0.0
        after = int(moved[-1]) + 1
        return min(float(self.times[after]), self.duration) if after < len(self.times) else self.duration

    def pieces(self) -> list[tuple[float, float]]:
        """Intervals [s] on which the signal is linear; together they are [0, duration]."""
        edges = [0.0, *self.breakpoints, self.duration]
        return list(pairwise(edges))

    def force_on(self, piece: tuple[float, float], t: Array) -> Array:
        """Force (2, j) [N] at times ``t`` (j,), as the piece (t0, t1) continues it."""
        return self.to_force(self.signal_on(piece, t))

    def signal_on(self, piece: tuple[float, float], t: Array) -> Array:
        """Signal (k, j) at times ``t`` (j,), as the piece (t0, t1) continues it."""
        return self.signal_by(np.full_like(t, 0.5 * (piece[0] + piece[1])), t)

    def force_at(self, t: Array) -> Array:
        """Force (2, j) [N] at times ``t`` (j,) >= 0; at a jump, what comes after it."""
        return self.to_force(self.signal_by(t, t))

    def signal_by(self, inside: Array, t: Array) -> Array:
        """Signal (k, j) at times ``t`` (j,), each by the linear piece that contains the time ``inside`` (j,)."""
        left = np.clip(np.searchsorted(self.times, inside, side="right") - 1, 0, len(self.times) - 1)
        right = np.minimum(left + 1, len(self.times) - 1)
        span = self.times[right] - self.times[left]
        share = np.where(span > 0, (t - self.times[left]) / np.where(span > 0, span, 1.0), 0.0)
        return np.asarray(self.signal[:, left] + share * (self.signal[:, right] - self.signal[:, left]))

    def steps(self, h: float) -> Steps:
        """Steps of length ``h`` [s], shortened where a breakpoint or the end comes first."""
        return self.steps_at(self._uniform(h))

    def steps_at(self, times: Array) -> Steps:
        """Steps between ``times`` (any order) [s], the breakpoints, and the end."""
        t = np.unique(np.concatenate([[0.0], times, self.breakpoints, [self.duration]]))
        t = t[t <= self.duration]
        lengths = np.diff(t)
        middle_times = t[:-1] + 0.5 * lengths
        start, middle, end = (self.signal_by(middle_times, at) for at in (t[:-1], middle_times, t[1:]))
        jumps = 1 + np.flatnonzero(
            np.any(np.abs(end[:, :-1] - start[:, 1:]) > 1e-12 * (1 + np.abs(end[:, :-1])), axis=0)
        )
        if len(jumps):  # a step of no length lets both sides of a jump be samples
            t, lengths = np.insert(t, jumps, t[jumps]), np.insert(lengths, jumps, 0.0)
            before = end[:, jumps - 1]
            start, middle, end = (np.insert(part, jumps, before, axis=1) for part in (start, middle, end))
        samples = np.column_stack([start, end[:, -1]])
        return Steps(
            t=t,
            h=lengths,
            start=self.to_force(start),
            middle=self.to_force(middle),
            end=self.to_force(end),
            force=self.to_force(samples),
            signal=samples,
        )

    def _uniform(self, h: float) -> Array:
        """Multiples of ``h`` within the duration; one that a breakpoint all but meets is moved onto it."""
        uniform = h * np.arange(int(np.floor(self.duration / h * (1 + 1e-12))) + 1)
        marks = np.array([*self.breakpoints, self.duration])
        nearest = np.clip(np.rint(marks / h).astype(int), 0, len(uniform) - 1)
        close = np.abs(uniform[nearest] - marks) <= 1e-9 * h + 1e-12 * marks
        uniform[nearest[close]] = marks[close]
        return np.asarray(uniform)

    def operating_points(self, biped: Biped, per_piece: int = 9) -> tuple[Array, Array]:
        """The environments that the scenario passes through, as far as they matter for linear stability.

        Returns A (3) [N] and the load at rest F_T + F_H = (M + m) g - F_y [N], each (j,): at both ends of every
        piece, ``per_piece`` instants inside it, and where A is extreme on it (in closed form where the force is
        linear in time; on a slope A does not change).
        """
        F_x, F_y = self.operating_forces(biped, per_piece)
        return np.hypot(biped.M * biped.g - F_y, F_x), biped.load(F_y)

    def operating_forces(self, biped: Biped, per_piece: int = 9) -> Array:
        """The forces (2, j) [N] of ``operating_points``."""
        found: list[Array] = []
        for start, end in self.pieces():
            t = np.linspace(start, end, per_piece + 2)
            if self.kind != "slope":
                t = np.append(t, _flattest(self.force_on((start, end), np.array([start, end])), biped, start, end))
            found.append(self.force_on((start, end), t))
        return np.concatenate(found, axis=1)


def _flattest(ends: Array, biped: Biped, start: float, end: float) -> float:
    """The instant at which A is least while the force goes linearly from ``ends[:, 0]`` to ``ends[:, 1]``."""
    first = np.array([ends[0, 0], ends[1, 0] - biped.M * biped.g])
    way = ends[:, 1] - ends[:, 0]
    length = float(way @ way)
    share = float(np.clip(-(first @ way) / length, 0.0, 1.0)) if length > 0 else 0.0
    return start + share * (end - start)


def varied(
    scenario: Scenario, biped: Biped, *, slope: Callable[[float], float], ramp: Callable[[float], float]
) -> Scenario:
    """``scenario`` as another ``biped`` meets it, its final slope [rad] and its ramp's time [s] mapped.

    On slopes and floors the force follows the body's mass. Only a slope and a force that grow have a ramp.
    """
    times, signal, to_force = scenario.times, scenario.signal, scenario.to_force
    if scenario.kind == "slope":
        to_force = slope_force(biped)
        final = float(signal[0, -1])
        signal = np.full_like(signal, slope(final)) if final == 0 else signal / final * slope(final)
    if scenario.kind == "platform":
        to_force = _floor_force(biped)
    if scenario.kind in ("slope", "force") and times[-1] > 0:
        times = times * (max(ramp(float(times[-1])), 1e-9) / times[-1])
    return replace(scenario, times=times, signal=signal, to_force=to_force)


def slope_force(biped: Biped) -> Callable[[Array], Array]:
    """(21): the force in the frame of ground that is inclined by alpha [rad]."""

    def to_force(signal: Array) -> Array:
        alpha = signal[0]
        return biped.M * biped.g * np.vstack([np.sin(alpha), 1.0 - np.cos(alpha)])

    return to_force


def slope(
    biped: Biped, *, name: str, angle: float, ramp: float, duration: float, theta0: float = 0.0, omega0: float = 0.0
) -> Scenario:
    """Ground that tilts to ``angle`` [rad] within ``ramp`` [s] (22); ``ramp`` = 0 is a sudden slope."""
    times, values = _ramp(ramp, [angle])
    return Scenario(
        name=name, kind="slope", duration=duration, times=times, signal=values, to_force=slope_force(biped),
        theta0=theta0, omega0=omega0,
    )  # fmt: skip


def constant_force(
    *, name: str, F_x: float, F_y: float, ramp: float, duration: float, theta0: float = 0.0, omega0: float = 0.0
) -> Scenario:
    """A force (F_x, F_y) [N] reached linearly within ``ramp`` [s]."""
    times, values = _ramp(ramp, [F_x, F_y])
    return Scenario(
        name=name, kind="force", duration=duration, times=times, signal=values, to_force=_as_is,
        theta0=theta0, omega0=omega0,
    )  # fmt: skip


def platform(
    biped: Biped, *, name: str, points: Array, duration: float, theta0: float = 0.0, omega0: float = 0.0
) -> Scenario:
    """A floor with acceleration ``points`` (n, 2): t [s], a [m/s²], piecewise linear; F_x = -M a."""
    times, values = _held(points)
    return Scenario(
        name=name, kind="platform", duration=duration, times=times, signal=values, to_force=_floor_force(biped),
        theta0=theta0, omega0=omega0,
    )  # fmt: skip


def profile(*, name: str, points: Array, duration: float, theta0: float = 0.0, omega0: float = 0.0) -> Scenario:
    """Any force ``points`` (n, 3): t [s], F_x [N], F_y [N], piecewise linear."""
    times, values = _held(points)
    return Scenario(
        name=name, kind="profile", duration=duration, times=times, signal=values, to_force=_as_is,
        theta0=theta0, omega0=omega0,
    )  # fmt: skip


def _floor_force(biped: Biped) -> Callable[[Array], Array]:
    def to_force(signal: Array) -> Array:
        return np.vstack([0.0 - biped.M * signal[0], np.zeros_like(signal[0])])

    return to_force


def _as_is(signal: Array) -> Array:
    return signal


def _ramp(ramp: float, value: list[float]) -> tuple[Array, Array]:
    final = np.array(value, dtype=float)[:, None]
    if ramp == 0.0:
        return np.array([0.0]), final
    return np.array([0.0, ramp]), np.hstack([0.0 * final, final])


def _held(points: Array) -> tuple[Array, Array]:
    """Times and values of ``points``, the first value held back to t = 0."""
    points = np.asarray(points, dtype=float)
    if points[0, 0] > 0:
        points = np.vstack([[0.0, *points[0, 1:]], points])
    return points[:, 0].copy(), points[:, 1:].T.copy()
