"""When trials come nearer to the stationary posture: how much of an error in the start is left after a trial.

A trial starts at rest in the posture theta_d with the integral of (14), which is 0 there, and its end, read by
(16)-(17), gives by (15) the next theta_d: (16) and (17) put into (15) leave theta_d = theta(T), whatever the masses in
them. So in a world that stays, e = theta_d - theta_f goes to theta(T) - theta_f. About the stationary posture, with
w = K_f s,

    e_next = rho(T) e + O(e²),   rho(T) = [1 0 0] expm(B T) (1, 0, K_p)',
    B = [[0, 1, 0], [(A L - K_p)/I, -K_d/I, 1/I], [-g K_p, -g K_d, g]],   g = K_f/ell (11)

((23) with w for s; for law cop g is (M + m) g/(F_T + F_H) times as large, for pd 0.) The start (e, 0, 0) is not the
stationary state, which is why (1, 0, K_p) and not (1, 0, 0) is carried on. Trials contract if and only if
|rho(T)| < 1. A law that adapts has a fourth state, and ends without an integral: there (1, 0, 0, 1) is carried on, by
(23). rho(0) = 1 and rho''(0) = A L/I > 0: too short a trial carries away from the posture. For pd rho tends to
K_p/(K_p - A L) > 1: pd control never contracts.

From noisy sensors theta_d is a mean over the last ``WINDOW`` of a trial, and what is left is no more than the largest
|rho| there, which is then what is given.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from design.analysis.estimate import WINDOW
from design.analysis.leftover import factor, factors, iteration, stays_below
from design.analysis.simulate import simulate
from design.analysis.survival import slope_limit
from design.model.body import Biped
from design.model.deciding import bearing
from design.model.environment import Scenario, constant_force
from design.model.laws import Gains, LawKind
from design.spec.setting import Setting

Array = NDArray[np.float64]

LEVELS = (1.0, 0.1)
SAMPLES = 32
"""Bodies and worlds within the box of [uncertainty], besides its corners (additive recurrence, Roberts 2018)."""
CHECKED = 6
"""Points of the box at which the iteration is simulated."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Point:
    """A body in an environment: A (3) and ``load`` = F_T + F_H at rest [N]; ``where`` in the box it lies."""

    scenario: str
    where: str
    biped: Biped
    gains: Gains
    A: float
    load: float
    duration: float


@dataclass(frozen=True, kw_only=True)
class Check:
    """The iteration simulated at ``points`` of the box from an error of ``start`` [rad], ``runs`` trials in all.

    ``ratio``: the largest |e_next/e|, each over one trial; ``off``: its largest distance from rho(T).
    """

    points: int
    runs: int
    start: float
    ratio: float
    off: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Contraction:
    """The largest |rho| of the ``points`` at the length of their trials, where it is, and how it depends on T.

    ``limit``: what the factor tends to without an integral, if it does. ``below_from``: for each level the shortest T
    [s] from which |rho(T)| stays below it at all points, None if never.
    """

    kind: LawKind
    factor: float
    at: Point
    points: int
    corners: int
    samples: int
    below_from: dict[float, float | None]
    limit: float | None
    check: Check

    @property
    def contracts(self) -> bool:
        """Whether every trial of the box leaves less of an error than there was, by rho and by simulation."""
        return self.factor < 1 and self.check.ratio < 1


def contraction(setting: Setting, gains: Gains, scenarios: Sequence[Scenario]) -> Contraction:
    """The largest rho over all environments of ``scenarios`` and all of the spec's [uncertainty]: corners and more."""
    points, corners, samples = box(setting, gains, scenarios)
    kind = setting.law
    B, start = _stacked(points, kind, setting.adapt, setting.biped)
    T = np.array([point.duration for point in points])
    mean = 0.0 if setting.sensors.exact else WINDOW
    found = np.zeros(len(points))
    for back in np.linspace(0.0, mean, 11 if mean else 1):
        with np.errstate(all="ignore"):  # what grows without bound counts as infinite
            part = np.abs(factors(B, start, np.maximum(T - back, 0.0)))
        found = np.maximum(found, np.where(np.isfinite(part), part, np.inf))
    worst = int(np.argmax(found))
    lengths = {level: stays_below(B, start, level) for level in LEVELS}
    shortest = {level: None if length is None else length + mean for level, length in lengths.items()}
    steady = points[worst]
    stiff = steady.gains.K_p - steady.A * steady.biped.L
    return Contraction(
        kind=kind,
        factor=float(found[worst]),
        at=steady,
        points=len(points),
        corners=corners,
        samples=samples,
        below_from=shortest,
        limit=steady.gains.K_p / stiff if (kind == "pd" or steady.gains.K_f == 0) and stiff > 0 else None,
        check=_checked(setting, points, found, lengths[LEVELS[-1]]),
    )


def box(setting: Setting, gains: Gains, scenarios: Sequence[Scenario]) -> tuple[list[Point], int, int]:
    """All points, and the numbers of corners and of drawn bodies and worlds that they come from."""
    tolerances, nominal = setting.tolerances, setting.biped
    names = ("M", "L", "I", "m", "ell", "slope", "ramp")
    spread = [k for k, name in enumerate(names) if getattr(tolerances, name) != type(tolerances.M)()]
    shares: list[tuple[str, Array]] = [("nominal", np.zeros(7))]
    if spread:
        corners = [np.array(signs) for signs in product((-1.0, 1.0), repeat=len(spread))]
        golden = float(np.roots([1.0, *[0.0] * (len(spread) - 1), -1.0, -1.0]).real.max())  # x^(n+1) = x + 1
        steps = golden ** -np.arange(1.0, len(spread) + 1)
        drawn = 2.0 * np.mod(0.5 + np.outer(np.arange(1, SAMPLES + 1), steps), 1.0) - 1.0
        for where, every in (("corner", corners), ("inside", drawn)):
            for part in every:
                one = np.zeros(7)
                one[spread] = part
                shares.append((where, one))
    points: list[Point] = []
    for scenario in scenarios:
        for where, share in shares:
            biped, real = tolerances.drawn(nominal, scenario, share.tolist())
            A, load = real.operating_points(biped)
            load = bearing(load)
            pairs = zip(A, load if setting.law == "cop" else np.full_like(load, load[-1]), strict=True)
            points += [
                Point(
                    scenario=scenario.name, where=where, biped=biped, gains=true_gains(setting, gains, biped), A=a,
                    load=n, duration=real.duration,
                )
                for a, n in sorted({(round(float(a), 9), round(float(n), 9)) for a, n in pairs})
            ]  # fmt: skip
    return points, 2 ** len(spread) if spread else 0, SAMPLES if spread else 0


def true_gains(setting: Setting, gains: Gains, real: Biped) -> Gains:
    """The gains with which the ``real`` body's loop is what the nominal body's law makes of it.

    K_F = K_f (M + m) g/ell of law cop, and its P, are computed with the nominal numbers.
    """
    return gains._replace(K_f=gains.K_f * setting.biped.weight / real.weight) if setting.law == "cop" else gains


def _stacked(points: Sequence[Point], kind: LawKind, adapt: float, known: Biped) -> tuple[Array, Array]:
    both = [iteration(point.biped, kind, point.gains, point.A, point.load, adapt, known) for point in points]
    return np.array([B for B, _ in both]), np.array([start for _, start in both])


def _checked(setting: Setting, points: Sequence[Point], found: Array, brief: float | None) -> Check:
    """The nonlinear iteration at the worst point and at others spread over the box.

    One trial of the full length, and three in a row of the length after which rho is still 0.1 somewhere, since what is
    left after a long one is too small to measure a ratio of.
    """
    chosen = {int(np.argmax(found)), *np.linspace(0, len(points) - 1, CHECKED).astype(int).tolist()}
    ratio = off = 0.0
    runs, start = 0, math.inf
    for number, k in enumerate(sorted(chosen)):
        point = points[k]
        size = min(math.radians(2.0), 0.25 * slope_limit(point.biped))
        start = min(start, size)
        e = size if number % 2 == 0 else -size
        plans = [(point.duration, 1)] + ([(min(brief, point.duration), 3)] if brief is not None else [])
        for T, times in plans:
            with np.errstate(all="ignore"):
                rho = factor(
                    point.biped, setting.law, point.gains, point.A, point.load, T, setting.adapt, setting.biped
                )
            for measured in ratios(setting, point, e, T, times):
                runs += 1
                ratio, off = max(ratio, abs(measured)), max(off, abs(measured - rho))
    return Check(points=len(chosen), runs=runs, start=start, ratio=ratio, off=off)


def ratios(setting: Setting, point: Point, e: float, T: float, times: int) -> list[float]:
    """e_next/e of ``times`` simulated trials of ``T`` [s] in a row in the environment of ``point``."""
    biped = point.biped
    F_y = biped.weight - point.load
    down = biped.M * biped.g - F_y
    F_x = -math.sqrt(max(point.A**2 - down**2, 0.0))
    theta_f = math.atan2(-F_x, down)
    world = constant_force(name="stays", F_x=F_x, F_y=F_y, ramp=0.0, duration=T)
    found = []
    for _ in range(times):
        theta_d = theta_f + e
        known = setting.biped if math.isfinite(setting.adapt) else None
        loop = replace(setting, biped=biped, known=known, theta_d=theta_d).loop()
        run = simulate(loop, replace(world, theta0=theta_d), point.gains, setting.step)
        e_next = math.inf if run.fallen is not None else float(run.theta[-1]) - theta_f
        found.append(e_next / e)
        e = e_next
        if not abs(e) < 0.5 or abs(e) < 1e-9:
            break
    return found
