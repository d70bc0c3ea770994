"""A file may be called anything: every form of what is said of it stays readable, drawable, and harmless."""

import json
import os
import re
import sys
from xml.etree import ElementTree

import pytest

import cli

NAMES = [
    "a|b<script>&.csv", "$x_{$\\frac.csv", "c\x1b[31md\n]]>.csv", "x\x9by\u202e\u2028z.csv",
    os.fsdecode(b"\xff\xfe.csv"),
]  # fmt: skip
OBEYED = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028-\u202e\udc80-\udcff]")


@pytest.fixture(scope="module")
def samples():
    """Ten seconds of a steady wind, as a force plate and a goniometer see them."""
    from design.analysis.simulate import simulate
    from design.spec.load import load
    from design.spec.setting import setting

    problem = setting(load("wind").spec)
    scenario = problem.scenarios[0]
    run = simulate(problem.under(scenario).loop(), scenario, problem.given_gains(), 0.01)
    rows = zip(run.t.tolist(), (run.F_T + run.F_H).tolist(), run.P.tolist(), run.theta.tolist(), strict=True)
    return "time,fz,cop,angle\n" + "".join(f"{t:.3f},{fz!r},{P!r},{theta!r}\n" for t, fz, P, theta in rows)


@pytest.fixture
def answered(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["poise", *arguments])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        said = capsys.readouterr()
        assert not OBEYED.search(said.out)
        assert not OBEYED.search(said.err)
        assert "internal error" not in said.err
        return ended.value.code, said.out or said.err

    return run


@pytest.mark.filterwarnings("ignore:Glyph")
@pytest.mark.parametrize("name", NAMES, ids=ascii)
def test_a_recording_of_any_name_is_reported_in_every_form(name, samples, answered, tmp_path):
    (tmp_path / name).write_text(samples)
    for form in ("text", "json", "md", "junit", "html"):
        code, out = answered("report", "wind", "--record", name, "--format", form)
        assert code in (0, 1, 3), out
        if form == "json":
            json.loads(out)
        if form == "junit":
            ElementTree.fromstring(out)
        if form == "md":
            tables = [line for line in out.splitlines() if line.startswith("|")]
            assert len({len(re.findall(r"(?<!\\)\|", line)) for line in tables}) == 1
        if form == "html":
            assert "<script>&" not in out
        assert answered("report", "wind", "--record", name, "--format", form, "-o", "out")[0] == code
        assert not OBEYED.search((tmp_path / "out").read_text())


@pytest.mark.filterwarnings("ignore:Glyph")
@pytest.mark.parametrize("name", NAMES, ids=ascii)
def test_a_recording_of_any_name_is_drawn_and_becomes_a_spec(name, samples, answered, tmp_path):
    (tmp_path / name).write_text(samples)
    code, said = answered(
        "estimate", name, "--spec", "wind", "--ankle", "0", "--plot", "p.svg", "--as-spec", f"{name}.toml"
    )
    assert code == 0, said
    ElementTree.parse(tmp_path / "p.svg")
    assert answered("simulate", f"{name}.toml")[0] == 0
    json.loads(answered("estimate", name, "--spec", "wind", "--format", "json")[1])
