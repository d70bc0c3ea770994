"""Gains against a problem: each row's worst value by the ids of `poise report`, and how far the rows are from met."""

import math
from typing import NamedTuple

import numpy as np

from . import linear
from .problem import AT_MOST
from .simulator import simulate

RUN_ROWS = (
    ("toe-force", "toe_force", 1.0),
    ("heel-force", "heel_force", 1.0),
    ("cop-margin", "cop_margin", 1.0),
    ("torque", "torque", 1.0),
    ("torque-rate", "torque_rate", 1.0),
    ("friction", "friction", 1.0),
    ("settling", "settling", 1.0),
    ("overshoot", "overshoot", math.degrees(1.0)),
    ("posture-error", "posture_error", math.degrees(1.0)),
)
"""Row, field of ``Run``, and the unit of the row in that of the field."""

STABLE_RUNGE_KUTTA = 2.5
"""|pole| times step beyond which Poise leaves a run undecided; the method is unstable from 2.78 on."""


class Judgement(NamedTuple):
    """``rows``: value by row id, the worst over all scenarios. ``violation``: the largest shortfall as a part of the
    level, or of a usual size where the level is 0; at most 0 where every requirement is met. ``broken``: that row.
    ``branches``: toe and heel force and the other rows, of each scenario apart.
    """

    rows: dict[str, float]
    violation: float
    broken: str
    branches: tuple[tuple[str, float], ...] = ()


def run_rows(run):
    """The rows of one run, by id."""
    rows = {row: getattr(run, field) * unit for row, field, unit in RUN_ROWS}
    rows["contact-force"] = min(run.toe_force, run.heel_force)
    return rows


def judge(problem, gains, points=None, *, step=None, exact=True, give_up=-np.inf):
    """All rows that ``problem`` requires or seeks, at ``gains`` (3,).

    ``points``: operating points of the linear loop, a fine choice if left out. ``step`` [s]: that of the spec if left
    out. ``exact``: the decay rate to all digits. An unstable loop is not simulated. With ``give_up`` [N] a run is
    abandoned, and broken, where a contact force is below it, and a loop whose poles or margins fall short by more than
    a twentieth is not simulated either.
    """
    gains = np.asarray(gains, dtype=float)
    points = linear.operating_points(problem, 65) if points is None else points
    rate = linear.exact_decay_rate if exact else linear.decay_rate
    rows = {"decay-rate": rate(problem, gains, points)}
    natural = math.sqrt(problem.body[7] / problem.body[1])
    if not rows["decay-rate"] > 0.0 or (problem.kind != "pd" and not gains[2] > 0.0):
        return Judgement(rows, 100.0 + min(max(-rows["decay-rate"] / natural, 0.0), 100.0), "decay-rate")
    fastest = float(np.abs(linear.poles(problem, gains, points)).max())
    if fastest * problem.step > STABLE_RUNGE_KUTTA:
        return Judgement(rows, 50.0 + min(fastest * problem.step / STABLE_RUNGE_KUTTA, 50.0), "time_step_s")
    wanted = {*problem.required, problem.objective}
    rows |= {row: value(problem, gains, points) for row, value in LINEAR_ROWS if row in wanted}
    linear_rows = {row: level for row, level in problem.required.items() if row in rows}
    short, row = _worst(linear_rows, rows, {"decay-rate": natural})
    if math.isfinite(give_up) and short > 0.05:
        return Judgement(rows, 35.0 + short, row)
    usual = usual_sizes(problem)
    branches = list(rows.items())
    for scenario in problem.scenarios:
        run = simulate(problem, scenario, gains, step, give_up)
        values = run_rows(run)
        branches += [*values.items(), ("contact-force", run.toe_force), ("contact-force", run.heel_force)]
        for row, value in values.items():
            rows[row] = (max if row in AT_MOST else min)(rows.get(row, value), value)
        stopped = run.fallen if run.fallen is not None else run.abandoned
        if stopped is not None:
            return Judgement(rows, 20.0 + 10.0 * (1.0 - stopped / scenario.duration), "toe-force or heel-force")
        if scenario.ends_moving:
            rows["settling"] = rows["overshoot"] = math.inf
    return Judgement(rows, *_worst(problem.required, rows, usual), tuple(branches))


LINEAR_ROWS = (
    ("delay-margin", linear.delay_margin),
    ("disk-margin", linear.disk_margin),
    ("sample-time", linear.sample_time),
)


def usual_sizes(problem):
    """By what a violation is divided where the level is 0, by row."""
    natural = math.sqrt(problem.body[7] / problem.body[1])
    return {"contact-force": problem.weight, "cop-margin": problem.ell, "decay-rate": natural}


def _worst(required, rows, usual):
    """The largest scaled violation of the ``required`` levels, and its row."""
    worst = (-math.inf, "")
    for row, level in required.items():
        short = rows[row] - level if row in AT_MOST else level - rows[row]
        worst = max(worst, (min(short / (level or usual.get(row, 1.0)), 10.0), row))
    return worst
