"""A certificate as a whole: it is for this spec, covers the whole box, and claims no less than the spec demands.

What a spec asks is every one of its scenarios, under its own gains, over at least its own box: a certificate may be
for less, which ``Answer.missing`` says.

A certificate is JSON: ``spec`` (text, sha256), ``law`` (kind and gains, as printed), ``scale`` of the box, and for each
of its ``scenarios`` the ``claims`` by row and a ``tree``. A tree is a ``part`` or is ``cut`` in the middle of the
parameter it names, into two ``halves``; so the parts cover the box, whatever they hold. A part has a ``norm`` (lower
triangle), a ``rate``, a ``reach``, the time ``after_s`` for which the scenario is watched on, and for each segment of
the signal its pieces: a weight, by which they share the segment's time, and the coefficients of theta, omega and s.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

from design.checking import Malformed, Refused, need
from design.checking.balls import ONE, decimal, root
from design.checking.linear import Ends, check_decay, ends_of
from design.checking.tube import walk
from design.checking.world import Box, Segment, demands, gravity, number, read, segments, whole_box
from design.errors import BadInput

FORMAT = "poise-certificate 1"
GAINS = ("kp", "kd", "kf")
KINDS = ("slope", "force", "platform", "profile")
ROWS = {"toe-force", "heel-force", "cop-margin", "decay-rate", "torque"}
Valid = Callable[[str], object] | None
LARGEST = 100_000_000  # bytes of a certificate
DEEPEST = 64  # cuts of a box, one within the other


@dataclass(kw_only=True)
class Answer:
    """``confirmed``: all that it claims is shown; or ``why`` not.

    ``missing``: what the spec asks beyond that. ``malformed``: it is no certificate, and is not looked at any further.
    By scenario the ``claims`` and the ``box``, ``scale`` of [uncertainty].
    """

    confirmed: bool = False
    malformed: bool = False
    why: str = ""
    missing: list[str] = field(default_factory=list)
    name: str = ""
    sha256: str = ""
    law: str = ""
    claims: dict[str, dict[str, Fraction]] = field(default_factory=dict)
    scale: Fraction = Fraction(1)
    box: dict[str, Box] = field(default_factory=dict)
    for_ever: dict[str, bool] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)
    parts: int = 0
    pieces: int = 0


def check(content: bytes, *, origin: str = "certificate", sha256: str | None = None, valid: Valid = None) -> Answer:
    """The answer for the ``content`` of a certificate, which must be for the spec with that ``sha256`` if it is given.

    ``valid`` raises ``BadInput`` for the text of a spec that is none. Raises ``BadInput`` if it is no certificate.
    """
    try:
        document = json.loads(
            content.decode(), parse_float=decimal, parse_int=lambda text: int(decimal(text)), parse_constant=decimal,
            object_pairs_hook=_without_repetition,
        )  # fmt: skip
    except Malformed as error:
        return Answer(malformed=True, why=str(error))
    except (ValueError, ArithmeticError, RecursionError):
        document = None
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        message = (
            f'is not a certificate; needs JSON with "format": "{FORMAT}", as `poise prove --certificate` writes it'
        )
        raise BadInput(message, file=origin)
    answer = Answer()
    try:
        _check(document, answer, sha256, valid)
    except Refused as refusal:
        answer.why = str(refusal)
    except Malformed as error:
        answer.malformed, answer.why = True, str(error)
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError) as error:
        answer.why = f"it is damaged ({type(error).__name__}: {repr(str(error)[:80])[1:-1]})"
    else:
        answer.confirmed = True
    return answer


def _without_repetition(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object of JSON; raises ``Malformed`` where a key is there twice, of which readers differ in what they take."""
    table = dict(pairs)
    if len(table) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        message = f"an object in it has the key {twice[:64]!r} twice; each needs to be there once"
        raise Malformed(message)
    return table


def _check(document: dict[str, Any], answer: Answer, given: str | None, valid: Valid) -> None:
    text, digest = document["spec"]["text"], document["spec"]["sha256"]
    answer.sha256 = hashlib.sha256(text.encode()).hexdigest()
    need(answer.sha256 == digest, "the spec's text does not have the sha256 that is given")
    need(given in (None, digest), "it is for another spec than the one given")
    spec = read(text)
    if valid is not None:
        valid(text)
    answer.name = spec["name"]
    need(document["spec"].get("name", answer.name) == answer.name, "it names another spec than the one in it")
    kind, gains = law(document["law"])
    answer.law = f"{kind}, " + ", ".join(f"{key} = {float(document['law'][key])!r}" for key in GAINS)
    if kind != spec["law"]["kind"] or any(spec["law"].get(key) != its for key, its in zip(GAINS, gains, strict=False)):
        answer.missing.append(f"the law and gains of the spec; it is for {answer.law}")
        answer.law += " (not the spec's)"
    need("adapt_s" not in spec["law"] or kind == "pd", "the spec's law adapts, which a certificate does not cover")
    scale = answer.scale = number(document["scale"])
    need(scale >= 0, "the scale of its box is below 0")
    tables = {table["name"]: table for table in spec["scenarios"]}
    for entry in document["scenarios"]:
        scenario = tables[entry["name"]]
        if entry["name"] in answer.claims:
            message = f"it has two entries for the scenario {entry['name']!r}"
            raise Malformed(message)
        claims = {row: number(value) for row, value in entry["claims"].items()}
        need(set(claims) <= ROWS, f"{entry['name']}: claims what is not checked here")
        need(scenario["kind"] in KINDS, f"{entry['name']}: is of a kind that is not known here")
        box = whole_box(spec, scenario, scale)
        for row, level in demands(spec).items():
            enough = claims[row] <= level if row == "torque" else claims[row] >= level
            need(enough, f"{entry['name']}: {row}: claims {float(claims[row]):g}; the spec needs {float(level):g}")
        try:
            _tree(entry["tree"], spec, scenario, gains, box, claims, answer, DEEPEST)
        except Refused as refusal:
            message = f"{entry['name']}: {refusal}"
            raise Refused(message) from None
        answer.claims[entry["name"]], answer.box[entry["name"]] = claims, box
    need(bool(answer.claims), "it claims nothing")
    answer.left_out = [name for name in tables if name not in answer.claims]
    if answer.left_out:
        answer.missing.append(f"scenario {', '.join(answer.left_out)}")
    boxes = [whole_box(spec, tables[name], Fraction(1)) for name in answer.claims]
    if scale < 1 and any(half for box in boxes for _, half in box.values()):
        answer.missing.append(f"the whole box of [uncertainty]; it is for {float(scale):g} times that")


def law(table: dict[str, Any]) -> tuple[str, list[Fraction]]:
    """The law's kind, and its gains: two for pd, three for (8)."""
    kind, gains = table["kind"], [number(table[key]) for key in GAINS]
    covered = kind == "force" or (kind == "pd" and not gains[2])
    need(covered and min(gains) >= 0, "the law is not one that a certificate covers")
    return kind, gains if kind == "force" else gains[:2]


def halves(box: Box, name: str) -> list[Box]:
    """The box cut in the middle of one parameter."""
    middle, half = box[name]
    return [{**box, name: (middle + side * half / 2, half / 2)} for side in (-1, 1)]


def _tree(
    tree: dict[str, Any], spec: dict[str, Any], scenario: dict[str, Any], gains: Sequence[Fraction], box: Box,
    claims: dict[str, Fraction], answer: Answer, depth: int,
) -> None:  # fmt: skip
    if "cut" in tree:
        need(depth > 0, f"its box is cut more than {DEEPEST} times, one cut within the other")
        for half, part in zip(tree["halves"], halves(box, tree["cut"]), strict=True):
            _tree(half, spec, scenario, gains, part, claims, answer, depth - 1)
        return
    g = gravity(spec)
    found = walk(spec, scenario, gains, g, box, tree["part"], claims["cop-margin"])
    for row, least in (("toe-force", min(found.toe)), ("heel-force", min(found.heel))):
        shown = f"{row}: is shown to be at least {least / ONE:.6g} only, not {float(claims[row]):.6g}"
        need(least >= claims[row] * ONE, shown)
    need(min(found.cop) >= 0, f"cop-margin: {float(claims['cop-margin']):.6g} is not shown")
    if "torque" in claims:
        most = max(found.torque)
        need(most <= claims["torque"] * ONE, f"torque: is shown to be at most {most / ONE:.6g} only")
    check_decay(claims["decay-rate"], gains, linear_ranges(scenario, box, g))
    answer.for_ever[scenario["name"]] = found.for_ever
    answer.parts, answer.pieces = answer.parts + 1, answer.pieces + found.pieces


def linear_ranges(scenario: dict[str, Any], box: Box, g: Fraction) -> tuple[Ends, Ends, Ends]:
    """What the linear loop depends on, over the box and all of the scenario: A L [N m], I and ell."""
    low, high = (a * b for a, b in zip(_sizes(scenario, box, g), ends_of(box["L"]), strict=True))
    return (low, high), ends_of(box["I"]), ends_of(box["ell"])


def _sizes(scenario: dict[str, Any], box: Box, g: Fraction) -> Ends:
    """Below the least and above the largest A (3) of the scenario, over the box."""
    low, high = (mass * g for mass in ends_of(box["M"]))
    if scenario["kind"] == "slope":
        return low, high
    least, largest = [], []
    for segment in segments(scenario, box)[0]:
        x, y = _forces(segment, scenario["kind"], box)
        down = low - max(y), high - min(y)
        near = max(min(x), -max(x), Fraction(0)) ** 2 + max(down[0], -down[1], Fraction(0)) ** 2
        far = max(map(abs, x)) ** 2 + max(map(abs, down)) ** 2
        least.append(Fraction(max(root(near) - 2, 0), ONE))  # ``root`` is at most 2 units above
        largest.append(Fraction(root(far), ONE))
    return min(least), max(largest)


def _forces(segment: Segment, kind: str, box: Box) -> tuple[list[Fraction], list[Fraction]]:
    ends = segment.first, segment.last
    if kind == "platform":
        return [-mass * end[0] for mass in ends_of(box["M"]) for end in ends], [Fraction(0)] * 2
    return [end[0] for end in ends], [end[1] for end in ends]


def content_of(path: str) -> bytes:
    """The bytes of a file; raises ``BadInput``."""
    try:
        if Path(path).stat().st_size > LARGEST:
            message = f"has too many bytes; at most {LARGEST:,} are read"
            raise BadInput(message, file=path)
        return Path(path).read_bytes()
    except (OSError, ValueError) as error:
        message = f"cannot be read: {getattr(error, 'strerror', None) or error}"
        raise BadInput(message, file=path) from None
