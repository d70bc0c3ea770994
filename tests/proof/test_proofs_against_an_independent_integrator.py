"""What is proved, disproved and certified of random boxes, against an integrator written anew from the paper.

The boxes hold middles that are exactly 0, slopes that cross 0, ramps of no length, and forces that jump when the
scenario ends: each is a spec in text, read by the package; the integrator has the same numbers, and no code of it.
"""

import itertools
import json
import math
from fractions import Fraction

import numpy as np
import pytest
from integrator import World, run, worst

from design.checking import verdict
from design.model.laws import Gains
from design.present import proving
from design.proof.certificate import confirmed
from design.spec.load import parse
from design.spec.setting import setting

BODY = {"M": 60.0, "L": 0.9, "I": 65.0, "m": 1.2, "ell": 0.11}
GAINS = (1800.0, 420.0, 0.4)
UNCERTAIN = {"M": "mass_kg", "L": "com_height_m", "I": "inertia_kgm2", "m": "foot_mass_kg", "ell": "half_length_m"}


def spec(scenario, *, requirements="", uncertainty="", gains=GAINS, step=0.001):
    """A spec's text and what the commands make of it."""
    text = f"""
schema_version = 1
name = "independent"
[body]
mass_kg = {BODY["M"]}
com_height_m = {BODY["L"]}
inertia_kgm2 = {BODY["I"]}
[foot]
mass_kg = {BODY["m"]}
half_length_m = {BODY["ell"]}
[[scenarios]]
name = "s"
{scenario}
[law]
kind = "force"
kp = {gains[0]}
kd = {gains[1]}
kf = {gains[2]}
[requirements]
{requirements}
[uncertainty]
{uncertainty}
[simulation]
time_step_s = {step}
"""
    source = parse(text, origin="independent")
    return source, setting(source.spec)


def proved(source, problem, seconds=300.0):
    proofs, entries = proving.proved_in(source, problem, problem.given_gains(), ["s"], seconds=seconds)
    return proofs[0], entries


def slope_text(angle, ramp, duration=3.0, theta0=0.0, omega0=0.0):
    return (
        f'kind = "slope"\nangle_deg = {angle}\nramp_s = {ramp}\nduration_s = {duration}\n'
        f"initial_angle_deg = {theta0}\ninitial_rate_deg_per_s = {omega0}"
    )


def held(proof, world, gains, duration, slack=2e-5):
    """Whether a world of the box keeps the bounds."""
    found = worst(world, gains, duration)
    for row in ("toe-force", "heel-force"):
        assert found[row] >= proof.value[row] - slack, row
    assert found["cop-margin"] >= proof.value["cop-margin"] - 1e-9
    if "torque" in proof.value:
        assert found["torque"] <= proof.value["torque"] + slack


# ---- slopes: the ramp is that of every final angle of the box


@pytest.mark.parametrize("angle", [0.0, 0.4, -1.0])
@pytest.mark.parametrize("ramp", [0.0, 0.8])
def test_every_slope_of_a_box_keeps_what_is_proved_and_certified_of_it(angle, ramp):
    source, problem = spec(slope_text(angle, ramp), uncertainty="slope_deg = 1.0\nmass_kg = { percent = 1.0 }")
    proof, entries = proved(source, problem)
    assert proof.answer == "proved"
    assert proof.checked
    assert len(entries) == 1
    for share, heavier in itertools.product((-1.0, -0.5, 0.0, 0.7, 1.0), (-0.01, 0.01)):
        body = {**BODY, "M": BODY["M"] * (1 + heavier)}
        held(proof, World(**body, angle_deg=angle + share, ramp_s=ramp), GAINS, 8.0)


def test_a_bound_between_what_the_ramp_and_what_a_sudden_slope_need_is_proved_of_the_ramp_at_any_middle():
    ramp, sudden = (worst(World(**BODY, angle_deg=3.0, ramp_s=time), GAINS, 10.0)["heel-force"] for time in (2.0, 0.0))
    assert sudden < ramp - 50.0
    level = 0.5 * (sudden + ramp)
    for middle, width in ((0.0, 3.0), (1.5, 1.5), (1.0, 2.0)):
        for time, answer in ((2.0, "proved"), (0.0, "disproved")):
            source, problem = spec(
                slope_text(middle, time),
                requirements=f"contact_force_n = {level:.3f}",
                uncertainty=f"slope_deg = {width}",
            )
            assert proved(source, problem)[0].answer == answer, (middle, time)


def test_halving_a_box_about_zero_leaves_every_ramp_as_it_is():
    from design.proof.box import _case, _halves

    _, problem = spec(slope_text(0.67, 1.346, 4.0), uncertainty="slope_deg = 1.34")
    case = _case(problem, problem.given_gains(), "s", 1.0)
    half = _halves(case, None)[0]  # from -0.67 to 0.67, so that its middle is exactly 0
    assert half.scenario.angle == pytest.approx(0.0, abs=1e-15)
    _, end = half.at({5: -1.0})
    t = np.array([0.3, 1.0, 2.0])
    alpha = math.radians(-0.67) * np.minimum(t / 1.346, 1.0)
    assert end.force_at(t)[0] == pytest.approx(BODY["M"] * 9.81 * np.sin(alpha), rel=1e-9)


# ---- random boxes


def _random(rng):
    """A slope or profile scenario as text and as worlds of its box, with gains and a duration."""
    K_p, K_d = rng.uniform(1100, 2600), rng.uniform(250, 700)
    AL = BODY["M"] * 9.81 * BODY["L"]
    gains = (K_p, K_d, rng.uniform(0.1, 0.6) * K_d * BODY["ell"] * (K_p - AL) / (BODY["I"] * K_p))  # (29)
    gains = tuple(float(f"{each:.6g}") for each in gains)
    part = float(rng.choice([0.0, 0.5, 1.0]))
    duration = 3.0
    theta0, omega0 = (float(f"{rng.uniform(-0.5, 0.5):.3f}") for _ in range(2))
    uncertain = [f"{UNCERTAIN[name]} = {{ percent = {part} }}" for name in ("M", "L", "I", "ell")]
    if rng.random() < 0.6:
        angle = float(rng.choice([0.0, 0.0, 0.3, -0.9, 1.7]))
        ramp = float(rng.choice([0.0, 0.5, 1.3, 3.0, 4.0]))
        width = float(rng.choice([0.0, 0.3, 0.6, 1.8]))
        text = slope_text(angle, ramp, duration, theta0, omega0)
        facts = {"kind": "slope", "ramp_s": ramp}
        uncertain.append(f"slope_deg = {width}")
    else:
        angle = width = 0.0
        last = rng.uniform(-15, 15)
        points = [(0.0, 0.0, 0.0), (0.7, *rng.uniform(-15, 15, 2)), (0.7, *rng.uniform(-15, 15, 2)), (1.5, last, 5.0)]
        end = rng.choice(["rests", "jumps at the end", "moves after it"])
        if end == "jumps at the end":
            points += [(3.0, last, 5.0), (3.0, 400.0, 0.0)]
        elif end == "moves after it":
            points += [(3.0, last, 5.0), (20.0, 4000.0, 0.0)]
        points = tuple(tuple(float(f"{each:.4g}") for each in point) for point in points)
        text = (
            f'kind = "profile"\npoints = {json.dumps(points)}\nduration_s = {duration}\n'
            f"initial_angle_deg = {theta0}\ninitial_rate_deg_per_s = {omega0}"
        )
        facts = {"kind": "profile", "points": points}

    def world(shares):
        body = {name: BODY[name] * (1 + part / 100 * shares[k]) for k, name in enumerate(("M", "L", "I", "ell"))}
        return World(**{**BODY, **body}, angle_deg=angle + width * shares[4], theta0_deg=theta0, omega0_deg=omega0,
                     **facts)  # fmt: skip

    return text, "\n".join(uncertain), gains, duration, world


@pytest.mark.parametrize("seed", [*range(4), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(4, 24))])
def test_random_boxes_keep_what_is_proved_of_them_and_break_what_is_disproved(seed):
    rng = np.random.default_rng(seed)
    text, uncertain, gains, duration, world = _random(rng)
    corners = [np.zeros(5), *rng.choice([-1.0, 1.0], (4, 5)), *rng.uniform(-1, 1, (2, 5))]
    runs = [worst(world(shares), gains, duration) for shares in corners]
    least = min(min(each["toe-force"], each["heel-force"]) for each in runs)
    off = float(rng.choice([-8.0, 0.5]))  # what all but certainly holds, and what does not
    level = max(least + off, 0.0)
    source, problem = spec(text, requirements=f"contact_force_n = {level:.4f}", uncertainty=uncertain, gains=gains)
    proof, _ = proved(source, problem, seconds=30.0)
    if proof.answer == "proved":
        assert proof.checked
        assert off < 0 or least >= level
        longer = 8.0 if proof.every_time else duration
        for shares in corners:
            held(proof, world(shares), gains, longer)
    if proof.answer == "disproved":
        broken = proof.counterexample
        body = {name: broken.at[name] for name in ("M", "L", "I", "m", "ell")}
        facts = world(np.zeros(5))
        there = World(**body, kind=facts.kind, angle_deg=math.degrees(broken.at["slope"]), ramp_s=facts.ramp_s,
                      points=facts.points, theta0_deg=facts.theta0_deg, omega0_deg=facts.omega0_deg)  # fmt: skip
        t, toe, heel, _, _ = run(there, gains, duration)
        series = {"toe-force": toe, "heel-force": heel}[broken.row]
        sides = [*series[np.abs(t - broken.time_s) < 1e-9], np.interp(broken.time_s, t, series)]  # of a jump
        assert min(abs(side - broken.value) for side in sides) < 0.05
        assert series.min() < level
        for name, part in (("M", "mass_kg"), ("L", "com_height_m"), ("ell", "half_length_m")):
            percent = Fraction(next(line for line in uncertain.splitlines() if part in line).split()[-2])
            middle = Fraction(repr(BODY[name]))
            inside = abs(Fraction(broken.at[name]) - middle) <= middle * percent / 100
            assert inside if percent else broken.at[name] == BODY[name], name


# ---- the end


END = """kind = "profile"
points = [[0.0, 0.0, 0.0], [1.5, 10.0, 0.0]{}]
duration_s = 2.0
initial_angle_deg = 0.1"""


@pytest.mark.parametrize(
    ("more", "ever"),
    [
        ("", True),
        (", [2.0, 10.0, 0.0], [2.0, 500.0, 0.0]", False),
        (", [30.0, 3000.0, 0.0]", False),
        (", [2.0, 10.0, 0.0], [30.0, 3000.0, 0.0]", False),
    ],
)
def test_every_time_is_said_only_where_the_force_rests_when_the_scenario_ends(more, ever):
    source, problem = spec(END.format(more))
    proof, (entry,) = proved(source, problem)
    assert proof.answer == "proved"
    assert proof.every_time is ever
    facts = proving.document(source, problem, problem.given_gains(), [proof], 1.0)
    assert facts["scenarios"][0]["every_time"] is ever
    assert {row["every_time"] for row in facts["rows"]} == {ever}
    said = proving.remarks([proof])[0]
    assert ("also after the scenario's end" in said) is ever
    assert ("until the end at 2 s" in said) is not ever
    answer = verdict.check(proving_text(source, problem, entry).encode())
    assert answer.for_ever == {"s": ever}


def proving_text(source, problem, entry):
    from design.proof.certificate import document

    return document(source, problem, problem.given_gains(), [entry])


def test_a_scenario_that_is_cut_while_its_ramp_still_grows_is_proved_until_its_end():
    source, problem = spec(slope_text(2.0, 4.0, 2.0))
    proof, _ = proved(source, problem)
    assert proof.answer == "proved"
    assert not proof.every_time


# ---- what is not contact can be broken, too


def test_cop_margin_and_torque_are_disproved_where_an_independent_run_breaks_them_by_a_hair():
    world = World(**BODY, angle_deg=2.0, ramp_s=0.5)
    found = worst(world, GAINS, 3.0)
    for key, row, better in (("cop_margin_m", "cop-margin", -1.0), ("torque_nm", "torque", 1.0)):
        for off, answer in ((1e-3, "proved"), (-1e-3, "disproved")):
            level = found[row] * (1 + better * off)
            source, problem = spec(slope_text(2.0, 0.5), requirements=f"{key} = {level:.9g}")
            proof, _ = proved(source, problem)
            assert proof.answer == answer, (row, off)
            if answer == "disproved":
                assert proof.counterexample.row == row
                assert proof.counterexample.value == pytest.approx(found[row], rel=1e-5)


def test_a_pole_a_hair_left_of_zero_is_never_called_unstable_nor_one_right_of_it_stable():
    source, problem = spec(slope_text(1.0, 0.5))
    for K_f, allowed in ((1e-13, {"proved", "unknown"}), (0.0, {"unknown"})):
        gains = Gains(1800.0, 420.0, K_f)
        proofs, _ = proving.proved_in(source, problem, gains, ["s"], seconds=3.0)
        assert proofs[0].answer in allowed
    # (29): K_d ell (K_p - A L) = K_f I K_p is the border; A = M g on a slope
    border = 420.0 * 0.11 * (1800.0 - 60.0 * 9.81 * 0.9) / (65.0 * 1800.0)
    for off, broken in ((1e-13, True), (-1e-13, False)):
        gains = Gains(1800.0, 420.0, border * (1 + off))
        proofs, _ = proving.proved_in(source, problem, gains, ["s"], seconds=3.0)
        found = proofs[0].counterexample
        assert (found is not None and found.row == "decay-rate") is broken, off


# ---- the checker has the last word


def test_what_the_checker_does_not_confirm_is_not_called_proved(monkeypatch):
    source, problem = spec(slope_text(1.0, 0.5))
    monkeypatch.setattr(verdict, "check", lambda content, **_: verdict.Answer(why="not shown"))
    proof, entries = proved(source, problem)
    assert (proof.answer, entries) == ("unknown", [])
    assert "independent checker does not confirm it: not shown" in proof.why
    assert not any(row.basis == "proved" for row in proving.rows(problem, [proof]) if row.id not in proving.STABILITY)


def test_a_law_that_has_no_certificate_says_that_its_proof_is_not_checked():
    source, problem = spec(slope_text(1.0, 0.5))
    problem = problem.with_law("cop")
    proofs, entries = proving.proved_in(source, problem, Gains(*GAINS), ["s"], seconds=20.0)
    assert (proofs[0].answer, entries) == ("proved", [])
    assert "not independently checked" in proving.remarks(proofs)[0]


def test_the_bounds_that_are_said_are_those_that_the_checker_confirms():
    source, problem = spec(slope_text(1.0, 0.5), requirements="torque_nm = 100.0")
    proof, _ = proved(source, problem)
    _, answer = confirmed(source, problem, problem.given_gains(), proof)
    rows = {row.id: row.value for row in proving.rows(problem, [proof])}
    for row, value in answer.claims["s"].items():
        assert rows[row] == pytest.approx(float(value), abs=2e-5 if row == "cop-margin" else 1e-4)
    found = worst(World(**BODY, angle_deg=1.0, ramp_s=0.5), GAINS, 8.0)
    for line in proving.as_text(source, problem, problem.given_gains(), [proof], [], lambda text, _: text).splitlines():
        words = line.split()
        if words and words[0] == "PROVED" and words[1] in found:
            printed = Fraction(words[3])
            exact = Fraction(repr(rows[words[1]]))
            assert printed >= exact if words[1] == "torque" else printed <= exact
