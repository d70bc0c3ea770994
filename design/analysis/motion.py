"""The states at chosen instants as a differentiable function of the gains.

A trajectory depends on three gains only, so its derivatives are best carried forward with it: the Runge-Kutta step is
differentiated once and twice along the gains, and the sensitivities are marched together with the state. CasADi is
told that these are the Jacobian and the Jacobian's Jacobian of the result, so that any function composed with it has
exact first and second derivatives; this is several times faster than differentiating the marched loop in reverse.

Where the disturbance itself is sought, the largest one that is survived, its size is one more parameter (``Sized``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import combinations_with_replacement
from typing import Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design.analysis.slabs import marched
from design.analysis.survival import pull, rest
from design.model.body import Biped
from design.model.closed_loop import ClosedLoop
from design.model.environment import Scenario, Steps

Array = NDArray[np.float64]

BLOCKS = 16
"""A trajectory is marched in multiples of a sixteenth of its length, only as far as it is looked at."""

_CLOSED = {"never_inline": True, "enable_forward": False, "enable_reverse": False}


@dataclass(frozen=True, kw_only=True)
class Sized:
    """A disturbance from rest on level ground, of the size ``base`` + ``rate`` v.

    A sudden slope [rad], or a push at the centre of gravity [N s].
    """

    kind: Literal["step-slope", "push"]
    base: float
    rate: float

    def size(self, v: Any) -> Any:
        """The size at ``v``."""
        return self.base + self.rate * v

    def force(self, biped: Biped, v: Any) -> Any:
        """The constant force (2,) [N], (21)."""
        if self.kind == "push":
            return ca.DM([0.0, 0.0])
        alpha = self.size(v)
        return biped.M * biped.g * ca.vertcat(ca.sin(alpha), 1.0 - ca.cos(alpha))

    def start(self, loop: ClosedLoop, p: Any) -> Any:
        """The states at t = 0, for p = (K, v): at rest on level ground, and pushed."""
        biped, law = loop.biped, loop.law
        omega = self.size(p[3]) * biped.L / biped.I if self.kind == "push" else 0.0
        if law.kind == "pd" or (biped.plain and law.target == 0.0):
            return ca.vertcat(*loop.start(0.0, omega))
        theta, tau = rest(loop)
        theta_d = theta if math.isfinite(law.adapt) else law.theta_d
        s = (tau - p[0] * (theta_d - theta)) / (p[2] * pull(loop))
        return ca.vertcat(*loop.start(theta, omega, s, theta_d))


class Motion:
    """One scenario's trajectory on one time grid, as a function of p: K = (K_p, K_d, K_f), or (K, v) where ``sized``.

    A sized disturbance replaces the scenario's force and state at t = 0.
    """

    def __init__(self, loop: ClosedLoop, scenario: Scenario, steps: Steps, sized: Sized | None = None) -> None:
        self.steps = steps
        self.free = 3 if sized is None else 4
        self._sized, self._biped = sized, loop.biped
        self._count = len(self.steps.h)
        self._size = loop.size
        self._pairs = _pairs(self.free)
        self._steps = sensitivity_steps(loop, sized)
        p = ca.SX.sym("p", self.free)
        if sized is None:
            z0 = ca.SX(ca.DM(loop.start(scenario.theta0, scenario.omega0)))
        else:
            z0 = sized.start(loop, p)
        slope = ca.jacobian(z0, p)
        orders = (z0, ca.vec(slope), ca.vertcat(*[ca.jacobian(slope[:, i], p[j]) for i, j in self._pairs]))
        self._start = [ca.Function("start", [p], [ca.densify(ca.vertcat(*orders[: k + 1]))]) for k in range(3)]
        self._built: dict[tuple[int, int], ca.Function] = {}

    @cached_property
    def _inputs(self) -> ca.DM:
        return ca.DM(np.vstack([self.steps.h, self.steps.start, self.steps.middle, self.steps.end]))

    def in_slabs(self, p: Array) -> Array:
        """States (m, N+1) at every sample for numbers ``p``, without building a march of that length."""
        own = p[: self.free]
        start = self._start[0](own).full().ravel()
        return marched(self._steps[0], start, self.steps, own if self._sized else own[:3])

    def states(self, instants: Sequence[int]) -> ca.Function:
        """P -> states (m, n) at the samples numbered ``instants`` (n), with exact derivatives to second order."""
        columns = [int(k) for k in instants]
        n, m, free = len(columns), self._size, self.free
        p, Z, J = ca.MX.sym("p", free), ca.MX.sym("Z", m, n), ca.MX.sym("J", m * n, free)
        plain, first, second = (self._marched(order, p, max(columns))[:, columns] for order in range(3))
        jacobian = ca.horzcat(*[ca.vec(first[m + m * j : 2 * m + m * j, :]) for j in range(free)])
        hessian = ca.horzcat(
            *[ca.vertcat(*[ca.vec(second[self._rows(i, j), :]) for j in range(free)]) for i in range(free)]
        )
        curvature = ca.Function(
            "jac_jac_states", [p, Z, J], [hessian, ca.MX(free * m * n, m * n)], ["p", "out_Z", "out_jac_Z_p"],
            ["jac_jac_Z_p_p", "jac_jac_Z_p_out_Z"],
        )  # fmt: skip
        slope = ca.Function(
            "jac_states", [p, Z], [jacobian], ["p", "out_Z"], ["jac_Z_p"], {"custom_jacobian": curvature, **_CLOSED}
        )
        return ca.Function("states", [p], [plain], ["p"], ["Z"], {"custom_jacobian": slope, **_CLOSED})

    def all_states(self, p: ca.MX, order: int = 0) -> ca.MX:
        """States (m, N+1) at every sample, without the fast derivatives.

        With ``order`` 1 or 2 their sensitivities stand below them, by parameter, then by pair of parameters.
        """
        return self._marched(order, p, self._count)

    def force(self, instants: Sequence[int] | None, p: Any) -> Any:
        """The force (2, n) [N] at the samples numbered ``instants``, or at all."""
        if self._sized is None:
            return ca.DM(self.steps.force if instants is None else self.steps.force[:, list(instants)])
        count = len(self.steps.t) if instants is None else len(instants)
        return ca.repmat(self._sized.force(self._biped, p[3]), 1, count)

    def _marched(self, order: int, p: ca.MX, last: int) -> ca.MX:
        """States and sensitivities up to ``order`` from the first sample to the one numbered ``last``."""
        blocks = max(1, -(-last * BLOCKS // self._count))
        if (order, blocks) not in self._built:
            step = self._steps[order]
            count = min(self._count, -(-self._count * blocks // BLOCKS))
            given = ca.MX.sym("p", self.free)
            start = self._start[order](given)
            march = step.mapaccum("march", count)(start, self._inputs[:, :count], ca.repmat(given, 1, count))
            self._built[order, blocks] = ca.Function("marched", [given], [ca.horzcat(start, march)])
        return self._built[order, blocks](p)

    def _rows(self, i: int, j: int) -> slice:
        at = self._size * (1 + self.free + self._pairs.index((min(i, j), max(i, j))))
        return slice(at, at + self._size)


def _pairs(free: int) -> list[tuple[int, int]]:
    return list(combinations_with_replacement(range(free), 2))


@lru_cache(maxsize=64)
def sensitivity_steps(loop: ClosedLoop, sized: Sized | None = None) -> list[ca.Function]:
    """The step of z (m), of (z, dz/dp), and of (z, dz/dp, d²z/dp²), each a function of (state, u, p).

    With z⁺ = phi(z, p): S⁺ = phi_z S + phi_p, and its derivative along each pair of parameters.
    """
    m, free = loop.size, 3 if sized is None else 4
    pairs = _pairs(free)
    z, u, p = ca.SX.sym("z", m), ca.SX.sym("u", 7), ca.SX.sym("p", free)
    S, T = ca.SX.sym("S", m, free), ca.SX.sym("T", m, len(pairs))
    seen = u if sized is None else ca.vertcat(u[0], *[sized.force(loop.biped, p[3])] * 3)
    following = loop.step.call([z, seen, p[:3]], True, False)[0]
    zp = ca.vertcat(z, p)
    along = [ca.vertcat(S[:, i], ca.densify(ca.DM.eye(free)[:, i])) for i in range(free)]
    S_next = [ca.jtimes(following, zp, direction) for direction in along]
    T_next = []
    for index, (i, j) in enumerate(pairs):
        held = ca.SX.sym(
            "held", m + free
        )  # d/dj of the i-th sensitivity, its direction held, plus the direction's own change
        bent = ca.jtimes(ca.jtimes(following, zp, held), zp, along[j])
        T_next.append(ca.substitute(bent, held, along[i]) + ca.jtimes(following, z, T[:, index]))
    cse = {"cse": True}
    first, second = ca.horzcat(*S_next), ca.horzcat(*T_next)
    return [
        ca.Function("step_0", [z, u, p], [following], cse) if sized else loop.step,
        ca.Function("step_1", [ca.veccat(z, S), u, p], [ca.veccat(following, first)], cse),
        ca.Function("step_2", [ca.veccat(z, S, T), u, p], [ca.veccat(following, first, second)], cse),
    ]
