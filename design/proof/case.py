"""What is to be proved: one loop in one scenario over one box of bodies and worlds."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction

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


class NotProved(Exception):
    """The tube cannot be built; the text says why, ``influence`` what each parameter that moves has to do with it."""

    def __init__(self, why: str, influence: dict[int, float] | None = None) -> None:
        super().__init__(why)
        self.influence = influence or {}


class OutOfTime(Exception):
    """The deadline has passed; nothing is known of what was begun."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Case:
    """``biped`` and ``scenario`` are the middle of the box, ``radii`` (7,) its half-widths by NAMES [SI, rad].

    The law may adapt within ``adapt`` [s]. It reckons with the body that is ``known`` to it, ``biped`` if that is None:
    one body, whatever the real one. What the law reckons with counts as the floats that it is. ``limits``: by NAMES,
    between which floats the parameters of the whole box lie, of which this may be a part.
    """

    biped: Biped
    kind: LawKind
    gains: Gains
    theta_d: float
    scenario: Scenario
    radii: tuple[float, ...]
    step: float
    known: Biped | None = None
    adapt: float = math.inf
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def believed(self) -> Biped:
        """The body that the law reckons with."""
        return self.known or self.biped

    @property
    def size(self) -> int:
        """How many states there are: theta, omega; s [N s] but for law pd; theta_d where the law adapts.

        Of law cop s is taken in the unit of (8), (M + m) g/ell times that of (20), so that tau is as in (8).
        """
        return 4 if math.isfinite(self.adapt) else 2 if self.kind == "pd" else 3

    @property
    def felt(self) -> Array:
        """How much tau changes with each state, in size (n,)."""
        K = self.gains
        return np.array([K.K_p, K.K_d, K.K_f, K.K_p][: self.size])

    @property
    def gathering(self) -> Fraction:
        """(M + m) g of the body that law cop reckons with [N]: s' is so many tau/(ell (F_T + F_H)).

        It takes its own ell for the CoP (18), and the ell of its K_F cancels that.
        """
        M, m, g = (Fraction(part) for part in _numbers(self.believed, "M", "m", "g"))
        return (M + m) * g

    @property
    def following(self) -> tuple[Fraction, Fraction, Fraction]:
        """The rate 1/T_a, and this times I/(M g L) and ell/(M g L), of the body that a law that adapts reckons with."""
        M, g, L, I, ell = (Fraction(part) for part in _numbers(self.believed, "M", "g", "L", "I", "ell"))
        a = 1 / Fraction(self.adapt)
        return a, a * I / (M * g * L), a * ell / (M * g * L)

    @property
    def moving(self) -> list[int]:
        """Numbers of the parameters that are not fixed."""
        return [k for k, radius in enumerate(self.radii) if radius > 0]

    @property
    def middle(self) -> dict[str, float]:
        """The middle of the box, by NAMES."""
        biped, scenario = self.biped, self.scenario
        final = scenario.angle if scenario.kind == "slope" else 0.0
        values = (biped.M, biped.L, biped.I, biped.m, biped.ell, final, float(scenario.times[-1]))
        return dict(zip(NAMES, values, strict=True))

    @property
    def tolerances(self) -> Tolerances:
        """The half-widths of the box."""
        return Tolerances(**{name: Spread(absolute=each) for name, each in zip(NAMES, self.radii, strict=True)})

    def at(self, shares: dict[int, float]) -> tuple[Biped, Scenario]:
        """The body and the world where parameter k is at a share, from -1 to 1, of its radius."""
        return self.tolerances.drawn(self.biped, self.scenario, [shares.get(k, 0.0) for k in range(7)])


def _numbers(biped: Biped, *names: str) -> tuple[float, ...]:
    return tuple(float(getattr(biped, name)) for name in names)


def longer(case: Case) -> Case:
    """The case with its scenario watched until the loop has all but come to rest, where the force rests."""
    biped, scenario = case.biped, case.scenario
    if goes_on(scenario):
        return case
    F_x, F_y = scenario.force_at(np.array([scenario.duration]))[:, 0]
    A, load = math.hypot(biped.M * biped.g - F_y, F_x), max(biped.load(F_y), 1e-6 * biped.weight)
    matrix = closed_loop_matrix(biped, case.kind, case.gains, A, load, case.adapt, case.believed)
    decay = -float(np.linalg.eigvals(matrix).real.max())
    if decay <= 0:
        return case
    if not case.radii[NAMES.index("ramp")]:  # points from the end on repeat the value at which the signal rests
        kept = max(int(np.searchsorted(scenario.times, scenario.duration, side="left")), 1)
        scenario = replace(scenario, times=scenario.times[:kept], signal=scenario.signal[:, :kept])
    return replace(case, scenario=replace(scenario, duration=scenario.duration + CALM / decay))


def goes_on(scenario: Scenario) -> bool:
    """Whether the force still changes when the scenario ends."""
    return not scenario.rests


def signals(scenario: Scenario, edges: Array) -> tuple[Array, Array]:
    """The signal at both ends of each piece between ``edges`` (n + 1,), each (j, n)."""
    middle = 0.5 * (edges[:-1] + edges[1:])
    return scenario.signal_by(middle, edges[:-1]), scenario.signal_by(middle, edges[1:])
