"""Certificates, and what can be done to them: each tampering is a change that matters, so that it must be refused."""

import copy
import hashlib
import json
from functools import cache

from design.proof.box import Proof, prove
from design.proof.certificate import write
from design.spec.load import builtin_text, parse
from design.spec.setting import setting

CALM = (("kd = 1200.0", "kd = 606.2"), ("kf = 1.0", "kf = 5.61"))
BOX = "[uncertainty]\nslope_deg = 1.0\nmass_kg = { percent = 2.0 }\nramp_s = 0.02\n[synthesis]\n"
STEP = (*CALM, ("duration_s = 10.0", "duration_s = 0.3"),
        ("contact_force_n = 0.0", "contact_force_n = 20.0\ntorque_nm = 60.0\ndecay_rate_per_s = 1.0"),
        ("[synthesis]", "[simulation]\ngravity_mps2 = 9.8\n[synthesis]"))  # fmt: skip
BOXED = (*CALM, ("angle_deg = 30.0", "angle_deg = 6.0"), ("ramp_s = 5.0", "ramp_s = 0.5"),
         ("duration_s = 10.0", "duration_s = 0.7"), ("[synthesis]\n", BOX),
         ("contact_force_n = 0.0", "contact_force_n = 108.0"))  # fmt: skip
PROFILE = """
schema_version = 1
name = "pushes"
[body]
mass_kg = 50.0
com_height_m = 0.75
[foot]
mass_kg = 0.5
half_length_m = 0.1
[[scenarios]]
name = "push"
kind = "profile"
points = [[0.0, 0.0, 0.0], [0.2, 30.0, -20.0], [0.3, 30.0, 25.0], [0.3, 0.0, 0.0]]
duration_s = 0.6
initial_angle_deg = 0.5
[[scenarios]]
name = "start"
kind = "platform"
acceleration_mps2 = [[0.1, 0.2], [0.3, 0.4], [0.9, -0.4]]
duration_s = 0.5
initial_rate_deg_per_s = -1.0
[[scenarios]]
name = "wind"
kind = "force"
fx_n = 30.0
fy_n = -20.0
ramp_s = 0.4
duration_s = 0.3
[law]
kind = "force"
kp = 3500.0
kd = 1200.0
kf = 1.0
desired_angle_deg = 0.4
"""
PD = (("angle_deg = 30.0", "angle_deg = 2.0"), ("ramp_s = 5.0", "ramp_s = 0.2"),
      ("duration_s = 10.0", "duration_s = 0.3"), ('kind = "force" ', 'kind = "pd" '))  # fmt: skip


QUIET = """
schema_version = 1
name = "quiet"
[body]
mass_kg = 50.0
com_height_m = 0.75
[foot]
mass_kg = 0.5
half_length_m = 0.1
[[scenarios]]
name = "push"
kind = "profile"
points = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.2, 0.0, 0.0]]
duration_s = 0.3
[law]
kind = "force"
kp = 3500.0
kd = 1200.0
kf = 1.0
"""


def source(text, replaced=()):
    """A spec in which each (old, new) is changed."""
    for old, new in replaced:
        assert old in text, old
        text = text.replace(old, new)
    return parse(text, origin="spec")


@cache
def written(text, replaced=()):
    """The certificate of a spec."""
    its = source(text, replaced)
    problem = setting(its.spec)
    proofs = [prove(problem, problem.gains, scenario.name) for scenario in problem.scenarios]
    assert all(proof.answer == "proved" for proof in proofs)
    return write(its, problem, problem.gains, proofs)


@cache
def boxed():
    """The certificate of a box that had to be cut; of what the prover says, only that it is proved is needed here."""
    its = source(builtin_text("slope"), BOXED)
    problem = setting(its.spec)
    proof = Proof(scenario="ramp", answer="proved", value={"cop-margin": 0.0157, "decay-rate": 8.2})
    return write(its, problem, problem.gains, [proof])


def step():
    """A small certificate: a sudden slope, with a demand on the torque."""
    return written(builtin_text("slope-step"), STEP)


def true_ones():
    """Small certificates of every kind of world and law."""
    return [step(), written(PROFILE), written(builtin_text("slope"), PD), boxed()]


def _at(document, *path):
    for key in path:
        document = document[key]
    return document


def changed(text, path, change):
    """The certificate with the entry at ``path`` replaced by ``change`` of it."""
    document = json.loads(text)
    holder = _at(document, *path[:-1])
    holder[path[-1]] = change(holder[path[-1]])
    return json.dumps(document)


def respelled(text, old, new):
    """The certificate with another spec, and the hash of that one."""
    document = json.loads(text)
    spec = document["spec"]
    assert old in spec["text"], old
    spec["text"] = spec["text"].replace(old, new)
    spec["sha256"] = hashlib.sha256(spec["text"].encode()).hexdigest()
    return json.dumps(document)


FIRST = ("scenarios", 0)
CLAIMS = (*FIRST, "claims")
PART = (*FIRST, "tree", "part")
CUT = (*FIRST, "tree")


def _bent(row):
    row = [*row, *[0] * (3 - len(row))]
    return [*row[:2], row[2] + 2**42, *row[3:]]


def tampered():
    """By name, certificates that must be refused."""
    found = {}
    one = step()
    pushes = written(PROFILE)
    claims = json.loads(one)["scenarios"][0]["claims"]
    raised = {"toe-force": 0.02, "heel-force": 0.02, "cop-margin": 1e-4, "decay-rate": 1e-3, "torque": -0.02}
    for row, by in raised.items():
        found[f"claims {row} too good"] = changed(one, (*CLAIMS, row), lambda value, by=by: value + by)
    for row, value in {
        "toe-force": 19.0,
        "heel-force": 19.0,
        "cop-margin": -1e-3,
        "decay-rate": 0.9,
        "torque": 61.0,
    }.items():
        found[f"claims {row} too little"] = changed(one, (*CLAIMS, row), lambda _, value=value: value)
        found[f"does not claim {row}"] = changed(
            one, CLAIMS, lambda its, row=row: {k: v for k, v in its.items() if k != row}
        )
    found["claims what nobody checks"] = changed(one, CLAIMS, lambda its: {**its, "routh": 1e9})
    found["claims nothing"] = changed(one, ("scenarios",), lambda _: [])
    found["claims for another scenario"] = changed(one, (*FIRST, "name"), lambda _: "ramp")
    assert set(raised) == set(claims)
    # the law, the box, the spec
    for key in ("kp", "kd", "kf"):
        for factor in (0.99, 1.01):
            found[f"{key} times {factor}"] = changed(one, ("law", key), lambda value, f=factor: value * f)
    found["a scale below zero of no box"] = changed(one, ("scale",), lambda value: -value)
    found["law pd"] = changed(one, ("law", "kind"), lambda _: "pd")
    found["law cop"] = changed(one, ("law", "kind"), lambda _: "cop")
    found["gains below zero"] = changed(one, ("law", "kf"), lambda value: -value)
    found["spec text"] = changed(one, ("spec", "text"), lambda text: text.replace("mass_kg = 50.0", "mass_kg = 50.5"))
    found["sha256"] = changed(one, ("spec", "sha256"), lambda text: text[::-1])
    for old, new in (
        ("mass_kg = 50.0", "mass_kg = 50.5"), ("mass_kg = 50.0", "mass_kg = 49.5"), ("mass_kg = 0.1", "mass_kg = 0.09"),
        ("com_height_m = 0.75", "com_height_m = 0.76"), ("inertia_kgm2 = 7.03125", "inertia_kgm2 = 7.1"),
        ("inertia_kgm2 = 7.03125", ""), ("half_length_m = 0.1", "half_length_m = 0.099"), ("= 9.8\n", "= 9.81\n"),
        ("half_length_m = 0.1", "half_length_m = 0.1\nankle_height_m = 0.05"),
        ("kf = 5.61", "kf = 5.61\ncop_target_m = 0.01"), ("half_length_m = 0.1", "toe_m = 0.1\nheel_m = 0.1"),
        ("half_length_m = 0.1", "ground_loads = 0\nhalf_length_m = 0.1"),
        ("half_length_m = 0.1", "ground_loads = 1\nhalf_length_m = 0.1"),
        ("half_length_m = 0.1", "half_length_m = -0.1"), ("mass_kg = 50.0", "mass_kg = 0.0"),
        ("angle_deg = 3.0", "angle_deg = 3.02"), ("angle_deg = 3.0", "angle_deg = -3.0"),
        ("ramp_s = 0.0", "ramp_s = 0.01"), ("duration_s = 0.3", "duration_s = 0.31"),
        ("duration_s = 0.3", "duration_s = -0.3"), ('kind = "slope"', 'kind = "ramp"'),
        ("duration_s = 0.3", "duration_s = 0.3\ninitial_angle_deg = 0.1"),
        ("duration_s = 0.3", "duration_s = 0.3\ninitial_rate_deg_per_s = 0.1"),
        ("kf = 5.61", "kf = 5.61\ndesired_angle_deg = 0.1"), ("kf = 5.61", "kf = 5.61\nadapt_s = 0.3"),
        ("contact_force_n = 20.0", "contact_force_n = 30.0"), ("torque_nm = 60.0", "torque_nm = 43.0"),
        ("decay_rate_per_s = 1.0", "decay_rate_per_s = 9.0\ncop_margin_m = 0.01"),
        ("decay_rate_per_s = 1.0", "decay_rate_per_s = 1.0\ncop_margin_m = 0.02"),
        ("contact_force_n = 20.0", "contact_force_n = { min = 30.0 }"),
        ("torque_nm = 60.0", "torque_nm = { max = 43.0, soft = false }"),
        ("[law]", "[uncertainty]\nmass_kg = 1.0\n[law]"), ("[law]", "[uncertainty]\nhalf_length_m = 0.2\n[law]"),
    ):  # fmt: skip
        found[f"{old.strip()} -> {new.strip()}"] = respelled(one, old, new)
    for old, new in (
        ("[0.2, 30.0, -20.0]", "[0.2, 30.5, -20.0]"), ("[0.2, 30.0, -20.0]", "[0.2, 30.0, -22.0]"),
        ("[0.2, 30.0", "[0.21, 30.0"), ("[0.3, 0.0, 0.0]", "[0.3, 0.0, 1.0]"), ("[0.3, 0.4]", "[0.3, 0.42]"),
        ("[0.2, 30.0", "[0.4, 30.0"),
        ("fx_n = 30.0", "fx_n = 30.5"),
        ("fy_n = -20.0", "fy_n = -22.0"), ("ramp_s = 0.4", "ramp_s = 0.41"), ("duration_s = 0.3", "duration_s = 0.31"),
        ("[0.3, 0.0, 0.0]]", "[0.3, 0.0, 0.0], [0.7, 50.0, 0.0]]"),
        ("[0.3, 0.0, 0.0]]", "[0.3, 0.0, 0.0], [0.9, 0.0, 0.0], [0.8, 0.0, 0.0]]"),
    ):  # fmt: skip
        found[f"pushes: {old} -> {new}"] = respelled(pushes, old, new)
    # the cover of the box
    # the norm
    found["rate"] = changed(one, (*PART, "rates", 0), lambda value: 1.05 * value)
    apart = written(builtin_text("slope-step"), STEP[2:])
    blocks = json.loads(apart)["scenarios"][0]["tree"]["part"]["blocks"]
    assert len(blocks) > 1
    for b in range(len(blocks)):
        for by, factor in (("more", 1.05), ("zero", 0), ("below zero", -1)):
            found[f"rate {b} {by}"] = changed(apart, (*PART, "rates", b), lambda value, f=factor: f * value)
        for c in range(len(blocks)):
            if b != c:
                found[f"coupling {b} {c}"] = changed(apart, (*PART, "couplings", b, c), lambda value: 0.5 * value)
                found[f"coupling {b} {c} below zero"] = changed(apart, (*PART, "couplings", b, c), lambda value: -value)
    found["a coupling without end"] = changed(apart, (*PART, "couplings"), lambda rows: [[1e6] * len(rows)] * len(rows))
    found["one block"] = changed(apart, (*PART, "blocks"), lambda _: [3])
    found["blocks of none"] = changed(apart, (*PART, "blocks"), lambda sizes: [*sizes, 0])
    found["blocks of too many"] = changed(apart, (*PART, "blocks"), lambda sizes: [*sizes, 1])
    found["reach"] = changed(one, (*PART, "reach"), lambda value: 1e-4 * value)
    found["reach below zero"] = changed(one, (*PART, "reach"), lambda value: -value)
    for i in range(3):
        for j in range(3):
            found[f"frame {i} {j}"] = changed(apart, (*PART, "frame", i, j), lambda value: -value)
    found["a frame that forgets a state"] = changed(apart, (*PART, "frame"), lambda rows: [rows[0], rows[1], rows[1]])
    found["a frame of zeros"] = changed(
        apart, (*PART, "frame"), lambda rows: [[0 * each for each in row] for row in rows]
    )
    # the trajectory
    pieces = (*PART, "segments", 0)
    for number in (0, 40, -1):
        for state in (1, 2, 3):
            for sign in (-1, 1):
                found[f"piece {number} state {state} {sign}"] = changed(
                    one, (*pieces, number, state, 0, 0), lambda c, sign=sign: c + sign * 2**52 // 1000
                )  # fmt: skip
            found[f"piece {number} state {state} bent"] = changed(one, (*pieces, number, state, 0), _bent)
        found[f"edge after piece {number}"] = changed(one, (*pieces, number, 0), lambda weight: weight * 5 // 4)
    found["piece dropped"] = changed(one, pieces, lambda each: each[:20] + each[21:])
    found["last piece dropped"] = changed(one, pieces, lambda each: each[:-1])
    found["end dropped"] = changed(one, (*PART,), lambda part: {**part, "after_s": 0.0,
                                   "segments": [part["segments"][0][:30]]})  # fmt: skip
    found["piece twice"] = changed(one, pieces, lambda each: each[:20] + each[19:])
    found["no pieces"] = changed(one, pieces, lambda _: [])
    found["no segments"] = changed(one, (*PART, "segments"), lambda _: [])
    found["a segment dropped"] = changed(pushes, (*PART, "segments"), lambda each: each[:-1])
    found["a segment emptied"] = changed(pushes, (*PART, "segments"), lambda each: [*each[:-1], []])
    found["weight of zero"] = changed(one, pieces, lambda each: [[0, *each[0][1:]], *each])
    found["weight below zero"] = changed(one, pieces, lambda each: [*each, [-5, *each[-1][1:]], [5, *each[-1][1:]]])
    found["broken weight"] = changed(one, (*pieces, 3, 0), lambda weight: weight + 0.5)
    found["broken coefficient"] = changed(one, (*pieces, 3, 1, 0, 0), lambda c: c + 0.5)
    found["too high a degree"] = changed(one, (*pieces, 3, 1, 0), lambda row: row + [0] * 9 + [1])
    found["a state missing"] = changed(one, pieces, lambda each: [piece[:3] for piece in each])
    found["a parameter too many"] = changed(one, (*pieces, 3, 1), lambda rows: [*rows, [1]])
    found["watched longer"] = changed(one, (*PART, "after_s"), lambda value: value + 0.05)
    found["watched for less than nothing"] = changed(one, (*PART, "after_s"), lambda value: -value)
    later = json.loads(pushes)["scenarios"][1]["tree"]["part"]
    found["watched after an end that moves"] = changed(
        pushes, ("scenarios", 1, "tree", "part"), lambda _: {**copy.deepcopy(later), "after_s": 0.1}
    )
    quiet = respelled(written(QUIET), "[0.1, 0.0, 0.0]", "[0.1, 900.0, 0.0]")
    quiet = changed(quiet, (*CLAIMS, "decay-rate"), lambda _: 0.01)
    found["a push passed over"] = changed(quiet, (*PART, "segments"), lambda each: [[], [], each[2]])
    moves = respelled(written(QUIET), "[0.2, 0.0, 0.0]]", "[0.2, 0.0, 0.0], [0.3, 0.0001, 0.0]]")
    low = {"toe-force": 100.0, "heel-force": 100.0, "cop-margin": 0.01, "decay-rate": 0.01}
    found["watched where the force still moves"] = changed(moves, CLAIMS, lambda _: low)
    found["law pd with an integral"] = changed(written(builtin_text("slope"), PD), ("law", "kf"), lambda _: 1.0)
    lowered = changed(one, CLAIMS, lambda its: {**its, "toe-force": 25.0, "heel-force": 25.0, "cop-margin": 1e-3})
    lighter = "[uncertainty]\nfoot_mass_kg = 0.2\n[law]"
    found["a foot that weighs less than nothing"] = respelled(lowered, "[law]", lighter)
    for scenario in (0, 1, 2):
        for state in (1, 2, 3):
            found[f"pushes {scenario} state {state}"] = changed(
                pushes, ("scenarios", scenario, "tree", "part", "segments", -1, -1, state, 0, 0), lambda c: c + 2**43
            )
    return found


def tampered_boxes():
    """The same of a box."""
    found = {}
    box = boxed()
    found["a larger box"] = changed(box, ("scale",), lambda value: value * 1.5)
    found["a box that is inside out"] = changed(box, ("scale",), lambda value: -value)
    for old, new in (("slope_deg = 1.0", "slope_deg = 1.2"), ("percent = 2.0", "percent = 3.0"),
                     ("ramp_s = 0.02", "ramp_s = 0.04"), ("ramp_s = 0.02", "ramp_s = 0.6"),
                     ("ramp_s = 0.5", "ramp_s = 0.7"), ("percent = 2.0", "percent = 200.0")):  # fmt: skip
        found[f"{old} -> {new}"] = respelled(box, old, new)
    found["half of the box missing"] = changed(box, (*CUT, "halves"), lambda halves: halves[:1])
    found["half of the box twice"] = changed(box, (*CUT, "halves"), lambda halves: [halves[0], halves[0]])
    found["halves exchanged"] = changed(box, (*CUT, "halves"), lambda halves: halves[::-1])
    found["cut across another"] = changed(box, (*CUT, "cut"), lambda _: "M")
    found["cut across what does not move"] = changed(box, (*CUT, "cut"), lambda _: "L")
    found["one half for the whole"] = changed(box, CUT, lambda tree: tree["halves"][1])
    found["parameters forgotten"] = changed(
        box,
        (*CUT, "halves", 0, "part", "segments"),
        lambda segments: [
            [[weight, *([*rows[:1]] for rows in states)] for weight, *states in pieces] for pieces in segments
        ],
    )
    return found


def weaker():
    """By name, certificates that claim or use less than they could, and still hold."""
    one = step()
    lower = {"toe-force": -1.0, "heel-force": -1.0, "cop-margin": -1e-3, "torque": 1.0}
    found = {f"less {row}": changed(one, (*CLAIMS, row), lambda value, by=by: value + by) for row, by in lower.items()}
    found["slower"] = changed(one, (*CLAIMS, "decay-rate"), lambda value: 0.5 * value)
    found["smaller rates"] = changed(one, (*PART, "rates"), lambda rates: [0.999 * rate for rate in rates])
    found["wider couplings"] = changed(
        one, (*PART, "couplings"), lambda rows: [[1.001 * each for each in row] for row in rows]
    )
    found["a wider reach"] = changed(one, (*PART, "reach"), lambda value: 1.5 * value)
    found["the norm in other units"] = changed(
        one, (*PART, "frame"), lambda rows: [[2 * each for each in row] for row in rows]
    )
    found["an eased demand"] = respelled(one, "contact_force_n = 20.0", "contact_force_n = { min = 40.0, soft = true }")
    found["no demand on the torque"] = respelled(one, "torque_nm = 60.0", "torque_nm = { max = 6.0, soft = true }")
    found["a ramp uncertain that is none"] = respelled(one, "[law]", "[uncertainty]\nramp_s = 0.1\n[law]")
    found["a slope uncertain that is none"] = respelled(
        written(PROFILE), "[law]", "[uncertainty]\nslope_deg = 1.0\n[law]"
    )
    found["one scenario of three"] = changed(written(PROFILE), ("scenarios",), lambda each: each[:1])
    return found
