"""What is to be proved: one loop in one scenario over one box of bodies and worlds."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from design.model.body import Biped
from design.model.environment import Scenario
from design.model.laws import Gains, LawKind
from design.model.stability import closed_loop_matrix
from design.model.uncertainty import Spread, Tolerances

Array = NDArray[np.float64]

NAMES = ("M", "L", "I", "m", "ell", "slope", "ramp")
"""The parameters of a box: of the body, and a slope's final angle and a ramp's time."""
CALM = 14.0
"""Time constants of the slowest pole for which a loop is watched after the end, before it counts as at rest."""
MOST = 100_000
"""Pieces for that, at most."""


class NotProved(Exception):
    """The tube cannot be built; the text says why."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Case:
    """``biped`` and ``scenario`` are the middle of the box, ``radii`` (7,) its half-widths by NAMES [SI, rad]."""

    biped: Biped
    kind: LawKind
    gains: Gains
    theta_d: float
    scenario: Scenario
    radii: tuple[float, ...]
    step: float

    @property
    def moving(self) -> list[int]:
        """Numbers of the parameters that are not fixed."""
        return [k for k, radius in enumerate(self.radii) if radius > 0]

    def at(self, shares: dict[int, float]) -> tuple[Biped, Scenario]:
        """The body and the world where parameter k is at a share, from -1 to 1, of its radius."""
        spreads = {name: Spread(absolute=radius) for name, radius in zip(NAMES, self.radii, strict=True)}
        return Tolerances(**spreads).drawn(self.biped, self.scenario, [shares.get(k, 0.0) for k in range(7)])


def longer(case: Case) -> Case:
    """The case with its scenario watched until the loop has all but come to rest, where the force rests."""
    biped, scenario = case.biped, case.scenario
    if goes_on(scenario):
        return case
    F_x, F_y = scenario.force_at(np.array([scenario.duration]))[:, 0]
    matrix = closed_loop_matrix(biped, case.kind, case.gains, math.hypot(biped.M * biped.g - F_y, F_x), biped.weight)
    decay = -float(np.linalg.eigvals(matrix).real.max())
    if decay <= 0:
        return case
    rest = min(CALM / decay, MOST * case.step)
    return replace(case, scenario=replace(scenario, duration=scenario.duration + rest))


def goes_on(scenario: Scenario) -> bool:
    """Whether the force still changes when the scenario ends."""
    return scenario.steady_from >= scenario.duration and bool(np.ptp(scenario.signal, axis=1).any())


def pieces(scenario: Scenario, step: float) -> tuple[Array, Array, tuple[Array, Array]]:
    """Edges (n + 1,), lengths (n,), and the signal at both ends of each piece, each (j, n)."""
    steps = scenario.steps(step)
    real = steps.h > 0
    edges = np.append(steps.t[:-1][real], steps.t[-1])
    middle = 0.5 * (edges[:-1] + edges[1:])
    inside = scenario.signal_by
    return edges, np.diff(edges), (inside(middle, edges[:-1]), inside(middle, edges[1:]))
