"""Why a specification cannot be met by any gains within its bounds: necessary conditions that need no optimiser.

Each obstacle is a proof. None found proves nothing. With sigma the required decay rate and the poles of (24) at
-sigma or left of it, the shifted polynomial has q_2, q_1, q_0 >= 0, so that p_2 >= 3 sigma, p_1 >= 3 sigma² and
p_0 >= sigma³; each p_i of (25) is largest at a corner of the gain bounds. (29) divided by K_p K_d ell reads
1 - K_f I/(ell K_d) - A L/K_p > 0, and its left side is largest at the corner (K_p, K_d high, K_f low).
That the body falls whatever the ankle does is proved by ``design.analysis.capture``.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np

from design.analysis.beyond import Beyond, beyond
from design.analysis.capture import Ankle, falls_to
from design.analysis.survival import push_limit, slope_limit
from design.model.deciding import deciding_points
from design.model.environment import Scenario
from design.model.limits import Required
from design.model.stability import characteristic, routh_hurwitz
from design.spec.setting import Setting

CAPTURE = "capture"
"""Id of the obstacle that no ankle survives a scenario."""


@dataclass(frozen=True, kw_only=True)
class Obstacle:
    """A requirement that stands in the way: ``value`` is the best that can be, ``required`` the demand, in ``unit``."""

    id: str
    scenario: str | None
    value: float
    required: float
    unit: str
    why: str
    physical: bool = False
    """Whether no gains and no requirement stand in the way, but the body, the foot and the scenario themselves."""

    def __str__(self) -> str:
        if self.id == CAPTURE:
            return self.why
        place = f" in scenario {self.scenario!r}" if self.scenario else ""
        return f"{self.id}{place}: at best {self.value:.6g} {self.unit}, needs {self.required:.6g}; {self.why}"


def obstacles(setting: Setting) -> list[Obstacle]:
    """All obstacles that are found, for ``setting`` with gain bounds; those of capture only where there are no others.

    What is said of poles holds for the paper's foot with P_d = 0.
    """
    loads = [obstacle for scenario in setting.scenarios for obstacle in _load(setting, scenario)]
    simple = [*_foot(setting), *loads]
    if setting.plain:
        simple += _survival(setting)
        simple += [obstacle for scenario in setting.scenarios for obstacle in _poles(setting, scenario)]
    return simple or list(_capture(setting))


def _level(setting: Setting, id: str) -> float:
    """The hard level of a requirement from below; soft ones bind nothing, contact and stability always need >= 0."""
    wish = setting.required.get(id, Required(level=0.0))
    return 0.0 if wish.soft else wish.level


def _foot(setting: Setting) -> Iterator[Obstacle]:
    level, ell = _level(setting, "cop-margin"), setting.biped.ell
    if level > ell:
        yield Obstacle(
            id="cop-margin", scenario=None, value=ell, required=level, unit="m",
            why="no point of the foot is farther from both ends than its middle; lengthen the foot",
        )  # fmt: skip


def _load(setting: Setting, scenario: Scenario) -> Iterator[Obstacle]:
    """F_T + F_H is the load; where no gain changes it, half of it must reach the level.

    At theta = 0 and omega = 0 f_y does not depend on the torque. Later, while the force rests at its last value for a
    time T, the height y = L cos(theta) must be accelerated by at least a = (2 level - load at rest)/M; if a > 0, no y
    within [-L, L] can do so for longer than T = 4 sqrt(L/a).
    """
    level, biped = _level(setting, "contact-force"), setting.under(scenario).biped
    found = []
    if scenario.theta0 == 0.0 and scenario.omega0 == 0.0:
        first = scenario.force_on(scenario.pieces()[0], np.array([0.0]))
        total = float(biped.load(first[1, 0]))
        if 0.5 * total < level:
            found.append(("at t = 0", total))
    last = scenario.pieces()[-1]
    if not np.ptp(scenario.signal_on(last, np.array(last)), axis=1).any():
        total = float(biped.load(scenario.force_on(last, np.array(last))[1, -1]))
        upward = (2 * level - total) / biped.M
        if upward * (last[1] - last[0]) ** 2 > 16 * biped.L:
            found.append(("at rest in the end", total))
    for when, total in found[:1]:
        reason = (
            "gravity no longer presses the foot on the ground; lower the slope or the lifting force"
            if total <= 0
            else "toe and heel share the load, so the smaller has at most half; lower contact_force_n"
        )
        yield Obstacle(
            id="contact-force", scenario=scenario.name, value=0.5 * total, required=level, unit="N",
            why=f"{when}, {reason}",
        )  # fmt: skip


def _survival(setting: Setting) -> Iterator[Obstacle]:
    """A sudden slope or a push from rest of which the report counts no more as survived than any ankle survives."""
    slope = math.degrees(slope_limit(setting.in_a_field().biped))
    for id, limit, unit in (("step-slope", slope, "deg"), ("push", push_limit(setting.biped), "N s")):
        level = _level(setting, id)
        if level > limit:
            yield Obstacle(
                id=id, scenario=None, value=limit, required=level, unit=unit,
                why="no ankle with this foot survives more from rest (capturability); lower it, or lengthen the foot",
            )  # fmt: skip


def _capture(setting: Setting) -> Iterator[Obstacle]:
    for each, physical in beyond_ankles(setting):
        yield Obstacle(
            id=CAPTURE, scenario=each.scenario, value=each.survivable, required=each.size, unit=each.unit,
            why=each.sentence(setting.biped), physical=physical,
        )  # fmt: skip


def beyond_ankles(setting: Setting, names: Collection[str] | None = None) -> Iterator[tuple[Beyond, bool]]:
    """The scenarios, of those called ``names``, that no ankle survives which keeps the hard requirements.

    And whether none does that only keeps the foot on the ground, with any torque.
    """
    torque = setting.required.get("torque")
    ankle = Ankle(
        level=_level(setting, "contact-force"), margin=_level(setting, "cop-margin"),
        torque=math.inf if torque is None or torque.soft else torque.level, at_rest=_rests(setting),
    )  # fmt: skip
    if 2 * ankle.level >= setting.biped.weight or ankle.margin > setting.biped.ell:
        return  # nothing on the foot can do that, whatever the scenario
    for scenario in setting.scenarios:
        if names is not None and scenario.name not in names:
            continue
        biped = setting.under(scenario).biped
        side = falls_to(biped, scenario, ankle)
        if side:
            bare = Ankle(at_rest=ankle.at_rest)
            yield beyond(biped, scenario, ankle, side), falls_to(biped, scenario, bare) != 0


def _rests(setting: Setting) -> bool:
    """Whether the law leaves an upright body alone that no force acts on: the torque is 0, and so is F_H - F_T."""
    known = setting.known or setting.biped
    return setting.theta_d == 0.0 and (setting.law == "pd" or (setting.plain and known.plain))


def _poles(setting: Setting, scenario: Scenario) -> Iterator[Obstacle]:
    if setting.bounds is None or math.isfinite(setting.adapt):  # (27)-(29) are then not necessary
        return
    biped, kind = setting.under(scenario).biped, setting.law
    low, high = setting.bounds[:, 0], setting.bounds[:, 1]
    best = (high[0], high[1], low[2])
    sigma = _level(setting, "decay-rate")
    names = {"stiffness": ("N m/rad", "raise the upper bound of kp"),
             "damping": ("N m s/rad" if kind == "pd" else "m/s", "raise the upper bound of kd, or lower that below kf"),
             "routh": ("N² m² s", "raise the upper bound of kp or kd, or lower the lower one of kf")}  # fmt: skip
    for A, load in zip(*deciding_points(kind, *scenario.operating_points(biped)), strict=True):
        for row, pairs in routh_hurwitz(biped, kind, best, A, load).items():
            left, right = pairs[0]
            if left <= right:
                unit, mend = names[row]
                yield Obstacle(
                    id=row, scenario=scenario.name, value=left, required=right, unit=unit,
                    why=f"even at kp = {best[0]:g}, kd = {best[1]:g}, kf = {best[2]:g}; {mend}",
                )  # fmt: skip
                return
        if kind != "pd" and high[2] <= 0:
            yield Obstacle(
                id="damping", scenario=scenario.name, value=0.0, required=0.0, unit="m/s",
                why="(28) needs K_f > 0, and the upper bound of kf is 0; raise it, or use law pd",
            )  # fmt: skip
            return
        p = characteristic(biped, kind, best, A, load)
        if kind == "pd":
            reach = {"kd": p[0] / 2, "kp": float(np.sqrt(max(p[1], 0.0)))}
        else:
            p_0 = characteristic(biped, kind, high, A, load)[2]
            reach = {"kd": p[0] / 3, "kp": float(np.sqrt(max(p[1], 0.0) / 3)), "kf": float(np.cbrt(p_0))}
        gain = min(reach, key=lambda name: reach[name])
        if reach[gain] < sigma:
            yield Obstacle(
                id="decay-rate", scenario=scenario.name, value=reach[gain], required=sigma, unit="1/s",
                why=f"the bounds of {gain} allow no more; widen them",
            )  # fmt: skip
            return
