"""How the loop's rates change with its states: a Jacobian that is affine in each of a few numbers.

With dtau = (-K_p, -K_d, K_f, K_p), the law's own, and e_j the unit vectors, the rows are

    theta'      e_2
    omega'      (G e_1 + dtau)/I                                    G = A L cos(theta - theta_f)
    s'          gather dtau + bend e_1 + drag e_2
    theta_d'    a (e_1 - e_4) + a ell_k/(M g L)_k dtau/ell - a I_k/(M g L)_k (G e_1 + dtau)/I        (a law that adapts)

with k for what the law reckons with. Law (8) has gather = 1/ell, and no bend and drag. Law (20), with N = F_T + F_H,
s' = c tau/(ell N) (``Case.gathering``) and z = c M L tau/(ell N²), has

    gather = c/(ell N) + z sin(theta)/I,    bend = z (G sin(theta)/I + theta'' cos(theta) - omega² sin(theta)),
    drag = 2 z omega cos(theta).

Between two states of a tube the rates differ by a mean of Jacobians, which lies in the convex hull of the ones at the
corners of the numbers' ranges.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from fractions import Fraction
from itertools import product
from typing import NamedTuple

from design.proof.case import Case
from design.proof.taylor import UP

Ends = tuple[float, float]
Matrix = list[list[Fraction]]


class Ranges(NamedTuple):
    """Of the numbers that the Jacobian depends on: ``G`` [N m], ``inertia`` = 1/I, ``gather``, ``bend``, ``drag``."""

    G: Ends
    inertia: Ends
    gather: Ends = (0.0, 0.0)
    bend: Ends = (0.0, 0.0)
    drag: Ends = (0.0, 0.0)

    def corners(self) -> Iterator[tuple[float, ...]]:
        """All choices of ends."""
        return product(*(sorted(set(ends)) for ends in self))

    def middle(self) -> tuple[float, ...]:
        """The middle of each."""
        return tuple(0.5 * sum(ends) for ends in self)

    def chief(self) -> Ranges:
        """The same with bend and drag, which matter least, in the middle of theirs."""
        bend, drag = self.middle()[3:]
        return self._replace(bend=(bend, bend), drag=(drag, drag))


def ranges(case: Case, G: Ends) -> Ranges:
    """The ranges for laws pd and (8), over the bodies of the box."""
    inertia = per(case.biped.I, case.radii[2])
    return Ranges(G, inertia, per(case.biped.ell, case.radii[4]) if case.size > 2 else (0.0, 0.0))


def per(value: float, radius: float) -> Ends:
    """The range of 1/x for x within ``radius`` of ``value``, and a trace more."""
    return 1.0 / (value + radius) / UP, math.nextafter(1.0 / (value - radius) * UP, math.inf)


def jacobian(case: Case, G: float, inertia: float, gather: float, bend: float, drag: float) -> Matrix:
    """The matrix (n, n), without rounding."""
    K_p, K_d, K_f = (Fraction(float(gain)) for gain in case.gains)
    n = case.size
    dtau = [-K_p, -K_d, K_f, K_p][:n]
    turning = [Fraction(inertia) * part for part in (dtau[0] + Fraction(G), *dtau[1:])]
    rows = [[Fraction(int(j == 1)) for j in range(n)], turning]
    if n > 2:
        gathered = [Fraction(gather) * part for part in dtau]
        rows.append([gathered[0] + Fraction(bend), gathered[1] + Fraction(drag), *gathered[2:]])
    if n > 3:
        a, swing, lever = case.following
        row = [lever * part - swing * turn for part, turn in zip(gathered, turning, strict=True)]
        rows.append([row[0] + a, *row[1:3], row[3] - a])
    return rows
