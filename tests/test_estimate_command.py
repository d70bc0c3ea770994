"""`poise estimate` and `poise report --record`: a trial of our own simulation comes back as what it was."""

import csv
import io
import json
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import cli
from design.model.environment import profile
from design.present.recording_spec import averaged, toml
from design.present.text import COLUMNS
from design.spec.load import builtin_text, load
from design.spec.setting import setting

DATA = Path(__file__).parents[1].parent / "shared" / "data"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason=f"the recordings are not at {DATA}")


@pytest.fixture
def poise(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)

    def run(*arguments, code=0):
        monkeypatch.setattr(sys, "argv", ["poise", *map(str, arguments)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            cli.main()
        out = capsys.readouterr()
        assert ended.value.code == code, out.err
        return out if code else out.out

    return run


@pytest.fixture
def simulated(poise):
    """The samples of a simulated run of a spec, by column, and the file that holds them."""

    def run(spec, *more):
        poise("simulate", spec, *more, "--format", "csv", "-o", f"{spec}.csv")
        table = np.genfromtxt(f"{spec}.csv", delimiter=",", names=True)
        return table, f"{spec}.csv"

    return run


@pytest.mark.parametrize(
    ("spec", "more", "most"),
    [("slope", (), 0.1), ("adult-slope", (), 0.2), ("adult-foot", (), 0.1), ("wind", ("--scenario", "breeze"), 0.5)],
)
def test_the_force_of_a_simulated_run_is_found_again(poise, simulated, spec, more, most):
    if spec == "wind":
        names = [scenario.name for scenario in load("wind").spec.scenarios]
        more = ("--scenario", names[0])
    true, file = simulated(spec, *more)
    found = json.loads(poise("estimate", file, "--spec", spec, "--format", "json"))
    assert found["status"] == "estimated"
    assert found["samples"] == len(true)
    assert found["dropouts"] == 0
    assert found["toe_force_n"]["min"] == pytest.approx(true["toe_force_n"].min())
    assert found["heel_force_n"]["min"] == pytest.approx(true["heel_force_n"].min())
    assert found["cop_m"]["max"] == pytest.approx(true["cop_m"].max())
    rows = list(csv.DictReader(io.StringIO(poise("estimate", file, "--spec", spec, "--format", "csv"))))
    assert {"time_s", "toe_force_n", "heel_force_n", "cop_m", "fx_estimate_n", "fy_estimate_n", "valid"} <= set(rows[0])
    late = true["time_s"] > 0.2
    for axis in "xy":
        estimate = np.array([float(row[f"f{axis}_estimate_n"] or "nan") for row in rows])
        assert np.abs(estimate - true[f"f{axis}_n"])[late].max() < most


def test_a_measured_force_becomes_a_scenario_that_repeats_the_run(poise, simulated):
    true, file = simulated("slope")
    poise("estimate", file, "--spec", "slope", "--as-spec", "measured.toml", "--every", "0.02")
    source = load("measured.toml")
    scenario = setting(source.spec).scenarios[0]
    assert scenario.kind == "profile"
    assert scenario.duration == pytest.approx(true["time_s"][-1])
    points = np.array(source.spec.scenarios[0].points)
    assert points[0, 0] == 0.0
    assert np.abs(np.interp(points[:, 0], true["time_s"], true["fx_n"]) - points[:, 1]).max() < 0.5
    assert np.abs(np.interp(points[:, 0], true["time_s"], true["fy_n"]) - points[:, 2]).max() < 0.5
    again = json.loads(poise("simulate", "measured.toml", "--format", "json"))["scenarios"][0]
    assert again["heel_force_n"]["min"] == pytest.approx(true["heel_force_n"].min(), abs=0.5)
    assert again["toe_force_n"]["min"] == pytest.approx(true["toe_force_n"].min(), abs=0.5)


def test_gains_are_found_against_a_measured_force(poise, simulated):
    _, file = simulated("slope")
    poise("estimate", file, "--spec", "slope", "--as-spec", "measured.toml", "--every", "0.1")
    found = json.loads(poise("synthesize", "measured.toml", "--starts", "1", "--format", "json"))
    assert found["status"] == "solved"
    assert found["objective"]["value"] == pytest.approx(190.99, abs=3)  # of the run itself


def test_the_contact_rows_of_a_recording_are_those_of_the_run(poise, simulated):
    _, file = simulated("slope")
    run = json.loads(poise("report", "slope", "--format", "json"))
    measured = json.loads(poise("report", "slope", "--record", file, "--format", "json"))
    assert measured["gains"] is None
    assert measured["record"]["valid_samples"] == 10001
    theirs = {row["id"]: row for row in run["rows"]}
    ours = {row["id"]: row for row in measured["rows"]}
    assert set(ours) == {"toe-force", "heel-force", "cop-margin", "torque"}
    for name, row in ours.items():
        assert row["basis"] == "measured"
        assert row["value"] == pytest.approx(theirs[name]["value"])
        assert row["time_s"] == pytest.approx(theirs[name]["time_s"])
        assert row["status"] == theirs[name]["status"]


def test_a_broken_requirement_of_a_recording_ends_with_one(poise, simulated):
    _, file = simulated("slope")
    Path("hard.toml").write_text(builtin_text("slope").replace("contact_force_n = 0.0", "contact_force_n = 100.0"))
    out = poise("report", "hard.toml", "--record", file, code=1).out
    assert "BROKEN heel-force" in out
    assert "left out" in out
    for form, mark in (
        ("md", "measured"),
        ("junit", "<failure"),
        ("html", "measured: slope.csv"),
        ("json", '"record"'),
    ):
        assert mark in poise("report", "hard.toml", "--record", file, "--format", form, code=1).out
    page = poise("report", "hard.toml", "--record", file, "--format", "html", code=1).out
    assert "Root locus" not in page
    assert "<svg" in page


def test_dropouts_stand_in_the_report_and_never_count(poise, simulated):
    _, file = simulated("slope")
    lines = Path(file).read_text().splitlines()
    for k in (500, 501, 9000):
        lines[k] = lines[k].split(",")[0] + ",0,0,0,0,0,0,0,0,0,0,0"
    Path("dropped.csv").write_text("\n".join(lines))
    rows = json.loads(poise("report", "slope", "--record", "dropped.csv", "--format", "json"))["rows"]
    heel = next(row for row in rows if row["id"] == "heel-force")
    assert heel["value"] == pytest.approx(29.5417, abs=1e-3)
    assert heel["note"] == "3 drop-outs masked"
    found = json.loads(poise("estimate", "dropped.csv", "--spec", "slope", "--format", "json"))
    assert found["dropouts"] == 3
    assert found["dropout_spans_s"] == [[0.499, 0.5], [8.999, 8.999]]
    said = poise("estimate", "dropped.csv", "--spec", "slope", "--as-spec", "o.toml")
    assert "3 rows without load" in said
    assert "2 gaps bridged" in Path("o.toml").read_text()
    load("o.toml")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("estimate", "."), "is a directory"),
        (("estimate", "nothing.csv"), "no such file"),
        (("estimate", "slope.csv", "--every", "1"), "--as-spec"),
        (("estimate", "slope.csv", "--as-spec", "o.toml", "--every", "0"), "--every"),
        (("estimate", "slope.csv", "--plot", "o.bmp"), ".png"),
        (("estimate", "slope.csv", "--spec", "nothing"), "no such file or built-in"),
        (("estimate", "slope.csv", "--spec", "adult-slope", "--strict"), "--strict"),
        (("report", "slope", "--up", "z"), "--record"),
        (("report", "slope", "--record", "slope.csv", "--gains", "1,2,3"), "--gains"),
        (("report", "slope", "--record", "slope.csv", "--against", "slope"), "--against"),
    ],
)
def test_wrong_usage_ends_with_two_and_one_line(poise, simulated, arguments, said):
    simulated("slope")
    err = poise(*arguments, code=2).err
    faults = [line for line in err.splitlines() if not line.startswith("warning: ")]
    assert len(faults) == 1
    assert said in faults[0]
    assert not Path("o.toml").exists()


def test_two_scenarios_in_a_file_are_refused(poise):
    poise("simulate", "wind", "--format", "csv", "-o", "wind.csv")
    if len(load("wind").spec.scenarios) > 1:
        assert "more than one trial" in poise("estimate", "wind.csv", "--spec", "wind", code=2).err


def test_our_own_output_can_be_read_again(poise, simulated):
    _, file = simulated("slope")
    first = json.loads(poise("estimate", file, "--spec", "slope", "--format", "json"))
    poise("estimate", file, "--spec", "slope", "--format", "csv", "-o", "again.csv")
    second = json.loads(poise("estimate", "again.csv", "--spec", "slope", "--format", "json"))
    for key in ("mean_vertical_force_n", "toe_force_n", "cop_m", "fx_n"):
        assert second[key] == first[key]


@needs_data
@pytest.mark.parametrize(
    "name", ["pds13_or1_grf.txt", "bds00001.txt", "amti_dropouts.csv", "bmc_posture_cog_ankles.csv"]
)
def test_every_form_of_a_real_recording_is_written(poise, name):
    said = poise("estimate", DATA / name, "--plot", "trial.png")
    assert Path("trial.png").read_bytes().startswith(b"\x89PNG")
    assert max(map(len, said.splitlines())) < 80 or str(DATA / name) in said
    found = json.loads(poise("estimate", DATA / name, "--format", "json"))
    rows = list(csv.DictReader(io.StringIO(poise("estimate", DATA / name, "--format", "csv"))))
    assert len(rows) == found["samples"]
    assert sum(row["valid"] == "1" for row in rows) == found["valid_samples"]
    if name.startswith("bmc"):
        assert found["fx_n"] is None
        assert found["toe_force_n"] is None
        assert "no contact force" in found["fx_method"]
    else:
        assert found["toe_force_n"]["mean"] == pytest.approx(found["mean_vertical_force_n"] / 2, rel=1e-4)
        poise("estimate", DATA / name, "--as-spec", "trial.toml", "--every", "0.5")
        assert "CONTACT" not in poise("simulate", "trial.toml")


def test_a_hole_in_the_measured_force_is_bridged_in_the_scenario(poise, simulated):
    true, file = simulated("slope")
    lines = Path(file).read_text().splitlines()
    for k in range(3000, 3601):
        lines[k] = lines[k].split(",")[0] + ",,,,,,,,,,,"
    Path("holed.csv").write_text("\n".join(lines))
    assert "line 3001, column" in poise("estimate", "holed.csv", "--spec", "slope", code=2).err
    poise("estimate", "holed.csv", "--spec", "slope", "--allow-gaps", "--as-spec", "o.toml")
    points = np.array(load("o.toml").spec.scenarios[0].points)
    assert np.abs(np.interp(points[:, 0], true["time_s"], true["fx_n"]) - points[:, 1]).max() < 1


def test_means_between_points_keep_a_straight_line_and_bridge_holes():
    t = np.arange(1001) / 1000
    line = np.vstack([3 * t - 1, 0 * t + 2])
    valid = np.ones(1001, dtype=bool)
    valid[300:420] = False
    holed = np.where(valid, line, np.nan)
    times, points = averaged(t, holed, valid, 0.07)
    assert times[0] == 0
    assert times[-1] == 1
    assert points[0] == pytest.approx(3 * times - 1, abs=2e-3)
    assert points[1] == pytest.approx(2.0)


def test_a_spec_survives_being_written():
    for name in ("slope", "adult-slope", "wind", "train"):
        data = load(name).spec.model_dump(mode="json", exclude_unset=True)
        assert tomllib.loads(toml(data)) == data


def test_columns_of_our_runs_are_known_but_the_true_force_is_not_taken_for_a_plates(poise, simulated):
    _, file = simulated("slope")
    taken = json.loads(poise("estimate", file, "--spec", "slope", "--format", "json"))["columns"]
    assert set(taken) == {"time", "angle", "rate", "toe", "heel", "torque", "cop"}
    assert "fx_n" in COLUMNS
    assert profile(name="x", points=np.zeros((1, 3)), duration=1.0).kind == "profile"


def _plate(path, angle=None, count=600):
    t = np.arange(count) / 100
    cop, load = 0.04 + 0.01 * np.sin(2 * t), 790 + 2 * np.cos(5 * t)
    names, columns = ["time [s]", "Fz [N]", "COPx [m]"], [t, load, cop]
    if angle is not None:
        names, columns = [*names, "angle [deg]"], [*columns, angle + 0.2 * np.sin(2 * t)]
    rows = "".join(",".join(f"{x:.6f}" for x in row) + "\n" for row in zip(*columns, strict=True))
    Path(path).write_text(",".join(names) + "\n" + rows)


def test_no_horizontal_force_follows_from_an_angle_where_the_ankle_is_assumed(poise):
    _plate("trial.csv", angle=3.0)
    found = json.loads(poise("estimate", "trial.csv", "--format", "json"))
    assert found["fx_n"] is None
    assert found["fx_static_n"] is None
    assert found["estimate_error_n"]["fx_spread"] is None
    assert found["fy_n"] is not None
    assert "needs --ankle" in found["fx_method"]
    assert any("height" in said and "inertia" in said for said in found["assumed"])
    said = poise("estimate", "trial.csv")
    assert "0 N by the body" not in said
    assert "tolerances: none given" in " ".join(said.split())
    assert "needs --ankle" in poise("estimate", "trial.csv", "--as-spec", "o.toml", code=2).err
    told = json.loads(poise("estimate", "trial.csv", "--ankle", "0.0", "--spec", "adult-slope", "--format", "json"))
    assert told["fx_n"] is not None
    assert not any("inertia" in said for said in told["assumed"])


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("-o", "trial.csv"), "the recording itself"),
        (("-o", "./link.csv"), "the recording itself"),
        (("-o", "body.toml", "--spec", "body.toml"), "the spec"),
        (("--plot", "a.png", "-o", "sub/../a.png"), "--plot too"),
        (("--as-spec", "trial.csv"), "the recording itself"),
        (("--as-spec", "a.toml", "-o", "a.toml"), "--as-spec too"),
    ],
)
def test_a_file_that_is_read_is_never_written_and_none_is_written_twice(poise, options, said):
    _plate("trial.csv")
    Path("link.csv").symlink_to("trial.csv")
    Path("sub").mkdir()
    Path("body.toml").write_text(builtin_text("adult-slope"))
    before = {path: path.read_bytes() for path in Path().iterdir() if path.is_file()}
    assert said in poise("estimate", "trial.csv", "--format", "csv", *options, code=2).err
    assert {path: path.read_bytes() for path in Path().iterdir() if path.is_file()} == before
    assert "would be lost" in poise("report", "slope", "--record", "trial.csv", "-o", "trial.csv", code=2).err
    assert {path: path.read_bytes() for path in Path().iterdir() if path.is_file()} == before


def test_the_spec_of_a_recording_is_named_after_it_and_carries_its_warnings(poise):
    _plate("_tïme 1.csv", angle=3.0)
    heavy = builtin_text("adult-slope").replace("mass_kg = ", "mass_kg = 100.0  # ", 1)
    Path("heavy.toml").write_text(heavy)
    poise("estimate", "_tïme 1.csv", "--spec", "heavy.toml", "--ankle", "0.04", "--as-spec", "o.toml")
    assert load("o.toml").spec.name == "t-me 1"
    head = [line for line in Path("o.toml").read_text().splitlines() if line.startswith("#")]
    assert any("WARNING" in line and "is it this body's recording?" in line for line in head)
    poise("estimate", "_tïme 1.csv", "--ankle", "0.04", "--as-spec", "o.toml")
    said = Path("o.toml").read_text()
    assert "which nobody gave" in said
    assert "# assumed: height" in said


def test_the_scenario_of_a_recording_has_the_sign_of_the_force_on_the_body(poise):
    t = np.arange(1200) / 100
    cop = 0.04 + 0.01 * np.sin(2 * np.pi * 0.9 * t) + 0.004 * np.sin(2 * np.pi * 2.1 * t)
    points = {}
    for sign in (1, -1):
        columns = [t, 790 + 0 * t, cop, sign * 300 * (cop - 0.04)]
        rows = "".join(",".join(f"{x:.6f}" for x in row) + "\n" for row in zip(*columns, strict=True))
        Path("trial.csv").write_text("time [s],Fz [N],COPx [m],Fx [N]\n" + rows)
        poise("estimate", "trial.csv", "--as-spec", "o.toml")
        points[sign] = np.array(load("o.toml").spec.scenarios[0].points)
    assert points[1] == pytest.approx(points[-1])
    assert np.interp(points[1][:, 0], t, cop - 0.04) * 300 == pytest.approx(points[1][:, 1], abs=0.5)


def test_levers_of_the_foot_share_the_load_out(poise):
    from design.analysis.simulate import simulate
    from design.spec.setting import setting

    its = setting(load("adult-foot").spec)
    run = simulate(its.loop(), its.scenarios[0], its.given_gains(), 5e-3)
    columns = np.column_stack([run.t, run.F_T + run.F_H, run.P, run.theta, run.tau])
    np.savetxt("plate.csv", columns, delimiter=",", header="time_s,fz_n,cop_m,theta_rad,torque_nm", comments="")
    read = ("--ankle", "0", "--columns", "time=time_s:s,fz=fz_n:N,cop=cop_m:m,angle=theta_rad:rad,torque=torque_nm:Nm")
    found = json.loads(poise("estimate", "plate.csv", "--spec", "adult-foot", *read, "--format", "json"))
    assert found["toe_force_n"]["min"] == pytest.approx(run.F_T.min(), rel=1e-6)
    assert found["heel_force_n"]["min"] == pytest.approx(run.F_H.min(), rel=1e-6)
    report = json.loads(poise("report", "adult-foot", "--record", "plate.csv", *read, "--format", "json"))
    rows = {row["id"]: row["value"] for row in report["rows"]}
    assert rows["cop-margin"] == pytest.approx(min((0.18 - run.P).min(), (0.06 + run.P).min()), rel=1e-6)
