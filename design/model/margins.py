"""How much gain, phase and delay the linear loop bears: from polynomials, without a frequency grid.

The loop is broken where a signal could be late or wrong and written as P(s) + Q(s) = 0, Q being the part that passes
the break:

actuator
    P = s (I s² - A L),  Q = s (K_d s + K_p) - (K_f/ell)(I s² - A L);  L = Q/P
force measurement
    P = s (I s² + K_d s + K_p - A L),  Q = -(K_f/ell)(I s² - A L)
angle measurement (angle and rate)
    P = (s - K_f/ell)(I s² - A L),  Q = s (K_d s + K_p)

With the foot on the ground F_H - F_T = tau/ell (11), so that the law's own integral is an unstable filter inside the
loop; a Nyquist count must know it, and these formulas do: the nominal loop is stable, and each margin is the smallest
change that puts a root on the imaginary axis. Crossings are the positive real roots of polynomials in omega². For law
(20) K_f stands for K_f (M + m) g/(F_T + F_H); law pd has K_f = 0, and a factor s cancels. Where law force adapts within
T_a = 1/a, the angle is also read through a K_p (1 - I s²/(M g L))/(s + a), and the force through a K_p/(M g L)/(s + a).
What the force measurement tells is tau + beta theta'' (``design.model.standing``): I + beta for I where K_f is, and the
law that adapts has I + M L h for I.

Sources: gain, phase and modulus margin as usual; disk margin in the form of S - T (Seiler, Packard and Gahinet, IEEE
Control Systems 40, 2020): alpha = 1/max |(S - T)/2|; delay margin by direct frequency sweeping made finite (Walton and
Marshall, IEE Proc. D 134, 1987).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from design.model.body import Biped
from design.model.laws import Gains, LawKind

Array = NDArray[np.float64]

IDS = (
    "gain-margin-up", "gain-margin-down", "phase-margin", "delay-margin", "force-delay-margin", "angle-delay-margin",
    "disk-margin",
)  # fmt: skip
"""Ids of the margins that have pieces."""


@dataclass(frozen=True, kw_only=True)
class Break:
    """The characteristic function P + Q, in rising powers of s; Q passes the break."""

    P: Polynomial
    Q: Polynomial


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


def effective_gain(biped: Biped, kind: LawKind, K_f: float, load: float) -> float:
    """K_f as it acts in the linear loop [m/s]."""
    if kind == "pd":
        return 0.0
    return K_f * biped.weight / load if kind == "cop" else K_f


def breaks(
    biped: Biped, kind: LawKind, K: Gains, A: float, load: float, adapt: float = math.inf, beta: float = 0.0
) -> dict[str, Break]:
    """The loop broken at ``actuator``, ``force`` and ``angle``; ``force`` is missing for law pd."""
    rest = Polynomial([-A * biped.L, 0.0, biped.I])
    feedback = Polynomial([K.K_p, K.K_d])
    if kind == "pd":
        return {"actuator": Break(P=rest, Q=feedback), "angle": Break(P=rest, Q=feedback)}
    pull = effective_gain(biped, kind, K.K_f, load) / biped.ell
    s = Polynomial([0.0, 1.0])
    extra = Polynomial([0.0, 0.0, beta])
    told = rest + extra
    if math.isfinite(adapt):
        a, lever = 1.0 / adapt, biped.M * biped.g * biped.L
        swung = biped.I + biped.M * biped.L * biped.height
        angle = s * (s + a) * feedback - a * K.K_p * s * Polynomial([1.0, 0.0, -swung / lever])
        force = pull * (s + a) + (a * K.K_p / lever) * s
        return {
            "actuator": Break(P=s * (s + a) * rest, Q=(angle - force * told).trim(1e-12 * abs(K.K_d))),
            "force": Break(P=s * (s + a) * rest + angle, Q=-force * told),
            "angle": Break(P=(s * (s + a) - force) * rest - force * extra, Q=angle),
        }
    return {
        "actuator": Break(P=s * rest, Q=s * feedback - pull * told),
        "force": Break(P=s * (rest + feedback), Q=-pull * told),
        "angle": Break(P=(s - pull) * rest - pull * extra, Q=s * feedback),
    }


def loop_margins(
    biped: Biped, kind: LawKind, K: Gains, A: float, load: float, adapt: float = math.inf, beta: float = 0.0
) -> LoopMargins:
    """All margins of a loop that is stable; raises ``ValueError`` for one that is not."""
    found = margin_pieces(biped, kind, K, A, load, adapt, beta)
    broken = breaks(biped, kind, K, A, load, adapt, beta)["actuator"]
    peak, _ = _peak(broken.P, broken.P + broken.Q)
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
    at = breaks(biped, kind, K, A, load, adapt, beta)
    P, Q = at["actuator"].P, at["actuator"].Q
    if (P + Q).roots().real.max() >= 0:
        message = "the loop is not stable; it has no margins"
        raise ValueError(message)

    def factors() -> list[tuple[float, float]]:
        return _critical_gains(P, Q)

    def delays(broken: Break | None) -> list[tuple[float, float]]:
        if broken is None:
            return []
        return [(w, _lag(broken.P, broken.Q, w) / w) for w in _unit_gain(broken.P, broken.Q)]

    rows: dict[str, Callable[[], list[tuple[float, float]]]] = {
        "gain-margin-up": lambda: [(w, k) for w, k in factors() if k > 1],
        "gain-margin-down": lambda: [(w, k) for w, k in factors() if 0 < k < 1],
        "phase-margin": lambda: [(w, abs(_wrapped(_lag(P, Q, w)))) for w in _unit_gain(P, Q)],
        "delay-margin": lambda: delays(at["actuator"]),
        "force-delay-margin": lambda: delays(at.get("force")),
        "angle-delay-margin": lambda: delays(at["angle"]),
        "disk-margin": lambda: [(w, 1.0 / peak) for w, peak in _peaks(0.5 * (P - Q), P + Q) if peak > 0],
    }
    return {id: rows[id]() for id in ids}


def near_crossings(broken: Break, reach: float = 0.5) -> list[tuple[float, float, float]]:
    """Where unit gain is nearly crossed: frequency [rad/s], lag to -1 there [rad], and gap of |Q/P| from 1.

    Stationary points of |Q/P| up to ``reach`` from 1. The gap is positive for a maximum below 1 or a minimum above it;
    when it closes, two crossings appear, and phase and delay margins jump.
    """
    a, b = _square(broken.Q), _square(broken.P)
    slope = a.deriv() * b - a * b.deriv()
    found = []
    for w in _positive_roots(slope):
        size = math.sqrt(float(a(w) / b(w)))
        least = float(slope.deriv()(w)) > 0
        gap = size - 1.0 if least else 1.0 - size
        if abs(gap) <= reach:
            found.append((math.sqrt(w), _lag(broken.P, broken.Q, math.sqrt(w)), gap))
    return found


def delay_margin(broken: Break) -> float:
    """The smallest T > 0 at which P + Q exp(-s T) has a root on the imaginary axis [s]."""
    return min((_lag(broken.P, broken.Q, w) / w for w in _unit_gain(broken.P, broken.Q)), default=math.inf)


def _square(p: Polynomial) -> Polynomial:
    """|p(i omega)|² as a polynomial in w = omega²."""
    even, odd = _parts(p)
    return even * even + Polynomial([0.0, 1.0]) * odd * odd


def _parts(p: Polynomial) -> tuple[Polynomial, Polynomial]:
    """p(i omega) = even(w) + i omega odd(w) with w = omega²."""
    signs = np.array([(-1.0) ** (k // 2) for k in range(len(p.coef))])
    c = p.coef * signs
    return Polynomial(c[0::2]), Polynomial(c[1::2] if len(c) > 1 else [0.0])


def _positive_roots(p: Polynomial) -> list[float]:
    """Real roots > 0; a pair that rounding moved off the axis counts, since a margin may only err on the safe side."""
    p = p.trim(1e-14 * float(np.abs(p.coef).max() or 1.0))
    if p.degree() < 1:
        return []
    roots = p.roots()
    size = float(np.abs(roots).max())
    near = np.abs(roots.imag) <= 1e-7 * np.abs(roots)
    return sorted(float(r) for r in roots.real[near] if r > 1e-12 * size)


def _unit_gain(P: Polynomial, Q: Polynomial) -> list[float]:
    """Frequencies at which |Q/P| = 1 [rad/s]."""
    return [math.sqrt(w) for w in _positive_roots(_square(Q) - _square(P))]


def _lag(P: Polynomial, Q: Polynomial, omega: float) -> float:
    """The phase lag in (0, 2 pi] that brings Q/P to -1 at ``omega``."""
    ratio = Q(1j * omega) / P(1j * omega)
    lag = float(np.angle(-ratio)) % (2 * math.pi)
    return lag if lag > 0 else 2 * math.pi


def _wrapped(angle: float) -> float:
    return (angle + math.pi) % (2 * math.pi) - math.pi


def _critical_gains(P: Polynomial, Q: Polynomial) -> list[tuple[float, float]]:
    """Frequencies, and factors k > 0 of Q at which P + k Q has a root on the imaginary axis there."""
    P_even, P_odd = _parts(P)
    Q_even, Q_odd = _parts(Q)
    crossings = _positive_roots(P_odd * Q_even - P_even * Q_odd)  # where Q/P is real
    found = []
    for w in crossings:
        s = 1j * math.sqrt(w)
        found.append((math.sqrt(w), float(-(P(s) / Q(s)).real)))
    if Q(0.0) != 0:  # a root through the origin
        found.append((0.0, float(-P(0.0) / Q(0.0))))
    return [(w, k) for w, k in found if k > 0]


def _peaks(above: Polynomial, below: Polynomial) -> list[tuple[float, float]]:
    """Frequencies [rad/s], infinity included, where |above/below| on the imaginary axis is stationary; its values."""
    a, b = _square(above), _square(below)
    candidates = [0.0, *_positive_roots(a.deriv() * b - a * b.deriv())]
    found = [(math.sqrt(w), math.sqrt(float(a(w) / b(w)))) for w in candidates]
    end = above.coef[-1] / below.coef[-1] if len(above.coef) == len(below.coef) else 0.0
    return [*found, (math.inf, abs(float(end)))]


def _peak(above: Polynomial, below: Polynomial) -> tuple[float, float]:
    """The largest |above/below| on the imaginary axis, and its frequency [rad/s]."""
    at, most = max(_peaks(above, below), key=lambda pair: pair[::-1])
    return most, at
