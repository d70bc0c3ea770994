"""What an answer of the checker says, in words and as JSON."""

from __future__ import annotations

import json
import math
from fractions import Fraction

from design.checking.verdict import Answer, Valid, check, content_of
from design.errors import BadInput

UNITS = {"toe-force": "N", "heel-force": "N", "cop-margin": "m", "decay-rate": "1/s", "torque": "N m"}
NUMBERS = {"M": "kg", "L": "m", "I": "kg m²", "m": "kg", "ell": "m", "slope": "deg", "ramp": "s"}


def render(
    path: str, sha256: str | None = None, form: str = "text", *, partial: bool = False, valid: Valid = None
) -> tuple[str, bool | None]:
    """The answer for the certificate at ``path`` in a ``form``, text or json, and whether it is confirmed.

    None stands for a certificate of which all is shown, but which does not cover what its spec asks; with ``partial``
    that counts as confirmed. ``sha256`` is the digest of the spec that it must be for, ``valid`` as in ``check``.
    Raises ``BadInput`` where there is no certificate.
    """
    answer = check(content_of(path), origin=path, sha256=sha256, valid=valid)
    if answer.malformed:
        message = f"is no certificate: {answer.why}"
        raise BadInput(message, file=path)
    whole = answer.confirmed and (partial or not answer.missing)
    write = as_json if form == "json" else as_text
    return write(answer, partial=partial), None if answer.confirmed and not whole else whole


def status(answer: Answer, *, partial: bool) -> str:
    """One word: confirmed, partial (asked for with ``partial``), incomplete, or refused."""
    if not answer.confirmed:
        return "refused"
    if not answer.missing:
        return "confirmed"
    return "partial" if partial else "incomplete"


def as_text(answer: Answer, *, partial: bool = False) -> str:
    """A line for each scenario, and the verdict."""
    if not answer.confirmed:
        return f"REFUSED: {answer.why}\n"
    lines = [f"{answer.name} (sha256 {answer.sha256[:12]}), law {answer.law}"]
    for name, claims in answer.claims.items():
        rows = ", ".join(
            f"{row} {'<=' if row == 'torque' else '>='} {_short(value, 8, up=row == 'torque')} {UNITS[row]}"
            for row, value in claims.items()
        )
        box = ", ".join(
            f"{key} {_short(middle - half, 6, up=True)} to {_short(middle + half, 6, up=False)} {NUMBERS[key]}"
            for key, (middle, half) in answer.box[name].items()
            if half
        )
        when = "at every time" if answer.for_ever[name] else "until its end, where its force still moves or jumps"
        part = "" if answer.scale == 1 else f" ({float(answer.scale):g} times [uncertainty])"
        where = f"for all {box}" if box else "for the numbers of the spec"
        lines.append(f"{name}: {rows}; {where}{part}; {when}")
    count = f"{answer.parts} {'part' if answer.parts == 1 else 'parts'}, {answer.pieces} pieces"
    words = {
        "confirmed": f"CONFIRMED ({count})",
        "partial": f"CONFIRMED IN PART ({count}): what is above, and not what is missing",
        "incomplete": "INCOMPLETE: what it claims is shown, but the spec asks more; --partial accepts that",
    }
    missing = [f"missing: {each}" for each in answer.missing]
    return "\n".join([*lines, *missing, words[status(answer, partial=partial)]]) + "\n"


def _short(value: Fraction, digits: int, *, up: bool) -> str:
    """A number of few digits, rounded ``up`` or down, so that what is said of it stays true."""
    if value == 0:
        return "0"
    size = math.floor(math.log10(abs(value)))
    unit = Fraction(10) ** (size - digits + 1)
    return f"{float((math.ceil if up else math.floor)(value / unit) * unit):.{digits}g}"


def as_json(answer: Answer, *, partial: bool = False) -> str:
    """The same facts."""
    scenarios = [
        {
            "name": name, "claims": {row: float(value) for row, value in claims.items()},
            "box": {key: {"from": low, "to": high, "unit": NUMBERS[key]} for key, low, high in _moving(answer, name)},
            "every_time": answer.for_ever[name],
        }
        for name, claims in answer.claims.items()
    ]  # fmt: skip
    document = {
        "schema_version": 1, "command": "check", "spec": {"name": answer.name, "sha256": answer.sha256},
        "status": status(answer, partial=partial), "why": answer.why, "missing": answer.missing, "law": answer.law,
        "scale": float(answer.scale),
        "scenarios": scenarios if answer.confirmed else [], "left_out": answer.left_out, "parts": answer.parts,
        "pieces": answer.pieces,
    }  # fmt: skip
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


def _moving(answer: Answer, name: str) -> list[tuple[str, float, float]]:
    box = answer.box[name].items()
    return [(key, float(middle - half), float(middle + half)) for key, (middle, half) in box if half]
