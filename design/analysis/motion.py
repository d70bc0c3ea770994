"""The states at chosen instants as a differentiable function of the gains.

A trajectory depends on three gains only, so its derivatives are best carried forward with it: the Runge-Kutta step is
differentiated once and twice along the gains, and the sensitivities are marched together with the state. CasADi is
told that these are the Jacobian and the Jacobian's Jacobian of the result, so that any function composed with it has
exact first and second derivatives; this is several times faster than differentiating the marched loop in reverse.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import combinations_with_replacement

import casadi as ca
import numpy as np

from design.model.closed_loop import ClosedLoop
from design.model.environment import Scenario, Steps

BLOCKS = 16
"""A trajectory is marched in multiples of a sixteenth of its length, only as far as it is looked at."""

_PAIRS = list(combinations_with_replacement(range(3), 2))
_CLOSED = {"never_inline": True, "enable_forward": False, "enable_reverse": False}


class Motion:
    """One scenario's trajectory on one time grid, as a function of K = (K_p, K_d, K_f)."""

    def __init__(self, loop: ClosedLoop, scenario: Scenario, steps: Steps) -> None:
        self.steps = steps
        self._count = len(self.steps.h)
        self._inputs = ca.DM(np.vstack([self.steps.h, self.steps.start, self.steps.middle, self.steps.end]))
        self._z0 = loop.start(scenario.theta0, scenario.omega0)
        self._steps = sensitivity_steps(loop)
        self._built: dict[tuple[int, int], ca.Function] = {}

    def states(self, instants: Sequence[int]) -> ca.Function:
        """K (3) -> states (m, n) at the samples numbered ``instants`` (n), with exact derivatives to second order."""
        columns = [int(k) for k in instants]
        n, m = len(columns), len(self._z0)
        K, Z, J = ca.MX.sym("K", 3), ca.MX.sym("Z", m, n), ca.MX.sym("J", m * n, 3)
        plain, first, second = (self._marched(order, K, max(columns))[:, columns] for order in range(3))
        jacobian = ca.horzcat(*[ca.vec(first[m + m * j : 2 * m + m * j, :]) for j in range(3)])
        hessian = ca.horzcat(*[ca.vertcat(*[ca.vec(second[_rows(m, i, j), :]) for j in range(3)]) for i in range(3)])
        curvature = ca.Function(
            "jac_jac_states", [K, Z, J], [hessian, ca.MX(3 * m * n, m * n)], ["K", "out_Z", "out_jac_Z_K"],
            ["jac_jac_Z_K_K", "jac_jac_Z_K_out_Z"],
        )  # fmt: skip
        slope = ca.Function(
            "jac_states", [K, Z], [jacobian], ["K", "out_Z"], ["jac_Z_K"], {"custom_jacobian": curvature, **_CLOSED}
        )
        return ca.Function("states", [K], [plain], ["K"], ["Z"], {"custom_jacobian": slope, **_CLOSED})

    def all_states(self, K: ca.MX) -> ca.MX:
        """States (m, N+1) at every sample, without the fast derivatives."""
        return self._marched(0, K, self._count)

    def _marched(self, order: int, K: ca.MX, last: int) -> ca.MX:
        """States and sensitivities up to ``order`` from the first sample to the one numbered ``last``."""
        blocks = max(1, -(-last * BLOCKS // self._count))
        if (order, blocks) not in self._built:
            step = self._steps[order]
            count = min(self._count, -(-self._count * blocks // BLOCKS))
            gains, start = ca.MX.sym("K", 3), ca.DM([*self._z0, *[0.0] * (step.size1_in(0) - len(self._z0))])
            march = step.mapaccum("march", count)(start, self._inputs[:, :count], ca.repmat(gains, 1, count))
            self._built[order, blocks] = ca.Function("marched", [gains], [ca.horzcat(start, march)])
        return self._built[order, blocks](K)


def _rows(m: int, i: int, j: int) -> slice:
    at = 4 * m + m * _PAIRS.index((min(i, j), max(i, j)))
    return slice(at, at + m)


@lru_cache(maxsize=16)
def sensitivity_steps(loop: ClosedLoop) -> list[ca.Function]:
    """The step of z (m), of (z, dz/dK) (4 m), and of (z, dz/dK, d²z/dK²) (10 m), each a function of (state, u, K).

    With z⁺ = phi(z, K): S⁺ = phi_z S + phi_K, and its derivative along each pair of gains.
    """
    m = loop.size
    z, u, K = ca.SX.sym("z", m), ca.SX.sym("u", 7), ca.SX.sym("K", 3)
    S, T = ca.SX.sym("S", m, 3), ca.SX.sym("T", m, len(_PAIRS))
    step = loop.step
    following = step.call([z, u, K], True, False)[0]
    zK = ca.vertcat(z, K)
    along = [ca.vertcat(S[:, i], ca.densify(ca.DM.eye(3)[:, i])) for i in range(3)]
    S_next = [ca.jtimes(following, zK, direction) for direction in along]
    T_next = []
    for index, (i, j) in enumerate(_PAIRS):
        held = ca.SX.sym(
            "held", m + 3
        )  # d/dj of the i-th sensitivity, its direction held, plus the direction's own change
        bent = ca.jtimes(ca.jtimes(following, zK, held), zK, along[j])
        T_next.append(ca.substitute(bent, held, along[i]) + ca.jtimes(following, z, T[:, index]))
    cse = {"cse": True}
    first, second = ca.horzcat(*S_next), ca.horzcat(*T_next)
    return [
        step,
        ca.Function("step_1", [ca.veccat(z, S), u, K], [ca.veccat(following, first)], cse),
        ca.Function("step_2", [ca.veccat(z, S, T), u, K], [ca.veccat(following, first, second)], cse),
    ]
