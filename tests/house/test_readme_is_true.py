"""What the README shows is what the tool prints: words exactly, numbers to five digits."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")


def _blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def _assert_same(shown, printed):
    assert NUMBER.sub("#", shown).split() == NUMBER.sub("#", printed).split()
    pairs = zip(NUMBER.findall(shown), NUMBER.findall(printed), strict=True)
    for one, other in pairs:
        assert float(one) == pytest.approx(float(other), rel=2e-5, abs=1e-9)


def _run(*arguments):
    return subprocess.run([sys.executable, *arguments], cwd=ROOT, check=True, capture_output=True, text=True).stdout


def test_the_first_command_prints_what_is_shown():
    assert ".venv/bin/poise synthesize slope" in README
    _assert_same(_blocks("text")[0], _run("cli.py", "synthesize", "slope"))


def test_the_python_example_prints_what_is_shown():
    _assert_same(_blocks("text")[1], _run("-c", _blocks("python")[0]))


def test_every_command_shown_exists():
    listed = _run("cli.py", "--help")
    for line in _blocks("sh")[0].splitlines():
        assert re.search(rf"^  {line.split()[1]} ", listed, flags=re.MULTILINE), line
