"""Where the body comes to rest: the posture in which the centre of pressure is at the law's target, and how it is held.

At rest the ground's horizontal force is -F_x, so that by the moments about the ankle (``design.model.plant``)

    tau_0 = c m g + h F_x - P_d N,  N = (M + m) g - F_y,    A L sin(theta_0 - theta_f) + tau_0 = 0

About it the law's integral gathers delta s' = (delta tau + beta theta'')/ell (over N for ell in law cop): a body that
turns changes the load and the horizontal force of the ground, with

    beta = M L (h cos theta_0 - P_d sin theta_0)

For the paper's foot and P_d = 0 theta_0 is theta_f, tau_0 and beta are 0, and delta s' = delta tau/ell (11). The linear
loop then is the paper's with A L cos(theta_0 - theta_f) for A L, and I + beta for I where K_f is: a ``Place``.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.model.body import Biped

Array = NDArray[np.float64]


class Place(NamedTuple):
    """An environment as the linear loop meets it: A cos(theta_0 - theta_f) [N], the load at rest [N], beta [kg m²]."""

    A: float
    load: float
    beta: float = 0.0


class Standing(NamedTuple):
    """The stationary posture ``theta`` [rad] and torque ``tau`` [N m], and what ``Place`` holds; each (j,).

    Where there is none, since the foot asks for more torque than A L, ``theta`` is NaN and ``A`` 0: nothing stands.
    """

    theta: Array
    tau: Array
    A: Array
    load: Array
    beta: Array

    @property
    def places(self) -> list[Place]:
        """The environments one by one."""
        return [Place(*map(float, each)) for each in zip(self.A, self.load, self.beta, strict=True)]


def standing(biped: Biped, F: Array, target: float = 0.0) -> Standing:
    """The stationary posture with P = ``target`` [m] under forces ``F`` (2, j) [N]."""
    F_x, F_y = np.asarray(F, dtype=np.float64)
    down = biped.M * biped.g - F_y
    size, theta_f = np.hypot(down, F_x), np.arctan2(-F_x, down)  # (3), (4)
    load = biped.load(F_y)
    if biped.plain and target == 0.0:
        return Standing(theta=theta_f, tau=0.0 * load, A=size, load=load, beta=0.0 * load)
    tau = biped.tilt_under(F_y) + biped.height * F_x - target * load
    with np.errstate(all="ignore"):
        away = np.arcsin(tau / (size * biped.L))
    theta = theta_f - away
    beta = biped.M * biped.L * (biped.height * np.cos(theta) - target * np.sin(theta))
    stands = np.isfinite(away)
    return Standing(
        theta=theta, tau=tau, A=np.where(stands, size * np.cos(away), 0.0), load=load,
        beta=np.where(stands, beta, 0.0),
    )  # fmt: skip


def posture(biped: Biped, F_x: float, F_y: float, target: float = 0.0) -> float:
    """theta_0 [rad] under one force [N]; theta_f (4) where nothing stands."""
    theta_f = math.atan2(-F_x, biped.M * biped.g - F_y)
    if biped.plain and target == 0.0:
        return theta_f
    theta = float(standing(biped, np.array([[F_x], [F_y]]), target).theta[0])
    return theta if math.isfinite(theta) else theta_f


def met(biped: Biped, target: float, known: Biped) -> float:
    """Where the CoP of ``biped`` comes to rest [m] under a law that takes it for the body ``known``.

    The law balances toe and heel force by the levers that it knows, for P = ``target``.
    """
    if known.skew == biped.skew and target == 0.0:
        return 0.0
    return biped.ell * (biped.skew - known.skew + target / known.ell)
