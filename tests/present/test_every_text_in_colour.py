"""On a colour terminal every command says what it says without colours, whatever the answer is."""

import inspect
import pkgutil
import re
import sys
from importlib import import_module
from typing import get_args

import pytest

import cli
import design.present
from design.analysis.obstacles import Obstacle
from design.analysis.rows import Row, RowStatus, Verdict
from design.analysis.synthesis import Answer
from design.model.laws import Gains
from design.present import proving, region, report, study_text, synthesis, text, tradeoff, trials
from design.present.text import Style, painter
from design.proof.box import Answer as ProofAnswer
from design.proof.box import Counterexample, Proof
from design.solvers.outcome import Outcome, Status
from design.spec.load import load
from design.spec.setting import setting

SOURCE = load("slope")
PROBLEM = setting(SOURCE.spec)
GAINS = Gains(3500.0, 1200.0, 1.0)
ESCAPE = re.compile(r"\033\[[0-9;]*m")


def _row(status, required=0.0, soft=False, basis="sampled"):
    return Row(
        id="heel-force", equation="(6)", scenario="ramp", unit="N", value=1.0, required=required, margin=1.0,
        status=status, time_s=1.0, basis=basis, soft=soft, note="a note",
    )  # fmt: skip


OBSTACLE = Obstacle(id="contact-force", scenario="ramp", value=100.0, required=200.0, unit="N", why="it is too light")


def _ended(status):
    return Outcome.infeasible(OBSTACLE) if status is Status.INFEASIBLE else Outcome(status=status, detail="why")


ROWS = [
    *(_row(status, soft=soft) for status in get_args(RowStatus) for soft in (False, True)),
    _row("met", basis="proved"), _row("met", required=None),
]  # fmt: skip


def _judged(status):
    needed = [row for row in ROWS if row.status in (status, "met")]
    return report.Report(
        source=SOURCE, setting=PROBLEM, gains=GAINS, verdict=Verdict(rows=tuple(needed), trajectories=())
    )


def _proof(answer):
    broken = Counterexample(row="heel-force", value=-1.0, time_s=1.0, at={}) if answer == "disproved" else None
    bounds = {"toe-force": 1.0, "heel-force": 2.0}
    return Proof(scenario="ramp", answer=answer, value=bounds, time_s=bounds, why="time", counterexample=broken)


def _front(status):
    return {
        "status": status, "reason": "a reason", "law": "force", "margins": [], "points": [], "ends": {}, "knee": None,
        "jumps": [], "unsolved": 0, "given": None,
    }  # fmt: skip


def _study(lost, failed):
    one = {
        "trials": 4, "lost": lost, "failed": failed, "contact_force_n": {"min": 1.0, "median": 2.0}, "settling_s": None,
        "settled": 0, "torque_rms_nm": 1.0, "unsolved": 0, "step_ms": {"median": 1.0, "p99": 1.0, "max": 1.0},
        "step_slope_share": None, "push_share": None,
    }  # fmt: skip
    return {
        "spec": {"name": "tilt"}, "trials": 4, "scenarios": ["ramp"], "seed": 0, "control_period_s": 0.005,
        "reference": "force", "left_out": {}, "remark": "", "controllers": {"force": one},
        "tuning": {"weights": {}, "gains": {}},
    }  # fmt: skip


TEXTS = {
    **{
        f"report {status}": (report, lambda paint, s=status: report.as_text(_judged(s), paint))
        for status in get_args(RowStatus)
    },
    **{
        f"comparison {status}": (
            report, lambda paint, s=status: report.comparison(_judged(s), _judged("met"), ("one", "other"), paint)
        ) for status in get_args(RowStatus)
    },
    **{
        f"prove {answer}": (
            proving, lambda paint, a=answer: proving.as_text(SOURCE, PROBLEM, GAINS, [_proof(a)], [], paint)
        ) for answer in get_args(ProofAnswer)
    },
    **{
        f"synthesize {status.name}": (
            synthesis,
            lambda paint, s=status: synthesis.text(
                SOURCE, PROBLEM, Answer(outcome=_ended(s), missed=tuple(ROWS)), paint
            ),
        ) for status in Status if status is not Status.SOLVED
    },
    **{
        f"tradeoff {status}": (tradeoff, lambda paint, s=status: tradeoff.as_text(SOURCE, _front(s), paint))
        for status in ("complete", "incomplete", "infeasible", "undecided")
    },
    **{
        f"study {lost} lost, {failed} failed": (
            study_text, lambda paint, n=lost, m=failed: study_text.as_text(_study(n, m), paint)
        ) for lost in (0, 1) for failed in (0, 1)
    },
    "rows": (text, lambda paint: "\n".join(text.report_table(ROWS, paint))),
}  # fmt: skip


@pytest.mark.parametrize("case", TEXTS)
def test_colours_add_escape_sequences_and_change_no_character(case):
    write = TEXTS[case][1]
    plain, coloured = write(painter(False)), write(painter(True))
    assert ESCAPE.sub("", coloured) == plain
    assert (coloured != plain) or case in ("study 0 lost, 0 failed",)


WIDE = "\n[uncertainty]\nslope_deg = 2\nmass_kg = { percent = 5 }\nhalf_length_m = { percent = 5 }\n"
COMMANDS = {
    "simulate": ["simulate", "slope"],
    "report": ["report", "slope"],
    "broken report": ["report", "slope", "--law", "pd"],
    "design beside another": ["report", "slope", "--against", "slope-step"],
    "proved": ["prove", "slope-step"],
    "disproved": ["prove", "slope", "--law", "pd"],
    "unknown": ["prove", "wide.toml", "--law", "cop", "--time-limit", "0.1"],
    "synthesized": ["synthesize", "slope", "--starts", "1"],
    "region": ["region", "slope-step"],
    "no region": ["region", "slope", "--law", "pd"],
    "trials": ["trials", "slope-step", "--trials", "2"],
    "trials that lose contact": ["trials", "slope", "--trials", "2", "--blind"],
    "study": ["study", "slope", "--controllers", "pd", "--trials", "1", "--jobs", "1"],
    "explanation": ["explain", "heel-force"],
}


@pytest.mark.parametrize("case", COMMANDS)
def test_every_command_answers_on_a_colour_terminal(case, monkeypatch, capsys, tmp_path):
    (tmp_path / "wide.toml").write_text(SOURCE.text + WIDE, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
    assert cli.app(COMMANDS[case], standalone_mode=False) in (None, 0, 1, 3)
    shown = capsys.readouterr().out
    assert ("\033[" in shown) or case in ("simulate", "explanation")
    if case in ("unknown", "proved", "disproved"):
        assert f"\033[{ {'unknown': '33', 'proved': '32', 'disproved': '1;31'}[case] }m" in shown


def test_whatever_paints_is_tried_in_colour():
    painting = set()
    for module in pkgutil.iter_modules(design.present.__path__):
        loaded = import_module(f"design.present.{module.name}")
        for _, function in inspect.getmembers(loaded, inspect.isfunction):
            if "paint" in inspect.signature(function).parameters and function.__module__ == loaded.__name__:
                painting.add(loaded)
    tried = {module for module, _ in TEXTS.values()} | {region, trials}  # the last two by their commands
    assert painting <= tried


def test_a_style_has_a_colour_of_its_own_and_a_word_that_is_none_is_an_error():
    assert len({style.code for style in Style}) == len(Style)
    with pytest.raises(ValueError, match="warn"):
        Style("warn")
