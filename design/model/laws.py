"""The paper's control laws: torque from the posture and one integral, their memory.

pd
    tau = -K_d omega + K_p (theta_d - theta), (8) with K_f = 0
force
    ... + K_f s,  s' = F_H - F_T, (8)-(9)
cop
    ... + K_F s,  s' = P_d - P,  K_F = K_f (M + m) g / ell, (20)

Law force may *adapt* (the highest loop of Fig. 5): theta_d then follows the estimated stationary posture within a
time T_a, T_a theta_d' = estimate - theta_d. From (1) and (3) A L sin(theta - theta_f) = I theta'' - tau, with tau by
(11), so that theta + (tau - I theta'')/(M g L) is the dynamic counterpart of (15), exact to first order where
A = M g, as on every slope, and at rest under any force. theta'' is not differentiated for but integrated by parts:

    theta_d = eta - I/(M g L T_a) omega,    T_a eta' = theta + ell (F_H - F_T)/(M g L) - theta_d

At rest theta_d = theta_f, and the integral is 0. (16)-(17) put into (15) themselves give theta, at rest or not:
theta_d would follow the body instead of the world, and the loop would be stable for long T_a only.

Where the centre of pressure is to come to rest under another point than the ankle, P_d, or the ankle is not in the
middle of the foot, levers l_T and l_H, 2 ell = l_T + l_H, (9) is

    s' = ((l_H + P_d) F_H - (l_T - P_d) F_T)/ell = (F_T + F_H) (P_d - P)/ell

which is F_H - F_T for the paper's foot and P_d = 0; in the law that adapts it takes the place of F_H - F_T, and
I + M L h that of I, h being the ankle's height: the moment balance about the point under the ankle. There theta_d comes
to the posture in which P = P_d.

``Law`` is the law in continuous time, in CasADi, as the paper simulates it. A ``Controller`` is what can run on a
robot: it is called once a period with what the sensors say. ``sampled`` makes one of a law; it keeps no clock and
holds no state, so that a run can be repeated, resumed, and branched.
"""

from __future__ import annotations

import math
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
    """A law in continuous time, for the ``biped`` that it knows.

    ``torque``: (x (2), memory, K (3)) -> tau [N m]. ``memory_rate``: (x, memory, F_T_F_H (2)) -> memory'. The memory is
    s, or (s, eta) where the law adapts within ``adapt`` [s]. K = (K_p, K_d, K_f).
    """

    kind: LawKind
    biped: Biped
    theta_d: float
    adapt: float
    target: float
    torque: ca.Function
    memory_rate: ca.Function


def law(kind: LawKind, biped: Biped, theta_d: float = 0.0, adapt: float = math.inf, target: float = 0.0) -> Law:
    """The law of this ``kind`` for ``biped``, with desired angle ``theta_d`` [rad] and P_d = ``target`` [m].

    With a finite ``adapt`` [s], for law force only, theta_d is the one at the start.
    """
    adapts = math.isfinite(adapt)
    if adapts and kind != "force":
        message = f"law {kind} does not adapt; law force does"
        raise ValueError(message)
    x, memory = ca.SX.sym("x", 2), ca.SX.sym("memory", 2 if adapts else 1)
    K, forces = ca.SX.sym("K", 3), ca.SX.sym("F", 2)
    aim = desired(biped, adapt, memory[1], x[1]) if adapts else theta_d
    rate = gathered(kind, biped, forces[0], forces[1], target)
    if adapts:
        rate = ca.vertcat(rate, followed(biped, adapt, aim, x[0], rate))
    return Law(
        kind=kind,
        biped=biped,
        theta_d=theta_d,
        adapt=adapt,
        target=target,
        torque=ca.Function(
            "torque", [x, memory, K], [torque_of(kind, biped, aim, x[0], x[1], memory[0], K)], ["x", "memory", "K"],
            ["tau"],
        ),
        memory_rate=ca.Function("memory_rate", [x, memory, forces], [rate]),
    )  # fmt: skip


def swing(biped: Biped, adapt: float) -> float:
    """How much theta_d gives way to the rate, I/(M g L T_a) [s], in a law that adapts within T_a = ``adapt`` [s].

    With I + M L h for I where the ankle has a height h.
    """
    return (biped.I + biped.M * biped.L * biped.height) / (biped.M * biped.g * biped.L * adapt)


def desired(biped: Biped, adapt: float, eta: Any, omega: Any) -> Any:
    """theta_d of a law that adapts."""
    return eta - swing(biped, adapt) * omega


def followed(biped: Biped, adapt: float, aim: Any, theta: Any, gathering: Any) -> Any:
    """How fast eta changes; ``gathering`` is s' (9)."""
    return (theta + biped.ell * gathering / (biped.M * biped.g * biped.L) - aim) / adapt


def torque_of(kind: LawKind, biped: Biped, theta_d: Any, theta: Any, omega: Any, s: Any, K: Any) -> Any:
    """Tau [N m] (8), (20), of the body that the law knows: numbers, arrays or CasADi expressions."""
    posture = -K[1] * omega + K[0] * (theta_d - theta)
    if kind == "pd":
        return posture
    if kind == "force":
        return posture + K[2] * s  # (10)
    return posture + K[2] * (biped.weight / biped.ell) * s  # (20)


def gathered(kind: LawKind, biped: Biped, F_T: Any, F_H: Any, target: float) -> Any:
    """S' (9), (20)."""
    if kind == "pd":
        return 0.0 * F_T
    lean = biped.skew - target / biped.ell
    if kind == "force":
        return (1.0 - lean) * F_H - (1.0 + lean) * F_T  # (9)
    return -((1.0 + lean) * F_T - (1.0 - lean) * F_H) * biped.ell / (F_T + F_H)  # P_d - P, (18)


@dataclass(frozen=True, kw_only=True)
class SampledLaw:
    """One of the paper's laws as a ``Controller``: the integral is summed once a ``period`` [s]."""

    kind: LawKind
    biped: Biped
    gains: Gains
    period: float
    theta_d: float = 0.0
    target: float = 0.0

    def start(self) -> float:
        """The integral at t = 0."""
        return 0.0

    def __call__(self, t: float, measurement: Measurement, memory: float) -> tuple[float, float]:
        """The torque [N m], and the integral after this period (N s for ``force``, m s for ``cop``)."""
        theta, omega, F_T, F_H = measurement
        tau = torque_of(self.kind, self.biped, self.theta_d, theta, omega, memory, self.gains)
        return tau, memory + self.period * gathered(self.kind, self.biped, F_T, F_H, self.target)


@dataclass(frozen=True, kw_only=True)
class AdaptingLaw:
    """Law force with a theta_d that follows the estimated posture within ``adapt`` [s], as a ``Controller``.

    Its memory is (s, eta), eta None until the first measurement.
    """

    biped: Biped
    gains: Gains
    period: float
    adapt: float
    theta_d: float = 0.0
    target: float = 0.0

    def start(self) -> tuple[float, float | None]:
        """The memory at t = 0."""
        return 0.0, None

    def __call__(
        self, t: float, measurement: Measurement, memory: tuple[float, float | None]
    ) -> tuple[float, tuple[float, float | None]]:
        """The torque [N m], and the memory after this period."""
        theta, omega, F_T, F_H = measurement
        s, eta = memory
        if eta is None:
            eta = self.theta_d + swing(self.biped, self.adapt) * omega
        aim = desired(self.biped, self.adapt, eta, omega)
        tau = torque_of("force", self.biped, aim, theta, omega, s, self.gains)
        gathering = gathered("force", self.biped, F_T, F_H, self.target)
        eta += self.period * followed(self.biped, self.adapt, aim, theta, gathering)
        return tau, (s + self.period * gathering, eta)
