"""A study's folder: the journal of its trials, and what is made from them whenever it ends."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from design.errors import BadInput, Infrastructure
from design.present import store, study_text, terminal


def check(folder: str | None, *, resume: bool) -> None:
    """Raise ``BadInput`` if there is nothing to resume from."""
    if resume and folder is None:
        message = "needs the folder of the study; name it with -o FOLDER"
        raise BadInput(message, key="--resume")
    if folder is not None and not Path(folder).is_dir():
        store.check_writable(folder)


@contextmanager
def kept(folder: str | None) -> Iterator[None]:
    """Say, when work is interrupted, what is kept and how to go on."""
    try:
        yield
    except (KeyboardInterrupt, SystemExit, Infrastructure):
        if folder is not None and Path(folder, "trials.jsonl").exists():
            terminal.note(f"stopped; what has ended is in {folder}; continue with --resume -o {folder}")
        raise


def write(folder: str, document: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> None:
    """``summary.json``, ``trials.csv``, ``report.md`` and ``report.html``, each whole or not at all."""
    from design.present.study_html import as_html

    store.write(Path(folder, "summary.json"), store.dumps(document))
    store.write(Path(folder, "trials.csv"), study_text.csv_text(rows))
    store.write(Path(folder, "report.md"), study_text.as_markdown(document))
    store.write(Path(folder, "report.html"), as_html(document, rows))
