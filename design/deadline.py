"""One deadline for a whole question: set once at the top, looked at wherever work is cut into pieces.

Solvers look at their own limits once an iteration; what is marched or judged between iterations looks here. A piece of
work that cannot be divided should take less than half a second.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_ends: ContextVar[float] = ContextVar("deadline", default=float("inf"))


class OutOfTime(Exception):
    """The deadline has passed; who set it catches this and keeps the best result so far."""


@contextmanager
def deadline(at: float) -> Iterator[None]:
    """Within the block ``check`` raises once ``time.monotonic()`` is past ``at`` [s], or past an earlier deadline."""
    token = _ends.set(min(at, _ends.get()))
    try:
        yield
    finally:
        _ends.reset(token)


def ends() -> float:
    """The deadline on the clock of ``time.monotonic()`` [s]; infinite where none is set."""
    return _ends.get()


def left() -> float:
    """The seconds left; at least 0."""
    return max(_ends.get() - time.monotonic(), 0.0)


def check() -> None:
    """Raise ``OutOfTime`` if the deadline has passed."""
    if time.monotonic() > _ends.get():
        raise OutOfTime
