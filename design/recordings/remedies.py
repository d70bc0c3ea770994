"""Options that may make a file readable: each is tried on the file before a message proposes it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from design.errors import BadInput
from design.recordings.reading import Reading
from design.recordings.selection import entries
from design.recordings.units import unit_of

DEPTH = 3
"""How many remedies, one after the other, are tried together."""
MOST_TRIALS = 16
"""How many ways of reading a file are tried for one message."""


@dataclass(frozen=True, kw_only=True)
class Remedy:
    """A change of how a file is read: ``options`` by role of ``--columns``, or as ``--rate``, and ``when`` it is right.

    An empty value removes a role from ``--columns``. ``last``: proposed only where no other helps.
    """

    options: dict[str, str]
    when: str = ""
    last: bool = False


class Misfit(BadInput):
    """A recording that does not fit, and the ``remedies`` that may be right; ``otherwise``: what to do if none is."""

    def __init__(
        self,
        message: str,
        *,
        file: str | None = None,
        key: str | None = None,
        remedies: Sequence[Remedy] = (),
        otherwise: str = "",
    ) -> None:
        self.remedies, self.otherwise, self.problem = tuple(remedies), otherwise, message
        super().__init__(f"{message}; {otherwise}" if otherwise else message, file=file, key=key)

    def advised(self, read: Callable[[Reading], int], how: Reading) -> BadInput:
        """The error whose message proposes those remedies under which ``read`` raises no error, and warns least.

        ``read``: the number of warnings with which the file can be read in a way.
        """
        trials = [MOST_TRIALS]
        advice: dict[str, int] = {}
        for remedy in sorted(self.remedies, key=lambda remedy: remedy.last):
            if remedy.last and advice:
                break
            first = apply(how, remedy)
            works = _working(read, first, [how], trials)
            if works is not None and _keeps(works[0], first, remedy):
                way, warnings = works
                advice.setdefault(f"{spoken(how, way)}{remedy.when}", warnings)
        best = [text for text, warnings in advice.items() if warnings == min(advice.values())]
        what = f"give {', or '.join(best)}" if best else self.otherwise
        return BadInput(f"{self.problem}; {what}" if what else self.problem, file=self.file, key=self.key)


def _working(
    read: Callable[[Reading], int], how: Reading, tried: list[Reading], trials: list[int]
) -> tuple[Reading, int] | None:
    """``how``, or ``how`` with one remedy more, if a file can be read so, and with how many warnings; else None."""
    if how in tried or trials[0] <= 0:
        return None
    trials[0] -= 1
    tried = [*tried, how]
    try:
        return how, read(how)
    except Misfit as misfit:
        if len(tried) > DEPTH:
            return None
        further = (_working(read, apply(how, remedy), tried, trials) for remedy in misfit.remedies)
        return next((works for works in further if works is not None), None)
    except BadInput:
        return None


def _keeps(way: Reading, first: Reading, remedy: Remedy) -> bool:
    """Whether ``way`` gives the roles of a ``remedy`` as ``first`` does: none that came later took them back."""
    columns, own = entries(way.columns), entries(first.columns)
    return all(columns.get(role, "").startswith(own[role]) for role in remedy.options if role in own)


def apply(how: Reading, remedy: Remedy) -> Reading:
    """``how`` with the options of a ``remedy`` in place of its own."""
    columns = entries(how.columns)
    others: dict[str, object] = {}
    for name, value in remedy.options.items():
        if name.startswith("--"):
            field = name.removeprefix("--").replace("-", "_")
            others[field] = {"rate": float, "resample": float, "allow_gaps": bool}.get(field, str)(value)
        elif value:
            columns[name] = _in_unit(columns.get(name, ""), value)
        else:
            columns.pop(name, None)
    text = ",".join(f"{role}={value}" for role, value in columns.items()) or None
    if columns == entries(how.columns):
        text = how.columns
    return replace(how, columns=text, **others)  # type: ignore[arg-type]


def _in_unit(before: str, value: str) -> str:
    """The ``value`` of a role; where it is a unit of some of the columns ``before``, the unit of all of these."""
    label, _, unit = value.rpartition(":")
    former, _, old = before.rpartition(":")
    former = former if unit_of(old) else before
    if unit_of(unit) and set(label.split("+")) < set(former.split("+")):
        return f"{former}:{unit}"
    return value


def spoken(before: Reading, after: Reading) -> str:
    """The options that turn ``before`` into ``after``, as they are written on the command line."""
    parts = []
    for name in ("columns", "delimiter", "decimal", "up", "forward", "ankle", "origins", "rate", "resample"):
        value = getattr(after, name)
        if value != getattr(before, name) and value is not None:
            text = f"{value:.6g}" if isinstance(value, float) else str(value)
            quoted = text if name != "columns" else "'" + text.replace("'", "'\\''") + "'"
            parts.append(f"--{name} {quoted}")
    if after.allow_gaps and not before.allow_gaps:
        parts.append("--allow-gaps")
    return " ".join(parts)
