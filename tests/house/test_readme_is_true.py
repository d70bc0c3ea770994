"""What the README shows is what the tool prints: words exactly, numbers to five digits."""

import math
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


def test_why_not_is_said_as_shown(tmp_path):
    shown = re.search(r"(    No design was found that meets contact-force.*?)\n\n", README, flags=re.DOTALL).group(1)
    text = _run("cli.py", "init", "slope")
    text = re.sub(r"contact_force_n = .*", "contact_force_n = 180.0", text)
    text = re.sub(r"decay_rate_per_s = .*", "decay_rate_per_s = 10.0", text)
    (tmp_path / "torn.toml").write_text(text, encoding="utf-8")
    command = [sys.executable, "cli.py", "synthesize", str(tmp_path / "torn.toml")]
    ran = subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True)
    assert ran.returncode == 3
    said = ran.stdout[ran.stdout.index("No design was found that meets contact-force") :].partition("\n\n")[0]
    _assert_same(shown, said)


def test_every_command_shown_exists():
    listed = _run("cli.py", "--help")
    for line in _blocks("sh")[0].splitlines():
        assert re.search(rf"^  {line.split()[1]} ", listed, flags=re.MULTILINE), line


def test_the_commands_on_recordings_work(tmp_path):
    lines = _blocks("sh")[1].splitlines()
    assert len(lines) == 6
    for line in lines:
        command = line.partition(" #")[0].split()
        assert command[0] == "poise"
        subprocess.run(
            [sys.executable, str(ROOT / "cli.py"), *command[1:]], cwd=tmp_path, check=True, capture_output=True
        )
    assert {path.name for path in tmp_path.iterdir()} == {"trial.csv", "trial.png", "forces.csv", "met.toml"}


def test_the_study_of_the_readme_is_what_a_study_finds():
    from dataclasses import replace

    from design.spec.load import load
    from design.spec.setting import setting
    from problems.comparison.conduct import conduct, facts

    source = load("slope")
    problem = setting(source.spec)
    problem = replace(problem, study=problem.study.model_copy(update={"trials": 1}))
    found = facts(conduct(source, problem, ["force", "force-synthesized", "lqr", "mpc"], jobs=2), problem)[
        "controllers"
    ]
    text = " ".join(README.split())
    forces = [f"{found[name]['contact_force_n']['min']:.1f} N" for name in ("mpc", "force")]
    slopes = [f"{100 * found[name]['step_slope_share']:.1f} %" for name in ("mpc", "force", "force-synthesized", "lqr")]
    pushes = [f"{100 * found[name]['push_share']:.1f} %" for name in ("mpc", "force", "force-synthesized", "lqr")]
    assert "the MPC keeps {} under toe and heel, the paper's gains {}, the synthesized ones".format(*forces) in text
    assert f"synthesized ones {found['force-synthesized']['contact_force_n']['min']:.1f} N (all sampled" in text
    assert f"every 5 ms), clipped LQR {found['lqr']['contact_force_n']['min']:.1f} N." in text
    assert "the MPC survives {} of what any ankle can, the paper's gains {}, the".format(*slopes) in text
    assert f"best on the ramp, {slopes[2]}, clipped LQR {slopes[3]}; of a push {pushes[0]}, {pushes[1]}," in text
    assert f"{pushes[1]}, {pushes[2]} and {pushes[3]}" in text


def test_what_adapting_buys_is_what_the_readme_says():
    from dataclasses import replace

    from design.analysis.survival import step_slope
    from design.analysis.verdict import judge
    from design.spec.load import load
    from design.spec.setting import setting

    problem = setting(load("slope").spec)
    rows = re.findall(r"^\| (none|[\d.]+ s) \| ([\d.]+) N \| ([\d.]+)° \| ([\d.]+) ms \|$", README, flags=re.MULTILINE)
    assert len(rows) == 4
    for adapt, force, slope, period in rows:
        other = problem if adapt == "none" else replace(problem, adapt=float(adapt.split()[0]))
        verdict = judge(other, other.gains, "all")
        borne = next(row.value for row in verdict.rows if row.id == "sample-time")
        assert f"{1e3 * borne:.1f}" == period
        least = min(row.value for row in verdict.rows if row.id in ("toe-force", "heel-force"))
        assert f"{least:.1f}" == force
        survived = step_slope(other.loop(), other.gains, other.step).survived
        assert f"{math.degrees(survived):.2f}" == slope


def test_what_is_proved_is_what_the_readme_says():
    """As `poise prove` prints it: the bounds of the independent checker where there is one, rounded down."""
    from dataclasses import replace

    from design.present.proving import proved_in
    from design.spec.load import load
    from design.spec.setting import setting

    source = load("slope")
    problem = setting(source.spec)

    def proof(its):
        return proved_in(source, its, its.gains, ["ramp"], seconds=60.0)[0][0]

    def down(value):
        return f"{math.floor(1000 * value) / 1000:.3f}"

    paper = proof(problem)
    assert paper.checked
    assert f"at least {down(paper.value['heel-force'])} N under the heel" in README
    alone = proof(problem.with_law("pd"))
    assert f"the heel lifts at {alone.counterexample.time_s:.3f} s" in README
    by_load = proof(problem.with_law("cop"))
    assert f"`cop` is proved to keep {down(by_load.value['heel-force'])} N" in README
    follows = proof(replace(problem, adapt=0.1))
    assert f"`adapt_s = 0.1` {down(follows.value['toe-force'])} N" in README
