"""The answer of gain synthesis as JSON and as text: never gains without their status."""

from __future__ import annotations

from typing import Any

from design.analysis.objectives import OBJECTIVES
from design.analysis.synthesis import Active, Answer
from design.present import store
from design.present.text import Paint, gains_line, number, report_table, wrapped
from design.spec.load import Source
from design.spec.setting import Setting


def document(source: Source, setting: Setting, answer: Answer) -> dict[str, Any]:
    """JSON of ``synthesize``; it holds the spec's text, so that a design can be reported on alone."""
    outcome, found = answer.outcome, answer.outcome.found
    solved = outcome.status.word == "solved" and found is not None
    rows = found.verdict.rows if solved and found else answer.missed
    verdict = {"solved": "met", "infeasible": "violated"}.get(outcome.status.word, "undecided")
    result = store.document(
        "synthesize",
        source,
        status=outcome.status.word,
        reason=f"{outcome.status.value} {outcome.detail}".strip(),
        law=setting.law,
        gains=store.gains_json(found.gains) if solved and found else None,
        objective={
            "id": setting.objective,
            "value": found.value if solved and found else None,
            "unit": OBJECTIVES[setting.objective].unit,
        },
        active=[_active(each) for each in found.active] if solved and found else [],
        starts={
            "tried": answer.starts,
            "reached": found.reached if solved and found else 0,
            "distinct_optima": found.optima if solved and found else 0,
        },
        verdict=verdict,
        rows=[store.row_json(row) for row in rows],
    )
    result["spec"]["text"] = source.text
    return result


def text(source: Source, setting: Setting, answer: Answer, paint: Paint) -> str:
    """The answer in words."""
    outcome = answer.outcome
    head = f"{source.spec.name}: {OBJECTIVES[setting.objective].verb} {setting.objective}, law {setting.law}"
    if outcome.status.word != "solved":
        style = {"infeasible": "bad"}.get(outcome.status.word, "doubt")
        lines = [head, "", paint(outcome.status.word.upper(), style), *wrapped(outcome.status.value)]
        lines += wrapped(outcome.detail)
        if answer.missed:
            lines += ["", "At that point (not a result):", *report_table(answer.missed, paint)]
        return "\n".join(lines) + "\n"
    found = outcome.value
    lines = [
        head,
        "",
        f"  {gains_line(found.gains, setting.law)}",
        f"  {setting.objective} = {_value(setting, found.value, 8)}",
        f"  solved; {found.reached} of {found.starts} starts reached it; confirmed by an independent integrator",
        "",
        "What holds it:",
        *(f"  {_active_line(each)}" for each in found.active),
    ]
    if not found.active:
        lines.append("  nothing: an interior optimum")
    if found.optima > 1:
        lines.append(f"{found.optima} distinct local optima were found; this is the best of them.")
    lines += _before(setting, answer)
    lines += ["", *report_table(found.verdict.rows, paint)]
    return "\n".join(lines) + "\n"


def _before(setting: Setting, answer: Answer) -> list[str]:
    """The spec's own gains beside the answer."""
    if answer.given is None or setting.gains is None:
        return []
    own = gains_line(setting.gains, setting.law)
    return wrapped(f"The spec's own gains, {own}: {_value(setting, answer.given, 6)}")


def _value(setting: Setting, value: float, digits: int) -> str:
    unit = OBJECTIVES[setting.objective].unit
    return f"{value:.{digits}g}" + ("" if unit == "1" else f" {unit}")


def _active(each: Active) -> dict[str, Any]:
    return {
        "id": each.id,
        "scenario": each.scenario,
        "time_s": each.time_s,
        "value": each.value,
        "required": each.required,
    }


def _active_line(each: Active) -> str:
    if each.scenario is None:
        return f"{each.id} is at its bound {number(each.required)}"
    where = "" if each.time_s is None else f" at {each.time_s:.3f} s"
    return f"{each.id} in scenario {each.scenario}{where}: {number(each.value, 8)}"
