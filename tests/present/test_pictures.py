"""Pictures: reproducible, in the form that was asked for, and showing what the run did."""

import io

import numpy as np
import pytest
from PIL import Image

from design.analysis.loop_curves import loop_curves
from design.analysis.simulate import simulate
from design.errors import BadInput
from design.model.broken_loop import breaks
from design.model.closed_loop import closed_loop
from design.model.laws import Gains
from design.present import plots
from design.present.animation import gif_bytes
from design.spec.load import load
from design.spec.setting import setting

SLOPE = setting(load("slope").spec)


def _run(kind, gains, duration=10.0):
    from dataclasses import replace

    return simulate(closed_loop(SLOPE.biped, kind), replace(SLOPE.scenarios[0], duration=duration), gains, 0.001)


def _svg(run):
    return plots.figure_bytes(plots.run_figure([run], SLOPE.biped, "t"), "svg").decode()


def test_the_same_records_give_the_same_file():
    run = _run("force", Gains(3500.0, 1200.0, 1.0))
    assert _svg(run) == _svg(run)


def test_lost_contact_is_marked_and_kept_contact_is_not():
    assert "contact lost, heel, 1.176 s" in _svg(_run("pd", Gains(3500.0, 1200.0, 0.0)))
    assert "contact lost" not in _svg(_run("force", Gains(3500.0, 1200.0, 1.0)))


def test_a_long_run_is_drawn_with_few_samples_and_every_extreme():
    run = _run("force", Gains(3500.0, 1200.0, 1.0), duration=25.003)
    thin = plots.thinned(run, most=500)
    assert len(thin.t) <= 600
    assert (np.diff(thin.t) >= 0).all()
    assert (thin.t[0], thin.t[-1]) == (run.t[0], run.t[-1])
    for name in ("theta", "F_T", "F_H", "tau", "P"):
        values, kept = getattr(run, name), getattr(thin, name)
        assert (kept.min(), kept.max()) == (values.min(), values.max())
    assert thin.F.shape == (2, len(thin.t))
    assert plots.thinned(run, most=len(run.t)) is run


def test_every_axis_has_a_unit():
    figure = plots.run_figure([_run("force", Gains(3500.0, 1200.0, 1.0))], SLOPE.biped, "")
    for ax in figure.axes:
        assert "[" in ax.get_ylabel()


@pytest.mark.parametrize("name", ["run.jpg", "run", "run.gif"])
def test_an_unknown_picture_format_is_refused(name):
    with pytest.raises(BadInput, match=r"\.png"):
        plots.format_of(name)


def test_the_animation_moves_in_real_time():
    run = _run("force", Gains(3500.0, 1200.0, 1.0), duration=1.0)
    image = Image.open(io.BytesIO(gif_bytes(SLOPE.biped, run)))
    assert image.n_frames * image.info["duration"] == pytest.approx(1000, rel=0.1)
    first = np.asarray(image.convert("RGB"), dtype=int)
    image.seek(image.n_frames - 1)
    assert np.abs(np.asarray(image.convert("RGB"), dtype=int) - first).max() > 50


def test_the_root_locus_goes_from_the_open_loop_to_the_design_and_beyond():
    A, load = (np.max(part, keepdims=True) for part in SLOPE.scenarios[0].operating_points(SLOPE.biped))
    broken = breaks(SLOPE.biped, SLOPE.law, SLOPE.gains, float(A[0]), float(load[0]))["actuator"]
    locus = loop_curves(SLOPE, SLOPE.gains).locus
    for at, k in ((0, 0.0), (299, 1.0), (499, 3.0)):
        residuals = (broken.P + k * broken.Q)(locus[at])
        sizes = np.polyval(np.abs((broken.P + k * broken.Q).coef[::-1]), np.abs(locus[at]))
        assert (np.abs(residuals) <= 1e-9 * sizes).all()
