"""What an answer of the checker says, in words and as JSON."""

from __future__ import annotations

import json

from design.checking.verdict import Answer, check, content_of

UNITS = {"toe-force": "N", "heel-force": "N", "cop-margin": "m", "decay-rate": "1/s", "torque": "N m"}
NUMBERS = {"M": "kg", "L": "m", "I": "kg m²", "m": "kg", "ell": "m", "slope": "deg", "ramp": "s"}


def render(path: str, sha256: str | None = None, form: str = "text") -> tuple[str, bool]:
    """The answer for the certificate at ``path`` in a ``form``, text or json, and whether it is confirmed.

    ``sha256`` is the digest of the spec that it must be for. Raises ``BadInput`` where there is no certificate.
    """
    answer = check(content_of(path), origin=path, sha256=sha256)
    return (as_json if form == "json" else as_text)(answer), answer.confirmed


def as_text(answer: Answer) -> str:
    """A line for each scenario, and the verdict."""
    if not answer.confirmed:
        return f"REFUSED: {answer.why}\n"
    lines = [f"{answer.name} (sha256 {answer.sha256[:12]}), law {answer.law}"]
    for name, claims in answer.claims.items():
        rows = ", ".join(
            f"{row} {'<=' if row == 'torque' else '>='} {float(value):.7g} {UNITS[row]}"
            for row, value in claims.items()
        )
        box = ", ".join(f"{key} {low:.6g} to {high:.6g} {NUMBERS[key]}" for key, low, high in _moving(answer, name))
        when = "at every time" if answer.for_ever[name] else "until its end, where its force still moves"
        part = "" if answer.scale == 1 else f" ({float(answer.scale):g} times [uncertainty])"
        where = f"for all {box}" if box else "for the numbers of the spec"
        lines.append(f"{name}: {rows}; {where}{part}; {when}")
    if answer.left_out:
        lines.append(f"not in the certificate: {', '.join(answer.left_out)}")
    count = f"{answer.parts} {'part' if answer.parts == 1 else 'parts'}, {answer.pieces} pieces"
    return "\n".join([*lines, f"CONFIRMED ({count})"]) + "\n"


def as_json(answer: Answer) -> str:
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
        "status": "confirmed" if answer.confirmed else "refused", "why": answer.why, "law": answer.law,
        "scale": float(answer.scale),
        "scenarios": scenarios if answer.confirmed else [], "left_out": answer.left_out, "parts": answer.parts,
        "pieces": answer.pieces,
    }  # fmt: skip
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


def _moving(answer: Answer, name: str) -> list[tuple[str, float, float]]:
    box = answer.box[name].items()
    return [(key, float(middle - half), float(middle + half)) for key, (middle, half) in box if half]
