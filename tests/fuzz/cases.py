"""Random inputs of the whole command, from a seed: specs, designs, certificates, recordings, and options.

A case is files and a command line. Half of the specs are changed as values (extreme numbers, odd texts, keys that are
missing, doubled or misspelt), half as text.
"""

from __future__ import annotations

import copy
import json
import random
import tomllib
from dataclasses import dataclass

BASE = """
schema_version = 1
name = "mine"
source = "made up"
[body]
mass_kg = 50.0
com_height_m = 0.75
inertia_kgm2 = 37.5
[foot]
mass_kg = 0.1
half_length_m = 0.1
[[scenarios]]
name = "ramp"
kind = "slope"
angle_deg = 3.0
ramp_s = 1.0
duration_s = 2.0
[[scenarios]]
name = "gust"
kind = "profile"
points = [[0.0, 0.0, 0.0], [0.5, -20.0, 0.0], [0.5, 0.0, 1.0]]
duration_s = 2.0
[law]
kind = "force"
kp = 3500.0
kd = 1200.0
kf = 1.0
desired_angle_deg = 0.0
[requirements]
contact_force_n = 5.0
decay_rate_per_s = 0.1
torque_nm = { max = 90.0, soft = true }
[synthesis]
maximise = "decay-rate"
starts = 1
bounds = { kp = [0.0, 3500.0], kd = [0.0, 1200.0], kf = [0.0, 17.0] }
[simulation]
time_step_s = 0.005
gravity_mps2 = 9.81
[uncertainty]
mass_kg = 1.0
[noise]
angle_deg = 0.01
[study]
trials = 1
control_period_s = 0.02
"""
EXTRA_KEYS = {
    "requirements": ["settling_s", "overshoot_deg", "posture_error_deg", "friction", "torque_rate_nm_per_s",
                     "gain_margin_up", "gain_margin_down", "phase_margin_deg", "delay_margin_s", "disk_margin",
                     "sample_time_s", "step_slope_deg", "push_ns", "slope_rate_deg_per_s", "cop_margin_m"],
    "law": ["adapt_s", "cop_target_m"],
    "foot": ["ankle_height_m", "toe_m", "heel_m", "ground_loads"],
    "scenarios": ["initial_angle_deg", "initial_rate_deg_per_s"],
    "uncertainty": ["com_height_m", "slope_deg", "ramp_s", "force_n", "friction"],
    "mpc": ["step_s", "horizon_s", "steps", "torque_weight"],
}  # fmt: skip
NUMBERS = [
    "0", "0.0", "-0.0", "5e-324", "1e-320", "1e-300", "1e-30", "1e-12", "1e-9", "1e-6", "1e-4", "1e-3", "0.01", "0.5",
    "1", "2", "-1", "10", "89.999999", "90", "-90", "180", "360", "1000", "1e6", "1e9", "1e300", "1.8e308", "1e400",
    "nan", "-inf", "9" * 30, "9" * 400, "true", "0x10", "1_000.5", "0.1e-3",
]  # fmt: skip
TEXTS = [
    "", " ", "a" * 70, "x" * 5000, "\x1b[2J\x1b[31m", "a\x07b", "]]>", "<script>alert(1)</script>", "a|b", "$x_{$",
    "é\u202e\U0001f600", "\ufeff", "\u2028", "../x", "pd", "cop", "goals", "nan", "slope", "platform", "a`b*c_d",
]  # fmt: skip
TOKENS = [
    b"\0", b"\x1b[2J", b"\xff", b"\xef\xbb\xbf", b"\r\n", b"\r", b"[", b"]", b"[[", b"{", b"}", b'"', b"'''", b"=",
    b"nan", b"inf", b"-", b"1e400", b"9" * 400, b"e", b".", b",", b"#", b"[[scenarios]]\n", b"\n[law]\n", b"[" * 2000,
    b"a." * 1500, b"true", b"1979-05-27", b"\xe2\x80\xae", b"]]>", b"<script>",
]  # fmt: skip
ODD = [
    "", "-", "--", "-1", "0", "nan", "inf", "1e400", "-0.0", "5e-324", "9" * 400, "x" * 3000, "\x1b[31m", "a\nb", "é",
    "\udcff", "$", "1,2", "1,2,3", "1,2,3,4", "1e9,1e9,1e9", "0,0,0", "nan,1,1", "1e-320,1,1", "3500,1200,1", ",,,",
    "none", "text", "json", "decay-rate", "contact-force", "ramp", "gust", "1", "2", "0.5", "1e-3", "1e6", ".", "/",
]  # fmt: skip
ROWS = ["decay-rate", "contact-force", "cop-margin", "torque", "settling", "push", "goals", "friction", "disk-margin"]
OPTIONS = {
    "report": ["--law", "--gains", "--against", "--record", "--format", "--rate", "--skip-rows"],
    "simulate": ["--law", "--gains", "--scenario", "--format"],
    "check": ["--format"],
    "estimate": ["--spec", "--columns", "--delimiter", "--decimal", "--skip-rows", "--rate", "--resample", "--up",
                 "--forward", "--ankle", "--origins", "--every", "--format"],
    "explain": [],
    "synthesize": ["--law", "--maximise", "--minimise", "--format"],
    "prove": ["--scale", "--scenario", "--law", "--gains", "--format"],
    "tradeoff": ["--points", "--point", "--law", "--format"],
    "init": [],
    "region": ["--scenario", "--law", "--gains", "--format"],
    "trials": ["--trials", "--scenario", "--sequence", "--seed", "--law", "--gains", "--format"],
}  # fmt: skip
USUAL = {"--format": ["text", "json", "csv", "md", "html", "junit"], "--law": ["pd", "force", "cop"]}
COMMANDS = [
    *["report"] * 6, *["simulate"] * 4, *["check"] * 3, *["estimate"] * 3, "explain", *["synthesize"] * 2,
    *["prove"] * 2, "tradeoff", "init", "region", "trials",
]  # fmt: skip
ENDINGS = ["out.json", "out.txt", "out.md", "out.html", "out.xml", "nowhere/out.txt", "$o_{.txt"]
NAMES = [
    "mine.toml", "mine.toml", "mine.toml", "a\x1b[31mb\n.toml", "$\\frac{.toml", "\udcff\udcfe.toml", "a|b<i>.toml",
]  # fmt: skip


class Raw(str):
    """TOML or JSON source that stands for itself."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """``files`` by name in the folder where ``arguments`` are run; ``outputs`` is what they may leave there."""

    files: dict[str, bytes]
    arguments: tuple[str, ...]
    outputs: tuple[str, ...] = ()


def written(value: object) -> str:
    """``value`` as TOML."""
    if isinstance(value, Raw):
        return str(value)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, dict):
        return "{" + ", ".join(f"{written(str(key))} = {written(part)}" for key, part in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(written, value)) + "]"
    return repr(value)


def places(value: object, path: tuple[object, ...] = ()) -> list[tuple[object, ...]]:
    """Every place in a tree of tables and lists."""
    found = [path] if path else []
    if isinstance(value, dict | list):
        for key, part in value.items() if isinstance(value, dict) else enumerate(value):
            found += places(part, (*path, key))
    return found


def changed(data: object, chance: random.Random) -> None:
    """Change one place of the tree ``data``."""
    path = chance.choice(places(data))
    inner = data
    for part in path[:-1]:
        inner = inner[part]  # type: ignore[index]
    key, what = path[-1], chance.random()
    assert isinstance(inner, dict | list)
    here = inner[key]  # type: ignore[index]
    if what < 0.55:
        numeric = isinstance(here, int | float | Raw)
        inner[key] = Raw(chance.choice(NUMBERS)) if numeric or chance.random() < 0.1 else chance.choice(TEXTS)  # type: ignore[index]
    elif what < 0.7 and isinstance(here, float):
        inner[key] = here * chance.choice([1e-9, 1e-3, 0.1, 0.9, 1.1, 3.0, 10.0, 1e3, 1e6, -1.0])  # type: ignore[index]
    elif what < 0.8:
        del inner[key]  # type: ignore[arg-type]
    elif what < 0.9:
        table = chance.choice(sorted(EXTRA_KEYS))
        if isinstance(data, dict):
            inner = data.setdefault(table, {})
            inner = inner[0] if isinstance(inner, list) and inner else inner
            if isinstance(inner, dict):
                inner[chance.choice(EXTRA_KEYS[table])] = Raw(chance.choice(NUMBERS))
    elif isinstance(inner, dict):
        inner[f"{key}_" if what < 0.95 else str(key)[:-1]] = inner.pop(key)
    else:
        inner.append(copy.deepcopy(here))


def damaged(content: bytes, chance: random.Random) -> bytes:
    """``content`` with a few bytes replaced, left out, or doubled."""
    new = bytearray(content)
    for _ in range(chance.choice([1, 1, 2, 4])):
        at, what = chance.randrange(len(new) + 1), chance.random()
        if what < 0.5:
            new[at : at + chance.choice([0, 1, 5])] = chance.choice(TOKENS)
        elif what < 0.7:
            del new[at : at + chance.choice([1, 3, 50])]
        elif what < 0.9:
            other = chance.randrange(len(new) + 1)
            new[at:at] = new[other : other + chance.choice([10, 200])]
        else:
            new = new.replace(b"\n", b"\r\n")
    return bytes(new)


def spec(chance: random.Random) -> bytes:
    """A spec with faults."""
    data = tomllib.loads(BASE)
    if chance.random() < 0.7:
        for _ in range(chance.choice([1, 1, 1, 2, 3])):
            changed(data, chance)
        text = "\n".join(f"{written(str(key))} = {written(part)}" for key, part in data.items()) + "\n"
        return text.encode("utf-8", "surrogatepass")
    return damaged(BASE.encode(), chance)


def json_with_faults(text: str, chance: random.Random) -> bytes:
    """A JSON file with faults."""
    if chance.random() < 0.3:
        return damaged(text.encode(), chance)
    data = json.loads(text)
    for _ in range(chance.choice([1, 1, 2])):
        changed(data, chance)
    return _json(data).encode("utf-8", "surrogatepass")


def _json(value: object) -> str:
    if isinstance(value, Raw):
        return {"nan": "NaN", "-inf": "-Infinity"}.get(value, str(value))
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)}: {_json(part)}" for key, part in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_json, value)) + "]"
    return json.dumps(value)


@dataclass(frozen=True, kw_only=True)
class Seeds:
    """Sound files that cases begin with: a design, certificates, and recordings (bytes, name)."""

    design: str
    certificates: tuple[str, ...]
    recordings: tuple[tuple[bytes, str], ...]


def case(seeds: Seeds, chance: random.Random) -> Case:
    """One case."""
    from tests.recordings.mutated import mutate

    command = chance.choice(COMMANDS)
    files: dict[str, bytes] = {}
    outputs: list[str] = []
    spec_name = chance.choice(NAMES)
    plain = chance.random() < 0.3  # a sound spec: then the options are odd
    files[spec_name] = BASE.encode() if plain else spec(chance)
    if command == "check":
        files["c.json"] = json_with_faults(chance.choice(seeds.certificates), chance)
        arguments = [command, "c.json", *([spec_name] if chance.random() < 0.5 else [])]
    elif command == "estimate":
        content, name = chance.choice(seeds.recordings)
        files[name] = mutate(content, chance)
        arguments = [command, name, *(["--spec", spec_name] if chance.random() < 0.5 else [])]
    elif command in ("explain", "init"):
        arguments = [command, chance.choice([*ODD, *TEXTS, "slope", "torque"]).replace("\0", "")]
    elif command in ("report", "prove", "region") and chance.random() < 0.2:
        files["d.json"] = json_with_faults(seeds.design, chance)
        arguments = [command, "d.json"]
    else:
        arguments = [command, spec_name]
    arguments += {
        "synthesize": ["--time-limit", "2", "--starts", "1"], "prove": ["--time-limit", "2"],
        "tradeoff": ["--between", f"{chance.choice(ROWS)},{chance.choice(ROWS)}", "--time-limit", "2"],
    }.get(command, [])  # fmt: skip
    if OPTIONS[command] and chance.random() < (0.9 if plain else 0.3):
        for option in chance.sample(OPTIONS[command], min(len(OPTIONS[command]), chance.choice([1, 1, 2]))):
            usual = USUAL.get(option, [])
            arguments += [option, chance.choice(usual if usual and chance.random() < 0.8 else ODD)]
    if command == "prove" and chance.random() < 0.3:
        arguments += ["--certificate", "proof.json"]
        outputs.append("proof.json")
    if command in ("report", "simulate", "synthesize", "prove", "tradeoff", "estimate") and chance.random() < 0.4:
        outputs.append(chance.choice(ENDINGS))
        arguments += ["-o", outputs[-1]]
    if command in ("simulate", "estimate") and chance.random() < 0.1:
        arguments += ["--plot", "picture.svg"]
        outputs.append("picture.svg")
    return Case(files=files, arguments=tuple(arguments), outputs=tuple(outputs))
