"""A study as one HTML file that opens offline: what a person who must choose needs first, then what it rests on.

Every sentence is made from the stored rows by a rule that stands here; nothing is said of what was not tried.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from design.present import study_plots, study_text
from design.present.text import Style, number

if TYPE_CHECKING:
    from design.present.plots import Figure

Document = Mapping[str, Any]
Row = Mapping[str, Any]

COMPARED = {
    "lost": ("trials that lost contact", "percentage points", 100.0, "less"),
    "contact_force_n": ("smallest contact force", "N", 1.0, "more"),
    "settling_s": ("settling", "s", 1.0, "less"),
    "posture_error_deg": ("error of the final posture", "deg", 1.0, "less"),
    "torque_rms_nm": ("torque, rms", "N m", 1.0, "less"),
    "torque_variation_nm": ("torque variation", "N m", 1.0, "less"),
}
"""Measures on the page: words, unit, what to multiply by, and which is better."""
SURVIVAL = {"step-slope": ("sudden slope", "deg"), "push": ("push", "N s")}
TOLD = {"mpc-oracle": "it is told the force", "mpc-preview": "it is told the force and its future"}
"""Controllers that no one can build: bounds on what knowing more would give."""
SHOWN = 200
"""Trials that are named one by one."""


def as_html(document: Document, rows: Sequence[Row]) -> str:
    """The whole page of a study's ``document`` (its summary) and ``rows``."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters["number"] = number
    controllers = document["controllers"]
    lines = differences(document)
    trouble = [row for row in rows if row["status"] not in ("kept", "found")]
    names = [*controllers, *document["left_out"]]
    source = files("design.present").joinpath("study.html.j2").read_text(encoding="utf-8")
    return environment.from_string(source).render(
        document=document,
        title=study_text.title(document),
        legend=study_text.LEGEND,
        word=("COMPLETE", Style.GOOD) if document["status"] == "complete" else ("UNDECIDED", Style.DOUBT),
        contact=contact(document),
        headline=headline(document),
        findings=findings(document),
        table=[(*_word(one), study_text.cells(name, one)) for name, one in controllers.items()],
        told=[f"{name} ({why})" for name, why in TOLD.items() if name in controllers],
        lines=differences(document, by_scenario=True),
        tuning=study_text.tuning_sentences(document),
        trouble=trouble[:SHOWN],
        hidden=max(0, len(trouble) - SHOWN),
        drawn=study_plots.chosen(controllers, document["reference"]),
        command=f"poise study SPEC --controllers {','.join(names)} --trials {document['trials']}"
        f" --seed {document['seed']}{_untuned(document)} -o FOLDER",
        **_pictures(document, rows, lines),
    )


def _untuned(document: Document) -> str:
    """The option of a study whose weights were not tuned."""
    weights = document["tuning"]["weights"].values()
    return " --no-tune" if weights and not any(its["evaluations"] for its in weights) else ""


def _pictures(document: Document, rows: Sequence[Row], lines: list[dict[str, Any]]) -> dict[str, Any]:
    controllers = document["controllers"]
    names = list(controllers)
    drawn = study_plots.chosen(controllers, document["reference"])
    runs, forces, survived = [], [], []
    for scenario in document["scenarios"]:
        its = [row for row in rows if row["scenario"] == scenario and row["trial"] is not None]
        first = [row for row in its if row["trial"] == 0]
        runs.append((scenario, _svg(study_plots.trajectory_figure(first, drawn))))
        forces.append((scenario, _svg(study_plots.contact_figure(its, names))))
    for what, (label, unit) in SURVIVAL.items():
        found = {
            row["controller"]: (row["survived"], row["limit"])
            for row in rows
            if row["trial"] is None and row["scenario"] == what and row["status"] == "found"
        }
        if found:
            survived.append((label, _svg(study_plots.survival_figure(found, names, label, unit))))
    times = {name: one["step_ms"] for name, one in controllers.items()}
    forests = []
    for words, *_ in COMPARED.values():
        of = [line for line in lines if line["words"] == words and line["low"] is not None]
        if of:
            forests.append((f"{words[0].upper()}{words[1:]}", _svg(study_plots.forest_figure(of))))
    return {
        "runs": runs,
        "forces": forces,
        "forests": forests,
        "survived": survived,
        "times": _svg(study_plots.times_figure(times, 1e3 * document["control_period_s"])),
    }


def _svg(figure: Figure | None) -> Any:
    from markupsafe import Markup

    from design.present.html import svg

    return None if figure is None else Markup(svg(figure))


def differences(document: Document, *, by_scenario: bool = False) -> list[dict[str, Any]]:
    """The paired differences, measure by measure, in the units of the page; those without a pair are left out.

    Over all scenarios, and with ``by_scenario`` of each too where there are several.
    """
    found = []
    for measure, (words, unit, scale, better) in COMPARED.items():
        for name, one in document["controllers"].items():
            whole = one.get("against", {}).get(measure)
            if not whole:
                continue
            counts = _counts(document, name) if measure == "lost" else ""
            split = by_scenario and len(whole["by_scenario"]) > 1 and not (counts and whole["mean"] == 0)
            parts = whole["by_scenario"] if split else {}
            for scenario, its in [(study_text.covered(whole), whole), *parts.items()]:
                if its["pairs"] and its["mean"] is not None:
                    values = {key: None if its[key] is None else scale * its[key] for key in ("mean", "low", "high")}
                    line = {"name": name, "measure": measure, "words": words, "unit": unit, "better": better}
                    of = counts if its is whole or not counts else _counts(document, name, scenario)
                    line |= {"scenario": scenario, "counts": of}
                    found.append({**line, **values, "pairs": its["pairs"]})
    return found


def _counts(document: Document, name: str, scenario: str | None = None) -> str:
    """How many trials lost contact, with the reference and with the controller ``name``; or of one ``scenario``."""
    both = [document["controllers"][who] for who in (document["reference"], name)]
    if scenario is None:
        return " to ".join(f"{one['lost']}/{one['trials']}" for one in both)
    return " to ".join(str(one["lost_in"].get(scenario, 0)) for one in both)


def contact(document: Document) -> tuple[str, Style]:
    """Who lost contact, in a few words, and the style; empty where no trial has ended."""
    tried = {name: one for name, one in document["controllers"].items() if one["trials"] > one["failed"]}
    lost = [name for name, one in tried.items() if one["lost"]]
    if not tried:
        return "", Style.DOUBT
    if len(lost) == len(tried) > 1:
        return "CONTACT LOST by every controller", Style.BAD
    return (f"CONTACT LOST by {_list(lost)}", Style.BAD) if lost else ("CONTACT KEPT in every trial", Style.GOOD)


def headline(document: Document) -> str:
    """Who lost contact, how often and where, who kept it, and who has the largest median contact force."""
    tried = {name: one for name, one in document["controllers"].items() if one["trials"]}
    if not tried:
        return "No trial has ended: there is nothing to choose by."
    stood = {name: one["trials"] - one["lost"] - one["failed"] for name, one in tried.items()}
    kept = [name for name, one in tried.items() if stood[name] == one["trials"]]
    if len(kept) == len(tried) > 1:
        text = "Every controller kept contact in all trials"
    elif kept:
        text = f"{_list(kept)} kept contact in all trials"
        if lost := [_lost_often(name, one) for name, one in tried.items() if one["lost"]]:
            text = f"{_list(lost)}; {text}"
    elif any(stood.values()):
        best = max(stood, key=lambda name: stood[name] / tried[name]["trials"])
        often = f"{stood[best]} of {tried[best]['trials']}"
        text = f"No controller kept contact in all trials; most often did {best}, in {often}"
    elif all(one["failed"] == one["trials"] for one in tried.values()):
        text = "No trial could be run to its end"
    else:
        text = "No controller kept contact in any trial"
    medians = {name: one["contact_force_n"]["median"] for name, one in tried.items()}
    order = sorted((name for name in tried if medians[name] is not None), key=lambda name: -medians[name])
    if not order:
        return f"{text}."
    best = number(medians[order[0]], 4)
    real = [name for name in order if name not in TOLD]
    if order[0] in TOLD and real:
        text += f"; the largest median of the smallest contact force is {best} N, with {order[0]} ({TOLD[order[0]]}),"
        most = number(medians[real[0]], 4)
        text += " and of those told nothing"
    else:
        most, real = best, order
        text += "; the largest median of the smallest contact force is"
    return f"{text} {most} N, with {_list(name for name in real if number(medians[name], 4) == most)}."


def _lost_often(name: str, one: Mapping[str, Any]) -> str:
    """How often, and in which scenarios, a controller lost contact."""
    where = ", ".join(f"{scenario} {count}" for scenario, count in one["lost_in"].items())
    return f"{name} lost contact in {one['lost']} of {one['trials']} trials ({where})"


def findings(document: Document) -> list[str]:
    """What synthesized gains and prediction give over the reference, and who survives most and least."""
    controllers, reference = document["controllers"], document["reference"]
    found = []
    for line in differences(document):
        name = line["name"]
        if line["measure"] == "contact_force_n" and ("synthesized" in name or "mpc" in name or name == "lqr"):
            told = f" ({TOLD[name]})" if name in TOLD else ""
            mean = "" if line["low"] is None else f" {line['mean']:+.4g} N"
            found.append(f"{name}{told} against {reference}: smallest contact force{mean}, {_interval(line)}.")
    for key, words in (("step_slope_share", "sudden slope"), ("push_share", "push")):
        shares = {name: one[key] for name, one in controllers.items() if one[key] is not None}
        if len(shares) < 2:
            continue
        low, high = min(shares, key=shares.__getitem__), max(shares, key=shares.__getitem__)
        said = f"{100 * shares[high]:.1f} % of what any ankle can with {high}"
        said += f", {100 * shares[low]:.1f} % with {low}"
        if reference in shares and reference not in (low, high):
            said += f", {100 * shares[reference]:.1f} % with {reference}"
        close = shares[high] - shares[low] < 0.01
        found.append(f"The largest {words} survived {'hardly differs' if close else 'differs'}: {said}.")
    return found


def _interval(line: Mapping[str, Any]) -> str:
    pairs = f"{line['pairs']} pair{'s' * (line['pairs'] != 1)}"
    if line["low"] is None:
        return f"95 % interval not available from {pairs}"
    holds = ", which holds 0" if line["low"] <= 0 <= line["high"] else ""
    return f"95 % interval {number(line['low'], 4)} to {number(line['high'], 4)} N{holds} ({pairs})"


def _word(one: Mapping[str, Any]) -> tuple[str, Style]:
    if not one["trials"]:
        return "NO TRIAL", Style.DOUBT
    return ("LOST", Style.BAD) if one["lost"] else ("FAILED", Style.BAD) if one["failed"] else ("KEPT", Style.GOOD)


def _list(names: Iterable[str]) -> str:
    *most, last = names
    return f"{', '.join(most)} and {last}" if most else last
