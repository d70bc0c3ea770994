"""What `poise simulate` shows of its runs: words, CSV or JSON, and pictures beside."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from design.analysis.estimate import Signals, at_rest, dynamic, evenly, static
from design.analysis.simulate import Trajectory, simulate
from design.analysis.verdict import coarse_step
from design.errors import BadInput
from design.model.laws import Gains, LawKind
from design.present import opening, plots, store, terminal, text
from design.spec.load import Source
from design.spec.setting import Setting

MOST = 20_000
"""Samples at which the dynamic estimate is looked at."""
SETTLED = 0.05
"""Time [s] after the start from which on its error counts."""


def render(
    reference: str,
    scenario: str | None,
    law: LawKind | None,
    gains: str | None,
    form: str,
    plot: str | None,
    animate: str | None,
    output: str | None,
    *,
    strict: bool = False,
) -> Iterator[str]:
    """Run the closed loop through every scenario, or one, in a ``form``: text, csv or json; draw what is asked for.

    The parts of the text; each scenario is run when its turn comes, and runs are kept for pictures only.
    """
    source, problem = opening.opened(reference, law, gains, strict=strict)
    picture = plots.format_of(plot) if plot else None
    if animate:
        plots.gif_only(animate, scenarios=1 if scenario else len(problem.scenarios))
    store.check_writable(plot, animate, output)
    chosen = problem.scenarios if scenario is None else (problem.scenario(scenario),)
    its = problem.given_gains()
    coarse = {each.name: coarse_step(problem.under(each).loop(), each, its, problem.step) for each in chosen}
    for why in filter(None, coarse.values()):
        terminal.note(f"warning: do not trust these numbers: {why}")
    runs: Iterable[Trajectory] = (simulate(problem.under(each).loop(), each, its, problem.step) for each in chosen)
    if picture or animate:
        runs = list(runs)
    if plot and picture:
        figure = plots.run_figure(list(runs), problem.biped, f"{source.spec.name}: {text.gains_line(its, problem.law)}")
        store.write(plot, plots.figure_bytes(figure, picture))
    if animate:
        from design.present.animation import gif_bytes

        store.write(animate, gif_bytes(problem.biped, next(iter(runs))))
    if form == "csv":
        return text.csv_parts(runs, several=len(chosen) > 1)
    if form == "json":
        scenarios = (
            store.run_json(run) | {"estimates": estimates(problem, run), "too_coarse": coarse[run.scenario] or None}
            for run in runs
        )
        facts = {"law": problem.law, "gains": store.gains_json(its), "scenarios": scenarios}
        return store.streamed(store.document("simulate", source, status="simulated", **facts))
    return _lines(source, problem, its, runs, coarse)


def _lines(
    source: Source, problem: Setting, gains: Gains, runs: Iterable[Trajectory], coarse: Mapping[str, str]
) -> Iterator[str]:
    head = f"{source.spec.name}, law {problem.law}, {text.gains_line(gains, problem.law)}"
    if math.isfinite(problem.adapt):
        head += f", desired angle adapts within {problem.adapt:g} s"
    yield head + "\n"
    for run in runs:
        why = coarse[run.scenario]
        lines = [*text.trajectory_lines(run, why), *([] if why else _estimate_lines(estimates(problem, run)))]
        yield "\n".join(lines) + "\n"


def estimates(problem: Setting, run: Trajectory) -> dict[str, Any] | None:
    """What the sensors say of the force in ``run``: at its end if it rests, and in motion; None for too short a run.

    Noise and tolerances are those of the spec, to first order; the errors are those without noise.
    """
    problem = problem.under(problem.scenario(run.scenario))
    period = max(problem.step, (float(run.t[-1]) - float(run.t[0])) / MOST)
    signals = evenly(Signals(run.t, run.theta, run.omega, run.F_T, run.F_H), period)
    if len(signals.t) < 4 or run.fallen is not None or run.lost_contact is not None:
        return None
    given = (problem.biped, signals, problem.sensors, problem.tolerances)
    try:
        rest = at_rest(*given, problem.target)
        moving = dynamic(*given, walk=problem.tuning.walk * problem.biped.weight)
    except (ValueError, BadInput):
        return None
    truth = np.array([np.interp(signals.t, run.t, part) for part in run.F])
    later = signals.t >= signals.t[0] + min(SETTLED, 0.5 * (signals.t[-1] - signals.t[0]))

    def largest(found: np.ndarray) -> list[float]:
        return [float(part) for part in np.abs(found - truth)[:, later].max(axis=1)]

    return {
        "static": {
            "fx_n": rest.F[0], "fy_n": rest.F[1], "stationary": rest.stationary, "off_n": list(rest.off),
            "noise_n": list(rest.spread), "tolerance_n": list(rest.bias),
            "largest_error_n": largest(static(*given, problem.target).F),
            "note": rest.why,
        },
        "dynamic": {
            "fx_n": float(moving.F[0, -1]), "fy_n": float(moving.F[1, -1]), "late_s": list(moving.lag),
            "noise_n": [float(part) for part in moving.spread[:, -1]],
            "tolerance_n": [float(part) for part in moving.bias[:, later].max(axis=1)],
            "largest_error_n": largest(moving.F),
        },
    }  # fmt: skip


def _estimate_lines(found: dict[str, Any] | None) -> list[str]:
    if found is None:
        return ["  estimates    none: contact was lost, the body fell, or the run is too short or too coarse"]
    rest, moving = found["static"], found["dynamic"]

    def pair(values: list[float]) -> str:
        return f"({values[0]:.3g}, {values[1]:.3g}) N"

    lines = [
        "  at rest      "
        + ("yes, (16)-(17) hold" if rest["stationary"] else f"NO: (16)-(17) off by {pair(rest['off_n'])}"),
        f"  on the way   (16)-(17) off by up to {pair(rest['largest_error_n'])},"
        f" the dynamic estimate by {pair(moving['largest_error_n'])}",
    ]
    if any(moving["noise_n"]):
        lines.append(f"  noise makes  {pair(rest['noise_n'])} at rest, {pair(moving['noise_n'])} in motion (std)")
    if any(moving["tolerance_n"]):
        lines += [
            f"  tolerances   {pair(rest['tolerance_n'])} at rest, {pair(moving['tolerance_n'])} in motion: the most",
            "               that a body within [uncertainty] moves the estimate by at any time",
        ]
    return lines
