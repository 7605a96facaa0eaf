"""Figures draw the numbers that they are given: measured, modelled, residuals, laws, errors of stages, films."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib import animation

from pliant.errors import InputError
from pliant.plotting import PAGE_WIDTH, page
from pliant.selection import ModelSelection, SelectionStep
from pliant.validation import figures
from pliant.validation.draw import map_error
from pliant.validation.selection_figures import selection_figure, shape_figure
from pliant.validation.use_figures import body_film


def legend(figure):
    return [text.get_text() for each in figure.legends for text in each.get_texts()]


def shows(ax, values, **look):
    """Whether a line of an axis has these ordinates."""
    lines = [line for line in ax.lines if all(getattr(line, f"get_{k}")() == v for k, v in look.items())]
    return any(np.shape(y := line.get_ydata()) == np.shape(values) and np.allclose(y, values, equal_nan=True)
               for line in lines)  # fmt: skip


def test_a_record_shows_measured_over_modelled_residuals_and_pressure(outcome):
    record = outcome.fits[0].records[0]
    exp, figure = record.experiment, figures.record_figure(record)
    rows = {ax.get_ylabel(): ax for ax in figure.axes}
    for s in range(3):
        for k, name in enumerate("xy"):
            ax = rows[f"link {s + 1} {name} (mm)"]
            assert shows(ax, 1e3 * exp.position[:, s, k])
            assert shows(ax, 1e3 * record.modelled[:, s, k])
    residual = 1e3 * (record.modelled - exp.position)
    for k, name in enumerate("xy"):
        ax = rows[f"residual\n{name} (mm)"]
        assert all(shows(ax, residual[:, s, k]) for s in range(3))
        assert shows(ax, [0.0, 0.0])
        assert sum(line.get_label() == "other stations" for line in ax.lines) == 1
    below = rows["pressure\n(kPa)"]
    assert shows(below, 1e-3 * record.pressure.reshape(-1))
    assert shows(below, [10.0, 10.0], label="nominal pressure")


def test_a_traced_record_shows_the_log_within_the_recording(outcome):
    record = outcome.fits[0].records[1]
    below = figures.record_figure(record).axes[-1]
    (line,) = (line for line in below.lines if line.get_label() == "measured pressure")
    trace = record.experiment.pressure
    near = (trace.time >= record.experiment.time[0]) & (trace.time <= record.experiment.time[-1])
    np.testing.assert_allclose(line.get_ydata(), 1e-3 * trace.pressure[near])


def test_residuals_show_their_correlation_and_the_band_of_white_noise(outcome):
    record = outcome.fits[0].records[0]
    left, right = figures.residual_figure(record).axes
    residual = 1e3 * (record.modelled[:, -1] - record.experiment.last_station)
    for k, name in enumerate("xy"):
        assert shows(left, residual[:, k], label=name)
        assert right.lines[k].get_ydata()[0] == pytest.approx(1.0)
    (band,) = right.patches
    assert band.get_height() == pytest.approx(2 * 1.96 / np.sqrt(len(residual)))
    assert [t.get_text() for t in right.get_legend().get_texts()] == ["95 % of white noise"]  # x and y: at the left


def test_a_path_shows_the_body_at_telling_instants_from_its_base(outcome):
    record = outcome.fits[0].records[1]
    figure = figures.path_figure(record)
    (ax,) = figure.axes
    chains = [line for line in ax.lines if line.get_marker() == "o"]
    assert len(chains) == sum(line.get_marker() == "+" and len(line.get_xdata()) == 3 for line in ax.lines) > 1
    for line in chains:
        (k,) = np.flatnonzero(np.isclose(1e3 * record.modelled[:, -1, 0], line.get_xdata()[-1], rtol=0, atol=1e-9))[:1]
        np.testing.assert_allclose(line.get_xydata(), 1e3 * np.vstack([[0.0, 0.0], record.modelled[k]]))
    assert {"modelled stations", "measured stations", "first frame"} <= set(legend(figure))
    times = [text.get_text() for text in ax.texts]
    assert len(times) == 2
    assert times[0] == "0.00 s"


def test_a_torque_law_is_marked_where_records_were_taken(outcome):
    (ax,) = figures.torque_figure(outcome.fits).axes
    chamber = outcome.model.chambers[0]
    curve = next(line for line in ax.lines if line.get_label().endswith("polynomial law"))
    np.testing.assert_allclose(curve.get_ydata(), 1e3 * chamber.torque_at(1e3 * curve.get_xdata()))
    assert curve.get_xdata().max() == pytest.approx(1.05 * 20.0)  # a little beyond the highest level
    marks = [line for line in ax.lines if line.get_linestyle() == "None"]
    taken = sorted((float(line.get_xdata()[0]), line.get_markerfacecolor() == "white") for line in marks)
    assert taken == [(0.0, True), (10.0, False), (10.0, False), (20.0, True), (20.0, True)]  # open: held out
    for line in marks:
        assert line.get_ydata()[0] == pytest.approx(1e3 * chamber.torque_at(1e3 * line.get_xdata()[0]))
    assert [t.get_text() for t in ax.get_legend().get_texts()][-2:] == ["training level", "held out level"]


def test_a_forecast_shows_its_band(outcome):
    forecast = outcome.forecasts[0]
    banded = replace(forecast, half_width=np.full(forecast.tip.shape, 2e-3))
    figure = figures.forecast_figure(banded)
    for k, ax in enumerate(figure.axes):
        tip = 1e3 * forecast.tip[:, k]
        assert shows(ax, tip)
        edges = ax.collections[0].get_paths()[0].vertices[:, 1]
        assert (edges.min(), edges.max()) == pytest.approx((tip.min() - 2.0, tip.max() + 2.0))
    assert legend(figure) == ["predicted, not recorded", "95 % band"]
    assert legend(figures.forecast_figure(forecast)) == ["predicted, not recorded"]


def test_a_shape_is_drawn_with_its_chain_at_each_instant(shape):
    fan, snaps = shape_figure(shape).axes
    assert len(fan.lines) > 3
    assert len(snaps.lines) >= 3  # measured, chain and spline at the instants


def assert_labels_inside(ax):
    """No label of a point runs past the frame, and the list of models stays on the paper, below the axes."""
    ax.figure.draw_without_rendering()
    frame, paper = ax.get_window_extent(), ax.figure.bbox
    for text in ax.texts:
        box = text.get_window_extent()
        assert frame.x0 <= box.x0 <= box.x1 <= frame.x1, text.get_text()
    models = ax.figure._supxlabel.get_window_extent()
    assert paper.x0 <= models.x0 <= models.x1 <= paper.x1
    assert paper.y0 <= models.y0
    assert models.y1 < ax.xaxis.label.get_window_extent().y0
    assert ax.figure.get_figheight() <= 120 / 25.4


@pytest.mark.parametrize("width", [PAGE_WIDTH, 88 / 25.4])
def test_the_labels_of_many_terms_stay_on_the_figure(width):
    """Long names of terms, neighbours in the number of parameters; on a page and in a column."""
    title = "springs that soften or stiffen, within a bound of 0.75 of K"
    steps = tuple(SelectionStep("creep" * (k > 0), title, "joins", ("a",) * (k + 1), 0.1, {"x": 9.0 / (k + 1)},
                                {"x": 10.0 / (k + 1)}) for k in range(12))  # fmt: skip
    with page(width):
        (ax,) = selection_figure(ModelSelection(steps, ("creep",), "", None, 1.0)).axes
    assert_labels_inside(ax)


def test_a_model_selection_shows_the_errors_of_each_model_and_the_choice():
    steps = (SelectionStep("", "first", "begins", ("a",), 0.5, {"x": 9.0}, {"x": 10.0}),
             SelectionStep("creep", "creep", "joins", ("a", "b", "c"), 0.1, {"x": 3.0}, {"x": 4.0}),
             SelectionStep("lag", "without lag", "leaves", ("a", "b"), 0.1, {"x": 3.5}, {"x": 3.9}))
    (ax,) = selection_figure(ModelSelection(steps, ("creep",), "", None, 1.0)).axes
    lines = {line.get_label(): line.get_xydata().tolist() for line in ax.lines}
    assert lines == {"training": [[1, 9], [3, 3], [2, 3.5]], "parts left out": [[1, 10], [3, 4], [2, 3.9]],
                     "chosen": [[2, 3.9]]}
    assert [t.get_text() for t in ax.texts] == ["1", "2", "3"]
    assert ax.figure.get_supxlabel().split("\n") == ["1  first", "2  + creep", "3  without lag"]
    assert ax.get_xlabel() == "free parameters"
    assert_labels_inside(ax)
    (ax,) = selection_figure(ModelSelection(steps, ("creep",), "", None, 1.0), 5.0).axes
    (line,) = (line for line in ax.lines if line.get_label() == "plain map, left out")
    assert list(line.get_ydata()) == [5.0, 5.0]
    assert line.get_linestyle() == ":"


def test_numbers_of_models_that_lie_on_each_other_share_a_place():
    errors = (("", 10.0), ("creep", 4.0), ("lag", 3.9), ("clock", 2.0))
    steps = tuple(SelectionStep(n, n, "joins", ("a", "b"), 0.1, {"x": error}, {"x": error}) for n, error in errors)
    (ax,) = selection_figure(ModelSelection(steps, ("creep",), "", None, 1.0)).axes
    assert [t.get_text() for t in ax.texts] == ["1", "2, 3", "4"]


def test_a_parameter_that_is_held_at_the_end_has_no_number_of_its_own():
    steps = tuple(SelectionStep("", *changed, ("a", "b"), 0.1, {"x": 3.0}, {"x": error}) for *changed, error in (
        ("first", "begins", 9.0), ("creep", "joins", 4.0), ("creep_time_1 held at 2", "settles", 5.5)))
    (ax,) = selection_figure(ModelSelection(steps, ("creep",), "", None, 1.0)).axes
    assert [t.get_text() for t in ax.texts] == ["1", "2"]
    assert ax.figure.get_supxlabel().split("\n") == ["1  first", "2  + creep", "    creep_time_1 held at 2"]
    assert ax.lines[1].get_xydata().tolist()[-1] == [2, 5.5]


def test_the_error_of_the_plain_map_is_scaled_to_left_out_parts():
    plain = SimpleNamespace(left_out_error=3.0, training_error=2.0, records={
        name: {"rmse_percent_of_travel": error} for name, error in (("a", 4.0), ("b", 6.0), ("c", 99.0))
    })
    records = [SimpleNamespace(name=n, role=role) for n, role in (("a", "train"), ("b", "train"), ("c", "held_out"))]
    assert map_error(SimpleNamespace(baseline=plain, records=records)) == pytest.approx(7.5)
    assert map_error(SimpleNamespace(baseline=None, records=records)) is None


@pytest.mark.parametrize("chambers", [1, 2])
def test_a_film_shows_the_body_the_way_of_its_tip_and_the_pressure_now(tmp_path, monkeypatch, chambers):
    time = np.linspace(0.0, 1.0, 101)
    tips = np.stack([np.stack([-0.1 * k * np.sin(time), 0.1 * k * np.cos(time)], axis=1) for k in (1, 2)], axis=1)
    pressure = np.outer(time, np.arange(1, chambers + 1)) * 20
    base = np.array([[0.0, 0.0], [0.0, 0.01]])
    kept = {}
    monkeypatch.setattr(animation.FuncAnimation, "save", lambda film, path, **how: kept.update(film=film, **how))
    body_film(tmp_path / "f.gif", time, base, tips, pressure, "pressure (kPa)", rate=20)
    film, figure = kept["film"], kept["film"]._fig
    film._draw_was_started = True
    frames = list(film.new_frame_seq())
    assert (kept["writer"], kept["fps"], len(frames)) == ("pillow", 20, 20)
    np.testing.assert_allclose(time[frames], np.arange(20) / 20, atol=0.0101)  # a frame of the motion or the next
    place, side = figure.axes
    line, way, now = film._func(60)
    np.testing.assert_allclose(line.get_xydata(), 1e3 * np.vstack([base, tips[60]]))
    np.testing.assert_allclose(way.get_xydata(), 1e3 * tips[:61, 1])
    np.testing.assert_allclose(now.get_xydata(), np.stack([np.full(chambers, time[60]), pressure[60]], axis=1))
    assert place.get_aspect() == 1.0
    assert place.get_xlim()[0] < 1e3 * tips[..., 0].min()
    assert place.get_xlim()[1] > 0.0
    assert place.get_ylim()[0] < 0.0
    assert place.get_ylim()[1] > 200.0
    np.testing.assert_allclose(np.stack([drawn.get_ydata() for drawn in side.lines[:chambers]], axis=1), pressure)
    monkeypatch.setattr(animation.writers, "is_available", lambda _: False)
    with pytest.raises(InputError, match=r"needs ffmpeg.*use \.gif"):
        body_film(tmp_path / "f.mp4", time, base, tips, pressure, "pressure (kPa)")
