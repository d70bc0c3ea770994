"""`poise prove`: what is proved of a design, for which box, under which assumptions; in words and JSON, and as rows."""

from __future__ import annotations

import math
import textwrap
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

from design.analysis.rows import Row, RowStatus, Verdict
from design.errors import BadInput
from design.model.laws import Gains, LawKind
from design.present import opening, store, terminal, text
from design.proof.box import Answer, Proof, levels, prove
from design.proof.largest import Largest
from design.proof.largest import largest as find_largest
from design.spec.load import Source
from design.spec.setting import Setting

ASSUMPTIONS = (
    "the two-link model with a rigid foot that does not slip, the law in continuous time, no delay, no noise; numbers"
    " of the body and world count with all within 1e-14 of them, what the law reckons with as the floats that it is"
)
UNCHECKED = "certificates are for laws pd and force without adapt_s"
STABILITY = ("stiffness", "damping", "routh", "decay-rate")
ROWS: dict[str, tuple[str, str]] = {
    "stiffness": ("(27)", "N m/rad"), "damping": ("(28)", "m/s"), "routh": ("(29)", "N² m² s"),
    "decay-rate": ("(24)", "1/s"), "toe-force": ("(5)", "N"), "heel-force": ("(6)", "N"), "cop-margin": ("(18)", "m"),
    "torque": ("(8)", "N m"),
}  # fmt: skip
UNITS = {"M": ("mass", "kg", 1.0), "L": ("com height", "m", 1.0), "I": ("inertia", "kg m²", 1.0),
         "m": ("foot mass", "kg", 1.0), "ell": ("half length", "m", 1.0), "slope": ("slope", "deg", 180 / math.pi),
         "ramp": ("ramp", "s", 1.0)}  # fmt: skip
WORST: dict[Answer, int] = {"proved": 0, "unknown": 1, "disproved": 2}
STYLES: dict[Answer, text.Style] = {
    "proved": text.Style.GOOD, "disproved": text.Style.BAD, "unknown": text.Style.DOUBT,
}  # fmt: skip
WORDS: dict[RowStatus, tuple[str, text.Style]] = {
    "met": ("PROVED", text.Style.GOOD),
    "violated": ("DISPROVED", text.Style.BAD),
    "undecided": ("UNKNOWN", text.Style.DOUBT),
}


def render(
    reference: str,
    law: LawKind | None,
    gains: str | None,
    scenario: str | None,
    scale: float,
    seconds: float,
    form: str,
    output: str | None = None,
    *,
    certificate: str | None = None,
    largest: bool = False,
    strict: bool = False,
) -> tuple[str, Answer]:
    """Prove, and say what came of it in a ``form``, text or json; and the answer over all scenarios."""
    source, problem = opening.opened(reference, law, gains, strict=strict)
    its = problem.given_gains()
    store.check_writable(output, certificate)
    names = [each.name for each in problem.scenarios] if scenario is None else [problem.scenario(scenario).name]
    if certificate and (why := _no_certificate(source, problem)):
        message = f"{why}; prove without --certificate"
        raise BadInput(message, key="--certificate")
    deadline, jobs = time.monotonic() + seconds, 1 + largest
    with terminal.progress() as say:
        proofs, entries = proved_in(source, problem, its, names, seconds=seconds / jobs, scale=scale, say=say)
        sizes = _sizes(problem, its, names, deadline - time.monotonic(), say) if largest else []
        if certificate and entries:
            from design.proof import certificate as certificates

            store.write(certificate, certificates.document(source, problem, its, entries, scale))
        elif certificate:
            terminal.note(f"{certificate}: not written: nothing is proved")
    answer = overall(proofs)
    if form == "json":
        sized = {"largest": [asdict(size) | {"ratio": size.ratio} for size in sizes]} if largest else {}
        return store.dumps(document(source, problem, its, proofs, scale) | sized), answer
    paint = terminal.painter_for_output(to_file=output is not None)
    return as_text(source, problem, its, proofs, sizes, paint), answer


def _sizes(
    problem: Setting, gains: Gains, names: list[str], seconds: float, say: Callable[[str], None]
) -> list[Largest]:
    try:
        return [find_largest(problem, gains, name, seconds=seconds / len(names), say=say) for name in names]
    except ValueError as error:
        raise BadInput(str(error), key="--largest") from None


def _no_certificate(source: Source, problem: Setting) -> str:
    """Why no certificate of this can be written; empty where one can."""
    if problem.law == "cop" or math.isfinite(problem.adapt):
        return UNCHECKED
    from design.proof.certificate import uncovered

    what = uncovered(source)
    return f"certificates are not for {what}" if what else ""


def proved_in(
    source: Source,
    problem: Setting,
    gains: Gains,
    names: list[str],
    *,
    seconds: float,
    scale: float = 1.0,
    say: Callable[[str], None] = lambda _: None,
) -> tuple[list[Proof], list[dict[str, Any]]]:
    """A proof for each scenario of these ``names``, and the certificate's entries of those that are proved.

    What has a certificate counts as proved only where the independent checker confirms it, and with the bounds that it
    confirms. ``seconds`` is for all of them; what the prover leaves of it is the checker's.
    """
    deadline = time.monotonic() + seconds
    unchecked = _no_certificate(source, problem)
    proofs: list[Proof] = []
    entries: list[dict[str, Any]] = []
    for k, name in enumerate(names):
        left = max(deadline - time.monotonic(), 0.0) / (len(names) - k)
        proof = prove(problem, gains, name, seconds=left, scale=scale, say=say)
        proof.unchecked = unchecked
        if not unchecked and proof.answer == "proved":
            entries += _checked(source, problem, gains, proof, scale, left - proof.seconds, say)
        proofs.append(proof)
    return proofs, entries


def _checked(
    source: Source, problem: Setting, gains: Gains, proof: Proof, scale: float, seconds: float,
    say: Callable[[str], None],
) -> list[dict[str, Any]]:  # fmt: skip
    """The entry of a proof that the checker confirms, which then has the bounds of it; else it is unknown."""
    from design.proof.certificate import Unconfirmed, confirmed

    began = time.monotonic()
    try:
        entry, answer = confirmed(source, problem, gains, proof, scale, seconds=seconds, say=say)
    except Unconfirmed as error:
        proof.answer, proof.why = "unknown", f"bounded, but the independent checker does not confirm it: {error}"
        return []
    finally:
        proof.seconds += time.monotonic() - began
    proof.checked, proof.every_time = True, answer.for_ever[proof.scenario]
    proof.value |= {row: float(value) for row, value in answer.claims[proof.scenario].items()}
    return [entry]


def overall(proofs: list[Proof]) -> Answer:
    """The worst answer."""
    return max((proof.answer for proof in proofs), key=lambda answer: WORST[answer])


def rows(problem: Setting, proofs: list[Proof]) -> list[Row]:
    """The bounds as rows: proved ones are met for all times and the whole box; a counterexample is violated."""
    demanded = levels(problem)
    return [
        _row(problem, proof, row, demanded.get(row, 0.0))
        for proof in proofs
        for row in ROWS
        if row in demanded or row in proof.value
    ]


def _row(problem: Setting, proof: Proof, row: str, level: float) -> Row:
    equation, unit = ROWS[row]
    broken = proof.counterexample
    facts: dict[str, Any] = {
        "id": row, "equation": equation, "scenario": proof.scenario, "required": level,
        "unit": "N m s/rad" if row == "damping" and problem.law == "pd" else unit,
    }  # fmt: skip

    def margin(value: float) -> float:
        return level - value if row == "torque" else value - level

    if broken is not None and broken.row == row:
        return Row(
            **facts, value=broken.value, margin=margin(broken.value), status="violated", time_s=broken.time_s,
            basis="sampled",
        )  # fmt: skip
    value = proof.value.get(row)
    # of one body and world, what is decided exactly holds whatever becomes of the rest
    alone = not proof.box and (bool(proof.unchecked) or row in STABILITY)
    if value is not None and (proof.answer == "proved" or alone):
        return Row(
            **facts, value=value, margin=margin(value), status="met", time_s=proof.time_s.get(row), basis="proved"
        )  # fmt: skip
    return Row(**facts, value=None, margin=None, status="undecided", time_s=None, basis="sampled", note=proof.why)


def document(source: Source, problem: Setting, gains: Gains, proofs: list[Proof], scale: float) -> dict[str, Any]:
    """The JSON of the command."""
    answer = overall(proofs)
    ever: dict[str | None, bool] = {proof.scenario: _ever(proof) for proof in proofs}
    return store.document(
        "prove", source, status=answer, verdict=answer, law=problem.law, gains=store.gains_json(gains),
        rows=[
            store.row_json(row) | {"every_time": ever[row.scenario]} for row in rows(problem, proofs)
        ],
        assumptions=ASSUMPTIONS, scale=scale,
        scenarios=[
            {
                "name": proof.scenario, "verdict": proof.answer, "share_of_box": proof.share, "parts": proof.parts,
                "seconds": proof.seconds, "why": proof.why, "box": _box(proof.box),
                "counterexample": _counterexample(proof), "every_time": _ever(proof), "end_s": proof.end_s,
                "checked": proof.checked,
            }
            for proof in proofs
        ],
    )  # fmt: skip


def _ever(proof: Proof) -> bool:
    """Whether it is proved at every time, also after the scenario's end."""
    return proof.answer == "proved" and proof.every_time


def _box(box: dict[str, tuple[float, float]]) -> dict[str, dict[str, Any]]:
    return {
        UNITS[name][0]: {"from": low * UNITS[name][2], "to": high * UNITS[name][2], "unit": UNITS[name][1]}
        for name, (low, high) in box.items()
    }


def _counterexample(proof: Proof) -> dict[str, Any] | None:
    broken = proof.counterexample
    if broken is None:
        return None
    at = {
        UNITS[name][0]: {"value": value * UNITS[name][2], "unit": UNITS[name][1]} for name, value in broken.at.items()
    }
    return {"row": broken.row, "value": broken.value, "time_s": broken.time_s, "at": at}


def as_text(
    source: Source,
    problem: Setting,
    gains: Gains,
    proofs: list[Proof],
    sizes: list[Largest],
    paint: text.Paint,
) -> str:
    """The rows, the box, the assumptions, and the answer, at most 80 wide but for names."""
    lines = [f"{source.spec.name}, law {problem.law}, {text.gains_line(gains, problem.law)}", ""]
    lines.append(f"{'':9} {'row':<11} {'scenario':<12} {'bound':>11} {'needs':>9} {'unit':<9} {'at s':>6}")
    for row in rows(problem, proofs):
        word, style = WORDS[row.status]
        proved = row.basis == "proved"
        value = text.bound(row.value, 7, up=row.id == "torque") if proved else text.number(row.value, 7)
        at = "-" if row.time_s is None else f"{row.time_s:.3f}"
        lines.append(
            f"{paint(f'{word:<9}', style)} {row.id:<11} {row.scenario or '':<12} {value:>11} {row.required:>9.6g}"
            f" {row.unit:<9} {at:>6}"
        )
    lines.append("")
    for proof in proofs:
        lines += textwrap.wrap(f"{proof.scenario}: {_said(proof)}", 78, subsequent_indent="  ")
    for size in sizes:
        said = (
            f"{size.scenario}: {text.bound(size.proved, 3)} times the box of [uncertainty] is bounded by the prover"
            " alone (--scale has the independent checker confirm it); "
            + (f"even {size.unbroken:g}" if size.beyond else f"{size.unbroken:.3g}")
            + f" times it is not broken by sampling its corners and inside: {100 * size.ratio:.0f} % of that is proved"
        )
        lines += textwrap.wrap(said, 78, subsequent_indent="  ")
    lines += ["", *textwrap.wrap(f"Assumes {ASSUMPTIONS}.", 78), ""]
    answer = overall(proofs)
    lines.append(paint(f"contact and stability: {answer.upper()}", STYLES[answer]))
    return "\n".join(lines) + "\n"


def _said(proof: Proof) -> str:
    box = ", ".join(
        f"{name} {text.bound(part['from'], 7, up=True)} to {text.bound(part['to'], 7)} {part['unit']}"
        for name, part in _box(proof.box).items()
    )
    where = f"for every body and world with {box}" if box else "for the nominal numbers"
    took = f"{proof.parts} {'part' if proof.parts == 1 else 'parts'}, {proof.seconds:.1f} s"
    if proof.answer == "proved":
        said = (
            "confirmed by the independent checker" if proof.checked else f"not independently checked: {proof.unchecked}"
        )
        return f"PROVED {where}, {_when(proof)}; {said} ({took})"
    broken = proof.counterexample
    if broken is not None:
        at = "" if broken.time_s is None else f" at {broken.time_s:.3f} s"
        point = ", ".join(
            f"{UNITS[name][0]} {broken.at[name] * UNITS[name][2]:.9g} {UNITS[name][1]}" for name in proof.box
        )
        return f"DISPROVED: {broken.row} is {broken.value:.6g}{at}{f', with {point}' if point else ''} ({took})"
    bounded = f"; {text.bound(100 * proof.share, 3)} % of the box is bounded" if proof.box else ""
    return f"UNKNOWN {where}: {proof.why}{bounded} ({took})"


def _when(proof: Proof) -> str:
    if proof.every_time:
        return "at every time, also after the scenario's end, where its force rests"
    return f"until the end at {proof.end_s:g} s, where its force still moves or jumps; not after it"


def remarks(proofs: list[Proof]) -> tuple[str, ...]:
    """What a report says of its proofs: for which box, and under which assumptions."""
    return (*(f"proof, {proof.scenario}: {_said(proof)}" for proof in proofs), f"the proof assumes {ASSUMPTIONS}")


def with_proofs(problem: Setting, verdict: Verdict, proofs: list[Proof]) -> Verdict:
    """A report's verdict in which proved rows say so, with a bound for their value, and disproved ones are violated."""
    found = {(row.scenario, row.id): row for row in rows(problem, proofs) if row.status != "undecided"}
    by_name = {proof.scenario: proof for proof in proofs}
    changed = [
        _replaced(row, better, by_name[str(row.scenario)])
        if (better := found.get((row.scenario, row.id))) is not None
        else row
        for row in verdict.rows
    ]
    return replace(verdict, rows=tuple(changed))


def _replaced(row: Row, better: Row, proof: Proof) -> Row:
    box = bool(proof.box)
    reach = "all times" if proof.every_time else f"all times until the end at {proof.end_s:g} s"
    reach += " and the whole box of [uncertainty]" if box else ""
    reach += f", not independently checked: {proof.unchecked}" if proof.unchecked else ""
    if better.status == "violated":
        note = "a body and world of the box of [uncertainty] break it" if box else "broken"
        return replace(better, required=row.required if row.required is not None else better.required,
                       note=_joined(row.note, note))  # fmt: skip
    if row.id in ("stiffness", "damping", "routh"):  # these show both sides; proved is their distance
        said = f"proved for {reach}: the margin is at least {text.bound(better.value)}"
        return replace(row, basis="proved", note=_joined(row.note, said))
    sampled = f"; {row.value:.6g} at the samples" if row.value is not None else ""
    margin = None if row.required is None else better.margin
    return replace(
        row, basis="proved", value=better.value, margin=margin, time_s=better.time_s,
        note=_joined(row.note, f"proved for {reach}{sampled}"),
    )  # fmt: skip


def _joined(note: str, more: str) -> str:
    return f"{note}; {more}" if note else more
