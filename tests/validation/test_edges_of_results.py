"""Metrics and figures at their edges: frames seen in part, ringing across an offset, views, chains of one link."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.identification import Experiment
from pliant.model import Space
from pliant.recording import make_recording
from pliant.reduction import links_of
from pliant.simulation import Trace
from pliant.validation import figures, metrics
from pliant.validation.metrics import compare, response
from pliant.validation.selection_figures import chain_through
from pliant.validation.store import metrics_of, modelled, recorded, save_results

T = np.arange(0.0, 4.0, 0.01)
LOG = Trace([0.0, 1.0, 1.01, 3.0, 3.01, 4.0], [0, 0, 1e4, 1e4, 0, 0])


def logged(path, stations=("tip",), time=T):
    return Experiment("p", time, path.reshape(len(time), len(stations), 2), stations, "trace", pressure=LOG)


def released(path, time=T):
    return Experiment("r", time, path[:, None], ("tip",), "release")


def ringing(across, along):
    """A point that rings at 3 Hz in y, behind an offset in x."""
    u = 0.01 * np.exp(-0.8 * T) * np.cos(2 * np.pi * 3.0 * T)
    return np.stack([np.full(T.size, across), along + u], axis=1)


@pytest.mark.parametrize(("across", "along"), [(0.0, 0.0), (0.5, 0.0), (-0.5, 0.1), (0.0, 0.5)])
def test_a_point_rings_alike_wherever_it_is(across, along):
    found = response(released(ringing(across, along)), ringing(across, along))
    assert found["frequency_hz"] == pytest.approx(3.0, rel=1e-3)
    assert found["damping_ratio"] == pytest.approx(0.8 / np.hypot(0.8, 6 * np.pi), rel=1e-2)


def test_a_frame_with_one_coordinate_is_not_seen():
    path = ringing(0.2, 0.1)
    whole = response(released(path), path)
    path[[40, 41, 399], 1] = np.nan
    part = response(released(path), path)
    assert part["frequency_hz"] == pytest.approx(whole["frequency_hz"], rel=1e-3)
    assert part["steady_state_mm"] == pytest.approx(whole["steady_state_mm"], rel=0.05)


@pytest.mark.parametrize(("late", "asked"), [(15, 0), (16, 1)])
def test_a_frequency_is_sought_in_sixteen_frames_and_more(monkeypatch, late, asked):
    """They begin 30 ms behind the last edge."""
    calls = []
    monkeypatch.setattr(metrics, "ring_down", lambda t, u: calls.append(t))
    monkeypatch.setattr(metrics, "last_edge", lambda _: 0.995)
    path = ringing(0.0, 0.1)
    path[T < 0.95] = path[0]
    seen = path.copy()
    seen[np.flatnonzero(T > 1.025)[late:]] = np.nan
    response(released(path), seen)
    assert len(calls) == asked
    for t in calls:
        assert (t[0], t.size) == (pytest.approx(1.03), late)


@pytest.mark.parametrize("peak", [1.005, 1.2])
def test_an_overshoot_of_half_a_per_cent_is_one(peak):
    u = 0.02 * ((T > 1.0) & (T < 3.0))
    u[(T > 1.2) & (T < 1.4)] *= peak
    path = np.stack([u, np.full(T.size, 0.1)], axis=1)
    assert response(logged(path), path)["overshoot_percent"] == pytest.approx(100 * (peak - 1))
    path[:, 0] = np.where((T > 1.0) & (T < 3.0), 0.02, 0.0)
    path[(T > 2.1) & (T < 2.3), 0] *= peak
    assert response(logged(path), path)["overshoot_percent"] is None  # in the second half of the plateau


def test_a_plateau_that_nobody_saw_has_no_steady_error():
    path = np.stack([0.02 * ((T > 1.0) & (T < 3.0)), np.full(T.size, 0.1)], axis=1)
    lost = path.copy()
    lost[(T > 0.99) & (T < 3.02)] = np.nan
    lost[0] = [0.001, 0.1]
    found = compare(logged(lost), path[:, None], 0.1)
    assert found["steady_state_mm"] == {"measured": None, "modelled": pytest.approx(20.0)}
    assert found["steady_state_error_mm"] is None


def test_swings_are_those_behind_the_release_alone():
    """What a point does before, or in one coordinate only, is no swing; of a step there is none."""
    path = ringing(0.3, 0.1)
    found = metrics.two_amplitudes(released(path), path)
    assert found["frequency_large_hz"] == pytest.approx(3.0, rel=3e-2)
    far = metrics.two_amplitudes(released(path + np.array([5.0, -3.0])), path + np.array([5.0, -3.0]))
    assert far["swing_large_mm"] == pytest.approx(found["swing_large_mm"], rel=1e-6)
    path[[50, 51], 1] = np.nan
    part = metrics.two_amplitudes(released(path), path)
    assert part["swing_large_mm"] == pytest.approx(found["swing_large_mm"], rel=0.05)


def test_the_axes_of_an_outcome_are_those_of_its_recordings_or_of_its_model(outcome):
    assert outcome.axes == ("x", "y")
    deep = outcome.model.with_(space=Space(), gravity=np.zeros(3), base_angle=0.0, rest_angle=0.0)
    assert replace(outcome, model=deep, fits=()).axes == ("x", "y", "z")


def test_results_that_are_not_there_are_missed_in_plain_words(outcome, tmp_path):
    with pytest.raises(InputError) as caught:
        metrics_of(tmp_path)
    assert str(caught.value).endswith("No such file or directory; name a folder that `pliant run` has written")
    assert "Errno" not in str(caught.value)
    save_results(outcome, tmp_path)
    with pytest.raises(InputError, match="a run was interrupted while it replaced its files: run the study again"):
        metrics_of(tmp_path)


def test_units_of_what_fits_say_are_those_of_the_recording(outcome):
    exp = outcome.fits[0].records[0].experiment
    of_places = modelled(outcome.fits, exp)
    assert of_places["modelled"][2] == {"units": "m"}
    assert recorded(exp)["position"].attrs["units"] == "m"
    angles = Experiment(exp.name, exp.time, np.full(exp.position.shape, np.nan), exp.stations, exp.excitation,
                        level=exp.level, angle=0.1 * exp.position[..., 0], angle_reference="rest",
                        pressure=exp.pressure)  # fmt: skip
    assert modelled(outcome.fits, angles)["modelled"][2] == {"units": "rad"}


# figures


def test_a_figure_is_saved_into_folders_that_it_makes_and_is_cleared(outcome, tmp_path):
    for _ in range(2):
        figure = figures.residual_figure(outcome.fits[0].records[0])
        made = figures.save(figure, tmp_path / "a" / "b", "residual", ("svg",))
        assert [p.name for p in made] == ["residual.svg"]
        assert made[0].stat().st_size > 1000
        assert figure.axes == []


def test_three_views_hold_all_points_with_the_same_margin_on_each_side():
    points = np.array([[[-0.1, 0.0, 0.0], [0.2, 0.05, 0.4]], [[np.nan] * 3, [0.0, -0.15, 0.1]]])
    low, high = np.array([-100.0, -150.0, 0.0]), np.array([200.0, 50.0, 400.0])
    _, views = figures.three_views(points)
    margins = []
    for ax, view in views:
        for axis, (least, most) in zip(view, (ax.get_xlim(), ax.get_ylim()), strict=True):
            assert 0.5 * (least + most) == pytest.approx(0.5 * (low + high)[axis])
            margins.append(0.5 * (most - least - (high - low)[axis]))
    assert margins == pytest.approx([margins[0]] * 6)
    assert 0 < margins[0] < 0.1 * 400
    _, still = figures.three_views(np.zeros((2, 1, 3)))
    assert all(np.ptp(ax.get_xlim()) > 0 for ax, _ in still)
    heights = [figures.three_views(points * np.array([1.0, 1.0, k]))[0].get_figheight() for k in (0.1, 0.3, 1.0, 50.0)]
    assert heights[0] < heights[1] < heights[2] == heights[3] == figures.TALLEST


@pytest.mark.parametrize("width", [3.2, 4.0])
def test_views_fill_a_figure_that_is_as_high_as_they_need(width, monkeypatch):
    """Their scale across and up is one: less what labels take, heights are as widths."""
    monkeypatch.setattr(figures, "WIDTH", type("Width", (), {"get": staticmethod(lambda: width)}))
    cube = np.array([[[0.0, 0.0, 0.0], [0.1, 0.1, 0.1]]])
    assert figures.three_views(cube)[0].get_figheight() == pytest.approx(width + 0.1)
    flat = cube * np.array([1.0, 1.0, 0.0])
    assert 0.5 * width < figures.three_views(flat)[0].get_figheight() < 0.8 * width


def test_a_path_is_named_once_and_drawn_to_its_end(outcome):
    record = outcome.fits[0].records[1]
    (ax,) = figures.path_figure(record).axes
    labels = [line.get_label() for line in ax.lines]
    for name in ("modelled", "measured stations", "modelled stations", "first frame"):
        assert labels.count(name) == 1, name
    (line,) = (line for line in ax.lines if line.get_label() == "modelled")
    np.testing.assert_allclose(line.get_xydata(), 1e3 * record.modelled[:, -1])
    stations = [line for line in ax.lines if line.get_marker() == "+" and line.get_color() == "black"]
    assert [s.get_label() == "measured stations" for s in stations] == [True, *[False] * (len(stations) - 1)]


def test_a_chain_is_drawn_from_its_base_and_begins_along_it(shape):
    """Wherever the base is; a spline through the tips leaves it upright, a lone link is a line."""
    points, joints, splines = chain_through(shape)
    np.testing.assert_allclose(splines[:, 0], 0.0, atol=1e-12)
    way = splines[:, 1] - splines[:, 0]
    assert (np.abs(way[:, 0]) < 0.02 * way[:, 1]).all()
    off = np.array([0.03, -0.02])
    links = replace(shape.links, base=shape.links.base + off, tips=shape.links.tips + off)
    moved = chain_through(replace(shape, position=shape.position + off, links=links))
    for a, b in zip(moved, (points, joints, splines), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-12)
    names = [f"p{i}" for i in range(shape.arc_length.size)]
    ds = make_recording(np.arange(len(shape.position)) / 20, shape.position, station=names, frame="planar",
                        arc_length=shape.arc_length)  # fmt: skip
    _, ends, lone = chain_through(replace(shape, links=links_of(ds, 1)))
    assert lone is ends
    assert ends.shape[1] == 2
