"""What the linear and the nonlinear prediction share: model about the stationary posture, cost, limits, terminal set.

minimise    Σ_{k<N} e_k² + w_rate (omega_k/Omega)² + w_torque (tau_k/(A L))²  +  x_NᵀP x_N  +  penalty sigma
over        tau_0 .. tau_{N-1}, sigma >= 0                     e = theta - theta_f, x = (e, omega), Omega² = A L/I
subject to  the dynamics from the state believed now, with the external force held (or as foreseen)
            each limit at each step, toe and heel force above all, to within sigma times its scale
            |tau_k| and |tau_k - tau_{k-1}| within the actuator's limits
            the terminal set

P is the Riccati matrix, so that without active limits the torque is LQR's, whatever N. sigma makes the limits soft with
an exact penalty: it is zero whenever the hard limits can be met.

Where foot or target are not the paper's, theta_f is the posture with the CoP at its target, tau counts from the torque
tau_0 that holds it, and A L is A L cos(theta_0 - theta_f) (``design.model.standing``).

Terminal set. The unstable mode xi = e + omega/Omega stands still under the torque -A L xi held for ever; theta goes
to theta_f + xi without overshoot (capturability: Hof 2005, Koolen 2012). So the plan must end where that torque is in
the actuator's reach from tau_{N-1}, and meets the limits both at x_N and at (theta_f + xi, 0); between the two the
limits, affine in e, are met as well. A plan shifted by one step, with that torque appended, is then feasible again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from design.model.actuator import Actuator
from design.model.body import Biped
from design.model.limits import Limit, Required, limits
from design.model.plant import plant
from design.model.standing import standing
from design.model.tuning import Tuning

Array = NDArray[np.float64]

PENALTY = 1e3
"""Cost of breaking a limit by its scale; the cost of e is 1 per rad² and step."""

GRID = 0.005
"""Ratio between neighbouring values of A for which a linear model is built."""

WISH = 1.0
"""Cost of breaking a wish by its scale: enough to keep it where that is possible, and not to stand askew for it where
it is not. For contact, by the scale that it then has, it is as much as a hundred."""
FIRM = 0.01
"""By how much less than its scale contact gives way when a wish does by its own."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Horizon:
    """A prediction to be posed: the nominal ``biped``, ``tuning``, ``actuator``, and ``rows``: limits and levels.

    ``target`` [m]: where the CoP is to come to rest.
    """

    biped: Biped
    tuning: Tuning
    actuator: Actuator
    rows: tuple[tuple[Limit, float], ...]
    penalty: float = PENALTY
    target: float = 0.0

    @cached_property
    def plain(self) -> bool:
        """Whether foot and target are the paper's."""
        return self.biped.plain and self.target == 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Posture:
    """The linear model about a stationary posture of size ``A`` [N], x = (e, omega), with the torque held a step.

    x_{k+1} = ``Ad`` (2, 2) x_k + ``Bd`` (2) tau_k; ``Q`` (2, 2) and ``R`` weigh x and tau; LQR: tau = -``K`` (2) x,
    cost xᵀ ``P`` (2, 2) x. ``Omega`` [1/s], ``AL`` [N m].
    """

    A: float
    AL: float
    Omega: float
    Ad: Array
    Bd: Array
    Q: Array
    R: float
    P: Array
    K: Array


def horizon(
    biped: Biped, tuning: Tuning, actuator: Actuator, required: dict[str, Required], target: float = 0.0,
    *, field: bool = False,
) -> Horizon:  # fmt: skip
    """The prediction for ``biped``: contact always, other limits where they are required to be kept.

    ``field``: friction is to hold the foot too against an acceleration field, as the force may be that of one.

    Where more than contact is required, contact itself comes first with a scale of its own, ``FIRM`` times the usual: a
    wish that has to be broken for a while then frees neither foot nor terminal set of it.
    """
    contact, wishes = [], []
    margin = tuning.contact * biped.weight
    for limit in limits(plant(biped), required, field=field):
        level = limit.hard_level
        if limit.id == "torque" or level is None or (limit.id == "cop-margin" and level <= 0):
            continue  # the actuator's, not required, or the same as contact
        if limit.unit == "N":
            contact.append((limit, margin))
        if limit.unit != "N" or level > 0:
            wishes.append((limit, level + (margin if limit.unit == "N" else 0.0)))
    if wishes:
        contact = [(replace(limit, scale=FIRM * limit.scale), level) for limit, level in contact]
    penalty = WISH if wishes else PENALTY
    return Horizon(
        biped=biped, tuning=tuning, actuator=actuator, rows=(*contact, *wishes), penalty=penalty, target=target
    )


def stationary(biped: Biped, F_x: float, F_y: float) -> tuple[float, float]:
    """A [N] and theta_f [rad] of (3)-(4) for the force (F_x, F_y) [N]."""
    down = biped.M * biped.g - F_y
    return math.hypot(down, F_x), math.atan2(-F_x, down)


def resting(horizon: Horizon, F_x: float, F_y: float) -> tuple[float, float, float]:
    """A [N], theta [rad] and tau [N m] of the posture to be reached; raises ``ArithmeticError`` where there is none."""
    if horizon.plain:
        return *stationary(horizon.biped, F_x, F_y), 0.0
    rest = standing(horizon.biped, np.array([[F_x], [F_y]]), horizon.target)
    if not rest.A[0] > 0:
        message = "no posture has its CoP at the target"
        raise ArithmeticError(message)
    return float(rest.A[0]), float(rest.theta[0]), float(rest.tau[0])


@lru_cache(maxsize=256)
def posture(biped: Biped, tuning: Tuning, A: float) -> Posture:
    """The linear model, exactly discretised, and its LQR."""
    AL = A * biped.L
    Omega = math.sqrt(AL / biped.I)
    c, s = math.cosh(Omega * tuning.step), math.sinh(Omega * tuning.step)
    Ad = np.array([[c, s / Omega], [Omega * s, c]])
    Bd = np.array([(c - 1) / AL, s / (Omega * biped.I)])
    Q, R = np.diag([1.0, tuning.rate / Omega**2]), tuning.torque / AL**2
    P = scipy.linalg.solve_discrete_are(Ad, Bd[:, None], Q, [[R]])
    K = (Bd @ P @ Ad) / (R + Bd @ P @ Bd)
    return Posture(A=A, AL=AL, Omega=Omega, Ad=Ad, Bd=Bd, Q=Q, R=R, P=P, K=K)
