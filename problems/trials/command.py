"""From the arguments of `poise trials` to what it prints: open, run, draw."""

from __future__ import annotations

from typing import Literal, NamedTuple

from design.model.laws import LawKind
from design.present import opening, terminal
from design.present import trials as present
from problems.trials.facts import conduct


class Asked(NamedTuple):
    """Which trials: their number, one ``scenario`` or the ``sequence`` A,B,..., the seed, and whether blindly."""

    trials: int | None = None
    scenario: str | None = None
    sequence: str | None = None
    seed: int | None = None
    blind: bool = False


def trials(
    spec: str,
    law: LawKind | None,
    gains: str | None,
    asked: Asked,
    form: Literal["text", "json"],
    plot: str | None,
    output: str | None,
    *,
    strict: bool,
) -> str:
    """Deliver the trials that are ``asked`` for, and say the verdict: met, violated or undecided."""
    source, problem = opening.opened(spec, law, gains, strict=strict)
    present.check(plot, output)
    found = conduct(problem, **asked._asdict())
    paint = terminal.painter_for_output(to_file=output is not None)
    terminal.deliver(present.render(source, found.facts, found.pictures, form, plot, paint), output)
    return str(found.facts["verdict"])
