"""Every fault of measured data ends in one line that says where and what to do, or in a mask that is counted."""

import io
import zipfile

import numpy as np
import pytest

from design.errors import BadInput
from design.model.body import Biped
from design.recordings import table
from design.recordings.reading import Reading
from design.recordings.record import open_record

BODY = Biped(M=68.0, L=0.92, I=70.0, m=2.0, ell=0.12)
N = 200
T = np.arange(N) / 100
COP = 0.03 * np.sin(2 * T)
FZ = 690 + 2 * np.cos(5 * T)
THETA = 0.02 * np.sin(2 * T)


def text(*columns, names="Time,Fz,COPx"):
    return (
        names + "\n" + "".join(",".join(f"{x:.6f}" for x in row) + "\n" for row in zip(*columns, strict=True))
    ).encode()


def read(path, content, given=True, **how):
    path.write_bytes(content)
    return open_record(str(path), Reading(**how), BODY, given=given)


def refusal(path, content, given=True, **how):
    with pytest.raises(BadInput) as caught:
        read(path, content, given, **how)
    said = str(caught.value)
    assert "\n" not in said
    return said


@pytest.fixture
def file(tmp_path):
    return tmp_path / "trial.csv"


def changed(**cells):
    """The plain table with some cells replaced: ``line_column="text"``."""
    lines = text(T, FZ, COP).decode().splitlines()
    for key, value in cells.items():
        line, column = (int(part) for part in key.removeprefix("at_").split("_"))
        row = lines[line - 1].split(",")
        row[column - 1] = value
        lines[line - 1] = ",".join(row)
    return "\n".join(lines).encode()


@pytest.mark.parametrize(
    ("cell", "said"), [("abc", "'abc'"), ("NaN", "'NaN'"), ("", "is empty"), ("inf", "'inf'"), ("1,2", "4 cells")]
)
def test_a_cell_that_is_no_number_is_named_by_line_and_column_or_masked(file, cell, said):
    content = changed(at_51_2=cell, at_80_2=cell)
    refused = refusal(file, content)
    assert "line 51" in refused
    assert said in refused
    assert "1 more" in refused
    if cell != "1,2":
        assert "column Fz" in refused
    found = read(file, content, allow_gaps=True)
    assert np.flatnonzero(found.gaps).tolist() == [49, 78]
    assert np.flatnonzero(~found.valid).tolist() == [49, 78]
    assert not found.dropouts.any()


def test_rows_without_load_are_masked_and_counted(file):
    load = FZ.copy()
    load[[20, 21, 22, 150]] = 0.0
    load[60] = 8.0
    cop = np.where(load < 10, 0.0, COP)
    found = read(file, text(T, load, cop))
    assert np.flatnonzero(found.dropouts).tolist() == [20, 21, 22, 60, 150]
    assert [count for *_, count in found.spans(found.dropouts)] == [3, 1, 1]
    assert found.load[found.valid].mean() == pytest.approx(np.delete(FZ, [20, 21, 22, 60, 150]).mean())


def test_a_plate_that_nobody_stands_on_is_refused(file):
    assert "zero in every row" in refusal(file, text(T, 0 * T, COP))


@pytest.mark.parametrize(
    ("stamps", "said"),
    [
        (np.where(np.arange(N) == 70, T[69], T), "repeats the time before"),
        (np.where(np.arange(N) == 70, T[60], T), "goes back"),
        (T + 0.5 * (np.arange(N) >= 70), "comes 0.51 s later"),
    ],
    ids=["duplicate", "backward", "hole"],
)
def test_irregular_time_stamps_are_refused_by_line_or_resampled_with_a_note(file, stamps, said):
    content = text(stamps, FZ, COP)
    refused = refusal(file, content)
    assert "line 72, column Time" in refused
    assert said in refused
    assert "--resample 100" in refused
    found = read(file, content, resample=50.0)
    assert np.diff(found.t) == pytest.approx(0.02)
    assert any("resampled to 50 Hz" in note for note in found.notes)
    if "later" in said:
        assert not found.valid[int(0.9 * 50)]
        assert found.valid[-1]
    else:
        assert found.valid.all()
    told = read(file, content, rate=100.0)
    assert told.t == pytest.approx(T)
    assert any("column Time is not used" in note for note in told.notes)


def test_a_column_of_dates_is_refused_unless_the_rate_is_given(file):
    lines = ["Time,Fz,COPx", *(f"10:47:{t:06.3f},{z:.4f},{p:.6f}" for t, z, p in zip(T, FZ, COP, strict=True))]
    content = "\n".join(lines).encode()
    assert "--rate" in refusal(file, content)
    assert read(file, content, rate=100.0).t == pytest.approx(T)


def test_rounded_time_stamps_are_regular(file):
    found = read(file, text(np.round(T / 1.2, 3), FZ, COP))
    assert found.rate == pytest.approx(120, rel=1e-3)


@pytest.mark.parametrize("count", [1, 3, 7, 15])
def test_a_recording_shorter_than_the_window_is_refused(file, count):
    assert "too short" in refusal(file, text(T[:count], FZ[:count], COP[:count])) or count == 1


def test_a_force_on_the_plate_is_turned_with_a_note(file):
    found = read(file, text(T, -FZ, COP))
    assert found.load == pytest.approx(FZ, abs=1e-5)
    assert any("force on the plate" in note for note in found.notes)


def test_a_cop_in_centimetres_without_a_unit_is_refused(file):
    refused = refusal(file, text(T, FZ, 100 * COP))
    for word in ("moves over", "read in m", "cop=COPx:cm"):
        assert word in refused


@pytest.mark.parametrize(("factor", "unit"), [(1 / 9.80665, "kgf"), (1 / 4.448, "lbf"), (1e-3, "kN")])
@pytest.mark.parametrize("given", [True, False], ids=["spec", "no spec"])
def test_a_force_in_another_unit_is_refused_with_the_unit_that_fits(file, factor, unit, given):
    refused = refusal(file, text(T, factor * FZ, COP), given=given)
    assert f"fz=Fz:{unit}" in refused
    found = read(file, text(T, factor * FZ, COP), columns=f"fz=Fz:{unit}")
    assert found.load == pytest.approx(FZ, rel=1e-3)


def test_an_angle_in_degrees_read_as_radians_is_refused(file):
    names = "Time,theta,toe_force,heel_force"
    refused = refusal(file, text(T, 50 * THETA / 0.02, FZ / 2, FZ / 2, names=names))
    assert "angle=theta:deg" in refused
    names = "Time,theta,rate,toe_force,heel_force"
    refused = refusal(file, text(T, THETA, np.degrees(0.04 * np.cos(2 * T)), FZ / 2, FZ / 2, names=names))
    assert "times the derivative of the angle" in refused


@pytest.mark.parametrize("name", ["theta", "theta [rad]"])
def test_a_posture_that_only_the_weight_could_hold_is_refused(file, name):
    names = f"Time,{name},toe_force,heel_force"
    for lean in (1.2 + THETA, 0.5 + THETA, 25 * THETA):
        refused = refusal(file, text(T, lean, FZ / 2, FZ / 2, names=names))
        for word in ("read in rad", "times the weight", "angle=theta:deg"):
            assert word in refused
    lean = text(T, 0.4 + THETA, FZ / 2, FZ / 2, names=names)
    assert "'angle=theta:rad' if it is rad indeed" in refusal(file, lean)
    assert read(file, lean, columns="angle=theta:rad").theta.mean() == pytest.approx(0.4, abs=0.02)
    assert "times the weight" in refusal(
        file, text(T, 1.2 + THETA, FZ / 2, FZ / 2, names=names), columns="angle=theta:rad"
    )
    assert read(file, text(T, 3 * THETA, FZ / 2, FZ / 2, names=names)).theta is not None
    degrees = text(T, 1.2 + THETA, FZ / 2, FZ / 2, names="Time,theta [deg],toe_force,heel_force")
    assert read(file, degrees).theta.mean() == pytest.approx(np.radians(1.2), rel=0.1)


@pytest.mark.parametrize(
    ("names", "wish"),
    [
        ("Time,Fz [daN],COPx", "fz=Fz [daN]"),
        ("Time,Fz [daN],COPx", None),
        ("Time,Fz [daN],COPx", "fz=2"),
        ("Time,Fz,COPx [in]", None),
        ("Time,Fz,COPx [in]", "cop=COPx [in]"),
        ("Time,Fz [N],COPx", "fz=Fz [daN]"),
        ("Time,Fz,COPx [m]", "cop=COPx[in]"),
        ("Time,Fz,COPx [m]", "cop=COPx:in"),
    ],
)
def test_a_unit_that_is_not_known_is_refused_with_those_that_are(file, names, wish):
    refused = refusal(file, text(T, FZ, COP, names=names), columns=wish)
    assert "kN, kgf, lbf" in refused or "m, cm, mm" in refused
    assert "daN" in refused or "'in'" in refused


def test_a_unit_of_the_user_stands_for_one_that_is_not_known(file):
    assert read(file, text(T, FZ, COP, names="Time,Fz [left],COPx"), columns="fz=Fz [left]:N").load is not None
    assert "in m by the file" in refusal(file, text(T, FZ, COP, names="Time,Fz,COPx [m]"), columns="cop=COPx[cm]")


@pytest.mark.parametrize("factor", [0.55, 1.7])
def test_a_load_far_from_the_weight_of_the_spec_is_refused(file, factor):
    assert "needs 0.6 to 1.6 times" in refusal(file, text(T, factor * FZ, COP))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is empty"),
        (b"\n\n  \n", "has no rows"),
        (b"Time,Fz,COPx\n", "no rows of numbers"),
        (b"just some words\nand more of them\n", "no rows of numbers"),
        (bytes(range(256)) * 8, "not a text file"),
        (b"MATLAB 7.3 MAT-file, Platform: GLNXA64", "MATLAB v7.3"),
        (b"\x89HDF\r\n\x1a\n" + bytes(100), "HDF5"),
        (b"MATLAB 5.0 MAT-file", "writetable"),
        (b"\x1f\x8b\x08" + bytes(50), "gzip"),
        (b"%PDF-1.4", "PDF"),
        (b"\x93NUMPY\x01\x00" + bytes(30), "damaged NumPy file"),
        (b"PK\x03\x04 not really", "damaged .npz"),
    ],
)
def test_a_file_of_another_kind_is_refused_by_its_kind(file, content, said):
    assert said in refusal(file, content)


def test_numpy_files_with_objects_or_unequal_columns_are_refused(tmp_path):
    out = io.BytesIO()
    np.savez(out, bad=np.array([{}, 1], dtype=object))
    assert "Python objects" in refusal(tmp_path / "a.npz", out.getvalue())
    out = io.BytesIO()
    np.savez(out, Fz=FZ, COPx=COP[:-1])
    assert "of one length" in refusal(tmp_path / "b.npz", out.getvalue())
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("xl/workbook.xml", "x")
    assert "damaged .xlsx" in refusal(tmp_path / "c.xlsx", out.getvalue())


def test_a_file_that_would_fill_the_memory_is_refused(file, monkeypatch):
    monkeypatch.setattr(table, "MAX_BYTES", 1000)
    assert "more than" in refusal(file, text(T, FZ, COP))
    monkeypatch.undo()
    monkeypatch.setattr(table, "MAX_CELLS", 100)
    assert "cells" in refusal(file, text(T, FZ, COP))


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ({"columns": "fz"}, "NAME=COLUMN"),
        ({"columns": "load=Fz"}, "there are: time"),
        ({"columns": "angel=Fz"}, "did you mean angle"),
        ({"columns": "fz=Fy"}, "its columns: Time, Fz, COPx"),
        ({"columns": "fz=Fz:m"}, "allowed: N, kN"),
        ({"columns": "fz=Fz,fz=Fz"}, "twice"),
        ({"delimiter": "xy"}, "--delimiter"),
        ({"decimal": "x"}, "--decimal"),
        ({"skip_rows": 9999}, "--skip-rows"),
        ({"rate": -1.0}, "--rate"),
        ({"rate": float("nan")}, "--rate"),
        ({"resample": 1e9}, "--resample"),
        ({"up": "x"}, "--up"),
        ({"forward": "up"}, "--forward"),
        ({"forward": "z"}, "--forward"),
        ({"ankle": "here"}, "--ankle"),
        ({"ankle": "3:N"}, "--ankle"),
        ({"ankle": "nan"}, "--ankle"),
    ],
)
def test_an_option_that_cannot_be_meant_is_named(file, how, said):
    assert said in refusal(file, text(T, FZ, COP), **how)


def test_without_the_reader_of_c3d_files_the_install_line_is_shown(tmp_path, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "ezc3d", None)
    header = bytearray(2048)
    header[0], header[1] = 2, 0x50
    header[2:10] = b"\x01\x00\x00\x00\x01\x00\x01\x00"
    header[16:18] = b"\x03\x00"
    assert "pip install 'poise[c3d]'" in refusal(tmp_path / "trial.c3d", bytes(header))


def test_the_sign_of_a_horizontal_force_that_follows_no_cop_is_assumed(file):
    content = text(T, FZ, COP, np.cos(7 * T), names="Time,Fz,COPx,Fx")
    assert "give fx=-Fx" in " ".join(read(file, content).assumed)
    assert not any("fx=" in said for said in read(file, content, columns="fx=Fx").assumed)


def test_missing_rows_that_are_resampled_are_gaps_and_not_drop_outs(file):
    load = FZ.copy()
    load[150] = 0.0
    kept = (np.arange(N) < 70) | (np.arange(N) >= 100)
    found = read(file, text(T[kept], load[kept], COP[kept]), resample=100.0)
    assert np.flatnonzero(found.dropouts).tolist() == [150]
    assert found.gaps[70:100].all()
    assert found.gaps.sum() == 30
    assert found.valid.sum() == N - 31


def test_a_row_that_is_zero_throughout_is_a_drop_out(file):
    good = np.ones(N)
    good[[60, 61, 120, 199]] = 0.0
    found = read(file, text(T * good, FZ * good, COP * good))
    assert np.flatnonzero(found.dropouts).tolist() == [60, 61, 120, 199]
    assert found.t == pytest.approx(T)


def test_a_cop_of_zero_under_load_is_a_gap_where_the_others_are_far(file):
    cop = 0.04 + 0.3 * COP
    cop[[30, 31, 32, 100]] = 0.0
    found = read(file, text(T, FZ, cop))
    assert np.flatnonzero(found.gaps).tolist() == [30, 31, 32, 100]
    assert not found.dropouts.any()
    assert any("exactly 0 under load" in note for note in found.notes)
    assert found.cop.min() > 0.02
    crossing = COP.copy()
    crossing[np.abs(crossing) < 3e-4] = 0.0
    assert (crossing == 0).any()
    assert not read(file, text(T, FZ, crossing)).gaps.any()


@pytest.mark.parametrize(
    "promise",
    [
        "Total Exported Frames,{},", "Number of samples:\t{}", "nRows={}", "NO_OF_SAMPLES\t{}", "NO_OF_FRAMES\t{}",
    ],
)  # fmt: skip
def test_fewer_rows_than_the_header_states_are_refused_or_noted(file, promise):
    content = (promise + "\n").encode() + text(T, FZ, COP)
    whole = content.replace(b"{}", b"200")
    assert len(read(file, whole).t) == N
    cut = content.replace(b"{}", b"1000")
    refused = refusal(file, cut)
    for word in ("truncated", "200 rows", "1,000", "--allow-gaps"):
        assert word in refused
    assert any("truncated" in note for note in read(file, cut, allow_gaps=True).notes)


TORQUE = -(COP - COP.mean()) * FZ


@pytest.mark.parametrize("ankle", [None, "0.0"])
@pytest.mark.parametrize(
    ("torque", "said"),
    [
        (-TORQUE, "minus ell (F_H - F_T) of (11): the other sign; give --columns 'torque=-torque'"),
        (100 * TORQUE, "torque=torque:N cm"),
        (1e3 * TORQUE, "torque=torque:N mm"),
        (0.5 * TORQUE, "times ell (F_H - F_T) of (11); needs 1; is it one leg's"),
        (5 + 0 * T, "does not move"),
        (10 * np.cos(9 * T), "does not move"),
    ],
    ids=["sign", "N cm", "N mm", "half", "constant", "another"],
)
def test_a_torque_that_is_not_that_of_the_contact_forces_is_refused(file, torque, said, ankle):
    assert said in refusal(file, text(T, FZ, COP, torque, names="Time,Fz,COPx,torque"), ankle=ankle)


def test_a_torque_that_fits_is_taken_and_one_about_another_axis_is_refused(file):
    names = "Time,Fz,COPx,torque"
    assert read(file, text(T, FZ, COP, TORQUE + 1, names=names), ankle="0.0").torque is not None
    assert "in the mean" in refusal(file, text(T, FZ, COP, TORQUE + 60, names=names), ankle="0.0")
    assert read(file, text(T, FZ, COP, TORQUE + 60, names=names)).torque is not None
    toes, heels = (FZ / 2 * (1 + sign * COP / 0.12) for sign in (1, -1))
    names = "Time,toe_force,heel_force,torque"
    assert "other sign" in refusal(file, text(T, toes, heels, 0.5 * COP * FZ, names=names), given=False)
    assert read(file, text(T, toes, heels, -0.5 * COP * FZ, names=names), given=False).torque is not None
