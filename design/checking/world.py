"""What a spec's text says: the body, the demands, and the signal of each scenario, in the decimals that are written.

The parameters that may move are, by name: M, L, I, m, ell [SI], slope (a slope's final angle, in degrees) and ramp (the
time in which a slope or a force grows [s]). A *box* gives each its middle and half-width. ``tomllib`` reads the text;
what a spec may hold beyond what is needed here is the loader's to judge.
"""

from __future__ import annotations

import re
import tomllib
from bisect import bisect_right
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from typing import Any

from design.checking import Malformed, need
from design.checking.balls import decimal

Box = dict[str, tuple[Fraction, Fraction]]
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_. -]{0,63}")
LARGEST = 10**40  # numbers beyond this are none of a body or its world
Corner = tuple[Fraction, tuple[Fraction, ...]]
NAMES = {"M": "mass_kg", "L": "com_height_m", "I": "inertia_kgm2", "m": "foot_mass_kg", "ell": "half_length_m",
         "slope": "slope_deg", "ramp": "ramp_s"}  # fmt: skip
DEMANDS = {"contact_force_n": ("toe-force", "heel-force"), "cop_margin_m": ("cop-margin",),
           "decay_rate_per_s": ("decay-rate",), "torque_nm": ("torque",)}  # fmt: skip


@dataclass(frozen=True)
class Segment:
    """A time in which the signal is linear [s], and the signal at its ends; ``grows`` if it is part of the ramp."""

    length: Fraction
    first: tuple[Fraction, ...]
    last: tuple[Fraction, ...]
    grows: bool


def read(text: str) -> dict[str, Any]:
    """The tables of the spec, every number a fraction."""
    tables: dict[str, Any] = _exact(tomllib.loads(text.removeprefix("\ufeff"), parse_float=decimal))
    names = [table["name"] for table in tables["scenarios"]]
    for k, name in enumerate([*names, tables["name"]]):
        if not isinstance(name, str) or not NAME.fullmatch(name):
            message = f"{str(name)[:64]!r} is no name; needs 1 to 64 letters, digits, spaces, or any of _ . -"
            raise Malformed(message)
        if k < len(names) and name in names[:k]:
            message = f"its spec has two scenarios that are called {name!r}; rename one"
            raise Malformed(message)
    foot, law = tables["foot"], tables["law"]
    need(foot.get("ankle_height_m", 0) == 0 == law.get("cop_target_m", 0), "an ankle or a target that is not at 0")
    need(isinstance(foot.get("ground_loads", False), bool), "a foot.ground_loads that is neither true nor false")
    need(foot.keys().isdisjoint(("toe_m", "heel_m")), "a foot that is not told by its half length")
    return tables


def _exact(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _exact(part) for key, part in value.items()}
    if isinstance(value, list):
        return [_exact(part) for part in value]
    return number(value) if isinstance(value, int | Fraction) and not isinstance(value, bool) else value


def number(value: Any) -> Fraction:
    """A number that was read as such, and is of a size that has a meaning; raises ``Malformed``."""
    if isinstance(value, bool) or not isinstance(value, int | Fraction) or not -LARGEST <= value <= LARGEST:
        message = f"{str(value)[:40]!r} is no number up to 1e40, written without quotes"
        raise Malformed(message)
    return Fraction(value)


def gravity(spec: dict[str, Any]) -> Fraction:
    """The acceleration g [m/s²]."""
    return Fraction(spec.get("simulation", {}).get("gravity_mps2", Fraction("9.81")))


def demands(spec: dict[str, Any]) -> dict[str, Fraction]:
    """What must be claimed at least, by row; ``torque`` is from above, and only where the spec has it."""
    table, found = spec.get("requirements", {}), {}
    for key, rows in DEMANDS.items():
        wish = table.get(key, {})
        level = wish if isinstance(wish, Fraction) else wish.get("min", wish.get("max"))
        hard = isinstance(wish, Fraction) or not wish.get("soft", False)
        if key != "torque_nm" or (hard and level is not None):
            found.update(dict.fromkeys(rows, level if hard and level is not None else Fraction(0)))
    return found


def whole_box(spec: dict[str, Any], scenario: dict[str, Any], scale: Fraction) -> Box:
    """``scale`` times the box of [uncertainty] around the spec's numbers; what a scenario lacks does not move."""
    body, foot = spec["body"], spec["foot"]
    rod = Fraction(4, 3) * body["mass_kg"] * body["com_height_m"] ** 2
    middle = {
        "M": body["mass_kg"], "L": body["com_height_m"], "I": body.get("inertia_kgm2", rod), "m": foot["mass_kg"],
        "ell": foot["half_length_m"], "slope": scenario.get("angle_deg", Fraction(0)),
        "ramp": scenario.get("ramp_s", Fraction(0)),
    }  # fmt: skip
    box = {}
    for name, key in NAMES.items():
        wish = spec.get("uncertainty", {}).get(key, Fraction(0))
        table = wish if isinstance(wish, dict) else {"absolute": wish}
        half = scale * (table.get("absolute", 0) + abs(middle[name]) * table.get("percent", 0) / 100)
        if (name == "slope" and scenario["kind"] != "slope") or (name == "ramp" and middle["ramp"] == 0):
            half = Fraction(0)
        least = middle[name] - half
        none = least == half == 0 and name in ("m", "ramp")
        need(half >= 0 and (least > 0 or none or name == "slope"), f"the box holds a {name} that is not above 0")
        box[name] = middle[name], half
    return box


def segments(scenario: dict[str, Any], box: Box) -> tuple[list[Segment], tuple[Fraction, ...] | None]:
    """The scenario cut where its signal has corners, with the ramp of the box's middle; and the signal that rests.

    The signal is, for a slope, the share of its final angle; else F_x, F_y [N], or the floor's acceleration [m/s²]. It
    is None in the end where it still moves when the scenario ends, or jumps after.
    """
    duration, ramp = scenario["duration_s"], box["ramp"][0]
    corners = _corners(scenario, ramp)
    need(duration > 0 and all(a[0] <= b[0] for a, b in pairwise(corners)), "the scenario's times do not rise")
    times = [t for t, _ in corners]
    cuts = [Fraction(0), *sorted({t for t in times if 0 < t < duration}), duration]
    found = []
    for start, end in pairwise(cuts):
        at = bisect_right(times, start) - 1
        first, last = _value(corners, at, start), _value(corners, at, end)
        found.append(Segment(end - start, first, last, grows=box["ramp"][0] > 0 and end <= ramp))
    final = found[-1].last
    rests = found[-1].first == final and all(value == final for t, value in corners if t >= duration)
    need(rests or not box["ramp"][1], "the ramp may take longer than the scenario")
    return found, final if rests else None


def _corners(scenario: dict[str, Any], ramp: Fraction) -> list[Corner]:
    kind = scenario["kind"]
    if kind in ("slope", "force"):
        final = (Fraction(1),) if kind == "slope" else (scenario["fx_n"], scenario.get("fy_n", Fraction(0)))
        return [(Fraction(0), final)] if ramp == 0 else [(Fraction(0), (0 * final[0],) * len(final)), (ramp, final)]
    rows = scenario["acceleration_mps2" if kind == "platform" else "points"]
    points = [(row[0], tuple(row[1:])) for row in rows]
    return [(Fraction(0), points[0][1]), *points]


def _value(corners: list[Corner], at: int, t: Fraction) -> tuple[Fraction, ...]:
    """At time ``t``, on the line that begins at corner ``at``."""
    begin, value = corners[at]
    if at + 1 == len(corners):
        return value
    end, after = corners[at + 1]
    return tuple(a + (t - begin) / (end - begin) * (b - a) for a, b in zip(value, after, strict=True))
