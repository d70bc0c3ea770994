"""A counterexample to what is to be proved: a body and world of a box that breaks a demand, and when.

Its middle and corners are tried: the corners at which one march of them all comes to its extremes. What that finds is
confirmed by an integrator that shares nothing with the prover (``design.analysis.recheck``): the instant is refined
between the samples, twice with different tolerances, and the violation must be far larger than what the two differ by.
Once the foot has lifted the equations no longer hold, so nothing after that counts. That a pole lies too far to the
right is decided in rational numbers. No point is tried that lies outside the box as the spec has it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.analysis.many import extremes
from design.analysis.recheck import SecondOpinion, second_opinion
from design.model.body import Biped
from design.model.environment import Scenario, varied
from design.proof import poles
from design.proof.case import NAMES, Case
from design.proof.exact import decimal

Array = NDArray[np.float64]

ROWS = ("toe-force", "heel-force", "cop-margin", "torque")
SMALL = 1e-6
"""Violations below this part of the weight, of ell, or of both are not looked at."""
BEYOND = 1e3
"""How many times as large as the integrator's own error a violation must be."""
REFINED = 80
"""Samples on either side of the worst one."""


@dataclass(frozen=True, kw_only=True)
class Counterexample:
    """A body and world of the box that break a demand: ``value`` at ``time_s``; ``at`` by names, in SI units."""

    row: str
    value: float
    time_s: float | None
    at: Mapping[str, float]


def counterexample(
    case: Case, demanded: dict[str, float], *, corners: bool, deadline: float = math.inf
) -> Counterexample | None:
    """A point of the part, its middle or a corner, that breaks a demand, by another integrator.

    None if none does, or none is known to by the ``deadline`` (``time.monotonic``).
    """
    tried = [case.at({})]
    if corners and case.moving:
        signs = list(product((-1.0, 1.0), repeat=len(case.moving)))
        tried += [case.at(dict(zip(case.moving, some, strict=True))) for some in signs]
    cases = [_within(case, biped, scenario) for biped, scenario in tried]
    sigma = decimal(demanded["decay-rate"])
    for one in cases:
        if time.monotonic() > deadline:
            return None
        for at in poles.along(one):
            if poles.too_slow(one, at, sigma):
                return Counterexample(row="decay-rate", value=poles.rate(one, at), time_s=None, at=one.middle)
    if len(cases) > 1:
        cases = [cases[0], *(cases[1 + k] for k in _worst(case, np.array(signs), deadline))]
    each = (_broken(one, demanded, deadline) for one in cases if time.monotonic() < deadline)
    return next((broken for broken in each if broken is not None), None)


def _within(case: Case, biped: Biped, scenario: Scenario) -> Case:
    """The body and world as a case of one point; what rounding has put outside the box is put on its boundary."""
    inside: dict[str, Any] = {
        name: min(max(value, low), high) for name, value, (low, high) in _values(case, biped, scenario)
    }
    real = replace(biped, **{name: inside[name] for name in NAMES[:5]})
    world = varied(scenario, real, slope=lambda _: inside["slope"], ramp=lambda _: inside["ramp"])
    return replace(case, biped=real, scenario=world, radii=(0.0,) * 7)


def _values(case: Case, biped: Biped, scenario: Scenario) -> list[tuple[str, float, tuple[float, float]]]:
    middle = replace(case, biped=biped, scenario=scenario).middle
    return [(name, middle[name], case.limits.get(name, (middle[name],) * 2)) for name in NAMES]


def _worst(case: Case, signs: Array, deadline: float) -> list[int]:
    """Which of all corners come to the extremes of toe and heel force, CoP margin and torque, by one march of all."""
    shares = np.zeros((len(signs), 7))
    shares[:, case.moving] = signs
    ends = extremes(
        case.biped, case.kind, case.gains, case.scenario, case.tolerances, shares, step=max(case.step, 2e-3),
        theta_d=case.theta_d, adapt=case.adapt, known=case.believed, deadline=deadline,
    )  # fmt: skip
    return sorted({int(np.argmin(each)) for each in (ends.toe, ends.heel, ends.cop, -ends.torque)})


def _run(one: Case, times: Array | None, tolerance: float, deadline: float) -> SecondOpinion:
    return second_opinion(
        one.biped, one.kind, one.theta_d, one.gains, one.scenario, one.step, one.adapt, known=one.believed,
        deadline=deadline, times=times, tolerance=tolerance,
    )  # fmt: skip


def _quantities(one: Case, ran: SecondOpinion) -> dict[str, Array]:
    load = ran.F_T + ran.F_H
    with np.errstate(all="ignore"):
        away = np.abs(ran.F_T - ran.F_H) * one.biped.ell / load  # (18)
    cop = np.where(load > 0, one.biped.ell - away, np.nan)
    return {"toe-force": ran.F_T, "heel-force": ran.F_H, "cop-margin": cop, "torque": np.abs(ran.tau)}


def _margins(one: Case, demanded: dict[str, float], ran: SecondOpinion) -> dict[str, Array]:
    """By row that is demanded, the margin at each sample while the foot stands, NaN after it has lifted."""
    values = _quantities(one, ran)
    lifted = np.minimum(ran.F_T, ran.F_H) < -SMALL * one.biped.weight
    standing: NDArray[np.bool_] = np.cumsum(lifted) - lifted == 0
    signs = {row: -1.0 if row == "torque" else 1.0 for row in ROWS}
    return {
        row: np.where(standing, signs[row] * (values[row] - demanded[row]), np.nan) for row in ROWS if row in demanded
    }


def _broken(one: Case, demanded: dict[str, float], deadline: float) -> Counterexample | None:
    """What one body in one world breaks first of all rows."""
    ran = _run(one, None, 1e-10, deadline)
    unit = one.biped.weight
    small = {"toe-force": unit, "heel-force": unit, "cop-margin": one.biped.ell, "torque": unit * one.biped.ell}
    candidates = []
    for row, margin in _margins(one, demanded, ran).items():
        if (margin < -SMALL * small[row]).any():
            candidates.append((row, int(np.nanargmin(margin))))
    for row, k in sorted(candidates, key=lambda each: each[1]):
        if (broken := _confirmed(one, demanded, row, ran.t, k, SMALL * small[row], deadline)) is not None:
            return broken
    return None


def _confirmed(
    one: Case, demanded: dict[str, float], row: str, t: Array, k: int, small: float, deadline: float
) -> Counterexample | None:
    """The violation near sample ``k``, if it is far larger than the integrator's error there."""
    times = np.append(np.linspace(t[max(k - 1, 0)], t[min(k + 1, len(t) - 1)], 2 * REFINED + 1), t[k])
    coarse, fine = (_run(one, times, tolerance, deadline) for tolerance in (1e-10, 1e-12))
    margin, other = (_margins(one, demanded, ran)[row] for ran in (fine, coarse))
    if not (fine.finished and (margin < -small).any()):
        return None
    at = int(np.nanargmin(margin))
    if demanded[row] == 0 and row in ("toe-force", "heel-force"):  # it lifts: told at the sample after that instant
        margin, other = (_quantities(one, ran)[row] for ran in (fine, coarse))
        at = int(np.nanargmin(np.where(fine.t == t[k], margin, np.inf)))
    if not abs(margin[at] - other[at]) * BEYOND < -margin[at]:
        return None
    return Counterexample(
        row=row, value=float(_quantities(one, fine)[row][at]), time_s=float(fine.t[at]), at=one.middle
    )
