"""Biped and law together: z' = f(z, F, K) with z = (theta, omega, s), and one Runge-Kutta step of it.

A law that adapts has a fourth state, eta (see ``design.model.laws``); n below is 3 or 4.

While the paper's foot stands, the law's integral follows from the torque: F_H - F_T = tau/ell (11).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design.model.body import Biped
from design.model.laws import Law, LawKind, law, swing
from design.model.plant import Plant, plant

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class ClosedLoop:
    """The closed loop of ``plant`` and ``law`` with gains K = (K_p, K_d, K_f) left open.

    ``rate``: (z (n), F (2), K (3)) -> z' (n), (12)-(13). ``torque``: (z, K) -> tau. ``step``: (z, u (7), K) -> z
    after one step of the classical fourth-order Runge-Kutta method; u = (h, F at its start, middle and end).
    ``readout``: (z, F, K) -> (tau, F_T, F_H).
    """

    plant: Plant
    law: Law
    rate: ca.Function
    torque: ca.Function
    step: ca.Function
    readout: ca.Function

    def march(self, count: int) -> ca.Function:
        """``count`` steps in a row: (z, u (7, count), K (3, count)) -> z after each (n, count)."""
        # nested in fours: CasADi's default takes five times as long to build
        return self.step.mapaccum("march", count, {"base": 4})

    def start(self, theta: Any, omega: Any, s: Any = 0.0, theta_d: Any = None) -> list[Any]:
        """The states z (n) at t = 0; ``theta_d`` of a law that adapts is the law's own unless it is given."""
        theta_d = self.law.theta_d if theta_d is None else theta_d
        return [theta, omega, s, *([theta_d + self._swing * omega] if self.size == 4 else [])]

    def states(self, theta: Array, omega: Array, s: Array, theta_d: Array) -> Array:
        """The states z (n, k) of samples, each (k,)."""
        rows = [theta, omega, s, *([theta_d + self._swing * omega] if self.size == 4 else [])]
        return np.vstack(rows)

    def theta_d(self, z: Array) -> Array:
        """theta_d (k,) [rad] at states ``z`` (n, k)."""
        return z[3] - self._swing * z[1] if self.size == 4 else np.full(z.shape[1], self.law.theta_d)

    @property
    def size(self) -> int:
        """How many states there are."""
        return int(self.rate.size1_in(0))

    @property
    def _swing(self) -> float:
        return swing(self.law.biped, self.law.adapt)

    @property
    def biped(self) -> Biped:
        """The biped of the plant."""
        return self.plant.biped


@lru_cache(maxsize=16)
def closed_loop(
    biped: Biped,
    kind: LawKind,
    theta_d: float = 0.0,
    adapt: float = math.inf,
    known: Biped | None = None,
    target: float = 0.0,
) -> ClosedLoop:
    """Close the loop around ``biped`` with the law of this ``kind`` and desired angle ``theta_d`` [rad]; built once.

    ``adapt`` [s]: the time within which theta_d follows the estimated posture; infinite if it does not. ``known``: the
    body that the law reckons with, where it is another than the real one. ``target``: P_d [m].
    """
    body, control = plant(biped), law(kind, known or biped, theta_d, adapt, target)
    n = 2 + control.memory_rate.size1_in(1)
    z, F, K = ca.SX.sym("z", n), ca.SX.sym("F", 2), ca.SX.sym("K", 3)
    x, memory = z[:2], z[2:]
    tau = control.torque(x, memory, K)
    reaction = body.forces(x, tau, F)
    derivative = ca.vertcat(body.dynamics(x, tau, F), control.memory_rate(x, memory, reaction))
    rate = ca.Function("rate", [z, F, K], [derivative], ["z", "F", "K"], ["zdot"], {"cse": True})
    return ClosedLoop(
        plant=body,
        law=control,
        rate=rate,
        torque=ca.Function("torque", [z, K], [tau], ["z", "K"], ["tau"]),
        step=_runge_kutta(rate),
        readout=ca.Function("readout", [z, F, K], [ca.vertcat(tau, reaction)], ["z", "F", "K"], ["y"], {"cse": True}),
    )


def _runge_kutta(rate: ca.Function) -> ca.Function:
    z, u, K = ca.SX.sym("z", rate.size1_in(0)), ca.SX.sym("u", 7), ca.SX.sym("K", 3)
    h, start, middle, end = u[0], u[1:3], u[3:5], u[5:7]
    k1 = rate(z, start, K)
    k2 = rate(z + h / 2 * k1, middle, K)
    k3 = rate(z + h / 2 * k2, middle, K)
    k4 = rate(z + h * k3, end, K)
    following = z + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return ca.Function("step", [z, u, K], [following], ["z", "u", "K"], ["z_next"], {"cse": True})
