"""The smallest conflict by deletion, and the smallest relaxation of each of its members and of each bound."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from design import deadline
from design.analysis.objectives import OBJECTIVES
from design.analysis.survey import best_apart
from design.analysis.synthesis import Relaxation, Synthesis, WhyNot
from design.analysis.verdict import judge
from design.deadline import OutOfTime
from design.deadline import deadline as limited
from design.model.laws import Gains
from design.model.limits import Required
from design.spec.setting import Setting
from problems import gains
from problems.gains.direct import most_feasible
from problems.gains.goal import FEASIBILITY, GAIN_UNITS, GAINS, MORE
from problems.gains.grid import Grid
from problems.gains.question import Question
from problems.gains.starts import from_start, survey

Say = Callable[[str], None]

STARTS = 4
NEARLY = 1e-6
"""Smallest margin, in its scale, from which a requirement counts as met on the coarse grid."""
WIDER = 4.0
"""How many times as far bounds are opened to see whether that would do."""
DIGITS = 5
"""Digits to which a relaxation is rounded, to the side on which it is enough."""


def solve(
    setting: Setting, *, beside: Sequence[Setting] = (), seconds: float = 120.0, say: Say = lambda _: None
) -> WhyNot:
    """Say why no design was found for ``setting``, also for the bodies ``beside`` it."""
    end = time.monotonic() + seconds
    asked = tuple(id for id, wish in setting.required.items() if not wish.soft and _binds(id, wish))
    filtered = _Filtered(conflict=list(asked))
    try:
        with limited(end):
            _filter(setting, asked, beside, filtered, say)
            if not filtered.feasible:
                _relax(setting, beside, filtered, say)
            filtered.complete = True
    except OutOfTime:  # then not to have found a point means nothing
        pass
    conflict = tuple(filtered.conflict) if filtered.minimal else asked
    return WhyNot(
        conflict=conflict, minimal=filtered.minimal, complete=filtered.complete,
        relaxations=tuple(filtered.relaxations), feasible=tuple(filtered.feasible),
    )  # fmt: skip


@dataclass
class _Filtered:
    """What is known so far."""

    conflict: list[str]
    minimal: bool = False
    complete: bool = False
    relaxations: list[Relaxation] = field(default_factory=list)
    feasible: list[Gains] = field(default_factory=list)


def _filter(setting: Setting, asked: Sequence[str], beside: Sequence[Setting], filtered: _Filtered, say: Say) -> None:
    """Leave out of the conflict each requirement without which still no design is found."""
    for id in asked:
        rest = [other for other in filtered.conflict if other != id]
        say(f"without {id}, as it is")
        point = feasible(_only(setting, rest), beside)
        if point is None:
            filtered.conflict = rest
        elif _keeps_all(setting, beside, point):
            filtered.feasible.append(point)
            return
    filtered.minimal = True


def _relax(setting: Setting, beside: Sequence[Setting], filtered: _Filtered, say: Say) -> None:
    """How far each requirement of the conflict, and each bound, would have to give way."""
    for id in filtered.conflict:
        say(f"how much of {id} is possible beside the rest")
        found = _most(setting, id, beside)
        if found is not None and _keeps_all(setting, beside, found.design):
            filtered.feasible.append(found.design)
            return
        if found is not None:
            filtered.relaxations.append(found)
    for name in _tight(setting):
        say(f"whether other bounds of {name.rstrip(MORE)} would do")
        found = _wider(setting, name, beside)
        if found is not None:
            filtered.relaxations.append(found)


def _keeps_all(setting: Setting, beside: Sequence[Setting], gains: Gains) -> bool:
    """Whether ``gains`` are within the bounds and meet the whole specification, at full resolution."""
    assert setting.bounds is not None
    K = np.array(gains)
    own = ~np.isnan(setting.bounds).any(axis=1)
    if (K[own] < setting.bounds[own, 0]).any() or (K[own] > setting.bounds[own, 1]).any():
        return False
    bodies = [setting, *[replace(world, required=setting.required) for world in beside]]
    return all(judge(body, gains).overall == "met" for body in bodies)


def _binds(id: str, wish: Required) -> bool:
    """Whether a requirement asks more than what is always asked."""
    return not (id in ("contact-force", "decay-rate", "cop-margin") and wish.level <= 0)


def _only(setting: Setting, ids: Sequence[str]) -> Setting:
    """The setting with only those requirements, and what is always asked."""
    kept = {
        id: wish if id in ids or wish.soft or not _binds(id, wish) else Required(level=0.0)
        for id, wish in setting.required.items()
        if id in ids or wish.soft or id in ("contact-force", "decay-rate", "cop-margin")
    }
    return replace(setting, required=kept)


def feasible(setting: Setting, beside: Sequence[Setting] = ()) -> Gains | None:
    """Gains that meet all requirements on the coarse grid, or None where none were found."""
    setting = replace(setting, objective="feasibility")
    question = Question(setting, [replace(world, required=setting.required) for world in beside])
    grid = Grid(question, question.coarse_step, FEASIBILITY)
    points, merit = survey(grid)
    instants = grid.thinned()
    seeds, misses = best_apart(points, merit, STARTS, question.lower, question.upper), []
    for K in seeds:
        deadline.check()
        value = float(merit[np.flatnonzero((points == K).all(axis=1))[0]])
        found, _ = from_start(grid, K, value, instants, deadline.ends())
        if found.converged and found.point.v >= -NEARLY:
            return Gains(*map(float, found.point.gains))
        if found.converged:
            misses.append(np.array(found.point.gains))
    K, margin = most_feasible(grid, np.array([*misses, *seeds]))
    return Gains(*map(float, K)) if margin >= -NEARLY else None


def _most(setting: Setting, id: str, beside: Sequence[Setting]) -> Relaxation | None:
    """The best value of requirement ``id`` beside the others."""
    others = [other for other in setting.required if other != id]
    loose = replace(_only(setting, others), objective=id)
    bodies = [replace(world, required=loose.required) for world in beside]
    design = _design(loose, bodies)
    if design is None:
        return None
    row, given = OBJECTIVES[id], setting.required[id].level
    enough = _rounded(design.value, down=row.sign > 0)
    return Relaxation(id=id, bound="", given=given, enough=enough, unit=row.unit, design=design.gains)


def _design(setting: Setting, bodies: Sequence[Setting]) -> Synthesis | None:
    """The best design, or the best that was checked: it is enough where its optimality is not confirmed too."""
    answer = gains.solve(setting, seconds=deadline.left(), beside=bodies)
    deadline.check()
    return answer.outcome.found or answer.best


def _tight(setting: Setting) -> list[str]:
    """The bounds that could be moved: upper ones, and lower ones above 0, of gains that the law has."""
    if setting.bounds is None:
        return []
    names = [name for k, name in enumerate(GAINS) if not (setting.law == "pd" and k == 2)]
    return names + [name + MORE for k, name in enumerate(GAINS) if name in names and setting.bounds[k, 0] > 0]


def _wider(setting: Setting, name: str, beside: Sequence[Setting]) -> Relaxation | None:
    """Where the bound of a gain would have to be for all requirements; None where no such bound is found."""
    k, upper = GAINS.index(name.rstrip(MORE)), not name.endswith(MORE)
    assert setting.bounds is not None
    bounds = setting.bounds.copy()
    given = float(bounds[k, 1] if upper else bounds[k, 0])
    bounds[k, int(upper)] = max(WIDER * given, 1.0) if upper else 0.0
    open_ = replace(setting, bounds=bounds, objective=name, gains=None)
    bodies = [replace(world, bounds=bounds) for world in beside]
    design = _design(open_, bodies)
    if design is None:
        return None
    value = design.value
    if (value <= given) if upper else (value >= given):
        return None
    return Relaxation(
        id=GAINS[k], bound="upper" if upper else "lower", given=given, enough=_rounded(value, down=not upper),
        unit=GAIN_UNITS[k], design=design.gains,
    )  # fmt: skip


def _rounded(value: float, *, down: bool) -> float:
    """``value`` to a few digits, on the side on which it is enough."""
    if value == 0 or not math.isfinite(value):
        return value
    unit = 10.0 ** (math.floor(math.log10(abs(value))) - DIGITS + 1)
    number = math.floor(value / unit) if down else math.ceil(value / unit)
    return float(f"{number * unit:.{DIGITS}g}")
