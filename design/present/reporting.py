"""`poise report` from its arguments to what it prints; pictures are drawn in a second process from the start on."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from design.present import drawing, terminal
from design.recordings.reading import Reading

if TYPE_CHECKING:  # nothing heavy before the second process is there
    from design.analysis.rows import RowStatus
    from design.model.laws import LawKind

ENDINGS = {".html": "html", ".md": "md", ".json": "json", ".xml": "junit"}


def render(
    spec: str,
    law: LawKind | None,
    gains: str | None,
    against: str | None,
    record: str | None,
    prove: float | None,
    how: Reading,
    form: str,
    output: str | None,
    *,
    strict: bool,
) -> tuple[str, RowStatus]:
    """The report in a ``form``, or in the one that the ending of ``output`` asks for, and its verdict.

    ``prove``: the seconds to spend on proofs of its rows; None for none.
    """
    if output and form == "text":
        form = ENDINGS.get(Path(output).suffix, form)
    with drawing.pen(apart=form == "html") as pen:
        from design.present import opening, report, store

        store.check_writable(output)
        if record is not None and output is not None:
            from design.present.recording import check_apart

            check_apart(record, spec, {"-o": output})
        one = opening.judged(spec, law, gains, strict=strict, record=record, how=how, drawn=form == "html")
        if prove is not None:
            one = opening.proved(one, prove)
        other = opening.judged(against, strict=strict, beside=one) if against else None
        paint = terminal.painter_for_output(to_file=output is not None)
        return report.render(form, one, other, (spec, against or ""), paint, pen), one.verdict.overall
