"""A journal is a file of rows in a study's folder that only grows, so that a killed study can be continued.

``trials.jsonl`` begins with a line that says what the rows belong to; each later line is one row and its checksum::

    {"journal": 1, "identity": {...}}
    {"crc": 2768625435, "row": {...}}

A row is one write to a descriptor opened for appending. What ``append`` has returned from is the kernel's, so
``kill -9`` leaves at most one torn line, the last, of a row that nobody was told is kept; ``resume`` cuts it off.
Nothing else is ever rewritten. A power failure is not ``kill -9``: the disk is told at most once a second, so what was
written since may be lost.

A lock of the operating system keeps a second writer out and ends with its holder, however that ends. A forked process
may inherit it and keep it: start such workers before the journal is opened.
"""

from __future__ import annotations

import itertools
import json
import os
import platform
import time
import zlib
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import Path
from typing import Any, Self

from filelock import FileLock, Timeout

from design.errors import BadInput
from design.present.store import dumps, write

NAME, LOCK, HOLDER = "trials.jsonl", "trials.lock", "trials.lock.json"
FORMAT = 1
"""The version of the journal's lines."""
SYNC_S = 1.0
"""The least time between two ``fsync`` of ``append`` [s]."""
SHOWN = 5
"""How many differences between identities a message lists."""
_FLAGS = os.O_WRONLY | os.O_APPEND | os.O_CREAT | getattr(os, "O_BINARY", 0)


@dataclass(eq=False, kw_only=True)
class Journal:
    """The rows that are there, and the way to add one; a context manager, whose end releases the lock.

    ``rows`` are as they would be read back: keys are text, and what is not finite is None. ``torn`` counts the torn
    last lines that were cut off, 0 or 1; ``damaged`` the lines that a repair left out. One thread appends.
    """

    path: Path
    rows: list[dict[str, Any]]
    torn: int
    damaged: int
    _fd: int
    _held: ExitStack
    _dirty: bool = False
    _synced: float = field(default_factory=time.monotonic)

    @classmethod
    def open(
        cls,
        folder: str | Path,
        identity: Mapping[str, Any],
        *,
        resume: bool,
        repair: bool = False,
        force_new: bool = False,
    ) -> Self:
        """Begin a journal in ``folder``, or with ``resume`` continue the one there, of the same ``identity``, if any.

        ``repair`` leaves out lines that are damaged, ``force_new`` begins anew whatever is there; either keeps the old
        file beside the new one. The folder is made if it is missing. Raises ``BadInput``, and leaves the journal as it
        is, if the folder cannot be written to or is in use; holds a journal and neither ``resume`` nor ``force_new``;
        holds one of another identity, or without ``repair`` one with a damaged line before its last.
        """
        path = Path(folder, NAME)
        head = _text({"journal": FORMAT, "identity": _plain(identity)}) + b"\n"
        needed = "a folder that can be written to, in one that exists, is needed; choose another place"
        with ExitStack() as held, _saying(folder, "cannot hold a study", needed):
            Path(folder).mkdir(exist_ok=True)
            _lock(Path(folder), held)
            if force_new and path.exists():
                path.replace(_spare(path, "old"))
            damaged = _repaired(path) if repair else 0
            fd = os.open(path, _FLAGS, 0o666)
            held.callback(os.close, fd)
            with path.open("rb") as file:
                lines = file.readlines()
            begun = bool(lines) and not _is_torn_head(lines)
            rows = _continued(lines, identity, path, resume=resume) if begun else []
            kept = begun + len(rows)
            torn = len(lines) - kept
            if torn:
                os.ftruncate(fd, sum(map(len, lines[:kept])))
            journal = cls(
                path=path, rows=rows, torn=torn, damaged=damaged, _fd=fd, _held=held.pop_all(), _dirty=bool(torn)
            )
        if not begun:
            journal._write(head)
        return journal

    def append(self, row: Mapping[str, Any]) -> None:
        """Add a row: once this returns, ``kill -9`` cannot undo it. Raises ``BadInput`` if it cannot be written."""
        if self._fd < 0:
            message = "the journal is closed"
            raise ValueError(message)
        plain = _plain(row)
        self._write(_line(plain))
        self.rows.append(plain)

    def _write(self, line: bytes) -> None:
        """Write the line whole; whatever prevents it ends the journal, since a torn line must stay the last."""
        self._dirty = True
        try:
            with _saying(self.path, "cannot be written", "make room, then continue with --resume"):
                rest = memoryview(line)
                while rest:
                    rest = rest[os.write(self._fd, rest) :]
                if time.monotonic() - self._synced >= SYNC_S:
                    os.fsync(self._fd)
                    self._dirty, self._synced = False, time.monotonic()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Bring the rows to the disk and release the lock; a second call does nothing."""
        fd, self._fd = self._fd, -1
        with _saying(self.path, "cannot be brought to the disk", "check the disk, then continue with --resume"):
            with self._held:
                if fd >= 0 and self._dirty:
                    os.fsync(fd)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def identity_differences(stored: Mapping[str, Any], present: Mapping[str, Any]) -> list[str]:
    """Where two identities differ, one sentence a dotted key: ``gains.kp was 3500, now 3400``; empty if they agree."""
    was, now = dict(_leaves(_plain(stored))), dict(_leaves(_plain(present)))
    found = []
    for key in dict.fromkeys([*was, *now]):
        pair = was.get(key, "absent"), now.get(key, "absent")
        if pair[0] != pair[1]:
            same = sum(1 for _ in takewhile(lambda both: both[0] == both[1], zip(*pair, strict=False)))
            before, after = (_short(text, same - 10 if same > 20 else 0) for text in pair)
            found.append(f"{key} was {before}, now {after}")
    return found


def _leaves(value: Any, key: str = "") -> Iterator[tuple[str, str]]:
    """Every number or word in nested JSON, as text, by its dotted key; 1 and 1.0 are one number, true is none."""
    parts = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    if key and (value in ({}, []) or not isinstance(value, dict | list)):
        yield key, json.dumps(value, ensure_ascii=False).removesuffix(".0")
    for name, part in parts:
        yield from _leaves(part, f"{key}.{name}".removeprefix("."))


def _short(text: str, start: int) -> str:
    return "…" * (start > 0) + text[start : start + 40] + "…" * (len(text) > start + 40)


def _continued(lines: list[bytes], identity: Mapping[str, Any], path: Path, *, resume: bool) -> list[dict[str, Any]]:
    """The rows of a journal that may be continued; the last line is left out if torn. Raises ``BadInput``."""
    stored = _identity(lines[0], path)
    rows = [_row(line) for line in lines[1:]]
    kept = [row for row in rows if row is not None]
    if not resume:
        size = f"{len(kept)} row{'s' * (len(kept) != 1)}"
        message = f"already holds a study of {size}; continue it with --resume, or choose another folder"
        raise BadInput(message, file=str(path.parent))
    if differences := identity_differences(stored, identity):
        more = f"; and {len(differences) - SHOWN} more" if len(differences) > SHOWN else ""
        message = (
            f"holds rows of another study: {'; '.join(differences[:SHOWN])}{more}; rows of two studies are not mixed; "
            "ask what was asked then, choose another folder, or begin anew with --force-new"
        )
        raise BadInput(message, file=str(path.parent))
    if None in rows[:-1]:
        message = (
            "is damaged: it does not agree with its checksum, and only the last line can have been torn by an "
            "interruption; continue with --resume --repair, which runs its trial again"
        )
        raise BadInput(message, file=str(path), key=f"line {2 + rows.index(None)}")
    return kept


def _repaired(path: Path) -> int:
    """Leave out damaged lines before the last, and keep the file as it was beside; how many there were."""
    if not path.exists():
        return 0
    head, *lines = path.read_bytes().splitlines(keepends=True) or [b""]
    damaged = [line for line in lines[:-1] if _row(line) is None]
    if damaged:
        write(_spare(path, "damaged"), path.read_bytes())
        write(path, b"".join([head, *(line for line in lines[:-1] if _row(line) is not None), *lines[-1:]]))
    return len(damaged)


def _spare(path: Path, ending: str) -> Path:
    """A name beside ``path`` that is not taken."""
    names = (path.with_name(f"{path.name}.{ending}{number or ''}") for number in itertools.count())
    return next(name for name in names if not name.exists())


def _is_torn_head(lines: list[bytes]) -> bool:
    """Whether a journal was killed while it wrote its first line; a file of anyone else's is not taken for one."""
    start = b'{"journal": '
    return len(lines) == 1 and not lines[0].endswith(b"\n") and lines[0][: len(start)] == start[: len(lines[0])]


def _identity(line: bytes, path: Path) -> dict[str, Any]:
    try:
        head = json.loads(line)
        found, identity = head["journal"], head["identity"]
        if not isinstance(found, int) or not isinstance(identity, dict):
            raise TypeError
    except (ValueError, TypeError, KeyError, RecursionError):
        message = "is not the first line of a journal; choose another folder"
        raise BadInput(message, file=str(path), key="line 1") from None
    if found != FORMAT:
        message = f"is {found}; this Poise continues {FORMAT}; choose another folder"
        raise BadInput(message, file=str(path), key="journal")
    return identity


def _row(line: bytes) -> dict[str, Any] | None:
    """The row of a line, or None if the line is not, byte for byte, what ``append`` writes for it."""
    try:
        row = json.loads(line)["row"]
        return row if isinstance(row, dict) and _line(row) == line else None
    except (ValueError, TypeError, KeyError, RecursionError):
        return None


def _line(row: Mapping[str, Any]) -> bytes:
    text = _text(row)
    return b'{"crc": %d, "row": %b}\n' % (zlib.crc32(text), text)


def _text(plain: Mapping[str, Any]) -> bytes:
    """Canonical JSON; half a surrogate pair, as in odd file names, has no UTF-8 and is escaped."""
    return json.dumps(plain, ensure_ascii=False, allow_nan=False).encode(errors="backslashreplace")


def _plain(value: Mapping[str, Any]) -> dict[str, Any]:
    """The value as it would be read back."""
    plain: dict[str, Any] = json.loads(dumps(value).encode(errors="backslashreplace"))
    return plain


def _lock(folder: Path, held: ExitStack) -> None:
    """Lock the folder until ``held`` ends, and say in a file beside the lock who holds it; raises ``BadInput``."""
    (folder / LOCK).touch()
    lock = FileLock(folder / LOCK, thread_local=False)
    try:
        lock.acquire(blocking=False)
    except Timeout:
        message = (
            f"is in use by {_holder(folder / HOLDER)}; one process at a time can write a study; "
            "wait for it, end it, or choose another folder"
        )
        raise BadInput(message, file=str(folder)) from None
    except NotImplementedError:
        message = "cannot hold a study: its file system has no locks (flock); choose a folder on a local disk"
        raise BadInput(message, file=str(folder)) from None
    held.callback(lock.release)
    write(folder / HOLDER, dumps({"pid": os.getpid(), "host": platform.node()}))
    held.callback((folder / HOLDER).unlink, missing_ok=True)


def _holder(path: Path) -> str:
    try:
        found = json.loads(path.read_bytes())
        return f"process {found['pid']} on {found['host']}"
    except (OSError, ValueError, TypeError, KeyError):
        return "another process"


@contextmanager
def _saying(place: str | Path, got: str, needed: str) -> Iterator[None]:
    """What the operating system refuses is said as ``BadInput``."""
    try:
        yield
    except OSError as error:
        message = f"{got}: {error.strerror or error}; {needed}"
        raise BadInput(message, file=str(place)) from None
