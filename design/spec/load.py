"""A spec file, or the name of a built-in, becomes a checked ``Spec``; every fault is one line that can be acted on."""

from __future__ import annotations

import difflib
import hashlib
import re
import sys
import tomllib
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from design.errors import BadInput
from design.spec.plausibility import remarks
from design.spec.schema import SCHEMA_VERSION, Spec

MAX_BYTES = 20_000_000
_REQUIRED = ("schema_version", "name", "[body]", "[foot]", "[[scenarios]]", "[law]")
_TAGS = {"slope", "force", "platform", "profile"}


@dataclass(frozen=True, kw_only=True)
class Source:
    """A spec as read: the checked ``spec``, its ``text``, where it came ``origin``, and ``remarks`` on it."""

    spec: Spec
    text: str
    origin: str
    remarks: tuple[str, ...]

    @property
    def sha256(self) -> str:
        """Digest of the text, as ``sha256sum`` prints it."""
        return hashlib.sha256(self.text.encode()).hexdigest()


def builtin_names() -> list[str]:
    """Names of the built-in specs, sorted."""
    return sorted(entry.name.removesuffix(".toml") for entry in _library().iterdir() if entry.name.endswith(".toml"))


def builtin_text(name: str) -> str:
    """Text of the built-in spec ``name``; raises ``BadInput`` with the names there are."""
    if name not in builtin_names():
        known = builtin_names()
        message = f"no built-in spec of that name{_did_you_mean(name, known)}; there are: {', '.join(known)}"
        raise BadInput(message, key=name)
    return str((_library() / f"{name}.toml").read_text(encoding="utf-8"))


def load(reference: str) -> Source:
    """The spec at the path ``reference``, or the built-in of that name, or standard input for ``-``.

    A name without a folder or the ending ``.toml`` is looked up among the built-ins first. Raises ``BadInput``.
    """
    if reference == "-":
        return parse(sys.stdin.read(), origin="standard input")
    if reference in builtin_names():
        return parse(builtin_text(reference), origin=reference)
    return parse(read_text(reference), origin=reference)


def read_text(path: str) -> str:
    """Text of a file, or ``BadInput`` that names the path and what is wrong with it."""
    place = Path(path)
    try:
        if place.is_dir():
            message = "is a directory; name a file in it"
            raise BadInput(message, file=path)
        if place.stat().st_size > MAX_BYTES:
            message = f"has {place.stat().st_size:,} bytes; at most {MAX_BYTES:,} are read"
            raise BadInput(message, file=path)
        return place.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        message = f"is not UTF-8 text (byte {error.start}); save it as UTF-8"
        raise BadInput(message, file=path) from None
    except (FileNotFoundError, NotADirectoryError):
        known = "" if "/" in path or "\\" in path else _did_you_mean(path, builtin_names())
        message = f"no such file or built-in spec{known}; built-in: {', '.join(builtin_names())}"
        raise BadInput(message, file=path) from None
    except (OSError, ValueError) as error:
        message = f"cannot be read: {getattr(error, 'strerror', None) or error}"
        raise BadInput(message, file=path) from None


def parse(text: str, *, origin: str) -> Source:
    """Check the TOML ``text`` of a spec; ``origin`` names it in messages. Raises ``BadInput``."""
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        message = f"is not valid TOML: {error}"
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
        raise _explain(error, origin) from None
    return Source(spec=spec, text=text, origin=origin, remarks=tuple(remarks(spec)))


def _library() -> Any:
    return files("design.spec").joinpath("library")


def _did_you_mean(word: str, among: list[str]) -> str:
    close = difflib.get_close_matches(word, among, n=1, cutoff=0.5)
    return f"; did you mean {close[0]!r}?" if close else ""


def _check_version(data: dict[str, Any], origin: str) -> None:
    version = data.get("schema_version", SCHEMA_VERSION)
    if isinstance(version, int) and not isinstance(version, bool) and version > SCHEMA_VERSION:
        message = f"is {version}; this Poise reads {SCHEMA_VERSION}; upgrade with `pip install -U poise`"
        raise BadInput(message, file=origin, key="schema_version")


def _explain(error: ValidationError, origin: str) -> BadInput:
    found = error.errors(include_url=False)
    # An unknown key is often the reason why another one is missing: say it first.
    found.sort(key=lambda fault: fault["type"] != "extra_forbidden")
    fault = found[0]
    key = _key(fault["loc"])
    context = fault.get("ctx", {})
    kind = fault["type"]
    if kind == "extra_forbidden":
        allowed = _siblings(fault["loc"])
        message = f"unknown key{_did_you_mean(str(fault['loc'][-1]), allowed)}; allowed here: {', '.join(allowed)}"
    elif kind == "missing":
        message = f"is missing; needs {_needs(fault['loc'])}"
    elif kind in ("union_tag_not_found", "union_tag_invalid"):
        key = f"{key}.kind"
        got = (
            "is missing"
            if kind == "union_tag_not_found"
            else f"is {context['tag']!r}{_did_you_mean(context['tag'], sorted(_TAGS))}"
        )
        message = f"{got}; allowed: slope, force, platform, profile"
    elif kind == "value_error":
        message = str(context["error"])
    else:
        message = f"is {_show(fault['input'])}; {_allowed(fault)}"
    return BadInput(message, file=origin, key=key or None, others=len(found) - 1)


def _allowed(fault: Any) -> str:
    bounds = _field_range(fault["loc"])
    kind, context = fault["type"], fault.get("ctx", {})
    if kind in ("greater_than", "greater_than_equal", "less_than", "less_than_equal"):
        if bounds:
            return f"needs {bounds}"
        sign = {"greater_than": ">", "greater_than_equal": ">=", "less_than": "<", "less_than_equal": "<="}[kind]
        return f"needs {sign} {next(iter(context.values())):g}"
    if kind == "literal_error":
        return f"allowed: {context['expected']}".replace("'", '"')
    if kind == "string_pattern_mismatch":
        return "needs 1 to 64 letters, digits, spaces or . _ -, beginning with a letter or digit"
    said = str(fault["msg"])
    return said[0].lower() + said[1:]


def _key(location: tuple[int | str, ...]) -> str:
    text = ""
    for index, part in enumerate(location):
        if part in _TAGS and index and isinstance(location[index - 1], int):
            continue
        text += f"[{part}]" if isinstance(part, int) else f".{part}"
    return text.removeprefix(".")


def _model_at(location: tuple[int | str, ...]) -> Any:
    """The model (a pydantic class) in which the last part of ``location`` is a key."""
    from pydantic import BaseModel

    from design.spec import schema

    model: Any = Spec
    tagged = {"slope": "SlopeTable", "force": "ForceTable", "platform": "PlatformTable", "profile": "ProfileTable"}
    for index, part in enumerate(location[:-1]):
        if isinstance(part, int):
            continue
        if part in tagged and index and isinstance(location[index - 1], int):
            model = getattr(schema, tagged[str(part)])
            continue
        field = getattr(model, "model_fields", {}).get(part)
        if field is None:
            return None
        options = [field.annotation, *getattr(field.annotation, "__args__", ())]
        inner = [o for o in options if isinstance(o, type) and issubclass(o, BaseModel)]
        model = inner[0] if inner else model
    return model


def _siblings(location: tuple[int | str, ...]) -> list[str]:
    return list(getattr(_model_at(location), "model_fields", {}))


def _field(location: tuple[int | str, ...]) -> Any:
    return getattr(_model_at(location), "model_fields", {}).get(location[-1])


def _field_range(location: tuple[int | str, ...]) -> str:
    field = _field(location)
    parts = []
    for bound in getattr(field, "metadata", ()):
        for attribute, sign in (("gt", ">"), ("ge", ">="), ("lt", "<"), ("le", "<=")):
            if (level := getattr(bound, attribute, None)) is not None:
                parts.append(f"{sign} {level:g}")
    unit = re.search(r"\[[^\]]+\]$", getattr(field, "description", "") or "")
    return " and ".join(parts) + (f" {unit.group()}" if parts and unit else "")


def _needs(location: tuple[int | str, ...]) -> str:
    field = _field(location)
    return (getattr(field, "description", None) or f"the table [{location[-1]}]").strip()


def _show(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
