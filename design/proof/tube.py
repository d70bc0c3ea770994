"""Contact for all times and every body of a box: a tube around an approximate trajectory that holds the true ones.

x̃(t, p) is any piecewise polynomial (``design.proof.trajectory``), linear in the parameters p of the box. Its defect
x̃' - f(x̃, t, p) is bounded by Taylor models (``design.proof.taylor``). In coordinates S x in blocks whose norms fall at
proved rates over the whole tube (``design.proof.norm``)

    |S_b (x - x̃)| <= D_b,    D_b' = -rate_b D_b + sum of coupling_bc D_c + |S_b defect|,    D(0) = |S (x - x̃)(0)|

The ranges of the Jacobian's numbers over the tube, on which the rate depends, are those of a tube of an assumed reach;
that D stays below it closes the argument, and for law (20), which divides by the load, keeps the load above 0. *After
the end*, where the force rests, the constant x̃(T) is an approximate trajectory for ever.

Assumptions: the foot stands (which the bounds on toe and heel force confirm), no slip, no delay, no noise. Numbers of
the body and world count with all that is within 1e-14 of them, what the law reckons with as the floats that they are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.proof.case import NAMES, Case, NotProved, goes_on, longer, signals
from design.proof.equations import Equations, Parts
from design.proof.norm import falls, settled
from design.proof.readout import Reach, quantities, reach_of, stiffness
from design.proof.taylor import ROUNDING, UP, Model, blank
from design.proof.trajectory import trajectory
from design.proof.windows import Norms, norms

Array = NDArray[np.float64]

ROUNDS = 8
"""How often the assumed radius of the tube is enlarged."""
WIDER = 1.2
"""How much wider than the tube that came of it the next assumed one is."""
CUTS = 8
"""Parts of each piece that have bounds of their own; a power of 2."""
SLIVER = 1e-15
"""By what part of the time, or of 1 s, a corner may lie off the float it is read as."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Bounds:
    """What holds over the box in pieces of time, and after the end (last).

    ``low``, ``high`` (n + 1,) of each quantity: ``toe-force``, ``heel-force``, ``load`` [N], ``torque`` (its size)
    [N m], ``cop-margin`` [m]. ``t`` (n + 1,): where the pieces begin [s], for the ramp of the middle. ``radius``: the
    tube's largest; ``rate`` [1/s]. ``influence``: by the number of each parameter that moves, what it
    moves of the loop.
    """

    t: Array
    low: dict[str, Array]
    high: dict[str, Array]
    radius: float
    rate: float
    influence: dict[int, float]


def bounds(case: Case, deadline: float = math.inf) -> Bounds:
    """The bounds for ``case``; raises ``NotProved``, and ``OutOfTime`` after the ``deadline`` (``time.monotonic``)."""
    try:
        tube = Tube(case, deadline)
    except ValueError as error:
        raise NotProved(str(error)) from error
    try:
        return tube.bounds()
    except (NotProved, ValueError) as error:
        raise NotProved(str(error), tube.influence()) from error


class End(NamedTuple):
    """The constant approximation after the end: states and parts, in which its flow is its defect."""

    states: list[Model]
    parts: Parts


class Tube:
    """The approximate trajectories as models, and what is computed of them."""

    def __init__(self, case: Case, deadline: float) -> None:
        self.case, self.k, self.size = longer(case), len(case.moving), case.size
        if goes_on(case.scenario) and case.radii[NAMES.index("ramp")] > 0:
            message = "the ramp may end sooner or later than the scenario; lengthen duration_s"
            raise NotProved(message)
        self.equations = Equations(self.case)
        self.trajectory, self.deadline = trajectory(self.case, deadline), deadline
        edges, self.h = self.trajectory.edges, np.diff(self.trajectory.edges)
        self.n = len(self.h)
        x, gap = self._approximation(self.trajectory.c)
        scale = self._time_scale(edges)
        parts = self.equations.parts(x, self.equations.world(self.n, signals(self.case.scenario, edges)))
        moved = np.stack([f.size() for f in parts.flow], axis=1)
        gap += SLIVER * (1 + edges[:-1, None]) * (moved + np.roll(moved, 1, axis=0))
        off = [(each.slope() - scale * f).parted(CUTS).size() for each, f in zip(x, parts.flow, strict=True)]
        self.defects = np.stack(off, axis=1) / CUTS
        self.last = [model.at(1.0)[-1] for model in x]
        self.jump = ROUNDING * np.array([[np.abs(model.c[-1]).sum() for model in x]])
        # the same in shorter pieces, that each may have bounds of its own
        self.x, self.parts = [model.parted(CUTS) for model in x], parts.parted(CUTS)
        self.edges = np.append((edges[:-1, None] + self.h[:, None] * np.arange(CUTS) / CUTS).ravel(), edges[-1])
        self.n, self.h = CUTS * self.n, np.repeat(self.h / CUTS, CUTS)
        self.gap = np.zeros((self.n, self.size))
        self.gap[::CUTS] = gap

    # ---- the approximate trajectories

    def _time_scale(self, edges: Array) -> Model:
        """h(p)/2 of each piece: a ramp that takes longer stretches its pieces."""
        half = self.equations.number("", 0.0, self.n)
        half.c[:, 0, 0] = 0.5 * self.h
        ramp = NAMES.index("ramp")
        if ramp in self.case.moving:
            last = float(self.case.scenario.times[-1])
            on = edges[1:] <= last * (1 + 1e-12)
            half.c[on, 1 + self.case.moving.index(ramp), 0] = 0.5 * self.h[on] * self.case.radii[ramp] / last
        return Model(half.c, ROUNDING * np.abs(half.c).sum(axis=(1, 2)))

    def _approximation(self, c: Array) -> tuple[list[Model], Array]:
        """States as models without rest (polynomials by definition), and the gaps (n, size) at the pieces' begins.

        ``c`` (n, w, size, degree + 1): the polynomials of ``design.proof.trajectory``.
        """
        rows = np.concatenate([c[:, :1], 0.5 * (c[:, 1::2] - c[:, 2::2])], axis=1)
        models = []
        for j in range(self.size):
            part = blank(self.n, self.k)
            part[:] = rows[:, :, j]
            models.append(Model(part, np.zeros(self.n)))
        gap = np.zeros((self.n, self.size))
        for j, model in enumerate(models):
            begin, end = model.at(-1.0), model.at(1.0)
            size = np.abs(model.c).sum(axis=(1, 2))
            true = np.zeros(begin.shape[1])
            start = (self.case.scenario.theta0, self.case.scenario.omega0, 0.0, self.case.theta_d)[j]
            true[0] = start
            gap[0, j] = np.abs(begin[0] - true).sum() + ROUNDING * (size[0] + abs(start))
            gap[1:, j] = np.abs(begin[1:] - end[:-1]).sum(axis=1) + ROUNDING * (size[1:] + size[:-1])
        return models, UP * gap

    # ---- all together

    def bounds(self) -> Bounds:
        """The bounds in the tube; raises ``NotProved``, ``OutOfTime``."""
        return self._read(*self.closed())

    def closed(self) -> tuple[Array, Reach, Norms, End | None]:
        """Assume a reach, bound the tube, and enlarge the reach until the tube stays within it.

        The radii D of its blocks over each piece and after the end, the reach, the norms, and what is at the end.
        """
        end = self._end()
        places = [(self.x, self.parts), *([end] if end is not None else [])]
        cop = self.case.kind == "cop"
        pieces = self.n + (end is not None)
        assumed = Reach(*(np.full(pieces, part) for part in (1e-6, 1e-5, 1e-2)))
        its: Norms | None = None
        for _ in range(ROUNDS):
            its = norms(self.equations, places, self.defects, self.h, assumed, self.deadline, its)
            D = self._radius(its, end)
            reach = reach_of(self.case.felt, its, D)
            if not np.isfinite(D).all():
                break
            if reach.within(assumed, all_three=cop):
                return D, reach, its, end
            assumed = Reach(*(np.maximum(WIDER * new, old) for new, old in zip(reach, assumed, strict=True)))
            if assumed.theta.max() > 1.0:
                break
        message = "the tube grows beyond what can be assumed of it; take a smaller box"
        raise NotProved(message)

    def ranges(self) -> tuple[float, tuple[float, float]]:
        """The reach of theta [rad], and what the stiffness A L cos(theta - theta_f) lies in [N m], ever."""
        _, reach, _, end = self.closed()
        places = [self.parts, *([end.parts] if end is not None else [])]
        ends = [
            stiffness(parts, its.theta)
            for parts, its in zip(places, reach.parted([len(parts.tau.c) for parts in places]), strict=True)
        ]
        low, high = min(float(each[0].min()) for each in ends), max(float(each[1].max()) for each in ends)
        return float(reach.theta.max()), (low, high)

    def _end(self) -> End | None:
        """The constant approximation after the end; None where the force moves on."""
        scenario = self.case.scenario
        if goes_on(scenario):
            return None
        states = []
        for last in self.last:
            c = blank(1, self.k)
            c[0, :, 0] = last
            states.append(Model(c, np.zeros(1)))
        signal = scenario.signal[:, -1:]
        return End(states, self.equations.parts(states, self.equations.world(1, (signal, signal))))

    def _radius(self, its: Norms, end: End | None) -> Array:
        """D (n, m) of each block over each piece, and after the end (last, if it ever rests).

        Over a piece D' <= -rate D + coupling D + added/h. With U >= D on all of it, U = (1 - K)^-1 (D + pushed), and
        what a block comes to in the end by its own rate alone.
        """
        n, ramp = self.n, NAMES.index("ramp")
        stretch = self.case.radii[ramp] / float(self.case.scenario.times[-1]) if self.case.radii[ramp] > 0 else 0.0
        h = np.append(self.h, np.full(len(its.S) - n, np.inf))[:, None]
        shortest, longest = h * max(1 - stretch * UP, 1e-300) / UP, h * (1 + stretch) * UP
        defects, rates = self.defects, its.rates
        if end is not None:
            defects = np.vstack([defects, [[f.size()[0] for f in end.parts.flow]]])
        added = its.sizes(defects)
        added[:n] *= 2
        with np.errstate(invalid="ignore"):
            slow = np.where(np.isfinite(h), rates * shortest, 1.0)
        pushed = UP * np.where(np.isfinite(h), added * np.minimum(1.0, UP / slow), added / rates)
        lasting = UP * np.where(np.isfinite(h), added / slow, added / rates)  # what a constant defect leads to
        left = falls(np.where(np.isfinite(h), slow / UP, 800.0))
        gone = UP * np.where(np.isfinite(h), 1 - falls(np.minimum(rates * longest * UP, 800.0))[0], 1.0)
        rises = UP * np.where(np.isfinite(h), added * np.minimum((1 - left[0]) / slow * UP, 1.0), lasting)
        K = UP * np.minimum(longest, UP / rates)[:, :, None] * its.couplings
        inverse = settled(K)
        gaps, coming = its.sizes(np.vstack([self.gap, self.jump])[: len(its.S)]), np.zeros_like(added)
        coming[: n - 1] = gaps[1:n]  # a corner may come early by a sliver
        driven = UP * its.couplings / rates[:, :, None]
        D, now = np.zeros_like(added), np.zeros(self.size)
        for k in range(len(D)):
            now = (its.carried[k] @ now + gaps[k]) * UP
            most = inverse[k] @ (now + pushed[k]) * UP
            steady = driven[k] @ most
            most = np.minimum(most, np.maximum(now, steady + lasting[k]) * UP)
            D[k] = (most + coming[k]) * UP
            now = np.minimum(left[1][k] * now + gone[k] * steady + rises[k], most) * UP
        return D

    def _read(self, D: Array, reach: Reach, its: Norms, end: End | None) -> Bounds:
        within, *after = reach.parted([self.n] if end is None else [self.n, 1])
        low, high = quantities(self.equations, self.x, self.parts, within)
        t = self.edges[:-1]
        if end is not None:
            low_end, high_end = quantities(self.equations, *end, after[0])
            low = {id: np.append(low[id], low_end[id]) for id in low}
            high = {id: np.append(high[id], high_end[id]) for id in high}
            t = self.edges
        return Bounds(
            t=t, low=low, high=high, radius=float(D.max()), rate=float(its.rates.min()), influence=self.influence()
        )  # fmt: skip

    def influence(self) -> dict[int, float]:
        """By the number of each parameter that moves, the share that it moves of itself, of tau and of the load."""
        found, biped = {}, self.case.biped
        for i, k in enumerate(self.case.moving):
            share = self.case.radii[k] / getattr(biped, NAMES[k]) if NAMES[k] in NAMES[:5] else 0.0
            for model in (self.parts.tau, self.parts.load):
                size = np.abs(model.c).sum(axis=(1, 2)).max()  # of level ground the nominal tau is 0
                share += float(np.abs(model.c[:, 1 + i]).sum(axis=1).max() / max(size, 1e-300))
            found[k] = share
        return found
