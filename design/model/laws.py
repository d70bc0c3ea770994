"""The paper's control laws: torque from the posture and one integral, their memory.

pd
    tau = -K_d omega + K_p (theta_d - theta), (8) with K_f = 0
force
    ... + K_f s,  s' = F_H - F_T, (8)-(9)
cop
    ... + K_F s,  s' = P_d - P,  K_F = K_f (M + m) g / ell, (20)

``Law`` is the law in continuous time, in CasADi, as the paper simulates it. A ``Controller`` is what can run on a
robot: it is called once a period with what the sensors say. ``sampled`` makes one of a law; it keeps no clock and
holds no state, so that a run can be repeated, resumed, and branched.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, Protocol, TypeVar

import casadi as ca

from design.model.body import Biped

LawKind = Literal["pd", "force", "cop"]


class Gains(NamedTuple):
    """Gains of (8): K_p [N m/rad], K_d [N m s/rad], K_f [m/s]."""

    K_p: float
    K_d: float
    K_f: float


class Measurement(NamedTuple):
    """All that a controller is told: angle [rad], rate [rad/s], toe and heel force [N]."""

    theta: float
    omega: float
    F_T: float
    F_H: float


Memory = TypeVar("Memory")


class Controller(Protocol[Memory]):
    """A control law in sampled time: a memory to start with, and a step."""

    def start(self) -> Memory:
        """The memory at t = 0."""
        ...

    def __call__(self, t: float, measurement: Measurement, memory: Memory) -> tuple[float, Memory]:
        """The torque [N m] to hold until the next call, and the memory to hand to it."""
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class Law:
    """A law in continuous time.

    ``torque``: (x (2), s, K (3)) -> tau [N m]. ``memory_rate``: (F_T_F_H (2)) -> s'. K = (K_p, K_d, K_f).
    """

    kind: LawKind
    theta_d: float
    torque: ca.Function
    memory_rate: ca.Function


def law(kind: LawKind, biped: Biped, theta_d: float = 0.0) -> Law:
    """The law of this ``kind`` for ``biped``, with desired angle ``theta_d`` [rad] and P_d = 0."""
    x, s, K, forces = ca.SX.sym("x", 2), ca.SX.sym("s"), ca.SX.sym("K", 3), ca.SX.sym("F", 2)
    return Law(
        kind=kind,
        theta_d=theta_d,
        torque=ca.Function(
            "torque", [x, s, K], [_torque(kind, biped, theta_d, x[0], x[1], s, K)], ["x", "s", "K"], ["tau"]
        ),
        memory_rate=ca.Function("memory_rate", [forces], [_memory_rate(kind, biped, forces[0], forces[1])]),
    )


def _torque(kind: LawKind, biped: Biped, theta_d: float, theta: Any, omega: Any, s: Any, K: Any) -> Any:
    posture = -K[1] * omega + K[0] * (theta_d - theta)
    if kind == "pd":
        return posture
    if kind == "force":
        return posture + K[2] * s  # (10)
    return posture + K[2] * (biped.weight / biped.ell) * s  # (20)


def _memory_rate(kind: LawKind, biped: Biped, F_T: Any, F_H: Any) -> Any:
    if kind == "pd":
        return 0.0 * F_T
    if kind == "force":
        return F_H - F_T  # (9)
    return -(F_T - F_H) * biped.ell / (F_T + F_H)  # P_d - P with P_d = 0, (18)


@dataclass(frozen=True, kw_only=True)
class SampledLaw:
    """One of the paper's laws as a ``Controller``: the integral is summed once a ``period`` [s]."""

    kind: LawKind
    biped: Biped
    gains: Gains
    period: float
    theta_d: float = 0.0

    def start(self) -> float:
        """The integral at t = 0."""
        return 0.0

    def __call__(self, t: float, measurement: Measurement, memory: float) -> tuple[float, float]:
        """The torque [N m], and the integral after this period (N s for ``force``, m s for ``cop``)."""
        theta, omega, F_T, F_H = measurement
        tau = _torque(self.kind, self.biped, self.theta_d, theta, omega, memory, self.gains)
        return tau, memory + self.period * _memory_rate(self.kind, self.biped, F_T, F_H)
