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

import cmath
import math
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial
from numpy.polynomial.polynomial import polyroots
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

    @property
    def coefficients(self) -> tuple[Array, Array]:
        """Those of P and of Q, in rising powers."""
        return np.asarray(self.P.coef, dtype=np.float64), np.asarray(self.Q.coef, dtype=np.float64)


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
    rest = np.array([-A * biped.L, 0.0, biped.I])
    feedback = np.array([K.K_p, K.K_d])
    if kind == "pd":
        return {"actuator": _break(rest, feedback), "angle": _break(rest, feedback)}
    pull = effective_gain(biped, kind, K.K_f, load) / biped.ell
    s = np.array([0.0, 1.0])
    extra = np.array([0.0, 0.0, beta])
    told = rest + extra
    if math.isfinite(adapt):
        a, lever = 1.0 / adapt, biped.M * biped.g * biped.L
        swung = biped.I + biped.M * biped.L * biped.height
        later = np.array([0.0, a, 1.0])  # s (s + a)
        force = np.array([a, 1.0]) * pull + s * (a * K.K_p / lever)
        angle = _sum(np.convolve(later, feedback), a * K.K_p * np.array([0.0, -1.0, 0.0, swung / lever]))
        passed = np.convolve(force, told)
        falls = np.convolve(later, rest)
        actuator = Polynomial(_sum(angle, -passed)).trim(1e-12 * abs(K.K_d))
        return {
            "actuator": Break(P=Polynomial(falls), Q=actuator),
            "force": _break(_sum(falls, angle), -passed),
            "angle": _break(_sum(np.convolve(_sum(later, -force), rest), -np.convolve(force, extra)), angle),
        }
    return {
        "actuator": _break(np.convolve(s, rest), _sum(np.convolve(s, feedback), -pull * told)),
        "force": _break(np.convolve(s, _sum(rest, feedback)), -pull * told),
        "angle": _break(_sum(np.convolve(np.array([-pull, 1.0]), rest), -pull * extra), np.convolve(s, feedback)),
    }


def _break(P: Array, Q: Array) -> Break:
    return Break(P=Polynomial(P), Q=Polynomial(Q))


def loop_margins(
    biped: Biped, kind: LawKind, K: Gains, A: float, load: float, adapt: float = math.inf, beta: float = 0.0
) -> LoopMargins:
    """All margins of a loop that is stable; raises ``ValueError`` for one that is not."""
    found = margin_pieces(biped, kind, K, A, load, adapt, beta)
    P, Q = breaks(biped, kind, K, A, load, adapt, beta)["actuator"].coefficients
    peak, _ = _peak(P, _sum(P, Q))
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
    P, Q = at["actuator"].coefficients
    whole = _sum(P, Q)
    if polyroots(whole).real.max() >= 0:
        message = "the loop is not stable; it has no margins"
        raise ValueError(message)

    def factors() -> list[tuple[float, float]]:
        return _critical_gains(P, Q)

    def delays(where: str) -> list[tuple[float, float]]:
        if where not in at:
            return []
        P, Q = at[where].coefficients
        return [(w, _lag(P, Q, w) / w) for w in _unit_gain(P, Q)]

    rows: dict[str, Callable[[], list[tuple[float, float]]]] = {
        "gain-margin-up": lambda: [(w, k) for w, k in factors() if k > 1],
        "gain-margin-down": lambda: [(w, k) for w, k in factors() if 0 < k < 1],
        "phase-margin": lambda: [(w, abs(_wrapped(_lag(P, Q, w)))) for w in _unit_gain(P, Q)],
        "delay-margin": lambda: delays("actuator"),
        "force-delay-margin": lambda: delays("force"),
        "angle-delay-margin": lambda: delays("angle"),
        "disk-margin": lambda: [(w, 1.0 / peak) for w, peak in _peaks(0.5 * _sum(P, -Q), whole) if peak > 0],
    }
    return {id: rows[id]() for id in ids}


def near_crossings(broken: Break, reach: float = 0.5) -> list[tuple[float, float, float]]:
    """Where unit gain is nearly crossed: frequency [rad/s], lag to -1 there [rad], and gap of |Q/P| from 1.

    Stationary points of |Q/P| up to ``reach`` from 1. The gap is positive for a maximum below 1 or a minimum above it;
    when it closes, two crossings appear, and phase and delay margins jump.
    """
    P, Q = broken.coefficients
    a, b = _square(Q), _square(P)
    slope = _sum(np.convolve(_derived(a), b), -np.convolve(a, _derived(b)))
    found = []
    for w in _positive_roots(slope):
        size = math.sqrt(_at(a, w) / _at(b, w))
        least = _at(_derived(slope), w) > 0
        gap = size - 1.0 if least else 1.0 - size
        if abs(gap) <= reach:
            found.append((math.sqrt(w), _lag(P, Q, math.sqrt(w)), gap))
    return found


def delay_margin(broken: Break) -> float:
    """The smallest T > 0 at which P + Q exp(-s T) has a root on the imaginary axis [s]."""
    P, Q = broken.coefficients
    return min((_lag(P, Q, w) / w for w in _unit_gain(P, Q)), default=math.inf)


def _sum(a: Array, b: Array) -> Array:
    """Of polynomials, by their coefficients in rising powers, as all below."""
    a, b = (a, b) if len(a) >= len(b) else (b, a)
    found = a.copy()
    found[: len(b)] += b
    return found


def _derived(c: Array) -> Array:
    return c[1:] * np.arange(1, len(c))


def _at(c: Array, x: Any) -> Any:
    """The value at one real or complex ``x``."""
    found = 0.0
    for each in reversed(c.tolist()):
        found = found * x + each
    return found


def _square(c: Array) -> Array:
    """|p(i omega)|² as a polynomial in w = omega²."""
    even, odd = _parts(c)
    return _sum(np.convolve(even, even), np.append(0.0, np.convolve(odd, odd)))


def _parts(c: Array) -> tuple[Array, Array]:
    """p(i omega) = even(w) + i omega odd(w) with w = omega²."""
    turned = c * TURNS[: len(c)]
    return turned[0::2], turned[1::2] if len(c) > 1 else np.zeros(1)


TURNS = np.tile([1.0, 1.0, -1.0, -1.0], 8)
"""Signs of the powers of i."""


def _positive_roots(c: Array) -> list[float]:
    """Real roots > 0; a pair that rounding moved off the axis counts, since a margin may only err on the safe side."""
    sizes = np.abs(c)
    c = c[: 1 + int(np.flatnonzero(sizes > 1e-14 * (sizes.max() or 1.0)).max(initial=0))]
    if len(c) < 2:
        return []
    roots = polyroots(c)
    size = float(np.abs(roots).max())
    near = np.abs(roots.imag) <= 1e-7 * np.abs(roots)
    return sorted(float(r) for r in roots.real[near] if r > 1e-12 * size)


def _unit_gain(P: Array, Q: Array) -> list[float]:
    """Frequencies at which |Q/P| = 1 [rad/s]."""
    return [math.sqrt(w) for w in _positive_roots(_sum(_square(Q), -_square(P)))]


def _lag(P: Array, Q: Array, omega: float) -> float:
    """The phase lag in (0, 2 pi] that brings Q/P to -1 at ``omega``."""
    ratio = _at(Q, 1j * omega) / _at(P, 1j * omega)
    lag = cmath.phase(-ratio) % (2 * math.pi)
    return lag if lag > 0 else 2 * math.pi


def _wrapped(angle: float) -> float:
    return (angle + math.pi) % (2 * math.pi) - math.pi


def _critical_gains(P: Array, Q: Array) -> list[tuple[float, float]]:
    """Frequencies, and factors k > 0 of Q at which P + k Q has a root on the imaginary axis there."""
    P_even, P_odd = _parts(P)
    Q_even, Q_odd = _parts(Q)
    crossings = _positive_roots(_sum(np.convolve(P_odd, Q_even), -np.convolve(P_even, Q_odd)))  # where Q/P is real
    found = []
    for w in crossings:
        s = 1j * math.sqrt(w)
        found.append((math.sqrt(w), -(_at(P, s) / _at(Q, s)).real))
    if Q[0] != 0:  # a root through the origin
        found.append((0.0, float(-P[0] / Q[0])))
    return [(w, k) for w, k in found if k > 0]


def _peaks(above: Array, below: Array) -> list[tuple[float, float]]:
    """Frequencies [rad/s], infinity included, where |above/below| on the imaginary axis is stationary; its values."""
    a, b = _square(above), _square(below)
    candidates = [0.0, *_positive_roots(_sum(np.convolve(_derived(a), b), -np.convolve(a, _derived(b))))]
    found = [(math.sqrt(w), math.sqrt(_at(a, w) / _at(b, w))) for w in candidates]
    end = above[-1] / below[-1] if len(above) == len(below) else 0.0
    return [*found, (math.inf, abs(float(end)))]


def _peak(above: Array, below: Array) -> tuple[float, float]:
    """The largest |above/below| on the imaginary axis, and its frequency [rad/s]."""
    at, most = max(_peaks(above, below), key=lambda pair: pair[::-1])
    return most, at
