"""Pictures drawn in a second process, which loads matplotlib while this one computes."""

from __future__ import annotations

from concurrent.futures import Executor

from design.workers import Here, processes


def pen(*, apart: bool) -> Executor:
    """Where pictures are drawn: ``apart`` in a process that makes ready at once, or here."""
    return processes(1, start="quick", ready=_ready) if apart else Here()


def _ready() -> None:
    from design.present import html, plots

    html.svg(plots.canvas(4.0, 3.0)[0])
