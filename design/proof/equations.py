"""The equations (1)-(12), (18) and (20) of a loop, written with Taylor models over the bodies and worlds of a box."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.proof.case import NAMES, Case, NotProved
from design.proof.taylor import ROUNDING, TINY, Model, blank, constant, inverse, reciprocal, sine_and_cosine

Array = NDArray[np.float64]


class World(NamedTuple):
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
    """What the equations are made of: tau, theta'', sin theta, cos theta, A L sin and A L cos of (theta - theta_f).

    ``load`` is F_T + F_H [N]; ``flow`` how fast each state changes.
    """

    tau: Model
    turning: Model
    sine: Model
    cosine: Model
    moment: Model
    stiffness: Model
    load: Model
    flow: list[Model]


class Equations:
    """The equations over one box; states as in ``Case.size``."""

    def __init__(self, case: Case) -> None:
        self.case, self.k = case, len(case.moving)
        biped, radii = case.biped, case.radii
        for name in NAMES[:5]:
            if getattr(biped, name) <= radii[NAMES.index(name)] and not (name == "m" and biped.m == radii[3] == 0):
                message = f"the box holds bodies without {name}"
                raise NotProved(message)

    def number(self, name: str, value: float, n: int) -> Model:
        """``value`` in n pieces, as it goes with the parameter called ``name``."""
        parts = [self.case.radii[k] if NAMES[k] == name else 0.0 for k in self.case.moving]
        return constant(n, self.k, value, ROUNDING * abs(value), parts)

    def _per(self, name: str, value: float, n: int) -> Model:
        a, b, r = reciprocal(value, self.case.radii[NAMES.index(name)])
        parts = [b if NAMES[k] == name else 0.0 for k in self.case.moving]
        return constant(n, self.k, a, r + ROUNDING * a, parts)

    def numbers(self, n: int) -> dict[str, Model]:
        """M, L, I, m, ell, g, 1/I and 1/ell in n pieces."""
        biped = self.case.biped
        found = {name: self.number(name, getattr(biped, name), n) for name in NAMES[:5]}
        found["1/I"], found["1/ell"] = self._per("I", biped.I, n), self._per("ell", biped.ell, n)
        found["g"] = constant(n, self.k, biped.g, ROUNDING * biped.g)
        return found

    def world(self, n: int, ends: tuple[Array, Array]) -> World:
        """The world in each piece, from the signal at its ends (each (j, n))."""
        kind, p = self.case.scenario.kind, self.numbers(n)
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

    def _torque(self, x: list[Model]) -> Model:
        K, n, theta_d = self.case.gains, len(x[0].c), self.case.theta_d
        desired = x[3] if len(x) > 3 else constant(n, self.k, theta_d, ROUNDING * abs(theta_d))
        tau = (desired - x[0]) * K.K_p + x[1] * -K.K_d
        return tau + x[2] * K.K_f if len(x) > 2 else tau

    def parts(self, x: list[Model], world: World) -> Parts:
        """What the states ``x`` lead to; raises ``NotProved`` where a law that divides by the load may find none."""
        p = self.numbers(len(x[0].c))
        sine, cosine = sine_and_cosine(x[0])
        tau = self._torque(x)
        moment, stiffness = (p["L"] * each for each in world.moments(x[0], sine, cosine))
        turning = p["1/I"] * (moment + tau)
        foot = p["m"] * p["g"]
        if self.case.biped.ground_loads and world.slope is not None:
            foot = foot * sine_and_cosine(world.slope)[1]
        load = foot + world.down - p["M"] * p["L"] * (turning * sine + x[1] * x[1] * cosine)  # (5)-(7)
        flow = [x[1], turning]
        if self.case.kind == "cop":  # (18), (20): s' = -P
            if not (load.bounds()[0] > 0).all():
                message = "toe and heel together may bear nothing, and law cop divides by what they bear"
                raise NotProved(message)
            flow.append(inverse(load) * (p["1/ell"] * tau * float(self.case.gathering)))
        elif len(x) > 2:
            flow.append(p["1/ell"] * tau)  # (11)
        if len(x) > 3:
            a, swing, lever = (float(part) for part in self.case.following)
            flow.append((x[0] - x[3]) * a + p["1/ell"] * tau * lever - turning * swing)
        return Parts(tau, turning, sine, cosine, moment, stiffness, load, flow)
