"""Where the spec asks no decay rate a design settles all the same, if some design does; and it is said."""

from dataclasses import replace

import numpy as np
import pytest

from design.analysis.synthesis import Settling
from design.analysis.verdict import judge, worst
from design.model.limits import Required
from design.present.synthesis import text
from design.spec.load import load
from design.spec.setting import setting
from problems import gains, settling

QUIET = """
schema_version = 1
name = "quiet"
[body]
mass_kg = 70.0
com_height_m = 0.93
[foot]
mass_kg = 2.0
toe_m = 0.19
heel_m = 0.07
ankle_height_m = 0.068
[[scenarios]]
name = "platform"
kind = "platform"
acceleration_mps2 = [[0.0, 0.0], [0.1, 0.6], [0.4, 0.6], [0.6, -0.6], [0.9, -0.6], [1.0, 0.0]]
duration_s = 6.0
[law]
kind = "force"
cop_target_m = 0.045
[requirements]
contact_force_n = 0.0
[synthesis]
maximise = "contact-force"
[synthesis.bounds]
kp = [0.0, 3000.0]
kd = [0.0, 1500.0]
kf = [0.0, 5.0]
"""


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    path = tmp_path_factory.mktemp("spec") / "quiet.toml"
    path.write_text(QUIET)
    return load(str(path))


def test_what_is_required_leaves_five_per_cent_at_the_end(source):
    quiet = setting(source.spec)
    assert not quiet.decay_asked
    assert np.exp(-settling.default_decay(quiet) * (6.0 - 1.0)) == pytest.approx(0.05, rel=0.01)
    assert setting(load("slope").spec).decay_asked  # 0.0 is written there


@pytest.mark.slow
def test_the_best_contact_force_hardly_settles_and_the_answer_does(source):
    quiet = setting(source.spec)
    alone = gains.solve(quiet).outcome.value
    assert worst(alone.verdict.rows, "decay-rate").value < 0.1
    settled, answer = settling.solve(quiet)
    design, rate = answer.outcome.value, settling.default_decay(quiet)
    assert worst(judge(quiet, design.gains).rows, "decay-rate").value >= rate * (1 - 1e-9)
    assert settled.required["decay-rate"].level == rate
    assert answer.settling.kept and answer.settling.value == pytest.approx(alone.value, rel=1e-3)
    assert "asks no decay rate" in text(source, settled, answer, lambda words, _: words)


@pytest.mark.slow
def test_what_is_feasible_stays_so_where_nothing_settles(source, monkeypatch):
    monkeypatch.setattr(settling, "default_decay", lambda _: 50.0)
    quiet = setting(source.spec)
    same, answer = settling.solve(quiet)
    assert same is quiet and answer.outcome.found is not None and not answer.settling.kept
    said = " ".join(text(source, same, answer, lambda words, _: words).split())
    assert "practically never settles" in said


def test_a_spec_that_asks_for_a_decay_rate_of_zero_gets_no_other():
    slope = setting(load("slope").spec)
    same, answer = settling.solve(replace(slope, required={**slope.required, "decay-rate": Required(level=0.0)}))
    assert answer.settling is None and same.required["decay-rate"].level == 0.0


def test_the_words_have_both_numbers(source):
    quiet = setting(source.spec)
    found = replace(
        gains.solve(setting(load("slope").spec)), settling=Settling(required=0.6, value=26.06, decay=6e-7, kept=True)
    )
    said = " ".join(text(source, quiet, found, lambda words, _: words).split())
    assert "0.6 1/s" in said and "26.06" in said and "6e-07" in said
