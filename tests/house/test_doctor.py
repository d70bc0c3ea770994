"""`poise doctor` says what Poise runs on, old packages are refused in one line, and a bug report names no folder."""

import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

from design.errors import BadInput
from design.present import doctor

ROOT = Path(__file__).resolve().parents[2]
POISE = [sys.executable, "-W", "ignore", str(ROOT / "cli.py")]


def test_doctor_prints_every_requirement_and_a_self_test_that_is_right():
    done = subprocess.run([*POISE, "doctor"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    assert "29.5417 N on the heel" in done.stdout
    for name in ("casadi", "numpy", "clarabel", "matplotlib", "scipy", "pydantic"):
        assert metadata.version(name) in done.stdout


@pytest.mark.parametrize(("line", "message"), [
    ("casadi>=99.0", r"casadi: is .*; Poise needs at least 99.0"),
    ("no-such-package>=1.0", r"no-such-package: is missing"),
])  # fmt: skip
def test_a_package_that_is_missing_or_too_old_is_one_line(monkeypatch, line, message):
    monkeypatch.setattr(doctor.metadata, "requires", lambda _: [line, 'other>=99; extra == "test"'])
    with pytest.raises(BadInput, match=message):
        doctor.check_versions()


@pytest.mark.parametrize(("installed", "least", "met"), [
    ("3.10", "3.9", True), ("3.7.0", "3.7", True), ("3.6.9", "3.7", False), ("1.16.0rc1", "1.16", True),
])  # fmt: skip
def test_versions_are_compared_by_number(installed, least, met):
    assert doctor.Requirement("package", least, installed).met is met


def test_a_bug_report_names_no_folder(tmp_path):
    spec = tmp_path / "secret project" / "mine.toml"
    try:
        Path(spec).read_text(encoding="utf-8")
    except OSError as error:
        report = doctor.bug_report(error, ["report", str(spec)])
    assert "mine.toml" in report
    assert "test_doctor.py" in report
    assert str(tmp_path) not in report
    assert str(ROOT) not in report
    assert str(Path(sys.prefix)) not in report
