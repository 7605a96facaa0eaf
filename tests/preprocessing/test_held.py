"""Frozen stations and held inputs: found where they were made, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.preprocessing.held import frozen, leave_out_frozen, lines_between_changes, staircases
from pliant.preprocessing.quality import quality
from pliant.recording import make_recording

TIME = np.arange(400) / 100


def moving(rng, *, grid=0.0):
    """A base at rest, a middle and a tip that swing, with noise; on a grid where one is given."""
    swing = 0.02 * np.sin(2 * np.pi * TIME)[:, None]
    place = np.stack([0 * swing, 0.4 * swing, swing], axis=1) * [1.0, 0.5, 0.0] + np.arange(3)[:, None] * [0, 0, 0.1]
    place = place + 2e-5 * rng.standard_normal(place.shape)
    return np.round(place / grid) * grid if grid else place


def recorded(place, **more):
    return make_recording(TIME, place, station=["base", "middle", "tip"], **more)


def test_a_frozen_station_is_marked_and_left_out():
    place = moving(np.random.default_rng(1))
    place[100:140, 2], place[300:303, 1], place[395:, 2] = place[99, 2], place[299, 1], place[394, 2]
    expected = np.zeros((400, 3), dtype=bool)
    expected[100:140, 2] = expected[300:303, 1] = expected[395:, 2] = True
    np.testing.assert_array_equal(frozen(place), expected)
    ds = recorded(place)
    found = quality(ds)
    assert found.frozen == {"middle": ((3.0, 3.02, 3),), "tip": ((1.0, 1.39, 40), (3.95, 3.99, 5))}
    assert any("tip is frozen in 45 frames while others move (1.00 to 1.39 s, 3.95 to 3.99 s)" in f
               for f in found.findings)  # fmt: skip
    left = leave_out_frozen(ds)
    np.testing.assert_array_equal(np.isnan(left["position"].values).all(-1), expected)
    assert left.attrs["history"].endswith("left out frames in which a station was frozen: middle 3, tip 45")
    assert np.isfinite(ds["position"].values).all()


@pytest.mark.parametrize("grid", [0.0, 1e-4, 1e-3])
def test_no_station_is_frozen_that_was_tracked(grid):
    place = moving(np.random.default_rng(2), grid=grid)  # on a coarse grid the slow ones repeat their numbers
    assert not frozen(place).any()
    assert leave_out_frozen(ds := recorded(place)) is ds


def test_frames_that_all_repeat_are_not_a_frozen_station():
    place = np.repeat(moving(np.random.default_rng(3))[::5], 5, axis=0)
    assert not frozen(place).any()
    assert quality(recorded(place)).repeated_frames == 320


def test_a_tracker_that_stops_and_leaps_is_left_out_and_one_that_waits_is_not():
    place = moving(np.random.default_rng(3))
    place[100:140] = place[99]
    marked = frozen(place)
    assert marked[100:140].all()
    assert marked.sum() == 120
    ds = recorded(place)
    assert any(line.startswith("all 3 stations are frozen in 40 frames and then leap (1.00 to 1.39 s)")
               for line in quality(ds).findings)  # fmt: skip
    assert np.isnan(leave_out_frozen(ds)["position"].values).all(axis=(1, 2)).sum() == 40
    time = np.maximum(TIME - 1.0, 0.0)[:, None, None]  # at rest without noise, then let go
    assert not frozen(0.05 * (1 - np.cos(12 * time)) * np.ones((400, 3, 3)) * np.arange(3)[:, None]).any()


def test_single_frames_that_a_log_misses_are_left_out_while_the_body_moves():
    rng = np.random.default_rng(5)
    place, late = moving(rng), np.zeros(400, dtype=bool)
    late[rng.permutation(np.arange(3, 397, 3))[:80]] = True
    for k in np.flatnonzero(late):
        place[k] = place[k - 1]
    marked = frozen(place)
    assert (marked == marked[:, :1]).all()
    assert not marked[~late].any()
    fast = np.abs(np.cos(2 * np.pi * TIME)) > 0.2
    assert marked[late & fast].all()
    count = int(marked[:, 0].sum())
    assert any(f"the log has no new frame in {count} frames of the motion" in f
               for f in quality(recorded(place)).findings)  # fmt: skip
    assert np.isnan(leave_out_frozen(recorded(place))["position"].values).all(axis=(1, 2)).sum() == count
    still = np.where(np.arange(400)[:, None, None] < 200, place, place[199])  # repeats of a body that rests are true
    assert not frozen(still)[200:].any()


def test_the_repeats_of_a_slower_tracker_are_not_missed_frames():
    every = np.arange(400) % 2 == 0
    slow = moving(np.random.default_rng(6))
    slow[~every] = slow[every]
    assert not frozen(slow).any()


def test_a_turn_that_goes_on_shows_that_the_station_is_tracked():
    place = moving(np.random.default_rng(4))
    place[100:140, 2] = place[99, 2]
    turn = np.zeros((400, 3, 4))
    turn[..., 3] = 1.0
    assert frozen(place, turn)[120, 2]
    turn[..., 2], turn[..., 3] = np.sin(TIME)[:, None], np.cos(TIME)[:, None]
    assert not frozen(place, turn).any()


def held(values, every=5):
    return np.repeat(values[::every], every)[: len(values)]


def test_held_inputs_are_named_and_made_of_lines_on_request():
    smooth, level = 0.3 * np.sin(5 * TIME), np.where((TIME > 1) & (TIME < 2), 1.0, 0.0)
    coarse = np.round(0.3 * np.sin(TIME), 2)  # a sensor of 0.01 that changes seldom, by one step
    noisy = np.round(0.4 * np.random.default_rng(0).standard_normal(400))  # a coarse sensor that flickers
    angles = np.stack([held(smooth), smooth, level, coarse, noisy], axis=-1)
    ds = recorded(moving(np.random.default_rng(5)), actuation=angles, input_kind="angle",
                  input_names=["motor", "fast", "level", "coarse", "noisy"])  # fmt: skip
    assert staircases(ds) == {"motor": (5, pytest.approx(0.05))}
    assert any(line.startswith("held inputs: motor, a new value every 5 samples (50 ms)")
               for line in quality(ds).findings)  # fmt: skip
    lines = lines_between_changes(ds)["actuation"].values
    np.testing.assert_array_equal(lines[:, 1:], angles[:, 1:])
    np.testing.assert_allclose(lines[:396, 0], np.interp(TIME, TIME[::5], smooth[::5])[:396], atol=1e-12)
    assert np.abs(lines[:396, 0] - smooth[:396]).max() < 0.1 * np.abs(angles[:396, 0] - smooth[:396]).max()


def test_a_plateau_of_a_held_pressure_stays_one():
    course = np.interp(TIME, [0, 1, 2, 3], [0, 30e3, 30e3, 10e3])
    ds = recorded(moving(np.random.default_rng(6)), pressure=held(course), pressure_time=TIME)
    assert staircases(ds) == {"p": (5, pytest.approx(0.05))}
    done = lines_between_changes(ds)["pressure"].values
    np.testing.assert_allclose(done[:396], course[:396], atol=1e-6)
    still = lines_between_changes(recorded(moving(np.random.default_rng(7)), pressure=course, pressure_time=TIME))
    np.testing.assert_array_equal(still["pressure"].values, course)
    assert "no input is a staircase" in still.attrs["history"]
