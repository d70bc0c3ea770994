"""What plates and motion capture of several makers write is read as it is meant, or the option to give is shown."""

import io

import numpy as np
import pytest

from design.errors import BadInput
from design.model.body import Biped
from design.recordings.names import Known, recognise
from design.recordings.reading import Reading
from design.recordings.record import open_record
from design.recordings.units import split, unit_of

BODY = Biped(M=68.0, L=0.92, I=70.0, m=2.0, ell=0.12)
N = 300
T = np.arange(N) / 100
COP = 0.05 + 0.02 * np.sin(3 * T)
FX, FY, FZ = 2 * np.cos(4 * T), 1.5 * np.sin(2 * T), 700 + 3 * np.sin(5 * T)
MX, MY, MZ = 0.03 * FZ, -COP * FZ, 0.3 + 0 * T
NIL = 0 * T


def rows(columns, delimiter=",", decimal=".", closed=False):
    lines = (delimiter.join(f"{x:.7g}" for x in row) for row in zip(*columns, strict=True))
    return "".join(line.replace(".", decimal) + delimiter * closed + "\n" for line in lines)


VICON = (
    "Devices\n1000\n,,AMTI OR6 Series #1 - Force,,,AMTI OR6 Series #1 - Moment,,,AMTI OR6 Series #1 - CoP,,\n"
    "Frame,Sub Frame,Fx,Fy,Fz,Mx,My,Mz,Cx,Cy,Cz\n,,N,N,N,N.mm,N.mm,N.mm,mm,mm,mm\n"
)
VICON_COLUMNS = [
    1 + np.arange(N) // 10,
    np.arange(N) % 10,
    -FX,
    -FY,
    -FZ,
    -1e3 * MX,
    -1e3 * MY,
    -1e3 * MZ,
    1e3 * COP,
    30 + NIL,
    NIL,
]
QUALISYS = (
    "NO_OF_SAMPLES\t300\nFREQUENCY\t100\nTIME_STAMP\t2020-01-01, 10:00:00\nFORCE_PLATE_LENGTH\t600.000\n\n"
    "Force_X\tForce_Y\tForce_Z\tMoment_X\tMoment_Y\tMoment_Z\tCOP_X\tCOP_Y\tCOP_Z\n"
)
QUALISYS_COLUMNS = [FX, FY, FZ, MX, MY, MZ, 1e3 * COP, 30 + NIL, NIL]
KISTLER = (
    "Data file:\tTrial 1\nSampling rate (Hz):\t100\nDescription: \n\n"
    "abs time (s)\tFx\tFy\tFz\t|Ft|\tAx\tAy\tMx\tMy\ns\tN\tN\tN\tN\tm\tm\tN*m\tN*m\n"
)
KISTLER_COLUMNS = [T, FX, FY, FZ, FZ, COP, 0.03 + NIL, MX, MY]
MOT = "grf.mot\nversion=1\nnRows=300\nnColumns=10\ninDegrees=yes\nendheader\n"
ONE = [f"ground_force_{q}{a}" for q in "vp" for a in "xyz"]
OPENSIM = MOT + "\t".join(["time", *ONE, *(f"ground_torque_{a}" for a in "xyz")]) + "\n"
OPENSIM_COLUMNS = [T, FX, FZ, FY, COP, NIL, 0.1 + NIL, NIL, NIL, NIL]


TRAJECTORIES = "Trajectories\n100\n,,LANK,,\nFrame,Sub Frame,X,Y,Z\n,,mm,mm,mm\n" + 30 * "1,0,400.5,100.25,80.5\n"
VISUAL3D = "\n".join(
    "\t".join([name, *cells]) for name, cells in (
        ("", 6 * ["trial.c3d"]), ("", 6 * ["FP1"]), ("", 3 * ["FORCE"] + 3 * ["COFP"]), ("", 6 * ["ORIGINAL"]),
        ("ITEM", list("XYZXYZ")),
    )
) + "\n"  # fmt: skip
NORAXON = 'Type:,MR3\n\n"Time,s","Marker","Force Plate 1 Fx,N","Force Plate 1 Fz,N","Force Plate 1 COP x,mm"\n'


def spelled(pattern):
    return "".join(pattern.format(a, b, c) for a, b, c in zip(T, FZ, COP, strict=True))


EXPORTS = {
    "Vicon, on the plate, mm": (VICON + rows(VICON_COLUMNS), {}, 1000),
    "Vicon, with trajectories below": (VICON + rows(VICON_COLUMNS) + "\n" + TRAJECTORIES, {}, 1000),
    "Vicon, with its titles in quotes": (
        (VICON + rows(VICON_COLUMNS) + "\n" + TRAJECTORIES).replace("Devices", '"Devices"').replace("Tr", '"Tr', 1)
        .replace("ies\n", 'ies"\n', 1), {}, 1000,
    ),
    "Vicon, with trajectories above": (TRAJECTORIES + "\n" + VICON + rows(VICON_COLUMNS), {}, 1000),
    "Visual3D": (
        VISUAL3D + rows([1 + np.arange(N), FX, FY, FZ, COP, 0.03 + NIL, NIL], "\t"), {"rate": 100.0}, 100
    ),
    "Noraxon": (NORAXON + rows([T, NIL, FX, FZ, 1e3 * COP]), {}, 100),
    "a balance board's weight": ("time,weight_kg,COPx_cm\n" + rows([T, FZ / 9.80665, 100 * COP]), {}, 100),
    "a balance board's corners": (
        "time,TopLeft_kg,TopRight_kg,BottomLeft_kg,BottomRight_kg\n"
        + rows([T, *(FZ / 9.80665 * (share + sign * COP / 0.476) for share, sign in zip(
            (0.2, 0.3, 0.3, 0.2), (1, 1, -1, -1), strict=True
        ))]), {}, 100,
    ),
    "Kistler BioWare": (KISTLER + rows(KISTLER_COLUMNS, "\t"), {}, 100),
    "Kistler BioWare, decimal comma": (KISTLER + rows(KISTLER_COLUMNS, "\t", ","), {}, 100),
    "Qualisys, unit given": (QUALISYS + rows(QUALISYS_COLUMNS, "\t"), {"columns": "cop=COP_X:mm"}, 100),
    "OpenSim": (OPENSIM + rows(OPENSIM_COLUMNS, "\t"), {}, 100),
    "Bertec": (
        "Time (s),Fx (N),Fy (N),Fz (N),Mx (N-m),My (N-m),Mz (N-m),CoPx (m),CoPy (m)\n"
        + rows([T, FX, FY, FZ, MX, MY, MZ, COP, 0.03 + NIL]), {}, 100,
    ),
    "two plates, joined": (
        "Time,FP1 - Fz (kN),FP1 - COPx (cm),FP2 - Fz (kN),FP2 - COPx (cm)\n"
        + rows([T, FZ / 2e3, 100 * COP - 1, FZ / 2e3, 100 * COP + 1]),
        {"columns": "fz=FP1 - Fz+FP2 - Fz,cop=FP1 - COPx+FP2 - COPx"}, 100,
    ),
    "two plates": ("Time,Fz1,COPx1,Fz2,COPx2\n" + rows([T, FZ / 2, COP - 0.1, FZ / 2, COP + 0.1]), {}, 100),
    "a spreadsheet's": ("Zeit;Fz;COPx\n" + rows([T, FZ, COP], ";", ","), {}, 100),
    "quoted decimal commas": (
        '"Time","Fz","COPx"\n' + spelled('"{:.3f}";"{:.4f}";"{:.6f}"\n').replace(".", ",").replace(";", ","), {}, 100,
    ),
    "closed rows, open header": ("Time,Fz,COPx\n" + rows([T, FZ, COP], closed=True), {}, 100),
    "an index without a name": (",Time,Fz,COPx\n" + rows([np.arange(N), T, FZ, COP]), {}, 100),
    "numpy.savetxt": ("# Time Fz COPx\n" + rows([T, FZ, COP], " "), {}, 100),
    "columns by number": (rows([T, FZ, COP]), {"columns": "time=1,fz=2,cop=3:m"}, 100),
    "no time column": ("Fz,COPx\n" + rows([FZ, COP]), {"rate": 100.0}, 100),
    "milliseconds": ("Time [ms],Fz,COPx\n" + rows([1e3 * T, FZ, COP]), {}, 100),
    "a blank unused column": ("Time,Fz,EMG,COPx\n" + spelled("{},{:.5f},,{:.7f}\n"), {}, 100),
    "an unused column of text": ("Time,Event,Fz,COPx\n" + spelled("{},go,{:.5f},{:.7f}\n"), {}, 100),
}  # fmt: skip


def read(content, path, **how):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return open_record(str(path), Reading(**how), BODY, given=True)


@pytest.mark.parametrize("maker", EXPORTS)
def test_an_export_is_read_as_it_is_meant(maker, tmp_path):
    content, how, rate = EXPORTS[maker]
    found = read(content, tmp_path / "trial.txt", **how)
    assert found.rate == pytest.approx(rate, rel=1e-3)
    assert found.load == pytest.approx(FZ, rel=1e-4)
    assert found.cop == pytest.approx(COP, abs=2e-6)
    if found.horizontal is not None:
        assert found.horizontal == pytest.approx(FX, abs=1e-4)


UNCLEAR = {
    "Qualisys, unit not given": (QUALISYS + rows(QUALISYS_COLUMNS, "\t"), ("COP_X", "1000 times", "cop=COP_X:mm")),
    "a name twice": ("Time,Fz,Fz,COPx\n" + rows([T, FZ, FZ, COP]), ("more than one", "Fz.2")),
    "unknown names": ("a,b,c\n" + rows([T, FZ, COP]), ("its columns: a, b, c", "--columns time=NAME")),
    "no names": (rows([T, FZ, COP]), ("column 1, column 2, column 3", "--columns")),
    "no CoP": ("Time,Fz\n" + rows([T, FZ]), ("neither cop nor my", "--columns")),
    "no time": ("Fz,COPx\n" + rows([FZ, COP]), ("--rate",)),
    "volts": ("Time,Fz [V],COPx\n" + rows([T, FZ, COP]), ("Fz [V]", "--columns")),
    "decimal commas without quotes": ("Fz,COPx\n" + rows([FZ + 0.001, COP], ",", ","), ("delimiter or the decimal",)),
    "commas alone": ("".join(f"0,{k:02d},70,{k % 10}\n" for k in range(50)), ("delimiter or the decimal sign",)),
    "one name too few": ("Time,Fz\n" + rows([T, FZ, COP]), ("column 1, column 2, column 3",)),
    "two trials": ("Time,Fz,COPx\n" + 2 * rows([T, FZ, COP]), ("line 302", "more than one trial")),
    "a second table": ("Time,Fz,COPx\n" + rows([T, FZ, COP]) + "\nTrajectories\n100\n", ("line 303", "is text")),
    "a sum below": ("Time,Fz,COPx\n" + rows([T, FZ, COP]) + "Mean,700,0.05\n", ("line 302", "'Mean'")),
}


@pytest.mark.parametrize("case", UNCLEAR)
def test_what_is_not_clear_is_demanded(case, tmp_path):
    content, words = UNCLEAR[case]
    with pytest.raises(BadInput) as caught:
        read(content, tmp_path / "trial.txt")
    for word in words:
        assert word in str(caught.value)


def test_numpy_files_are_read(tmp_path):
    for name, save in (
        ("a.npz", lambda out: np.savez(out, time=T, Fz=FZ, COPx=COP)),
        (
            "b.npz",
            lambda out: np.savez_compressed(out, data=np.column_stack([T, FZ, COP]), names=["t", "Fz [N]", "Cx"]),
        ),
        ("c.npz", lambda out: np.savez(out, fs=100.0, Fz=FZ, COPx=COP)),
        (
            "vectors.npz",
            lambda out: np.savez(out, time=T, force=np.column_stack([FX, FY, FZ]), cop=np.column_stack([COP, NIL])),
        ),
        ("d.npy", lambda out: np.save(out, np.array(list(zip(T, FZ, COP, strict=True)), dtype="f8,f8,f8"))),
    ):
        out = io.BytesIO()
        save(out)
        how = {"columns": "time=f0,fz=f1,cop=f2"} if name.endswith(".npy") else {}
        found = read(out.getvalue(), tmp_path / name, **how)
        assert found.load == pytest.approx(FZ)
        assert found.cop == pytest.approx(COP)


def c3d_file(path, plates=1):
    ezc3d = pytest.importorskip("ezc3d", reason="ezc3d is not installed")
    file = ezc3d.c3d()
    file.add_parameter("POINT", "UNITS", ["mm"])
    file["parameters"]["POINT"]["RATE"]["value"] = [100]
    file["parameters"]["POINT"]["LABELS"]["value"] = ("marker",)
    file["data"]["points"] = np.ones((4, 1, N // 2))
    if plates:
        file["parameters"]["ANALOG"]["RATE"]["value"] = [200]
        file["parameters"]["ANALOG"]["LABELS"]["value"] = tuple(f"{p}{a}1" for p in "FM" for a in "xyz")
        file["parameters"]["ANALOG"]["UNITS"]["value"] = ("N", "N", "N", "Nmm", "Nmm", "Nmm")
        file["data"]["analogs"] = np.stack([-FX, -FY, -FZ, -1e3 * MX, -1e3 * MY, -1e3 * MZ])[None]
        corners = np.array([[200, -200, -200, 200], [200, 200, -200, -200], [0, 0, 0, 0]], float)[:, :, None]
        for name, kind, value in (
            ("USED", 2, np.array([1])), ("TYPE", 2, np.array([2])), ("ZERO", 2, np.array([1, 0])),
            ("CHANNEL", 2, np.arange(1, 7)[:, None]), ("CORNERS", 4, corners), ("ORIGIN", 4, np.zeros((3, 1))),
        ):  # fmt: skip
            file.add_parameter("FORCE_PLATFORM", name, [0])
            file["parameters"]["FORCE_PLATFORM"][name].update(type=kind, value=value)
    file.write(str(path))


def test_the_force_plate_of_a_c3d_file_is_read(tmp_path):
    path = tmp_path / "trial.c3d"
    c3d_file(path)
    found = open_record(str(path), Reading(), BODY, given=True)
    assert found.rate == 200
    assert found.load == pytest.approx(FZ, rel=1e-5)
    assert found.cop == pytest.approx(COP, abs=1e-5)
    assert "cop" in found.columns
    assert found.columns["cop"].endswith("[mm]")


def test_a_c3d_file_without_plates_or_cut_off_is_refused(tmp_path):
    path = tmp_path / "trial.c3d"
    c3d_file(path, plates=0)
    with pytest.raises(BadInput, match="no force plates"):
        open_record(str(path), Reading(), BODY, given=True)
    c3d_file(path)
    whole = path.read_bytes()
    for part in (300, 700, 1500, len(whole) - 2000):
        path.write_bytes(whole[:part])
        with pytest.raises(BadInput, match=r"cut off|beginning|cannot be read"):
            open_record(str(path), Reading(), BODY, given=True)


@pytest.mark.parametrize(
    ("name", "known"),
    [
        ("GRFNET_Y", Known(kind="force", axis="y", tag="net")),
        ("F1X", Known(kind="force", axis="x", tag="1")),
        ("GRF_left_z", Known(kind="force", axis="z", tag="l")),
        ("FP2.ForY", Known(kind="force", axis="y", tag="2")),
        ("Fz (plate 1)", Known(kind="force", axis="z", tag="1")),
        ("Vertical force 2", Known(role="fz", tag="2")),
        ("left AP force", Known(role="fx", tag="l")),
        ("C7X", None),
        ("M1X", None),
        ("R.Ankle_X", Known(kind="ankle", axis="x", tag="r")),
        ("ground_force_1_vy", Known(kind="force", axis="y", tag="1")),
        ("1_ground_force_px", Known(kind="cop", axis="x", tag="1")),
        ("FP2 - Fz", Known(kind="force", axis="z", tag="2")),
        ("COPx_cm", Known(kind="cop", axis="x", unit="cm")),
        ("rate_rad_per_s", Known(role="rate", unit="rad/s")),
        ("toe_force_n", Known(role="toe", unit="N")),
        ("Ay", Known(kind="cop", axis="y")),
        ("ay", None),
        ("|Ft|", None),
        ("max", None),
        ("RFREEMOMENT_Y", None),
        ("ground_torque_x", None),
        ("Frame", None),
    ],
)
def test_names_are_known(name, known):
    assert recognise(name) == known


@pytest.mark.parametrize(
    ("text", "unit"),
    [("Nm", "N m"), ("N.mm", "N mm"), ("N-m", "N m"), ("N*m", "N m"), ("[sec]", "s"), ("MM", "mm"), ("°", "deg"),
     ("kg", "kgf"), ("V", None), ("", None)],
)  # fmt: skip
def test_units_are_known(text, unit):
    assert unit_of(text) == unit


def test_a_bracket_that_is_no_unit_stays_in_the_name():
    assert split("Fz [V]") == ("Fz [V]", None)
    assert split("COPx (cm)") == ("COPx", "cm")


@pytest.mark.parametrize("second", ["GRFz", "fz", "verticalForce"])
def test_two_columns_that_may_be_the_load_are_refused(tmp_path, second):
    content = f"Time,Fz,{second},COPx\n" + rows([T, FZ, FZ / 2, COP])
    with pytest.raises(BadInput) as caught:
        read(content, tmp_path / "trial.csv")
    assert f"more than one column that may be fz: Fz, {second}; give --columns 'fz=Fz'" in str(caught.value)
    assert f"fz={second}" not in str(caught.value)  # half the weight: it was tried
    assert read(content, tmp_path / "trial.csv", columns="fz=Fz").load == pytest.approx(FZ, rel=1e-4)


def test_two_centres_of_pressure_or_gravity_of_one_kind_are_refused(tmp_path):
    with pytest.raises(BadInput, match="may be cop: COPx, Ax"):
        read("Time,Fz,COPx,Ax\n" + rows([T, FZ, COP, COP - 0.3]), tmp_path / "trial.csv")
    with pytest.raises(BadInput, match="may be com_x: COM_X, COG_X"):
        columns = [T, COP + 0.1, 0.95 + NIL, COP, 0.9 + NIL, NIL, 0.07 + NIL]
        read("Time,COM_X,COM_Y,COG_X,COG_Y,Ankle_X,Ankle_Y\n" + rows(columns), tmp_path / "trial.csv")


SHARE = 0.5 + 0.2 * np.sin(T)
PLATES = "Time,Fx1,Fz1,COPx1,Fx2,Fz2,COPx2\n" + rows([T, FX, SHARE * FZ, COP, 3 * FX, (1 - SHARE) * FZ, COP + 0.1])


@pytest.mark.parametrize("wish", ["fz=Fz1+Fz2,cop=COPx2+COPx1", "fz=Fz2+Fz1,cop=COPx2+COPx1", "fz=Fz1+Fz2"])
def test_the_cop_and_the_horizontal_force_of_two_plates_are_paired_with_their_loads(tmp_path, wish):
    found = read(PLATES, tmp_path / "trial.csv", columns=wish)
    assert found.cop == pytest.approx(COP + 0.1 * (1 - SHARE), abs=1e-5)
    assert np.abs(found.horizontal) == pytest.approx(np.abs(4 * FX), abs=1e-4)


@pytest.mark.parametrize(
    ("wish", "said"),
    [
        ("fz=Fz1+Fz2,cop=COPx1", "the same plates"),
        ("fz=Fz1+Fz2,cop=COPx1+COPx1", "the same plates"),
        ("fz=Fz1+Fz2,cop=COPx1+COPx2,fx=Fx1", "fx=Fx1 of plate 1"),
        ("fz=Fz2,cop=COPx1", "fz=Fz2 of plate 2"),
    ],
)
def test_columns_of_other_plates_than_the_loads_are_refused(tmp_path, wish, said):
    with pytest.raises(BadInput) as caught:
        read(PLATES, tmp_path / "trial.csv", columns=wish)
    assert said in str(caught.value)


def test_one_plate_of_two_takes_no_horizontal_force_of_both(tmp_path):
    names = "Time,LGRF_X,LGRF_Y,LGRF_Z,RGRF_Y,LCOP_X,GRFNET_X,GRFNET_Y,GRFNET_Z,COPNET_X\n"
    content = names + rows([T, FX, FZ, FY, FZ / 9, COP, 3 * FX, FZ * 10 / 9, FY, COP])
    found = read(content, tmp_path / "trial.csv", columns="fz=LGRF_Y,cop=LCOP_X")
    assert np.abs(found.horizontal) == pytest.approx(np.abs(FX), abs=1e-4)
    without = content.replace("LGRF_X", "other")
    assert read(without, tmp_path / "trial.csv", columns="fz=LGRF_Y,cop=LCOP_X").horizontal is None
