"""From the arguments of `poise tradeoff` to what it prints: open, seek the front, keep what is asked for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from design.analysis.objectives import OBJECTIVES
from design.model.laws import LawKind
from design.present import opening, plots, store, terminal
from design.present import tradeoff as present
from design.solvers.outcome import Outcome, Status
from design.spec.setting import Setting
from problems.tradeoff import front
from problems.tradeoff.front import Front
from problems.tradeoff.margins import Margins, margins

CODES = {"complete": "met", "infeasible": "violated", "incomplete": "undecided", "undecided": "undecided"}
"""What each status means for the exit code."""


def tradeoff(
    spec: str,
    law: LawKind | None,
    between: Sequence[str],
    points: int,
    time_limit: float,
    point: str | None,
    form: str,
    plot: str | None,
    output: str | None,
    *,
    strict: bool,
) -> str:
    """Deliver the front between the rows named in ``between``, and say met, violated or undecided.

    ``point``: the number of a point, or ``knee``, that is written to ``output`` as a design; the front is then printed.
    """
    which = margins(between)
    form = present.check(form, point, points, plot, output)
    source, problem = opening.opened(spec, law, strict=strict)
    if problem.robust and not problem.tolerances.none:
        terminal.note("remark: synthesis.robust is not for fronts; this one is for the nominal body")
    with terminal.progress() as say:
        found = front.solve(problem, which, points=points, seconds=time_limit, say=say)
    facts = as_facts(found, problem, which)
    if plot and facts["points"]:
        from design.present.tradeoff_plots import tradeoff_figure

        figure = tradeoff_figure(facts, present.title(source, facts))
        store.write(plot, plots.figure_bytes(figure, plots.format_of(plot)))
    elif plot:
        terminal.note(f"no front, no picture: {plot} is not written")
    paint = terminal.painter_for_output(to_file=output is not None and point is None)
    printed = present.render(source, facts, form, paint)
    terminal.deliver(printed, output if point is None else None)
    if point is not None and output:
        if facts["points"]:
            store.write(output, present.design(source, facts, point))
        else:
            terminal.note(f"no front, no design: {output} is not written")
    return CODES[facts["status"]]


def as_facts(outcome: Outcome[Front], problem: Setting, which: Margins) -> dict[str, Any]:
    """A front as stored; its points are numbered from 1."""
    found = outcome.found
    if found is None:
        status = "infeasible" if outcome.status is Status.INFEASIBLE else "undecided"
    else:
        status = "complete" if outcome.status is Status.SOLVED else "incomplete"
    said = "" if status == "complete" else f"{outcome.status.value} {outcome.detail}".strip()
    return {
        "status": status,
        "reason": said,
        "verdict": CODES[status],
        "law": problem.law,
        "margins": [{"id": id, "unit": OBJECTIVES[id].unit, "sense": OBJECTIVES[id].sense} for id in which.ids],
        "points": [
            {
                "gains": store.gains_json(each.gains),
                "values": _by_id(which, each.values),
                "active": sorted({one.id for one in each.active}),
            }
            for each in (found.designs if found else ())
        ],
        "ends": {id: at + 1 for id, at in zip(which.ids, found.ends, strict=True)} if found else {},
        "knee": {"point": found.knee[0] + 1, "distance": found.knee[1]} if found and found.knee else None,
        "jumps": [[one + 1, other + 1] for one, other in (found.jumps if found else ())],
        "unsolved": found.unsolved if found else 0,
        "given": _given(found, which) if found else None,
    }


def _given(found: Front, which: Margins) -> dict[str, Any] | None:
    """The spec's own gains beside the front."""
    own = found.own
    if own is None:
        return None
    return {
        "gains": store.gains_json(own.gains),
        "values": _by_id(which, own.values),
        "met": own.met,
        "dominated": own.beaten is not None,
        "dominated_by": None if own.beaten is None else own.beaten + 1,
    }


def _by_id(which: Margins, values: Sequence[float] | Any) -> dict[str, float]:
    return {id: float(value) for id, value in zip(which.ids, values, strict=True)}
