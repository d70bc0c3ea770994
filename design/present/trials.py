"""Trials for the terminal: a table, then one plain sentence for each finding."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any

from design.analysis.simulate import Trajectory
from design.model.laws import Gains
from design.present import plots, store
from design.present.text import Paint, Style, gains_line, number, short, table, wrapped
from design.spec.load import Source

Facts = Mapping[str, Any]
Runs = Sequence[tuple[Trajectory, Trajectory | None]]


def check(plot: str | None, output: str | None) -> None:
    """Raise ``BadInput`` where a file cannot be written, before anything is computed."""
    if plot:
        plots.format_of(plot)
    store.check_writable(plot, output)


def render(
    source: Source, facts: Facts, pictures: Sequence[tuple[float, Runs]], form: str, plot: str | None, paint: Paint
) -> str:
    """The trials in a ``form``, text or json; drawn to the file ``plot``. ``pictures`` as for the figure."""
    document = store.document("trials", source, **facts)
    if plot:
        from design.present.trials_plots import trials_figure

        title = f"{source.spec.name}, law {facts['law']}, {_gains(facts)}"
        store.write(plot, plots.figure_bytes(trials_figure(facts, pictures, title), plots.format_of(plot)))
    return store.dumps(document) if form == "json" else as_text(document, paint)


HEADER = ("#", "scenario", "start", "angle", "contact", "at", "settle", "moves", "F_x", "F_y", "error")
SAME = 0.01
"""Contact forces that differ by less are the same [N]."""
SPEC = "as the spec says"
LEGEND = (
    "start: as the spec says, or the last trial's estimate (16)-(17); angle: theta_d and starting posture [deg]."
    " contact: smallest contact force [N], and where. settle: [s] until theta stays near theta_f. moves: farthest from"
    " theta_f [deg]. F_x, F_y: what the trial's end says of the external force [N]; error: its distance from the truth."
)


def as_text(document: Facts, paint: Paint) -> str:
    """The trials in at most 80 columns."""
    trials = document["trials"]
    whole = table(HEADER, [_cells(trial) for trial in trials], right=(0, 3, 4, 6, 7, 8, 9, 10))
    lines = [*wrapped(f"{document['spec']['name']}, law {document['law']}, {_gains(document)}"), "", whole[0]]
    for line, trial in zip(whole[1:], trials, strict=True):
        lines.append(paint(line, Style.BAD) if trial["lost_contact"] or trial["fallen_s"] is not None else line)
    lines += ["", *wrapped(LEGEND), *wrapped(f"The estimate is taken from {document['estimate_from']}."), ""]
    for sentence, style in findings(document):
        lines += [paint(line, style) if style else line for line in wrapped(sentence)]
    return "\n".join(lines) + "\n"


def _gains(document: Facts) -> str:
    its = document["gains"]
    adapts = f", desired angle adapts within {document['adapt_s']:g} s" if math.isfinite(document["adapt_s"]) else ""
    return gains_line(Gains(its["kp"], its["kd"], its["kf"]), document["law"]) + adapts


def _cells(trial: Facts) -> list[str]:
    F_x, F_y = trial["fx_error_n"], trial["fy_error_n"]
    return [
        str(trial["trial"]), short(trial["scenario"], 8), "spec" if trial["start"] == SPEC else "estimate",
        fixed(trial["desired_angle_deg"], 2), number(trial["contact_force_n"], 4), trial["contact_at"],
        number(trial["settling_s"], 4), fixed(trial["transient_deg"], 3), fixed(trial["fx_estimate_n"], 1),
        fixed(trial["fy_estimate_n"], 1), "-" if F_x is None else f"{math.hypot(F_x, F_y):.1e}",
    ]  # fmt: skip


def fixed(value: float | None, places: int) -> str:
    """A number with ``places`` decimals, never -0."""
    if value is None or not math.isfinite(value):
        return "-"
    text = f"{value:.{places}f}"
    return text.removeprefix("-") if float(text) == 0 else text


def findings(document: Facts) -> list[tuple[str, Style | None]]:
    """Sentences, each with a style, or None."""
    found: list[tuple[str, Style | None]] = []
    if document["verdict"] == "undecided":
        found.append((f"UNDECIDED: do not trust these numbers: {document['why']}.", Style.DOUBT))
    for place, series in enumerate(document["series"], 1):
        trials = [trial for trial in document["trials"] if trial["series"] == place]
        if series["second_over_first"]:
            found.append(_gain(trials[0]["scenario"], series))
        found += _ends(trials)
        found += _starts(trials)
    found += [(each, None) for each in _survived(document["survives"])]
    found.append(_contraction(document["contraction"]))
    return found


def _gain(name: str, series: Facts) -> tuple[str, Style | None]:
    """What the second trial has over the first, in words, and the style."""
    (one, two, more), (slow, quick, sooner) = (
        series["second_over_first"][key] for key in ("contact_force_n", "settling_s")
    )
    text = f"{name}: trial 2 starts from trial 1's estimate; its smallest contact force is "
    if abs(more) < SAME:
        text += f"the same ({number(one)} N)"
    else:
        text += f"{number(abs(more))} N {'larger' if more > 0 else 'smaller'} ({number(two)} N, not {number(one)} N)"
    if math.isfinite(slow) and math.isfinite(quick):
        within = f"to within {number(series['settling_band_deg'], 3)} deg"
        if sooner == 0:
            text += f", and so is the time in which it settles ({number(slow, 4)} s, {within})"
        else:
            text += f", and it settles {number(abs(sooner), 4)} s {'sooner' if sooner > 0 else 'later'}"
            text += f" ({number(quick, 4)} s, not {number(slow, 4)} s, {within})"
    return text + ".", Style.GOOD if more >= SAME else Style.DOUBT if more <= -SAME else None


def _lost(trial: Facts) -> str:
    """What became of contact, in words; empty if it was kept."""
    parts = []
    if trial["lost_contact"]:
        parts.append(f"contact is lost at the {trial['lost_contact']['at']} at {trial['lost_contact']['time_s']:.3f} s")
    if trial["fallen_s"] is not None:
        parts.append(f"the body falls at {trial['fallen_s']:.3f} s")
    return " and ".join(parts)


def _ends(trials: Iterable[Facts]) -> list[tuple[str, Style | None]]:
    """Ends that say little or nothing; what several trials of a scenario have in common is said of the first."""
    found: dict[str, tuple[str, Style | None]] = {}
    for trial in trials:
        where = f"{trial['scenario']}, trial {trial['trial']}"
        if _lost(trial):
            found.setdefault(
                f"{trial['scenario']} {_lost(trial)}", (f"{where}: {_lost(trial)}; its end is not used.", Style.BAD)
            )
        elif not trial["stationary"]:
            bound = f"{number(trial['fx_bound_n'], 3)} N and {number(trial['fy_bound_n'], 3)} N"
            why = trial["not_stationary_because"]
            text = f"{where} does not come to rest; its estimate may be off by {bound}: {why}."
            found.setdefault(f"{trial['scenario']} {trial['start']}", (text, Style.DOUBT))
    return list(found.values())


def _starts(trials: Sequence[Facts]) -> list[tuple[str, Style | None]]:
    """Starts from an estimate not made, or made in spite of toe and heel; once for each change of scenario."""
    found: dict[tuple[str, str], tuple[str, Style | None]] = {}
    for before, trial in pairwise(trials):
        refused, change = trial["refused"], (before["scenario"], trial["scenario"])
        where = f"{trial['scenario']}, trial {trial['trial']}"
        least = f"the smallest contact force is {number((refused or trial)['contact_force_n'])} N"
        outcome = _lost(refused or trial) or "contact is kept"
        if trial["blindly"]:
            text = f"{where} starts from the estimate blindly: {trial['reason']}. There {outcome}; {least}."
            found.setdefault(change, (text, Style.DOUBT))
        elif refused:
            text = f"{where} starts as the spec says: {trial['reason']}. Started from the estimate, at"
            text += f" {fixed(refused['desired_angle_deg'], 2)} deg, {outcome}; {least} instead of"
            text += f" {number(trial['contact_force_n'])} N."
            found.setdefault(change, (text, Style.DOUBT))
    return list(found.values())


def _survived(survives: Iterable[Facts]) -> list[str]:
    words = {True: "contact is kept", False: "contact is lost"}
    found = []
    for each in survives:
        text = f"Standing on what trial {each['after_trial']} found ({each['scenario']}, {each['of']}"
        text += f" {number(each['from'], 4)} {each['unit']}), the law survives a sudden change by up to"
        text += f" +{number(each['up'], 4)} and {number(each['down'], 4)} {each['unit']}"
        if each["kept_from_the_estimate"] is not None:
            text += f"; into {each['next']} {words[each['kept_from_the_estimate']]} from there"
        found.append(text + ".")
    return found


def _contraction(found: Facts) -> tuple[str, Style | None]:
    at, box, check = found["at"], found["box"], found["checked"]
    size = number(found["factor"], 3) if math.isfinite(found["factor"]) else "more than can be computed"
    left = f"a trial of {number(at['trial_s'], 4)} s leaves {size} of a small error in the start"
    where = f" at worst over {box['points']} point{'s' * (box['points'] != 1)}"
    if box["corners"]:
        where += f" of the box of [uncertainty] ({box['corners']} corners, {box['drawn']} drawn) and the scenarios"
    else:
        where += " of the scenarios (no [uncertainty]: the nominal body)"
    text = f"In a world that stays the trials {'contract' if found['contracts'] else 'do not contract'}: {left}{where}"
    one, tenth = found["stays_below_1_from_s"], found["stays_below_0.1_from_s"]
    if one is not None:
        text += f"; less than all of it from {number(one, 4)} s on, less than a tenth from {number(tenth, 4)} s on"
    elif found["limit"] is not None:
        text += f"; without the integral it tends to K_p/(K_p - A L) = {number(found['limit'])}: no length is enough"
    else:
        text += "; the loop is not stable at all of them"
    text += (
        f". Checked at {check['points']} point{'s' * (check['points'] != 1)} of the box by simulation, in"
        f" {check['trials']} trial{'s' * (check['trials'] != 1)} from {number(check['error_deg'], 3)} deg or what was"
        " left of it: "
    )
    if math.isfinite(check["largest_ratio"]):
        text += f"the largest ratio is {number(check['largest_ratio'], 4)}, and none is farther than"
        text += f" {check['largest_difference_from_factor']:.1e} from the linear one."
    else:
        text += "the body falls."
    return text, Style.GOOD if found["contracts"] else Style.BAD
