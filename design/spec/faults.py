"""What is wrong with a spec, as one line: where, what was got, and what is allowed; the ranges are the schema's own."""

from __future__ import annotations

import difflib
import re
from typing import Any

from pydantic import BaseModel, ValidationError

from design.errors import BadInput
from design.spec import schema
from design.spec.schema import Spec

Location = tuple[int | str, ...]
_TAGS = {"slope", "force", "platform", "profile"}


def did_you_mean(word: str, among: list[str]) -> str:
    """A hint at the nearest of ``among``, or nothing."""
    close = difflib.get_close_matches(word, among, n=1, cutoff=0.5)
    return f"; did you mean {close[0]!r}?" if close else ""


def explain(error: ValidationError, data: object, origin: str) -> BadInput:
    """The first fault of a spec's ``data`` as one line, and how many more there are."""
    found = error.errors(include_url=False)
    # An unknown key is often the reason why another one is missing: say it first.
    found.sort(key=lambda fault: fault["type"] != "extra_forbidden")
    fault = found[0]
    key = _key(_as_written(fault["loc"], data))
    context = fault.get("ctx", {})
    kind = fault["type"]
    if kind == "extra_forbidden":
        allowed = _siblings(fault["loc"])
        message = f"unknown key{did_you_mean(str(fault['loc'][-1])[:80], allowed)}; allowed here: {', '.join(allowed)}"
    elif kind == "missing":
        message = f"is missing; needs {_needs(fault['loc'])}"
    elif kind in ("union_tag_not_found", "union_tag_invalid"):
        key = f"{key}.kind"
        got = (
            "is missing"
            if kind == "union_tag_not_found"
            else f"is {show(context['tag'])}{did_you_mean(str(context['tag'])[:80], sorted(_TAGS))}"
        )
        message = f"{got}; allowed: slope, force, platform, profile"
    elif kind == "value_error":
        message = str(context["error"])
        inner, _, rest = message.partition(": ")
        if inner in _siblings((*fault["loc"], "")):  # a table's validator blames one of its keys
            key, message = f"{key}.{inner}", rest
    else:
        message = f"is {show(fault['input'])}; {_allowed(fault)}"
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


def _as_written(location: Location, data: object) -> Location:
    """``location`` without the ``min`` or ``max`` of a requirement that was written as a plain number."""
    if not location or location[-1] not in ("min", "max"):
        return location
    for part in location[:-1]:
        data = data[part] if isinstance(data, dict) and part in data else None
    return location if isinstance(data, dict) else location[:-1]


def _key(location: Location) -> str:
    text = ""
    for index, part in enumerate(location):
        if part in _TAGS and index and isinstance(location[index - 1], int):
            continue
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            text += "." + (part if part.isprintable() and len(part) <= 60 else show(part))
    return text.removeprefix(".")


def _model_at(location: Location) -> Any:
    """The model (a pydantic class) in which the last part of ``location`` is a key; None where there is none."""
    model: Any = Spec
    tagged = {"slope": "SlopeTable", "force": "ForceTable", "platform": "PlatformTable", "profile": "ProfileTable"}
    for index, part in enumerate(location[:-1]):
        if isinstance(part, int):
            continue
        if part in tagged and index and isinstance(location[index - 1], int):
            model = getattr(schema, tagged[part])
            continue
        field = getattr(model, "model_fields", {}).get(part)
        if field is None:
            return None
        options = [field.annotation, *getattr(field.annotation, "__args__", ())]
        tables = [option for option in options if isinstance(option, type) and issubclass(option, BaseModel)]
        model = tables[0] if tables else model
    return model


def _siblings(location: Location) -> list[str]:
    return list(getattr(_model_at(location), "model_fields", {}))


def _field(location: Location) -> Any:
    return getattr(_model_at(location), "model_fields", {}).get(location[-1])


def _field_range(location: Location) -> str:
    field = _field(location)
    if field is None:
        return ""
    notes = [
        note for option in getattr(field.annotation, "__args__", ()) for note in getattr(option, "__metadata__", ())
    ]
    inner = [bound for note in notes for bound in getattr(note, "metadata", ())]
    parts = []
    for bound in [*field.metadata, *inner]:
        for attribute, sign in (("gt", ">"), ("ge", ">="), ("lt", "<"), ("le", "<=")):
            if (level := getattr(bound, attribute, None)) is not None:
                parts.append(f"{sign} {level:g}")
    unit = re.search(r"\[[^\]]+\]$", field.description or "")
    return " and ".join(parts) + (f" {unit.group()}" if parts and unit else "")


def _needs(location: Location) -> str:
    field = _field(location)
    return (getattr(field, "description", None) or f"the table [{location[-1]}]").strip()


def show(value: object) -> str:
    """A value as it may stand in a message: short, and printable."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
