"""Biped and law together: z' = f(z, F, K) with z = (theta, omega, s), and one Runge-Kutta step of it.

While the foot stands, the law's integral follows from the torque: F_H - F_T = tau/ell (11).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca

from design.model.body import Biped
from design.model.laws import Law, LawKind, law
from design.model.plant import Plant, plant


@dataclass(frozen=True, eq=False, kw_only=True)
class ClosedLoop:
    """The closed loop of ``plant`` and ``law`` with gains K = (K_p, K_d, K_f) left open.

    ``rate``: (z (3), F (2), K (3)) -> z' (3), (12)-(13). ``torque``: (z, K) -> tau. ``step``: (z, u (7), K) -> z
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
        """``count`` steps in a row: (z, u (7, count), K (3, count)) -> z after each (3, count)."""
        # nested in fours: CasADi's default takes five times as long to build
        return self.step.mapaccum("march", count, {"base": 4})

    @property
    def biped(self) -> Biped:
        """The biped of the plant."""
        return self.plant.biped


@lru_cache(maxsize=16)
def closed_loop(biped: Biped, kind: LawKind, theta_d: float = 0.0) -> ClosedLoop:
    """Close the loop around ``biped`` with the law of this ``kind`` and desired angle ``theta_d`` [rad]; built once."""
    body, control = plant(biped), law(kind, biped, theta_d)
    z, F, K = ca.SX.sym("z", 3), ca.SX.sym("F", 2), ca.SX.sym("K", 3)
    x, s = z[:2], z[2]
    tau = control.torque(x, s, K)
    reaction = body.forces(x, tau, F)
    derivative = ca.vertcat(body.dynamics(x, tau, F), control.memory_rate(reaction))
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
    z, u, K = ca.SX.sym("z", 3), ca.SX.sym("u", 7), ca.SX.sym("K", 3)
    h, start, middle, end = u[0], u[1:3], u[3:5], u[5:7]
    k1 = rate(z, start, K)
    k2 = rate(z + h / 2 * k1, middle, K)
    k3 = rate(z + h / 2 * k2, middle, K)
    k4 = rate(z + h * k3, end, K)
    following = z + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return ca.Function("step", [z, u, K], [following], ["z", "u", "K"], ["z_next"], {"cse": True})
