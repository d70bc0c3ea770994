"""`poise prove` and `poise report --prove`: three answers, their exit codes, and nothing in between."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

CLI = Path(__file__).resolve().parents[1] / "cli.py"
BOX = "\n[uncertainty]\nmass_kg = { percent = 1 }\nslope_deg = 0.5\nhalf_length_m = { percent = 1 }\n"


def _poise(*arguments, text=None):
    return subprocess.run(
        [sys.executable, str(CLI), *map(str, arguments)], capture_output=True, text=True, check=False, input=text
    )


def _spec(name="slope", more=""):
    return _poise("init", name).stdout + more


def test_a_box_is_proved_and_the_document_says_which():
    ran = _poise("prove", "-", "--gains", "3500,606.2,5.61", "--format", "json", text=_spec(more=BOX))
    assert ran.returncode == 0, ran.stderr
    data = json.loads(ran.stdout)
    assert (data["command"], data["verdict"]) == ("prove", "proved")
    rows = {row["id"]: row for row in data["rows"]}
    assert {"toe-force", "heel-force", "cop-margin", "routh", "decay-rate"} <= set(rows)
    assert all(row["basis"] == "proved" and row["status"] == "met" for row in rows.values())
    assert 100 < rows["heel-force"]["value"] < 180
    box = data["scenarios"][0]["box"]
    assert box["mass"] == {"from": pytest.approx(49.5), "to": pytest.approx(50.5), "unit": "kg"}
    assert box["slope"]["to"] == pytest.approx(30.5)
    assert data["scenarios"][0]["share_of_box"] == 1.0


def test_what_is_broken_is_disproved_with_its_instant():
    ran = _poise("prove", "slope", "--law", "pd")
    assert ran.returncode == 1
    assert "DISPROVED: heel-force" in ran.stdout
    assert "at 1.176 s" in ran.stdout


def test_every_law_is_proved():
    ran = _poise("prove", "slope", "--law", "cop", "--format", "json")
    assert ran.returncode == 0
    assert {row["id"]: row["value"] for row in json.loads(ran.stdout)["rows"]}["heel-force"] > 47.3
    adapting = _spec().replace("[law]", "[law]\nadapt_s = 0.1", 1)
    ran = _poise("prove", "-", "--format", "json", text=adapting)
    assert ran.returncode == 0
    assert {row["id"]: row["value"] for row in json.loads(ran.stdout)["rows"]}["toe-force"] > 149.3


def test_what_cannot_be_decided_is_unknown():
    wide = "\n[uncertainty]\nslope_deg = 2\nmass_kg = { percent = 5 }\nhalf_length_m = { percent = 5 }\n"
    ran = _poise("prove", "-", "--gains", "3500,606.2,5.61", "--law", "cop", "--time-limit", "1", text=_spec(more=wide))
    assert ran.returncode == 3, ran.stdout
    assert "UNKNOWN" in ran.stdout
    assert "PROVED " not in ran.stdout.replace("UNPROVED", "")


def test_a_box_that_is_too_large_says_how_much_of_it_is_proved_or_breaks_it():
    large = "\n[uncertainty]\nmass_kg = { percent = 30 }\ncom_height_m = { percent = 30 }\n"
    ran = _poise("prove", "-", "--format", "json", "--time-limit", "5", text=_spec(more=large))
    data = json.loads(ran.stdout)
    assert data["verdict"] in ("disproved", "unknown")
    assert ran.returncode == {"disproved": 1, "unknown": 3}[data["verdict"]]
    assert data["scenarios"][0]["why"]
    assert _poise("prove", "-", "--scale", "0", text=_spec(more=large)).returncode == 0


def test_a_report_proves_on_demand():
    ran = _poise("report", "slope", "--prove", "--format", "json")
    assert ran.returncode == 0
    data = json.loads(ran.stdout)
    basis = {row["id"]: row["basis"] for row in data["rows"]}
    assert basis["heel-force"] == basis["routh"] == "proved"
    assert basis["torque"] == "sampled"


def test_what_a_body_of_the_box_breaks_is_broken_in_the_report():
    wide = "\n[uncertainty]\nslope_deg = 8\n"
    assert _poise("report", "-", text=_spec("slope", wide)).returncode == 0
    ran = _poise("report", "-", "--prove", "--format", "json", text=_spec("slope", wide))
    assert ran.returncode == 1, ran.stderr
    row = next(row for row in json.loads(ran.stdout)["rows"] if row["id"] == "heel-force")
    assert row["status"] == "violated"
    assert row["value"] < 0
    assert "break it" in row["note"]


def test_a_certificate_is_confirmed_for_its_spec_and_refused_for_another_or_when_tampered_with(tmp_path):
    file = tmp_path / "proof.json"
    assert _poise("prove", "slope-step", "--certificate", file).returncode == 0
    confirmed = _poise("check", file, "slope-step")
    assert confirmed.returncode == 0
    assert confirmed.stdout.splitlines()[-1].startswith("CONFIRMED")
    other = _poise("check", file, "slope")
    assert other.returncode == 1
    assert "REFUSED" in other.stdout
    assert _poise("prove", "slope-step", "--gains", "3500,1000,1", "--certificate", file).returncode == 0
    less = _poise("check", file, "slope-step")
    assert less.returncode == 3
    assert "CONFIRMED" not in less.stdout
    assert "missing: the law and gains of the spec" in less.stdout
    assert _poise("check", file, "slope-step", "--partial").returncode == 0
    document = json.loads(file.read_text(encoding="utf-8"))
    document["law"]["kp"] *= 0.9
    file.write_text(json.dumps(document), encoding="utf-8")
    assert _poise("check", file).returncode == 1
    assert _poise("check", CLI).returncode == 2


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("prove", "nothing.toml"), "nothing.toml"),
        (("prove", "slope", "--scenario", "rampe"), "ramp"),
        (("prove", "slope", "--scale", "-1"), "scale"),
        (("prove", "slope", "--law", "cop", "--certificate", "proof.json"), "certificates are for laws pd and force"),
        (("prove", "slope", "-o", "/nowhere/at/all.json"), "all.json"),
    ],
)
def test_bad_input_is_one_line(arguments, said):
    ran = _poise(*arguments)
    assert ran.returncode == 2
    assert said in ran.stderr
    assert "Traceback" not in ran.stderr


@pytest.mark.parametrize("command", ["simulate", "prove", "report"])
def test_a_ramp_that_may_take_no_time_or_less_is_refused(command):
    for width in (5.0, 7.0):
        ran = _poise(command, "-", text=_spec(more=f"\n[uncertainty]\nramp_s = {width}\n"))
        assert ran.returncode == 2
        assert "uncertainty.ramp_s: lets the ramp of scenario 'ramp' last from" in ran.stderr


@pytest.mark.parametrize("command", ["simulate", "report", "prove"])
def test_a_step_that_is_too_coarse_for_the_fastest_pole_is_said_and_is_no_fall(command):
    stiff = _spec("slope").replace("kp = 3500.0", "kp = 1e6").replace("kd = 1200.0", "kd = 1e5")
    ran = _poise(command, "-", text=stiff)
    assert "fall" not in ran.stdout.lower()
    if command != "prove":
        assert "too coarse for a pole at" in " ".join(ran.stdout.split())
