"""From a reference on the command line, a spec or a stored design, to the problem and its verdict."""

from __future__ import annotations

import math
from dataclasses import replace

from design.analysis.obstacles import beyond_ankles
from design.analysis.rows import Verdict
from design.analysis.verdict import judge
from design.errors import BadInput
from design.model.laws import Gains, LawKind
from design.present import terminal
from design.present.report import Report
from design.present.store import read_design
from design.recordings.reading import Reading
from design.spec.load import Source, decode, load, parse, read_bytes
from design.spec.setting import Setting, parse_gains, setting


def opened(
    reference: str, law: LawKind | None = None, gains: str | None = None, *, strict: bool = False
) -> tuple[Source, Setting]:
    """The spec or design at ``reference`` in SI units, under the ``law`` and ``gains`` of the command line.

    Remarks on implausible numbers go to standard error; ``strict`` raises ``BadInput`` for the first.
    """
    own: Gains | None = None
    kind: LawKind | None = None
    if reference.endswith(".json"):
        text, own, kind = read_design(decode(read_bytes(reference), reference), reference)
        source = parse(text, origin=reference)
    else:
        source = load(reference)
    for remark in source.remarks:
        if strict:
            message = f"{remark} (--strict)"
            raise BadInput(message, file=source.origin)
        terminal.note(f"warning: {source.origin}: {remark}")
    problem = setting(source.spec)
    if math.isfinite(problem.adapt) and (law or kind or "force") != "force":
        terminal.note(f"remark: law.adapt_s is for law force; law {law or kind} does without")
    problem = problem.with_law(law or kind)
    return source, problem.with_law(None, parse_gains(gains, problem.law) if gains is not None else own)


def judged(
    reference: str,
    law: LawKind | None = None,
    gains: str | None = None,
    *,
    strict: bool = False,
    beside: Report | None = None,
    record: str | None = None,
    how: Reading | None = None,
    drawn: bool = False,
) -> Report:
    """The report on a spec or design, to be ``drawn`` or not; ``beside`` another it is judged by that one's spec.

    With a ``record``, a file that is read as ``how`` says, the measured trial is judged and no run.
    """
    if record is not None:
        from design.present import recording

        if law is not None or gains is not None:
            message = "is judged as it was measured; leave out --law and --gains"
            raise BadInput(message, key="--record")
        return recording.judged(record, how or Reading(), reference, strict=strict)
    if how is not None and how != Reading():
        message = "is missing; the options that say how a recording is read go with it"
        raise BadInput(message, key="--record")
    if beside is not None and beside.record is not None:
        message = "compares designs; a recording is judged alone"
        raise BadInput(message, key="--against")
    source, problem = opened(reference, law, gains, strict=strict)
    its = problem.given_gains()
    if beside is not None:
        source, problem = beside.source, beside.setting.with_law(problem.law, its)
        its = problem.given_gains()
    verdict = judge(problem, its, "all", drawn=drawn)
    remarks = _physical_limits(problem, verdict)
    return Report(source=source, setting=problem, gains=its, verdict=verdict, remarks=remarks)


def _physical_limits(problem: Setting, verdict: Verdict) -> tuple[str, ...]:
    """A sentence for each scenario whose contact is lost and that no ankle survives."""
    lost = [
        row.scenario or "" for row in verdict.rows if row.id in ("toe-force", "heel-force") and row.status == "violated"
    ]
    return tuple(each.sentence(problem.biped) for each, _ in beyond_ankles(problem, lost)) if lost else ()


def proved(report: Report, seconds: float) -> Report:
    """The report with what can be proved of its rows within ``seconds``; raises ``BadInput`` for a recording."""
    from design.present import proving

    if report.gains is None:
        message = "proves what a design does; a recording is judged as it was measured"
        raise BadInput(message, key="--prove")
    if not 0 < seconds <= 86400:
        message = f"is {seconds:g}; needs seconds above 0, at most 86400"
        raise BadInput(message, key="--prove")
    problem = report.setting
    names = [scenario.name for scenario in problem.scenarios]
    with terminal.progress() as say:
        proofs, _ = proving.proved_in(report.source, problem, report.gains, names, seconds=seconds, say=say)
    verdict = proving.with_proofs(problem, report.verdict, proofs)
    said = (*report.remarks, *proving.remarks(proofs))
    return replace(report, verdict=verdict, remarks=said)
