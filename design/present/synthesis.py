"""The answer of gain synthesis as JSON and as text: never gains without their status."""

from __future__ import annotations

from typing import Any

from design.analysis.objectives import OBJECTIVES
from design.analysis.synthesis import (
    MEASURED,
    Active,
    Answer,
    Box,
    Price,
    Settling,
    Synthesis,
    WhyNot,
)
from design.present import store
from design.present.text import Paint, Style, gains_line, number, report_table, wrapped
from design.spec.load import Source
from design.spec.setting import Setting

SURE = (
    f"no proof that none is better: on {MEASURED.specs} random specs a long global search found better in"
    f" {MEASURED.missed}"
)


def document(source: Source, setting: Setting, answer: Answer, bound: dict[str, Any] | None = None) -> dict[str, Any]:
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
            "sense": OBJECTIVES[setting.objective].verb,
            "value": found.value if solved and found else None,
            "unit": OBJECTIVES[setting.objective].unit,
        },
        active=[_active(each) for each in found.active] if solved and found else [],
        sensitivities=[_price(each) for each in found.prices] if solved and found else [],
        box=_box(found.box) if solved and found and found.box else None,
        bound=bound,
        why_not=_why(answer.why) if answer.why else None,
        best_so_far=_best(answer.best) if answer.best else None,
        starts={
            "tried": answer.starts,
            "reached": found.reached if solved and found else 0,
            "distinct_optima": found.optima if solved and found else 0,
            "measured_miss_rate": {
                "missed": MEASURED.missed,
                "undecided": MEASURED.undecided,
                "random_specs": MEASURED.specs,
            },
        },
        default_decay_rate=_settling(answer.settling) if answer.settling else None,
        verdict=verdict,
        rows=[store.row_json(row) for row in rows],
    )
    result["spec"]["text"] = source.text
    return result


def text(source: Source, setting: Setting, answer: Answer, paint: Paint, bound: list[str] | None = None) -> str:
    """The answer in words; ``bound``: what is known of the global optimum."""
    outcome = answer.outcome
    head = f"{source.spec.name}: {OBJECTIVES[setting.objective].verb} {setting.objective}, law {setting.law}"
    if outcome.status.word != "solved":
        style = {"infeasible": Style.BAD}.get(outcome.status.word, Style.DOUBT)
        lines = [head, "", paint(outcome.status.word.upper(), style), *wrapped(outcome.status.value)]
        lines += wrapped(outcome.detail)
        lines += _settling_lines(setting, answer)
        if answer.why:
            lines += ["", *why_lines(answer.why)]
        if answer.best:
            lines += ["", *_best_lines(setting, answer.best, paint)]
        elif answer.missed:
            lines += ["", "At that point (not a result):", *report_table(answer.missed, paint)]
        return "\n".join(lines) + "\n"
    found = outcome.value
    worst = " at worst within [uncertainty]" if found.box else ""
    lines = [
        head,
        "",
        f"  {gains_line(found.gains, setting.law)}",
        f"  {setting.objective} = {_value(setting, found.value, 8)}{worst}",
        f"  solved; {found.reached} of {found.starts} local searches reached it; confirmed by an independent"
        " integrator",
        *(f"  {line}" for line in bound or [SURE]),
        "",
        "What holds it:",
        *(f"  {_active_line(each)}" for each in found.active),
    ]
    if not found.active:
        lines.append("  other bodies of the box" if found.box else "  nothing: an interior optimum")
    lines += _price_lines(setting, found)
    if found.optima > 1:
        lines.append(f"{found.optima} distinct local optima were found; this is the best of them.")
    lines += wrapped(outcome.detail) if outcome.detail else []
    lines += _settling_lines(setting, answer)
    lines += _before(setting, answer)
    if found.box:
        lines += ["", *_box_lines(setting, found.box)]
    lines += ["", *report_table(found.verdict.rows, paint)]
    return "\n".join(lines) + "\n"


def _best(best: Synthesis) -> dict[str, Any]:
    return {
        "gains": store.gains_json(best.gains),
        "value": best.value,
        "rows": [store.row_json(row) for row in best.verdict.rows],
    }


def _best_lines(setting: Setting, best: Synthesis, paint: Paint) -> list[str]:
    """The best design so far: it keeps every requirement, and a better one may exist."""
    return [
        "The best design so far was checked to keep every requirement; a better one may exist:",
        f"  {gains_line(best.gains, setting.law)}",
        f"  {setting.objective} = {_value(setting, best.value, 8)}",
        "",
        *report_table(best.verdict.rows, paint),
    ]


def _settling(settling: Settling) -> dict[str, Any]:
    return {
        "required_per_s": settling.required,
        "kept": settling.kept,
        "value_without": settling.value,
        "decay_rate_without_per_s": settling.decay,
    }


def _settling_lines(setting: Setting, answer: Answer) -> list[str]:
    """What was required so that the design settles, or that it does not."""
    settling = answer.settling
    if settling is None:
        return []
    if settling.kept:
        return wrapped(
            f"The spec asks no decay rate. At least {settling.required:.3g} 1/s was required, so that the body comes to"
            f" rest within the scenario; without it {setting.objective} = {_value(setting, settling.value, 6)} at a"
            f" decay rate of {settling.decay:.2g} 1/s. requirements.decay_rate_per_s = 0.0 asks for none."
        )
    return wrapped(
        f"Warning: this design practically never settles: its decay rate is {settling.decay:.2g} 1/s. No design was"
        f" found that meets the specification with at least {settling.required:.3g} 1/s."
    )


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


def _price(each: Price) -> dict[str, Any]:
    return {
        "id": each.id,
        "kind": each.kind,
        "given": each.given,
        "unit": each.unit,
        "change_per_percent": each.change,
        "change_per_percent_solved": each.solved,
    }


def _price_lines(setting: Setting, found: Synthesis) -> list[str]:
    """What one per cent more of each bound, requirement and tolerance does."""
    if not found.prices:
        return []
    unit = OBJECTIVES[setting.objective].unit
    lines = [f"One per cent more of each changes {setting.objective} by" + ("" if unit == "1" else f" [{unit}]") + ":"]
    for each in found.prices:
        what = each.id if each.kind in ("requirement", "tolerances") else f"{each.kind} of {each.id}"
        said = [] if each.change is None else [f"{each.change:+.4g} by its multiplier"]
        said += [] if each.solved is None else [f"{each.solved:+.4g} when sought again"]
        lines.append(f"  {what} ({number(each.given)}): {', '.join(said) or 'not found'}")
    return lines


def _box(box: Box) -> dict[str, Any]:
    return {
        "rounds": box.rounds,
        "points": [
            {"row": each.row, "scenario": each.scenario, "at": dict(each.at), "shares": list(each.shares)}
            for each in box.points
        ],
        "tried": box.tried,
        "broken": 0,
        "nominal": {
            "value": box.nominal,
            "gains": store.gains_json(box.nominal_gains),
            "share_broken": box.nominal_broken,
        },
        "proofs": [{"scenario": name, "answer": answer, "share": share} for name, answer, share in box.proofs],
    }


def _box_lines(setting: Setting, box: Box) -> list[str]:
    """What is known over the box."""
    alone = f"{gains_line(box.nominal_gains, setting.law)}: {_value(setting, box.nominal, 6)} there"
    lines = [
        f"Over the box of [uncertainty]: {box.rounds} rounds; {len(box.points)} of its points bind or did,",
        *(
            f"  {each.row}" + (f" in {each.scenario}" if each.scenario else "") + ": "
            + ", ".join(f"{name} {value:.5g}" for name, value in each.at.items())
            for each in box.points
        ),
        f"  {box.tried} points of it were tried, none breaks the design.",
        *wrapped(
            f"The best gains for the nominal body alone, {alone}, break in {100 * box.nominal_broken:.3g} % of"
            " corners and points inside."
        ),
    ]  # fmt: skip
    for name, answer, share in box.proofs:
        part = "" if answer != "unknown" else f" ({100 * share:.3g} % of the box in the time given; see poise prove)"
        lines.append(f"  {name}: contact and stability over the whole box: {answer.upper()}{part}")
    return lines


def _why(why: WhyNot) -> dict[str, Any]:
    return {
        "conflict": list(why.conflict),
        "minimal": why.minimal,
        "complete": why.complete,
        "relaxations": [
            {"id": each.id, "bound": each.bound or None, "given": each.given, "enough": each.enough, "unit": each.unit}
            for each in why.relaxations
        ],
    }


def why_lines(why: WhyNot) -> list[str]:
    """The conflict, and what would be enough: what a search found, and did not find; no word of it is a proof."""
    names = " and ".join(why.conflict)
    if not why.minimal:
        lines = wrapped(f"Time ran out before it was known which of {names} is in the way; give it more time.")
        return lines if why.conflict else wrapped("Time ran out before anything was known; give it more time.")
    if len(why.conflict) > 1:
        lines = wrapped(f"No design was found that meets {names} together; without any one of them one was found.")
    elif why.conflict:
        lines = wrapped(f"No design was found that meets {names}, even alone; without it one was found.")
    else:
        lines = wrapped("No design was found that keeps contact and stability alone, within these bounds.")
    if why.relaxations:
        lines += ["A checked design meets the rest with any one of:", *(f"  {each}" for each in why.relaxations)]
    if not why.complete:
        lines.append("Time ran out before all that might be enough was looked at.")
    elif not why.relaxations:
        lines.append("No single relaxation was found that would be enough.")
    return lines
