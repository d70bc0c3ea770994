"""Plates, signs, axes, routes and formats: one known truth is read as the same numbers however it is written down."""

import numpy as np
import pytest
from c3d_writer import DEC, INTEL, SGI, c3d
from plate_files import AXES, BODY, FORMATS, RATE, SHARES, SWAY, TOTAL, Truth, as_c3d

from design.errors import BadInput
from design.recordings.files import table_of
from design.recordings.reading import Reading
from design.recordings.record import recorded
from design.recordings.remarks import Subject


def routes(truth, sign, up, forward, names):
    """Ways of reading: axes alone, or columns in both orders."""
    axis, turned = forward[-1], "-" if forward.startswith("-") else ""
    count = len(truth.F)
    fz = [("-" if sign < 0 else "") + names["force"].format(k, up) for k in range(1, count + 1)]
    cop = [turned + names["cop"].format(k, axis) for k in range(1, count + 1)]
    yield "automatic", Reading(forward=forward)
    yield "cop alone", Reading(columns=f"cop={'+'.join(cop)}")
    yield "columns", Reading(columns=f"fz={'+'.join(fz)},cop={'+'.join(cop)}")
    yield "columns in another order", Reading(columns=f"fz={'+'.join(fz)},cop={'+'.join(cop[::-1])}")
    yield "fz alone", Reading(columns=f"fz={'+'.join(fz)}", forward=forward)


def cases():
    """All of them as text and arrays; C3D has z up, and the slow spreadsheet one axis."""
    for form in FORMATS:
        for plates in SHARES:
            for axes, (up, _) in AXES.items():
                few = {"C3D": up == "z" and plates != "3", "xlsx": axes == "z up, y forward" and plates != "3"}
                if few.get(form, True):
                    yield pytest.param(form, plates, axes, id=f"{form}, {plates}, {axes}")


@pytest.mark.parametrize("sign", [1, -1], ids=["on the foot", "on the plate"])
@pytest.mark.parametrize(("form", "plates", "axes"), list(cases()))
def test_every_route_gives_the_same_numbers(form, plates, axes, sign):
    up, forward = AXES[axes]
    truth = Truth(plates, up, forward)
    content, names, path = FORMATS[form](truth, sign)
    table = table_of(content, path, Reading())
    for route, how in routes(truth, sign, up, forward, names):
        record = recorded(table, how, Subject(biped=BODY, given=True))
        assert record.load == pytest.approx(truth.load, rel=1e-5), route
        assert record.cop == pytest.approx(truth.cop, abs=1e-5), route
        assert record.horizontal == pytest.approx(truth.push, abs=1e-3), route
        assert record.F_T + record.F_H == pytest.approx(truth.load, rel=1e-5), route
        assert len(record.plates) == truth.loaded, route
        assert ("empty" in " ".join(record.notes)) == (truth.loaded < len(truth.F)), route
        assert not record.warnings, route


@pytest.mark.parametrize("points", [1, 0], ids=["points", "no points"])
@pytest.mark.parametrize("integers", [False, True], ids=["reals", "integers"])
@pytest.mark.parametrize("processor", [INTEL, DEC, SGI], ids=["Intel", "DEC", "SGI"])
def test_a_c3d_file_of_every_processor_is_read(processor, integers, points):
    truth = Truth("2", "z", "x")
    content, _, path = as_c3d(truth, 1, processor=processor, integers=integers, points=points)
    record = recorded(table_of(content, path, Reading()), Reading(forward="x"), Subject(biped=BODY, given=True))
    assert record.rate == RATE
    assert record.load == pytest.approx(truth.load, rel=1e-3)
    assert record.cop == pytest.approx(truth.cop, abs=1e-4)
    assert not any("in one frame" in each or "is in m" in each for each in record.assumed)


CORNERS = np.array([[0.3, -0.3, -0.3, 0.3], [0.2, 0.2, -0.2, -0.2], [0, 0, 0, 0]]) + np.array([[0.5], [0.1], [0]])
COP = 0.52 + 0.01 * SWAY
NIL = 0 * SWAY


def plate(analog, *, scale=1e3, **form):
    """The record of a C3D file with one plate that has its corners at ``CORNERS`` [m], times ``scale`` there."""
    pytest.importorskip("ezc3d", reason="ezc3d is not installed")
    form = {"origins": [[0, 0, 0]], "labels": list("abcdefgh")[: len(analog)], **form}
    content = c3d(np.stack(analog), rate=RATE, corners=[scale * CORNERS], **form)
    how = Reading(forward="x")
    return recorded(table_of(content, "trial.c3d", how), how, Subject(biped=BODY, given=True))


@pytest.mark.parametrize(("moment", "times"), [("Nmm", 1e3), ("Nm", 1.0)])
@pytest.mark.parametrize("depth", [0.0, -40.0])
def test_a_plate_of_type_2_with_its_origin_below_the_surface_is_read(moment, times, depth):
    fx = -5 * SWAY  # the moment is about the sensors, M = (p + o) x F, with o = (0, 0, depth) from there to the centre
    my = -(COP - 0.5) * TOTAL + depth / 1e3 * fx
    analog = [fx, NIL, TOTAL, NIL, times * my, NIL]
    record = plate(analog, units=["N"] * 3 + [moment] * 3, origins=[[0, 0, depth]])
    assert record.load == pytest.approx(TOTAL, rel=1e-5)
    assert record.cop == pytest.approx(COP, abs=1e-5)


def test_a_plate_of_type_3_with_four_sensors_is_read():
    a, b = 0.2, 0.12  # the sensors are at (±a, ±b), from the first quadrant on
    share = (COP - 0.5) / (4 * a) * TOTAL
    corner = [TOTAL / 4 + sign * share for sign in (1, -1, -1, 1)]
    analog = [-2.5 * SWAY, -2.5 * SWAY, NIL, NIL, *corner]
    record = plate(analog, units=["N"] * 8, kind=3, per_plate=8, origins=[[1e3 * a, 1e3 * b, 0]])
    assert record.load == pytest.approx(TOTAL, rel=1e-5)
    assert record.cop == pytest.approx(COP, abs=1e-5)


def test_the_unit_of_positions_must_fit_the_corners():
    analog = [NIL, NIL, TOTAL, NIL, -1e3 * (COP - 0.5) * TOTAL, NIL]
    units = ["N"] * 3 + ["Nmm"] * 3
    assert plate(analog, units=units).cop == pytest.approx(COP, abs=1e-5)
    assert plate(analog, units=units, points=0, scale=1.0).cop == pytest.approx(COP, abs=1e-5)
    with pytest.raises(BadInput, match=r"states positions in m .* they fit in mm"):
        plate(analog, units=units, position="m")
