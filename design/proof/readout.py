"""What holds in a tube: bounds of the contact forces, the torque and the centre of pressure, and of the Jacobian.

Each quantity is that of the approximate trajectory, more or less by how fast it changes with the state, anywhere in the
tube, times how far the state may be.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.proof.equations import Equations, Parts
from design.proof.norm import dual
from design.proof.spans import Span, span
from design.proof.taylor import UP, Model

Array = NDArray[np.float64]
Series = dict[str, Array]


class Reach(NamedTuple):
    """How far theta [rad], omega [rad/s] and tau [N m] may be from those of the approximate trajectory (n,)."""

    theta: Array
    omega: Array
    tau: Array

    def within(self, other: Reach, *, all_three: bool) -> bool:
        """Whether theta's, or ``all_three``, are at most the other's."""
        return all(bool((a <= b).all()) for a, b in zip(self[: 3 if all_three else 1], other, strict=False))

    def parted(self, lengths: Sequence[int]) -> Iterator[Reach]:
        """Those of so many pieces, one after the other."""
        begin = 0
        for length in lengths:
            yield Reach(*(each[begin : begin + length] for each in self))
            begin += length


def reach_of(felt: Array, inverse: Array, D: Array) -> Reach:
    """The reach of a tube of radius ``D`` (n,) in the norms of the matrices that have this ``inverse`` (n, m, m)."""
    theta, omega = (UP * np.sqrt(inverse[:, j, j]) * D for j in (0, 1))
    return Reach(theta, omega, UP * dual(inverse, list(felt), len(D)) * D)


def stiffness(parts: Parts, reach: Array) -> tuple[Array, Array]:
    """Bounds (n,) of G where theta is within ``reach`` [rad]."""
    bottom, top = parts.stiffness.bounds()
    # A L cos changes by at most |A L sin| a + A L a²/2
    size = np.hypot(parts.moment.size(), parts.stiffness.size()) * UP
    widen = UP * (parts.moment.size() * reach + size * reach**2)
    return bottom - widen, top + widen


def gathering(equations: Equations, x: list[Model], parts: Parts, reach: Reach) -> tuple[Span, Span, Span]:
    """What gather, bend and drag lie in in each piece, as ``design.proof.jacobian`` has them for law (20)."""
    p = equations.numbers(len(x[0].c))
    inertia, ML, c = span(p["1/I"]), span(p["M"] * p["L"]), float(equations.case.gathering)
    pull = np.hypot(parts.moment.size(), parts.stiffness.size()) * UP
    turned = UP * p["1/I"].size() * (pull * reach.theta + reach.tau)
    omega, tau = span(x[1]).wider(reach.omega), span(parts.tau).wider(reach.tau)
    sine, cosine = (span(each).wider(reach.theta).within(1.0) for each in (parts.sine, parts.cosine))
    W = x[1].size()
    moved = turned * parts.sine.size() + (parts.turning.size() + turned) * reach.theta
    moved = moved + reach.omega * (2 * W + reach.omega) + (W + reach.omega) ** 2 * reach.theta
    load = span(parts.load).wider(UP * UP * (p["M"] * p["L"]).size() * moved)
    G = Span(*stiffness(parts, reach.theta))
    level = span(p["1/ell"]).times(c).over(load)
    z = ML.times(tau).over(load).times(level)
    gather = level.plus(z.times(sine).times(inertia))
    turning = span(parts.turning).wider(turned)
    bend = G.times(sine).times(inertia).plus(turning.times(cosine)).less(omega.times(omega).times(sine))
    return gather, z.times(bend), z.times(2.0).times(omega).times(cosine)


def quantities(equations: Equations, x: list[Model], parts: Parts, D: Array, inverse: Array) -> tuple[Series, Series]:
    """Lower and upper bounds over pieces, in which the tube's radius is ``D`` (n,); ``inverse`` (n, m, m), of P."""
    n, case = len(D), equations.case
    p, felt = equations.numbers(n), case.felt.tolist()
    tau, turning, sine, load = parts.tau, parts.turning, parts.sine, parts.load
    lever = p["1/ell"] * tau
    toe, heel = (load - lever) * 0.5, (load + lever) * 0.5
    # how fast they change with the state, anywhere in the tube
    reach = UP * np.sqrt(np.diagonal(inverse, axis1=1, axis2=2)).T * D
    S = np.minimum(sine.size() + reach[0], 1.0)
    W = x[1].size() + reach[1]
    pull = np.hypot(parts.moment.size(), parts.stiffness.size()) * UP
    inertia = p["1/I"].size()
    steepest = [pull + felt[0], *(np.full(n, each) for each in felt[1:])]
    far = sum(part * move for part, move in zip(steepest, reach, strict=True))
    T = turning.size() + inertia * far * UP
    ML, short = (p["M"] * p["L"]).size(), p["1/ell"].size()
    of_load = [ML * (inertia * part * S) for part in steepest]
    of_load[0] = of_load[0] + ML * (T + W * W)
    of_load[1] = of_load[1] + ML * 2 * W
    of_force = [0.5 * (a + short * b) for a, b in zip(of_load, felt, strict=True)]
    slack_force = UP * dual(inverse, of_force, n) * D
    slack_load = UP * dual(inverse, of_load, n) * D
    slack_torque = UP * dual(inverse, felt, n) * D
    low, high = {}, {}
    for id, model, slack in (("toe-force", toe, slack_force), ("heel-force", heel, slack_force),
                             ("torque", tau, slack_torque), ("load", load, slack_load)):  # fmt: skip
        bottom, top = model.bounds()
        low[id], high[id] = bottom - slack * UP, top + slack * UP
    most = np.maximum(np.abs(low["torque"]), np.abs(high["torque"]))
    with np.errstate(all="ignore"):
        away = np.where(low["load"] > 0, most / low["load"], np.inf) * UP
        least = np.where((low["torque"] <= 0) & (high["torque"] >= 0), 0.0,
                         np.minimum(np.abs(low["torque"]), np.abs(high["torque"])))  # fmt: skip
        near = np.where(high["load"] > 0, least / high["load"], np.inf) / UP
    ell, radius = case.biped.ell, case.radii[4]
    low["cop-margin"], high["cop-margin"] = (ell - radius) / UP - away, (ell + radius) * UP - near
    low["torque"], high["torque"] = least, most
    return low, high
