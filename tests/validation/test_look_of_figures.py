"""How figures look: widths, marks and greys of every kind of line, sizes, legends and aligned labels.

docs/figures hold what is printed: what is measured is thick and grey, what is modelled thin and dark.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

from pliant.identification import Band
from pliant.plotting import page
from pliant.validation import figures, use_figures
from pliant.validation.curves import slenderness
from pliant.validation.selection_figures import order_figure, shape_figure
from pliant.validation.use_figures import body_film, motion_figure

MEASURED, MODELLED = ("0.57", "-", 1.9, "None"), ("#0b2f6b", "-", 0.9, "None")
X, Y, Z = ("black", "-", 0.85, "None"), ("#c1440e", "--", 0.85, "None"), ("#0b6b5b", "--", 0.85, "None")
COLUMN = 88 / 25.4  # inches


def looks(ax):
    """Colour, dash, width and mark of the lines of an axis, by their labels."""
    return {line.get_label(): (line.get_color(), line.get_linestyle(), line.get_linewidth(), line.get_marker())
            for line in ax.lines if not line.get_label().startswith("_")}  # fmt: skip


def aligned(figure):
    """How many axes share their labels' place with each of them."""
    groups = figure._align_label_groups["y"]
    return [len(groups.get_siblings(ax)) for ax in figure.axes]


def labels(figure):
    return [(ax.get_xlabel(), ax.get_ylabel()) for ax in figure.axes]


def below(figure):
    """Labels and columns of the legend below a figure."""
    (legend,) = figure.legends
    return [text.get_text() for text in legend.get_texts()], legend._ncols


def test_a_record_in_lines_points_and_residuals(outcome):
    figure = figures.record_figure(outcome.fits[0].records[0])
    assert tuple(figure.get_size_inches()) == pytest.approx((7.16, 0.6 + 1.3 * (3 + 0.8 + 0.7)))
    first, _, second, *_ = figure.axes
    assert looks(first) == {"measured": ("0.35", "None", 1.0, "+"), "modelled": MODELLED}  # 120 frames are seen
    (points,) = (line for line in first.lines if line.get_label() == "measured")
    assert (points.get_markersize(), points.get_markeredgewidth()) == (4.5, 0.9)
    assert looks(second) == {"measured": MEASURED, "modelled": MODELLED}
    residual, pressure = figure.axes[6], figure.axes[8]
    assert looks(residual) == {"other stations": ("0.7", "-", 0.6, "None"), "last station": ("black", "-", 0.7, "None")}
    (zero,) = (line for line in residual.lines if np.size(line.get_ydata()) == 2)
    assert (zero.get_color(), zero.get_linewidth(), list(zero.get_ydata())) == ("0.4", 0.5, [0, 0])
    assert looks(pressure) == {"nominal pressure": ("0.5", ":", 1.2, "None"),
                               "pressure behind the valve": ("black", "--", 0.9, "None")}  # fmt: skip
    (behind,) = (line for line in pressure.lines if line.get_label() == "pressure behind the valve")
    assert behind._unscaled_dash_pattern[1] == (5, 1.5)
    assert below(figure) == (["measured", "modelled", "other stations", "last station", "nominal pressure",
                              "pressure behind the valve"], 3)  # fmt: skip
    assert aligned(figure) == [5, 4] * 4 + [5]
    assert labels(figure)[6:] == [("", "residual\nx (mm)"), ("", "residual\ny (mm)"), ("time (s)", "pressure\n(kPa)")]
    shown = [ax.xaxis.get_tick_params()["labelbottom"] for ax in figure.axes]
    assert shown == [False] * 8 + [True]
    heights = [ax.get_subplotspec().get_gridspec().get_height_ratios() for ax in figure.axes[:1]]
    assert heights == [[1.0, 1.0, 1.0, 0.8, 0.7]]
    with page(COLUMN):
        narrow = figures.record_figure(outcome.fits[0].records[0])
    assert tuple(narrow.get_size_inches()) == pytest.approx((COLUMN, 4.6))
    assert below(narrow)[1] == 2


@pytest.mark.parametrize(("seen", "mark"), [(120, "+"), (121, "None")])
def test_up_to_a_hundred_and_twenty_frames_are_drawn_one_by_one(outcome, seen, mark):
    value = np.where(np.arange(140) < seen, 1.0, np.nan)
    ax = Figure().subplots()
    figures.measured(ax, np.arange(140.0), value)
    assert ax.lines[0].get_marker() == mark
    record = outcome.fits[0].records[0]
    exp = record.experiment
    place = exp.position.copy()
    place[seen:, -1, 0] = np.nan
    path = figures.path_figure(replace(record, experiment=replace(exp, position=place)))
    (line,) = (line for line in path.axes[0].lines if line.get_label() == "measured")
    assert line.get_marker() == mark


def test_a_band_lies_behind_the_lines_of_its_station(outcome):
    record = outcome.fits[0].records[0]
    exp = record.experiment
    half = 1e-3 * (1 + np.arange(6).reshape(3, 2)) * np.ones((len(exp.time), 3, 2))
    at = record.modelled
    banded = replace(record, band=Band(at, half / 2, at - half, at + half, 0.95))
    figure = figures.record_figure(banded)
    for s in range(3):
        for k in range(2):
            (patch,) = figure.axes[2 * s + k].collections
            edge = patch.get_paths()[0].vertices
            low, high = 1e3 * (at - half)[:, s, k], 1e3 * (at + half)[:, s, k]
            assert (edge[:, 1].min(), edge[:, 1].max()) == pytest.approx((low.min(), high.max()))
            assert (edge[:, 0].min(), edge[:, 0].max()) == pytest.approx((exp.time[0], exp.time[-1]))
            assert len(np.unique(edge[:, 0])) == len(exp.time)  # all frames, as there are fewer than 400
            assert patch.get_label() == "95 % band"
            assert patch.get_zorder() == 0.5
            assert patch.get_linewidth()[0] == 0.4
            assert patch.get_facecolor()[0, 0] == pytest.approx(0.9)
            assert patch.get_edgecolor()[0, 0] == pytest.approx(0.75)


def test_many_frames_of_a_band_are_thinned_to_four_hundred(outcome):
    record, count = outcome.fits[0].records[0], 3000
    time, zero = np.arange(count) / 1000, np.zeros((count, 1, 2))
    band = Band(zero, zero, zero - 1e-3, zero + 2e-3, 0.9, "deg", 50.0)
    ax = Figure().subplots()
    figures.draw_band(ax, SimpleNamespace(band=band, experiment=SimpleNamespace(time=time)), 0, 1)
    edge = ax.collections[0].get_paths()[0].vertices
    assert len(np.unique(edge[:, 0])) == 400
    assert (edge[:, 1].min(), edge[:, 1].max()) == pytest.approx((-0.05, 0.1))
    assert ax.collections[0].get_label() == "90 % band"
    figures.draw_band(ax, record, 0, 0)  # without a band nothing is drawn
    assert len(ax.collections) == 1


def test_several_traces_are_drawn_in_greys_of_their_own(outcome):
    record = outcome.fits[0].records[0]
    exp = record.experiment
    time = np.linspace(-0.5, 2.0, 251)
    traces = {name: SimpleNamespace(time=time, pressure=1e3 * k * (time + 1)) for k, name in enumerate("abcde", 1)}
    driven = SimpleNamespace(traces=traces, time=exp.time, pressure=1, level=0.0)
    drawn = replace(record, experiment=driven, pressure=np.outer(exp.time, [1e3, 2e3]))
    ax = Figure().subplots()
    figures.draw_inputs(ax, drawn)
    inside = (time >= exp.time[0]) & (time <= exp.time[-1])
    for k, (name, grey) in enumerate(zip("abcde", ("0.57", "0.45", "0.33", "0.21", "0.57"), strict=True), 1):
        (line,) = (line for line in ax.lines if line.get_label() == f"measured pressure, {name}")
        assert (line.get_color(), line.get_linewidth()) == (grey, 1.9)
        np.testing.assert_allclose(line.get_data(), [time[inside], k * (time[inside] + 1)])
    assert [float(line.get_ydata()[-1]) for line in ax.lines[5:]] == pytest.approx([exp.time[-1], 2 * exp.time[-1]])


@pytest.mark.parametrize(("inputs", "label", "factors"), [
    ({"a": "N", "b": "N"}, "tension\n(N)", (1.0, 1.0)), ({"a": "rad", "b": "rad"}, "motor angle\n(rad)", (1.0, 1.0)),
    ({"a": "m", "b": "m"}, "displacement\n(mm)", (1e3, 1e3)), ({"a": "Pa", "b": "m"}, "input\n(kPa, mm)", (1e-3, 1e3)),
])  # fmt: skip
def test_inputs_of_tendons_are_drawn_in_their_own_units(outcome, inputs, label, factors):
    record = outcome.fits[0].records[0]
    time = record.experiment.time
    traces = {"b": SimpleNamespace(time=time, pressure=0.2 * time)}
    driven = SimpleNamespace(traces=traces, time=time, pressure=1, level=0.0)
    ax = Figure().subplots()
    figures.draw_inputs(ax, replace(record, experiment=driven, pressure=np.outer(time, [0.1, 0.2]), inputs=inputs))
    assert ax.get_ylabel() == label
    expected = (0.2 * factors[1], 0.1 * factors[0], 0.2 * factors[1])
    for line, slope in zip(ax.lines, expected, strict=True):
        np.testing.assert_allclose(line.get_ydata(), slope * np.asarray(line.get_xdata()), rtol=1e-12, atol=1e-15)


def test_fits_side_by_side(outcome):
    fits = (*outcome.fits, *outcome.fits, *outcome.fits)
    figure = figures.comparison_figure(fits, "low")
    assert tuple(figure.get_size_inches()) == pytest.approx((7.16, 4.2))
    assert len(figure.axes) == 3 * 4  # four fits at most
    record = outcome.fits[0].records[0]
    for k in range(2):
        assert looks(figure.axes[4 * k]) == {"measured": MEASURED, "modelled": MODELLED}
        np.testing.assert_allclose(figure.axes[4 * k].lines[0].get_ydata(), 1e3 * record.experiment.last_station[:, k])
        np.testing.assert_allclose(figure.axes[4 * k].lines[1].get_ydata(), 1e3 * record.modelled[:, -1, k])
    assert looks(figure.axes[8]) == {"distance": ("black", "-", 0.7, "None")}
    away = record.modelled[:, -1] - record.experiment.last_station
    np.testing.assert_allclose(figure.axes[8].lines[0].get_ydata(), 1e3 * np.hypot(*away.T))
    assert labels(figure)[8:] == [("time (s)", "distance (mm)"), *[("time (s)", "")] * 3]
    assert [y for _, y in labels(figure)[:8:4]] == ["link 3 x (mm)", "link 3 y (mm)"]
    assert figure.axes[8].get_ylim()[0] == 0.0
    assert below(figure) == (["measured", "modelled"], 2)
    assert aligned(figure)[0] == 3
    titles = [ax.get_title(loc="left") for ax in figures.comparison_figure(outcome.fits, "low").axes[:2]]
    assert titles[1] == f"_polynomial law\ntraining:\nRMSE {record.metrics['rmse_mm']:.3g} mm"
    longer = replace(outcome.fits[0], title="x" * 59)
    for count, wide in ((1, 59), (2, 47), (4, 23)):  # 95 letters across the figure
        shown = figures.comparison_figure((longer,) * count, "low").axes[0].get_title(loc="left")
        assert max(map(len, shown.split("\ntraining")[0].split("\n"))) == wide


@pytest.mark.parametrize("width", [7.16, COLUMN])
def test_long_names_of_stations_do_not_run_into_the_next_panel(outcome, width):
    """Names as trackers give them, in a column and on a page."""
    record = outcome.fits[0].records[0]
    names = tuple(f"left front marker {k}" for k in range(len(record.experiment.stations)))
    with page(width):
        figure = figures.record_figure(replace(record, experiment=replace(record.experiment, stations=names)))
    figure.draw_without_rendering()
    boxes = [ax.yaxis.label.get_window_extent() for ax in figure.axes[0:8:2]]  # one column, from the top
    assert all(lower.y1 < upper.y0 for upper, lower in pairwise(boxes))
    assert len({ax.get_ylabel() for ax in figure.axes[0:6:2]}) == 3  # the numbers are not cut off


def test_residuals_and_their_correlation(outcome):
    left, right = (figure := figures.residual_figure(outcome.fits[0].records[0])).axes
    assert tuple(figure.get_size_inches()) == pytest.approx((7.16, 2.5))
    assert looks(left) == {"x": X, "y": Y}
    assert [(line.get_color(), line.get_linestyle()) for line in right.lines] == [X[:2], Y[:2]]
    assert [text.get_text() for text in right.get_legend().get_texts()] == ["95 % of white noise"]  # x and y once
    assert [line._unscaled_dash_pattern[1] for line in left.lines] == [None, (4, 1.5)]
    assert figures.RESIDUALS[1] == ("#c1440e", (0, (4, 1.5)))
    assert figures.RESIDUALS[2] == ("#0b6b5b", (0, (1, 1)))
    assert left.get_legend()._ncols == 2
    least = min(line.get_ydata().min() for line in right.lines)
    assert right.get_ylim()[1] == 1.05
    assert -1.05 <= right.get_ylim()[0] <= least - 0.05  # fitted to what is drawn
    (band,) = right.patches
    assert band.get_zorder() == 0
    assert band.get_facecolor()[0] == pytest.approx(0.85)
    assert labels(figure) == [("time (s)", "residual of link 3 (mm)"), ("lag (s)", "autocorrelation")]
    widths = [ax.get_subplotspec().get_gridspec().get_width_ratios() for ax in figure.axes[:1]]
    assert list(widths[0]) == [1, 1]
    with page(COLUMN):
        assert aligned(figures.residual_figure(outcome.fits[0].records[0])) == [2, 2]
    record = outcome.fits[0].records[0]
    lone = np.full_like(record.experiment.position, np.nan)
    lone[3:15] = 1e-3 * np.arange(12)[:, None, None]
    lone[20, :, 0] = 0.0
    (band,) = (
        figures.residual_figure(replace(record, experiment=replace(record.experiment, position=lone))).axes[1].patches
    )
    assert band.get_height() == pytest.approx(2 * 1.96 / np.sqrt(13))


def test_a_torque_law_has_marks_of_its_own(outcome):
    (ax,) = (figure := figures.torque_figure(outcome.fits)).axes
    assert tuple(figure.get_size_inches()) == pytest.approx((7.16, 3.2))
    assert labels(figure) == [("gauge pressure (kPa)", "torque on each joint (mN m)")]
    assert ax.get_xlim()[0] == 0.0
    curves = [line for line in ax.lines if line.get_linestyle() != "None"]
    assert all(len(line.get_xdata()) == 200 and line.get_xdata()[0] == 0.0 for line in curves)
    marks = [line for line in ax.lines if line.get_linestyle() == "None"]
    assert [line.get_marker() for line in marks] == ["o"] * 3 + ["s"] * 2
    assert {line.get_markersize() for line in marks} == {5.5}
    assert [line.get_color() for line in marks] == [curves[0].get_color()] * 3 + [curves[1].get_color()] * 2
    assert [line.get_markerfacecolor() for line in marks[:2]] == [curves[0].get_color(), "white"]
    training, held_out = ax.get_legend().legend_handles[-2:]
    assert [h.get_markerfacecolor() for h in (training, held_out)] == ["0.3", "white"]
    assert {(h.get_marker(), h.get_markersize(), h.get_color(), h.get_linestyle()) for h in (training, held_out)} == {
        ("o", 5.5, "0.3", "None")
    }
    still = replace(outcome.fits[0], records=outcome.fits[0].records[2:])  # at no pressure: to 1.05 Pa
    assert figures.torque_figure((still,)).axes[0].lines[0].get_xdata().max() == pytest.approx(1.05e-3)


def test_a_path_and_its_body(outcome):
    record = outcome.fits[0].records[0]
    (ax,) = (figure := figures.path_figure(record)).axes
    measured, modelled = record.experiment.position, record.modelled
    height = 1.2 + 0.8 * 5.4 * slenderness(measured, modelled, body=True)
    assert tuple(figure.get_size_inches()) == pytest.approx((5.4, height))
    assert height == pytest.approx(1.2 + 0.8 * 5.4 * 1.1)  # it is slender
    assert looks(ax) == {
        "measured": MEASURED,
        "modelled": MODELLED,
        "modelled stations": ("0.15", "-", 0.8, "o"),
        "measured stations": ("black", "None", 1.0, "+"),
        "first frame": ("black", "None", 1.0, "s"),
    }
    sizes = {line.get_label(): line.get_markersize() for line in ax.lines}
    assert [sizes[k] for k in ("modelled stations", "measured stations", "first frame")] == [4.0, 7.0, 5.0]
    (first,) = (line for line in ax.lines if line.get_label() == "first frame")
    seen = measured[np.isfinite(measured[:, -1]).all(axis=1), -1]
    np.testing.assert_allclose([first.get_xdata()[0], first.get_ydata()[0]], 1e3 * seen[0])
    assert first.get_markerfacecolor() == "none"
    assert labels(figure) == [("x (mm)", "y (mm)")]
    assert (ax.get_aspect(), ax.get_adjustable()) == (1.0, "datalim")
    assert below(figure)[1] == 3
    for text, at in zip(ax.texts, (0, -1), strict=True):
        chains = [line for line in ax.lines if line.get_marker() == "o"]
        np.testing.assert_allclose(text.xy, chains[at].get_xydata()[-1])
        assert (text.xyann, text.get_fontsize(), text.get_ha()) == ((0, 9), 7, "center")
        assert text.get_bbox_patch().get_facecolor()[:3] == (1.0, 1.0, 1.0)
    with page(COLUMN):
        assert figures.path_figure(record).get_figwidth() == pytest.approx(COLUMN)
    tip = replace(record.experiment, position=measured[:, -1:], stations=("tip",))
    alone = figures.path_figure(replace(record, experiment=tip, modelled=modelled[:, -1:]))
    assert set(looks(alone.axes[0])) == {"measured", "modelled", "first frame"}  # one station is no body


@pytest.mark.parametrize(
    ("width", "height", "ratio"), [(1.0, 0.2, 0.3), (1.0, 0.7, 0.7), (1.0, 2.0, 1.1), (0.0, 1.0, 1.1)]
)
def test_a_path_is_as_slender_as_a_page_bears(width, height, ratio):
    path = np.array([[[0.0, 0.0]], [[width, 0.0]], [[0.5 * width, height]], [[np.nan, np.nan]]])
    assert slenderness(path, path + 0.0, body=False) == pytest.approx(ratio)
    far = np.concatenate([path[:, :1], path], axis=1) + np.array([0.0, 1.0])
    assert slenderness(far, far, body=True) == pytest.approx(np.clip((height + 1) / max(width, 1e-9), 0.3, 1.1))


def test_a_forecast_and_its_band(outcome):
    forecast = outcome.forecasts[0]
    figure = figures.forecast_figure(replace(forecast, half_width=np.full(forecast.tip.shape, 1e-3)))
    assert tuple(figure.get_size_inches()) == pytest.approx((7.16, 0.6 + 1.3))
    assert labels(figure) == [("time (s)", "tip x (mm)"), ("time (s)", "tip y (mm)")]
    assert looks(figure.axes[0]) == {"predicted, not recorded": MODELLED}
    (patch,) = figure.axes[0].collections
    assert patch.get_linewidth()[0] == 0
    assert patch.get_facecolor()[0, 0] == pytest.approx(0.8)
    angle = replace(forecast, tip=forecast.tip[:, :1])
    (ax,) = figures.forecast_figure(angle).axes
    np.testing.assert_allclose(ax.lines[0].get_ydata(), np.degrees(forecast.tip[:, 0]))
    assert ax.get_ylabel() == "tip angle (deg)"


def test_a_figure_is_saved_at_two_hundred_dots_an_inch(outcome, tmp_path):
    from PIL import Image

    (file,) = figures.save(figures.forecast_figure(outcome.forecasts[0]), tmp_path, "f", ["png"])
    with Image.open(file) as picture:
        assert picture.size == (1432, 380)


def motion(inputs):
    time = np.linspace(0.0, 1.0, 11)
    tips = np.outer(time, np.arange(1, 17)).reshape(11, 8, 2) * 1e-3
    return xr.Dataset({
        "tip_position": (("time", "link", "axis"), tips),
        "pressure": (("time", "input"), np.outer(time, 1e3 * np.arange(1, inputs + 1))),
    }, {"time": time, "input": [f"c{k}" for k in range(inputs)]})  # fmt: skip


@pytest.mark.parametrize("inputs", [1, 2])
def test_a_motion_as_the_paper_draws_it(inputs):
    run = motion(inputs)
    figure = motion_figure(run)
    assert tuple(figure.get_size_inches()) == pytest.approx((7.16, 0.6 + 1.3 * 3.6))
    left, right, low = figure.axes
    assert list(left.get_subplotspec().get_gridspec().get_height_ratios()) == [2.6, 1.0]
    assert labels(figure) == [("", "X of the link tips (mm)"), ("", "Y of the link tips (mm)"),
                              ("time (s)", "pressure (kPa)")]  # fmt: skip
    chosen = [1, 3, 4, 5, 7, 8]  # six of eight links, the last among them
    for ax, axis in ((left, 0), (right, 1)):
        assert [line.get_label() for line in ax.lines] == [f"tip of link {k}" for k in chosen]
        assert [line.get_color() for line in ax.lines] == ["0.60", "0.48", "0.36", "0.24", "0.12", "0.00"]
        for line, k in zip(ax.lines, chosen, strict=True):
            np.testing.assert_allclose(line.get_ydata(), 1e3 * run["tip_position"].values[:, k - 1, axis])
    assert len(low.lines) == inputs
    for k, line in enumerate(low.lines):
        np.testing.assert_allclose(line.get_ydata(), (k + 1) * run["time"].values)
        assert (line.get_color(), line.get_linewidth(), line.get_linestyle()) == ("black", 0.9, ["-", "--"][k])
    named = [f"pressure, c{k}" for k in range(inputs)] if inputs > 1 else []
    assert below(figure)[0] == [*(f"tip of link {k}" for k in chosen), *named]
    assert aligned(figure) == [2, 1, 2]


def test_a_film_frames_its_body(tmp_path, monkeypatch):
    from matplotlib import animation

    kept = {}

    def save(film, path, **how):
        film._draw_was_started = True
        kept.update(film=film, **how)

    monkeypatch.setattr(animation.FuncAnimation, "save", save)
    time = np.linspace(0.0, 1.0, 11)
    tips = np.stack(
        [np.stack([-0.05 * time, 0.1 - 0.02 * time], axis=1), np.stack([-0.1 * time, 0.2 + 0 * time], axis=1)], axis=1
    )
    body_film(tmp_path / "f.gif", time, np.array([[0.0, 0.0], [0.0, 0.01]]), tips, time[:, None], "pressure (kPa)")
    place, side = (figure := kept["film"]._fig).axes
    assert kept["dpi"] == 100
    assert kept["fps"] == 25
    assert figure.get_figheight() == 3.2
    assert list(place.get_subplotspec().get_gridspec().get_width_ratios()) == [2, 1]
    assert place.get_xlim() == pytest.approx((-100 - 4 * 12, 4 * 12))  # margins of 6 % of its height
    assert place.get_ylim() == pytest.approx((-12, 212))
    assert labels(figure) == [("x (mm)", "y (mm)"), ("time (s)", "pressure (kPa)")]
    way, line = place.lines
    assert (way.get_linewidth(), line.get_linewidth(), line.get_markersize()) == (0.8, 3.0, 3)
    assert [each.get_linewidth() for each in side.lines[:1]] == [0.9]
    shift = np.array([0.0, 0.3])
    low = tips - shift
    body_film(tmp_path / "f.gif", time, np.array([[0.0, 0.0], [0.0, -0.01]]), low, time[:, None], "pressure (kPa)")
    assert kept["film"]._fig.axes[0].get_ylim() == pytest.approx((-220 - 13.2, 13.2))
    high = tips + shift
    body_film(tmp_path / "f.gif", time, np.array([[0.0, 0.3], [0.0, 0.31]]), high, time[:, None], "pressure (kPa)")
    assert kept["film"]._fig.axes[0].get_ylim()[0] == pytest.approx(-12)  # the base's height is in it


def test_shapes_and_orders(shape):
    order, chain = order_figure(shape), shape_figure(shape)
    for figure, height, ratios in ((order, 2.8, [2, 1]), (chain, 3.4, [1, 1])):
        assert figure.get_figheight() == height
        assert list(figure.axes[0].get_subplotspec().get_gridspec().get_width_ratios()) == ratios
    with page(COLUMN):
        assert aligned(order_figure(shape)) == [2, 2]


def test_the_running_model(rng):
    time = np.linspace(0, 1, 5)
    two = (("time", "joint"), np.zeros((5, 6)))
    strain = (("time", "segment"), np.zeros((5, 1)))
    values = {"joint_angle": two, "smooth_joint_rate": two, "smooth_joint_rate_sd": two,
              "innovation": (("time", "row"), np.zeros((5, 1)))}  # fmt: skip
    more = {"axial_strain": strain, "smooth_axial_strain": strain, "smooth_axial_strain_sd": strain}
    for given, height in ((values, 5.4), (values | more, 7.2)):
        found = xr.Dataset(
            given, {"time": time, "joint": np.arange(6), **({"segment": ["a"]} if given is not values else {})}
        )
        figure = use_figures.estimate_overview(found)
        count = len(figure.axes)
        assert figure.get_figheight() == height
        assert [ax.get_ylabel() for ax in figure.axes] == [
            "angle (deg)",
            "rate (rad/s), 2 sd",
            "whitened innovation (1)",
            "strain (%), 2 sd",
        ][:count]
        assert [ax.get_xlabel() for ax in figure.axes] == [""] * (count - 1) + ["time (s)"]
        assert aligned(figure) == [count] * count
        legend = figure.axes[0].get_legend()
        assert (legend._ncols, legend._loc) == (5, 4)
        corner = figure.axes[0].transAxes.inverted().transform(legend.get_bbox_to_anchor().get_points())
        np.testing.assert_allclose(corner, [[1, 1], [1, 1]], atol=1e-9)
        dots, *levels = figure.axes[2].lines
        assert (dots.get_linestyle(), dots.get_marker(), dots.get_markersize(), dots.get_color()) == (
            "None",
            ".",
            1.5,
            "0.3",
        )
        assert [line.get_linewidth() for line in levels] == [0.6, 0.6]
        for ax in (figure.axes[1], *figure.axes[3:]):
            assert (ax.collections[0].get_alpha(), ax.collections[0].get_linewidth()[0]) == (0.2, 0)
    rows = {n: ("time", np.ones(5)) for n in ("statistic", "arc_low", "arc_high", "contact_arc_length", "normal_force",
                                              "tangential_force")}  # fmt: skip
    figure = use_figures.contact_overview(xr.Dataset(rows, {"time": time}, {"threshold": 3.0}))
    assert figure.get_figheight() == 5.0
    assert aligned(figure) == [3] * 3
    assert labels(figure) == [
        ("", "test statistic (1)"), ("", "position along the body (mm)"), ("time (s)", "force (N)"),
    ]
    assert figure.axes[0].lines[1].get_linewidth() == 0.8
    assert figure.axes[1].collections[0].get_linewidth()[0] == 0
    figure = use_figures.control_figure(time, *(np.zeros(5),) * 4)
    assert figure.get_figheight() == 3.4
    assert aligned(figure) == [2, 2]
    assert figure.axes[1].lines[1].get_linewidth() == 0.7
    assert labels(figure)[1] == ("time (s)", "gauge pressure (kPa)")
    numbers = {n: ("sample", rng.normal(size=9), {"units": "1"}) for n in "abcd"}
    tip = {"tip": (("sample", "time", "axis"), rng.normal(size=(9, 5, 2)))}
    samples = xr.Dataset({"failed": ("sample", np.zeros(9, bool)), **tip, **numbers}, {"time": time, "axis": [*"xy"]})
    figure = use_figures.sweep_figure(samples)
    assert figure.get_figheight() == pytest.approx(1.9 * 3)
    wide = figure.axes[-1]
    assert (wide.get_xlabel(), wide.get_ylabel()) == ("time (s)", "position (mm)")
    assert [(c.get_alpha(), c.get_linewidth()[0]) for c in wide.collections] == [(0.25, 0)] * 2
    assert [bar.get_linewidth() for bar in figure.axes[0].patches][:1] == [0.4]
    assert wide.get_subplotspec().colspan == range(3)
    still = use_figures.sweep_figure(samples.drop_vars("tip"))
    assert still.get_figheight() == pytest.approx(1.9 * 2)
    assert [ax.get_subplotspec().num1 for ax in still.axes] == [0, 1, 2, 3]
