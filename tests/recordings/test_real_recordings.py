"""Four recordings of people standing are read as those who made them say; in wrong units or axes they are not read."""

from pathlib import Path

import numpy as np
import pytest

from design.errors import BadInput
from design.model.body import Biped
from design.recordings.horizontal import against_cop
from design.recordings.reading import Reading
from design.recordings.record import derivative, open_record

DATA = Path(__file__).parents[2].parent / "shared" / "data"
OR1, ONE_PLATE, DROPOUTS, MARKERS = (
    DATA / name for name in ("pds13_or1_grf.txt", "bds00001.txt", "amti_dropouts.csv", "bmc_posture_cog_ankles.csv")
)
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"the recordings are not at {DATA}")


def person(mass, half_length=0.12, height=0.92):
    return Biped(M=mass - 2.0, L=height, I=70.0, m=2.0, ell=half_length)


SUBJECTS = {OR1: person(65.35, 0.2405 / 2), ONE_PLATE: person(54.2, 0.218 / 2), DROPOUTS: person(59.4)}


def record(path, biped=None, **how):
    body = biped or SUBJECTS.get(path) or person(70.0)
    return open_record(str(path), Reading(**how), body, given=True)


def refusal(path, **how):
    with pytest.raises(BadInput) as caught:
        record(path, **how)
    return str(caught.value)


@pytest.mark.parametrize(("path", "mass"), [(OR1, 65.35), (ONE_PLATE, 54.2)], ids=["two plates", "one plate"])
def test_the_mean_vertical_force_is_the_stated_body_weight(path, mass):
    found = record(path)
    assert found.load[found.valid].mean() == pytest.approx(mass * 9.81, rel=0.02)
    assert not found.warnings


@pytest.mark.parametrize("path", [ONE_PLATE, DROPOUTS], ids=["Z up, cm", "AMTI"])
def test_cop_from_moments_is_the_files_cop(path):
    stated, computed = record(path), record(path, columns="cop=none")
    good = stated.valid
    assert np.abs(stated.cop - computed.cop)[good].max() < 1e-6
    assert any("CoP equals -my / fz" in note for note in stated.notes)


@pytest.mark.parametrize("columns", ["fz=RGRF_Y+LGRF_Y", "cop=RCOP_X+LCOP_X", "fz=LGRF_Y+RGRF_Y,cop=RCOP_X+LCOP_X"])
def test_the_sum_of_two_plates_is_the_net_force_and_cop_that_the_laboratory_wrote(columns):
    net, added = record(OR1, forward="x"), record(OR1, columns=columns, forward="x")
    assert added.load == pytest.approx(net.load, abs=1e-4)
    assert added.cop == pytest.approx(net.cop, abs=1e-5)
    assert added.horizontal == pytest.approx(net.horizontal, abs=1e-4)
    assert len(added.plates) == 2


def test_toe_and_heel_force_turn_back_into_load_and_cop():
    found = record(OR1, ankle="0.2")
    assert found.F_T + found.F_H == pytest.approx(found.load)
    assert (found.F_T - found.F_H) * found.biped.ell / found.load == pytest.approx(found.cop - 0.2)


def test_the_vertical_axis_is_told_from_the_data():
    assert any(note.startswith("y points up") for note in record(OR1).notes)
    assert any(note.startswith("z points up") for note in record(ONE_PLATE).notes)


def test_every_dropout_is_found_and_masked_and_nothing_else_is():
    found = record(DROPOUTS)
    assert len(found.t) == 15605
    assert np.flatnonzero(found.dropouts).tolist() == [1, 2, 15600, 15601, 15602, 15603, 15604]
    assert (found.valid == ~found.dropouts).all()
    assert found.spans(found.dropouts) == [(0.01, 0.02, 2), (156.0, 156.04, 5)]
    assert found.load[found.valid].min() > 500


def test_what_nobody_said_is_listed_as_assumed():
    free = open_record(str(ONE_PLATE), Reading(), person(70.0), given=False)
    said = " ".join(free.assumed)
    for part in ("mass 54.83 kg", "foot of the built-in", "ankle taken at -0.08035 m", "x points forward"):
        assert part in said
    told = record(ONE_PLATE, ankle="-8:cm", forward="x")
    assert not told.assumed


def test_markers_alone_give_the_angle_and_no_force():
    found = record(MARKERS)
    assert found.load is None
    assert found.P is None
    assert np.degrees(found.theta).mean() == pytest.approx(4.169, abs=0.01)
    assert found.height.mean() == pytest.approx(0.8806, abs=1e-3)
    assert np.abs(found.omega - np.gradient(found.theta, found.t)).max() < 0.02


@pytest.mark.parametrize(
    ("path", "how", "words"),
    [
        (OR1, {"up": "z"}, ("--up", "largest along y", "635.4")),
        (ONE_PLATE, {"up": "y"}, ("--up", "largest along z")),
        (MARKERS, {"up": "z"}, ("--up", "largest along y")),
        (OR1, {"columns": "fz=GRFNET_Z"}, ("GRFNET_Z", "horizontal component")),
        (OR1, {"columns": "fz=GRFNET_Y:kN"}, ("read in kN", "fits if the column is in N")),
        (OR1, {"columns": "fz=GRFNET_Y:kgf"}, ("read in kgf", "fits if the column is in N")),
        (OR1, {"columns": "fz=GRFNET_Y:lbf"}, ("read in lbf", "fits if the column is in N")),
        (OR1, {"columns": "fz=RGRF_Y,cop=RCOP_X"}, ("one of two plates",)),
        (OR1, {"columns": "cop=COPNET_X:mm"}, ("only", "is it in m?")),
        (OR1, {"columns": "cop=COPNET_X:cm"}, ("only", "is it in m?")),
        (OR1, {"columns": "time=Time:ms"}, ("sampling rate of 1e+05 Hz", "perhaps in s")),
        (OR1, {"ankle": "20"}, ("--ankle", "from the ankle")),
        (ONE_PLATE, {"columns": "cop=COPx:m"}, ("COPx", "in cm by the file", "says m")),
        (ONE_PLATE, {"columns": "my=-My"}, ("minus -my / fz", "sign")),
        (ONE_PLATE, {"columns": "my=Mx"}, ("does not move with -my / fz",)),
        (ONE_PLATE, {"columns": "fz=COPx"}, ("COPx", "fz is a force")),
        (DROPOUTS, {"columns": "cop=Cx:cm"}, ("0.01 times -my / fz", "fits if the column is in m")),
        (DROPOUTS, {"columns": "my=My:N mm"}, ("1000 times -my / fz",)),
        (DROPOUTS, {"columns": "time=MocapFrame"}, ("1 Hz", "header states 100 Hz")),
        (MARKERS, {"columns": "com_y=COG_Y:cm,ankle_y=R.Ankle_Y:cm"}, ("above the ankles", "--up, or the unit")),
    ],
)  # fmt: skip
def test_a_wrong_unit_axis_or_sign_is_refused_with_the_mismatch_named(path, how, words):
    said = refusal(path, **how)
    for word in words:
        assert word in said, said


def test_another_body_is_remarked_upon_and_a_far_one_refused():
    found = open_record(str(OR1), Reading(), person(80.0), given=True)
    assert "19 % off" in " ".join(found.warnings).replace("-19", "19")
    with pytest.raises(BadInput, match="times the weight"):
        open_record(str(OR1), Reading(), person(170.0), given=True)


@pytest.mark.parametrize("path", [OR1, ONE_PLATE, DROPOUTS], ids=["on the foot", "on the plate", "AMTI, on the plate"])
def test_the_horizontal_force_is_that_on_the_foot_which_moves_against_the_cop(path):
    found = record(path)
    assert against_cop(found.horizontal, found.cop, found.rate) < -0.7
    turned = any("force on the plate" in note for note in found.notes)
    assert turned == (path != OR1)
    assert found.columns["fx"].startswith("-") == turned
    back = record(path, forward="-x")
    assert back.horizontal == pytest.approx(-found.horizontal)


def test_the_sign_of_a_horizontal_force_that_the_user_gives_is_kept():
    found = record(ONE_PLATE, columns="fx=Fx")
    assert "fx=-Fx" in " ".join(found.warnings)
    turned = record(ONE_PLATE, columns="fx=-Fx")
    assert not turned.warnings
    assert turned.horizontal == pytest.approx(-found.horizontal)
    assert record(OR1, columns="fx=-GRFNET_X").horizontal == pytest.approx(-record(OR1).horizontal)


def test_a_forward_axis_turns_the_cop():
    ahead, back = record(ONE_PLATE, forward="x"), record(ONE_PLATE, forward="-x")
    assert back.cop == pytest.approx(-ahead.cop)
    side = record(ONE_PLATE, forward="y")
    assert side.cop.mean() == pytest.approx(0.0097, abs=1e-4)
    assert any("CoP equals" in note for note in side.notes)


def test_the_derivative_of_a_parabola_is_its_slope():
    t = np.arange(100) / 50
    assert derivative(t, 3 * t**2 - t)[10:-10] == pytest.approx((6 * t - 1)[10:-10])
