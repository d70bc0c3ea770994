"""Errors that a user can act on.

::

    PoiseError            anything that Poise says on purpose; one line
    ├── BadInput          what was given cannot be used: file, key, value, what is allowed   (exit 2)
    ├── Infrastructure    workers, scheduler or memory are gone: says nothing of the problem (exit 3)
    └── Unsolved          the value of an outcome was asked for, but its status is not "solved"

Each stores its facts; the sentence is made from them.
"""

from __future__ import annotations


def one_line(text: str) -> str:
    """``text`` in one line, with what cannot be printed written out."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in " ".join(text.split()))


class PoiseError(Exception):
    """Base of the errors that Poise raises on purpose; ``str()`` is one line for the user."""


class BadInput(PoiseError):
    """An input that cannot be used.

    Parameters: ``message`` says what was got, what is needed and what to do, in this order; ``file`` and ``key``
    say where; ``others`` counts further problems of the same file.
    """

    def __init__(self, message: str, *, file: str | None = None, key: str | None = None, others: int = 0) -> None:
        self.message, self.file, self.key, self.others = message, file, key, others
        where = ": ".join(part for part in (file, key) if part)
        more = f" (and {others} more problem{'s' * (others > 1)} in this file)" if others else ""
        super().__init__(one_line(f"{where}: {message}{more}".removeprefix(": ")))


class Infrastructure(PoiseError):
    """Workers, a scheduler or memory are gone; what was finished is kept, and nothing is known of the rest."""


class Unsolved(PoiseError):
    """The value of an outcome that has none."""
