"""A spec file as numbers in SI units and radians."""

import math
import tomllib
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

KINDS = ("pd", "force", "cop")
RADIANS = math.pi / 180.0

ROW_OF_KEY = {
    "contact_force_n": "contact-force",
    "decay_rate_per_s": "decay-rate",
    "cop_margin_m": "cop-margin",
    "torque_nm": "torque",
    "torque_rate_nm_per_s": "torque-rate",
    "friction": "friction",
    "settling_s": "settling",
    "overshoot_deg": "overshoot",
    "posture_error_deg": "posture-error",
    "delay_margin_s": "delay-margin",
    "disk_margin": "disk-margin",
    "sample_time_s": "sample-time",
}
"""The requirements that this package can judge."""

APPLIED, SLOPE, FLOOR = range(3)
"""What the force comes from, as simulator.c numbers it."""
AT_MOST = {"torque", "torque-rate", "friction", "settling", "overshoot", "posture-error"}
"""Rows that must be at most their level; the others at least."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Scenario:
    """An external force over time, and the state at t = 0.

    ``pieces`` (n, 6): on each from t0 to t1 the signal is linear: t0, t1, both components at t0, both at t1. The signal
    is (alpha, 0) [rad] if ``is_slope``, else (F_x, F_y) [N]. ``steady_from`` [s]: when it has come to its last value.
    """

    name: str
    world: int  # APPLIED, SLOPE or FLOOR
    pieces: np.ndarray
    duration: float
    steady_from: float
    theta: float
    omega: float

    @property
    def is_slope(self):
        """Whether the signal is an angle."""
        return self.world == SLOPE

    @property
    def ends_moving(self):
        """Whether the force still changes at the end."""
        return bool(np.any(self.pieces[-1, 2:4] != self.pieces[-1, 4:6]))


@dataclass(frozen=True, eq=False, kw_only=True)
class Problem:
    """What a spec asks: maximise or minimise ``objective`` over gains (K_p, K_d, K_f) within ``bounds`` (3, 2).

    ``body``: M, L, I, m, toe, heel, h, g. ``required`` maps a row to its level; contact, CoP within the foot and a
    positive decay rate are always there. ``gains``: the spec's own, or None.
    """

    name: str
    body: np.ndarray
    kind: str
    theta_d: float
    target: float
    scenarios: tuple[Scenario, ...]
    required: dict[str, float]
    objective: str
    minimise: bool
    bounds: np.ndarray
    gains: np.ndarray | None
    step: float

    @property
    def weight(self):
        """(M + m) g [N]."""
        return (self.body[0] + self.body[3]) * self.body[7]

    @property
    def ell(self):
        """Half the length of the foot [m]."""
        return 0.5 * (self.body[4] + self.body[5])

    @property
    def is_paper_foot(self):
        """Toe and heel equally far from an ankle on the ground, and the CoP to rest under it."""
        return self.body[4] == self.body[5] and self.body[6] == 0.0 and self.target == 0.0


def read(source):
    """The problem of a spec: a path, or the text of a TOML file."""
    return parse(tomllib.loads(Path(source).read_text() if isinstance(source, Path) else source))


def parse(spec):
    """The problem of a spec that is a dictionary; raises ``ValueError`` for what this package cannot judge."""
    body, foot, law = spec["body"], spec["foot"], spec["law"]
    M, L = body["mass_kg"], body["com_height_m"]
    g = spec.get("simulation", {}).get("gravity_mps2", 9.81)
    toe = foot.get("toe_m", foot.get("half_length_m"))
    heel = foot.get("heel_m", foot.get("half_length_m"))
    numbers = [M, L, body.get("inertia_kgm2", 4.0 / 3.0 * M * L**2), foot["mass_kg"], toe, heel]
    numbers += [foot.get("ankle_height_m", 0.0), g]
    if "adapt_s" in law:
        message = "law.adapt_s is not known here"
        raise ValueError(message)
    synthesis = spec.get("synthesis", {})
    bounds = synthesis.get("bounds", {})
    gains = [law.get("kp"), law.get("kd"), 0.0 if law["kind"] == "pd" else law.get("kf")]
    return Problem(
        name=spec["name"],
        body=np.array(numbers, dtype=float),
        kind=law["kind"],
        theta_d=law.get("desired_angle_deg", 0.0) * RADIANS,
        target=law.get("cop_target_m", 0.0),
        scenarios=tuple(_scenario(each, M) for each in spec["scenarios"]),
        required=_required(spec.get("requirements", {})),
        objective=synthesis.get("maximise", synthesis.get("minimise", "decay-rate")),
        minimise="minimise" in synthesis,
        bounds=np.array([bounds.get(key, (0.0, 0.0)) for key in ("kp", "kd", "kf")], dtype=float),
        gains=None if None in gains else np.array(gains, dtype=float),
        step=spec.get("simulation", {}).get("time_step_s", 0.001),
    )


def _required(table):
    required = {"contact-force": 0.0, "cop-margin": 0.0, "decay-rate": 0.0}
    for key, level in table.items():
        if key not in ROW_OF_KEY:
            message = f"requirements.{key} is not known here"
            raise ValueError(message)
        if isinstance(level, dict):
            if level.get("soft"):
                continue
            level = level.get("min", level.get("max"))
        required[ROW_OF_KEY[key]] = float(level)
    return required


def _scenario(table, M):
    kind, duration = table["kind"], float(table["duration_s"])
    if kind in ("slope", "force"):
        last = (table["angle_deg"] * RADIANS, 0.0) if kind == "slope" else (table["fx_n"], table.get("fy_n", 0.0))
        ramp = table.get("ramp_s", 0.0)
        points = [(0.0, *last)] if ramp == 0 else [(0.0, 0.0, 0.0), (ramp, *last)]
    elif kind == "platform":
        points = [(t, -M * a, 0.0) for t, a in table["acceleration_mps2"]]
    else:
        points = [tuple(point) for point in table["points"]]
    pieces, steady_from = _pieces(np.array(points, dtype=float), duration)
    return Scenario(
        name=table["name"], world={"slope": SLOPE, "platform": FLOOR}.get(kind, APPLIED), pieces=pieces,
        duration=duration, steady_from=steady_from,
        theta=table.get("initial_angle_deg", 0.0) * RADIANS, omega=table.get("initial_rate_deg_per_s", 0.0) * RADIANS,
    )  # fmt: skip


def _pieces(points, duration):
    """The linear pieces within [0, duration] of ``points`` (t, two components), and when the last value is reached."""
    knots = [(0.0, *points[0, 1:]), *map(tuple, points), (max(duration, points[-1, 0]) + 1.0, *points[-1, 1:])]
    pieces = []
    for (t0, *first), (t1, *last) in pairwise(knots):
        if t1 <= t0 or t0 >= duration:
            continue
        share = (min(t1, duration) - t0) / (t1 - t0)
        end = [a + share * (b - a) for a, b in zip(first, last, strict=True)] if t1 > duration else last
        pieces.append([t0, min(t1, duration), *first, *end])
    pieces = np.array(pieces)
    final, steady_from = pieces[-1, 4:6], 0.0
    for piece in pieces:
        if np.any(piece[2:4] != final) or np.any(piece[4:6] != final):
            steady_from = piece[1]
    return pieces, float(steady_from)
