"""Contact for all times and every body of a box: a tube around an approximate trajectory that holds the true ones.

x̃(t, p) is any piecewise polynomial, here cubic in time through Runge-Kutta samples, linear in the parameters p of the
box. Its defect x̃' - f(x̃, t, p) is bounded by Taylor models (``design.proof.taylor``). In a norm in which the loop
contracts with a proved rate over the whole tube (``design.proof.norm``; Dahlquist 1958)

    |x - x̃|_P (t) <= D(t),    D' = -rate D + |defect|_P,    D(0) = |x(0) - x̃(0)|_P

The range of G over the tube, on which the rate depends, is that of a tube of an assumed radius; that D stays below it
closes the argument. *After the end*, where the force rests, the constant x̃(T) is an approximate trajectory for ever.

Assumptions: the foot stands (which the bounds on toe and heel force confirm), no slip, no delay, no noise; laws pd and
(8). Numbers of the body and world count with all that is within 1e-14 of them, gains as the floats that they are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design.model.closed_loop import closed_loop
from design.proof.case import NAMES, Case, NotProved, goes_on, longer, pieces
from design.proof.norm import contracting, dual, inverted, norm
from design.proof.taylor import ROUNDING, TINY, UP, Model, blank, constant, reciprocal, sine_and_cosine

Array = NDArray[np.float64]

ROUNDS = 8
"""How often the assumed radius of the tube is enlarged."""
SLIVER = 1e-15
"""By what part of the time, or of 1 s, a corner may lie off the float it is read as."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Bounds:
    """What holds over the box in pieces of time, and after the end (last).

    ``low``, ``high`` (n + 1,) of each quantity: ``toe-force``, ``heel-force``, ``load`` [N], ``torque`` (its size)
    [N m], ``cop-margin`` [m]. ``t`` (n + 1,): where the pieces begin [s], for the ramp of the middle. ``radius``: the
    tube's largest; ``rate`` [1/s]. ``influence``: by the number of each parameter that moves, how much it moves
    theta''.
    """

    t: Array
    low: dict[str, Array]
    high: dict[str, Array]
    radius: float
    rate: float
    influence: dict[int, float]


def bounds(case: Case) -> Bounds:
    """The bounds for ``case``; raises ``NotProved``."""
    if case.kind == "cop":
        message = "law cop divides by the measured load; its tube is not built"
        raise NotProved(message)
    try:
        return _Tube(case).bounds()
    except ValueError as error:
        raise NotProved(str(error)) from error


@dataclass(frozen=True, eq=False, kw_only=True)
class World:
    """F_x, M g - F_y and M g [N] as models, and the slope [rad] where it is one."""

    x: Model
    down: Model
    weight: Model
    slope: Model | None

    def moments(self, theta: Model, sine: Model, cosine: Model) -> tuple[Model, Model]:
        """A sin(theta - theta_f) and A cos(theta - theta_f) [N]."""
        if self.slope is None:
            return self.down * sine + self.x * cosine, self.down * cosine - self.x * sine
        across, along = sine_and_cosine(theta + self.slope)  # one small angle instead of two large ones
        return self.weight * across, self.weight * along


class Parts(NamedTuple):
    """What the equations are made of: tau, theta'', sin theta, cos theta, A L sin and A L cos of (theta - theta_f)."""

    tau: Model
    turning: Model
    sine: Model
    cosine: Model
    moment: Model
    stiffness: Model


class End(NamedTuple):
    """The constant approximation after the end: states, their flow, which is its defect, parts, and the world."""

    states: list[Model]
    flow: list[Model]
    parts: Parts
    world: World


class _Tube:
    """The approximate trajectories as models, and what is computed of them."""

    def __init__(self, case: Case) -> None:
        self.case, self.k = longer(case), len(case.moving)
        self.size = 2 if case.kind == "pd" else 3
        if goes_on(case.scenario) and case.radii[NAMES.index("ramp")] > 0:
            message = "the ramp may end sooner or later than the scenario; lengthen duration_s"
            raise NotProved(message)
        self.edges, self.h, shares = pieces(self.case.scenario, case.step)
        self.n = len(self.h)
        self._body()
        self.x, self.gap = self._approximation()
        self.scale = self._time_scale()
        self.world = self._force(self.n, shares)

    # ---- what the parameters do

    def _number(self, name: str, value: float, n: int) -> Model:
        parts = [self.case.radii[k] if NAMES[k] == name else 0.0 for k in self.case.moving]
        return constant(n, self.k, value, ROUNDING * abs(value), parts)

    def _inverse(self, name: str, value: float, n: int) -> Model:
        radius = self.case.radii[NAMES.index(name)]
        a, b, r = reciprocal(value, radius)
        parts = [b if NAMES[k] == name else 0.0 for k in self.case.moving]
        return constant(n, self.k, a, r + ROUNDING * a, parts)

    def _body(self) -> None:
        biped, radii = self.case.biped, self.case.radii
        for name in NAMES[:5]:
            if getattr(biped, name) <= radii[NAMES.index(name)] and not (name == "m" and biped.m == radii[3] == 0):
                message = f"the box holds bodies without {name}"
                raise NotProved(message)

    def _numbers(self, n: int) -> dict[str, Model]:
        biped = self.case.biped
        found = {name: self._number(name, getattr(biped, name), n) for name in NAMES[:5]}
        found["1/I"], found["1/ell"] = self._inverse("I", biped.I, n), self._inverse("ell", biped.ell, n)
        found["g"] = constant(n, self.k, biped.g, ROUNDING * biped.g)
        return found

    def _time_scale(self) -> Model:
        """h(p)/2 of each piece: a ramp that takes longer stretches its pieces."""
        half = self._number("", 0.0, self.n)
        half.c[:, 0, 0] = 0.5 * self.h
        ramp = NAMES.index("ramp")
        if ramp in self.case.moving:
            last = float(self.case.scenario.times[-1])
            on = self.edges[1:] <= last * (1 + 1e-12)
            half.c[on, 1 + self.case.moving.index(ramp), 0] = 0.5 * self.h[on] * self.case.radii[ramp] / last
        return Model(half.c, ROUNDING * np.abs(half.c).sum(axis=(1, 2)))

    def _force(self, n: int, ends: tuple[Array, Array]) -> World:
        """The world in each piece, from the signal at its ends (each (j, n))."""
        kind, p = self.case.scenario.kind, self._numbers(n)
        signals = []
        for first, last in zip(*ends, strict=True):
            c = blank(n, self.k)
            c[:, 0, 0], c[:, 0, 1] = 0.5 * (first + last), 0.5 * (last - first)
            slope = NAMES.index("slope")
            if kind == "slope" and slope in self.case.moving:
                at, final = 1 + self.case.moving.index(slope), float(self.case.scenario.signal[0, -1])
                share = c[:, 0, :2] / final if final else np.array([1.0, 0.0])
                c[:, at, :2] = share * self.case.radii[slope]
            size = np.abs(c).sum(axis=(1, 2)).max()
            signals.append(Model(c, np.full(n, ROUNDING * size + TINY)))
        weight = p["M"] * p["g"]
        if kind == "slope":
            sine, cosine = sine_and_cosine(signals[0])
            return World(x=weight * sine, down=weight * cosine, weight=weight, slope=signals[0])
        if kind == "platform":
            return World(x=-(p["M"] * signals[0]), down=weight, weight=weight, slope=None)
        return World(x=signals[0], down=weight - signals[1], weight=weight, slope=None)

    # ---- the approximate trajectories

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
            start = (self.case.scenario.theta0, self.case.scenario.omega0, 0.0)[j]
            true[0] = start
            gap[0, j] = np.abs(begin[0] - true).sum() + ROUNDING * (size[0] + abs(start))
            gap[1:, j] = np.abs(begin[1:] - end[:-1]).sum(axis=1) + ROUNDING * (size[1:] + size[:-1])
        return models, UP * gap

    def _hermite(self, shares: dict[int, float]) -> Array:
        """Coefficients (size, n, 4) of the cubics through the samples of one body and world."""
        case = self.case
        biped, scenario = case.at(shares)
        loop = closed_loop(biped, case.kind, case.theta_d)
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
            message = "the body falls"
            raise NotProved(message)
        a, b = z[:, :-1], z[:, 1:]
        cubic = [
            0.5 * (a + b) + 0.25 * (begin - end), 0.75 * (b - a) - 0.25 * (begin + end), 0.25 * (end - begin),
            0.25 * (a - b) + 0.25 * (begin + end),
        ]  # fmt: skip
        return np.stack(cubic, axis=-1)[: self.size]

    # ---- the equations

    def _torque(self, x: list[Model]) -> Model:
        K = self.case.gains
        tau = x[0] * -K.K_p + x[1] * -K.K_d + K.K_p * self.case.theta_d
        return tau + x[2] * K.K_f if self.size == 3 else tau

    def _flow(self, x: list[Model], world: World) -> tuple[list[Model], Parts]:
        p = self._numbers(len(x[0].c))
        sine, cosine = sine_and_cosine(x[0])
        tau = self._torque(x)
        moment, stiffness = (p["L"] * each for each in world.moments(x[0], sine, cosine))
        turning = p["1/I"] * (moment + tau)
        found = [x[1], turning]
        flow = found if self.size == 2 else [*found, p["1/ell"] * tau]
        return flow, Parts(tau, turning, sine, cosine, moment, stiffness)

    # ---- the norm

    # ---- all together

    def bounds(self) -> Bounds:
        """Assume a radius, bound the tube, and enlarge the radius until the tube stays within it."""
        flow, parts = self._flow(self.x, self.world)
        defects = np.stack([(x.slope() - self.scale * f).size() for x, f in zip(self.x, flow, strict=True)], axis=1)
        end = self._end()
        moved = np.stack([f.size() for f in flow], axis=1)
        gap = self.gap + SLIVER * (1 + self.edges[:-1, None]) * (moved + np.roll(moved, 1, axis=0))
        assumed = 1e-6  # in theta [rad]
        for _ in range(ROUNDS):
            G = self._stiffness(parts, end, assumed)
            P, rate = contracting(self.case, G, defects.max(axis=0))
            inverse = inverted(P)
            D, tail = self._radius(P, rate, defects, gap, end)
            widest = max(float(D.max()), tail)
            reach = UP * math.sqrt(inverse[0, 0]) * widest
            if not math.isfinite(widest):
                break
            if reach <= assumed:
                return self._read(parts, D, tail, end, inverse, rate)
            assumed = 1.5 * reach
            if assumed > 1.0:
                break
        message = "the tube grows beyond what can be assumed of it; take a smaller box"
        raise NotProved(message)

    def _end(self) -> End | None:
        """The constant approximation after the end, its flow (the defect), and parts; None where the force moves on."""
        scenario = self.case.scenario
        if goes_on(scenario):
            return None
        states = []
        for model in self.x:
            c = blank(1, self.k)
            c[0, :, 0] = model.at(1.0)[-1]
            states.append(Model(c, np.zeros(1)))
        signal = scenario.signal[:, -1:]
        world = self._force(1, (signal, signal))
        flow, parts = self._flow(states, world)
        return End(states, flow, parts, world)

    def _stiffness(self, parts: Parts, end: End | None, assumed: float) -> tuple[float, float]:
        """The range of G over the tube: theta within ``assumed`` [rad] of the approximation."""
        low, high = math.inf, -math.inf
        for each in (parts, end.parts) if end is not None else (parts,):
            bottom, top = each.stiffness.bounds()
            # A L cos changes by at most |A L sin| a + A L a²/2
            size = np.hypot(each.moment.size(), each.stiffness.size()) * UP
            widen = UP * (each.moment.size() * assumed + size * assumed**2)
            low, high = min(low, float((bottom - widen).min())), max(high, float((top + widen).max()))
        return math.nextafter(low, -math.inf), math.nextafter(high, math.inf)

    def _radius(self, P: Array, rate: float, defects: Array, gap: Array, end: End | None) -> tuple[Array, float]:
        """D (n,) over each piece, and after the end."""
        size = np.abs(P)
        h = self.h / UP
        ramp = NAMES.index("ramp")
        if self.case.radii[ramp] > 0:
            h = h * max(0.0, 1 - self.case.radii[ramp] / float(self.case.scenario.times[-1])) / UP
        added = 2 * norm(size, defects)
        gaps = norm(size, gap)
        shrink = (1.0 / (1.0 + rate * h)) * UP  # exp(-x) <= 1/(1 + x)
        D = np.zeros(self.n)
        now = 0.0
        coming = np.append(gaps[1:], 0.0).tolist()  # a corner may come early by a sliver
        each = zip(gaps.tolist(), added.tolist(), coming, shrink.tolist(), strict=True)
        for k, (step, more, following, factor) in enumerate(each):
            D[k] = (now + step + more + following) * UP
            now = min((now + step) * factor + more, D[k]) * UP
        if end is None:
            return D, 0.0
        drift = np.array([[f.size()[0] for f in end.flow]])
        jump = np.array([[ROUNDING * model.size()[0] for model in end.states]])
        return D, UP * max(now + float(norm(size, jump)[0]), float(norm(size, drift)[0]) / rate)

    def _read(self, parts: Parts, D: Array, tail: float, end: End | None, inverse: Array, rate: float) -> Bounds:
        low, high = self._quantities(self.x, parts, self.world, D, inverse)
        t = self.edges[:-1]
        if end is not None:
            low_end, high_end = self._quantities(end.states, end.parts, end.world, np.array([tail]), inverse)
            low = {id: np.append(low[id], low_end[id]) for id in low}
            high = {id: np.append(high[id], high_end[id]) for id in high}
            t = self.edges
        moved = {k: float(np.abs(parts.turning.c[:, 1 + i]).sum(axis=1).max()) for i, k in enumerate(self.case.moving)}
        return Bounds(t=t, low=low, high=high, radius=max(float(D.max()), tail), rate=rate, influence=moved)

    def _quantities(
        self, x: list[Model], parts: Parts, world: World, D: Array, inverse: Array
    ) -> tuple[dict[str, Array], dict[str, Array]]:
        """Lower and upper bounds over pieces, the tube's radius included."""
        n = len(D)
        p, K = self._numbers(n), self.case.gains
        tau, turning, sine, cosine = parts[:4]
        ML = p["M"] * p["L"]
        load = p["m"] * p["g"] + world.down - ML * (turning * sine + x[1] * x[1] * cosine)  # F_T + F_H, (5)-(7)
        lever = p["1/ell"] * tau
        toe, heel = (load - lever) * 0.5, (load + lever) * 0.5
        # how fast they change with the state, anywhere in the tube
        reach = UP * np.sqrt(np.diag(inverse))[:, None] * D
        S = np.minimum(sine.size() + reach[0], 1.0)
        W = x[1].size() + reach[1]
        pull = np.hypot(parts.moment.size(), parts.stiffness.size()) * UP
        inertia = p["1/I"].size()
        steepest = [pull + K.K_p, np.full(n, K.K_d), np.full(n, K.K_f)][: self.size]
        far = sum(part * move for part, move in zip(steepest, reach, strict=True))
        T = turning.size() + inertia * far * UP
        ML_size, short = ML.size(), p["1/ell"].size()
        of_load = [ML_size * (inertia * part * S) for part in steepest]
        of_load[0] = of_load[0] + ML_size * (T + W * W)
        of_load[1] = of_load[1] + ML_size * 2 * W
        of_torque = [K.K_p, K.K_d, K.K_f][: self.size]
        of_force = [0.5 * (a + short * b) for a, b in zip(of_load, of_torque, strict=True)]
        slack_force = UP * dual(inverse, of_force, n) * D
        slack_load = UP * dual(inverse, of_load, n) * D
        slack_torque = UP * dual(inverse, of_torque, n) * D
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
        ell, radius = self.case.biped.ell, self.case.radii[4]
        low["cop-margin"], high["cop-margin"] = (ell - radius) / UP - away, (ell + radius) * UP - near
        size = np.maximum(np.abs(low["torque"]), np.abs(high["torque"]))
        low["torque"], high["torque"] = least, size
        return low, high
