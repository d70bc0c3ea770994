"""From the arguments of `poise region` to what it prints: open, ask for each scenario, keep what is asked for."""

from __future__ import annotations

import math
import time
from typing import Any, Literal

import numpy as np

from design.model.environment import Scenario
from design.model.laws import Gains, LawKind
from design.present import opening, plots, store, terminal
from design.present import region as present
from design.spec.setting import Setting
from problems.region.loop import NoRegion
from problems.region.samples import cuts, turned
from problems.region.search import Region, solve


def region(
    spec: str,
    law: LawKind | None,
    gains: str | None,
    scenario: str | None,
    form: Literal["text", "json"],
    plot: str | None,
    output: str | None,
    *,
    strict: bool,
) -> str:
    """Deliver the regions of a spec's scenarios, or of one; and say ``proved``, or ``unknown`` if one was not found."""
    source, problem = opening.opened(spec, law, gains, strict=strict)
    its = problem.given_gains()
    worlds = [problem.scenario(scenario)] if scenario is not None else list(problem.scenarios)
    if plot:
        plots.format_of(plot)
    store.check_writable(plot, output)
    facts, drawn = [], []
    with terminal.progress() as say:
        for world in worlds:
            say(f"{world.name}: the largest region that can be proved")
            began = time.monotonic()
            try:
                found = solve(problem, world, its)
            except NoRegion as error:
                facts.append(present.none(world.name, str(error), time.monotonic() - began))
                continue
            facts.append(as_facts(found, problem, world, its, time.monotonic() - began))
            if plot:
                drawn.append((world.name, cuts(found, problem.biped, its, world)))
    document = present.document(source, problem, its, facts)
    if plot and drawn:
        from design.present.region_plots import region_figure

        title = present.title(source, problem, its)
        store.write(plot, plots.figure_bytes(region_figure(drawn, title), plots.format_of(plot)))
    elif plot:
        terminal.note(f"no region, no picture: {plot} is not written")
    paint = terminal.painter_for_output(to_file=output is not None)
    printed = store.dumps(document) if form == "json" else present.as_text(document, paint)
    terminal.deliver(printed, output)
    return str(document["verdict"])


def as_facts(found: Region, problem: Setting, world: Scenario, gains: Gains, seconds: float) -> dict[str, Any]:
    """A region as stored: angles in degrees, but the matrices for (rad, rad/s, N m)."""
    start = np.array(
        [world.theta0 - found.theta_f, world.omega0, gains.K_p * (problem.theta_d - found.theta_f)]
    )  # s = 0
    value = float(start @ found.P @ start)
    return {
        "scenario": found.scenario,
        "status": "proved",
        "why": "",
        "stationary_angle_deg": math.degrees(found.theta_f),
        "P": found.P,
        "Q": found.Q,
        "multipliers": found.multipliers,
        "e_max_rad": found.e_max,
        "decay_rate_per_s": found.alpha,
        "linear_decay_rate_per_s": found.decay,
        "volume": found.volume,
        "volume_over_lyapunov": found.scaled,
        "largest_turn_deg": math.degrees(found.turn),
        "largest_turn_simulated_deg": math.degrees(turned(found, problem.biped, gains, world)),
        "largest_angle_deg": math.degrees(found.angle),
        "largest_push_deg_per_s": math.degrees(found.push),
        "strip_deg": math.degrees(found.strip),
        "share_of_strip": found.share,
        "turn_share_of_strip": found.turn / found.strip,
        "load_n": found.load,
        "contact_force_n": found.level,
        "start": {"value": value, "inside": value <= 1},
        "tried": [{"e_max_rad": e_max, "volume": volume} for e_max, volume in found.tried],
        "seconds": seconds,
    }
