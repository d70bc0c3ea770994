"""``poise study`` as its users meet it: what it prints, what it leaves behind, and one line for what it cannot do."""

import csv
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from design.spec.load import load

ROOT = Path(__file__).resolve().parents[1]
SHORT = {"ramp_s = 5.0": "ramp_s = 1.0", "angle_deg = 30.0": "angle_deg = 3.0", "duration_s = 10.0": "duration_s = 1.5"}
TEXT = load("slope").text
for long, short in SHORT.items():
    TEXT = TEXT.replace(long, short)
NOISY = TEXT + "\n[noise]\nangle_deg = 0.02\nrate_deg_per_s = 0.1\nforce_n = 2.0\n"


def _study(folder, *arguments, text=NOISY):
    spec = folder / "mine.toml"
    spec.write_text(text, encoding="utf-8")
    command = [sys.executable, str(ROOT / "cli.py"), "study", str(spec), "--jobs", "2", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    ended = _study(folder, "--controllers", "force,mpc,nmpc", "--trials", "3", "-o", str(folder / "out"))
    assert ended.returncode == 0, ended.stderr
    return folder / "out", ended.stdout


def test_a_study_leaves_its_trials_and_its_reports(done):
    folder, _ = done
    assert {path.name for path in folder.iterdir()} >= {
        "trials.jsonl", "trials.csv", "summary.json", "report.md", "report.html",
    }  # fmt: skip
    with (folder / "trials.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3 * 3 + 2 * 3
    assert {row["status"] for row in rows} <= {"kept", "lost", "found"}
    assert all(float(row["median_ms"]) > 0 for row in rows if row["trial"])


def test_the_text_fits_80_columns_and_names_every_controller(done):
    _, printed = done
    assert max(map(len, printed.splitlines())) <= 80
    assert re.search(r"^force .* \d/3 ", printed, re.MULTILINE)  # of so many trials it is the median time
    for name in ("force", "mpc", "nmpc"):
        assert re.search(rf"^{name} ", printed, re.MULTILINE)
    assert "95 % interval" in printed


def test_the_json_has_the_common_keys_and_those_of_a_study(done):
    folder, _ = done
    document = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assert (document["command"], document["status"], document["trials"]) == ("study", "complete", 3)
    assert {"name", "sha256"} <= document["spec"].keys()
    one = document["controllers"]["mpc"]
    for key in ("trials", "lost", "settling_s", "torque_rms_nm", "unsolved", "step_slope_deg"):
        assert key in one
    assert set(one["contact_force_n"]) == {"min", "median"}
    assert set(one["step_ms"]) == {"median", "p99", "max"}
    against = one["against"]["contact_force_n"]
    assert against["low"] <= against["mean"] <= against["high"]
    assert 0.9 < one["step_slope_share"] <= 1.0


def test_a_study_is_not_begun_over_another_and_a_finished_one_resumes_to_the_same(done):
    folder, printed = done
    same = ["--controllers", "force,mpc,nmpc", "--trials", "3", "-o", str(folder)]
    ended = _study(folder.parent, *same)
    assert (ended.returncode, ended.stdout) == (2, "")
    assert "--resume" in ended.stderr.splitlines()[-1]
    again = _study(folder.parent, *same, "--resume")
    assert again.returncode == 0
    assert again.stdout == printed
    other = _study(folder.parent, *same, "--resume", "--seed", "5")
    assert other.returncode == 2
    assert "seed" in other.stderr.splitlines()[-1]


def test_who_loses_contact_is_said_and_the_study_is_still_complete(tmp_path):
    steep = TEXT.replace("angle_deg = 3.0", "angle_deg = 30.0").replace("duration_s = 1.5", "duration_s = 2.0")
    ended = _study(tmp_path, "--controllers", "pd", "--trials", "2", "--format", "json", text=steep)
    assert ended.returncode == 0
    document = json.loads(ended.stdout)
    assert document["controllers"]["pd"]["lost"] == 2
    assert "neither noise nor uncertainty" in document["remark"]


BAD = {
    "unknown controller": (["--controllers", "pid"], "allowed: pd, force"),
    "no trials": (["--trials", "0"], "greater than or equal to 1"),
    "resume without a folder": (["--resume"], "-o FOLDER"),
    "no folder to be in": (["-o", "/no/such/place/study"], "cannot"),
    "no scheduler": (["--dask", "tcp://127.0.0.1:9"], "no scheduler answers"),
    "no address": (["--dask", "nonsense"], "--dask"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_line_and_exit_2(case, tmp_path):
    arguments, said = BAD[case]
    more = [] if "--controllers" in arguments else ["--controllers", "force"]
    ended = _study(tmp_path, *more, *arguments)
    assert (ended.returncode, ended.stdout) == (2, "")
    assert said in ended.stderr
    assert "Traceback" not in ended.stderr


SPECS = {
    "a negative deviation": ("[noise]\nangle_deg = -1.0", "noise.angle_deg"),
    "both kinds of a tolerance": ("[uncertainty]\nmass_kg = { percent = 1.0, absolute = 2.0 }", "uncertainty.mass_kg"),
    "a tolerance of 100 %": ("[uncertainty]\nmass_kg = { percent = 100.0 }", "uncertainty.mass_kg"),
    "a horizon of one": ("[mpc]\nhorizon = 1", "mpc.horizon"),
    "a weight of nothing": ("[mpc]\ntorque_weight = 0.0", "mpc.torque_weight"),
    "an unknown controller": ('[study]\ncontrollers = ["pid"]', "study.controllers"),
    "a delay between periods": ("[noise]\ndelay_s = 0.007", "noise.delay_s"),
    "a misspelt key": ("[mpc]\nhorizn = 20", "did you mean 'horizon'"),
    "a wider tolerance than the foot": ("[uncertainty]\nhalf_length_m = 0.2", "half_length_m"),
}


@pytest.mark.parametrize("case", SPECS)
def test_a_bad_table_is_one_line_that_names_the_key(case, tmp_path):
    table, said = SPECS[case]
    ended = _study(tmp_path, "--controllers", "force", "--trials", "1", text=TEXT + "\n" + table + "\n")
    assert (ended.returncode, ended.stdout) == (2, "")
    assert said in ended.stderr
    assert "Traceback" not in ended.stderr


def test_weights_are_the_defaults_where_they_are_not_to_be_tuned(tmp_path):
    ended = _study(tmp_path, "--controllers", "lqr", "--trials", "1", "--no-tune", "-o", str(tmp_path / "out"))
    assert "they were not tuned" in ended.stdout
    its = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))["tuning"]["weights"]["lqr"]
    assert (its["torque_weight"], its["rate_weight"], its["evaluations"]) == (0.0135, 0.02, 0)
    assert "--no-tune -o FOLDER" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


def test_a_controller_that_cannot_be_built_is_left_out_and_the_others_run(tmp_path):
    fast = TEXT.replace("[body]", "[study]\ncontrol_period_s = 0.5\n[body]")
    fast = fast.replace("com_height_m = 0.75", "com_height_m = 0.0005").replace(
        "inertia_kgm2 = 7.03125", "inertia_kgm2 = 1.3e-5"
    )
    ended = _study(tmp_path, "--controllers", "force,lqr", "--trials", "1", "--format", "json", text=fast)
    assert "falls" in json.loads(ended.stdout)["left_out"]["lqr"]


def test_controllers_of_the_spec_are_those_that_run(tmp_path):
    text = TEXT + '\n[study]\ncontrollers = ["cop", "mpc"]\ntrials = 1\n'
    ended = _study(tmp_path, "--format", "json", text=text)
    assert list(json.loads(ended.stdout)["controllers"]) == ["cop", "mpc"]
