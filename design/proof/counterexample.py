"""A counterexample to what is to be proved: a body and world of a box that breaks a demand, and when.

Its middle and corners are tried: the corners at which one march of them all presses toe and heel least. What is found
is confirmed by an integrator that shares nothing with the prover (``design.analysis.recheck``).
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from design.analysis.many import extremes
from design.analysis.recheck import second_opinion
from design.model.deciding import deciding_points
from design.proof import poles
from design.proof.case import Case
from design.proof.exact import around, decimal

Array = NDArray[np.float64]


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
    cases = [replace(case, biped=biped, scenario=scenario) for biped, scenario in tried]
    for one in cases:
        if time.monotonic() > deadline:
            return None
        sigma = _decay(one)
        if sigma < demanded["decay-rate"] * (1 - 1e-9) or sigma < -1e-9:
            return Counterexample(row="decay-rate", value=sigma, time_s=None, at=one.middle)
    if len(cases) > 1:
        cases = [cases[0], *(cases[1 + k] for k in _worst(case, np.array(signs), deadline))]
    each = (_broken(one, demanded, deadline) for one in cases if time.monotonic() < deadline)
    return next((broken for broken in each if broken is not None), None)


def _worst(case: Case, signs: Array, deadline: float) -> list[int]:
    """Which of all corners press the toe, and the heel, least, and have most torque, by one march of them all."""
    shares = np.zeros((len(signs), 7))
    shares[:, case.moving] = signs
    ends = extremes(
        case.biped, case.kind, case.gains, case.scenario, case.tolerances, shares, step=max(case.step, 2e-3),
        theta_d=case.theta_d, adapt=case.adapt, known=case.believed, deadline=deadline,
    )  # fmt: skip
    return sorted({int(np.argmin(each)) for each in (ends.toe, ends.heel, -ends.torque)})


def _broken(one: Case, demanded: dict[str, float], deadline: float) -> Counterexample | None:
    """What one body in one world breaks."""
    ran = second_opinion(
        one.biped, one.kind, one.theta_d, one.gains, one.scenario, one.step, one.adapt, known=one.believed,
        deadline=deadline,
    )  # fmt: skip
    for row, force in (("toe-force", ran.F_T), ("heel-force", ran.F_H)):
        below = np.flatnonzero(force < demanded[row] - 1e-6 * one.biped.weight)  # false where it is not a number
        if len(below):
            at = int(below[0]) if demanded[row] == 0 else int(np.nanargmin(force))
            return Counterexample(row=row, value=float(force[at]), time_s=float(ran.t[at]), at=one.middle)
    size = np.abs(ran.tau)
    above = np.flatnonzero(size > demanded.get("torque", np.inf) * (1 + 1e-9))
    if len(above):
        at = int(above[0])
        return Counterexample(row="torque", value=float(size[at]), time_s=float(ran.t[at]), at=one.middle)
    return None


def _decay(case: Case) -> float:
    """The least decay rate of one body along one scenario."""
    case = replace(case, radii=(0.0,) * 7)
    at, L = poles.numbers(case), decimal(case.biped.L)
    A, load = deciding_points(case.kind, *case.scenario.operating_points(case.biped), case.adapt)
    points = zip(A.tolist(), load.tolist(), strict=True)
    return min(poles.rate(case, replace(at, AL=around(a) * L, load=around(n))) for a, n in points)
