"""Every way in which the command ends: its exit code, what it prints where, and what it leaves behind."""

import csv
import hashlib
import io
import json
import math
import os
import re
import signal
import stat
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

import cli
from design.present.store import dumps
from design.present.text import COLUMNS
from design.spec.load import builtin_text

ROOT = Path(cli.__file__).resolve().parent
SLOPE = builtin_text("slope")
ADULT = builtin_text("adult-slope")
COMMANDS = sorted(command.name or command.callback.__name__ for command in cli.app.registered_commands)
READERS = ("simulate", "synthesize", "report")
TRAIN = builtin_text("train").replace("duration_s = 12.0", "duration_s = 2.0")
SHORT = ADULT.replace("duration_s = 12.0", "duration_s = 1.0")
LAW = SLOPE[SLOPE.index("[law]") : SLOPE.index("[requirements]")]


def put(text, **values):
    """``text`` with ``key = value`` in place of what the first line of that key says."""
    for key, value in values.items():
        text, count = re.subn(rf"(?m)^{key} = .*$", lambda _: f"{key} = {value}", text, count=1)  # noqa: B023
        assert count == 1
    return text


@dataclass(frozen=True)
class Ended:
    """How a run of the command ended."""

    code: int
    out: str
    err: str

    @property
    def faults(self):
        """Lines of standard error other than warnings."""
        return [line for line in self.err.splitlines() if not line.startswith("warning: ")]

    @property
    def json(self):
        """The result as strict JSON."""
        return strict_json(self.out)


def strict_json(text):
    def refuse(name):
        raise AssertionError(f"{name} is no JSON")

    return json.loads(text, parse_constant=refuse)


@pytest.fixture
def poise(monkeypatch, capsys, tmp_path):
    """Run the command in an empty folder, in this process."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments, given=None):
        monkeypatch.setattr(sys, "argv", ["poise", *map(str, arguments)])
        if given is not None:
            monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(given), encoding="utf-8"))
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            cli.main()
        out, err = capsys.readouterr()
        return Ended(ended.value.code or 0, out, err)

    return run


def process(*arguments, code=None, timeout=60, **options):
    """Run the command in a process of its own; ``code`` instead of the script."""
    start = [sys.executable, "-c", code] if code else [sys.executable, str(ROOT / "cli.py")]
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **options}
    done = subprocess.run(
        [*start, *map(str, arguments)], text=True, encoding="utf-8", timeout=timeout, check=False, **options
    )
    return Ended(done.returncode, done.stdout or "", done.stderr or "")


def snapshot(folder):
    """Every file of ``folder`` with its bytes."""
    return {path.name: path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


def assert_refused(ended, *words):
    """Exit code 2, nothing on standard output, and one line on standard error with ``words`` in it."""
    assert ended.code == 2
    assert ended.out == ""
    assert len(ended.faults) == 1, ended.err
    assert ended.faults[0].startswith("poise: ")
    assert "internal error" not in ended.err
    assert "Traceback" not in ended.err
    for word in words:
        assert word in ended.faults[0]


# Bad specs

BAD_SPECS = {
    "not toml": ("name = = 1\n", ("mine.toml", "not valid TOML", "line 1, column 8")),
    "empty": ("", ("mine.toml", "is empty", "[body]")),
    "unknown key": (put(SLOPE, com_height_m="1\nmas = 1"), ("mine.toml: body.mas", "did you mean 'mass_kg'")),
    "nan": (put(SLOPE, mass_kg="nan"), ("mine.toml: body.mass_kg", "needs a finite number")),
    "quoted": (put(SLOPE, mass_kg='"80"'), ("mine.toml: body.mass_kg", "without quotes")),
    "no mass": (put(SLOPE, mass_kg="0"), ("mine.toml: body.mass_kg", "needs >= 0.001")),
    "newer": (put(SLOPE, schema_version="2"), ("mine.toml: schema_version", "this Poise reads 1")),
    "no table": (SLOPE.replace(LAW, ""), ("mine.toml: law", "is missing")),
    "reversed bounds": (put(SLOPE.replace("kp = [0.0, 3500.0]", "kp = [9.0, 1.0]")), ("bounds", "kp = [9.0, 1.0]")),
    "deep": ("x = " + "[" * 9000, ("mine.toml", "nested too deeply")),
    "huge integer": (put(SLOPE, mass_kg="9" * 5000), ("mine.toml", "digits")),
}


@pytest.mark.parametrize("command", READERS)
@pytest.mark.parametrize(("text", "words"), BAD_SPECS.values(), ids=BAD_SPECS.keys())
def test_a_bad_spec_ends_every_command_in_one_line(command, text, words, poise, tmp_path):
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    before = snapshot(tmp_path)
    ended = poise(command, "mine.toml", "-o", "result.json")
    assert_refused(ended, *words)
    assert snapshot(tmp_path) == before


@pytest.mark.parametrize("command", READERS)
@pytest.mark.parametrize(
    "name", ["missing.toml", "missing.json", "folder", "folder.json", "slop", "no/such.toml", "x" * 5000]
)
def test_a_spec_that_is_not_there_ends_every_command_in_one_line(command, name, poise, tmp_path):
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder.json").mkdir()
    before = snapshot(tmp_path)
    assert_refused(poise(command, name, "-o", "result.json"), name)
    assert snapshot(tmp_path) == before


def test_text_that_is_not_utf8_ends_in_one_line(poise, tmp_path):
    (tmp_path / "mine.toml").write_bytes(b"name = '\xff'")
    assert_refused(poise("report", "mine.toml"), "mine.toml", "UTF-8")


def test_a_spec_is_read_from_standard_input(poise):
    assert poise("simulate", "-", given=ADULT.encode()).out == poise("simulate", "adult-slope").out
    assert_refused(poise("simulate", "-", given=b"name = \n"), "standard input", "not valid TOML")


def test_standard_input_that_is_not_utf8_ends_in_one_line(poise):
    assert_refused(poise("simulate", "-", given=ADULT.encode() + b"# \xff\n"), "standard input", "UTF-8")


def test_standard_input_that_is_not_utf8_ends_in_one_line_in_the_c_locale_too(tmp_path):
    (tmp_path / "mine.toml").write_bytes(ADULT.encode() + b"# \xff\n")
    with (tmp_path / "mine.toml").open("rb") as given:
        ended = process("simulate", "-", "--format", "json", stdin=given, env={**os.environ, "LC_ALL": "C"})
    assert_refused(ended, "standard input", "UTF-8")


@pytest.mark.parametrize("command", READERS)
def test_a_spec_without_what_the_command_needs_says_which_key(command, poise, tmp_path):
    bare = re.sub(r"(?ms)^\[synthesis\]\n.*?(?=^\[simulation)", "", re.sub(r"(?m)^k[pdf] = \d.*\n", "", SLOPE))
    (tmp_path / "mine.toml").write_text(bare, encoding="utf-8")
    assert_refused(poise(command, "mine.toml"), "synthesis.bounds" if command == "synthesize" else "law.kp")


# Bad options


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("report", "slope", "--gains", "1"), ("--gains", "'1'", "three numbers")),
        (("report", "slope", "--gains", ""), ("--gains", "three numbers")),
        (("report", "slope", "--gains", "1,2,3,4"), ("--gains", "three numbers")),
        (("report", "slope", "--gains", "1,x,3"), ("--gains", "1,x,3", "three numbers")),
        (("report", "slope", "--gains", "nan,1,1"), ("--gains", "nan,1,1", "from 0")),
        (("report", "slope", "--gains", "inf,1,1"), ("--gains", "inf,1,1", "1e9")),
        (("report", "slope", "--gains", "-1,1,1"), ("--gains", "-1,1,1", "from 0")),
        (("simulate", "train.toml", "--scenario", "nosuch"), ("--scenario", "'nosuch'", "start")),
        (("simulate", "train.toml", "--plot", "run.bmp"), ("run.bmp", ".png, .svg, .pdf")),
        (("simulate", "train.toml", "--plot", "run"), ("run", ".png, .svg, .pdf")),
        (("simulate", "train.toml", "--plot", "no/such/run.png"), ("no/such/run.png", "cannot be written")),
        (("simulate", "train.toml", "-o", "no/such/run.txt"), ("no/such/run.txt", "cannot be written")),
        (("simulate", "train.toml", "-o", "."), (".", "cannot be written")),
        (("simulate", "train.toml", "-o", "folder"), ("folder", "cannot be written")),
        (("simulate", "train.toml", "-o", "plain.txt/run.txt"), ("plain.txt/run.txt", "cannot be written")),
        (("simulate", "train.toml", "-o", "x" * 300), ("cannot be written",)),
        (
            ("simulate", "train.toml", "--plot", "run.png", "-o", "no/such/run.txt"),
            ("no/such/run.txt", "cannot be written"),
        ),
        (("synthesize", "hopeless.toml", "-o", "no/such/design.json"), ("no/such/design.json", "cannot be written")),
        (("synthesize", "hopeless.toml", "-o", "folder"), ("folder", "cannot be written")),
        (("init", "nosuch"), ("nosuch", "slope-step")),
        (("init", "slop"), ("did you mean 'slope'",)),
        (("init", "../schema"), ("../schema", "slope-step")),
    ],
    ids=lambda value: " ".join(value)[:60] if isinstance(value, tuple) else None,
)
def test_a_bad_option_is_one_line_and_leaves_nothing_behind(arguments, words, poise, tmp_path):
    (tmp_path / "folder").mkdir()
    (tmp_path / "plain.txt").write_text("kept")
    (tmp_path / "train.toml").write_text(TRAIN, encoding="utf-8")
    (tmp_path / "hopeless.toml").write_text(put(SLOPE, contact_force_n="300.0"), encoding="utf-8")
    before = snapshot(tmp_path)
    assert_refused(poise(*arguments), *words)
    assert snapshot(tmp_path) == before


@pytest.mark.parametrize(
    "command",
    [
        ("report",),
        ("synthesize",),
        ("simulate",),
        ("study",),
        ("trials",),
        ("prove",),
        ("tradeoff", "--between", "contact-force", "decay-rate"),
    ],
    ids=lambda command: command[0],
)
def test_a_box_that_leaves_no_body_is_one_line_of_every_command(command, poise, tmp_path):
    (tmp_path / "thin.toml").write_text(SLOPE + "\n[uncertainty]\nmass_kg = 60.0\n", encoding="utf-8")
    before = snapshot(tmp_path)
    assert_refused(poise(command[0], "thin.toml", *command[1:]), "uncertainty.mass_kg", "-10 of 50", "less than that")
    assert snapshot(tmp_path) == before


@pytest.mark.parametrize(
    "arguments",
    [
        ("nosuch",),
        ("report",),
        ("report", "slope", "extra"),
        ("report", "slope", "--nosuch"),
        ("report", "slope", "--law", "pid"),
        ("report", "slope", "--format", "xml"),
        ("report", "slope", "--gains"),
        ("simulate", "slope", "--format", "xml"),
        ("synthesize", "slope", "--starts", "0"),
        ("synthesize", "slope", "--starts", "many"),
        ("synthesize", "slope", "--time-limit", "0"),
        ("synthesize", "slope", "--time-limit", "nan"),
    ],
    ids=" ".join,
)
def test_wrong_usage_is_answered_with_the_usage(arguments, poise, tmp_path):
    ended = poise(*arguments)
    assert (ended.code, ended.out) == (2, "")
    lines = ended.err.splitlines()
    assert lines[0].startswith(("Usage: poise", "Error: "))
    assert lines[-1].startswith("Error: ")
    assert "Traceback" not in ended.err
    assert snapshot(tmp_path) == {}


@pytest.mark.parametrize(
    ("wish", "said"),
    [
        (("--maximise", "height"), "decay-rate"),
        (("--maximise", "torque"), "--minimise torque"),
        (("--minimise", "push"), "--maximise push"),
        (("--minimise", "goals"), "soft"),
        (("--maximise", "push", "--minimise", "torque"), "exclude"),
        (("--maximise", "push", "--global"), "--global"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_a_wish_that_cannot_be_is_one_line(wish, said, poise):
    ended = poise("synthesize", "slope", *wish)
    assert (ended.code, ended.out) == (2, "")
    assert said in ended.err.splitlines()[-1]
    assert "Traceback" not in ended.err


# Designs that cannot be used

DESIGN = {
    "schema_version": 1,
    "spec": {"text": SHORT},
    "law": "force",
    "gains": {"kp": 3000.0, "kd": 1000.0, "kf": 0.3},
}


def design_text(**values):
    return json.dumps({**DESIGN, **values})


def test_a_design_is_simulated_with_its_own_gains(poise, tmp_path):
    gains = {"kp": 2900.0, "kd": 900.0, "kf": 0.2}
    (tmp_path / "design.json").write_text(design_text(gains=gains))
    ended = poise("simulate", "design.json", "--format", "json")
    assert ended.code == 0
    assert ended.json["gains"] == gains
    assert ended.json["law"] == "force"


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", "not valid JSON"),
        ("{", "not valid JSON"),
        (design_text()[:-20], "not valid JSON"),
        ("[" * 100_000, "not valid JSON"),
        ("9" * 5000, "not valid JSON"),
        ("[]", "not a design"),
        ("{}", "not a design"),
        ("null", "not a design"),
        (design_text(schema_version=2), "schema_version: is 2; this Poise reads 1"),
        (design_text(gains=None, status="undecided"), "'undecided'"),
        (design_text(gains={}), "gains.kp"),
        (design_text(gains=[1, 2, 3]), "gains.kp"),
        (design_text(gains={"kp": 1.0, "kd": 1.0}), "gains.kp"),
        (design_text(gains={"kp": math.nan, "kd": 1.0, "kf": 1.0}), "finite"),
        (design_text(gains={"kp": math.inf, "kd": 1.0, "kf": 1.0}), "finite"),
        (design_text(gains={"kp": -1.0, "kd": 1.0, "kf": 1.0}), "from 0"),
        (design_text(gains={"kp": 10**400, "kd": 1.0, "kf": 1.0}), "finite"),
        (design_text(gains={"kp": "3000", "kd": 1.0, "kf": 1.0}), "gains.kp"),
        (design_text(gains={"kp": True, "kd": 1.0, "kf": 1.0}), "gains.kp"),
        (design_text(law="pid"), "law"),
        (design_text(spec="slope"), "spec.text"),
        (design_text(spec={}), "spec.text"),
        (design_text(spec={"text": 3}), "spec.text"),
        (design_text(spec={"text": ""}), "is empty"),
        (design_text(spec={"text": put(ADULT, mass_kg="-1")}), "body.mass_kg: is -1.0"),
        (design_text(spec={"text": ADULT + "# \ud800"}), "mine.json"),
    ],
    ids=lambda value: value[-60:] if len(value) > 60 else value,
)
def test_a_bad_design_is_one_line(text, word, poise, tmp_path):
    (tmp_path / "mine.json").write_text(text)
    assert_refused(poise("simulate", "mine.json"), "mine.json", word)


# What is written


@pytest.mark.parametrize("command", READERS)
def test_a_file_that_is_there_is_kept_when_the_command_fails(command, poise, tmp_path):
    (tmp_path / "mine.toml").write_text(put(SLOPE, mass_kg="-1"), encoding="utf-8")
    (tmp_path / "result.json").write_text("kept")
    assert_refused(poise(command, "mine.toml", "-o", "result.json"))
    assert (tmp_path / "result.json").read_text() == "kept"


@pytest.mark.parametrize(("error", "code"), [(OSError(28, "No space left on device"), 2), (KeyboardInterrupt(), 130)])
def test_a_file_that_is_there_is_kept_when_writing_fails(error, code, poise, tmp_path, monkeypatch):
    (tmp_path / "run.txt").write_text("kept")
    before = snapshot(tmp_path)

    def fail(_):
        raise error

    monkeypatch.setattr(os, "fsync", fail)
    ended = poise("simulate", "adult-slope", "-o", "run.txt")
    assert (ended.code, ended.out) == (code, "")
    assert len(ended.faults) <= 1
    assert snapshot(tmp_path) == before


def test_a_result_goes_to_the_file_instead_of_standard_output(poise, tmp_path):
    printed = poise("simulate", "adult-slope")
    written = poise("simulate", "adult-slope", "-o", "run.txt")
    assert (written.code, written.out, written.err) == (0, "", "")
    assert (tmp_path / "run.txt").read_text(encoding="utf-8") == printed.out
    assert list(snapshot(tmp_path)) == ["run.txt"]


def test_writing_to_a_pipe_leaves_it_a_pipe(poise, tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        poise("simulate", "adult-slope", "-o", "pipe")
        assert stat.S_ISFIFO(pipe.stat().st_mode)
    finally:
        os.close(reader)


@pytest.mark.parametrize(("kind", "magic"), [("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF")])
def test_a_plot_is_a_picture(kind, magic, poise, tmp_path):
    (tmp_path / "mine.toml").write_text(SHORT, encoding="utf-8")
    ended = poise("simulate", "mine.toml", "--plot", f"run.{kind}")
    assert ended.code == 0
    assert ended.faults == []
    assert (tmp_path / f"run.{kind}").read_bytes().startswith(magic)


# Exit codes of report


def test_a_report_of_what_is_met_exits_0(poise):
    ended = poise("report", "slope")
    assert ended.code == 0
    assert re.search(r"(?m)^specification: KEPT\b", ended.out)
    assert "BROKEN" not in ended.out
    assert ended.faults == []


def test_a_report_of_what_is_violated_exits_1(poise):
    ended = poise("report", "slope", "--law", "pd")
    assert ended.code == 1
    assert re.search(r"(?m)^specification: BROKEN\b", ended.out)
    assert re.search(r"(?m)^BROKEN +heel-force +ramp +-\d", ended.out)
    assert ended.faults == []


def test_a_report_of_what_cannot_be_decided_exits_3(poise, tmp_path):
    (tmp_path / "mine.toml").write_text(put(SLOPE, time_step_s="0.5"), encoding="utf-8")
    ended = poise("report", "mine.toml")
    assert ended.code == 3
    assert re.search(r"(?m)^specification: UNDECIDED\b", ended.out)
    assert re.search(r"time step of 0\.5 s is\s+too\s+coarse", ended.out)


@pytest.mark.parametrize(("law", "code", "verdict"), [("force", 0, "met"), ("pd", 1, "violated")])
def test_the_json_of_a_report_says_what_its_exit_code_says(law, code, verdict, poise, tmp_path):
    (tmp_path / "mine.toml").write_text(put(SLOPE, duration_s="5.0"), encoding="utf-8")
    ended = poise("report", "mine.toml", "--law", law, "--format", "json")
    assert ended.code == code
    assert ended.json["law"] == law
    assert ended.json["verdict"] == verdict
    counting = [row["status"] for row in ended.json["rows"] if row["required"] is not None and not row["soft"]]
    assert counting
    assert ("violated" in counting) == (verdict == "violated")


# JSON

ROW = {"id", "equation", "scenario", "unit", "value", "required", "margin", "status", "time_s", "basis"}
FIRST_IDS = {"stiffness", "damping", "routh", "decay-rate", "toe-force", "heel-force", "cop-margin", "torque"}


def assert_common(document, command, text):
    assert document["schema_version"] == 1
    assert document["command"] == command
    assert document["spec"]["sha256"] == hashlib.sha256(text.encode()).hexdigest()
    assert document["status"]
    assert {"poise", "casadi", "python"} <= document["provenance"].keys()
    assert all(isinstance(version, str) for version in document["provenance"].values())


def assert_rows(rows):
    for row in rows:
        assert ROW <= row.keys()
        assert row["status"] in ("met", "violated", "undecided")
        assert row["basis"] in ("exact", "sampled", "proved")
        for key in ("value", "required", "margin", "time_s"):
            assert row[key] is None or isinstance(row[key], float)
        for key in ("id", "equation", "unit"):
            assert isinstance(row[key], str)


def test_the_json_of_a_report_has_the_common_keys(poise):
    document = poise("report", "slope", "--format", "json").json
    assert_common(document, "report", SLOPE)
    assert document["spec"]["name"] == "slope"
    assert document["gains"] == {"kp": 3500.0, "kd": 1200.0, "kf": 1.0}
    assert_rows(document["rows"])
    assert {row["id"] for row in document["rows"]} >= FIRST_IDS
    assert {row["scenario"] for row in document["rows"]} <= {"ramp", None}


def test_the_json_of_a_run_has_every_column(poise, tmp_path):
    (tmp_path / "train.toml").write_text(TRAIN, encoding="utf-8")
    document = poise("simulate", "train.toml", "--format", "json").json
    assert_common(document, "simulate", TRAIN)
    assert document["gains"] == {"kp": 3500.0, "kd": 1200.0, "kf": 1.0}
    assert [run["name"] for run in document["scenarios"]] == ["start", "stop"]
    for run in document["scenarios"]:
        assert set(run["samples"]) == set(COLUMNS)
        assert run["samples"]["slope_rad"] is None
        assert run["samples"]["time_s"][0] == 0.0
        assert run["samples"]["time_s"][-1] == 2.0
        assert run["toe_force_n"]["min"] == min(run["samples"]["toe_force_n"])
        assert run["lost_contact"] is None
        assert run["fallen_s"] is None


@pytest.mark.parametrize("form", ["json", "csv", "text"])
def test_a_fall_prints_no_nan(form, poise):
    ended = poise("simulate", "slope", "--gains", "0,0,0", "--format", form)
    assert ended.code == 0
    assert ended.faults == []
    assert not re.search(r"(?i)\b(nan|inf|infinity)\b", ended.out)
    if form == "json":
        (run,) = ended.json["scenarios"]
        assert 0 < run["fallen_s"] < 10
    if form == "text":
        assert "FALLS" in ended.out


def test_what_is_not_finite_becomes_null():
    assert strict_json(dumps({"a": math.nan, "b": [math.inf, -math.inf, 1.0]})) == {"a": None, "b": [None, None, 1.0]}


# CSV


def rows_of(text):
    header, *rows = csv.reader(io.StringIO(text))
    return header, rows


def test_the_csv_of_one_scenario_has_the_columns_and_every_sample(poise):
    ended = poise("simulate", "slope", "--format", "csv")
    header, rows = rows_of(ended.out)
    assert header == list(COLUMNS)
    assert header == (
        "time_s theta_rad rate_rad_per_s torque_nm toe_force_n heel_force_n cop_m fx_n fy_n fx_estimate_n"
        " fy_estimate_n slope_rad"
    ).split()  # fmt: skip
    assert len(rows) == 10_001
    assert all(math.isfinite(float(cell)) for row in rows for cell in row)
    assert float(rows[0][0]) == 0.0
    assert float(rows[-1][0]) == 10.0
    assert float(rows[-1][-1]) == pytest.approx(math.radians(30.0), rel=1e-14)


def test_the_csv_of_two_scenarios_begins_with_the_scenario(poise, tmp_path):
    (tmp_path / "train.toml").write_text(TRAIN, encoding="utf-8")
    header, rows = rows_of(poise("simulate", "train.toml", "--format", "csv").out)
    assert header == ["scenario", *COLUMNS]
    names = [row[0] for row in rows]
    assert names == sorted(names)
    assert set(names) == {"start", "stop"}
    assert {row[-1] for row in rows} == {""}


def test_the_csv_of_one_of_two_scenarios_has_no_scenario_column(poise, tmp_path):
    (tmp_path / "train.toml").write_text(TRAIN, encoding="utf-8")
    header, rows = rows_of(poise("simulate", "train.toml", "--scenario", "stop", "--format", "csv").out)
    assert header == list(COLUMNS)
    whole = rows_of(poise("simulate", "train.toml", "--format", "csv").out)[1]
    assert rows == [row[1:] for row in whole if row[0] == "stop"]


def test_csv_and_json_hold_the_same_numbers(poise, tmp_path):
    (tmp_path / "mine.toml").write_text(SHORT, encoding="utf-8")
    header, rows = rows_of(poise("simulate", "mine.toml", "--format", "csv").out)
    samples = poise("simulate", "mine.toml", "--format", "json").json["scenarios"][0]["samples"]
    for index, name in enumerate(header):
        assert [float(row[index]) for row in rows] == samples[name]


# Synthesis

GAINS = re.compile(r"\bk[pdf]\s*[=:]\s*\d")


def test_an_infeasible_requirement_is_named_and_exits_1(poise, tmp_path):
    (tmp_path / "mine.toml").write_text(put(SLOPE, contact_force_n="300.0"), encoding="utf-8")
    ended = poise("synthesize", "mine.toml")
    assert ended.code == 1
    assert "INFEASIBLE" in ended.out
    assert re.search(r"contact-force in scenario 'ramp': at best \d+(\.\d+)? N, needs 300", ended.out)
    assert not GAINS.search(ended.out)
    assert ended.faults == []
    ended = poise("synthesize", "mine.toml", "--format", "json")
    assert ended.code == 1
    assert_common(ended.json, "synthesize", put(SLOPE, contact_force_n="300.0"))
    assert ended.json["status"] == "infeasible"
    assert ended.json["verdict"] == "violated"
    assert ended.json["gains"] is None
    assert ended.json["objective"] == {"id": "contact-force", "sense": "maximise", "value": None, "unit": "N"}
    assert "contact-force" in ended.json["reason"]


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ({"ramp_s": "0.0"}, "capturability"),
        ({"angle_deg": "120.0"}, "contact-force"),
        ({"decay_rate_per_s": "1e6"}, "decay-rate"),
        ({"contact_force_n": "0.0\ncop_margin_m = 0.2"}, "cop-margin"),
    ],
    ids=["line of force beside the foot", "overhang", "too fast", "wider than the foot"],
)
def test_what_no_gains_can_meet_is_infeasible_with_the_quantity_that_limits(values, word, poise, tmp_path):
    (tmp_path / "mine.toml").write_text(put(SLOPE, **values), encoding="utf-8")
    ended = poise("synthesize", "mine.toml", "--starts", "1", "--time-limit", "20")
    assert ended.code == 1
    assert "INFEASIBLE" in ended.out
    said = " ".join(ended.out.split())
    if word == "capturability":
        assert re.search(r"In scenario 'ramp' a sudden slope of \S+ deg makes the body fall over the toe, .*"
                         r" with this foot at most 7\.6\d* deg of it can be survived", said)  # fmt: skip
    else:
        assert re.search(rf" {word}( in scenario 'ramp')?: at best \S+ .*, needs \d", said)


@pytest.mark.slow
def test_a_slope_beyond_the_friction_gives_no_gains_and_names_friction(poise, tmp_path):
    (tmp_path / "mine.toml").write_text(
        put(SLOPE, ramp_s="1.0", duration_s="3.0", contact_force_n="0.0\nfriction = 0.3"), encoding="utf-8"
    )
    ended = poise("synthesize", "mine.toml", "--starts", "1")
    assert ended.code in (1, 3)
    assert re.search(r"\bfriction in scenario 'ramp'", ended.out)
    assert not GAINS.search(ended.out)


MET_FOR_A_MOMENT = {
    "a body that rises from its lean loads the foot more than at rest": put(
        SLOPE, ramp_s="0.0\ninitial_angle_deg = -28.0", duration_s="0.05", desired_angle_deg="-28.0",
        contact_force_n="220.0", kp="380.0", kd="0.1", kf="1e-5",
    ),
    "contact holds until the body has fallen some way": put(
        builtin_text("slope-step"), angle_deg="12.0", duration_s="0.1", kp="500.0", kd="20.0", kf="0.05",
    ),
}  # fmt: skip


@pytest.mark.parametrize("text", MET_FOR_A_MOMENT.values(), ids=MET_FOR_A_MOMENT.keys())
def test_what_a_design_meets_is_not_called_infeasible(text, poise, tmp_path):
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    assert poise("report", "mine.toml").code == 0
    assert poise("synthesize", "mine.toml", "--starts", "1").code in (0, 3)


@pytest.mark.slow
def test_an_undecided_synthesis_gives_no_gains_and_exits_3(poise, tmp_path):
    (tmp_path / "mine.toml").write_text(put(SLOPE, contact_force_n="200.0"), encoding="utf-8")
    ended = poise("synthesize", "mine.toml")
    assert ended.code == 3
    assert "UNDECIDED" in ended.out
    assert not GAINS.search(ended.out)
    assert ended.faults == []
    ended = poise("synthesize", "mine.toml", "--format", "json", "-o", "design.json")
    assert ended.code == 3
    assert ended.json["status"] == ended.json["verdict"] == "undecided"
    assert '"gains": null' in ended.out
    assert ended.json["objective"]["value"] is None
    assert_rows(ended.json["rows"])
    assert (tmp_path / "design.json").read_text(encoding="utf-8") == ended.out
    assert_refused(poise("report", "design.json"), "design.json: gains", "'undecided'")


@pytest.mark.slow
def test_a_design_is_written_with_its_status_and_read_by_report(poise, tmp_path):
    text = ADULT.replace("kd = [0.0, 2500.0]", "kd = [1000.0, 1000.0]").replace("kf = [0.0, 5.0]", "kf = [0.3, 0.3]")
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    ended = poise("synthesize", "mine.toml", "--starts", "1", "-o", "design.json")
    assert ended.code == 0
    assert ended.err == ""
    design = strict_json((tmp_path / "design.json").read_text(encoding="utf-8"))
    assert_common(design, "synthesize", text)
    assert design["spec"]["text"] == text
    assert (design["status"], design["verdict"]) == ("solved", "met")
    assert design["objective"]["id"] == "contact-force"
    assert design["objective"]["unit"] == "N"
    assert_rows(design["rows"])
    assert f"kp = {design['gains']['kp']:.10g}" in ended.out
    reported = poise("report", "design.json", "--format", "json")
    assert reported.code == 0
    assert reported.json["gains"] == design["gains"]
    assert reported.json["verdict"] == "met"
    assert reported.json["spec"] == {key: design["spec"][key] for key in ("name", "sha256")}


def test_a_time_limit_that_is_too_short_is_undecided_and_gains_are_the_best_so_far_at_most(poise):
    ended = poise("synthesize", "adult-slope", "--time-limit", "0.1")
    assert ended.code == 3
    assert "UNDECIDED" in ended.out
    result, _, rest = ended.out.partition("The best design so far was checked to keep every requirement")
    assert not GAINS.search(result)
    assert not rest or "a better one may exist" in rest


# Numbers at the edge of what is allowed


@pytest.mark.parametrize("command", ["simulate", "report"])
@pytest.mark.parametrize(
    "text",
    [
        put(SLOPE, duration_s="1.0", inertia_kgm2="5e-324"),
        put(SLOPE, duration_s="1.0", half_length_m="5e-324"),
        put(SLOPE, duration_s="1.0", mass_kg="5e-324"),
        put(SLOPE, duration_s="5e-324"),
        put(SLOPE, duration_s="1.0", gravity_mps2="5e-324"),
        put(SLOPE, duration_s="1.0", contact_force_n="1e308"),
        put(builtin_text("train"), duration_s="1.5", acceleration_mps2="[[0.0, 0.0], [1.0, 1e308]]"),
        put(builtin_text("train"), duration_s="1.5", acceleration_mps2="[[0.0, 0.0], [1e308, 1.0]]"),
        put(builtin_text("wind"), duration_s="1.5", points="[[0.0, 0.0, 0.0], [2.0, -1e308, 1e308]]"),
    ],
    ids=["inertia", "foot", "mass", "duration", "gravity", "requirement", "acceleration", "time", "force"],
)
def test_extreme_numbers_are_judged_or_refused_but_never_an_internal_error(command, text, poise, tmp_path):
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    ended = poise(command, "mine.toml", "--format", "json")
    if ended.code == 2:
        assert_refused(ended, "mine.toml")
    else:
        assert ended.code in (0, 1, 3)
        assert ended.faults == []
        assert_common(ended.json, command, text)


@pytest.mark.parametrize("gains", ["1e9,1200,1", "3500,1e9,1"])
def test_extreme_gains_take_neither_gigabytes_nor_minutes(gains, tmp_path):
    (tmp_path / "mine.toml").write_text(put(SLOPE, duration_s="1.0"), encoding="utf-8")
    code = "import resource, cli; resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30)); cli.main()"
    arguments = ["report", tmp_path / "mine.toml", "--gains", gains, "--format", "json"]
    ended = process(*arguments, code=code, timeout=20, cwd=ROOT, env={**os.environ, "OPENBLAS_NUM_THREADS": "1"})
    assert ended.code in (1, 3), ended.err
    assert ended.faults == []
    assert ended.json["verdict"] in ("violated", "undecided")


@given(
    values=st.fixed_dictionaries(
        {},
        optional={
            "mass_kg": st.floats(1e-3, 1000),
            "com_height_m": st.floats(1e-3, 1000),
            "inertia_kgm2": st.floats(1e-3, 1e9),
            "half_length_m": st.floats(1e-3, 10),
            "angle_deg": st.floats(-180, 180).map(lambda angle: angle + 0.0),
            "ramp_s": st.just(0.0) | st.floats(1e-3, 3600),
            "kp": st.floats(1e-3, 1e9),
            "kd": st.floats(1e-3, 1e9),
            "kf": st.floats(1e-3, 1e9),
        },
    )
)
@example(values={"mass_kg": 749.0, "inertia_kgm2": 0.001, "angle_deg": 0.0})
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_run_of_any_allowed_spec_is_strict_json(values, poise, tmp_path):
    text = put(put(SLOPE, duration_s="0.5", time_step_s="0.005"), **{key: repr(value) for key, value in values.items()})
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    ended = poise("simulate", "mine.toml", "--format", "json")
    assert ended.code == 0, ended.err
    assert ended.faults == []
    assert_common(ended.json, "simulate", text)


# The rest of the world


def test_help_is_there_for_the_command_and_each_of_its_commands(poise):
    ended = poise("--help")
    assert (ended.code, ended.err) == (0, "")
    assert all(command in ended.out for command in COMMANDS)
    assert {"simulate", "synthesize", "report", "specs", "init", "schema"} <= set(COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_a_command_fits_a_terminal(command, poise):
    ended = poise(command, "--help")
    assert (ended.code, ended.err) == (0, "")
    assert ended.out.startswith(f"Usage: poise {command} ")
    assert max(map(len, ended.out.splitlines())) <= 80


def test_help_imports_nothing_heavy():
    code = (
        "import sys, cli\n"
        "sys.argv = ['poise', '--help']\n"
        "try:\n    cli.main()\n"
        "finally:\n    sys.stderr.write(' '.join(sorted({name.partition('.')[0] for name in sys.modules})))\n"
    )
    ended = process(code=code, cwd=ROOT)
    assert ended.code == 0
    assert ended.out.startswith("Usage: poise")
    loaded = set(ended.err.split())
    assert "typer" in loaded
    assert not loaded & {"casadi", "numpy", "matplotlib", "scipy", "pydantic", "clarabel"}


@pytest.mark.parametrize("name", ["design", "problems"])
@pytest.mark.parametrize("form", ["package", "module"])
def test_a_module_of_the_same_name_that_comes_first_is_named(name, form, tmp_path):
    decoy = tmp_path / name / "__init__.py" if form == "package" else tmp_path / f"{name}.py"
    decoy.parent.mkdir(exist_ok=True)
    decoy.write_text("raise SystemExit('a decoy was imported')\n")
    code = f"import sys; sys.path.append({str(ROOT)!r}); sys.argv[0] = 'poise'; import cli; cli.main()"
    ended = process("simulate", "slope", code=code, cwd="/", env={**os.environ, "PYTHONPATH": str(tmp_path)})
    assert_refused(ended, str(decoy))


def test_the_script_is_not_misled_by_the_python_path(tmp_path):
    (tmp_path / "design.py").write_text("raise SystemExit('a decoy was imported')\n")
    ended = process("specs", cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(tmp_path)})
    assert (ended.code, ended.err) == (0, "")


def test_an_internal_error_is_one_line_and_with_debug_a_traceback_and_a_report(poise, monkeypatch, tmp_path):
    def fail(_):
        raise RuntimeError("first line\nsecond line")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("design.present.opening.load", fail)
    ended = poise("report", "slope")
    assert (ended.code, ended.out) == (2, "")
    assert ended.err.startswith("poise: internal error: RuntimeError: first line second line; rerun with --debug")
    assert ended.err.count("\n") == 1
    ended = poise("report", "slope", "--debug")
    assert (ended.code, ended.out) == (2, "")
    assert "Traceback" in ended.err
    assert "RuntimeError: first line" in (tmp_path / "poise-bug-report.txt").read_text()


def test_an_interrupt_exits_130(poise, monkeypatch):
    def fail(_):
        raise KeyboardInterrupt

    monkeypatch.setattr("design.present.opening.load", fail)
    ended = poise("report", "slope")
    assert (ended.code, ended.out) == (130, "")
    assert ended.err.strip() in ("", "poise: interrupted")


@pytest.mark.slow
@pytest.mark.parametrize("after", [0.7, 0.85, 3.0])  # while programs are built, where CasADi's glue can swallow it
def test_an_interrupt_in_mid_synthesis_exits_130_without_gains(after, tmp_path):
    arguments = ["synthesize", "slope", "--starts", "1000", "-o", str(tmp_path / "design.json")]
    running = subprocess.Popen(
        [sys.executable, str(ROOT / "cli.py"), *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a test runner's workers may ignore it
    )  # fmt: skip
    try:
        time.sleep(after)
        assert running.poll() is None
        running.send_signal(signal.SIGINT)
        out, err = running.communicate(timeout=40)
    finally:
        running.kill()
        running.communicate()
    assert (running.returncode, out) == (130, "")
    assert "Traceback" not in err
    assert snapshot(tmp_path) == {}


@pytest.mark.parametrize("arguments", [("schema",), ("report", "mine.toml")], ids=" ".join)
def test_a_terminal_that_knows_only_ascii_still_gets_its_result(arguments, tmp_path):
    (tmp_path / "mine.toml").write_text(put(ADULT, duration_s="1.0"), encoding="utf-8")
    ended = process(*arguments, cwd=tmp_path, env={**os.environ, "PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"})
    assert ended.code == 0, ended.err
    assert ended.faults == []
    assert ended.out


@pytest.mark.parametrize("arguments", [("init", "slope"), ("simulate", "mine.toml")], ids=" ".join)
def test_a_reader_that_has_gone_is_no_violation(arguments, tmp_path):
    (tmp_path / "mine.toml").write_text(SHORT, encoding="utf-8")
    reader, writer = os.pipe()
    os.close(reader)
    try:
        ended = process(*arguments, stdout=writer, cwd=tmp_path)
    finally:
        os.close(writer)
    assert ended.code == 0
    assert ended.faults == []


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_behind_standard_output_is_one_line():
    with open("/dev/full", "w") as full:
        ended = process("init", "slope", stdout=full)
    assert ended.code == 2
    assert len(ended.faults) == 1
    assert ended.faults[0].startswith("poise: ")
    assert "No space left" in ended.faults[0]


def test_no_colour_codes_go_into_a_file_or_a_pipe(poise, tmp_path):
    assert "\033" not in poise("simulate", "slope").out
    poise("simulate", "slope", "-o", "run.txt")
    assert "\033" not in (tmp_path / "run.txt").read_text(encoding="utf-8")
