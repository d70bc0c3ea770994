"""Why a specification cannot be met by any gains within its bounds: necessary conditions that need no optimiser.

Each obstacle is a proof. None found proves nothing. With sigma the required decay rate and the poles of (24) at
-sigma or left of it, the shifted polynomial has q_2, q_1, q_0 >= 0, so that p_2 >= 3 sigma, p_1 >= 3 sigma² and
p_0 >= sigma³; each p_i of (25) is largest at a corner of the gain bounds. (29) divided by K_p K_d ell reads
1 - K_f I/(ell K_d) - A L/K_p > 0, and its left side is largest at the corner (K_p, K_d high, K_f low).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from design.model.environment import Scenario
from design.model.limits import Required
from design.model.stability import characteristic, deciding_points, routh_hurwitz
from design.spec.setting import Setting


@dataclass(frozen=True, kw_only=True)
class Obstacle:
    """A requirement that stands in the way: ``value`` is the best that can be, ``required`` the demand, in ``unit``."""

    id: str
    scenario: str | None
    value: float
    required: float
    unit: str
    why: str

    def __str__(self) -> str:
        place = f" in scenario {self.scenario!r}" if self.scenario else ""
        return f"{self.id}{place}: at best {self.value:.6g} {self.unit}, needs {self.required:.6g}; {self.why}"


def obstacles(setting: Setting) -> list[Obstacle]:
    """All obstacles that are found, for ``setting`` with gain bounds."""
    return [
        *_foot(setting),
        *(obstacle for scenario in setting.scenarios for obstacle in _load(setting, scenario)),
        *(obstacle for scenario in setting.scenarios for obstacle in _capture(setting, scenario)),
        *(obstacle for scenario in setting.scenarios for obstacle in _poles(setting, scenario)),
    ]


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
    """F_T + F_H is the load; at theta = 0 and omega = 0, and in the final stationary posture, no gain changes it."""
    level = _level(setting, "contact-force")
    ends = {"at the end": float(setting.biped.weight - scenario.steps(scenario.duration).force[1, -1])}
    if scenario.theta0 == 0.0 and scenario.omega0 == 0.0:
        first = scenario.force_on(scenario.pieces()[0], np.array([0.0]))
        ends["at t = 0"] = float(setting.biped.weight - first[1, 0])
    for when, total in ends.items():
        if 0.5 * total < level or total <= 0:
            reason = (
                "gravity no longer presses the foot on the ground; lower the slope or the lifting force"
                if total <= 0
                else "toe and heel share the load, so the smaller has at most half; lower contact_force_n"
            )
            yield Obstacle(
                id="contact-force", scenario=scenario.name, value=0.5 * total, required=level, unit="N",
                why=f"{when}, {reason}",
            )  # fmt: skip
            return


def _capture(setting: Setting, scenario: Scenario) -> Iterator[Obstacle]:
    """From rest under a force that is constant from t = 0, when the weight's line misses the foot.

    With e = theta - theta_f on the side of theta, and the load at most that at rest, the body is accelerated away
    whatever the ankle does, and the more the farther it has gone.
    """
    if len(scenario.breakpoints) or np.ptp(scenario.signal, axis=1).any():
        return
    biped, level = setting.biped, _level(setting, "contact-force")
    F_x, F_y = scenario.force_on((0.0, scenario.duration), np.array([0.0]))[:, 0]
    theta_f = float(np.arctan2(-F_x, biped.M * biped.g - F_y))
    A = float(np.hypot(biped.M * biped.g - F_y, F_x))
    lean = scenario.theta0 - theta_f
    side = np.sign(lean)
    needed = A * biped.L * np.sin(abs(lean))
    available = biped.ell * max(biped.weight - F_y - 2 * level, 0.0)
    away = side * scenario.theta0 >= 0 and side * scenario.omega0 >= 0
    if away and abs(lean) < 0.5 * np.pi and needed > available:
        reach = float(np.degrees(np.arcsin(min(available / (A * biped.L), 1.0))))
        yield Obstacle(
            id="step-slope", scenario=scenario.name, value=reach, required=float(np.degrees(abs(lean))), unit="deg",
            why=(
                f"the resultant force passes {biped.L * np.sin(abs(lean)):.4g} m from the ankle and the foot"
                f" holds {available / A:.4g} m (capturability: no ankle controller can keep contact)"
            ),
        )  # fmt: skip


def _poles(setting: Setting, scenario: Scenario) -> Iterator[Obstacle]:
    if setting.bounds is None:
        return
    biped, kind = setting.biped, setting.law
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
