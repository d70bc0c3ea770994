"""How much gain, phase and delay the linear loop bears: from polynomials, without a frequency grid.

The loop is broken at the actuator and at the measurements (``design.model.broken_loop``): P(s) + Q(s) = 0, L = Q/P.

With the foot on the ground F_H - F_T = tau/ell (11), so that the law's own integral is an unstable filter inside the
loop; a Nyquist count must know it, and these formulas do: the nominal loop is stable, and each margin is the smallest
change that puts a root on the imaginary axis. Crossings are the positive real roots of polynomials in omega².

Sources: gain, phase and modulus margin as usual; disk margin in the form of S - T (Seiler, Packard and Gahinet, IEEE
Control Systems 40, 2020): alpha = 1/max |(S - T)/2|; delay margin by direct frequency sweeping made finite (Walton and
Marshall, IEE Proc. D 134, 1987).
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial.polynomial import polyroots
from numpy.typing import NDArray

from design.model.body import Biped
from design.model.broken_loop import Break, breaks
from design.model.laws import Gains, LawKind
from design.model.polynomials import derivative, parts, positive_roots, square, total, value_at

Array = NDArray[np.float64]

IDS = (
    "gain-margin-up", "gain-margin-down", "phase-margin", "delay-margin", "force-delay-margin", "angle-delay-margin",
    "disk-margin",
)  # fmt: skip
"""Ids of the margins that have pieces."""


@dataclass(frozen=True, kw_only=True)
class LoopMargins:
    """Margins at the actuator, and delays elsewhere; infinite where no change of that kind destabilises.

    ``gain_up`` > 1 and ``gain_down`` < 1 are factors of the loop gain; ``phase`` [rad] in either direction; ``modulus``
    the least |1 + L|; ``disk`` alpha and its frequency ``disk_at`` [rad/s]; delays [s].
    """

    gain_up: float
    gain_down: float
    phase: float
    modulus: float
    disk: float
    disk_at: float
    delay: float
    force_delay: float
    angle_delay: float


def loop_margins(
    biped: Biped, kind: LawKind, K: Gains, A: float, load: float, adapt: float = math.inf, beta: float = 0.0
) -> LoopMargins:
    """All margins of a loop that is stable; raises ``ValueError`` for one that is not."""
    found = margin_pieces(biped, kind, K, A, load, adapt, beta)
    P, Q = breaks(biped, kind, K, A, load, adapt, beta)["actuator"].coefficients
    peak, _ = _peak(P, total(P, Q))
    disk_at, disk = min(found["disk-margin"], key=lambda pair: pair[1])

    def least(id: str) -> float:
        return min((value for _, value in found[id]), default=math.inf)

    return LoopMargins(
        gain_up=least("gain-margin-up"),
        gain_down=max((value for _, value in found["gain-margin-down"]), default=0.0),
        phase=least("phase-margin"),
        modulus=1.0 / peak,
        disk=disk,
        disk_at=disk_at,
        delay=least("delay-margin"),
        force_delay=least("force-delay-margin"),
        angle_delay=least("angle-delay-margin"),
    )


def margin_pieces(
    biped: Biped,
    kind: LawKind,
    K: Gains,
    A: float,
    load: float,
    adapt: float = math.inf,
    beta: float = 0.0,
    ids: Collection[str] = IDS,
) -> dict[str, list[tuple[float, float]]]:
    """What each margin of ``ids`` is the worst of, by row id: (frequency [rad/s], value), each smooth in the gains.

    One for every crossing of unit gain or of the negative axis, and every peak of |S - T|. Phases in rad. Raises
    ``ValueError`` for a loop that is not stable.
    """
    broken = breaks(biped, kind, K, A, load, adapt, beta)
    P, Q = broken["actuator"].coefficients
    whole = total(P, Q)
    if polyroots(whole).real.max() >= 0:
        message = "the loop is not stable; it has no margins"
        raise ValueError(message)

    @cache
    def factors() -> list[tuple[float, float]]:
        return _critical_gains(P, Q)

    def delays(where: str) -> list[tuple[float, float]]:
        if where not in broken:
            return []
        P, Q = broken[where].coefficients
        return [(w, _lag(P, Q, w) / w) for w in _unit_gain(P, Q)]

    rows: dict[str, Callable[[], list[tuple[float, float]]]] = {
        "gain-margin-up": lambda: [(w, k) for w, k in factors() if k > 1],
        "gain-margin-down": lambda: [(w, k) for w, k in factors() if 0 < k < 1],
        "phase-margin": lambda: [(w, abs(_wrapped(_lag(P, Q, w)))) for w in _unit_gain(P, Q)],
        "delay-margin": lambda: delays("actuator"),
        "force-delay-margin": lambda: delays("force"),
        "angle-delay-margin": lambda: delays("angle"),
        "disk-margin": lambda: [(w, 1.0 / peak) for w, peak in _peaks(0.5 * total(P, -Q), whole) if peak > 0],
    }
    return {id: rows[id]() for id in ids}


def near_crossings(broken: Break, reach: float = 0.5) -> list[tuple[float, float, float]]:
    """Where unit gain is nearly crossed: frequency [rad/s], lag to -1 there [rad], and gap of |Q/P| from 1.

    Stationary points of |Q/P| up to ``reach`` from 1. The gap is positive for a maximum below 1 or a minimum above it;
    when it closes, two crossings appear, and phase and delay margins jump.
    """
    P, Q = broken.coefficients
    a, b = square(Q), square(P)
    slope = total(np.convolve(derivative(a), b), -np.convolve(a, derivative(b)))
    found = []
    for w in positive_roots(slope):
        size = math.sqrt(value_at(a, w) / value_at(b, w))
        least = value_at(derivative(slope), w) > 0
        gap = size - 1.0 if least else 1.0 - size
        if abs(gap) <= reach:
            found.append((math.sqrt(w), _lag(P, Q, math.sqrt(w)), gap))
    return found


def delay_margin(broken: Break) -> float:
    """The smallest T > 0 at which P + Q exp(-s T) has a root on the imaginary axis [s]."""
    P, Q = broken.coefficients
    return min((_lag(P, Q, w) / w for w in _unit_gain(P, Q)), default=math.inf)


def _unit_gain(P: Array, Q: Array) -> list[float]:
    """Frequencies at which |Q/P| = 1 [rad/s]."""
    return [math.sqrt(w) for w in positive_roots(total(square(Q), -square(P)))]


def _lag(P: Array, Q: Array, omega: float) -> float:
    """The phase lag in (0, 2 pi] that brings Q/P to -1 at ``omega``."""
    ratio = value_at(Q, 1j * omega) / value_at(P, 1j * omega)
    lag = cmath.phase(-ratio) % (2 * math.pi)
    return lag if lag > 0 else 2 * math.pi


def _wrapped(angle: float) -> float:
    return (angle + math.pi) % (2 * math.pi) - math.pi


def _critical_gains(P: Array, Q: Array) -> list[tuple[float, float]]:
    """Frequencies, and factors k > 0 of Q at which P + k Q has a root on the imaginary axis there."""
    P_even, P_odd = parts(P)
    Q_even, Q_odd = parts(Q)
    crossings = positive_roots(total(np.convolve(P_odd, Q_even), -np.convolve(P_even, Q_odd)))  # where Q/P is real
    found = []
    for w in crossings:
        s = 1j * math.sqrt(w)
        found.append((math.sqrt(w), -(value_at(P, s) / value_at(Q, s)).real))
    if Q[0] != 0:  # a root through the origin
        found.append((0.0, float(-P[0] / Q[0])))
    return [(w, k) for w, k in found if k > 0]


def _peaks(above: Array, below: Array) -> list[tuple[float, float]]:
    """Frequencies [rad/s], infinity included, where |above/below| on the imaginary axis is stationary; its values."""
    a, b = square(above), square(below)
    candidates = [0.0, *positive_roots(total(np.convolve(derivative(a), b), -np.convolve(a, derivative(b))))]
    found = [(math.sqrt(w), math.sqrt(value_at(a, w) / value_at(b, w))) for w in candidates]
    end = above[-1] / below[-1] if len(above) == len(below) else 0.0
    return [*found, (math.inf, abs(float(end)))]


def _peak(above: Array, below: Array) -> tuple[float, float]:
    """The largest |above/below| on the imaginary axis, and its frequency [rad/s]."""
    where, most = max(_peaks(above, below), key=lambda pair: pair[::-1])
    return most, where
