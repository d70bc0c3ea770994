"""A journal keeps every row that was acknowledged, whatever kills its writer, and never mixes or alters rows."""

import errno
import json
import math
import os
import platform
import random
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from design.errors import BadInput
from design.present.journal import Journal, identity_differences

IDENTITY = {"spec": {"name": "slope", "sha256": "ab" * 32}, "seed": 1, "controllers": ["pd", "mpc"]}
KILLS = 20
ROOT = Path(__file__).resolve().parents[2]

NURSERY = """
import os, resource, sys, time
from design.present.journal import Journal
from tests.present.test_journal_survives import IDENTITY, row

say, write = lambda text: write(1, text.encode()), os.write

def in_parts(fd, data):
    time.sleep(0.0002)
    return write(fd, data[: 1 + len(data) // 3])

for line in sys.stdin:
    folder, limit, parts = line.split()
    if pid := os.fork():
        say(f"born {pid}\\n")
        say(f"ended {os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])}\\n")
        continue
    if int(limit):
        resource.setrlimit(resource.RLIMIT_FSIZE, (int(limit), int(limit)))
    if int(parts):
        os.write = in_parts
    try:
        journal = Journal.open(folder, IDENTITY, resume=True)
        while True:
            number = len(journal.rows)
            journal.append(row(number))
            say(f"kept {number}\\n")
    except BaseException as error:
        say(f"error {type(error).__name__}: {error}\\n")
    os._exit(0)
"""


def row(number):
    """A row unlike its neighbours, some of several pages of memory."""
    return {"trial": number, "controller": "η", "force": number / 7, "samples": "0123456789" * (1 + number % 5 * 500)}


class Nursery:
    """A process that forks writers, so that twenty of them need not load the libraries twenty times."""

    def __init__(self):
        self.process = subprocess.Popen(
            [sys.executable, "-c", NURSERY], cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.living = None

    def writer(self, folder, *, limit=0, parts=False):
        """The pid of a new process that appends rows to ``folder``, to ``limit`` bytes, or each by many writes."""
        self.process.stdin.write(f"{folder} {limit} {int(parts)}\n")
        self.process.stdin.flush()
        self.living = int(self.read_until("born")[-1].split()[1])
        return self.living

    def read_until(self, start):
        lines = []
        while not lines or not lines[-1].startswith(start):
            lines.append(self.process.stdout.readline())
            assert lines[-1], "the nursery died"
            self.living = None if lines[-1].startswith("ended") else self.living
        return lines

    def kill(self, pid):
        """Kill -9; gives what the writer had said and nobody had read."""
        os.kill(pid, signal.SIGKILL)
        said = self.read_until("ended")
        assert said.pop() == f"ended {-signal.SIGKILL}\n", said
        return said


@pytest.fixture(scope="module")
def nursery():
    made = Nursery()
    yield made
    if made.living:  # a test failed and left it, and it would write for ever
        os.kill(made.living, signal.SIGKILL)
    made.process.stdin.close()
    made.process.stdout.close()
    made.process.wait(10)


def _kept(said):
    return sum(line.startswith("kept") for line in said)


def _file(folder):
    return folder / "trials.jsonl"


def _write(folder, rows, identity=IDENTITY, *, resume=False):
    with Journal.open(folder, identity, resume=resume) as journal:
        for each in rows:
            journal.append(each)
    return _file(folder).read_bytes()


@contextmanager
def _refused(match, folder):
    """What is tried raises ``BadInput`` and leaves the journal as it was, and open to others."""
    before = _file(folder).read_bytes()
    with pytest.raises(BadInput, match=match):
        yield
    assert _file(folder).read_bytes() == before
    with pytest.raises(BadInput, match=r"already holds|is not the first line|is 2"):
        Journal.open(folder, IDENTITY, resume=False)


SHORT = [{"trial": n, "lost": n == 1, "note": "η\n"} for n in range(4)]


def test_no_acknowledged_row_is_lost_when_the_writer_is_killed_twenty_times(tmp_path, nursery):
    chance = random.Random(9)
    folder, there, torn, added = tmp_path / "killed", 0, 0, set()
    for turn in range(KILLS):
        pid = nursery.writer(folder, parts=turn % 2 == 1)
        said = [nursery.read_until(("kept", "error"))[-1] for _ in range(chance.randrange(12))]
        time.sleep(chance.uniform(0, 0.01))
        said += nursery.kill(pid)
        acknowledged = there + _kept(said)
        with Journal.open(folder, IDENTITY, resume=True) as journal:
            assert journal.rows == [row(n) for n in range(len(journal.rows))]
            # one more may be there: written whole, and killed before it could be said
            assert acknowledged <= len(journal.rows) <= acknowledged + 1
            assert journal.torn in (0, 1)
            torn += journal.torn
            added.add(len(journal.rows) - there)
            there = len(journal.rows)
    assert torn, "no kill fell into a write: this test has not tested enough"
    assert len(added) > 3, "the kills all came at the same moment"
    killed = _write(folder, [row(there)], resume=True)
    undisturbed = _write(tmp_path / "undisturbed", [row(n) for n in range(there + 1)])
    assert killed == undisturbed


def test_a_killed_holder_leaves_no_lock_and_a_living_one_is_named(tmp_path, nursery):
    pid = nursery.writer(tmp_path)
    nursery.read_until("kept")
    os.kill(pid, signal.SIGSTOP)
    began = time.monotonic()
    for resume in (False, True):
        with pytest.raises(BadInput, match=f"in use by process {pid} on {platform.node()}"):
            Journal.open(tmp_path, IDENTITY, resume=resume)
    assert time.monotonic() - began < 1
    nursery.kill(pid)
    with Journal.open(tmp_path, IDENTITY, resume=True) as journal:
        with pytest.raises(BadInput, match=f"in use by process {os.getpid()} "):
            Journal.open(tmp_path, IDENTITY, resume=True)
        journal.append(row(len(journal.rows)))
    Journal.open(tmp_path, IDENTITY, resume=True).close()


def test_a_full_disk_ends_the_journal_and_what_was_kept_before_stays(tmp_path, nursery):
    nursery.writer(tmp_path, limit=30_000)
    said = nursery.read_until("ended")
    assert said[-1] == "ended 0\n"
    assert "cannot be written: File too large; make room, then continue with --resume" in said[-2]
    assert _file(tmp_path).stat().st_size == 30_000  # so a part of the last row was written
    with Journal.open(tmp_path, IDENTITY, resume=True) as journal:
        assert journal.torn == 1
        assert journal.rows == [row(n) for n in range(_kept(said))]
        assert len(journal.rows) > 2


def test_after_a_write_that_failed_no_row_follows_the_torn_one(tmp_path, monkeypatch):
    write = os.write

    def fails(fd, data):
        if len(data) < 30:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(fd, data[:-20])

    journal = Journal.open(tmp_path, IDENTITY, resume=False)
    journal.append(SHORT[0])
    with monkeypatch.context() as patch:
        patch.setattr("design.present.journal.os.write", fails)
        with pytest.raises(BadInput, match="cannot be written: No space left on device; make room, then continue"):
            journal.append(SHORT[1])
    with pytest.raises(ValueError, match="closed"):
        journal.append(SHORT[1])
    with Journal.open(tmp_path, IDENTITY, resume=True) as journal:
        assert (journal.rows, journal.torn) == (SHORT[:1], 1)


@pytest.mark.parametrize(("least_s", "count"), [(0, 4), (3600, 1)])
def test_rows_are_brought_to_the_disk_from_time_to_time_and_at_the_end(tmp_path, monkeypatch, least_s, count):
    synced = []
    with Journal.open(tmp_path, IDENTITY, resume=False) as journal:
        monkeypatch.setattr("design.present.journal.SYNC_S", least_s)
        monkeypatch.setattr("design.present.journal.os.fsync", lambda fd: synced.append(os.fstat(fd).st_size))
        for each in SHORT:
            journal.append(each)
    assert len(synced) == count
    assert synced[-1] == _file(tmp_path).stat().st_size


def test_a_write_in_parts_is_a_whole_line(tmp_path, monkeypatch):
    whole = _write(tmp_path / "whole", SHORT)
    write = os.write
    monkeypatch.setattr("design.present.journal.os.write", lambda fd, data: write(fd, data[:7]))
    assert _write(tmp_path / "parts", SHORT) == whole


def test_a_journal_cut_anywhere_continues_with_a_prefix_of_its_rows(tmp_path):
    data = _write(tmp_path, SHORT)
    ends = [at + 1 for at, byte in enumerate(data) if byte == ord("\n")]
    for cut in range(len(data) + 1):
        _file(tmp_path).write_bytes(data[:cut])
        with Journal.open(tmp_path, IDENTITY, resume=True) as journal:
            there = max(0, sum(end <= cut for end in ends) - 1)
            assert journal.rows == SHORT[:there], cut
            assert journal.torn == (cut not in (0, *ends)), cut
            for each in SHORT[there:]:
                journal.append(each)
        assert _file(tmp_path).read_bytes() == data, cut


def test_a_study_killed_in_its_first_line_begins_anew_even_as_another(tmp_path):
    head = _write(tmp_path, [])
    for cut in (0, 1, 5, 20, len(head) - 1):
        _file(tmp_path).write_bytes(head[:cut])
        other = _write(tmp_path, SHORT[:1], {"seed": 2})
        assert other.startswith(b'{"journal": 1, "identity": {"seed": 2}}\n{"crc": ')


def test_every_flipped_byte_of_a_middle_line_is_refused_with_its_line_number(tmp_path):
    data = _write(tmp_path, SHORT)
    lines = data.splitlines(keepends=True)
    start = len(lines[0]) + len(lines[1])
    for at in range(start, start + len(lines[2])):
        flip = 1 << at % 8
        _file(tmp_path).write_bytes(data[:at] + bytes([data[at] ^ flip]) + data[at + 1 :])
        with _refused("trials.jsonl: line 3: is damaged.* --repair", tmp_path):
            Journal.open(tmp_path, IDENTITY, resume=True)
    _file(tmp_path).write_bytes(b"".join(lines[:2] + lines[3:]))
    with Journal.open(tmp_path, IDENTITY, resume=True) as journal:
        assert journal.rows == SHORT[:1] + SHORT[2:]


def test_a_damaged_line_is_refused_before_a_torn_tail_is_cut(tmp_path):
    data = _write(tmp_path, SHORT)
    _file(tmp_path).write_bytes(data.replace(b'"trial": 2', b'"trial": 7')[:-3])
    with _refused("line 4: is damaged", tmp_path):
        Journal.open(tmp_path, IDENTITY, resume=True)


def test_a_journal_is_continued_only_when_asked(tmp_path):
    _write(tmp_path, SHORT)
    with _refused("already holds a study of 4 rows; continue it with --resume, or choose another folder", tmp_path):
        Journal.open(tmp_path, IDENTITY, resume=False)
    assert _write(tmp_path / "new", SHORT, resume=True) == _file(tmp_path).read_bytes()


def test_rows_of_another_study_are_not_mixed_in(tmp_path):
    _write(tmp_path, SHORT)
    other = {**IDENTITY, "spec": {"name": "slope", "sha256": "ab" * 31 + "cd"}, "seed": 2}
    differences = r"sha256 was …[ab]*ab\", now …[ab]*cd\"; seed was 1, now 2; rows of two studies are not mixed"
    with _refused(differences, tmp_path):
        Journal.open(tmp_path, other, resume=True)


@pytest.mark.parametrize(
    ("stored", "present", "found"),
    [
        (IDENTITY, json.loads(json.dumps(IDENTITY)), []),
        ({"a": (1, 2.0), "n": math.nan}, {"n": None, "a": np.array([1.0, 2.0])}, []),
        ({"gains": {"kp": 3500, "kd": 1}}, {"gains": {"kp": 3400.0, "kd": 1.0}}, ["gains.kp was 3500, now 3400"]),
        ({"a": 1}, {"a": True}, ["a was 1, now true"]),
        ({"a": "absent"}, {}, ['a was "absent", now absent']),
        ({"a": {}}, {"a": {"b": 1}}, ["a was {}, now absent", "a.b was absent, now 1"]),
        ({"law": ["pd", "mpc"]}, {"law": ["pd"]}, ['law.1 was "mpc", now absent']),
        ({}, {"long": "x" * 99}, ['long was absent, now "' + "x" * 39 + "…"]),
    ],
)
def test_identities_differ_by_dotted_keys(stored, present, found):
    assert identity_differences(stored, present) == found


def test_rows_are_read_back_as_they_are_held(tmp_path):
    odd = {
        "η": "½\u2028\r\n\x00😀",
        "half": "\ud83d",
        "two": "\ud83d\ude00",
        "nan": math.nan,
        "inf": [np.inf, -0.0, 1e-320],
    }
    data = _write(tmp_path, [odd, {}, {"array": np.arange(2), "big": 2**70, 3: None}])
    with Journal.open(tmp_path, IDENTITY, resume=True) as journal:
        assert journal.rows == [
            {**odd, "two": "😀", "nan": None, "inf": [None, -0.0, 1e-320]},
            {},
            {"array": [0, 1], "big": 2**70, "3": None},
        ]
        held = Journal.open(tmp_path / "again", IDENTITY, resume=True)
        for each in journal.rows:
            held.append(each)
        assert held.rows == journal.rows
        held.close()
    assert _file(tmp_path / "again").read_bytes() == data
    assert "½" in data.decode() and b"NaN" not in data


def test_a_closed_journal_takes_no_row(tmp_path):
    with Journal.open(tmp_path, IDENTITY, resume=False) as journal:
        journal.close()
    with pytest.raises(ValueError, match="closed"):
        journal.append({})


def _no_parent(folder):
    return folder / "missing" / "study"


def _a_file(folder):
    (folder / "file").touch()
    return folder / "file"


def _not_writable(folder):
    return "/proc/self"


def _a_folder_in_the_way(folder):
    _file(folder).mkdir()
    return folder


@pytest.mark.parametrize("place", [_no_parent, _a_file, _not_writable, _a_folder_in_the_way])
def test_where_no_journal_can_be_the_input_is_bad(tmp_path, place):
    with pytest.raises(BadInput, match=r"cannot hold a study: .* is needed; choose another place"):
        Journal.open(place(tmp_path), IDENTITY, resume=True)


@pytest.mark.parametrize(
    ("content", "match"),
    [
        ("trial,force\n1,2\n", "line 1: is not the first line of a journal"),
        ("trial", "line 1: is not the first line of a journal"),
        ("[]\n", "line 1: is not the first line of a journal"),
        ('{"journal": 2, "identity": {}}\n', "journal: is 2; this Poise continues 1"),
    ],
)
def test_a_file_of_anyone_elses_is_left_alone(tmp_path, content, match):
    _file(tmp_path).write_text(content, encoding="utf-8")
    with _refused(match, tmp_path):
        Journal.open(tmp_path, IDENTITY, resume=True)
