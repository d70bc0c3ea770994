"""The linear prediction in flat coordinates: one sequence y instead of states, torques and the equations between them.

About a stationary posture the deviations of e, omega and tau are a sliding sum, difference and second difference of y,

    e_k     = (y_k + y_{k+1})/2
    omega_k = (Omega sinh Omega h)/(cosh Omega h - 1) (y_{k+1} - y_k)/2
    tau_k   = (A L)/(2 (cosh Omega h - 1)) (y_{k+2} - 2 cosh(Omega h) y_{k+1} + y_k),

the controllable canonical form of the dynamics with the torque held for h; y_0 = y_1 = 0. No equality constraint is
left, and every matrix is banded. Rows of a program come in the order of *points*: steps 0 .. N-1, the end N under the
torque that holds, and where that torque leads (see ``problems.prediction``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from design.model.actuator import Actuator
from problems.prediction import Posture

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class Bands:
    """Matrices from (y_2 .. y_{N+1}) to e and omega (N+1, N) and tau (N, N); ``points`` (N+2, 3, N) to all of them.

    ``turn`` (2, N): to e and omega at N.
    """

    e: Array
    omega: Array
    tau: Array
    points: Array
    turn: Array


def bands(model: Posture, count: int) -> Bands:
    """The matrices for N = ``count`` steps."""
    c = float(model.Ad[0, 0])
    both = np.eye(count + 1, count + 2) + np.eye(count + 1, count + 2, 1)
    step = np.eye(count + 1, count + 2, 1) - np.eye(count + 1, count + 2)
    second = np.eye(count, count + 2) - 2 * c * np.eye(count, count + 2, 1) + np.eye(count, count + 2, 2)
    unit = 0.5 / model.Bd[0]
    e, omega, tau = 0.5 * both[:, 2:], unit * model.Bd[1] * step[:, 2:], unit * second[:, 2:]
    return Bands(e=e, omega=omega, tau=tau, points=with_end(model, e, omega, tau), turn=np.stack([e[-1], omega[-1]]))


def with_end(model: Posture, e: Array, omega: Array, tau: Array, goal: float = 0.0, held: float = 0.0) -> Array:
    """The points (N+2, 3, ...) of e, omega (N+1, ...), tau (N, ...), and the end, which stands still near ``goal``.

    ``held`` [N m] is the torque that holds the goal itself.
    """
    xi = e[-1] - goal + omega[-1] / model.Omega
    hold = held - model.AL * xi
    last = np.stack([e[-1], omega[-1], hold]), np.stack([goal + xi, np.zeros_like(xi), hold])
    return np.concatenate([np.stack([e[:-1], omega[:-1], tau], axis=1), np.stack(last)])


class Pattern:
    """The matrix of the rows over (y, sigma), by columns; its entries change with the limits' slopes.

    ``points`` (N+2, 3, N), or without the ends (N, 3, N). Rows: ``each`` components of limits at every point, soft;
    then tau_k and tau_k - tau_{k-1} from above and from below as far as the actuator limits them, scaled by ``size``
    [N m], soft only at the end; then sigma >= 0. ``give`` (rows,): how far each row gives way to sigma.
    """

    def __init__(self, points: Array, each: int, actuator: Actuator, step: float, size: float) -> None:
        N = points.shape[2]
        steps = min(N + 1, len(points))
        self.soft, self.size = each * len(points), size
        torques = points[:steps, 2]
        changes = np.diff(torques, axis=0, prepend=0.0)
        reach, fixed = [], []
        for rows, most, first in (
            (torques, actuator.torque, actuator.torque),
            (changes, actuator.rate * step, actuator.rate * actuator.period),
        ):
            if np.isfinite(most):
                fixed += [rows / size, -rows / size]
                reach.append(np.append(first, np.full(steps - 1, most)) / size)
        self.limited = (bool(np.isfinite(actuator.torque)), bool(np.isfinite(actuator.rate)))
        self.reach = reach
        stacked = np.vstack([*fixed, np.zeros((0, N))])
        at_end = np.zeros(len(stacked))
        if steps > N:
            at_end[N::steps] = -1.0
        constant = np.zeros((self.soft + len(stacked) + 1, N + 1))
        constant[: self.soft, N] = constant[-1, N] = -1.0
        constant[self.soft : -1] = np.column_stack([stacked, at_end])
        self.give, self._steps = -constant[:, N], steps
        spread = np.repeat(points, each, axis=0)
        filled = constant != 0
        filled[: self.soft, :N] |= (spread != 0).any(axis=1)
        self._columns, self._rows = np.nonzero(filled.T)
        self.shape = constant.shape
        self._data = constant[self._rows, self._columns]
        moving = (self._rows < self.soft) & (self._columns < N)
        rows = self._rows[moving]
        self._moving = np.flatnonzero(moving)
        self._parts = -spread[rows, :, self._columns[moving]].T
        self._component = rows % each
        self._slopes = np.full((each, 3), np.nan)

    def matrix(self) -> sp.csc_matrix:
        """A matrix with every entry of the pattern in place."""
        pointers = np.searchsorted(self._columns, np.arange(self.shape[1] + 1))
        data = np.where(self._data == 0, 1.0, self._data)
        return sp.csc_matrix((data, self._rows, pointers), shape=self.shape)

    def entries(self, slopes: Array) -> Array:
        """The entries for limits with these ``slopes`` (each, 3) in e, omega and tau."""
        if not np.array_equal(slopes, self._slopes):
            self._slopes = slopes.copy()
            self._data[self._moving] = (slopes.T[:, self._component] * self._parts).sum(axis=0)
        return self._data

    def room(self, points: Array, margins: Array, before: float, hold: float = 0.0) -> Array:
        """How far each row is from its bound: at ``points`` (.., 3), with limits' ``margins`` (.., each) there.

        Torques, and the one ``before``, count from ``hold`` [N m]; the actuator's limit does not.
        """
        return np.concatenate([margins.ravel(), *self._reach_left(points, before, hold), [0.0]])

    def reached(self, points: Array, before: float, hold: float = 0.0) -> bool:
        """Whether the actuator reaches the torques of ``points``; all count from ``hold`` as in ``room``."""
        return not self.reach or all(left.min() >= 0 for left in self._reach_left(points, before, hold))

    def _reach_left(self, points: Array, before: float, hold: float) -> list[Array]:
        if not self.reach:
            return []
        torques, parts = points[: self._steps, 2], []
        values = [torques + hold] * self.limited[0] + [np.diff(torques, prepend=before)] * self.limited[1]
        for value, most in zip(values, self.reach, strict=True):
            parts += [most - value / self.size, most + value / self.size]
        return parts
