"""States that are tried in simulation beside the region: which of them recover.

Three cuts through the states (e, omega, w): with the integral as it is at rest (w = 0); as it was at rest before the
ground turned by -e (w = K_p e); and as the region likes it best (w that makes V least), over which the region's part is
its whole projection. A state has recovered once it enters the region, from where recovery is proved.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.model.body import Biped
from design.model.environment import Scenario
from design.model.laws import Gains
from design.present.region_plots import Cut
from problems.region.search import Region

Array = NDArray[np.float64]

SIDE = 29
"""States along each side of a cut."""
TURNS = 241
"""Sudden turns of the ground that are tried to each side."""
PATIENCE = 12.0
"""Time constants of V after which a state that is not back counts as lost."""
LONGEST = 20_000
"""Steps, at most."""


def cuts(region: Region, biped: Biped, gains: Gains, scenario: Scenario) -> list[Cut]:
    """The three cuts, tried."""
    P, K_p = region.P, gains.K_p
    best = -P[2, :2] / P[2, 2]
    wide = np.sqrt(np.diag(region.Q)[:2])
    strip = np.array([region.strip, region.Omega * region.strip])
    named = [
        ("projection, w that suits each state best", best),
        ("after the ground has turned (w = $K_p$ e)", np.array([K_p, 0.0])),
        ("integral at rest (w = 0)", np.zeros(2)),
    ]
    found = []
    for k, (title, row) in enumerate(named):
        lift = np.vstack([np.eye(2), row])
        part = lift.T @ P @ lift
        reach = [
            np.array([1.15 * max(wide[0], strip[0]), 1.5 * wide[1]]),
            2.4 * np.sqrt(np.diag(np.linalg.inv(part))),
            2.8 / np.sqrt(np.diag(part)),  # where the region crosses the axes: along it, it is slender
        ][k]
        e, omega = np.meshgrid(*(np.linspace(-each, each, SIDE) * (1 - 1 / SIDE) for each in reach))
        states = lift @ np.stack([e.ravel(), omega.ravel()])
        shadow = _ellipse(np.linalg.inv(region.Q[:2, :2]))
        found.append(
            Cut(
                title=title, outline=np.degrees(_ellipse(part)), shadow=np.degrees(shadow),
                states=np.degrees(states[:2]), recovered=recovered(region, biped, gains, scenario, states),
                strip=math.degrees(region.strip), Omega=region.Omega, reach=np.degrees(reach),
            )
        )  # fmt: skip
    return found


def turned(region: Region, biped: Biped, gains: Gains, scenario: Scenario) -> float:
    """The largest sudden turn [rad] of the ground, to either side, up to which all that are tried recover."""
    e = np.linspace(region.turn, max(1.2 * region.strip, 1.01 * region.turn), TURNS)
    found = []
    for side in (1.0, -1.0):
        states = side * np.stack([e, np.zeros(TURNS), gains.K_p * e])
        lost = np.flatnonzero(~recovered(region, biped, gains, scenario, states)[1:])
        found.append(float(e[lost[0]] if len(lost) else e[-1]))
    return min(found)


def _ellipse(P: NDArray[Any]) -> Array:
    """Points (2, k) of xᵀ P x = 1."""
    angle = np.linspace(0.0, 2 * math.pi, 181)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(P)).T @ np.stack([np.cos(angle), np.sin(angle)]))


def recovered(region: Region, biped: Biped, gains: Gains, scenario: Scenario, states: Array) -> NDArray[np.bool_]:
    """Which of ``states`` (3, n) = (e, omega, w) come into the region, toe and heel on the ground (level) all the way.

    The classical Runge-Kutta method, contact seen at its steps.
    """
    M, L, I, m, ell, g = biped.M, biped.L, biped.I, biped.m, biped.ell, biped.g
    F_x, F_y = scenario.force_at(np.array([scenario.duration]))[:, 0]
    K_p, K_d, K_f = gains

    def rate(x: Array) -> tuple[Array, Array]:
        theta = region.theta_f + x[0]
        tau = -K_p * x[0] - K_d * x[1] + x[2]
        turning = ((M * g - F_y) * L * np.sin(theta) + F_x * L * np.cos(theta) + tau) / I
        load = (M + m) * g - F_y - M * L * (turning * np.sin(theta) + x[1] ** 2 * np.cos(theta))
        return np.stack([x[1], turning, K_f / ell * tau]), 0.5 * (load - np.abs(tau) / ell)

    fastest = math.sqrt(K_p / I) + K_d / I + K_f / ell
    h = min(0.5 / fastest, 0.005)
    steps = min(int(PATIENCE / (region.decay * h)), LONGEST)
    back = np.zeros(states.shape[1], dtype=bool)
    going = np.arange(states.shape[1])
    x = states
    for _ in range(steps):
        k1, contact = rate(x)
        home = np.einsum("in,ij,jn->n", x, region.P, x) <= 1
        kept = (contact >= region.level) & (np.abs(x[0]) < math.pi)
        back[going[kept & home]] = True
        stays = kept & ~home
        if not stays.any():
            break
        x, k1, going = x[:, stays], k1[:, stays], going[stays]
        k2 = rate(x + 0.5 * h * k1)[0]
        k3 = rate(x + 0.5 * h * k2)[0]
        k4 = rate(x + h * k3)[0]
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return back
