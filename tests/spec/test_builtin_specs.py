"""Every built-in spec loads, is printed as it is stored, fits the JSON Schema, and is remarked on where it is odd."""

import copy
import json
import math
import sys
import tomllib
from pathlib import Path

import jsonschema
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cli
import design.spec
from design.errors import BadInput
from design.spec.load import builtin_names, builtin_text, load, parse
from design.spec.plausibility import remarks
from design.spec.schema import Spec, json_schema
from design.spec.setting import setting

LIBRARY = Path(design.spec.__file__).parent / "library"
NAMES = sorted(path.stem for path in LIBRARY.glob("*.toml"))
SLOPE = tomllib.loads(builtin_text("slope"))
ADULT = tomllib.loads(builtin_text("adult-slope"))
SCHEMA = jsonschema.Draft202012Validator(json_schema())


def changed(base=SLOPE, **values):
    """The data of a spec with ``table__key=value`` put in; ``scenario__key`` is of the first scenario."""
    data = copy.deepcopy(base)
    for place, value in values.items():
        table, _, key = place.partition("__")
        inner = data["scenarios"][0] if table == "scenario" else data.setdefault(table, {}) if key else data
        inner[key or table] = value
    return data


def remarks_on(**values):
    """What is remarked on the adult's spec, on which nothing is, with ``values`` put in."""
    return list(remarks(Spec.model_validate(changed(ADULT, **values))))


@pytest.fixture
def poise(monkeypatch, capsys):
    """Run the command; returns the exit code, standard output and the lines of standard error."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["poise", *arguments])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        out, err = capsys.readouterr()
        return ended.value.code or 0, out, err.splitlines()

    return run


# The library


def test_the_names_are_those_of_the_files():
    assert builtin_names() == NAMES
    assert {"slope", "slope-step", "wind", "train", "adult-slope", "adult-foot"} <= set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_a_built_in_spec_loads_under_its_own_name(name):
    source = load(name)
    assert source.spec.name == source.origin == name
    assert source.spec.source
    its = setting(source.spec)
    assert its.bounds is not None
    gains, low, high = its.given_gains(), its.bounds[:, 0], its.bounds[:, 1]
    assert all(a <= K <= b for a, K, b in zip(low, gains, high, strict=True))


@pytest.mark.parametrize("name", NAMES)
def test_init_prints_a_built_in_spec_to_the_byte(name, poise, tmp_path):
    code, out, err = poise("init", name)
    assert (code, err) == (0, [])
    assert out.encode() == (LIBRARY / f"{name}.toml").read_bytes()
    own = tmp_path / "own.toml"
    own.write_text(out, encoding="utf-8")
    assert load(str(own)).spec == load(name).spec
    assert load(str(own)).sha256 == load(name).sha256


@pytest.mark.parametrize("name", NAMES)
def test_a_spec_comes_back_from_json_as_it_went(name):
    spec = load(name).spec
    assert Spec.model_validate_json(spec.model_dump_json()) == spec


def test_specs_lists_every_built_in_with_its_scenarios(poise):
    code, out, err = poise("specs")
    assert (code, err) == (0, [])
    for line, name in zip(out.splitlines(), NAMES, strict=True):
        assert line.split()[0] == name
        assert all(scenario.name in line for scenario in load(name).spec.scenarios)


def test_the_slope_is_that_of_the_paper():
    its = setting(load("slope").spec)
    biped = its.biped
    assert (biped.M, biped.L, biped.I, biped.m, biped.ell, biped.g) == (50.0, 0.75, 7.03125, 0.1, 0.1, 9.81)
    assert biped.I == 50.0 * 0.75**2 / 4
    assert its.scenarios[0].angle == pytest.approx(math.radians(30.0), rel=1e-15)
    assert its.scenarios[0].times.tolist() == [0.0, 5.0]
    assert its.step == 0.001


# The JSON Schema


def test_the_schema_is_one():
    jsonschema.Draft202012Validator.check_schema(json_schema())
    assert json_schema()["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    assert json_schema()["title"] == "Poise spec file"


@pytest.mark.parametrize("name", NAMES)
def test_a_built_in_spec_fits_the_schema(name):
    SCHEMA.validate(tomllib.loads(builtin_text(name)))


GOOD = {
    "requirement as a number": {"requirements__torque_nm": 40.0},
    "requirement as a table": {"requirements__torque_nm": {"max": 40.0}},
    "soft requirement": {"requirements__contact_force_n": {"min": 20.0, "soft": True}},
    "integer for a number": {"body__mass_kg": 50},
    "law pd": {"law__kind": "pd"},
    "fixed gain": {"synthesis__bounds": {"kp": [1.0, 1.0], "kd": [0.0, 2.0]}},
}
BAD = {
    "unknown key": {"body__mas": 1.0},
    "unknown table": {"boddy": {}},
    "negative mass": {"body__mass_kg": -1.0},
    "zero height": {"body__com_height_m": 0.0},
    "text for a number": {"body__mass_kg": "50"},
    "boolean for a number": {"body__mass_kg": True},
    "negative requirement": {"requirements__contact_force_n": -1.0},
    "text for a requirement": {"requirements__contact_force_n": "20"},
    "min for max": {"requirements__torque_nm": {"min": 1.0}},
    "unknown kind": {"scenario__kind": "slop"},
    "key of another kind": {"scenario__fx_n": 1.0},
    "unknown law": {"law__kind": "pid"},
    "negative gain": {"law__kp": -1.0},
    "no inertia": {"body__inertia_kgm2": 0.0},
    "no scenario": {"scenarios": []},
    "newer version": {"schema_version": 2},
    "three bounds": {"synthesis__bounds": {"kp": [0.0, 1.0, 2.0], "kd": [0.0, 1.0]}},
    "name with a line end": {"name": "a\nb"},
    "too long a step": {"simulation__time_step_s": 2.0},
}


@pytest.mark.parametrize("values", GOOD.values(), ids=GOOD.keys())
def test_what_the_loader_accepts_the_schema_accepts(values):
    data = changed(**values)
    Spec.model_validate(data)
    SCHEMA.validate(data)


@pytest.mark.parametrize("values", BAD.values(), ids=BAD.keys())
def test_what_the_loader_refuses_the_schema_refuses(values):
    data = changed(**values)
    with pytest.raises(ValueError, match="validation error"):
        Spec.model_validate(data)
    with pytest.raises(jsonschema.ValidationError):
        SCHEMA.validate(data)


def test_the_schema_command_prints_the_schema(poise):
    code, out, err = poise("schema")
    assert (code, err) == (0, [])
    assert json.loads(out) == json_schema()


def test_every_number_of_the_schema_is_described():
    for table in json_schema()["$defs"].values():
        for key, its in table.get("properties", {}).items():
            if key not in ("kind", "min", "max"):
                assert its.get("description"), f"{table['title']}.{key}"


# A body that cannot exist


@pytest.mark.parametrize("name", NAMES)
def test_a_built_in_body_is_remarked_on_exactly_if_its_inertia_is_below_M_L2(name):
    source = load(name)
    body = source.spec.body
    least = body.mass_kg * body.com_height_m**2
    if body.inertia_kgm2 < least:
        (remark,) = source.remarks
        assert remark.startswith(f"body.inertia_kgm2 = {body.inertia_kgm2:g}: ")
        assert f"M L² = {least:.6g} kg m²" in remark
    else:
        assert source.remarks == ()


def test_the_papers_body_cannot_exist_and_the_adult_can():
    assert [name for name in NAMES if not load(name).remarks] == ["adult-foot", "adult-slope"]
    assert "at least M L² = 28.125 kg m²" in load("slope").remarks[0]


@given(M=st.floats(1, 200), L=st.floats(0.1, 2), share=st.floats(0.01, 9.9))
@settings(max_examples=200, deadline=None)
def test_inertia_is_remarked_on_exactly_if_it_is_below_M_L2(M, L, share):
    found = remarks_on(body__mass_kg=M, body__com_height_m=L, body__inertia_kgm2=share * M * L**2, foot__mass_kg=0.5)
    about = [remark for remark in found if "parallel-axis" in remark]
    if abs(share - 1) > 1e-9:
        assert len(about) == (share < 1)


@pytest.mark.parametrize(("M", "L"), [(50.0, 0.75), (68.0, 0.92), (70.0, 1.1), (0.3, 0.1)])
def test_a_point_mass_is_no_impossible_body(M, L):
    assert remarks_on(body__mass_kg=M, body__com_height_m=L, body__inertia_kgm2=M * L**2, foot__mass_kg=0.1,
                      foot__half_length_m=0.05) == []  # fmt: skip


def test_inertia_that_is_left_out_is_that_of_a_rod_and_not_remarked_on():
    data = tomllib.loads(builtin_text("adult-slope"))
    del data["body"]["inertia_kgm2"]
    spec = Spec.model_validate(data)
    assert list(remarks(spec)) == []
    assert setting(spec).biped.I == pytest.approx(4 / 3 * 68.0 * 0.92**2, rel=1e-14)


# Another unit

SLIPS = {
    "height in cm": (
        {"body__com_height_m": 175.0, "body__inertia_kgm2": 3e6},
        "body.com_height_m",
        ("175 m", "cm", "1.75"),
    ),
    "height in mm": (
        {"body__com_height_m": 0.00092, "body__inertia_kgm2": 1e-4},
        "body.com_height_m",
        ("0.92 mm",),
    ),
    "mass in g": (
        {"body__mass_kg": 900.0, "body__inertia_kgm2": 900.0},
        "body.mass_kg",
        ("900 kg", "g", "0.9"),
    ),
    "mass in N": (
        {"body__mass_kg": 687.0, "body__inertia_kgm2": 687.0},
        "body.mass_kg",
        ("687 kg", "N", "70.03"),
    ),
    "foot in cm": ({"foot__half_length_m": 9.0}, "foot.half_length_m", ("9 m", "cm", "0.09")),
    "ankle in cm": ({"foot__ankle_height_m": 8.0}, "foot.ankle_height_m", ("8 m", "cm", "0.08")),
    "slope in rad": ({"scenario__angle_deg": 0.1}, "scenarios[0].angle_deg", ("0.1°", "radians", "5.73")),
    "slope in rad, uphill": ({"scenario__angle_deg": -0.5236}, "scenarios[0].angle_deg", ("radians", "-30")),
    "step in ms": ({"simulation__time_step_s": 0.5}, "simulation.time_step_s", ("500 ms", "0.0005")),
    "gravity in cm": ({"simulation__gravity_mps2": 981.0}, "simulation.gravity_mps2", ("981", "9.81 m/s²")),
    "inertia in kg cm²": ({"body__inertia_kgm2": 7e5}, "body.inertia_kgm2", ("ten times",)),
    "foot heavier than body": ({"foot__mass_kg": 80.0}, "foot.mass_kg", ("80 kg", "68 kg")),
}


@pytest.mark.parametrize(("values", "key", "said"), SLIPS.values(), ids=SLIPS.keys())
def test_a_number_in_another_unit_is_remarked_on_with_the_value_in_both(values, key, said):
    about = [remark for remark in remarks_on(**values) if remark.startswith(key)]
    assert any(all(word in remark for word in said) for remark in about), about
    assert all(len(remark.splitlines()) == 1 for remark in about)


def test_a_wind_above_the_weight_and_a_violent_train_are_remarked_on():
    wind = changed(tomllib.loads(builtin_text("wind")), scenario__fx_n=600.0)
    assert any("scenarios[0].fx_n = 600 N" in remark for remark in remarks(Spec.model_validate(wind)))
    train = changed(tomllib.loads(builtin_text("train")), scenario__acceleration_mps2=[[0.0, 0.0], [1.0, 98.1]])
    found = [remark for remark in remarks(Spec.model_validate(train)) if "acceleration_mps2" in remark]
    assert len(found) == 1
    assert "98.1 m/s² (10 g)" in found[0]


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"scenario__angle_deg": 0.0},
        {"scenario__angle_deg": 1.0},
        {"scenario__angle_deg": -20.0},
        {"simulation__gravity_mps2": 1.62},
        {"simulation__time_step_s": 0.01},
        {"body__mass_kg": 120.0, "body__com_height_m": 1.2, "body__inertia_kgm2": 200.0},
        {
            "body__mass_kg": 12.0,
            "body__com_height_m": 0.45,
            "body__inertia_kgm2": 3.0,
            "foot__half_length_m": 0.06,
        },
    ],
    ids=["as it is", "level", "gentle", "uphill", "moon", "10 ms", "tall adult", "child"],
)
def test_a_plausible_number_is_not_remarked_on(values):
    assert remarks_on(**values) == []


# --strict


@pytest.mark.parametrize(
    ("wrong", "key"), [("com_height_m = 175", "body.com_height_m"), ("angle_deg = 0.1", "angle_deg")]
)
def test_a_remark_is_a_warning_and_with_strict_an_error(wrong, key, poise, tmp_path):
    path = tmp_path / "mine.toml"
    text = builtin_text("adult-slope")
    line = next(line for line in text.splitlines() if line.startswith(wrong.partition(" = ")[0]))
    path.write_text(text.replace(line, wrong), encoding="utf-8")
    code, out, err = poise("simulate", str(path))
    assert code == 0
    assert out
    assert err
    assert all(line.startswith(f"warning: {path}: ") for line in err)
    assert any(key in line for line in err)
    code, out, err = poise("simulate", str(path), "--strict")
    assert (code, out) == (2, "")
    assert len(err) == 1
    assert err[0].startswith(f"poise: {path}: ")
    assert err[0].endswith("(--strict)")


@pytest.mark.parametrize("command", ["report", "simulate", "synthesize"])
def test_strict_refuses_the_body_of_the_paper_in_every_command(command, poise):
    code, out, err = poise(command, "slope", "--strict")
    assert (code, out) == (2, "")
    assert len(err) == 1
    assert err[0].startswith("poise: slope: body.inertia_kgm2 = 7.03125: ")


def test_strict_accepts_a_body_that_can_exist(poise):
    code, out, err = poise("simulate", "adult-slope", "--strict")
    assert code == 0
    assert out
    assert err == []


def test_a_name_that_is_no_built_in_is_refused_with_those_there_are():
    with pytest.raises(
        BadInput, match=r"did you mean 'slope'\?; there are: adult-foot, adult-slope, everywhere, slope"
    ):
        builtin_text("slop")


def test_a_built_in_text_is_parsed_under_any_origin():
    assert parse(builtin_text("wind"), origin="elsewhere").origin == "elsewhere"
