"""The smallest conflict by deletion, and the smallest relaxation of each of its members and of each bound."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from design.analysis.objectives import OBJECTIVES
from design.analysis.survey import best_apart
from design.analysis.synthesis import Relaxation, WhyNot
from design.model.limits import Required
from design.spec.setting import Setting
from problems import gains
from problems.gains.goal import FEASIBILITY, GAIN_UNITS, GAINS, MORE
from problems.gains.grid import Grid
from problems.gains.question import Question
from problems.gains.starts import from_start, survey

Say = Callable[[str], None]

STARTS = 4
WIDER = 4.0
"""How many times as far bounds are opened to see whether that would do."""
DIGITS = 5
"""Digits to which a relaxation is rounded, to the side on which it is enough."""


def solve(
    setting: Setting, *, beside: Sequence[Setting] = (), seconds: float = 120.0, say: Say = lambda _: None
) -> WhyNot:
    """Say why ``setting``, known to be infeasible, cannot be met, also by the bodies ``beside`` it."""
    deadline = time.monotonic() + seconds
    asked = [id for id, wish in setting.required.items() if not wish.soft and _binds(id, wish)]
    conflict = list(asked)
    for id in asked:
        rest = [other for other in conflict if other != id]
        say(f"without {id}, as it is")
        met = feasible(_only(setting, rest), beside, deadline)
        if time.monotonic() > deadline:  # then not to have found a point means nothing
            return WhyNot(conflict=tuple(conflict), minimal=False, complete=False, relaxations=())
        if not met:
            conflict = rest
    relaxations = []
    for id in conflict:
        say(f"how much of {id} is possible beside the rest")
        found = _most(setting, id, beside, deadline)
        if found is not None:
            relaxations.append(found)
    for name in _tight(setting):
        say(f"whether other bounds of {name.rstrip(MORE)} would do")
        found = _wider(setting, name, beside, deadline)
        if found is not None:
            relaxations.append(found)
    complete = time.monotonic() <= deadline
    return WhyNot(conflict=tuple(conflict), minimal=True, complete=complete, relaxations=tuple(relaxations))


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


def feasible(setting: Setting, beside: Sequence[Setting], deadline: float) -> bool:
    """Whether a point that meets all requirements is found, on the coarse grid."""
    setting = replace(setting, objective="feasibility")
    question = Question(setting, [replace(world, required=setting.required) for world in beside])
    grid = Grid(question, question.coarse_step, FEASIBILITY)
    points, merit = survey(grid)
    instants = grid.thinned()
    for K in best_apart(points, merit, STARTS, question.lower, question.upper):
        if time.monotonic() > deadline:
            break
        value = float(merit[np.flatnonzero((points == K).all(axis=1))[0]])
        found, _ = from_start(grid, K, value, instants, deadline)
        if found.converged and found.point.v >= -1e-6:
            return True
    return False


def _most(setting: Setting, id: str, beside: Sequence[Setting], deadline: float) -> Relaxation | None:
    """The best value of requirement ``id`` beside the others."""
    others = [other for other in setting.required if other != id]
    loose = replace(_only(setting, others), objective=id)
    bodies = [replace(world, required=loose.required) for world in beside]
    answer = gains.solve(loose, seconds=max(deadline - time.monotonic(), 1.0), beside=bodies)
    if answer.outcome.found is None:
        return None
    row, given = OBJECTIVES[id], setting.required[id].level
    enough = _rounded(answer.outcome.found.value, down=row.sign > 0)
    return Relaxation(id=id, bound="", given=given, enough=enough, unit=row.unit)


def _tight(setting: Setting) -> list[str]:
    """The bounds that could be moved: upper ones, and lower ones above 0, of gains that the law has."""
    if setting.bounds is None:
        return []
    names = [name for k, name in enumerate(GAINS) if not (setting.law == "pd" and k == 2)]
    return names + [name + MORE for k, name in enumerate(GAINS) if name in names and setting.bounds[k, 0] > 0]


def _wider(setting: Setting, name: str, beside: Sequence[Setting], deadline: float) -> Relaxation | None:
    """Where the bound of a gain would have to be for all requirements; None where no such bound is found."""
    k, upper = GAINS.index(name.rstrip(MORE)), not name.endswith(MORE)
    assert setting.bounds is not None
    bounds = setting.bounds.copy()
    given = float(bounds[k, 1] if upper else bounds[k, 0])
    bounds[k, int(upper)] = max(WIDER * given, 1.0) if upper else 0.0
    open_ = replace(setting, bounds=bounds, objective=name, gains=None)
    bodies = [replace(world, bounds=bounds) for world in beside]
    answer = gains.solve(open_, seconds=max(deadline - time.monotonic(), 1.0), beside=bodies)
    if answer.outcome.found is None:
        return None
    value = answer.outcome.found.value
    if (value <= given) if upper else (value >= given):
        return None
    return Relaxation(
        id=GAINS[k], bound="upper" if upper else "lower", given=given, enough=_rounded(value, down=not upper),
        unit=GAIN_UNITS[k],
    )  # fmt: skip


def _rounded(value: float, *, down: bool) -> float:
    """``value`` to a few digits, on the side on which it is enough."""
    if value == 0 or not math.isfinite(value):
        return value
    unit = 10.0 ** (math.floor(math.log10(abs(value))) - DIGITS + 1)
    number = math.floor(value / unit) if down else math.ceil(value / unit)
    return float(f"{number * unit:.{DIGITS}g}")
