from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from matplotlib.figure import Figure

from pliant.errors import InputError
from pliant.plotting import letter_panels, page
from pliant.simulation import Pulse, simulate
from pliant.validation import curves, figures
from pliant.validation.use_figures import motion_figure
from pliant.validation.wording import digits


def labels(figure: Figure) -> set[str]:
    return {text.get_text() for legend in figure.legends for text in legend.get_texts()}


def test_record_figure_shows_every_station_its_residual_and_the_pressure(outcome):
    figure = figures.record_figure(outcome.fits[0].records[0])
    assert len(figure.axes) == 2 * (3 + 1) + 1  # the pressure once
    assert {"measured", "modelled", "last station", "nominal pressure"} <= labels(figure)
    assert not figure.get_suptitle()
    assert "link 3 x (mm)" in [ax.get_ylabel() for ax in figure.axes]


def test_record_figure_of_a_release_has_no_pressure(outcome):
    figure = figures.record_figure(outcome.fits[0].records[2])
    assert len(figure.axes) == 2 * (3 + 1)


def test_in_one_column_a_figure_leaves_room_for_its_caption_and_no_text_is_cut(outcome):
    with page(88 / 25.4):
        figure = figures.record_figure(outcome.fits[0].records[0])
        letter_panels(figure)
        figure.draw_without_rendering()
    assert figure.get_figheight() * 25.4 <= 120
    assert [ax.get_title(loc="left") for ax in figure.axes] == [f"({c})" for c in "abcdefghi"]
    whole = figure.bbox
    for ax in figure.axes:
        for text in (ax.yaxis.label, ax.xaxis.label):
            box = text.get_window_extent()
            assert not text.get_text() or (box.x0 >= whole.x0 and box.y0 >= whole.y0 and box.y1 <= whole.y1)
    rows = [ax.yaxis.label.get_window_extent() for ax in figure.axes if ax.get_subplotspec().is_first_col()]
    assert all(low.y1 < high.y0 for high, low in pairwise(rows))  # labels of neighbours do not meet


def test_measured_trace_is_drawn_beside_the_modelled_pressure(outcome):
    assert "measured pressure" in labels(figures.record_figure(outcome.fits[0].records[1]))


def test_few_frames_are_drawn_as_points(outcome):
    exp = outcome.fits[0].records[0].experiment
    ax = Figure().subplots()
    figures.measured(ax, exp.time[:30], exp.position[:30, -1, 0])
    assert ax.lines[0].get_marker() == "+"
    assert ax.lines[0].get_linestyle() == "None"


def test_comparison_has_one_column_a_fit_and_says_who_had_seen_the_record(outcome):
    figure = figures.comparison_figure(outcome.fits, "low")
    titles = [ax.get_title(loc="left") for ax in figure.axes if ax.get_title(loc="left")]
    assert len(titles) == 2
    assert all("training:\nRMSE" in t for t in titles)
    with pytest.raises(InputError, match="no fit has the record 'absent'"):
        figures.comparison_figure(outcome.fits, "absent")


def test_comparison_shows_the_whole_distance(outcome):
    figure = figures.comparison_figure(outcome.fits, "low")
    for ax in figure.axes[-2:]:
        assert ax.get_ylim()[1] >= np.nanmax(ax.lines[0].get_ydata())


def test_lines_differ_without_colour(outcome):
    """Lines on the same axes differ by dash, width, mark or lightness, so that they do in greyscale."""
    drawn = [figures.residual_figure(outcome.fits[0].records[0]), figures.torque_figure(outcome.fits),
             figures.record_figure(outcome.fits[0].records[0])]
    for figure in drawn:
        for ax in figure.axes:
            shown = [line for line in ax.lines if not line.get_label().startswith("_")]
            looks = {(str(line.get_linestyle()), line._dash_pattern[1] and tuple(line._dash_pattern[1]),
                      line.get_linewidth(), line.get_marker()) for line in shown}
            assert len(looks) == len(shown)


def test_saving_is_deterministic_and_gives_both_kinds(outcome, tmp_path):
    again = []
    for folder in ("a", "b"):
        svg, png = figures.save(figures.path_figure(outcome.fits[0].records[1]), tmp_path / folder, "path")
        again.append((svg.read_bytes(), png.read_bytes()))
    assert again[0] == again[1]
    assert b"<svg" in again[0][0]
    assert again[0][1].startswith(b"\x89PNG")
    assert sorted(p.name for p in (tmp_path / "a").iterdir()) == ["path.png", "path.svg"]


def test_a_name_in_any_script_is_drawn(outcome, tmp_path):
    forecast = outcome.forecasts[0]
    object.__setattr__(copy := type(forecast)(**vars(forecast)), "title", "软体 $\\frac")
    figures.save(figures.forecast_figure(copy), tmp_path, "f")


def test_motion_figure_draws_every_link_and_the_pressure(outcome):
    figure = motion_figure(simulate(outcome.model, Pulse(1e4, 0.05, 0.2), duration=0.4, time_step=2e-3))
    assert labels(figure) == {"tip of link 1", "tip of link 2", "tip of link 3"}
    assert len(figure.axes) == 3


def test_a_folder_that_cannot_be_is_one_sentence(outcome, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"cannot write .*path\.svg"):
        figures.save(figures.path_figure(outcome.fits[0].records[0]), tmp_path / "file" / "figures", "path")


def test_thinning_keeps_extremes_and_gaps():
    time = np.linspace(0, 1, 20_001)
    value = np.sin(40 * time)
    value[7000] = 9.0
    value[12_000:12_400] = np.nan
    t, y = curves.thin(time, value, 1000)
    assert t.size < 1200
    assert np.all(np.diff(t) > 0)
    assert np.nanmax(y) == 9.0
    inside = (t > time[12_000]) & (t < time[12_399])
    assert np.isnan(y[inside]).all()
    assert inside.any()


def test_autocorrelation_of_white_noise_and_of_a_wave(rng):
    time = np.arange(4000) * 0.01
    noise = rng.normal(size=time.size)
    noise[rng.integers(0, time.size, 200)] = np.nan
    lag, correlation = curves.autocorrelation(time, noise)
    assert correlation[0] == pytest.approx(1.0)
    assert lag[1] == pytest.approx(0.01)
    assert lag.size == 401
    assert curves.autocorrelation(time[:200], noise[:200])[0].size == 51  # to a quarter of the length
    assert (np.abs(correlation[1:]) > 1.96 / np.sqrt(3800)).mean() < 0.12
    _, wave = curves.autocorrelation(time, np.sin(2 * np.pi * time))
    assert wave[100] == pytest.approx(0.975, abs=0.01)
    assert not curves.autocorrelation(time, np.zeros(4000))[1].any()


@pytest.mark.parametrize("count", [1, 5, 6, 7, 40, 212])
def test_chosen_stations_hold_the_last_and_are_few(count):
    chosen = curves.evenly_spaced(count)
    assert chosen[-1] == count - 1
    assert len(chosen) == min(count, 6)
    assert min(chosen) >= 0


@pytest.mark.parametrize(("value", "text"), [
    (8.0, "8.00"), (None, "–"), (float("nan"), "–"), (-0.0634, "−0.0634"), (437, "437"),
    (25000.0, "25000"), (1.3e-6, "1.30e-6"), (999000.0, "999000"), (1e6, "1.00e6"), (1234567.0, "1.23e6"),
])
def test_numbers_are_written_as_one_reads_them(value, text):
    assert digits(value) == text.replace("-", "−")
