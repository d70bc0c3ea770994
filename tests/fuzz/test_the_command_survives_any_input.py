"""Whatever the input, the command ends with one of its exit codes, in a few clean lines, soon, and in little memory."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

if not hasattr(os, "fork"):
    pytest.skip("each case is a fork", allow_module_level=True)

from tests.fuzz.cases import Case
from tests.fuzz.run import restored, stored

ROOT = Path(__file__).parents[2]
CORPUS = Path(__file__).with_name("corpus")


def _run(*arguments):
    """The lines that the fuzzer prints: in a process of its own, which has one thread and can be forked."""
    ended = subprocess.run(
        [sys.executable, "-m", "tests.fuzz.run", *arguments], cwd=ROOT, capture_output=True, text=True, timeout=500
    )
    assert ended.returncode == 0, ended.stderr
    return ended.stdout.splitlines()


def test_what_failed_once_is_sound():
    names = sorted(CORPUS.glob("*.json"))
    lines = _run("--again", *map(str, names))
    assert len(lines) == len(names)
    for line in lines:
        assert " [] " in line


@pytest.mark.slow
def test_cases_that_nobody_wrote_are_sound(tmp_path):
    *failed, summary = _run("--count", "150", "--seed", "2026", "--keep", str(tmp_path / "failures"))
    assert failed == []
    assert "'sound': 150" in summary


@pytest.mark.slow
@pytest.mark.parametrize(
    ("code", "word"),
    [
        ("1 / 0", "internal error"),
        ("import os; os._exit(139)", "exit code 139"),
        ("import sys; sys.stderr.write('a\\x1b[2Jb')", "control characters 0x1b"),
        ("import sys; sys.stderr.write('\\n' * 99)", "99 lines"),
        ("import numpy; numpy.ones(200_000_000)", "MB"),
        ("open('half.json', 'w').write('{')", "leaves 'half.json'"),
    ],
)
def test_the_judgement_sees_what_is_wrong(code, word, tmp_path):
    """The same fork with a fault in the command."""
    case = Case(files={}, arguments=("explain", "torque"))
    place = tmp_path / "case.json"
    place.write_text(stored(case))
    assert restored(place.read_text()) == case
    fault = (
        "import sys; sys.argv = ['run', '--again', sys.argv[1]]; from tests.fuzz import run; run.load();"
        f"from design.present import explain; explain.explain = lambda row: exec({code!r}) or ''; run.main()"
    )
    ended = subprocess.run(
        [sys.executable, "-c", fault, str(place)], cwd=ROOT, capture_output=True, text=True, timeout=100
    )
    assert word in ended.stdout


def test_cases_are_kept_as_they_are(tmp_path):
    for path in CORPUS.glob("*.json"):
        assert json.loads(stored(restored(path.read_text()))) == json.loads(path.read_text())
