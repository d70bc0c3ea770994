"""The front: its ends, the gaps between them halved one after another, what is beaten sought again or left out."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from design.model.laws import Gains
from design.solvers.outcome import Outcome, Status
from design.spec.setting import Setting
from problems import gains as single
from problems.tradeoff.gaps import Gap, Tried, gaps
from problems.tradeoff.margins import Cube, Margins, beats, cube, outside
from problems.tradeoff.point import Design, Designer

Array = NDArray[np.float64]
Say = Callable[[str], None]

SAME = 1e-3
"""Designs whose margins all differ by less than this part of their range are the same point."""
BEATEN = 1e-5
"""Part of a margin's range by which a point may be worse than another and not count as beaten."""
TIE = 1e-6
"""Part of an end's best margin that may go for the others, if that gives at least ``WORTH`` of the range of one."""
WORTH = 1e-2
CLOSE = 0.25
"""Gains that differ by less than this part of their scale are thought to be of one branch."""
NEXT = 0.1
"""Gains so near to each other need no coarse grid: the design between them is sought at full resolution at once."""
BENT = 1e-3
"""Distance from the chord from which there is a knee."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Own:
    """The spec's own gains: their ``values`` (k,), whether they meet the spec, and which point ``beaten`` them."""

    gains: Gains
    values: Array
    met: bool
    beaten: int | None


@dataclass(frozen=True, eq=False, kw_only=True)
class Front:
    """The designs from the best of the first margin on; ``u`` (n, k) their margins in the cube of the ends.

    ``ends``: which design is the best of each margin. ``knee``: which is farthest outside of the chord, and how far;
    None where the front does not bend. ``jumps``: pairs of designs between which none lies. ``unsolved``: attempts
    at a point that gave none.
    """

    margins: Margins
    designs: tuple[Design, ...]
    u: Array
    ends: tuple[int, ...]
    knee: tuple[int, float] | None
    jumps: tuple[tuple[int, int], ...]
    unsolved: int
    own: Own | None


def solve(
    setting: Setting, margins: Margins, *, points: int = 15, seconds: float = 600.0, say: Say = lambda _: None
) -> Outcome[Front]:
    """A front of about so many ``points``, evenly spread; the outcome is solved if it is whole.

    A front that is not whole is there all the same; none is if an end was not found. Raises ``BadInput`` if there are
    no bounds of the gains.
    """
    designer = Designer(setting, margins.ids, time.monotonic() + seconds)
    ends = _ends(designer, margins, say)
    if isinstance(ends, Outcome):
        return ends
    search = _Search(designer, margins, _ties_broken(designer, margins, ends, say))
    while len(search.designs) < points and not designer.late:
        gap = search.widest()
        if gap is None:
            break
        say(f"point {len(search.designs) + 1} of {points}; the widest gap is {gap.length:.2g} of the range")
        search.halve(gap)
    return search.finished(points, setting.gains)


def _ends(designer: Designer, margins: Margins, say: Say) -> list[Design] | Outcome[Front]:
    """The best design of each margin, or how the search for one ended.

    Each starts from those that are known too, which are feasible. One that was not found is sought again from them.
    """
    ends: dict[str, Design] = {}
    setting, failed = designer.setting, Outcome[Front](status=Status.TIME_LIMIT)
    for id in (*margins.ids, *margins.ids):
        left = designer.deadline - time.monotonic()
        if id in ends or left <= 0:
            continue
        known = [end.gains for end in ends.values()]
        problem = replace(setting, objective=id)
        answer = single.solve(problem, seconds=left, say=_told(say, f"best {id}: "), known=known)
        if answer.outcome.proof is not None:
            return Outcome.infeasible(answer.outcome.proof)
        end = None if answer.outcome.found is None else designer.known(answer.outcome.found, id, {})
        if end is not None:
            ends[id] = end
            continue
        status = answer.outcome.status if answer.outcome.found is None else Status.DISAGREEMENT
        said = f"No end of the front: the best {id}. {answer.outcome.detail}"
        failed = Outcome(status=status, detail=said.strip())
        if not ends and id == margins.ids[-1]:
            break  # there is nothing to start from
    return [ends[id] for id in margins.ids] if len(ends) == len(margins.ids) else failed


def _told(say: Say, before: str) -> Say:
    return lambda text: say(before + text)


def _ties_broken(designer: Designer, margins: Margins, ends: list[Design], say: Say) -> list[Design]:
    """The ends, or designs that are as good within ``TIE`` and better in what comes after."""
    signs, ids = margins.signs, margins.ids
    values = np.array([end.values for end in ends])
    reach = np.ptp(values, axis=0)
    found = []
    for k, end in enumerate(ends):
        kept = {ids[k]: float(end.values[k] - signs[k] * TIE * abs(end.values[k]))}
        for j in range(len(ids)):
            if j == k or reach[j] <= TIE * designer.scale(j) or designer.late:
                continue
            say(f"best {ids[k]}, and then {ids[j]}")
            other = designer.best(ids[j], kept, end.gains, float(end.values[j]), near=True)
            if other and signs[j] * (other.values[j] - end.values[j]) > WORTH * reach[j]:
                end = other
            kept = {**kept, ids[j]: float(end.values[j] - signs[j] * TIE * abs(end.values[j]))}
        found.append(end)
    return found


class _Search:
    """The points so far and what was tried."""

    def __init__(self, designer: Designer, margins: Margins, ends: Sequence[Design]) -> None:
        self.designer, self.margins = designer, margins
        values = np.array([end.values for end in ends])
        scales = [designer.scale(k) for k in range(len(ends))]
        self.cube: Cube = cube(margins.signs, values, scales)
        self.ends = list(ends)
        self.designs: list[Design] = []
        self.tried = Tried()
        self.unsolved = 0
        for end in ends:
            self._enter(end)

    @property
    def u(self) -> Array:
        """(n, k)."""
        return self.cube.of(np.array([each.values for each in self.designs]))

    def widest(self) -> Gap | None:
        """The gap to halve next."""
        found = [gap for gap in gaps(self.u, self.tried) if gap.length > SAME] if len(self.designs) > 1 else []
        return found[0] if found else None

    def halve(self, gap: Gap) -> None:
        """Seek a design in the ``gap``, and take note if there is none."""
        u, ids = self.u, self.margins.ids
        levels = {ids[k]: self.cube.value(k, at) for k, at in gap.levels.items()}
        found = self._sought(gap, u, levels)
        if found is None:
            self.unsolved += not self.designer.late
            self.tried.fail(u, gap)
            return
        its = self.cube.of(found.values)
        new = self._enter(found)
        if u.shape[1] == 2:
            ((k, at),) = gap.levels.items()
            if not new or its[k] > at + SAME:
                high = float(its[k]) if new else max(float(u[gap.i, k]), float(u[gap.j, k]))
                self.tried.empty.append((k, at, high))
        elif new:
            self.tried.close(u, gap)
        else:
            self.tried.fail(u, gap)

    def _sought(self, gap: Gap, u: Array, levels: dict[str, float]) -> Design | None:
        """From between the neighbours if they are close, then from the one that keeps more of the levels."""
        one, other = self.designs[gap.i], self.designs[gap.j]
        if min(u[gap.i, k] - at for k, at in gap.levels.items()) < min(
            u[gap.j, k] - at for k, at in gap.levels.items()
        ):
            one, other = other, one
        id, best = self.margins.ids[gap.best], gap.best
        scale = self.designer.scales
        starts = [(one.gains, one.values[best], False), (one.gains, one.values[best], True),
                  (other.gains, other.values[best], False)]  # fmt: skip
        apart = float(np.abs((np.array(one.gains) - np.array(other.gains)) / scale).max())
        if apart < CLOSE:
            middle = Gains(*(0.5 * (np.array(one.gains) + np.array(other.gains))))
            starts[0] = (middle, 0.5 * (one.values[best] + other.values[best]), apart < NEXT)
        for gains, value, near in starts:
            found = None if self.designer.late else self.designer.best(id, levels, gains, float(value), near=near)
            if found:
                return found
        return None

    def _enter(self, design: Design) -> bool:
        """Take ``design`` among the points, unless it is one of them or beaten; what it beats is sought again."""
        u = self.cube.of(design.values)
        beaten = [each for each in self.designs if beats(self.cube.of(each.values), u, BEATEN)]
        for each in beaten[:1]:
            again = self._again(design, each)
            if again is None or any(beats(self.cube.of(e.values), self.cube.of(again.values), BEATEN) for e in beaten):
                return False
            design, u = again, self.cube.of(again.values)
        if any(np.abs(self.cube.of(each.values) - u).max() < SAME for each in self.designs):
            return False
        for each in [each for each in self.designs if beats(u, self.cube.of(each.values), BEATEN)]:
            again = self._again(each, design)
            self.designs = [other for other in self.designs if other is not each]
            stays = again is not None and not beats(u, self.cube.of(again.values), BEATEN)
            if again is not None and stays:
                self.designs.append(again)
            self.ends = [
                end if end is not each else again if again is not None and stays else design for end in self.ends
            ]
        self.designs.append(design)
        return True

    def _again(self, design: Design, start: Design) -> Design | None:
        """The question that gave ``design``, asked again from ``start``."""
        value = start.values[self.margins.ids.index(design.asked)]
        return self.designer.best(design.asked, design.levels, start.gains, float(value))

    def finished(self, points: int, own: Gains | None) -> Outcome[Front]:
        """The front in order, and whether it is whole."""
        u = self.u
        order = [int(k) for k in np.argsort(-u[:, 0], kind="stable")]
        order = [k for k in order if self.designs[k] in self.ends or not any(beats(one, u[k], 1e-9) for one in u)]
        designs = [self.designs[k] for k in order]
        u = u[order]
        left = [gap for gap in gaps(u, Tried()) if gap.length > SAME] if len(designs) > 1 else []
        jumps = tuple(
            (gap.i, gap.j) for gap in left if u.shape[1] == 2
            and any(
                self.tried.top(k, *sorted((float(u[gap.i, k]), float(u[gap.j, k])))) < max(u[gap.i, k], u[gap.j, k])
                for k in gap.levels
            )
        )  # fmt: skip
        where = [self._place(end, u) for end in self.ends]
        far = outside(u, u[where])
        top = int(np.argmax(far))
        bent = far[top] > BENT and top not in where
        front = Front(
            margins=self.margins, designs=tuple(designs), u=u, ends=tuple(where), jumps=jumps, unsolved=self.unsolved,
            knee=(top, float(far[top])) if bent else None, own=None if own is None else self._own(own, u),
        )  # fmt: skip
        if len(designs) >= points or (not self.designer.late and not self.unsolved):
            return Outcome(status=Status.SOLVED, found=front)
        said = f"{len(designs)} of {points} points were found."
        return Outcome(status=Status.TIME_LIMIT if self.designer.late else Status.STALLED, detail=said, found=front)

    def _place(self, end: Design, u: Array) -> int:
        return int(np.argmin(np.abs(u - self.cube.of(end.values)).max(axis=1)))

    def _own(self, gains: Gains, u: Array) -> Own:
        values, met = self.designer.values(gains)
        better = (u - self.cube.of(np.where(np.isfinite(values), values, -self.margins.signs * 1e300))).min(axis=1)
        by = int(np.argmax(better))
        return Own(gains=gains, values=values, met=met, beaten=by if better[by] > 0 else None)
