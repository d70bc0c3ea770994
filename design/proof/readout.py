"""What holds in a tube: bounds of the contact forces, the torque and the centre of pressure, and of the Jacobian.

Each quantity is that of the approximate trajectory, more or less by how fast it changes with the state, anywhere in the
tube, times how far the state may be.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.proof.equations import Equations, Parts
from design.proof.norm import felt_signed as signed
from design.proof.spans import Span, span
from design.proof.taylor import UP, Model

if TYPE_CHECKING:
    from design.proof.windows import Norms

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


def reach_of(felt: Array, norms: Norms, D: Array) -> Reach:
    """The reach of a tube whose blocks have radii ``D`` (n, m) in the ``norms``."""
    gradients = (*np.eye(len(felt))[:2], signed(felt))
    return Reach(*(UP * (norms.felt(gradient) * D).sum(axis=1) for gradient in gradients))


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


def quantities(equations: Equations, x: list[Model], parts: Parts, reach: Reach) -> tuple[Series, Series]:
    """Lower and upper bounds over pieces, in a tube of this ``reach``."""
    n, case = len(reach.theta), equations.case
    p = equations.numbers(n)
    tau, turning, sine, load = parts.tau, parts.turning, parts.sine, parts.load
    lever = p["1/ell"] * tau
    toe, heel = (load - lever) * 0.5, (load + lever) * 0.5
    # how much they change within the reach, anywhere in the tube
    S = np.minimum(sine.size() + reach.theta, 1.0)
    W = x[1].size()
    pull = np.hypot(parts.moment.size(), parts.stiffness.size()) * UP
    turned = UP * p["1/I"].size() * (pull * reach.theta + reach.tau)
    moved = turned * S + turning.size() * reach.theta  # theta'' sin theta, omega² cos theta
    moved = moved + reach.omega * (2 * W + reach.omega) + W**2 * reach.theta
    slack_load = UP * UP * (p["M"] * p["L"]).size() * moved
    slack_force = 0.5 * UP * (slack_load + UP * p["1/ell"].size() * reach.tau)
    slack_torque = reach.tau
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
