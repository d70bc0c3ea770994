"""Contact for all times and every body of a box: a tube around an approximate trajectory that holds the true ones.

x̃(t, p) is any piecewise polynomial, here cubic in time through Runge-Kutta samples, linear in the parameters p of the
box. Its defect x̃' - f(x̃, t, p) is bounded by Taylor models (``design.proof.taylor``). In a norm in which the loop
contracts with a proved rate over the whole tube (``design.proof.norm``; Dahlquist 1958)

    |x - x̃|_P (t) <= D(t),    D' = -rate D + |defect|_P,    D(0) = |x(0) - x̃(0)|_P

The ranges of the Jacobian's numbers over the tube, on which the rate depends, are those of a tube of an assumed reach;
that D stays below it closes the argument, and for law (20), which divides by the load, keeps the load above 0. *After
the end*, where the force rests, the constant x̃(T) is an approximate trajectory for ever.

Assumptions: the foot stands (which the bounds on toe and heel force confirm), no slip, no delay, no noise. Numbers of
the body and world count with all that is within 1e-14 of them, what the law reckons with as the floats that they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design.model.closed_loop import closed_loop
from design.model.laws import swing
from design.proof.case import NAMES, Case, NotProved, goes_on, longer, pieces
from design.proof.equations import Equations, Parts
from design.proof.norm import norm
from design.proof.readout import Reach, quantities, reach_of
from design.proof.taylor import ROUNDING, UP, Model, blank
from design.proof.windows import Norms, norms

Array = NDArray[np.float64]

ROUNDS = 8
"""How often the assumed radius of the tube is enlarged."""
WIDER = 1.2
"""How much wider than the tube that came of it the next assumed one is."""
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


def bounds(case: Case) -> Bounds:
    """The bounds for ``case``; raises ``NotProved``."""
    try:
        tube = _Tube(case)
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


class _Tube:
    """The approximate trajectories as models, and what is computed of them."""

    def __init__(self, case: Case) -> None:
        self.case, self.k, self.size = longer(case), len(case.moving), case.size
        if goes_on(case.scenario) and case.radii[NAMES.index("ramp")] > 0:
            message = "the ramp may end sooner or later than the scenario; lengthen duration_s"
            raise NotProved(message)
        self.equations = Equations(self.case)
        self.edges, self.h, shares = pieces(self.case.scenario, case.step)
        self.n = len(self.h)
        self.x, self.gap = self._approximation()
        self.scale = self._time_scale()
        self.parts = self.equations.parts(self.x, self.equations.world(self.n, shares))

    # ---- the approximate trajectories

    def _time_scale(self) -> Model:
        """h(p)/2 of each piece: a ramp that takes longer stretches its pieces."""
        half = self.equations.number("", 0.0, self.n)
        half.c[:, 0, 0] = 0.5 * self.h
        ramp = NAMES.index("ramp")
        if ramp in self.case.moving:
            last = float(self.case.scenario.times[-1])
            on = self.edges[1:] <= last * (1 + 1e-12)
            half.c[on, 1 + self.case.moving.index(ramp), 0] = 0.5 * self.h[on] * self.case.radii[ramp] / last
        return Model(half.c, ROUNDING * np.abs(half.c).sum(axis=(1, 2)))

    def _approximation(self) -> tuple[list[Model], Array]:
        """States as models without rest (polynomials by definition), and the gaps (n, size) at the pieces' begins."""
        nominal = self._hermite({})
        c = [blank(self.n, self.k) for _ in range(self.size)]
        for j in range(self.size):
            c[j][:, 0, :4] = nominal[j]
        for i, k in enumerate(self.case.moving):
            moved = 0.5 * (self._hermite({k: 1.0}) - self._hermite({k: -1.0}))
            for j in range(self.size):
                c[j][:, 1 + i, :4] = moved[j]
        models = [Model(part, np.zeros(self.n)) for part in c]
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

    def _hermite(self, shares: dict[int, float]) -> Array:
        """Coefficients (size, n, 4) of the cubics through the samples of one body and world."""
        case = self.case
        biped, scenario = case.at(shares)
        known = case.believed if case.size > 3 or case.kind == "cop" else None
        loop = closed_loop(biped, case.kind, case.theta_d, case.adapt, known)
        edges, h = self.edges, self.h
        if scenario.times[-1] != case.scenario.times[-1]:  # another ramp: the same shares of it
            old, new = float(case.scenario.times[-1]), float(scenario.times[-1])
            edges = np.where(edges <= old * (1 + 1e-12), edges * (new / old), edges + (new - old))
            h = np.diff(edges)
        middle = edges[:-1] + 0.5 * h
        inside = scenario.signal_by
        forces = [scenario.to_force(inside(middle, at)) for at in (edges[:-1], middle, edges[1:])]
        u = np.vstack([h, *forces])
        K = ca.repmat(ca.DM(case.gains), 1, self.n)
        z0 = ca.DM(loop.start(scenario.theta0, scenario.omega0))
        after = loop.march(self.n)(z0, ca.DM(u), K).full()
        z = np.column_stack([z0.full(), after])
        rate = loop.rate.map(self.n)
        begin = rate(z[:, :-1], forces[0], K).full() * (0.5 * h)
        end = rate(z[:, 1:], forces[2], K).full() * (0.5 * h)
        if not (np.isfinite(z).all() and (np.abs(z[0]) < 1.5).all()):
            message = "the approximate trajectory is lost: the body leans too far, or the time step is too coarse"
            raise NotProved(message)
        a, b = z[:, :-1], z[:, 1:]
        cubic = [
            0.5 * (a + b) + 0.25 * (begin - end), 0.75 * (b - a) - 0.25 * (begin + end), 0.25 * (end - begin),
            0.25 * (a - b) + 0.25 * (begin + end),
        ]  # fmt: skip
        found = np.stack(cubic, axis=-1)[: self.size]
        if case.kind == "cop":
            found[2] *= float(case.gathering) / case.believed.ell
        if case.size > 3:  # from eta to theta_d
            found[3] -= swing(case.believed, case.adapt) * found[1]
        return found

    # ---- all together

    def bounds(self) -> Bounds:
        """Assume a reach, bound the tube, and enlarge the reach until the tube stays within it."""
        flow = self.parts.flow
        defects = np.stack([(x.slope() - self.scale * f).size() for x, f in zip(self.x, flow, strict=True)], axis=1)
        end = self._end()
        places = [(self.x, self.parts), *([end] if end is not None else [])]
        moved = np.stack([f.size() for f in flow], axis=1)
        gap = self.gap + SLIVER * (1 + self.edges[:-1, None]) * (moved + np.roll(moved, 1, axis=0))
        cop = self.case.kind == "cop"
        pieces = self.n + (end is not None)
        assumed = Reach(*(np.full(pieces, part) for part in (1e-6, 1e-5, 1e-2)))
        for _ in range(ROUNDS):
            its = norms(self.equations, places, defects, assumed)
            D = self._radius(its, defects, gap, end)
            reach = reach_of(self.case.felt, its.inverse, D)
            if not np.isfinite(D).all():
                break
            if reach.within(assumed, all_three=cop):
                return self._read(D, its, end)
            assumed = Reach(*(np.maximum(WIDER * new, old) for new, old in zip(reach, assumed, strict=True)))
            if assumed.theta.max() > 1.0:
                break
        message = "the tube grows beyond what can be assumed of it; take a smaller box"
        raise NotProved(message)

    def _end(self) -> End | None:
        """The constant approximation after the end; None where the force moves on."""
        scenario = self.case.scenario
        if goes_on(scenario):
            return None
        states = []
        for model in self.x:
            c = blank(1, self.k)
            c[0, :, 0] = model.at(1.0)[-1]
            states.append(Model(c, np.zeros(1)))
        signal = scenario.signal[:, -1:]
        return End(states, self.equations.parts(states, self.equations.world(1, (signal, signal))))

    def _radius(self, its: Norms, defects: Array, gap: Array, end: End | None) -> Array:
        """D over each piece, and after the end (last, if it ever rests)."""
        n, size = self.n, np.abs(its.P)
        h = self.h / UP
        ramp = NAMES.index("ramp")
        if self.case.radii[ramp] > 0:
            h = h * max(0.0, 1 - self.case.radii[ramp] / float(self.case.scenario.times[-1])) / UP
        added = 2 * norm(size[:n], defects)
        gaps = norm(size[:n], gap)
        shrink = (1.0 / (1.0 + its.rate[:n] * h)) * UP  # exp(-x) <= 1/(1 + x)
        coming = np.append(norm(size[: n - 1], gap[1:]), 0.0)  # a corner may come early by a sliver
        D = np.zeros(len(its.c))
        now = 0.0
        each = zip(*(part.tolist() for part in (its.c[:n], gaps, added, coming, shrink)), strict=True)
        for k, (factor, step, more, following, less) in enumerate(each):
            now = now * factor + step
            D[k] = (now + more + following) * UP
            now = min(now * less + more, D[k]) * UP
        if end is not None:
            drift = norm(size[n:], np.array([[f.size()[0] for f in end.parts.flow]]))[0] / its.rate[n]
            jump = norm(size[n:], np.array([[ROUNDING * model.size()[0] for model in end.states]]))[0]
            D[n] = UP * max(now * its.c[n] * UP + float(jump), float(drift))
        return D

    def _read(self, D: Array, its: Norms, end: End | None) -> Bounds:
        n = self.n
        low, high = quantities(self.equations, self.x, self.parts, D[:n], its.inverse[:n])
        t = self.edges[:-1]
        if end is not None:
            low_end, high_end = quantities(self.equations, *end, D[n:], its.inverse[n:])
            low = {id: np.append(low[id], low_end[id]) for id in low}
            high = {id: np.append(high[id], high_end[id]) for id in high}
            t = self.edges
        return Bounds(
            t=t, low=low, high=high, radius=float(D.max()), rate=float(its.rate.min()), influence=self.influence()
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
