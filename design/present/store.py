"""What is stored: JSON documents with their spec and provenance, written whole or not at all.

Hashes are over inputs only. JSON never holds NaN or infinity: what is not finite is null.
"""

from __future__ import annotations

import errno
import hashlib
import json
import math
import os
import platform
import stat
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from design import __version__
from design.analysis.rows import Row
from design.analysis.simulate import Trajectory
from design.errors import BadInput
from design.model.laws import Gains, LawKind
from design.present.text import columns
from design.spec.load import Source

if TYPE_CHECKING:  # only who reads recordings waits for it
    from design.recordings.record import Record

FORMAT = 1
"""The version of Poise's JSON."""


def document(command: str, source: Source, **parts: Any) -> dict[str, Any]:
    """The common JSON of every command, with ``parts`` in the middle and the provenance at the end."""
    return {
        "schema_version": FORMAT,
        "command": command,
        "spec": {"name": source.spec.name, "sha256": source.sha256},
        **parts,
        "provenance": provenance(),
    }


def provenance() -> dict[str, str]:
    """Versions of what computed a result."""
    return {
        "poise": __version__,
        **{name: version(name) for name in ("casadi", "numpy", "scipy", "clarabel")},
        "python": platform.python_version(),
    }


def code() -> str:
    """The digest of Poise's own source files; rows of two versions of the code are not mixed."""
    home = Path(__file__).resolve().parents[2]
    files = sorted(path for package in ("design", "problems") for path in (home / package).rglob("*.py"))
    digest = hashlib.sha256()
    for path in files:
        digest.update(path.relative_to(home).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


def gains_json(gains: Gains) -> dict[str, float]:
    """Gains by the keys of the spec file."""
    return {"kp": gains.K_p, "kd": gains.K_d, "kf": gains.K_f}


def row_json(row: Row) -> dict[str, Any]:
    """A row as stored."""
    return asdict(row)


def record_json(record: Record) -> dict[str, Any]:
    """Which recording was read, as what, and how much of it can be used."""
    return {
        "file": record.origin,
        "sha256": record.sha256,
        "columns": record.columns,
        "plates": record.plates,
        "samples": len(record.t),
        "valid_samples": int(record.valid.sum()),
        "dropouts": int(record.dropouts.sum()),
        "gaps": int(record.gaps.sum()),
        "notes": record.notes,
        "assumed": record.assumed,
        "warnings": record.warnings,
    }


def run_json(run: Trajectory) -> dict[str, Any]:
    """A run of ``simulate``: what it comes to, and its samples by column."""
    lost = run.lost_contact
    return {
        "name": run.scenario,
        "toe_force_n": _least(run.t, run.F_T),
        "heel_force_n": _least(run.t, run.F_H),
        "lost_contact": None if lost is None else {"time_s": lost[0], "at": lost[1]},
        "fallen_s": run.fallen,
        "samples": columns(run),
    }


def _least(t: np.ndarray, force: np.ndarray) -> dict[str, float]:
    at = int(np.argmin(force))
    return {"min": float(force[at]), "time_s": float(t[at])}


def dumps(document: Mapping[str, Any]) -> str:
    """JSON text of ``document``; numpy arrays become lists, and what is not finite becomes null."""
    return "".join(streamed(document))


def streamed(document: Mapping[str, Any]) -> Iterator[str]:
    """The text of ``dumps`` in parts; lists may be iterators, whose items are made and written one by one."""
    yield from _parts(document, "\n")
    yield "\n"


BLOCK = 10_000
"""Samples that become text at once."""


def _parts(value: Any, line: str) -> Iterator[str]:
    """JSON of ``value``; ``line`` begins a line of its depth."""
    if isinstance(value, np.generic) or (isinstance(value, np.ndarray) and not value.ndim):
        value = value.item()
    inner, mark = line + " ", ""
    if isinstance(value, Mapping):
        yield "{"
        for key, part in value.items():
            yield f"{mark}{inner}{json.dumps(str(key), ensure_ascii=False)}: "
            yield from _parts(part, inner)
            mark = ","
        yield line + "}" if mark else "}"
    elif isinstance(value, np.ndarray) and value.ndim == 1:
        yield "["
        for begin in range(0, len(value), BLOCK):
            yield mark + inner + f",{inner}".join(_scalar(part) for part in value[begin : begin + BLOCK].tolist())
            mark = ","
        yield line + "]" if mark else "]"
    elif isinstance(value, list | tuple | np.ndarray | Iterator):
        yield "["
        for part in value:
            yield mark + inner
            yield from _parts(part, inner)
            mark = ","
        yield line + "]" if mark else "]"
    else:
        yield _scalar(value)


def _scalar(value: Any) -> str:
    if isinstance(value, float):
        return float.__repr__(value) if math.isfinite(value) else "null"
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def write(path: str | Path, content: str | bytes | Iterable[str]) -> None:
    """Write ``content`` to ``path`` whole or not at all; raises ``BadInput`` if it cannot be written.

    A pipe or a device is written through, not replaced. Of the bytes of a file's name that are no text stays an escape.
    """
    parts = [content] if isinstance(content, str | bytes) else content
    data = (part if isinstance(part, bytes) else part.encode(errors="backslashreplace") for part in parts)
    target = Path(path)
    try:
        if target.exists() and not target.is_file() and not target.is_dir():
            with target.open("wb") as file:
                file.writelines(data)
            return
        _replace(target, data)
    except OSError as error:
        message = f"cannot be written: {error.strerror or error}; choose another place"
        raise BadInput(message, file=str(path)) from None


def _replace(target: Path, data: Iterable[bytes]) -> None:
    target = target.resolve()
    if target.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.", suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            file.writelines(data)
            file.flush()
            os.fsync(file.fileno())
        _as_before(Path(name), target)
        Path(name).replace(target)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def _as_before(new: Path, target: Path) -> None:
    """Give ``new`` the mode and, where the system lets it, the owner of the file that it is to replace, if any."""
    try:
        there = target.stat()
    except FileNotFoundError:
        new.chmod(0o666 & ~_umask())
        return
    if hasattr(os, "chown") and (there.st_uid, there.st_gid) != (new.stat().st_uid, new.stat().st_gid):
        with suppress(PermissionError):
            os.chown(new, there.st_uid, there.st_gid)
    new.chmod(stat.S_IMODE(there.st_mode))


def check_writable(*paths: str | None) -> None:
    """Raise ``BadInput`` for the first of ``paths`` that lies in no folder or is one, before anything is computed."""
    for path in filter(None, paths):
        target = Path(path)
        try:
            reason = "is a directory" if target.is_dir() else ""
            if not target.parent.is_dir() or not os.access(target.parent, os.W_OK):
                reason = "its folder is missing or not writable"
        except OSError as error:
            reason = error.strerror or str(error)
        if reason:
            message = f"cannot be written: {reason}; choose another place"
            raise BadInput(message, file=path)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def read_design(text: str, origin: str) -> tuple[str, Gains, LawKind | None]:
    """Spec text, gains and law of a design file written by ``synthesize``; raises ``BadInput``."""
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        message = f"is not valid JSON: {str(error)[:120]}"
        raise BadInput(message, file=origin) from None
    if not isinstance(data, dict) or "gains" not in data or "spec" not in data:
        message = "is not a design file; write one with `poise synthesize SPEC -o design.json`"
        raise BadInput(message, file=origin)
    if isinstance(found := data.get("schema_version"), int) and found > FORMAT:
        message = f"is {found}; this Poise reads {FORMAT}; upgrade with `pip install -U poise`"
        raise BadInput(message, file=origin, key="schema_version")
    gains, spec, law = data["gains"], data["spec"], data.get("law")
    if gains is None:
        message = f"has no gains: its status is {str(data.get('status'))[:40]!r}; synthesize again"
        raise BadInput(message, file=origin, key="gains")
    if law not in (None, "pd", "force", "cop"):
        message = f"is {str(law)[:40]!r}; allowed: pd, force, cop"
        raise BadInput(message, file=origin, key="law")
    try:
        numbers = [gains[key] for key in ("kp", "kd", "kf")]
        spec_text = spec["text"]
        plain = all(isinstance(n, int | float) and not isinstance(n, bool) and 0 <= n <= 1e9 for n in numbers)
        if not plain or not isinstance(spec_text, str):
            raise ValueError
        spec_text.encode()
    except (KeyError, TypeError, ValueError):
        message = "needs gains.kp, gains.kd, gains.kf (finite numbers from 0 to 1e9) and spec.text; synthesize again"
        raise BadInput(message, file=origin) from None
    return spec_text, Gains(*map(float, numbers)), law
