"""Results of a body in space: kept whole, compared in three dimensions, drawn from the side."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pliant.identification import Experiment
from pliant.plotting import recording_overview
from pliant.recording import make_recording
from pliant.reduction import links_of, select_order
from pliant.reduction.links import link_frames, swings_along
from pliant.simulation import Trace
from pliant.validation.figures import path_figure, record_figure, residual_figure
from pliant.validation.metrics import joint_errors
from pliant.validation.outcome import RecordOutcome, Shape
from pliant.validation.selection_figures import chain_through, shape_figure
from pliant.validation.store import experiment_of, modelled, modelled_inputs, recorded

TIME = np.arange(60) / 30
ROUND = np.stack([0.3 * np.sin(5 * TIME), 0.4 * np.cos(4 * TIME) - 0.4], -1)  # rad, of every joint


def chain(swings, lengths=(0.1, 0.1, 0.1)):
    """Stations (T, 3, 3) of a chain in space whose joints all swing alike."""
    frames = link_frames(np.repeat(swings[:, None], len(lengths), axis=1))
    return np.cumsum(frames[..., 2] * np.array(lengths)[:, None], axis=1)


@pytest.fixture
def record():
    exp = Experiment("round", TIME, chain(ROUND), ("a", "b", "c"), "release")
    return RecordOutcome("round", "train", exp, chain(ROUND + np.array([0.01, 0.0])), np.zeros((len(TIME), 1)),
                         {"rmse_mm": 1.0, "max_mm": 2.0, "rmse_percent_of_travel": 3.0})  # fmt: skip


def test_positions_in_space_come_back(record):
    kept = experiment_of(recorded(record.experiment))
    np.testing.assert_array_equal(kept.position, record.experiment.position)
    assert kept.dimension == 3


def test_errors_of_joints_are_those_of_their_swings(record):
    settled = np.ones(len(TIME), dtype=bool)
    found = joint_errors(record.experiment, record.modelled, settled)
    swing = swings_along(np.diff(record.modelled, axis=1, prepend=0.0)) - ROUND[:, None]
    np.testing.assert_allclose(found["joint_rmse_mrad"], 1e3 * np.sqrt((swing**2).sum(axis=2).mean(axis=0)), rtol=1e-9)
    np.testing.assert_allclose(found["joint_rmse_mrad"], 10.0, rtol=1e-9)  # all turned by 0.01 rad about x


def test_figures_in_space_have_three_axes_and_three_views(record):
    labels = [ax.get_ylabel() for ax in record_figure(record).axes]
    assert {"a x (mm)", "a y (mm)", "a z (mm)"} <= set(labels)
    assert [line.get_label() for line in residual_figure(record).axes[0].lines] == ["x", "y", "z"]
    figure = path_figure(record)
    position = 1e3 * record.experiment.position[:, -1]
    views = [(0, 2), (1, 2), (0, 1)]
    for ax, view in zip(figure.axes, views, strict=True):
        assert (ax.get_xlabel(), ax.get_ylabel()) == tuple(f"{'xyz'[axis]} (mm)" for axis in view)
        np.testing.assert_allclose(ax.lines[0].get_xydata(), position[:, view], atol=1e-9)
        (low, high), (bottom, top) = ax.get_xlim(), ax.get_ylim()
        assert low < position[:, view[0]].min() < position[:, view[0]].max() < high
        assert bottom < position[:, view[1]].min() < position[:, view[1]].max() < top
    figure.canvas.draw()
    scales = [ax.get_window_extent().width / np.ptp(ax.get_xlim()) for ax in figure.axes]
    np.testing.assert_allclose(scales, scales[0], rtol=0.05)  # one scale for all


def test_a_shape_in_space_is_drawn_from_the_side():
    s = np.linspace(0, 0.3, 16)
    place = np.concatenate([np.zeros((len(TIME), 1, 3)), chain(ROUND / 5, (0.02,) * 15)], axis=1)
    ds = make_recording(TIME, place, frame="spatial", arc_length=s)
    curvature = np.zeros((len(TIME), len(s)))
    shape = Shape("a", s, place, curvature, curvature[0], select_order(ds, max_order=4), links_of(ds, 3), "")
    points, joints, splines = chain_through(shape)
    assert points.shape[2] == joints.shape[2] == splines.shape[2] == 2
    np.testing.assert_allclose(splines[:, -1], points[:, -1], atol=1e-9)
    np.testing.assert_allclose(joints[:, -1], points[:, -1], atol=1e-9)
    assert shape_figure(shape).axes[1].get_ylabel() == "z (mm)"
    flat = links_of(make_recording(TIME, place[..., 1:], frame="planar", arc_length=s), 3)
    np.testing.assert_allclose(flat.rest_bend, flat.rest_angle)
    bent = replace(shape.links, rest_angle=np.array([0.3, 0.4, 0, 0, 0.6, -0.8]))
    np.testing.assert_allclose(bent.rest_bend, [0.5, 0, 1.0])


def test_inputs_of_several_units_keep_these_in_files_and_figures():
    """A displacement [m], a motor angle [rad] and a pressure [Pa]: each in its unit, under a name that says so."""
    clock = TIME[::2]
    values = np.outer(np.sin(clock), [3e-3, 0.2, 4e4])
    units = {"long": "m", "pair": "rad", "bellows": "Pa"}
    drives = {name: Trace(clock, column) for name, column in zip(units, values.T, strict=True)}
    exp = Experiment("round", TIME, chain(ROUND), ("a", "b", "c"), "trace", drives=drives)
    seen = np.outer(np.sin(TIME), [3e-3, 0.2, 4e4])
    record = RecordOutcome("round", "train", exp, chain(ROUND), seen, {"rmse_mm": 1.0, "max_mm": 2.0,
                           "rmse_percent_of_travel": 3.0}, inputs=units)  # fmt: skip
    kept = recorded(exp, record.unit_of)
    assert "pressure" not in kept
    assert kept["actuation"].dims == ("input_time", "driven")
    assert kept["actuation"].attrs == {"units": "m, rad, Pa", "long_name": "measured input"}
    again = experiment_of(kept)
    for name, trace in drives.items():
        np.testing.assert_array_equal(again.drives[name].pressure, trace.pressure)
        np.testing.assert_array_equal(again.drives[name].time, clock)
    fit = SimpleNamespace(name="f", records=[record])
    added = kept.assign(modelled([fit], exp))
    assert "modelled_pressure" not in added
    assert added["modelled_actuation"].attrs["units"] == "m, rad, Pa"
    np.testing.assert_array_equal(modelled_inputs(added.isel(fit=0)), seen)
    ax = record_figure(record).axes[-1]
    drawn = {line.get_label(): line.get_ydata() for line in ax.lines}
    np.testing.assert_allclose(drawn["measured displacement, long (mm)"], 1e3 * values[:, 0])
    np.testing.assert_allclose(drawn["measured motor angle, pair (rad)"], values[:, 1])
    np.testing.assert_allclose(drawn["measured pressure, bellows (kPa)"], 1e-3 * values[:, 2])
    assert ax.get_ylabel() == "input\n(mm, rad, kPa)"


def test_the_overview_of_a_recording_draws_inputs_of_each_unit():
    ds = make_recording(
        TIME, chain(ROUND), station=["a", "b", "c"], frame="spatial", pressure=4e4 * np.sin(TIME), pressure_time=TIME,
        actuation=np.outer(np.sin(TIME), [3e-3, 2e-3, 0.2]), input_time=TIME, input_names=["long", "short", "pair"],
        input_kind=["displacement", "displacement", "angle"],
    )
    axes = recording_overview(ds).axes
    assert [ax.get_ylabel() for ax in axes[3:]] == ["gauge pressure (kPa)", "displacement (mm)", "motor angle (rad)"]
    np.testing.assert_allclose(axes[3].lines[0].get_ydata(), 40.0 * np.sin(TIME))
    assert [line.get_label() for line in axes[4].lines] == ["long", "short"]
    np.testing.assert_allclose(axes[4].lines[1].get_ydata(), 2.0 * np.sin(TIME))
    np.testing.assert_allclose(axes[5].lines[0].get_ydata(), 0.2 * np.sin(TIME))
    only = recording_overview(ds.drop_vars(["pressure", "pressure_time"]))
    assert [ax.get_ylabel() for ax in only.axes[3:]] == ["displacement (mm)", "motor angle (rad)"]
