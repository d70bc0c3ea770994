"""The point of the box of [uncertainty] that is worst for a design: corners, spread points, and descent from the best.

Margins are those of the program (``problems.gains``), each in its scale: what is required, or what the objective v
claims. Runs of many bodies are marched at once; rows without samples are looked at in the corners.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from design.analysis.many import Extremes, extremes
from design.analysis.spread import in_box
from design.analysis.survival import HORIZON, push, step_slope
from design.analysis.transient import BAND
from design.model.environment import Scenario, slope
from design.model.laws import Gains
from design.model.uncertainty import Spread, Tolerances
from design.spec.setting import Setting
from problems.gains.approach import BANDS, asked
from problems.gains.goal import Goal
from problems.gains.modelled import margins, wanted
from problems.gains.pieces import values
from problems.gains.question import APPROACH, SURVIVALS, Question, environments

Array = NDArray[np.float64]

INSIDE = 32
"""Points inside the box that are looked at beside its corners."""
FEW = 32
"""Corners in which rows are looked at that take longer."""
CLOSE = 0.03
"""Margin, in its scale, up to which the way downhill from a point is followed."""
STEPS = 6


@dataclass(frozen=True, kw_only=True)
class Weak:
    """Where a row is worst: ``shares`` (7) of the half-widths, and its ``margin`` there in its scale.

    ``scenario`` is None for a row that belongs to none.
    """

    id: str
    scenario: str | None
    shares: tuple[float, ...]
    margin: float


def weakest(question: Question, goal: Goal, gains: Gains, v: float, step: float) -> list[Weak]:
    """The worst point of the box for every row that is required or claimed, in every scenario; worst first."""
    setting = question.setting
    points = in_box(setting.tolerances, INSIDE)
    found = [
        weak for scenario in setting.scenarios for weak in _along(question, goal, v, scenario, gains, points, step)
    ]
    found += _poles(question, goal, gains, v, points)
    found += _survivals(question, goal, gains, v, points, step)
    found += _modelled(question, goal, gains, v, points, step)
    return sorted(found, key=lambda weak: weak.margin)


def world(setting: Setting, shares: Sequence[float], scenario: str | None = None) -> Setting:
    """The setting of one body and world of the box, in one scenario or all; the law knows the nominal body."""
    chosen = [each for each in setting.scenarios if scenario is None or each.name == scenario]
    drawn = [setting.tolerances.drawn(setting.biped, each, shares) for each in chosen]
    return replace(setting, biped=drawn[0][0], scenarios=tuple(its for _, its in drawn), known=setting.biped)


def runs(
    setting: Setting, scenario: Scenario, gains: Gains, shares: Array, step: float, impulse: float = 0.0,
    paths: bool = False,
) -> Extremes:  # fmt: skip
    """The runs of many bodies of the box through one scenario; with ``paths``, how they come to their final posture."""
    return extremes(
        setting.under(scenario).biped, setting.law, gains, scenario, setting.tolerances, shares, step=step,
        theta_d=setting.theta_d, target=setting.target, adapt=setting.adapt, impulse=impulse, paths=paths,
    )  # fmt: skip


def sampled_margins(question: Question, goal: Goal, v: float, found: Extremes) -> dict[str, Array]:
    """Margins (N,) of the limits along the runs, by row: against the hard level, the objective, and the soft one."""
    scales = {limit.id: limit.scale for limit in question.limits}
    seen = {"toe-force": found.toe, "heel-force": found.heel, "cop-margin": found.cop, "torque": found.torque,
            "friction": found.friction}  # fmt: skip
    margins: dict[str, Array] = {}
    for limit in question.limits:
        value = seen[limit.id]
        rows = []
        if limit.hard_level is not None:
            rows.append(limit.margin(value, limit.hard_level) / scales[limit.id])
        if limit.id in goal.limits:
            rows.append(goal.sign * value / limit.scale - v)
        if goal.id == "goals" and limit.required is not None and limit.required.soft:
            id = "contact-force" if limit.id in ("toe-force", "heel-force") else limit.id
            rows.append(limit.margin(value, limit.required.level) / question.size_of(id) - v)
        if rows:
            margins[limit.id] = np.min(rows, axis=0)
    return margins | {id: margin for id in path_ids(question, goal) for margin in _path(question, goal, v, found, id)}


def path_ids(question: Question, goal: Goal) -> list[str]:
    """Those rows of the program that are about the whole of a run."""
    return [id for id in (*APPROACH, "torque-rate") if question.asks(goal, id)]


def _path(question: Question, goal: Goal, v: float, found: Extremes, id: str) -> list[Array]:
    """The margin (N,) of such a row, none where the objective has no value."""
    if id == "torque-rate":
        pairs = asked(question, goal, id, found.rate)
    elif found.paths is None:
        return []
    elif id == "settling":
        band = BAND * found.paths.farthest
        return [
            np.where(np.isfinite(band), (band - found.paths.distance(T)) / (BANDS * np.maximum(band, 1e-9)), -1.0)
            for T in _longest(question, goal, v)
        ]
    else:
        value = found.paths.overshoot() if id == "overshoot" else found.paths.error
        pairs = asked(question, goal, id, np.degrees(value))
    return [row - of * v if of else row for row, of in pairs if not of or math.isfinite(v)]


def _longest(question: Question, goal: Goal, v: float) -> list[float]:
    """The settling time [s] that is required, or that the objective ``v`` is."""
    level, wish = question.level("settling"), question.wish("settling")
    if goal.id == "settling":
        return [max(goal.value(v), 0.0)] if math.isfinite(v) else []
    if level is not None:
        return [level]
    return [max(wish - v * question.size_of("settling"), 0.0)] if wish is not None and math.isfinite(v) else []


def _along(
    question: Question, goal: Goal, v: float, scenario: Scenario, gains: Gains, points: Array, step: float
) -> list[Weak]:
    """The worst points of the rows along the runs through ``scenario``."""
    setting, paths = question.setting, bool(path_ids(question, goal))

    def all_margins(shares: Array) -> dict[str, Array]:
        return sampled_margins(question, goal, v, runs(setting, scenario, gains, shares, step, paths=paths))

    first = all_margins(points)
    found = []
    for id, its in first.items():
        at, margin = points[int(np.argmin(its))], float(its.min())
        if margin < CLOSE:
            at, margin = downhill(lambda shares, id=id: all_margins(shares)[id], at, margin, setting.tolerances)  # type: ignore[misc]
        found.append(Weak(id=id, scenario=scenario.name, shares=tuple(at.tolist()), margin=margin))
    return found


def downhill(
    margins: Callable[[Array], Array], at: Array, margin: float, tolerances: Tolerances
) -> tuple[Array, float]:
    """A worse point near ``at``: steps along the measured slope, inside the box."""
    free = tolerances.moving
    reach = 0.25
    for _ in range(STEPS):
        offsets = np.zeros((2 * len(free), 7))
        for row, k in enumerate(free):
            offsets[2 * row, k], offsets[2 * row + 1, k] = 0.05, -0.05
        around = np.clip(at + offsets, -1, 1)
        near = margins(around)
        width = (around[0::2] - around[1::2])[np.arange(len(free)), free]
        slope = np.zeros(7)
        slope[free] = (near[0::2] - near[1::2]) / width
        if not np.isfinite(slope).all() or not np.abs(slope).max() > 0:
            break
        way = -slope / np.abs(slope).max()
        trials = np.clip(at + np.outer([0.25, 0.5, 1.0, 2.0], reach * way), -1, 1)
        trials = np.vstack([trials, np.where(np.abs(way) > 1e-3, np.sign(way), at), around])
        its = margins(trials)
        best = int(np.argmin(its))
        if not its[best] < margin - 1e-9:
            break
        at, margin = trials[best], float(its[best])
    return at, margin


def _poles(question: Question, goal: Goal, gains: Gains, v: float, points: Array) -> list[Weak]:
    """The worst decay rate, and with that goal the worst of (27)-(29)."""
    setting = question.setting
    claimed, wish = question.decay, question.wish("decay-rate")
    if goal.id == "decay-rate":
        claimed = v * question.pace
    elif goal.id == "goals" and wish is not None:
        claimed = max(claimed, wish + v * question.size_of("decay-rate"))
    costly = setting.law == "cop" or math.isfinite(setting.adapt) or not setting.plain
    margins, slacks = [], []
    looked = points[: 1 + FEW] if costly else points
    for shares in looked:
        places = environments(world(setting, shares.tolist()))
        rate = min(-float(np.roots([1.0, *each.coefficients(gains)]).real.max()) for each in places)
        margins.append((rate - claimed) / question.pace)
        slacks.append(min(float(slack) for each in places for slack in each.slacks(gains)) - v)
    worst = int(np.argmin(margins))
    found = [Weak(id="decay-rate", scenario=None, shares=tuple(looked[worst].tolist()), margin=float(margins[worst]))]
    if goal.id == "routh-margin":
        worst = int(np.argmin(slacks))
        found.append(
            Weak(id="routh-margin", scenario=None, shares=tuple(looked[worst].tolist()), margin=float(slacks[worst]))
        )
    return found


def survival_size(question: Question, goal: Goal, kind: str, v: float) -> float | None:
    """The disturbance that must be survived: required, wished for, or claimed; None where nothing is asked."""
    level, wish = question.level(kind), question.wish(kind)
    if goal.id == kind:
        return goal.value(v)
    if goal.id == "goals" and wish is not None:
        return wish + v * question.size_of(kind)
    return level


def _survivals(question: Question, goal: Goal, gains: Gains, v: float, points: Array, step: float) -> list[Weak]:
    """The worst bodies under the sudden slope and push that must be survived."""
    setting, found = question.setting, []
    for kind in SURVIVALS:
        size = survival_size(question, goal, kind, v)
        if size is None or size <= 0:
            continue
        if setting.plain and not setting.theta_d:
            angle = math.radians(size) if kind == "step-slope" else 1e-9
            bare = replace(setting, tolerances=replace(setting.tolerances, slope=Spread(), ramp=Spread()))
            scenario = slope(setting.biped, name=kind, angle=angle, ramp=0.0, duration=HORIZON)

            def margins(
                shares: Array, bare: Setting = bare, scenario: Scenario = scenario, size: float = size, kind: str = kind
            ) -> Array:
                its = runs(bare, scenario, gains, shares, step, impulse=size if kind == "push" else 0.0)
                return np.minimum(its.toe, its.heel) / setting.biped.weight

            first = margins(points)
            at, margin = points[int(np.argmin(first))], float(first.min())
            if margin < CLOSE and bare.tolerances.moving:
                at, margin = downhill(margins, at, margin, bare.tolerances)
        else:
            find = step_slope if kind == "step-slope" else push
            looked = points[: 1 + FEW]
            unit = math.pi / 180 if kind == "step-slope" else 1.0
            foot = setting.in_a_field() if kind == "step-slope" else setting
            its = [
                find(world(foot, shares.tolist()).loop(), gains, step).survived / unit / size - 1 for shares in looked
            ]
            at, margin = looked[int(np.argmin(its))], float(min(its))
        found.append(Weak(id=kind, scenario=None, shares=tuple(at.tolist()), margin=margin))
    return found


def _modelled(question: Question, goal: Goal, gains: Gains, v: float, points: Array, step: float) -> list[Weak]:
    """The worst corners of the rows that have no samples."""
    ids = wanted(question, goal)
    if not ids:
        return []
    worst: dict[str, Weak] = {}
    for shares in points[: 1 + FEW]:
        one = Question(world(question.setting, shares.tolist()))
        found = values(one, ids, np.array(gains), step)
        for id in ids:
            if found is None:
                margin = -1.0
            else:
                margin = min(
                    (
                        row - of * v
                        for (its, _, gap), pieces in found.items()
                        if its == id and not gap
                        for piece in pieces
                        for row, of in margins(question, goal, id, piece.value)
                    ),
                    default=math.inf,
                )
            if id not in worst or margin < worst[id].margin:
                worst[id] = Weak(id=id, scenario=None, shares=tuple(shares.tolist()), margin=float(margin))
    return list(worst.values())


def named(setting: Setting, shares: Sequence[float]) -> dict[str, float]:
    """The uncertain numbers of a point of the box, by their keys in the spec, in its units."""
    keys = ("mass_kg", "com_height_m", "inertia_kgm2", "foot_mass_kg", "half_length_m", "slope_deg", "ramp_s")
    found = {}
    for k in setting.tolerances.moving:
        name = fields(Tolerances)[k].name
        its: Spread = getattr(setting.tolerances, name)
        if name in ("slope", "ramp"):
            unit = 180 / math.pi if name == "slope" else 1.0
            found[keys[k]] = unit * shares[k] * (its.absolute or its.part)
        else:
            found[keys[k]] = its.around(getattr(setting.biped, name), shares[k])
    return found
