"""However a table is written down it is read as the same numbers, or refused: never with shifted columns."""

import random
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mutated import mutate, tried
from plate_files import FORMATS, Truth

from design.errors import BadInput
from design.model.body import Biped
from design.recordings.reading import Reading
from design.recordings.record import open_record

BODY = Biped(M=68.0, L=0.92, I=70.0, m=2.0, ell=0.12)
N = 60
T = 0.5 + np.arange(N) / 50
COP = 0.05 + 0.02 * np.sin(4 * T)
FZ = 690.0 + 5 * np.cos(3 * T)
FX = 2.0 * np.sin(2 * T)
MY = -COP * FZ
QUANTITIES = {  # values, kind of unit, names that are known
    "time": (T, "s", ("Time", "t", "time")),
    "fx": (FX, "N", ("Fx", "FX", "Force X")),
    "fz": (FZ, "N", ("Fz", "FZ", "Force Z")),
    "my": (MY, "N m", ("My", "MY", "Moment Y")),
    "cop": (COP, "m", ("COPx", "Cx", "CoP_X")),
    "other": (np.arange(N) % 7, "", ("Trigger", "Frame", "Sync")),
}
UNITS = {
    "s": {"s": 1, "ms": 1e3},
    "N": {"N": 1, "kN": 1e-3},
    "N m": {"Nm": 1, "N.mm": 1e3},
    "m": {"m": 1, "cm": 1e2, "mm": 1e3},
}
HEADERS = ("Subject", "Trial name: quiet", "Weight (kg) 70", "Date 05/01/2021", "# a comment", "PlateLength")


@st.composite
def written(draw):
    delimiter = draw(st.sampled_from([",", ";", "\t", " ", "  ", ", "]))
    decimal = draw(st.sampled_from([".", ","] if "," not in delimiter else ["."]))
    roles = draw(st.permutations(list(QUANTITIES)))
    states = draw(st.sampled_from(["brackets", "row", "none"]))
    if delimiter.isspace() and delimiter != "\t":
        states = "none"
    names, units, columns = [], [], []
    for role in roles:
        values, kind, known = QUANTITIES[role]
        unit = draw(st.sampled_from(list(UNITS[kind]))) if kind and states != "none" else ""
        name = draw(st.sampled_from(known))
        if delimiter.isspace() and delimiter != "\t":
            name = name.replace(" ", "_")
        names.append(f"{name} [{unit}]" if unit and states == "brackets" else name)
        units.append(unit)
        columns.append(values * (UNITS[kind][unit] if unit else 1))
    quote = draw(st.booleans()) and not delimiter.isspace()
    head = [f'"{name}"' if quote else name for name in names]
    above = draw(st.lists(st.sampled_from(HEADERS), max_size=40))
    closed = draw(st.booleans()) and delimiter in ",;\t"
    lines = [*above, delimiter.join(head)]
    if states == "row" and any(units):
        lines.append(delimiter.join(units))
    for row in zip(*columns, strict=True):
        lines.append(delimiter.join(f"{value:.9f}".replace(".", decimal) for value in row) + delimiter * closed)
    lines += [""] * draw(st.integers(0, 3))
    text = draw(st.sampled_from(["\n", "\r\n", "\r"])).join(lines)
    encoding = draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16"]))
    return text.encode(encoding)


def _read(content, **how):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "trial.txt"
        path.write_bytes(content)
        return open_record(str(path), Reading(forward="x", **how), BODY, given=True)


@settings(max_examples=150, deadline=None)
@given(written())
def test_the_same_table_is_read_however_it_is_written(content):
    found = _read(content)
    assert found.t == pytest.approx(T, abs=1e-6)
    assert found.load == pytest.approx(FZ, rel=1e-6)
    assert found.cop == pytest.approx(COP, abs=1e-6)
    assert found.horizontal == pytest.approx(FX, abs=1e-5)


PLAIN = "Time,Fx,Fz,My,COPx\n" + "".join(
    f"{t:.4f},{x:.4f},{z:.4f},{y:.4f},{p:.6f}\n" for t, x, z, y, p in zip(T, FX, FZ, MY, COP, strict=True)
)


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_a_damaged_table_is_refused_or_read_as_what_is_left(data):
    lines = PLAIN.splitlines()
    k = data.draw(st.integers(1, N))
    cells = lines[k].split(",")
    what = data.draw(st.sampled_from(["drop cell", "add cell", "text", "empty", "nan", "cut", "swap decimal"]))
    column = data.draw(st.integers(0, 4))
    if what == "drop cell":
        del cells[column]
    elif what == "add cell":
        cells.insert(column, "1.0")
    elif what == "cut":
        cells = cells[: max(1, column)]
    else:
        cells[column] = {"text": "abc", "empty": "", "nan": "NaN", "swap decimal": cells[column].replace(".", ",")}[
            what
        ]
    lines[k] = ",".join(cells)
    content = "\n".join(lines).encode()
    with pytest.raises(BadInput) as caught:
        _read(content)
    assert f"line {k + 1}" in str(caught.value)
    found = _read(content, allow_gaps=True)
    good = found.valid
    only_time = column == 0 and what in ("text", "empty", "nan")  # a time stamp follows from its neighbours
    assert good[k - 1] == only_time
    assert good.sum() == N - (not only_time)
    if only_time:
        assert found.t == pytest.approx(T, abs=1e-3)
        return
    assert found.load[good] == pytest.approx(np.delete(FZ, k - 1), abs=1e-3)
    assert found.cop[good] == pytest.approx(np.delete(COP, k - 1), abs=1e-5)


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=400))
def test_any_bytes_are_read_or_refused_in_one_line(content):
    try:
        _read(content)
    except BadInput as refused:
        assert "\n" not in str(refused)


@settings(max_examples=100, deadline=None)
@given(st.text(alphabet='0123456789.,;\t \n-eEFzTimeCOPx[]()"', max_size=400))
def test_any_text_is_read_or_refused_in_one_line(text):
    try:
        _read(text.encode())
    except BadInput as refused:
        assert "\n" not in str(refused)


@pytest.mark.parametrize("form", FORMATS)
def test_a_mutated_file_is_read_or_refused_in_one_line(form, tmp_path):
    if form == "C3D":
        pytest.importorskip("ezc3d", reason="ezc3d is not installed")
    chance = random.Random(f"seed of {form}")
    content, _, name = FORMATS[form](Truth("2", "z", "x"), 1)
    seen = {
        tried(mutate(content, chance), Path(name).suffix, chance, tmp_path) for _ in range(15 if form == "C3D" else 40)
    }
    assert "refused" in seen
