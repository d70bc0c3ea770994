"""Usual names of columns: of plates by AMTI, Bertec, Kistler, Vicon and Qualisys, of OpenSim, and our own."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

from design.recordings.units import unit_of

SCALARS = {
    "time": "time t zeit temps tiempo tempo times timestamp timestamps abstime mocaptime elapsedtime",
    "angle": "angle theta ankleangle leanangle bodyangle swayangle",
    "rate": "rate omega angularrate angularvelocity anglerate thetadot ankleangularvelocity",
    "toe": "toeforce toe ft forcetoe",
    "heel": "heelforce heel fh forceheel",
    "torque": "torque tau ankletorque anklemoment",
    "fz": "verticalforce vgrf grfv load fvertical fvert fv totalforce",
    "fx": "horizontalforce forwardforce apforce fap",
    "cop": "cop copap apcop copforward cpap",
}
_ROLE = {word: role for role, words in SCALARS.items() for word in words.split()}

_KIND = {
    "force": "f for force forcef grf grfnet groundreactionforce",
    "moment": "m mom moment momentm grm groundreactionmoment",
    "cop": "cop copnet c copc copa cofp centerofpressure centreofpressure",
    "com": "com cog centerofmass centreofmass centerofgravity centreofgravity",
    "ankle": "ankle ank anklejoint anklejointcenter anklejointcentre",
}
_WORD = {word: kind for kind, words in _KIND.items() for word in words.split()}
_PLATE = r"(?:fp|forceplate|forceplatform|plate|platform|p)?\d+"
_AXIS = re.compile(
    rf"(?P<pre>net|total|sum|right|left|r|l|{_PLATE})?"
    rf"(?P<word>{'|'.join(sorted(_WORD, key=len, reverse=True))})(?P<mid>right|left|\d+)?(?P<axis>[xyz])"
    rf"(?P<post>net|total|sum|right|left|r|l|{_PLATE})?"
)
_MARKER = re.compile(r"[cm]\d+[xyz]")
"""Vertebrae and metatarsals, by which markers are called."""
_SCALAR = re.compile(
    rf"(?P<pre>right|left|{_PLATE})?(?P<word>{'|'.join(word for word in _ROLE if _ROLE[word] in ('fz', 'fx', 'cop'))})"
    rf"(?P<post>right|left|{_PLATE})?"
)
_SIDE = r"right|left|r|l|\d+"
_OPENSIM = re.compile(rf"(?P<pre>{_SIDE})?groundforce(?P<mid>{_SIDE})?(?P<word>[vp])(?P<axis>[xyz])(?P<post>{_SIDE})?")
_SUFFIX = re.compile(r"(.+?)_(rad_per_s|deg_per_s|[a-zA-Z]{1,3})")
_WHOLE = {"net", "total", "sum", ""}


@dataclass(frozen=True, kw_only=True)
class Known:
    """What a name says: a ``role``, or a ``kind`` and an ``axis``; the plate's or side's ``tag``; a ``unit``."""

    role: str = ""
    kind: str = ""
    axis: str = ""
    tag: str = ""
    unit: str | None = None


def recognise(name: str) -> Known | None:
    """What a column called ``name`` holds, if its name is a usual one."""
    found = _plain(name, None)
    if found is None and (match := _SUFFIX.fullmatch(name)):
        unit = unit_of(match[2].replace("_per_", "/"))
        return _plain(match[1], unit) if unit else None
    return found


def _plain(name: str, unit: str | None) -> Known | None:
    again = re.fullmatch(r"(.*\w)\.(\d+)", name)
    base, number = (again[1], again[2]) if again else (name, "")
    if "|" in base:
        return None
    if match := re.fullmatch(r"A([xyz])(\d*)", base):
        return Known(kind="cop", axis=match[1], tag=match[2] or number, unit=unit)
    key = re.sub(r"[^a-z0-9]", "", base.lower())
    if key in _ROLE:
        return Known(role=_ROLE[key], tag=number, unit=unit)
    if match := _OPENSIM.fullmatch(key):
        kind = {"v": "force", "p": "cop"}[match["word"]]
        tags = {_tag(match[part]) for part in ("pre", "mid", "post")} | {number}
        return Known(kind=kind, axis=match["axis"], tag="/".join(sorted(tags - {""})), unit=unit)
    if match := _SCALAR.fullmatch(key):
        tags = {_tag(match["pre"]), _tag(match["post"]), number} - {""}
        return Known(role=_ROLE[match["word"]], tag="/".join(sorted(tags)), unit=unit)
    if (match := _AXIS.fullmatch(key)) and not _MARKER.fullmatch(key):
        tags = {_tag(match["pre"]), _tag(match["mid"]), _tag(match["post"]), number} - {""}
        whole = match["word"].endswith("net") or match["pre"] in _WHOLE - {""} or match["post"] in _WHOLE - {""}
        tag = "net" if whole else "/".join(sorted(tags))
        return Known(kind=_WORD[match["word"]], axis=match["axis"], tag=tag, unit=unit)
    return None


def resembled(name: str) -> Known | None:
    """What a part of ``name`` says about a plate; the other words, as in ``paretic Fvert``, are the plate's ``tag``."""
    words = [word for word in re.split(r"[\s_.:/-]+", name) if word]
    for index, word in enumerate(words):
        known = Known(role="fz") if word.lower() in ("vertical", "weight") else recognise(word)
        if known and (known.role in ("fz", "fx", "cop") or known.kind in ("force", "moment", "cop")):
            rest = " ".join(words[:index] + words[index + 1 :]).lower()
            return replace(known, tag=" ".join(filter(None, (rest, known.tag))))
    return None


def unit_after(name: str) -> str | None:
    """The unit that a name ends in after an underscore: ``weight_kg`` -> ``kgf``."""
    match = _SUFFIX.fullmatch(name)
    return unit_of(match[2].replace("_per_", "/")) if match else None


def is_weight(name: str) -> bool:
    """Whether a column is called the weight, as balance boards call the vertical force."""
    return re.sub(r"[^a-z]", "", name.lower()) in ("weight", "bodyweight", "totalweight", "weightkg")


def _tag(text: str | None) -> str:
    if not text or text in _WHOLE:
        return ""
    return text[:1] if text[0] in "rl" else re.sub(r"\D", "", text)
