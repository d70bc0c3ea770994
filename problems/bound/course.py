"""What trajectories allow over a box of gains: each limit at each sample as a quadratic, and what that misses.

Values, slopes and curvatures at the centre are exact (``design.analysis.motion``). What the quadratic misses is not
enclosed but measured, at four corners, and taken ``SAFETY`` times, with a part of the curvature itself added.
Where it misses nearly as much as its curvature says, it is not used at all: the box is too large. Therefore bounds from
here are a *sampled relaxation*: sound as far as four corners tell the truth about a box.

A requirement holds at every sample, so that a few samples suffice for a bound: those at which the quadratics are
least, at the centre and at each corner. Samples after a fall, at the centre or at a corner, are not used.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design import deadline
from design.analysis.motion import Motion
from design.analysis.simulate import FALLEN
from design.buffered import Buffered
from problems.bound.poles import SIX
from problems.bound.relax import Quadratics
from problems.gains import Grid
from problems.gains.goal import BACKOFF
from problems.gains.grid import limit_rows
from problems.gains.question import Case

Array = NDArray[np.float64]

SAFETY = 2.0
SHARE = 0.1
"""Part of the curvature's largest effect that is added to what the quadratic misses."""
TRUSTED = 0.5
"""A quadratic that misses more than this part of its curvature's largest effect is not used."""
TINY = 1e-3
"""What it may miss in any case, in the scale of its row."""
CLEAR = 0.98
"""Part of the samples that can be used, from which a box is thought to be seen clearly."""
BATCH = 16
UNSEEN = 1e6
"""Value of a row that is not used: it excludes nothing."""


CORNERS: Array = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])
"""Four corners of a box, no two of them neighbours; the last is the least stable one: weak, and K_f large."""
PICKS = 1 + len(CORNERS)


@dataclass(frozen=True, eq=False)
class Seen:
    """The ``rows`` of some boxes, and how their centres and corners do themselves.

    ``clear`` (b,): nearly all samples can be used. ``points`` (b, 5, 3); ``objective`` (b, 5): the least row of the
    objective there, ``required``: of all others, -inf where the biped falls.
    """

    rows: Quadratics
    clear: NDArray[np.bool_]
    points: Array
    objective: Array
    required: Array


class Course:
    """The trajectories of a grid's cases, as functions of the gains in parts of ``scale``.

    ``of`` (m,): what each row of a box owes v.
    """

    def __init__(self, grid: Grid) -> None:
        self.scale = grid.question.scale
        found = [
            _functions(grid, case, motion)
            for case, motion in zip(grid.cases, grid.whole, strict=True)
            if case.sized is None
        ]
        self._plain = [Buffered(plain.map(BATCH * len(CORNERS))) for plain, _, _ in found]
        self._second = [Buffered(second.map(BATCH)) for _, second, _ in found]
        self._of = [of for _, _, of in found]
        self.of: Array = np.concatenate([np.tile(of, PICKS) for of in self._of])

    def look(self, centre: Array, radius: Array) -> Seen:
        """At boxes (b, 3). Raises ``OutOfTime`` between batches where a deadline is set and has passed."""
        parts = [self._batch(centre[k : k + BATCH], radius[k : k + BATCH]) for k in range(0, len(centre), BATCH)]
        rows = Quadratics(*(np.concatenate([getattr(part.rows, name) for part in parts]) for name in ("f", "g", "H")))
        rest = (
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("clear", "points", "objective", "required")
        )
        return Seen(rows, *rest)

    def _batch(self, centre: Array, radius: Array) -> Seen:
        deadline.check()
        count = len(centre)
        fill = np.arange(BATCH) % count
        centre, radius = centre[fill], radius[fill]
        points = np.concatenate([centre[:, None], centre[:, None] + CORNERS * radius[:, None]], axis=1)
        K = points * self.scale
        objective, required = (np.full((BATCH, PICKS), np.inf) for _ in range(2))
        rows: Quadratics | None = None
        clear = np.ones(BATCH, dtype=bool)
        for plain, second, of in zip(self._plain, self._second, self._of, strict=True):
            corners = plain(K=K[:, 1:].ravel())["rows"].reshape(BATCH, len(CORNERS), -1, 1 + len(of))
            middle = second(K=K[:, 0].ravel())["rows"].reshape(BATCH, -1, 1 + 10 * len(of))
            with np.errstate(invalid="ignore", over="ignore"):
                found, values, fell, good = _quadratics(middle, corners, radius * self.scale)
                least = np.where(fell[..., None], -np.inf, values.min(axis=2))  # (b, 5, rows)
            rows = found if rows is None else rows.beside(found)
            clear &= good > CLEAR
            for k, owes in enumerate(of):
                into = objective if owes else required
                np.minimum(into, least[..., k], out=into)
        assert rows is not None
        return Seen(rows.at(np.arange(count)), clear[:count], points[:count], objective[:count], required[:count])


def _functions(grid: Grid, case: Case, motion: Motion) -> tuple[ca.Function, ca.Function, Array]:
    """K -> (theta, rows) at all samples; the same with first and second derivatives of the rows; what each owes v."""
    loop = case.loop
    m = loop.size
    z, S, T = ca.SX.sym("z", m), ca.SX.sym("S", m, 3), ca.SX.sym("T", m, 6)
    K, F = ca.SX.sym("K", 3), ca.SX.sym("F", 2)
    found = [
        (row[k] if of else row[k] + BACKOFF, of)
        for limit in case.limits
        for row, of in limit_rows(grid.question, grid.goal, case, limit, limit.quantity(z[:2], loop.torque(z, K), F))
        for k in range(row.numel())
    ]
    rows, of = ca.vertcat(*[row for row, _ in found]), np.array([of for _, of in found])
    zK = ca.vertcat(z, K)
    along = [ca.vertcat(S[:, j], ca.densify(ca.DM.eye(3)[:, j])) for j in range(3)]
    first = [ca.jtimes(rows, zK, direction) for direction in along]
    held = ca.SX.sym("held", m + 3)
    pairs = [(i, j) for i in range(3) for j in range(i, 3)]
    bent = {}
    for index, (i, j) in enumerate(pairs):
        curved = ca.jtimes(ca.jtimes(rows, zK, held), zK, along[j])
        bent[i, j] = ca.substitute(curved, held, along[i]) + ca.jtimes(rows, z, T[:, index])
    cse = {"cse": True}
    seen = ca.Function("seen", [z, K, F], [ca.vertcat(z[0], rows)], cse)
    orders = ca.vertcat(z[0], rows, *first, *[bent[pair] for pair in SIX])
    all_seen = ca.Function("seen_2", [ca.veccat(z, S, T), K, F], [ca.densify(orders)], cse)
    k = ca.MX.sym("K", 3)
    n, force = len(motion.steps.t), ca.DM(motion.steps.force)
    made = []
    for order, function in ((0, seen), (2, all_seen)):
        states = motion.all_states(k, order)
        made.append(ca.Function("rows", [k], [function.map(n)(states, ca.repmat(k, 1, n), force)], ["K"], ["rows"]))
    return made[0], made[1], of


def _quadratics(middle: Array, corners: Array, radius: Array) -> tuple[Quadratics, Array, Array, Array]:
    """Five quadratics for each row, all rows at centre and corners (b, 5, samples, rows), and where it falls (b, 5).

    Last, the part of the samples that can be used (b,).
    """
    b, n = middle.shape[:2]
    count = corners.shape[3] - 1
    orders = middle[..., 1:].reshape(b, n, 10, count)
    f = orders[:, :, 0]  # (b, n, rows)
    sizes = np.concatenate([radius, *[(radius[:, j] * radius[:, k])[:, None] for j, k in SIX]], axis=1)
    terms = orders[:, :, 1:] * sizes[:, None, :, None]
    products = np.stack([CORNERS[:, j] * CORNERS[:, k] * (0.5 if j == k else 1.0) for j, k in SIX], axis=-1)
    powers = np.concatenate([CORNERS, products], axis=1)
    said = f[:, None] + np.matmul(powers, terms.reshape(b, n, 9, count)).swapaxes(1, 2)  # (b, 4, n, rows)
    curved = np.abs(terms[:, :, 3:])
    bend = 0.5 * curved[:, :, :3].sum(axis=2) + curved[:, :, 3:].sum(axis=2)
    missed = np.abs(corners[..., 1:] - said).max(axis=1)
    rest = SAFETY * missed + SHARE * bend
    down = ~(np.abs(np.concatenate([middle[:, None, :, 0], corners[..., 0]], axis=1)) < FALLEN)  # (b, 5, n)
    before = ~np.logical_or.accumulate(down.any(axis=1), axis=-1)  # (b, n)
    good = before[..., None] & (missed <= TRUSTED * bend + TINY)
    upper = np.concatenate([f[:, None], said], axis=1) + rest[:, None]
    where = np.argmin(np.where(good[:, None], upper, np.inf), axis=2)  # (b, 5, rows)
    take = (np.arange(b)[:, None, None], where, np.arange(count))
    use = good[take]
    terms = np.moveaxis(terms, 2, 3)[take]  # (b, 5, rows, 9)
    rows = Quadratics(
        np.where(use, (f + rest)[take], UNSEEN).reshape(b, -1).copy(),
        np.where(use[..., None], terms[..., :3], 0.0).reshape(b, -1, 3),
        np.where(use[..., None], terms[..., 3:], 0.0).reshape(b, -1, 6),
    )
    return rows, np.concatenate([f[:, None], corners[..., 1:]], axis=1), down.any(axis=2), good.mean(axis=(1, 2))
