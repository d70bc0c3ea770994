"""Drop-outs, lifted feet, missing samples and damaged files: masked by the plate that has them, or one line."""

import io
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from c3d_writer import c3d
from hypothesis import given, settings
from hypothesis import strategies as st

from design.errors import BadInput
from design.model.body import Biped
from design.recordings import c3d as c3d_files
from design.recordings import c3d_reader
from design.recordings.clock import _rounded_rate
from design.recordings.files import table_of
from design.recordings.reading import Reading
from design.recordings.record import open_record

BODY = Biped(M=68.0, L=0.92, I=70.0, m=2.0, ell=0.12)
N = 400
T = np.arange(N) / 100
FZ = 687 + 2 * np.cos(5 * T)
SHARE = 0.4 + 0.1 * np.sin(T)
COPS = 0.03 + 0.01 * np.sin(2 * T), 0.05 + 0.01 * np.sin(3 * T)


def text(names, *columns):
    return names + "\n" + "".join(",".join(f"{x:.8g}" for x in row) + "\n" for row in zip(*columns, strict=True))


def read(folder, content, biped=BODY, given=True, target=0.0, **how):
    path = folder / "trial.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return open_record(str(path), Reading(**how), biped, given=given, target=target)


@pytest.mark.parametrize("columns", [None, "fz=Fz1+Fz2,cop=COPx1+COPx2"])
def test_a_drop_out_of_one_plate_is_masked_and_a_lifted_foot_is_not(tmp_path, columns):
    loads = [SHARE * FZ, (1 - SHARE) * FZ]
    cops = [cop.copy() for cop in COPS]
    for plate, first, last in ((0, 50, 55), (1, 200, 203)):  # zeros, though the other plate bears no more
        loads[plate][first:last] = cops[plate][first:last] = 0.0
    lifted = slice(300, 340)
    loads[0][lifted], cops[0][lifted], loads[1][lifted] = 0.0, np.nan, FZ[lifted]
    record = read(tmp_path, text("Time,Fz1,COPx1,Fz2,COPx2", T, loads[0], cops[0], loads[1], cops[1]), columns=columns)
    assert np.flatnonzero(record.dropouts).tolist() == [*range(50, 55), *range(200, 203)]
    assert not record.gaps.any()
    truth = SHARE * COPS[0] + (1 - SHARE) * COPS[1]
    truth[lifted] = COPS[1][lifted]
    assert record.cop[record.valid] == pytest.approx(truth[record.valid], abs=1e-6)
    assert record.load[record.valid] == pytest.approx(FZ[record.valid], rel=1e-6)


def test_a_cop_that_is_missing_under_load_is_named_by_its_plate(tmp_path):
    cop = COPS[1].copy()
    cop[70] = np.nan
    content = text("Time,Fz1,COPx1,Fz2,COPx2", T, SHARE * FZ, COPS[0], (1 - SHARE) * FZ, cop)
    with pytest.raises(BadInput, match="line 72, column COPx2: is 'nan'"):
        read(tmp_path, content)
    assert np.flatnonzero(read(tmp_path, content, allow_gaps=True).gaps).tolist() == [70]


@pytest.mark.parametrize("start", [0, 100, 250])
def test_a_negative_force_that_begins_with_an_empty_plate_is_turned(tmp_path, start):
    empty = np.arange(N) < start
    load = np.where(empty, 0.4 * np.cos(40 * T), -FZ)
    moment = np.where(empty, 0.01, COPS[0] * FZ)
    record = read(tmp_path, text("Time,Fz,My", T, load, moment))
    assert (record.dropouts == empty).all()
    assert record.cop[~empty] == pytest.approx(COPS[0][~empty], abs=1e-6)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 3.4e38, -3e38])
@pytest.mark.parametrize("form", ["csv", "npy", "C3D"])
def test_a_number_that_cannot_be_is_refused_or_masked_in_every_format(tmp_path, value, form):
    load = FZ.copy()
    load[123] = value
    path = tmp_path / {"csv": "trial.csv", "npy": "trial.npy", "C3D": "trial.c3d"}[form]
    columns = None
    if form == "csv":
        path.write_text(text("Time,Fz,COPx", T, load, COPS[0]))
    elif form == "npy":
        np.save(path, np.column_stack([T, load, COPS[0]]))
        columns = "time=1,fz=2,cop=3"
    else:
        pytest.importorskip("ezc3d", reason="ezc3d is not installed")
        nil = 0 * T
        corners = 1e3 * np.array([[0.3, -0.3, -0.3, 0.3], [0.2, 0.2, -0.2, -0.2], [0, 0, 0, 0]])
        with np.errstate(over="ignore"):
            analog = np.stack([nil, nil, load, nil, -1e3 * COPS[0] * FZ, nil]).astype(np.float32)
        path.write_bytes(
            c3d(analog, rate=100.0, labels=list("abcdef"), units=["N"] * 3 + ["Nmm"] * 3, corners=[corners],
                origins=[[0, 0, 0]])
        )  # fmt: skip
    with pytest.raises(BadInput, match=r"(line 125|row 124|sample 124), column .*needs a number.*--allow-gaps"):
        open_record(str(path), Reading(columns=columns), BODY, given=True)
    record = open_record(str(path), Reading(columns=columns, allow_gaps=True), BODY, given=True)
    assert np.flatnonzero(~record.valid).tolist() == [123]
    assert record.load == pytest.approx(FZ, rel=1e-3)


@settings(max_examples=60, deadline=None)
@given(st.floats(20, 2000), st.integers(1, 4), st.floats(0, 100))
def test_rounded_stamps_give_the_rate_and_a_stamp_twice_does_not(rate, digits, start):
    stamps = np.round(start + np.arange(500) / rate, digits)
    found = _rounded_rate(stamps)
    quantum = 10.0**-digits
    apart = abs(1 / (rate * quantum) - round(1 / (rate * quantum)))
    if found is not None:
        assert found[0] == pytest.approx(rate, rel=max(1e-3, quantum * rate / 500))
    if 1 / rate < 3 * quantum and 0.03 < apart and 500 / rate > 30 * quantum:
        assert found is not None
    even = start + np.arange(500) / 100
    even[300:] -= 0.01
    assert _rounded_rate(np.round(even, 2)) is None
    even[300:] += 0.02
    assert _rounded_rate(np.round(even, 2)) is None


def test_a_thousand_hertz_in_two_digits_is_read(tmp_path):
    stamps = np.round(np.arange(N) / 1000, 2)
    record = read(tmp_path, text("Time,Fz,COPx", stamps, FZ, COPS[0]))
    assert record.rate == pytest.approx(1000, rel=1e-3)
    assert any("rounded to 0.01 s" in note for note in record.notes)


def test_a_cop_alone_tells_what_it_can(tmp_path):
    record = read(tmp_path, text("Time,CoPx,CoPy", T, COPS[0], COPS[1]))
    assert record.cop == pytest.approx(COPS[0], abs=1e-6)
    assert record.P == pytest.approx(COPS[0] - COPS[0].mean(), abs=1e-6)
    assert record.load is None
    assert record.F_T is None
    assert "the vertical force is missing" in record.warnings[0]
    with pytest.raises(BadInput, match="vertical force is missing of some"):
        read(tmp_path, text("Time,CoPx1,CoPx2", T, COPS[0], COPS[1]))


def test_a_load_of_both_signs_is_refused_and_not_masked_as_a_drop_out(tmp_path):
    for part in (0.1, 0.5, 0.8):
        content = text("Time,Fz,COPx", T, np.where(np.arange(N) < part * N, -FZ, FZ), COPS[0])
        with pytest.raises(BadInput, match="one sign"):
            read(tmp_path, content)


def test_the_sum_of_the_plates_is_not_added_to_them(tmp_path):
    loads = [SHARE * FZ, (1 - SHARE) * FZ]
    truth = SHARE * COPS[0] + (1 - SHARE) * COPS[1]
    names = "Time,Fz1,COPx1,Fz2,COPx2,Fz"
    record = read(tmp_path, text(names, T, loads[0], COPS[0], loads[1], COPS[1], FZ), given=False)
    assert record.load == pytest.approx(FZ, rel=1e-6)
    assert record.cop == pytest.approx(truth, abs=1e-6)
    assert any("Fz is the sum" in note for note in record.notes)


def test_a_balance_board_in_kilograms_with_uneven_stamps_is_read_as_proposed(tmp_path):
    stamps = T * 1.7 + 0.008 * np.sin(7 * np.arange(N))
    content = text("Time (s),Weight (kg),CoPx (cm),CoPy (cm)", stamps, FZ / 9.80665, 100 * COPS[0], 100 * COPS[1])
    with pytest.raises(BadInput, match=r"give --resample [\d.]+, or --rate"):
        read(tmp_path, content)
    record = read(tmp_path, content, resample=50.0)
    assert record.load == pytest.approx(np.interp(record.t, stamps, FZ), rel=1e-4)
    assert record.cop == pytest.approx(np.interp(record.t, stamps, COPS[0]), abs=1e-5)
    assert record.columns["fz"] == "Weight [kgf]"


def test_feet_that_seem_to_stand_behind_each_other_are_remarked_upon(tmp_path):
    loads = [SHARE * FZ, (1 - SHARE) * FZ]
    names = "Time,Fz1,COPx1,COPy1,Fz2,COPx2,COPy2"
    content = text(names, T, loads[0], 0 * T - 0.1, COPS[0], loads[1], 0 * T + 0.1, COPS[1])
    assert "side by side" in read(tmp_path, content).assumed[0]
    assert not any("side by side" in each for each in read(tmp_path, content, forward="y").assumed)


@pytest.mark.parametrize("skew", [0.0, 0.4, -0.3])
@pytest.mark.parametrize("target", [0.0, 0.02])
def test_the_assumed_ankle_puts_the_mean_cop_at_the_laws_target(tmp_path, skew, target):
    foot = Biped(M=68.0, L=0.92, I=70.0, m=2.0, ell=0.12, skew=skew)
    record = read(tmp_path, text("Time,Fz,COPx", T, FZ, COPS[0]), biped=foot, target=target)
    assert record.ankle_assumed
    assert record.P.mean() == pytest.approx(target, abs=1e-6)
    sentence = next(each for each in record.assumed if each.startswith("ankle"))
    equal = "mean of toe and heel force is equal" in sentence
    assert equal == (record.F_T.mean() == pytest.approx(record.F_H.mean(), rel=1e-3))
    if not equal:  # moments about the ankle: toe F_T = heel F_H + P load
        assert foot.toe * record.F_T - foot.heel * record.F_H == pytest.approx(record.P * record.load)
        assert f"{record.F_T.mean():.4g} and {record.F_H.mean():.4g} N" in sentence


@pytest.mark.parametrize(
    ("program", "words"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "the reader fails"),
        ("import time; time.sleep(60)", "within 0.6 s"),
        ("raise SystemExit(5)", "the reader fails"),
        ("import sys; sys.stderr.write('odd \\x1b[2J header'); raise SystemExit(5)", "odd"),
    ],
    ids=["crash", "hang", "silence", "message"],
)
def test_what_happens_to_the_reader_of_c3d_files_is_one_line(tmp_path, monkeypatch, program, words):
    pytest.importorskip("ezc3d", reason="ezc3d is not installed")
    script = tmp_path / "reader.py"
    script.write_text(program)
    monkeypatch.setattr(c3d_reader, "__file__", str(script))
    monkeypatch.setattr(c3d_files, "SECONDS", 0.3)
    content = bytearray(2048)
    content[0], content[1], content[515], content[16] = 2, 0x50, 84, 3
    begin = time.monotonic()
    with pytest.raises(BadInput) as refused:
        table_of(bytes(content), "trial.c3d", Reading())
    assert time.monotonic() - begin < 20
    assert words in str(refused.value)
    assert str(refused.value).isprintable()


def test_headers_reach_the_terminal_without_control_characters(tmp_path):
    content = text("Time,Fz\x1b]0;evil\x07,COPx\x1b[2J,Event\u202e", T, FZ, COPS[0], T)
    with pytest.raises(BadInput) as refused:
        read(tmp_path, content)
    assert str(refused.value).isprintable()
    table = table_of(content.encode(), "trial.csv", Reading())
    assert all(name.isprintable() for name in (*table.names, *table.detected))


@pytest.mark.parametrize("quoted", [True, False])
def test_a_cell_of_any_length_is_one_line(tmp_path, quoted):
    cell = "x" * 200_000
    content = text("Time,Fz,COPx", T, FZ, COPS[0]).replace(
        "\n", f'\n1,"{cell}",3\n' if quoted else f"\n1,{cell},3\n", 1
    )
    with pytest.raises(BadInput) as refused:
        read(tmp_path, content)
    assert len(str(refused.value)) < 2000
    with pytest.raises(BadInput, match="needs one row a line"):
        read(tmp_path, "1," * 1_000_000)


@pytest.mark.parametrize("skip", [-1, -5])
def test_a_negative_number_of_lines_is_not_skipped(tmp_path, skip):
    with pytest.raises(BadInput, match="0 or more"):
        read(tmp_path, text("Time,Fz,COPx", T, FZ, COPS[0]), skip_rows=skip)


def test_without_the_reader_of_spreadsheets_the_install_line_is_shown(monkeypatch):
    openpyxl = pytest.importorskip("openpyxl", reason="openpyxl is not installed")
    out = io.BytesIO()
    openpyxl.Workbook().save(out)
    with pytest.raises(BadInput, match="no sheet with rows of numbers"):
        table_of(out.getvalue(), "trial.xlsx", Reading())
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    with pytest.raises(BadInput, match=r"pip install 'poise\[xlsx\]'"):
        table_of(out.getvalue(), "trial.xlsx", Reading())


@pytest.mark.parametrize("drift", [0.0, 30.0])
@pytest.mark.parametrize("step", [0.02, 0.005])
def test_the_load_of_one_foot_is_told_from_a_body_without_a_spec(tmp_path, drift, step):
    t = np.arange(0, 40, step)
    height = 0.1 * np.sin(2 * np.pi * 0.3 * t)  # a body that bends its knees: m (g + y'')
    body = 70 * (9.81 - (2 * np.pi * 0.3) ** 2 * height) + drift * t / t[-1] + 2 * np.sin(40 * t)
    foot = body * (0.5 + 0.04 * np.sin(2 * np.pi * 0.12 * t))
    for load, warns in ((body, False), (foot, True)):
        path = tmp_path / "trial.csv"
        rows = zip(t, load, 0.05 + 0.01 * np.sin(t), strict=True)
        path.write_text("Time,Fz,COPx\n" + "\n".join(f"{a:.4f},{b:.5f},{c:.6f}" for a, b, c in rows))
        found = open_record(str(path), Reading(), BODY, given=False)
        assert any("one foot of two" in each for each in found.warnings) == warns


@pytest.mark.slow
def test_an_hour_at_a_thousand_hertz_takes_half_a_gigabyte(tmp_path):
    if not Path("/proc/self/status").exists():
        pytest.skip("the peak of a process's own memory is read from /proc")
    path = tmp_path / "hour.csv"
    with path.open("w") as file:
        file.write("Time [s],Fx [N],Fz [N],COPx [m]\n")
        for first in range(0, 3_600_000, 100_000):
            t = np.arange(first, first + 100_000) / 1000
            file.write(
                "\n".join(
                    f"{a:.3f},{c:.6f},{b:.8f},{c:.8f}"
                    for a, b, c in zip(t, 687 + np.sin(t), 0.01 * np.cos(t), strict=True)
                )
            )
            file.write("\n")
    program = (
        "import sys; import cli\n"
        "sys.argv = ['poise', 'estimate', sys.argv[1], '--format', 'csv', '-o', sys.argv[2]]\n"
        "try: cli.main()\n"
        "finally: print(*(line for line in open('/proc/self/status') if line.startswith('VmHWM')))"
    )
    root = Path(__file__).parents[2]
    command = [sys.executable, "-c", program, path, tmp_path / "out.csv"]
    ended = subprocess.run(command, capture_output=True, text=True, cwd=root, check=False)
    with (tmp_path / "out.csv").open("rb") as written:
        assert sum(1 for _ in written) == 3_600_001, ended.stderr
    assert int(ended.stdout.rpartition("VmHWM:")[2].split()[0]) < 500_000  # kB, and not the parent's peak
