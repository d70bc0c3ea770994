"""A study gives the same rows wherever it runs, survives kill -9 and its workers' deaths, and refuses to mix."""

import json
import os
import random
import signal
import socket
import subprocess
import sys
import threading
import time
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design import workers
from design.errors import BadInput, Infrastructure
from design.model.laws import Gains
from design.present.journal import Journal
from design.spec.load import load, parse
from design.spec.setting import setting
from design.workers import Here, processes
from problems.comparison import conduct as conducted
from problems.comparison import study as asked
from problems.comparison.conduct import conduct, facts
from problems.comparison.study import COLUMNS_VERSION, Case, Task, perform, study, tasks
from problems.comparison.summary import interval, summary

ROOT = Path(__file__).resolve().parents[2]
SHORT = {"ramp_s = 5.0": "ramp_s = 1.0", "angle_deg = 30.0": "angle_deg = 3.0", "duration_s = 10.0": "duration_s = 1.5"}
NOISY = load("slope").text
for long, short in SHORT.items():
    NOISY = NOISY.replace(long, short)
NOISY += (
    "\n[noise]\nangle_deg = 0.02\nrate_deg_per_s = 0.1\nforce_n = 2.0\n[uncertainty]\nmass_kg = { percent = 5.0 }\n"
)
GAINS = Gains(3500.0, 1200.0, 1.0)
CASE = Case(text=NOISY, seed=7, gains=(("force", GAINS), ("cop", GAINS)))
NAMES = ["force", "mpc", "mpc-preview"]


def _problem(text=NOISY):
    return setting(parse(text, origin="noisy").spec)


def _todo(trials=4):
    return [task for task in tasks(_problem(), NAMES, trials) if task.trial is not None]


def _timeless(rows):
    """Rows as they must be equal: without computing times, in order."""
    plain = [{key: value for key, value in row.items() if key != "seconds"} for row in rows]
    return sorted(plain, key=lambda row: (row["controller"], row["scenario"], row["trial"] or 0, row["trial"] is None))


ALONE = _timeless(study(CASE, _todo(), Here, 1))


@pytest.mark.parametrize("workers", [1, 2])
def test_the_rows_are_the_same_for_any_number_of_workers(workers):
    assert _timeless(study(CASE, _todo(), lambda: processes(workers), 2 * workers)) == ALONE


def test_the_rows_are_the_same_in_another_order():
    shuffled = _todo()
    random.Random(3).shuffle(shuffled)
    assert _timeless(study(CASE, shuffled, Here, 1)) == ALONE


@contextmanager
def _cluster(folder):
    """A real scheduler and two real workers, each a process of its own; the second has two threads."""
    distributed = pytest.importorskip("distributed", reason="distributed is not installed")
    quiet = {
        "cwd": folder, "env": {**os.environ, "PYTHONPATH": str(ROOT)}, "stdout": subprocess.DEVNULL,
        "stderr": subprocess.DEVNULL,
    }  # fmt: skip
    python = [sys.executable, "-W", "ignore", "-m"]
    where = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", "scheduler.json"]
    scheduler = subprocess.Popen([*python, "distributed.cli.dask_scheduler", *where], **quiet)
    file = folder / "scheduler.json"
    deadline = time.monotonic() + 60
    while not file.exists() and time.monotonic() < deadline:
        time.sleep(0.1)
    address = json.loads(file.read_text())["address"]
    worker = [*python, "distributed.cli.dask_worker", address, "--no-dashboard", "--no-nanny", "--nthreads"]
    members = [subprocess.Popen([*worker, threads], **quiet) for threads in ("1", "2")]
    with distributed.Client(address, set_as_default=False) as client:
        client.wait_for_workers(2, timeout=60)
    try:
        yield address, scheduler
    finally:
        for process in (*members, scheduler):
            process.terminate()
        for process in (*members, scheduler):
            try:
                process.wait(timeout=20)
            except subprocess.TimeoutExpired:  # a worker without a scheduler takes its time
                process.kill()
                process.wait()


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """The address of a scheduler with two workers."""
    with _cluster(tmp_path_factory.mktemp("dask")) as (address, _):
        yield address


@pytest.mark.filterwarnings("ignore")
def test_the_rows_are_the_same_on_a_dask_cluster(cluster):
    source = parse(NOISY, origin="noisy")
    problem = replace(_problem(), study=_problem().study.model_copy(update={"trials": 3, "seed": 7}))
    there = conduct(source, problem, ["force", "mpc"], dask=cluster)
    here = conduct(source, problem, ["force", "mpc"], jobs=1)
    assert _timeless(there.rows) == _timeless(here.rows)


@pytest.mark.filterwarnings("ignore")
def test_where_no_scheduler_answers_one_line_says_so():
    with pytest.raises(BadInput, match="no scheduler answers"):
        conduct(parse(NOISY, origin="noisy"), _problem(), ["force"], dask="tcp://127.0.0.1:9")


@pytest.mark.filterwarnings("ignore")
def test_something_that_listens_and_never_answers_is_given_up():
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        began = time.monotonic()
        with pytest.raises(BadInput, match=r"no scheduler answers.*timed out"):
            conduct(parse(NOISY, origin="noisy"), _problem(), ["force"], dask=f"127.0.0.1:{silent.getsockname()[1]}")
        assert time.monotonic() - began < 60


# ---- failures


def _dies(case, task):
    """A worker that is killed by one of its tasks."""
    if task == Task(controller="force", scenario="ramp", trial=1):
        os.kill(os.getpid(), signal.SIGKILL)
    return perform(case, task)


def test_a_worker_that_dies_costs_one_row_and_no_other(monkeypatch):
    monkeypatch.setattr(asked, "perform", _dies)
    rows = list(study(CASE, _todo(), lambda: processes(2), 4))
    crashed = [row for row in rows if row["status"] == "crashed"]
    assert [(row["controller"], row["trial"]) for row in crashed] == [("force", 1)]
    assert _timeless(row for row in rows if row["status"] != "crashed") == [
        row for row in ALONE if (row["controller"], row["trial"]) != ("force", 1)
    ]


def test_a_trial_that_raises_is_a_row_that_says_why():
    rows = list(study(CASE, [Task(controller="pd", scenario="ramp", trial=0), *_todo(1)], Here, 1))
    assert rows[0] == {
        "controller": "pd", "scenario": "ramp", "trial": 0, "status": "failed", "why": "ValueError: pd has no gains",
    }  # fmt: skip
    assert [row["status"] for row in rows[1:]] == ["kept"] * 3


class _Breaks(Executor):
    """An executor whose every task takes the pool with it."""

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        future.set_exception(BrokenExecutor("gone"))
        return future


def test_an_executor_that_always_breaks_ends_the_study_with_a_row_for_each_task():
    rows = list(study(CASE, _todo(2), _Breaks, 2))
    assert [row["status"] for row in rows] == ["crashed"] * 6
    found = summary(rows, "force")
    assert found["mpc"]["failed"] == 2
    assert found["mpc"]["contact_force_n"] == {"min": None, "median": None}


def _stops(case, task):
    """A worker that is stopped by one of its tasks, as by Ctrl-Z."""
    if task == Task(controller="force", scenario="ramp", trial=1):
        os.kill(os.getpid(), signal.SIGSTOP)
    return perform(case, task)


def _never_ends(case, task):
    if task == Task(controller="force", scenario="ramp", trial=1):
        time.sleep(1000.0)
    return perform(case, task)


@pytest.mark.slow
@pytest.mark.parametrize(("fault", "silence", "limit"), [(_stops, 4.0, 600.0), (_never_ends, 600.0, 10.0)])
def test_a_worker_that_stops_or_hangs_is_ended_and_costs_one_row(monkeypatch, fault, silence, limit):
    monkeypatch.setattr(asked, "perform", fault)
    monkeypatch.setattr(workers, "SILENCE_S", silence)
    todo = [task for task in _todo() if task.controller == "force"]
    rows = list(study(CASE, todo, lambda: processes(2), 4, limit=limit))
    crashed = [row for row in rows if row["status"] == "crashed"]
    assert [(row["controller"], row["trial"]) for row in crashed] == [("force", 1)]
    assert len(rows) == len(todo)


@pytest.mark.parametrize("fault", [CancelledError(), MemoryError(), ConnectionResetError("scheduler")])
def test_what_befalls_the_infrastructure_is_never_a_row(fault):
    class Lost(Executor):
        def submit(self, fn, /, *args, **kwargs):
            future = Future()
            future.set_exception(fault)
            return future

    with pytest.raises(Infrastructure):
        list(study(CASE, _todo(1), Lost, 2))


def _killed_midway(process, journal):
    """End ``process`` once the journal holds some rows."""
    while not journal.exists() or journal.read_bytes().count(b"\n") < 10:
        time.sleep(0.02)
    process.kill()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_a_lost_scheduler_stops_the_study_which_ends_on_another_with_the_rows_of_an_undisturbed_run(
    tmp_path_factory, tmp_path, monkeypatch
):
    monkeypatch.setattr(conducted, "CLUSTER_LIMIT_S", 3.0)
    source = parse(NOISY, origin="noisy")
    problem = replace(_problem(), study=_problem().study.model_copy(update={"trials": 60, "seed": 7}))
    undisturbed = conduct(source, problem, ["force", "mpc"], jobs=2)
    with _cluster(tmp_path_factory.mktemp("lost")) as (address, scheduler):
        threading.Thread(target=_killed_midway, args=(scheduler, tmp_path / "study" / "trials.jsonl")).start()
        with pytest.raises(Infrastructure, match=r"scheduler|not run"):
            conduct(source, problem, ["force", "mpc"], dask=address, folder=str(tmp_path / "study"))
    with _cluster(tmp_path_factory.mktemp("other")) as (address, _):
        there = conduct(source, problem, ["force", "mpc"], dask=address, folder=str(tmp_path / "study"), resume=True)
    assert 0 < there.journal["resumed"] < len(there.rows)
    assert _timeless(there.rows) == _timeless(undisturbed.rows)


# ---- kill -9


def _command(folder, *more):
    return [
        sys.executable, str(ROOT / "cli.py"), "study", str(folder.parent / "spec.toml"), "--controllers",
        "force,mpc", "--trials", "12", "--jobs", "2", "-o", str(folder), *more,
    ]  # fmt: skip


def _rows(folder):
    lines = (folder / "trials.jsonl").read_text(encoding="utf-8").splitlines()[1:]
    return _timeless(json.loads(line)["row"] for line in lines)


@pytest.mark.slow
def test_killed_twenty_times_it_ends_with_the_rows_of_an_undisturbed_run(tmp_path):
    (tmp_path / "spec.toml").write_text(NOISY, encoding="utf-8")
    whole = tmp_path / "whole"
    subprocess.run(_command(whole), check=True, capture_output=True)
    killed, draw = tmp_path / "killed", random.Random(11)
    deaths = 0
    while deaths < 20:
        more = ["--resume"] if (killed / "trials.jsonl").exists() else []
        process = subprocess.Popen(
            _command(killed, *more), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
        )
        try:
            process.wait(timeout=draw.uniform(0.3, 3.2))
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        deaths += 1
    subprocess.run(_command(killed, "--resume"), check=True, capture_output=True)
    assert _rows(killed) == _rows(whole)
    summaries = [json.loads((folder / "summary.json").read_text()) for folder in (killed, whole)]
    for each in summaries:
        for one in each["controllers"].values():
            one.pop("step_ms")
    assert summaries[0] == summaries[1]


def test_an_interrupt_keeps_what_has_ended_and_says_how_to_go_on(tmp_path):
    (tmp_path / "spec.toml").write_text(NOISY, encoding="utf-8")
    folder = tmp_path / "study"
    process = subprocess.Popen(_command(folder, "--trials", "4000"), stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        if (folder / "trials.jsonl").exists() and len((folder / "trials.jsonl").read_text().splitlines()) > 6:
            break
        time.sleep(0.05)
    process.send_signal(signal.SIGTERM)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 143
    assert b"continue with --resume" in said
    assert b"Traceback" not in said
    assert len(_rows(folder)) > 5


def test_a_changed_study_is_refused_and_an_unchanged_one_has_nothing_left_to_do(tmp_path):
    source, problem = parse(NOISY, origin="noisy"), _problem()
    small = replace(problem, study=problem.study.model_copy(update={"trials": 1}))
    folder = str(tmp_path / "study")
    first = conduct(source, small, ["force"], folder=folder)
    again = conduct(source, small, ["force"], folder=folder, resume=True)
    assert again.journal["resumed"] == len(first.rows) == 3
    assert again.rows == first.rows
    with pytest.raises(BadInput, match="--resume"):
        conduct(source, small, ["force"], folder=folder)
    with pytest.raises(BadInput, match="controllers"):
        conduct(source, small, ["force", "mpc"], folder=folder, resume=True)
    with pytest.raises(BadInput, match="seed"):
        other = replace(small, study=small.study.model_copy(update={"seed": 1}))
        conduct(source, other, ["force"], folder=folder, resume=True)
    changed = NOISY.replace("kd = 1200.0", "kd = 1100.0")
    with pytest.raises(BadInput, match="spec"):
        conduct(parse(changed, origin="noisy"), _problem(changed), ["force"], folder=folder, resume=True)


def test_a_study_of_an_earlier_version_is_refused_in_a_line_that_says_what_its_rows_lack(tmp_path):
    source, problem = parse(NOISY, origin="noisy"), _problem()
    small = replace(problem, study=problem.study.model_copy(update={"trials": 1}))
    conduct(source, small, ["force"], folder=str(tmp_path))
    journal = tmp_path / "trials.jsonl"
    head, *rest = journal.read_text(encoding="utf-8").splitlines(keepends=True)
    identity = json.loads(head)["identity"]
    assert identity.pop("columns") == COLUMNS_VERSION
    identity.pop("weights")
    journal.write_text("".join([json.dumps({"journal": 1, "identity": identity}) + "\n", *rest]), encoding="utf-8")
    with pytest.raises(BadInput, match=r"columns was absent, now 2") as refused:
        conduct(source, small, ["force"], folder=str(tmp_path), resume=True)
    assert "\n" not in str(refused.value)


def test_more_trials_of_the_same_study_can_be_added(tmp_path):
    source, problem = parse(NOISY, origin="noisy"), _problem()
    folder = str(tmp_path / "study")
    few = replace(problem, study=problem.study.model_copy(update={"trials": 1}))
    more = replace(problem, study=problem.study.model_copy(update={"trials": 3}))
    conduct(source, few, ["force"], folder=folder)
    found = conduct(source, more, ["force"], folder=folder, resume=True)
    assert found.journal["resumed"] == 3
    assert len(found.rows) == 5


def _small_study(folder, **how):
    problem = _problem()
    small = replace(problem, study=problem.study.model_copy(update={"trials": 1}))
    return conduct(parse(NOISY, origin="noisy"), small, ["force"], folder=str(folder), **how), small


def test_rows_of_another_version_of_the_code_are_not_mixed_and_a_study_can_begin_anew(tmp_path, monkeypatch):
    first, _ = _small_study(tmp_path / "study")
    monkeypatch.setattr(conducted, "code", lambda: "another")
    with pytest.raises(BadInput, match=r"versions\.code was .*, now"):
        _small_study(tmp_path / "study", resume=True)
    anew, _ = _small_study(tmp_path / "study", force_new=True)
    assert anew.journal["resumed"] == 0
    assert _timeless(anew.rows) == _timeless(first.rows)
    assert (tmp_path / "study" / "trials.jsonl.old").exists()


def test_lines_that_do_not_count_are_counted_and_named_and_their_trials_run_again(tmp_path):
    first, problem = _small_study(tmp_path / "study")
    path = tmp_path / "study" / "trials.jsonl"
    with Journal.open(tmp_path / "study", json.loads(path.read_bytes().splitlines()[0])["identity"], resume=True) as j:
        j.append(first.rows[0])  # twice the same trial
        j.append({"controller": "force"})  # not a whole row
    head, *lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join([head, lines[0][:-9] + b"x" + lines[0][-8:], *lines[1:], lines[1][:20]]))
    with pytest.raises(BadInput, match="--repair"):
        _small_study(tmp_path / "study", resume=True)
    again, _ = _small_study(tmp_path / "study", resume=True, repair=True)
    assert again.journal == {"resumed": 3, "torn": 1, "damaged": 1, "incomplete": 1, "duplicated": 0}
    assert _timeless(again.rows) == _timeless(first.rows)
    assert "1 torn, 1 damaged, 1 incomplete" in facts(again, problem)["remark"]
    assert (tmp_path / "study" / "trials.jsonl.damaged").exists()


# ---- what is asked, and what is said


def test_what_cannot_be_built_is_left_out_with_its_reason_and_nothing_left_is_an_error():
    bare = NOISY.replace("kp = 3500.0", "# kp").replace("kd = 1200.0", "# kd")
    problem = _problem(bare)
    small = replace(problem, study=problem.study.model_copy(update={"trials": 1}))
    found = conduct(parse(bare, origin="bare"), small, ["force", "mpc"])
    assert found.controllers == ("mpc",)
    assert "no gains" in found.left_out["force"]
    assert facts(found, small)["left_out"] == found.left_out
    with pytest.raises(BadInput, match="none can be built"):
        conduct(parse(bare, origin="bare"), small, ["force"])


def test_an_unknown_controller_and_a_delay_between_periods_are_bad_input():
    source = parse(NOISY, origin="noisy")
    with pytest.raises(BadInput, match="allowed: pd, force"):
        conduct(source, _problem(), ["pid"])
    late = NOISY.replace("\n[noise]", "\n[noise]\ndelay_s = 0.007")
    with pytest.raises(BadInput, match=r"multiple of study.control_period_s = 0.005"):
        conduct(parse(late, origin="late"), _problem(late), ["force"])


@given(st.integers(0, 10**6), st.integers(8, 60), st.floats(-50, 50))
@settings(max_examples=30, deadline=None)
def test_an_interval_holds_its_mean_and_moves_with_the_differences(seed, count, shift):
    differences = np.random.default_rng(seed).normal(3.0, 20.0, count)
    found, moved = interval(differences), interval(differences + shift)
    assert found["pairs"] == count
    assert found["low"] < found["mean"] < found["high"]
    assert moved["low"] - shift == pytest.approx(found["low"], abs=0.5)
    assert moved["high"] - shift == pytest.approx(found["high"], abs=0.5)


def test_intervals_cover_the_truth_about_as_often_as_they_say():
    rng = np.random.default_rng(5)
    hits = 0
    for _ in range(200):
        found = interval(rng.normal(1.0, 2.0, 25))
        hits += found["low"] <= 1.0 <= found["high"]
    assert 0.88 <= hits / 200 <= 0.99


@pytest.mark.parametrize("differences", [[], [1.0], [1.0, 2.0]])
def test_too_few_pairs_have_no_interval(differences):
    found = interval(np.array(differences))
    assert found["low"] is None
    assert found["pairs"] == len(differences)


def test_pairing_is_by_world():
    def row(controller, trial, force, status="kept"):
        return {
            "controller": controller, "scenario": "ramp", "trial": trial, "status": status, "contact_force_n": force,
            "tail_steps": 0, "law_steps": 0, "steps": 1,
        }  # fmt: skip

    worlds = np.random.default_rng(1).normal(0, 50, 12)
    rows = [row("a", k, 100 + world) for k, world in enumerate(worlds)]
    rows += [row("b", k, 103 + world + 0.1 * (k % 2)) for k, world in enumerate(worlds)][::-1]
    found = summary(rows, "a")["b"]["against"]["contact_force_n"]
    assert found["mean"] == pytest.approx(3.05)
    assert 3.0 <= found["low"] <= found["high"] <= 3.1  # the spread of worlds, 50 N, is gone
