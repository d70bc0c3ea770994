"""`poise tradeoff`: a table, sentences, JSON, CSV, Markdown, a page, a picture, a design; and exit codes."""

import csv
import io
import json
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from types import SimpleNamespace

import jsonschema
import pytest

import cli
from design.present.plots import figure_bytes
from design.present.tradeoff_plots import tradeoff_figure
from design.spec.load import load

ROOT = Path(__file__).resolve().parents[1]
BETWEEN = ["--between", "contact-force", "decay-rate"]
NUMBER = {"type": "number"}
GAINS = {"type": "object", "properties": {"kp": NUMBER, "kd": NUMBER, "kf": NUMBER}, "required": ["kp", "kd", "kf"]}
SCHEMA = {
    "type": "object",
    "required": ["schema_version", "command", "spec", "status", "verdict", "law", "margins", "points", "ends", "knee",
                 "jumps", "unsolved", "given", "provenance"],
    "properties": {
        "schema_version": {"const": 1},
        "command": {"const": "tradeoff"},
        "margins": {"items": {"required": ["id", "unit", "sense"]}, "minItems": 2, "maxItems": 3},
        "points": {
            "minItems": 1,
            "items": {
                "required": ["gains", "values", "active"],
                "properties": {"gains": GAINS, "values": {"type": "object", "additionalProperties": NUMBER}},
            },
        },
        "ends": {"additionalProperties": {"type": "integer", "minimum": 1}},
        "given": {"required": ["gains", "values", "met", "dominated", "dominated_by"]},
    },
}  # fmt: skip


def _poise(*arguments):
    """What the command does, in this process."""
    out, err = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.setattr(sys, "argv", ["poise", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
    return SimpleNamespace(returncode=ended.value.code, stdout=out.getvalue(), stderr=err.getvalue())


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One run that writes a picture and a design, and another form for each ending from the same facts."""
    return tmp_path_factory.mktemp("front")


@pytest.fixture(scope="module")
def printed(folder):
    return _poise(
        "tradeoff", "slope", *BETWEEN, "--points", "4", "--point", "3", "-o", folder / "design.json", "--plot",
        folder / "front.svg", "--format", "json",
    )  # fmt: skip


@pytest.fixture(scope="module")
def document(printed):
    return json.loads(printed.stdout, parse_constant=lambda constant: pytest.fail(f"JSON holds {constant}"))


def test_the_json_is_of_the_form_that_is_promised(printed, document):
    assert printed.returncode == 0, printed.stderr
    jsonschema.validate(document, SCHEMA)
    assert (document["status"], document["verdict"], len(document["points"])) == ("complete", "met", 4)
    assert list(document["points"][0]["values"]) == ["contact-force", "decay-rate"]
    assert document["ends"] == {"contact-force": 1, "decay-rate": 4}
    own = document["given"]
    assert own["dominated"]
    beaten_by = document["points"][own["dominated_by"] - 1]["values"]
    assert all(beaten_by[id] > value for id, value in own["values"].items())


def test_a_point_is_a_design_for_report(folder, document):
    report = _poise("report", folder / "design.json", "--format", "json")
    assert report.returncode == 0
    rows = json.loads(report.stdout)["rows"]
    its = document["points"][2]["values"]
    assert min(r["value"] for r in rows if r["id"] in ("toe-force", "heel-force")) == its["contact-force"]
    assert min(r["value"] for r in rows if r["id"] == "decay-rate") == its["decay-rate"]


def test_the_picture_names_ends_knee_and_the_spec_s_own_gains(folder, document):
    text = (folder / "front.svg").read_text(encoding="utf-8")
    for words in ("1: best contact-force", "4: best decay-rate", "knee", "the spec's own gains", "contact-force [N]",
                  "decay-rate [1/s]", "no design found there"):  # fmt: skip
        assert words in text
    three = json.loads(json.dumps(document))
    three["margins"].append({"id": "torque", "unit": "N m", "sense": "at most"})
    for k, each in enumerate([*three["points"], three["given"]]):
        each["values"]["torque"] = 10.0 + k
    figure = tradeoff_figure(three, "three")
    assert len(figure.axes) == 6  # all pairs, and again with the spec's own gains, which are far
    assert figure_bytes(figure, "png").startswith(b"\x89PNG")


def test_every_form_says_the_same(folder, document):
    from design.present import tradeoff
    from design.present.text import painter

    source = load("slope")
    text = tradeoff.render(source, document, "text", painter(False))
    assert max(map(len, text.splitlines())) <= 80
    said = " ".join(text.split())
    assert "COMPLETE" in said
    assert "The spec's own gains, kp = 3500 N m/rad" in said
    assert f"The knee is point {document['knee']['point']}: " in said
    rows = list(csv.DictReader(io.StringIO(tradeoff.render(source, document, "csv", painter(False)))))
    assert [float(row["decay-rate"]) for row in rows] == [p["values"]["decay-rate"] for p in document["points"]]
    assert [float(row["kd"]) for row in rows] == [p["gains"]["kd"] for p in document["points"]]
    markdown = tradeoff.render(source, document, "md", painter(False))
    assert "| # | contact-force [N] | decay-rate [1/s] | kp | kd | kf |  |" in markdown
    page = tradeoff.render(source, document, "html", painter(False))
    assert "<svg" in page
    assert 'href="http' not in page
    assert 'src="http' not in page
    assert page.count("<tr>") == 5


def test_jumps_and_points_that_were_not_found_are_told(document):
    from design.present import tradeoff

    facts = {**document, "jumps": [[2, 3]], "unsolved": 2, "knee": None, "status": "incomplete", "reason": "Late."}
    said = " ".join(tradeoff.findings(facts))
    assert "jumps from point 2 to point 3" in said
    assert "2 attempts" in said
    assert "no knee" in said
    assert said.startswith("Late.")


def test_out_of_reach_is_exit_1_and_no_file(tmp_path):
    file = tmp_path / "high.toml"
    file.write_text(load("slope").text.replace("contact_force_n = 0.0", "contact_force_n = 300.0"), encoding="utf-8")
    picture = tmp_path / "front.png"
    ended = _poise("tradeoff", file, *BETWEEN, "--plot", picture)
    assert ended.returncode == 1
    assert "INFEASIBLE" in ended.stdout
    assert not picture.exists()
    assert "no picture" in ended.stderr


def test_a_time_limit_is_exit_3_and_a_page_says_so(tmp_path):
    page = tmp_path / "front.html"
    ended = _poise("tradeoff", "slope", *BETWEEN, "--time-limit", "0.1", "-o", page)
    assert (ended.returncode, ended.stdout) == (3, "")
    assert "time limit" in page.read_text(encoding="utf-8")


BAD = {
    "an unknown row": (["--between", "contact-force", "grace"], "'grace'; needs two or three of decay-rate"),
    "one row": (["--between", "decay-rate"], "names 1"),
    "none": ([], "names 0"),
    "a row twice": (["--between", "torque,torque"], "twice"),
    "a point beyond": ([*BETWEEN, "--point", "16", "-o", "design.json"], "a number from 1 to 15, or knee"),
    "a point without a place": ([*BETWEEN, "--point", "2"], "-o design.json"),
    "a picture of no kind": ([*BETWEEN, "--plot", "front.bmp"], ".bmp"),
    "no such folder": ([*BETWEEN, "-o", "/no/such/front.csv"], "cannot be written"),
    "too few points": ([*BETWEEN, "--points", "1"], "greater than or equal to 2"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_line_and_exit_2(case):
    arguments, said = BAD[case]
    ended = _poise("tradeoff", "slope", *arguments)
    assert (ended.returncode, ended.stdout) == (2, "")
    assert said in ended.stderr
    assert "Traceback" not in ended.stderr


def test_a_spec_without_bounds_is_told_what_is_missing(tmp_path):
    file = tmp_path / "free.toml"
    text = load("slope").text
    start = text.index("[synthesis.bounds]")
    file.write_text(text[:start] + text[text.index("[simulation]") :], encoding="utf-8")
    command = [sys.executable, str(ROOT / "cli.py"), "tradeoff", str(file), "--between", "torque,decay-rate"]
    ended = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert ended.returncode == 2
    assert "synthesis.bounds: is missing" in ended.stderr
