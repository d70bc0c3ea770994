"""Standard output for results, standard error for the rest; colours and progress only where a terminal shows them."""

from __future__ import annotations

import io
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from design.errors import PoiseError

if TYPE_CHECKING:  # NumPy waits until there is something to paint
    from design.present.text import Paint


def out(text: str) -> None:
    """A part of the result; if who reads it has seen enough, the program ends well."""
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(0) from None


def note(text: str) -> None:
    """A line beside the result."""
    sys.stderr.write(text + "\n")


def is_usage(error: Exception) -> bool:
    """Whether it is wrong usage, which the command line's library words itself."""
    return hasattr(error, "show")


def failed(error: Exception) -> None:
    """One line for wrong usage or an internal error."""
    if is_usage(error):
        error.show()  # type: ignore[attr-defined]
        return
    said = " ".join(str(error).split())[:200]
    note(f"poise: internal error: {type(error).__name__}: {said}; rerun with --debug")


def ended(run: Callable[[], object], *, debug: bool, stops: tuple[type[BaseException], ...]) -> int:
    """The exit code with which ``run`` ends: its own, 2 for an error, 130 for one of ``stops``; ``debug`` raises."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        with insistent_interrupts():
            code = run()
        sys.stdout.flush()
    except PoiseError as error:
        if debug:
            raise
        note(f"poise: {error}")
        return 2
    except stops:
        note("poise: interrupted")
        return 130
    except Exception as error:
        if debug and not is_usage(error):
            raise
        failed(error)
        return 2
    return code if isinstance(code, int) else 0


def deliver(result: str, output: str | None) -> None:
    """The result to the file ``output``, or to standard output."""
    if output:
        from design.present.store import write

        write(output, result)
    else:
        out(result)


def painter_for_output(*, to_file: bool = False) -> Paint:
    """Colours where standard output is a terminal and NO_COLOR is not set."""
    from design.present.text import painter

    return painter(sys.stdout.isatty() and not to_file and not os.environ.get("NO_COLOR"))


@contextmanager
def progress() -> Iterator[Callable[[str], None]]:
    """One line on standard error that is written over, where that is a terminal."""
    live = sys.stderr.isatty()

    def say(text: str) -> None:
        if live:
            sys.stderr.write(f"\r\033[K{text}")
            sys.stderr.flush()

    try:
        yield say
    finally:
        if live:
            sys.stderr.write("\r\033[K")


def cores() -> int:
    """How many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0)) or 1
    return os.cpu_count() or 1


@contextmanager
def terminated_like_interrupted() -> Iterator[None]:
    """A SIGTERM, as a cluster sends it, ends the work as Ctrl-C does, with exit code 143."""

    def stop(number: int, frame: object) -> None:
        raise SystemExit(128 + number)

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def insistent_interrupts() -> Iterator[None]:
    """Ctrl-C is raised again every half second until it comes through: CasADi's glue can swallow it."""
    if not hasattr(signal, "setitimer") or threading.current_thread() is not threading.main_thread():
        yield
        return

    def again(number: int, frame: object) -> None:
        signal.setitimer(signal.ITIMER_REAL, 0.5)
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, again), signal.signal(signal.SIGALRM, again)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGINT, before[0])
        signal.signal(signal.SIGALRM, before[1])
