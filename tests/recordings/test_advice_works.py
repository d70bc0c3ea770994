"""What a message proposes was tried: given as it is printed, it reads the file; and it never repeats what was given."""

import re
import shlex
from dataclasses import replace

import numpy as np
import pytest

from design.errors import BadInput
from design.model.body import Biped
from design.recordings.reading import Reading
from design.recordings.record import open_record

BODY = Biped(M=68.0, L=0.92, I=70.0, m=2.0, ell=0.12)
N = 1000
T = np.arange(N) / 100
SWAY = np.sin(2 * np.pi * T)
COP = 0.05 + 0.01 * SWAY + 0.005 * np.sin(0.5 * T)
FZ = 687 + 3 * np.sin(1.3 * T)
FX = -5 * SWAY
SHARE = 0.4 + 0.1 * np.sin(T)
COPS = (COP - 0.02, COP + 0.02)
LOADS = (SHARE * FZ, (1 - SHARE) * FZ)
BOTH = SHARE * COPS[0] + (1 - SHARE) * COPS[1]
NIL = 0 * T
ALONG_Y = {f"{q}{a}{k}": (q == "COP") * (a == "y") * each for q in ("F", "COP") for a in "xy"
           for k, each in enumerate((*COPS, NIL), start=1)}  # fmt: skip
CORNERS = [FZ / 9.80665 * (1 + sign * COP / 0.119) / 4 for sign in (1, -1)]  # in kg, 238 mm apart


def text(delimiter=",", **columns):
    names = delimiter.join(name.replace("__", " ").replace("_U", " [").replace("U_", "]") for name in columns)
    rows = (delimiter.join(f"{x:.9g}" for x in row) for row in zip(*columns.values(), strict=True))
    return "\n".join([names, *rows])


def two(names=("Fz1", "COPx1", "Fz2", "COPx2"), **more):
    return text(Time=T, **dict(zip(names, (LOADS[0], COPS[0], LOADS[1], COPS[1]), strict=True)), **more)


UNEVEN = T.copy()
UNEVEN[500:] += 0.37
CASES = {
    "kN": (text(Time=T, Fz=FZ / 1e3, COPx=COP), {}, COP),
    "kgf": (text(Time=T, Fz=FZ / 9.80665, COPx=COP), {}, COP),
    "lbf": (text(Time=T, Fz=FZ / 4.44822, COPx=COP), {}, COP),
    "toe and heel in kN": (
        text(Time=T, toe=FZ * (0.24 + COP) / 480, heel=FZ * (0.24 - COP) / 480, COPx=COP / 2), {}, COP / 2,
    ),
    "CoP in cm": (text(Time=T, Fz=FZ, COPx=100 * COP), {}, COP),
    "CoP in mm beside the moment": (text(Time=T, Fz=FZ, COPx=1e3 * COP, My=-COP * FZ), {}, COP),
    "moment in N mm": (text(Time=T, Fz=FZ, My=-1e3 * COP * FZ), {}, COP),
    "moment in N mm beside the CoP": (text(Time=T, Fz=FZ, COPx=COP, My=-1e3 * COP * FZ), {}, COP),
    "CoP in cm, force in kN": (text(Time=T, Fz=FZ / 1e3, COPx=100 * COP), {}, COP),
    "moment with the other sign": (text(Time=T, Fz=FZ, COPx=COP, My=COP * FZ), {}, COP),
    "another moment": (text(Time=T, Fz=FZ, COPx=COP, My=np.cos(9 * T)), {}, COP),
    "time in ms": (text(Time=1e3 * T, Fz=FZ, COPx=COP), {}, COP),
    "a hole in the stamps": (text(Time=UNEVEN, Fz=FZ, COPx=COP), {}, COP),
    "a cell of text": (re.sub(r"\n0\.5,[^,]*,", "\n0.5,abc,", text(Time=T, Fz=FZ, COPx=COP)), {}, COP),
    "names that are not usual": (two(("paretic__Fvert", "paretic__CPap", "other__Fvert", "other__CPap")), {}, BOTH),
    "an axis in names that are not usual ones": (two(("left__Fz", "left__COPx", "other__Fz", "other__COPx")), {}, BOTH),
    "the moment of one plate of two with the other sign": (
        two(My1=-LOADS[0] * COPS[0], My2=LOADS[1] * COPS[1]), {}, BOTH,
    ),
    "one CoP of two": (two(), {"columns": "fz=Fz1+Fz2,cop=COPx1"}, BOTH),
    "the same CoP twice": (two(), {"columns": "fz=Fz1+Fz2,cop=COPx1+COPx1"}, BOTH),
    "the other plate's CoP": (two(), {"columns": "fz=Fz1,cop=COPx2"}, BOTH),
    "one plate of two": (two(), {"columns": "fz=Fz1,cop=COPx1"}, BOTH),
    "moments of two plates": (
        text(Time=T, Fz1=LOADS[0], My1=-LOADS[0] * COPS[0], Fz2=LOADS[1], My2=-LOADS[1] * COPS[1]), {}, BOTH,
    ),
    "the wrong axis up": (text(Time=T, Fx=FX, Fy=NIL, Fz=FZ, COPx=COP), {"up": "y"}, COP),
    "two loads": (text(Time=T, Fz=FZ, GRFz=FZ / 2, COPx=COP), {}, COP),
    "a moment in N mm on the plate": (text(Time=T, Fz=-FZ, My=1e3 * COP * FZ), {}, COP),
    "a moment in N mm on the plate beside the CoP": (text(Time=T, Fz=-FZ, COPx=COP, My=1e3 * COP * FZ), {}, COP),
    "a force in kN on the plate": (text(Time=T, Fz=-FZ / 1e3, My=COP * FZ), {}, COP),
    "a moment in kN m": (text(Time=T, Fz=FZ, My=-1e-3 * COP * FZ), {}, COP),
    "moments of two plates, on the plate": (
        text(Time=T, Fz1=-LOADS[0], My1=LOADS[0] * COPS[0], Fz2=-LOADS[1], My2=LOADS[1] * COPS[1]), {}, BOTH,
    ),
    "moments of two plates in N mm, on the plate": (
        text(Time=T, Fz1=-LOADS[0], My1=1e3 * LOADS[0] * COPS[0], Fz2=-LOADS[1], My2=1e3 * LOADS[1] * COPS[1]),
        {}, BOTH,
    ),
    "forces in kN of two plates and an empty one, along y": (
        text(Time=T, **ALONG_Y, Fz1=LOADS[0] / 1e3, Fz2=LOADS[1] / 1e3, Fz3=NIL),
        {"columns": "fz=Fz1+Fz2+Fz3,cop=COPy1+COPy2+COPy3,fx=Fy1+Fy2+Fy3"}, BOTH,
    ),
    "CoPs in mm of two plates and an empty one, along y": (
        text(Time=T, **{name: 1e3 * each for name, each in ALONG_Y.items()}, Fz1=LOADS[0], Fz2=LOADS[1], Fz3=NIL),
        {"columns": "fz=Fz1+Fz2+Fz3,cop=COPy1+COPy2+COPy3,fx=Fy1+Fy2+Fy3"}, BOTH,
    ),
    "a board's corners without a unit": (
        text(Time=T, TL=CORNERS[0], TR=CORNERS[0], BL=CORNERS[1], BR=CORNERS[1]), {}, COP,
    ),
    "a load without CoP": (text(Time=T, Fz=FZ, Fz2=FZ, COPx=COP), {}, COP),
}  # fmt: skip


def proposals(message):
    """The ways of reading that a message proposes after its last `give`."""
    found = []
    for part in re.split(r", or (?=--)", message.rpartition("; give ")[2]):
        options = {}
        for option, value in re.findall(r"(--[a-z-]+)(?: ('[^']*'|[^\s,(]+))?", part):
            field = option.removeprefix("--").replace("-", "_")
            plain = shlex.split(value)[0] if value else ""
            if field == "origins" or field not in Reading.__dataclass_fields__:
                continue
            options[field] = True if field == "allow_gaps" else float(plain) if field in ("rate", "resample") else plain
        found.append(options)
    return [each for each in found if each]


@pytest.mark.parametrize("case", CASES)
def test_what_a_message_proposes_reads_the_file(case, tmp_path):
    content, how, truth = CASES[case]
    path = tmp_path / "trial.csv"
    path.write_text(content)
    first = Reading(**how)
    with pytest.raises(BadInput) as refused:
        open_record(str(path), first, BODY, given=True)
    ways = proposals(str(refused.value))
    assert ways, refused.value
    cops = []
    for options in ways:
        assert replace(first, **options) != first
        record = open_record(str(path), replace(first, **options), BODY, given=True)
        assert record.load[record.valid] == pytest.approx(np.interp(record.t, T, FZ)[record.valid], rel=0.01)
        cops.append(record)
    right = np.interp(cops[0].t, T, truth) if "hole" not in case else cops[0].cop
    assert cops[0].cop == pytest.approx(right, abs=2e-5), refused.value


def test_a_unit_is_not_proposed_against_one_that_the_file_states(tmp_path):
    path = tmp_path / "trial.csv"
    path.write_text(
        "Time [s],Fz [N],COPx [m]\n" + "\n".join(f"{t:.3f},150,{p:.6f}" for t, p in zip(T, COP, strict=True))
    )
    with pytest.raises(BadInput) as refused:
        open_record(str(path), Reading(), BODY, given=True)
    assert not proposals(str(refused.value))
    assert "lbf" not in str(refused.value)


def test_moments_about_different_origins_need_the_origins(tmp_path):
    moments = [-load * (cop - origin) for load, cop, origin in zip(LOADS, COPS, (0.3, -0.3), strict=True)]
    path = tmp_path / "trial.csv"
    path.write_text(text(Time=T, Fz1=LOADS[0], My1=moments[0], Fz2=LOADS[1], My2=moments[1]))
    for columns in (None, "my=My1+My2", "fz=Fz1+Fz2,my=My1+My2"):
        with pytest.raises(BadInput, match="about the origin of their own plate"):
            open_record(str(path), Reading(columns=columns), BODY, given=True)
        for origins in ("0.3,-0.3", "30,-30:cm"):
            record = open_record(str(path), Reading(columns=columns, origins=origins), BODY, given=True)
            assert record.cop == pytest.approx(BOTH, abs=1e-6)
    with pytest.raises(BadInput, match="one of each, in this order"):
        open_record(str(path), Reading(origins="0.3"), BODY, given=True)
    path.write_text(two())
    with pytest.raises(BadInput, match="and none is read"):
        open_record(str(path), Reading(origins="0.3,-0.3"), BODY, given=True)


def test_plates_with_load_that_a_selection_leaves_out_are_named(tmp_path):
    path = tmp_path / "trial.csv"
    path.write_text(two())
    for columns in ("cop=COPx2", "fz=Fz2,cop=COPx2", "fz=Fz2"):
        record = open_record(str(path), Reading(columns=columns), BODY, given=False)
        assert "Fz1 (2" in record.warnings[0]
    assert not open_record(str(path), Reading(columns="cop=COPx2+COPx1"), BODY, given=False).warnings
    path.write_text(two(COPy1=COPS[0], COPy2=COPS[1]))
    with pytest.raises(BadInput, match="along different axes"):
        open_record(str(path), Reading(columns="cop=COPx1+COPy2"), BODY, given=True)


def test_a_plate_is_turned_whole_or_what_was_not_turned_is_said(tmp_path):
    path = tmp_path / "trial.csv"
    path.write_text(text(Time=T, Fx=-FX, Fz=-FZ, My=COP * FZ))
    for columns in (None, "fz=-Fz", "fz=-Fz,my=-My", "fz=-Fz,fx=-Fx", "fz=Fz"):
        record = open_record(str(path), Reading(columns=columns), BODY, given=True)
        assert record.cop == pytest.approx(COP, abs=1e-6)
        assert record.horizontal == pytest.approx(FX, abs=1e-6)
        assert not record.warnings
    path.write_text(text(Time=T, Fx=-FX, Fy=NIL, Fz=-FZ, Mx=-COP * FZ, COPy=COP))  # y forward: CoP = Mx / Fz
    record = open_record(str(path), Reading(columns="fz=-Fz,my=Mx", forward="y"), BODY, given=True)
    assert record.cop == pytest.approx(COP, abs=1e-6)
    assert not record.warnings
    path.write_text(text(Time=T, Fx=-FX, Fz=-FZ, My=COP * FZ))
    record = open_record(str(path), Reading(columns="fz=-Fz,my=My"), BODY, given=True)
    assert "my=My keeps its sign" in " ".join(record.warnings)
    record = open_record(str(path), Reading(columns="fz=-Fz,fx=Fx"), BODY, given=True)
    assert "fx=Fx keeps its sign" in " ".join(record.warnings)


@pytest.mark.parametrize("sign", [1, -1], ids=["on the foot", "on the plate"])
@pytest.mark.parametrize(
    "names", [("Fx", "Fz", "COPx"), ("FP1:Fx", "FP1:Fz", "FP1:COPx", "FP2:Fx", "FP2:Fz", "FP2:COPx")]
)
@pytest.mark.parametrize("push", [FX, np.cos(2 * np.pi * T)], ids=["that the CoP tells", "that nothing tells"])
@pytest.mark.parametrize("selected", [False, True])
def test_the_sign_of_the_forward_force_that_is_proposed_turns_it(tmp_path, sign, names, push, selected):
    one = (sign * push, sign * FZ, COP)
    two = (sign * 0.3 * push, sign * LOADS[0], COP, sign * 0.7 * push, sign * LOADS[1], COP)
    path = tmp_path / "trial.csv"
    columns = dict(zip(names, one if len(names) == 3 else two, strict=True))
    path.write_text(",".join(["Time", *names]) + "\n" + text(Time=T, **columns).partition("\n")[2])
    wrong = "fx=" + "+".join(f"-{name}" for name in names if "Fx" in name)
    how = Reading(columns=wrong if selected else None)
    record = open_record(str(path), how, BODY, given=True)
    told = push is FX
    said = [*record.warnings, *record.assumed]
    proposed = [each[1] for line in said if (each := re.search(r"(?:be|give) (fx=[^?]+)", line))]
    assert len(proposed) == (selected if told else not selected)
    for columns in proposed:
        other = open_record(str(path), replace(how, columns=columns), BODY, given=True)
        assert other.horizontal == pytest.approx(-record.horizontal, abs=1e-9)
        assert not other.warnings
    if told and not selected:
        assert record.horizontal == pytest.approx(FX, abs=1e-6)
