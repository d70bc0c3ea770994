"""A spec file, or the name of a built-in, becomes a checked ``Spec``; every fault is one line that can be acted on."""

from __future__ import annotations

import hashlib
import sys
import tomllib
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, BinaryIO

from pydantic import ValidationError

from design.errors import BadInput, one_line
from design.spec.faults import did_you_mean, explain, show
from design.spec.plausibility import remarks
from design.spec.schema import SCHEMA_VERSION, Spec

MAX_BYTES = 20_000_000
_REQUIRED = ("schema_version", "name", "[body]", "[foot]", "[[scenarios]]", "[law]")


@dataclass(frozen=True, kw_only=True)
class Source:
    """A spec as read: the checked ``spec``, its ``text``, its ``origin``, and ``remarks`` on it.

    ``sha256`` is the digest of the file's bytes, as ``sha256sum`` prints it.
    """

    spec: Spec
    text: str
    origin: str
    sha256: str
    remarks: tuple[str, ...]


def builtin_names() -> list[str]:
    """Names of the built-in specs, sorted."""
    return sorted(entry.name.removesuffix(".toml") for entry in _library().iterdir() if entry.name.endswith(".toml"))


def builtin_text(name: str) -> str:
    """Text of the built-in spec ``name``; raises ``BadInput`` with the names there are."""
    if name not in builtin_names():
        known = builtin_names()
        message = f"no built-in spec of that name{did_you_mean(name, known)}; there are: {', '.join(known)}"
        raise BadInput(message, key=name)
    return str((_library() / f"{name}.toml").read_text(encoding="utf-8"))


def load(reference: str) -> Source:
    """The spec at the path ``reference``, or the built-in of that name, or standard input for ``-``.

    A name without a folder or the ending ``.toml`` is looked up among the built-ins first. Raises ``BadInput``.
    """
    if reference == "-":
        return parse(_take(sys.stdin.buffer, "standard input"), origin="standard input")
    if reference in builtin_names():
        return parse(builtin_text(reference), origin=reference)
    return parse(read_bytes(reference), origin=reference)


def read_bytes(path: str) -> bytes:
    """Content of a file, or ``BadInput`` that names the path and what is wrong with it."""
    place = Path(path)
    try:
        if place.is_dir():
            message = "is a directory; name a file in it"
            raise BadInput(message, file=path)
        with place.open("rb") as file:
            return _take(file, path)
    except (FileNotFoundError, NotADirectoryError):
        known = "" if "/" in path or "\\" in path else did_you_mean(path, builtin_names())
        message = f"no such file or built-in spec{known}; built-in: {', '.join(builtin_names())}"
        raise BadInput(message, file=path) from None
    except (OSError, ValueError) as error:
        message = f"cannot be read: {getattr(error, 'strerror', None) or error}"
        raise BadInput(message, file=path) from None


def _take(file: BinaryIO, name: str) -> bytes:
    content = file.read(MAX_BYTES + 1)
    if len(content) > MAX_BYTES:
        message = f"has too many bytes; at most {MAX_BYTES:,} are read"
        raise BadInput(message, file=name)
    return content


def decode(content: bytes, origin: str) -> str:
    """``content`` as text, or ``BadInput``."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        message = f"is not UTF-8 text (byte {error.start}); save it as UTF-8"
        raise BadInput(message, file=origin) from None


def parse(content: str | bytes, *, origin: str) -> Source:
    """Check the TOML text ``content`` of a spec; ``origin`` names it in messages. Raises ``BadInput``."""
    text = content if isinstance(content, str) else decode(content, origin)
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        message = f"is not valid TOML: {_placed(str(error), text)}"
        raise BadInput(message, file=origin) from None
    except (RecursionError, ValueError) as error:
        message = f"is not valid TOML: {'nested too deeply' if isinstance(error, RecursionError) else error}"
        raise BadInput(message, file=origin) from None
    if not data:
        message = f"is empty; needs {', '.join(_REQUIRED)}; `poise init slope` writes an example"
        raise BadInput(message, file=origin)
    _check_version(data, origin)
    try:
        spec = Spec.model_validate(data)
    except ValidationError as error:
        raise explain(error, data, origin) from None
    raw = content.encode() if isinstance(content, str) else content
    digest = hashlib.sha256(raw).hexdigest()
    return Source(spec=spec, text=text, origin=one_line(origin), sha256=digest, remarks=tuple(remarks(spec)))


def _placed(said: str, text: str) -> str:
    """The parser's words with a line and a column where it says only that the document ended."""
    if "end of document" not in said:
        return said
    lines = text.split("\n")
    return said.replace("at end of document", f"at line {len(lines)}, column {len(lines[-1]) + 1}, the end of document")


def _library() -> Any:
    return files("design.spec").joinpath("library")


def _check_version(data: dict[str, Any], origin: str) -> None:
    version = data.get("schema_version", SCHEMA_VERSION)
    if isinstance(version, bool) or not isinstance(version, int):
        message = f"is {show(version)}; needs the integer {SCHEMA_VERSION}"
        raise BadInput(message, file=origin, key="schema_version")
    if version > SCHEMA_VERSION:
        message = f"is {show(version)}; this Poise reads {SCHEMA_VERSION}; upgrade with `pip install -U poise`"
        raise BadInput(message, file=origin, key="schema_version")
