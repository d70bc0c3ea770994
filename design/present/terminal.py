"""Standard output for results, standard error for the rest; colours and progress only where a terminal shows them."""

from __future__ import annotations

import io
import multiprocessing
import os
import re
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, TextIO

from design.errors import BadInput, Infrastructure, PoiseError

INTERRUPTED = 130
BUG_REPORT = "poise-bug-report.txt"

if TYPE_CHECKING:  # NumPy waits until there is something to paint
    from design.present.text import Paint


OBEYED = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")
"""Characters that a terminal obeys, or by which it turns the order of others."""
PAINT = re.compile(r"(\x1b\[[0-9;]*m)")


def harmless(text: str, *, painted: bool = False) -> str:
    """``text`` with its control characters written out, as JSON does it; colours of ``painted`` text stay."""
    if not OBEYED.search(text):
        return text
    if painted:
        return "".join(part if PAINT.fullmatch(part) else harmless(part) for part in PAINT.split(text))
    return OBEYED.sub(lambda match: f"\\u{ord(match[0]):04x}", text)


def out(text: str | Iterable[str]) -> None:
    """Write a part of the result; a reader that has closed the stream changes nothing, a full disk is ``BadInput``."""
    painted = sys.stdout.isatty()
    try:
        for part in [text] if isinstance(text, str) else text:
            sys.stdout.write(harmless(part, painted=painted))
        sys.stdout.flush()
    except BrokenPipeError:
        _discard(sys.stdout)
    except OSError as error:
        _discard(sys.stdout)
        message = f"cannot be written: {error.strerror or error}; choose another place with -o FILE"
        raise BadInput(message, key="standard output") from None


def note(text: str) -> None:
    """A line beside the result, dropped where standard error is closed or full."""
    try:
        sys.stderr.write(harmless(text) + "\n")
        sys.stderr.flush()
    except (OSError, ValueError):
        _discard(sys.stderr)


def _discard(stream: TextIO) -> None:
    """Let everything that is still written to ``stream`` vanish, also what Python flushes at its end."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def is_usage(error: Exception) -> bool:
    """Whether it is wrong usage, which the command line's library words itself."""
    return hasattr(error, "show")


def failed(error: Exception) -> None:
    """One line for wrong usage or an internal error."""
    if is_usage(error):
        shown = io.StringIO()
        error.show(shown)  # type: ignore[attr-defined]
        note(shown.getvalue().rstrip())
        return
    if isinstance(error, ImportError):
        note(f"poise: {error}; a package is missing or broken: pip install --force-reinstall poise; see `poise doctor`")
        return
    line = " ".join(str(error).split())[:200]
    note(f"poise: internal error: {type(error).__name__}: {line}; rerun with --debug, which writes a report of it")


def _report(error: Exception) -> None:
    """Write what a bug report needs to a file, and show the traceback."""
    from design.present.doctor import bug_report
    from design.present.store import write

    traceback.print_exception(error)
    write(BUG_REPORT, bug_report(error, sys.argv[1:]))
    note(f"poise: {BUG_REPORT} holds what a bug report needs; it names no folder of yours")


def ended(run: Callable[[], object], *, debug: bool, stops: tuple[type[BaseException], ...]) -> int:
    """The exit code with which ``run`` ends: its own, 2 for an error, 130 for one of ``stops``.

    ``debug`` raises what Poise says on purpose, and reports every other error.
    """
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed before the program began
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # files and pipes get UTF-8, whatever the locale
            stream.reconfigure(encoding=None if stream.isatty() else "utf-8", errors="backslashreplace")
    os.environ["MPLBACKEND"] = "agg"  # a notebook hands its own to the commands that it runs
    arrived = threading.Event()
    try:
        with insistent_interrupts() as arrived:
            code = run()
    except PoiseError as error:
        if debug:
            raise
        note(f"poise: {error}")
        return 3 if isinstance(error, Infrastructure) else 2
    except stops:
        code = INTERRUPTED
    except MemoryError:
        note("poise: there is not enough memory; shorten the scenarios, lengthen the time step, or use fewer --jobs")
        return 2
    except Exception as error:
        if arrived.is_set():  # CasADi's glue has made another error of the interrupt
            code = INTERRUPTED
        else:
            failed(error)
            if debug and not is_usage(error):
                _report(error)
            return 2
    if code == INTERRUPTED:  # typer makes this exit code of an interrupt
        for child in multiprocessing.active_children():  # whatever they do: nobody waits for it
            child.kill()
        note("poise: interrupted")
    return code if isinstance(code, int) else 0


def deliver(result: str | Iterable[str], output: str | None) -> None:
    """The result, or its parts one by one, to the file ``output``, or to standard output."""
    if output:
        from design.present.store import write

        write(output, result)
    else:
        for part in [result] if isinstance(result, str) else result:
            out(part)


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
def insistent_interrupts() -> Iterator[threading.Event]:
    """Ctrl-C is raised again every half second until it comes through: CasADi's glue can swallow it or change it.

    The event is set from the first one on.
    """
    arrived = threading.Event()
    if not hasattr(signal, "setitimer") or threading.current_thread() is not threading.main_thread():
        yield arrived
        return

    def again(number: int, frame: object) -> None:
        arrived.set()
        signal.setitimer(signal.ITIMER_REAL, 0.5)
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, again), signal.signal(signal.SIGALRM, again)
    try:
        yield arrived
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGINT, before[0])
        signal.signal(signal.SIGALRM, before[1])
