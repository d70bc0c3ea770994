"""A spec that cannot be used is refused in one line: the file, the key, what was got, and what is allowed."""

import copy
import datetime
import hashlib
import json
import math
import os
import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.errors import BadInput
from design.spec import load as loader
from design.spec.load import builtin_names, builtin_text, load, parse
from design.spec.schema import MAX_STEPS, SCHEMA_VERSION, RequirementsTable
from design.spec.setting import setting

VALID = {
    "schema_version": 1,
    "name": "mine",
    "source": "made up",
    "body": {"mass_kg": 50.0, "com_height_m": 0.75, "inertia_kgm2": 37.5},
    "foot": {"mass_kg": 0.1, "half_length_m": 0.1},
    "scenarios": [
        {"name": "ramp", "kind": "slope", "angle_deg": 30.0, "ramp_s": 5.0, "duration_s": 10.0,
         "initial_angle_deg": 1.0, "initial_rate_deg_per_s": 2.0},
        {"name": "wind", "kind": "force", "fx_n": 60.0, "fy_n": 1.0, "ramp_s": 2.0, "duration_s": 10.0},
        {"name": "train", "kind": "platform", "acceleration_mps2": [[0.0, 0.0], [1.5, 1.0]], "duration_s": 12.0},
        {"name": "gust", "kind": "profile", "points": [[0.0, 0.0, 0.0], [2.0, -40.0, 0.0]], "duration_s": 10.0},
    ],
    "law": {"kind": "force", "kp": 3500.0, "kd": 1200.0, "kf": 1.0, "desired_angle_deg": 0.5},
    "requirements": {"contact_force_n": 20.0, "decay_rate_per_s": 0.5, "cop_margin_m": {"min": 0.01, "soft": True},
                     "torque_nm": {"max": 90.0}},
    "synthesis": {"maximise": "decay-rate", "starts": 3,
                  "bounds": {"kp": [0.0, 3500.0], "kd": [0.0, 1200.0], "kf": [0.0, 17.0]}},
    "simulation": {"time_step_s": 0.001, "gravity_mps2": 9.81},
}  # fmt: skip


class Raw(str):
    """TOML source that stands for itself."""


def toml(value):
    if isinstance(value, Raw):
        return str(value)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, dict):
        return "{" + ", ".join(f"{toml(str(key))} = {toml(part)}" for key, part in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    if isinstance(value, datetime.date | datetime.time):
        return value.isoformat()
    return repr(value)


def text_of(data):
    return "\n".join(f"{toml(key)} = {toml(value)}" for key, value in data.items()) + "\n"


def text_with(path, value):
    """The valid spec with ``value`` at ``path``; None takes the key away."""
    data = copy.deepcopy(VALID)
    inner = data
    for part in path[:-1]:
        inner = inner[part]
    if value is None:
        del inner[path[-1]]
    else:
        inner[path[-1]] = value
    return text_of(data)


def dotted(path):
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path).removeprefix(".")


def refusal(text):
    """The message with which ``text`` is refused."""
    with pytest.raises(BadInput) as caught:
        setting(parse(text, origin="mine.toml").spec)
    message = str(caught.value)
    assert message.startswith("mine.toml: ")
    assert len(message.splitlines()) == 1
    return message


def refusal_of(path):
    """The message with which the file or name ``path`` is refused."""
    with pytest.raises(BadInput) as caught:
        load(str(path))
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    assert str(path) in message
    return message


def leaves(value, path=()):
    if isinstance(value, dict | list):
        for key, part in value.items() if isinstance(value, dict) else enumerate(value):
            yield from leaves(part, (*path, key))
    else:
        yield path, value


def nodes(value, path=()):
    if path:
        yield path
    if isinstance(value, dict | list):
        for key, part in value.items() if isinstance(value, dict) else enumerate(value):
            yield from nodes(part, (*path, key))


LEAVES = list(leaves(VALID))
NODES = list(nodes(VALID))
NUMBERS = [path for path, value in LEAVES if isinstance(value, float)]


def test_the_unbroken_spec_is_accepted():
    assert parse(text_of(VALID), origin="mine.toml").remarks == ()


# The file itself


def test_a_missing_file_is_named_with_the_built_in_specs(tmp_path):
    message = refusal_of(tmp_path / "missing.toml")
    assert "no such file" in message
    assert all(name in message for name in builtin_names())


@pytest.mark.parametrize(("wrong", "right"), [("slop", "slope"), ("trian", "train"), ("adult_slope", "adult-slope")])
def test_a_misspelt_built_in_name_is_answered_with_the_right_one(wrong, right, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert f"did you mean {right!r}" in refusal_of(wrong)


def test_a_directory_is_no_spec(tmp_path):
    assert "is a directory" in refusal_of(tmp_path)


def test_a_file_below_a_file_does_not_exist(tmp_path):
    (tmp_path / "plain.toml").write_text("x = 1")
    assert "no such file" in refusal_of(tmp_path / "plain.toml" / "mine.toml")


def test_a_link_to_itself_cannot_be_read(tmp_path):
    (tmp_path / "loop.toml").symlink_to(tmp_path / "loop.toml")
    assert "cannot be read" in refusal_of(tmp_path / "loop.toml")


def test_a_file_without_read_permission_says_so(tmp_path):
    path = tmp_path / "secret.toml"
    path.write_text(text_of(VALID))
    path.chmod(0)
    if os.access(path, os.R_OK):
        pytest.skip("this user may read everything")
    assert "ermission denied" in refusal_of(path)


@pytest.mark.parametrize(
    "raw", [b"\xff\xfe[\x00", "name = 'Gr\u00f6\u00dfe'".encode("latin-1")], ids=["utf-16", "latin-1"]
)
def test_a_file_that_is_not_utf8_says_at_which_byte(raw, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_bytes(raw)
    position = next(k for k, byte in enumerate(raw) if byte > 127)
    message = refusal_of(path)
    assert "UTF-8" in message
    assert f"byte {position}" in message


def test_more_bytes_than_allowed_are_not_read(tmp_path, monkeypatch):
    path = tmp_path / "mine.toml"
    path.write_text(text_of(VALID))
    monkeypatch.setattr(loader, "MAX_BYTES", 100)
    assert "at most 100 " in refusal_of(path)


def test_more_bytes_than_allowed_are_not_read_from_a_pipe_either(monkeypatch):
    monkeypatch.setattr(loader, "MAX_BYTES", 100)
    reader, writer = os.pipe()
    with os.fdopen(writer, "wb") as end:
        end.write(text_of(VALID).encode())
    try:
        assert "at most 100 " in refusal_of(f"/dev/fd/{reader}")
    finally:
        os.close(reader)


def test_a_byte_order_mark_and_windows_line_ends_do_no_harm(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_bytes(b"\xef\xbb\xbf" + text_of(VALID).replace("\n", "\r\n").encode())
    assert load(str(path)).spec == parse(text_of(VALID), origin="").spec


@pytest.mark.parametrize("ends", ["\n", "\r\n"], ids=["unix", "windows"])
def test_the_digest_is_that_of_the_file(ends, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_bytes(text_of(VALID).replace("\n", ends).encode())
    assert load(str(path)).sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


# TOML


@pytest.mark.parametrize("text", ["", "\n \n", "# only a comment\n"], ids=["nothing", "blank", "comment"])
def test_an_empty_file_is_answered_with_the_tables_it_needs(text):
    message = refusal(text)
    for needed in ("schema_version", "name", "[body]", "[foot]", "[[scenarios]]", "[law]"):
        assert needed in message


@pytest.mark.parametrize(
    ("text", "line", "column"),
    [
        ("name = 'a'\n[body\nmass_kg = 1\n", 2, 6),
        ("name = = 3\n", 1, 8),
        ("name = 1\nname = 2\n", 2, 9),
        ("[body]\nmass_kg = 1\n[foot]\n[body]\n", 4, 6),
        ("[body]\nmass_kg = 1\nmass_kg = 2\n", 3, 12),
        ("a.b = 1\na.b.c = 2\n", 2, 10),
        ("mass_kg = 1,5\n", 1, 12),
        ("mass_kg = .5\n", 1, 11),
        ("name = 'a\nb'\n", 1, 10),
        ("x = 1\x00\n", 1, 6),
        ("name =\n", 1, 7),
        ("name = ", 1, 8),
        ("a = 1\nname = 'never closed", 2, 21),
        ("a = 1\npoints = [[0, 1], [2,", 2, 22),
    ],
    ids=[
        "open bracket", "two equal signs", "duplicate key", "duplicate table", "duplicate key in a table",
        "a value as table", "decimal comma", "no leading zero", "line end in a string", "NUL", "no value",
        "no value at the end", "unclosed string at the end", "unclosed array at the end",
    ],
)  # fmt: skip
def test_what_is_not_toml_is_shown_by_line_and_column(text, line, column):
    message = refusal(text)
    assert "is not valid TOML" in message
    found = re.search(r"line (\d+), column (\d+)", message)
    assert found, message
    assert int(found[1]) == line
    assert abs(int(found[2]) - column) <= 1


@pytest.mark.parametrize(
    "text",
    ["x = " + "[" * 9000 + "]" * 9000, "x = " + "{a=" * 9000 + "1" + "}" * 9000, "x = " + "[" * 9000],
    ids=["arrays", "tables", "unclosed"],
)
def test_deep_nesting_is_refused(text):
    assert "nested too deeply" in refusal(text)


@pytest.mark.parametrize("depth", [10, 90, 300])
def test_a_nested_value_is_refused_at_its_key(depth):
    assert refusal(text_with(("body", "mass_kg"), Raw("[" * depth + "]" * depth))).startswith(
        "mine.toml: body.mass_kg: "
    )


@pytest.mark.parametrize(
    "text", [".".join("a" * 3000) + " = 1", "[" + ".".join("a" * 3000) + "]\nb = 1"], ids=["key", "table"]
)
def test_a_deep_dotted_key_is_refused(text):
    refusal(text)


@pytest.mark.parametrize("digits", [400, 4000, 5000, 50_000])
def test_a_huge_integer_is_refused(digits):
    message = refusal(text_with(("body", "mass_kg"), Raw("9" * digits)))
    assert "body.mass_kg: is inf; needs a finite number" in message or "digits" in message


def test_include_reads_no_other_file(tmp_path):
    message = refusal('include = "../../etc/passwd"\n' + text_of(VALID))
    assert message.startswith("mine.toml: include: unknown key")


# Keys


@pytest.mark.parametrize(
    ("path", "meant"),
    [
        (("body", "mas"), "mass_kg"),
        (("body", "mass"), "mass_kg"),
        (("body", "Mass_kg"), "mass_kg"),
        (("boddy",), "body"),
        (("scenario",), "scenarios"),
        (("scenarios", 0, "ramp"), "ramp_s"),
        (("scenarios", 0, "angle_rad"), "angle_deg"),
        (("scenarios", 2, "acceleration"), "acceleration_mps2"),
        (("law", "Kp"), "kp"),
        (("requirements", "contact_force"), "contact_force_n"),
        (("requirements", "cop_margin_m", "sof"), "soft"),
        (("synthesis", "bound"), "bounds"),
        (("synthesis", "bounds", "kpp"), "kp"),
        (("simulation", "timestep_s"), "time_step_s"),
    ],
    ids=lambda value: dotted(value) if isinstance(value, tuple) else None,
)
def test_an_unknown_key_is_answered_with_the_one_that_was_meant(path, meant):
    message = refusal(text_with(path, 1.0))
    assert message.startswith(f"mine.toml: {dotted(path)}: unknown key; did you mean {meant!r}?; allowed here: ")
    assert meant in message.partition("allowed here: ")[2]


def test_a_misspelt_key_is_named_before_the_one_that_is_missing_for_it():
    data = copy.deepcopy(VALID)
    data["body"]["mas"] = data["body"].pop("mass_kg")
    message = refusal(text_of(data))
    assert message.startswith("mine.toml: body.mas: unknown key; did you mean 'mass_kg'?")
    assert message.endswith("(and 1 more problem in this file)")


def test_a_key_of_another_kind_of_scenario_is_unknown():
    message = refusal(text_with(("scenarios", 1, "angle_deg"), 3.0))
    assert message.startswith("mine.toml: scenarios[1].angle_deg: unknown key")
    assert "fx_n" in message


REQUIRED = [
    ("schema_version",), ("name",), ("body",), ("foot",), ("scenarios",), ("law",),
    ("body", "mass_kg"), ("body", "com_height_m"), ("foot", "mass_kg"), ("foot", "half_length_m"),
    ("scenarios", 0, "name"), ("scenarios", 0, "kind"), ("scenarios", 0, "angle_deg"), ("scenarios", 0, "duration_s"),
    ("scenarios", 1, "fx_n"), ("scenarios", 2, "acceleration_mps2"), ("scenarios", 3, "points"), ("law", "kind"),
    ("requirements", "torque_nm", "max"), ("synthesis", "bounds", "kp"), ("synthesis", "bounds", "kd"),
]  # fmt: skip


@pytest.mark.parametrize("path", REQUIRED, ids=dotted)
def test_a_missing_key_is_named_with_what_it_is(path):
    assert re.match(
        rf"mine\.toml: {re.escape(dotted(path))}: is missing; (needs|allowed:) \S+",
        refusal(text_with(path, None)),
    )


OPTIONAL = [
    ("source",), ("requirements",), ("synthesis",), ("simulation",),
    ("body", "inertia_kgm2"), ("law", "kp"), ("law", "kd"), ("law", "kf"), ("law", "desired_angle_deg"),
    ("scenarios", 0, "ramp_s"), ("scenarios", 0, "initial_angle_deg"), ("scenarios", 0, "initial_rate_deg_per_s"),
    ("scenarios", 1, "fy_n"), ("scenarios", 1, "ramp_s"),
    ("requirements", "contact_force_n"), ("requirements", "decay_rate_per_s"), ("requirements", "cop_margin_m"),
    ("requirements", "cop_margin_m", "soft"), ("requirements", "torque_nm"),
    ("synthesis", "maximise"), ("synthesis", "starts"), ("synthesis", "bounds"), ("synthesis", "bounds", "kf"),
    ("simulation", "time_step_s"), ("simulation", "gravity_mps2"),
]  # fmt: skip


@pytest.mark.parametrize("path", OPTIONAL, ids=dotted)
def test_an_optional_key_may_be_left_out(path):
    setting(parse(text_with(path, None), origin="mine.toml").spec)


def test_a_missing_schema_version_is_answered_with_the_version():
    assert re.search(rf"\b{SCHEMA_VERSION}\b", refusal(text_with(("schema_version",), None)))


def test_a_requirement_without_its_level_is_asked_for_a_number():
    message = refusal(text_with(("requirements", "cop_margin_m"), {"soft": True}))
    assert message.startswith("mine.toml: requirements.cop_margin_m.min: is missing")
    assert "table" not in message


# Numbers


@pytest.mark.parametrize(
    ("source", "got"),
    [
        ("nan", "is nan"),
        ("-nan", "is nan"),
        ("inf", "is inf"),
        ("-inf", "is -inf"),
        ("1e999", "is inf"),
        ("-0.0", "is -0.0; write 0.0"),
        ("true", "is a boolean"),
        ('"80"', "write 80 without quotes"),
        ('"heavy"', "is a string"),
        ("[1.0]", "is a list"),
        ("1979-05-27", "is a date"),
        ("9" * 400, "is inf"),
    ],
    ids=lambda value: value[:12],
)
def test_what_is_no_plain_finite_number_is_refused_at_its_key(source, got):
    for path in NUMBERS:
        message = refusal(text_with(path, Raw(source)))
        assert message.startswith(f"mine.toml: {dotted(path)}")
        assert got in message
        assert "needs a" in message or "write 0.0" in message


@pytest.mark.parametrize(
    ("path", "bad", "allowed"),
    [
        (("body", "mass_kg"), (0, 0.0, -1, -80.0, 1001), "needs >= 0.001 and <= 1000 [kg]"),
        (("body", "com_height_m"), (0, -0.75, 1001), "needs >= 0.0001 and <= 1000 [m]"),
        (("body", "inertia_kgm2"), (0, -7.0, 1e10), "needs >= 1e-06 and <= 1e+09 [kg m²]"),
        (("foot", "mass_kg"), (-0.1, 101), "needs >= 0 and <= 100 [kg]"),
        (("foot", "half_length_m"), (0, -0.1, 11), "needs >= 0.0001 and <= 10 [m]"),
        (("foot", "ankle_height_m"), (-0.1, 11), "needs >= 0 and <= 10 [m]"),
        (("law", "cop_target_m"), (-11, 11), "needs >= -10 and <= 10 [m]"),
        (("scenarios", 0, "duration_s"), (0, -10, 3601), "needs >= 0.001 and <= 3600 [s]"),
        (("scenarios", 0, "ramp_s"), (-5, 3601), "needs >= 0 and <= 3600 [s]"),
        (("scenarios", 0, "angle_deg"), (181, -181), "needs >= -180 and <= 180 [deg]"),
        (("scenarios", 0, "initial_angle_deg"), (91, -91), "needs >= -90 and <= 90 [deg]"),
        (("scenarios", 1, "fx_n"), (1e7, -1e7), "needs >= -1e+06 and <= 1e+06 [N]"),
        (("law", "kp"), (-1, 1e10), "needs >= 0 and <= 1e+09 [N m/rad]"),
        (("law", "kd"), (-1, 1e10), "needs >= 0 and <= 1e+09 [N m s/rad]"),
        (("law", "kf"), (-1, 1e10), "needs >= 0 and <= 1e+09 [m/s]"),
        (("law", "desired_angle_deg"), (91,), "needs >= -90 and <= 90 [deg]"),
        (("requirements", "contact_force_n"), (-1,), "needs >= 0"),
        (("requirements", "torque_nm"), (-1,), "needs >= 0"),
        (("synthesis", "starts"), (0, -1, 1001, 10**30), "needs >= 1 and <= 1000"),
        (("synthesis", "bounds", "kp", 0), (-1,), "needs >= 0"),
        (("simulation", "time_step_s"), (0, -0.001, 1.5), "needs > 0 and <= 1 [s]"),
        (("simulation", "gravity_mps2"), (0, -9.81, 1001), "needs >= 0.001 and <= 1000 [m/s²]"),
    ],
    ids=lambda value: dotted(value) if isinstance(value, tuple) and isinstance(value[0], str) else None,
)
def test_a_number_out_of_range_is_answered_with_the_range_and_the_unit(path, bad, allowed):
    for value in bad:
        message = refusal(text_with(path, value))
        assert message.startswith(f"mine.toml: {dotted(path)}")
        assert allowed in message


@pytest.mark.parametrize("value", [-1.0, math.nan, "20"])
def test_a_requirement_written_as_a_number_is_named_by_the_key_that_was_written(value):
    for key in RequirementsTable.model_fields:
        assert refusal(text_with(("requirements", key), value)).startswith(f"mine.toml: requirements.{key}: ")


@pytest.mark.parametrize("text", ["nan", "inf", "1e999", "-0.0"])
def test_no_hint_leads_to_another_refusal(text):
    assert f"write {text} without quotes" not in refusal(text_with(("body", "mass_kg"), text))


@pytest.mark.parametrize("value", [0.5, 1, 0x10, 1_0])
def test_integers_and_floats_are_equally_numbers(value):
    assert parse(text_with(("body", "mass_kg"), value), origin="").spec.body.mass_kg == float(value)


# Values


@pytest.mark.parametrize("value", [2, 3, 10**24])
def test_a_newer_version_is_named_beside_the_one_that_is_read(value):
    message = refusal(text_with(("schema_version",), value))
    assert message.startswith(f"mine.toml: schema_version: is {value}; this Poise reads {SCHEMA_VERSION}; upgrade")


def test_a_newer_version_is_named_before_the_keys_that_it_may_have_brought():
    assert "schema_version: is 2;" in refusal(text_of({**VALID, "schema_version": 2, "brand_new": {}}))


@pytest.mark.parametrize("value", [0, -1, True, "1", math.nan, [1], {}], ids=repr)
def test_only_the_integer_one_is_a_version(value):
    message = refusal(text_with(("schema_version",), value))
    assert message.startswith("mine.toml: schema_version: is ")
    assert str(SCHEMA_VERSION) in message.partition(";")[2]


@pytest.mark.parametrize("value", ["slop", "Slope", "", 3, 1.5, True, [1], {"a": 1}, math.nan], ids=repr)
def test_an_unknown_kind_of_scenario_is_answered_with_the_kinds(value):
    message = refusal(text_with(("scenarios", 0, "kind"), value))
    assert message.startswith("mine.toml: scenarios[0].kind: is ")
    assert message.endswith("allowed: slope, force, platform, profile")


@pytest.mark.parametrize(
    ("path", "value", "allowed"),
    [
        (("law", "kind"), "pid", ("pd", "force", "cop")),
        (("law", "kind"), 3, ("pd", "force", "cop")),
        (("synthesis", "maximise"), "contact", ("decay-rate", "contact-force", "cop-margin", "routh-margin")),
        (("synthesis", "starts"), 1.5, ("integer",)),
        (("synthesis", "starts"), True, ("integer",)),
        (("synthesis", "starts"), "3", ("integer",)),
        (("requirements", "cop_margin_m", "soft"), 1, ("boolean",)),
        (("requirements", "cop_margin_m", "soft"), "true", ("boolean",)),
        (("name",), "", ("1 to 64",)),
        (("name",), "a\nb", ("1 to 64",)),
        (("name",), "mine\n", ("1 to 64",)),
        (("name",), "../mine", ("1 to 64",)),
        (("name",), "x" * 65, ("1 to 64",)),
        (("name",), 3, ("string",)),
        (("scenarios", 0, "name"), "\x1b[31m", ("1 to 64",)),
        (("source",), "x" * 3000, ("2000",)),
        (("body",), 3, ("dictionary",)),
        (("body",), [{"mass_kg": 1.0}], ("dictionary",)),
        (("scenarios",), [], ("at least 1",)),
        (("scenarios",), {"kind": "slope"}, ("list",)),
        (("scenarios",), "ramp", ("list",)),
        (("requirements",), [], ("dictionary",)),
    ],
    ids=lambda value: dotted(value) if isinstance(value, tuple) and value[0] in VALID else None,
)
def test_a_value_that_is_not_allowed_is_answered_with_what_is(path, value, allowed):
    message = refusal(text_with(path, value))
    assert message.startswith(f"mine.toml: {dotted(path)}: is ")
    assert all(word in message for word in allowed)


@pytest.mark.parametrize("gain", ["kp", "kd", "kf"])
def test_reversed_bounds_are_refused_and_equal_ones_fix_the_gain(gain):
    message = refusal(text_with(("synthesis", "bounds", gain), [2.0, 1.0]))
    assert "synthesis.bounds" in message
    assert f"{gain} = [2.0, 1.0]: the lower bound is above the upper one" in message
    its = setting(parse(text_with(("synthesis", "bounds", gain), [2.0, 2.0]), origin="").spec)
    assert its.bounds[("kp", "kd", "kf").index(gain)].tolist() == [2.0, 2.0]


@pytest.mark.parametrize("value", [[], [1.0], [0.0, 1.0, 2.0], 3.0, {"low": 0.0}], ids=repr)
def test_bounds_are_two_numbers(value):
    message = refusal(text_with(("synthesis", "bounds", "kp"), value))
    assert message.startswith("mine.toml: synthesis.bounds.kp: is ")
    assert "list" in message


@pytest.mark.parametrize(
    ("index", "key", "points", "word"),
    [
        (2, "acceleration_mps2", [[0.0, 0.0], [2.0, 1.0], [1.0, 1.0]], "sort the points by time"),
        (3, "points", [[0.0, 0.0, 0.0], [2.0, 1.0, 0.0], [1.0, 1.0, 0.0]], "sort the points by time"),
        (2, "acceleration_mps2", [[-1.0, 0.0], [2.0, 1.0]], "needs >= 0"),
        (2, "acceleration_mps2", [], "at least 1"),
        (2, "acceleration_mps2", [[]], "at least 2"),
        (2, "acceleration_mps2", [[0.0]], "at least 2"),
        (2, "acceleration_mps2", [[0.0, 0.0, 0.0]], "at most 2"),
        (3, "points", [[0.0, 0.0]], "at least 3"),
        (3, "points", [[0.0, 0.0, 0.0, 0.0]], "at most 3"),
        (3, "points", [1.0, 2.0, 3.0], "list"),
        (3, "points", [["0", 0.0, 0.0]], "without quotes"),
    ],
)
def test_points_that_are_no_signal_are_refused(index, key, points, word):
    message = refusal(text_with(("scenarios", index, key), points))
    assert message.startswith(f"mine.toml: scenarios[{index}]")
    assert word in message


def test_points_at_equal_times_are_a_jump():
    points = [[0.0, 0.0], [1.0, 0.0], [1.0, 2.0]]
    its = setting(parse(text_with(("scenarios", 2, "acceleration_mps2"), points), origin="").spec)
    assert its.scenarios[2].breakpoints == [1.0]


def test_scenarios_of_the_same_name_are_refused():
    message = refusal(text_with(("scenarios", 2, "name"), "ramp"))
    assert message.startswith("mine.toml: scenarios[2].name = 'ramp' is taken by scenarios[0]")


@pytest.mark.parametrize("step", [1e-9, 1e-320, 5e-324])
def test_too_many_steps_are_refused(step):
    message = refusal(text_with(("simulation", "time_step_s"), step))
    assert "scenarios[0]" in message
    assert "simulation.time_step_s" in message
    assert f"at most {MAX_STEPS:,}" in message


# The message


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("body", "k" * 5000), 1.0),
        (("scenarios", 0, "kind"), "x" * 5000),
        (("law", "kind"), "x" * 5000),
        (("name",), "x" * 5000),
        (("schema_version",), Raw("9" * 4000)),
        (("body", "mass_kg"), list(range(5000))),
    ],
    ids=["key", "kind", "law", "name", "version", "list"],
)
def test_a_long_value_does_not_make_a_long_message(path, value):
    assert len(refusal(text_with(path, value))) < 500


def test_several_problems_are_counted():
    data = copy.deepcopy(VALID)
    data["body"].update(mass_kg=-1.0, com_height_m="tall")
    data["foot"]["length"] = 0.2
    assert refusal(text_of(data)).endswith("(and 2 more problems in this file)")


WORDS = st.text(st.characters(codec="utf-8"), max_size=12)
SCALARS = (
    st.booleans()
    | st.integers()
    | st.integers(-(10**400), 10**400)
    | st.floats()
    | st.floats(-10, 10)
    | WORDS
    | st.sampled_from(["slope", "force", "platform", "profile", "pd", "cop", "80", "nan"])
    | st.dates()
    | st.times()
    | st.datetimes()
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(WORDS | st.sampled_from(["min", "max", "kp"]), inner, max_size=3)
    ),
    max_leaves=8,
)


@given(path=st.sampled_from(NODES), value=VALUES)
@settings(max_examples=250, deadline=None)
def test_any_value_in_any_place_is_accepted_or_refused_in_one_line(path, value):
    text = text_with(path, value)
    try:
        setting(parse(text, origin="mine.toml").spec)
    except BadInput as error:
        assert str(error).startswith("mine.toml: ")
        assert len(str(error).splitlines()) == 1


@given(path=st.sampled_from(NUMBERS), value=st.floats() | st.integers(-(10**12), 10**12))
@settings(max_examples=200, deadline=None)
def test_a_number_that_is_refused_is_refused_at_its_key(path, value):
    try:
        setting(parse(text_with(path, value), origin="mine.toml").spec)
    except BadInput as error:
        above = dotted(path[:2])
        assert above in str(error) or path == ("simulation", "time_step_s")


@given(place=st.sampled_from([(), ("body",), ("scenarios", 0), ("law",), ("synthesis", "bounds")]), key=WORDS)
@settings(max_examples=100, deadline=None)
def test_any_key_that_is_unknown_is_refused_in_printable_characters(place, key):
    inside = VALID
    for part in place:
        inside = inside[part]
    if key in inside:
        return
    message = refusal(text_with((*place, key), 1.0))
    assert "unknown key" in message
    assert message.isprintable()


@given(path=st.sampled_from(NODES))
@settings(max_examples=100, deadline=None)
def test_a_spec_that_lacks_anything_is_accepted_or_refused_in_one_line(path):
    try:
        setting(parse(text_with(path, None), origin="mine.toml").spec)
    except BadInput as error:
        assert len(str(error).splitlines()) == 1


@given(
    text=st.text(st.characters(codec="utf-8"), max_size=60) | st.text("[]{}=.,'\"\n# a1-+e_:TZ\\", max_size=60),
    cut=st.integers(0, 1000),
)
@settings(max_examples=300, deadline=None)
def test_any_text_in_any_place_is_accepted_or_refused_in_one_line(text, cut):
    whole = builtin_text("slope")
    for candidate in (text, whole[:cut] + text + whole[cut:]):
        try:
            parse(candidate, origin="mine.toml")
        except BadInput as error:
            assert len(str(error).splitlines()) == 1
