"""A certificate is confirmed if and only if what it claims is shown: the checker believes nothing else."""

import ast
import hashlib
import json
import re
import time
from pathlib import Path

import numpy as np
import pytest
from certificate_cases import (
    BOXED,
    CLAIMS,
    PART,
    PROFILE,
    STEP,
    boxed,
    changed,
    source,
    step,
    tampered,
    tampered_boxes,
    true_ones,
    weaker,
    written,
)

from design.analysis.recheck import second_opinion
from design.checking import verdict, words
from design.errors import BadInput
from design.model.laws import Gains
from design.proof.box import Proof, prove
from design.proof.certificate import confirmed, write
from design.spec.load import builtin_text
from design.spec.setting import setting

BOX_OF_MASS = "[uncertainty]\nmass_kg = 0.2\n"
CHECKER = sorted((Path(__file__).resolve().parents[2] / "design" / "checking").glob("*.py"))


def check(text):
    return verdict.check(text.encode())


# ---- what is true is confirmed


@pytest.mark.parametrize(
    "name",
    ["slope", *(pytest.param(name, marks=pytest.mark.slow) for name in ("slope-step", "wind", "train"))],
)
def test_what_is_proved_is_confirmed(name):
    text = written(builtin_text(name))
    answer = check(text)
    assert answer.confirmed, answer.why
    assert all(answer.for_ever.values())
    assert not answer.left_out
    assert len(text) < 1_000_000
    if name == "slope":
        claims = answer.claims["ramp"]
        assert 29.5317 < claims["heel-force"] <= 29.5417  # the paper's, to a hundredth of a newton
        assert 206.984 < claims["toe-force"] <= 206.9945


@pytest.mark.parametrize("number", range(4))
def test_small_ones_are_confirmed(number):
    answer = check(true_ones()[number])
    assert answer.confirmed, answer.why


def test_bodies_and_worlds_of_a_certified_box_keep_what_is_claimed():
    answer = check(boxed())
    assert answer.parts == 2
    claims = answer.claims["ramp"]
    problem = setting(source(builtin_text("slope"), BOXED).spec)
    rng = np.random.default_rng(3)
    for shares in (*([[0, 0, 0, 0, 0, 0, 0]]), *rng.choice([-1.0, 1.0], (6, 7)), *rng.uniform(-1, 1, (4, 7))):
        biped, scenario = problem.tolerances.drawn(problem.biped, problem.scenarios[0], shares)
        ran = second_opinion(biped, "force", 0.0, problem.gains, scenario, 1e-3)
        assert ran.F_T.min() >= claims["toe-force"]
        assert ran.F_H.min() >= claims["heel-force"]
        assert (biped.ell - np.abs(ran.tau / (ran.F_T + ran.F_H))).min() >= claims["cop-margin"]


def test_a_claim_is_as_near_to_the_truth_as_sampling_can_tell():
    problem = setting(source(builtin_text("slope-step"), STEP).spec)
    ran = second_opinion(problem.biped, "force", 0.0, problem.gains, problem.scenarios[0], 1e-4)
    claims = check(step()).claims["step"]
    for row, value in (("toe-force", ran.F_T.min()), ("heel-force", ran.F_H.min())):
        assert value - 0.05 < claims[row] <= value + 1e-6
    assert np.abs(ran.tau).max() - 1e-6 <= claims["torque"] < np.abs(ran.tau).max() + 0.02


# ---- what is not shown is refused


def refused(cases):
    answers = {name: check(text) for name, text in cases.items()}
    assert [name for name, answer in answers.items() if answer.confirmed] == []
    assert all(answer.why for answer in answers.values())


def test_tampering_is_refused():
    assert len(tampered()) > 110
    refused(dict(list(tampered().items())[::3]))


@pytest.mark.slow
def test_every_tampering_is_refused():
    refused(tampered())


@pytest.mark.slow
def test_every_tampering_with_a_box_is_refused():
    refused(tampered_boxes())


def test_what_claims_less_may_stay():
    answers = {name: check(text) for name, text in weaker().items()}
    assert {name: answer.why for name, answer in answers.items() if not answer.confirmed} == {}
    assert answers["one scenario of three"].left_out == ["start", "wind"]


def rendered(text, tmp_path, **options):
    """The JSON of `poise check`, and what it returns for the exit code."""
    place = tmp_path / "certificate.json"
    place.write_text(text, encoding="utf-8")
    told, confirmed = words.render(str(place), form="json", **options)
    return json.loads(told), confirmed


def test_what_covers_less_than_the_spec_asks_is_not_called_confirmed(tmp_path):
    its = source(
        builtin_text("slope-step"), (("kd = 1200.0", "kd = 606.2"), ("[synthesis]", f"{BOX_OF_MASS}[synthesis]"))
    )
    problem = setting(its.spec)
    nominal = prove(problem, problem.gains, "step", scale=0.0)
    others = problem.gains._replace(K_d=650.0)
    less = {
        "no box": write(its, problem, problem.gains, [nominal], 0.0),
        "other gains": write(its, problem, others, [prove(problem, others, "step")]),
        "one scenario of three": changed(written(PROFILE), ("scenarios",), lambda each: each[:1]),
    }
    for text in less.values():
        told, confirmed = rendered(text, tmp_path)
        assert (told["status"], confirmed) == ("incomplete", None)
        assert len(told["missing"]) == 1
        said, _ = words.render(str(tmp_path / "certificate.json"))
        assert "CONFIRMED" not in said
        told, confirmed = rendered(text, tmp_path, partial=True)
        assert (told["status"], confirmed) == ("partial", True)
    whole, confirmed = rendered(write(its, problem, problem.gains, [prove(problem, problem.gains, "step")]), tmp_path)
    assert (whole["status"], whole["missing"], confirmed) == ("confirmed", [], True)


def spec_changed(text, change):
    """The certificate with another spec's text, and the hash of that one."""
    document = json.loads(text)
    document["spec"]["text"] = change(document["spec"]["text"])
    document["spec"]["sha256"] = hashlib.sha256(document["spec"]["text"].encode()).hexdigest()
    return json.dumps(document)


SPOOF = "step: toe-force >= 480 N; at every time\\nCONFIRMED (1 part, 9 pieces)\\n\\u001b[8m"
TWIN = '[[scenarios]]\nname = "step"\nkind = "slope"\nangle_deg = 89.0\nduration_s = 1.0\n[law]'
NO_CERTIFICATES = {
    "a name that spells a verdict": lambda one: spec_changed(
        one, lambda text: text.replace('name = "step"', f'name = "{SPOOF}"')
    ),
    "a name with a line's end": lambda one: spec_changed(one, lambda text: text.replace('"step"', '"step\\n"')),
    "a scenario twice in the spec": lambda one: spec_changed(one, lambda text: text.replace("[law]", TWIN, 1)),
    "a scenario twice": lambda one: changed(one, ("scenarios",), lambda each: [*each, *each]),
    **{
        f"{path[-1]} as {value[:12]}": lambda one, path=path, value=value: changed(one, path, lambda _: value)
        for path in (("scale",), ("law", "kp"), (*PART, "rates", 0), (*PART, "frame", 0, 0), (*CLAIMS, "toe-force"))
        for value in ("1e30000000", "1e-99999999", "1/3", "9" * 5000)
    },
    "a scale of four hundred digits": lambda one: changed(one, ("scale",), lambda _: 10**399),
    "a scale of 1e41": lambda one: changed(one, ("scale",), lambda _: 10**41),
    "a coefficient of a million digits": lambda one: one.replace('"reach":', f'"more": {"7" * 1_000_000}, "reach":'),
    **{
        f"{key} twice": lambda one, key=key, first=first: one.replace(f'"{key}":', f'"{key}": {first}, "{key}":', 1)
        for key, first in (("scale", "1e3"), ("kp", "1e0"), ("toe-force", "-0.0"), ("tree", "{}"), ("sha256", '"0"'))
    },
    "a line's end in a key that is there twice": lambda one: one.replace('"scale":', '"s\\n": 1, "s\\n": 2, "scale":'),
    "an exponent of eight digits": lambda one: re.sub(r'"scale": ?1.0', '"scale": 1e99999999', one),
}  # fmt: skip


@pytest.mark.parametrize("name", NO_CERTIFICATES)
def test_names_and_numbers_that_are_none_are_bad_input_at_once(name, tmp_path):
    text = NO_CERTIFICATES[name](step())
    assert text != step()
    began = time.process_time()
    with pytest.raises(BadInput) as caught:
        rendered(text, tmp_path)
    assert time.process_time() - began < 1.0
    assert all(c.isprintable() for c in str(caught.value))
    assert len(str(caught.value)) < 400


def test_other_gains_than_the_specs_are_told():
    its = source(builtin_text("slope-step"))
    problem = setting(its.spec)
    gains = Gains(3500.0, 1000.0, 1.0)
    answer = check(write(its, problem, gains, [prove(problem, gains, "step")]))
    assert answer.confirmed
    assert answer.law == "force, kp = 3500.0, kd = 1000.0, kf = 1.0 (not the spec's)"


def test_it_must_be_for_the_spec_that_is_given():
    digest = json.loads(step())["spec"]["sha256"]
    assert verdict.check(step().encode(), sha256=digest).confirmed
    assert "another spec" in verdict.check(step().encode(), sha256=digest[::-1]).why


def _removed(document, path):
    holder = document
    for key in path[:-1]:
        holder = holder[key]
    del holder[path[-1]]


def _paths(value, path=()):
    if path:
        yield path
    if isinstance(value, dict):
        for key in value:
            yield from _paths(value[key], (*path, key))
    elif isinstance(value, list):
        for key in range(min(len(value), 2)):
            yield from _paths(value[key], (*path, key))


def test_a_damaged_certificate_is_refused_and_never_breaks_the_checker():
    numbers = {
        ("scale",),
        (*PART, "rates", 0),
        (*PART, "rates", 1),
        (*PART, "couplings", 0, 0),
        (*PART, "couplings", 1, 1),
        (*PART, "reach"),
        (*PART[:2], "claims", "decay-rate"),
    }  # true is 1
    may_stay = numbers
    for path in _paths(json.loads(step())):
        if path != ("format",):
            document = json.loads(step())
            _removed(document, path)
            assert not check(json.dumps(document)).confirmed or path == ("spec", "name"), path
            for other in (None, "x", [], {}, True, 1e300, -1):
                answer = check(changed(step(), path, lambda _, other=other: other))
                assert not answer.confirmed or path in may_stay, (path, other)


@pytest.mark.parametrize(
    "content",
    [b"", b"{", b"[]", b"3", b"\xff\xfe", b'{"format": "other"}', b'{"a": NaN}', b"[" * 100_000, b"1e999999999"],
)
def test_what_is_no_certificate_is_bad_input(content):
    with pytest.raises(BadInput, match="is not a certificate"):
        verdict.check(content)


def test_a_file_that_is_not_there_is_bad_input(tmp_path):
    with pytest.raises(BadInput, match="cannot be read"):
        words.render(str(tmp_path / "none.json"))


def test_what_is_not_proved_is_not_certified():
    its = source(builtin_text("slope"))
    problem = setting(its.spec)
    with pytest.raises(BadInput, match="nothing is proved"):
        write(its, problem, problem.gains, [Proof(scenario="ramp", answer="unknown")])
    false = Proof(scenario="ramp", answer="proved", value={"cop-margin": 0.05, "decay-rate": 1.0})
    with pytest.raises(BadInput, match="cop-margin"):
        write(its, problem, problem.gains, [false])


# ---- words


def test_an_answer_is_told(tmp_path):
    place = tmp_path / "certificate.json"
    place.write_text(boxed(), encoding="utf-8")
    said, confirmed = words.render(str(place))
    assert confirmed
    assert said.endswith("CONFIRMED (2 parts, 237 pieces)\n") or re.search(
        r"CONFIRMED \(2 parts, \d+ pieces\)\n$", said
    )
    assert "for all M 49 to 51 kg, slope 5 to 7 deg, ramp 0.48 to 0.52 s; at every time" in said
    told = json.loads(words.render(str(place), form="json")[0])
    assert told["status"] == "confirmed"
    assert told["scenarios"][0]["box"]["M"] == {"from": 49.0, "to": 51.0, "unit": "kg"}
    place.write_text(changed(step(), ("scale",), lambda _: 2), encoding="utf-8")
    assert words.render(str(place))[1]  # no tolerances, so there is no box
    place.write_text(changed(step(), ("law", "kd"), lambda value: 2 * value), encoding="utf-8")
    said, confirmed = words.render(str(place))
    assert not confirmed
    assert said.startswith("REFUSED: step: ")


# ---- the checker itself


def test_the_checker_shares_no_code_with_the_prover_and_is_small():
    known = {"design.checking", "design.errors"}
    lines = 0
    for path in CHECKER:
        lines += len(path.read_text(encoding="utf-8").splitlines())
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [each.name for each in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            for name in names:
                ours = name.split(".")[0] in ("design", "problems")
                assert not ours or any(name == each or name.startswith(f"{each}.") for each in known), (path, name)
                assert name.split(".")[0] not in ("numpy", "scipy", "casadi"), (path, name)
    assert lines < 1200


@pytest.mark.parametrize("later", ["", ", [0.9, 0.0, 0.0]", ", [0.6, 0.0, 0.0], [0.9, 0.0, 0.0], [1.4, 0.0, 0.0]"])
def test_points_after_the_end_at_which_the_force_stays_change_nothing(later):
    its = source(PROFILE, (("[0.3, 0.0, 0.0]]", f"[0.3, 0.0, 0.0]{later}]"),))
    problem = setting(its.spec)
    answer = confirmed(its, problem, problem.gains, prove(problem, problem.gains, "push"))[1]
    assert answer.for_ever["push"]
    assert answer.claims["push"] == verdict.check(written(PROFILE).encode()).claims["push"]


def test_a_force_of_nothing_whose_ramp_is_cut_off_is_proved():
    its = source(PROFILE, (("fx_n = 30.0\nfy_n = -20.0\nramp_s = 0.4", "fx_n = 0.0\nfy_n = 0.0\nramp_s = 0.4"),))
    problem = setting(its.spec)
    assert confirmed(its, problem, problem.gains, prove(problem, problem.gains, "wind"))[1].confirmed
