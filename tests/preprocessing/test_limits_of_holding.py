"""Frozen stations and held inputs, each limit from just below, at and just above, with cases worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.preprocessing import held
from pliant.preprocessing.detectors import repeated_frames
from pliant.preprocessing.held import (
    _interval,
    _lines,
    frozen,
    frozen_sentences,
    lines_between_changes,
    runs,
    staircases,
)
from pliant.recording import make_recording


def inputs(intervals, sizes=(2.0, 1.0)):
    """A held input with these intervals between its changes, by the sizes in turn."""
    levels = np.append(0.0, np.cumsum(np.resize(sizes, len(intervals) + 1)))
    return np.repeat(levels, [3, *intervals, 3])


@pytest.mark.parametrize(
    ("intervals", "every"),
    [
        ([5] * 18, 1),  # 19 changes with the first
        ([5] * 19, 5),
        ([2] * 19, 2),
        ([1] * 30, 1),
        ([2] * 12 + [3] * 9, 1),  # 57 % alike, and 60 %
        ([2] * 15 + [3] * 10, 2),
        ([3] * 11 + [2, 4] * 5, 3),  # of three samples or more, one more or less is alike
        ([3] * 11 + [5] * 10, 1),
        ([3] * 13 + [5] * 7, 3),
        ([5] * 18 + [1] * 2, 5),  # a tenth is shorter, and more
        ([5] * 17 + [1] * 3, 1),
        ([5] * 14 + [9] * 6, 5),  # longer ones do not count as shorter
    ],
)
def test_an_input_is_held_where_its_intervals_are_alike(intervals, every):
    mixed = inputs(np.random.default_rng(1).permutation(intervals))
    assert _interval(mixed) == _interval(-mixed) == every


@pytest.mark.parametrize(
    ("sizes", "every"), [((1.0, 2.0), 5), ((1.0, 1.5), 1), ((1.0, 1.0, 2.0), 1), ((1.0, 2.0, 2.0), 5), ((1.0, 1.0), 1)]
)
def test_an_input_that_mostly_changes_by_its_resolution_is_a_coarse_sensor(sizes, every):
    assert _interval(inputs([5] * 29, sizes)) == every


def test_straight_lines_join_the_changes():
    values = np.repeat([0.0, 4.0, 8.0, 11.0], [4, 6, 7, 3])
    time = np.arange(20) * 0.1
    made = _lines(time, values, 4)
    knots = [0, 4, 10, 13, 17]  # the third value stays longer than six samples: until four before the next
    np.testing.assert_allclose(made, np.interp(time, time[knots], values[knots]))
    lost = values.copy()
    lost[[5, 13]] = np.nan
    made = _lines(time, lost, 4)
    assert np.flatnonzero(np.isnan(made)).tolist() == [5, 13]
    whole = np.interp(time, time[[0, 4, 10, 17]], values[[0, 4, 10, 17]])
    np.testing.assert_allclose(np.delete(made, [5, 13]), np.delete(whole, [5, 13]))


def test_lines_are_drawn_in_the_columns_of_the_held_inputs():
    time = np.arange(400) / 100
    smooth = np.sin(5 * time)
    tensions = np.stack([smooth, np.repeat(smooth[::5], 5), smooth, np.repeat(2 * smooth[::8], 8)], axis=1)
    pressures = np.stack([smooth, np.repeat(smooth[::4], 4)], axis=1)
    ds = make_recording(
        time, angle=np.zeros((400, 1)), frame="planar", actuation=tensions, input_kind="tension",
        input_names=list("abcd"), pressure=pressures, chamber=["l", "r"],
    )  # fmt: skip
    assert staircases(ds) == {"r": (4, pytest.approx(0.04)), "b": (5, pytest.approx(0.05)),
                              "d": (8, pytest.approx(0.08))}  # fmt: skip
    made = lines_between_changes(ds)
    for name, columns in (("actuation", {1: 5, 3: 8}), ("pressure", {1: 4})):
        was, now = ds[name].values, made[name].values
        for k in range(was.shape[1]):
            if k in columns:
                rows = np.arange(0, 400, columns[k])
                expected = np.interp(time, time[rows], was[rows, k])
                np.testing.assert_allclose(now[:390, k], expected[:390], atol=1e-12)
            else:
                np.testing.assert_array_equal(now[:, k], was[:, k])
    assert made.attrs["history"].endswith("straight lines between the changes of r, b, d")


# frozen stations


def walk(after=3.5, other=6.5, axes=3):
    """A station of resolution 1 that is frozen in frames 10 to 13, then steps by `after`; one that goes by `other`."""
    place = np.zeros((30, 2, axes))
    steps = np.ones(30)
    steps[10:14], steps[14] = 0.0, after
    place[:, 0, 0] = np.cumsum(steps)
    place[10:, 1, 1] = other
    return place


@pytest.mark.parametrize(
    ("after", "other", "found"), [(3.5, 6.5, True), (3.0, 6.5, False), (3.5, 6.0, False), (3.5, -6.5, True)]
)
def test_a_frozen_station_then_steps_by_three_resolutions_while_another_moved_by_six_noises(
    monkeypatch, after, other, found
):
    monkeypatch.setattr(held, "noise_level", lambda _: np.array([50.0, 1.0]))
    marked = frozen(walk(after, other))
    assert np.argwhere(marked).tolist() == ([[k, 0] for k in range(10, 14)] if found else [])


def test_a_station_that_is_hidden_or_never_moves_shows_nothing(monkeypatch):
    monkeypatch.setattr(held, "noise_level", lambda place: np.full(place.shape[1], 0.01))
    place = walk()
    assert frozen(place)[:, 0].sum() == 4
    place[:, 1] = 0.0
    place[11:13, 1] = np.nan
    assert not frozen(place).any()
    assert not frozen(np.where(np.arange(2)[:, None] == 0, 7.0, walk())).any()  # the first never moves
    assert frozen(walk()[:, :1]).sum() == 4  # alone: it leaps by more than three of the steps that follow
    assert not frozen(walk(after=3.0)[:, :1]).any()
    monkeypatch.setattr(held, "noise_level", lambda place: np.full(place.shape[1], 0.6))
    assert not frozen(walk()[:, :1]).any()  # and not by more than six noises
    monkeypatch.setattr(held, "noise_level", lambda place: np.full(place.shape[1], 0.01))
    place = walk()[:14]  # frozen to the end: its usual step is its resolution
    assert not frozen(place).any()
    place[:9, 0, 0] = 4.0 * np.arange(9)
    place[9:, 0, 0] = 33.0
    assert np.flatnonzero(frozen(place)[:, 0]).tolist() == [10, 11, 12, 13]


def test_runs_of_three_and_repeats_of_what_was_seen():
    flags = np.array([0, 1, 1, 0, 1, 1, 1, 0, 0, 1, 1, 1, 1], bool)
    assert runs(flags) == [(4, 7), (9, 13)]
    nan = np.nan
    values = np.array([[1, 2], [1, 2], [nan, 2], [nan, 2], [1, 2], [1, 3], [nan, nan], [nan, nan], [nan, 3], [nan, 3]])
    repeated = [False, True, False, True, False, False, False, False, False, True]
    assert repeated_frames(values).tolist() == repeated


def test_the_three_longest_spans_are_told_in_their_order():
    spans = ((0.0, 0.2, 3), (1.0, 1.9, 10), (2.0, 2.3, 4), (3.0, 3.8, 9), (4.0, 4.4, 5))
    (line,) = frozen_sentences({"tip": spans}, 2)
    where = "1.00 to 1.90 s, 3.00 to 3.80 s, 4.00 to 4.40 s and 2 shorter"
    assert line.startswith(f"tip is frozen in 31 frames while others move ({where}): the tracker")
    (line,) = frozen_sentences({"tip": spans[:3]}, 2)
    assert "(0.00 to 0.20 s, 1.00 to 1.90 s, 2.00 to 2.30 s): the" in line
