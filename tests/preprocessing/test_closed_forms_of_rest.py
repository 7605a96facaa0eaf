"""Where a body is at rest, with motions of a few frames whose answer can be counted."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.preprocessing.quality import quality
from pliant.preprocessing.rest import (
    _away,
    _precedes_motion,
    _still,
    before_inputs,
    clock_finding,
    rest_window,
    still_within,
)
from pliant.recording import make_recording


def along(*values):
    """One station at these places along x."""
    return np.array(values, dtype=float)[:, None, None] * np.array([1.0, 0.0])


@pytest.mark.parametrize("start", [0.0, 100.0, -100.0])
@pytest.mark.parametrize(
    ("step", "values", "still"),
    [
        (0.1 / 1.8, (0, 0, 0, 0, 1), "11000"),  # two frames to each side
        (0.5, (0, 0, 0, 1, 1, 1), "110011"),  # one at least
        (0.1 / 3, (0, 0, 0, 0, 0, 0, 0, 1), "11110000"),
        (0.1 / 3, (0, 0, 0, 0, 0, 0, 0, 0.02, 1, 1, 1, 1), "111110000001"),
    ],
)
def test_a_frame_is_still_with_a_tenth_of_a_second_to_both_sides(start, step, values, still):
    found = _still(along(*values), start + step * np.arange(len(values)))
    assert "".join(str(int(f)) for f in found) == still


def test_every_station_is_still_and_some_is_seen():
    place = np.concatenate([along(*np.zeros(30)), along(*np.where(np.arange(30) < 20, 0.0, 1.0))], axis=1)
    time = np.arange(30) / 50  # five frames to each side
    np.testing.assert_array_equal(_still(place, time), [True] * 15 + [False] * 10 + [True] * 5)
    place[3, :, 1] = np.nan  # half of a place is none
    place[4, 0] = np.nan
    found = _still(place, time)
    assert (found[3], found[4]) == (False, True)
    assert _away(place)[3].tolist() == [0.0, 0.0]


def test_frames_that_repeat_do_not_hide_the_noise():
    rng = np.random.default_rng(2)
    place = np.zeros((400, 1, 2))
    place[:, 0] = 1e-3 * rng.normal(size=(400, 2))
    place[200:, 0, 0] += 0.01
    held = np.repeat(place[::4], 4, axis=0)  # a log four times as fast as its tracker
    time = np.arange(400) / 100
    assert _still(held, time)[20:180].all()


@pytest.mark.parametrize("start", [0.0, 100.0])
@pytest.mark.parametrize(("rest", "found"), [(0.09, False), (0.12, True)])
def test_a_rest_lasts_a_tenth_of_a_second(start, rest, found):
    """A frame is still with a tenth of a second to both sides, so the body stands 0.2 s longer than its rest."""
    time = np.arange(200) / 100
    end = 0.7 + rest
    place = np.where(time < 0.5, np.sin(40 * (time - 0.5)), np.where(time > end, np.sin(40 * (time - end)), 0.0))
    ds = make_recording(start + time, along(*place), frame="planar")
    if found:
        assert rest_window(ds) == (pytest.approx(start + 0.6), pytest.approx(start + 0.6 + rest))
        return
    with pytest.raises(InputError, match=r"never at rest for 0\.1 s"):
        rest_window(ds)


def test_of_two_rests_after_a_motion_the_longer_one_counts():
    time = np.arange(600) / 100
    swing = np.sin(30 * time)
    place = np.where((time > 1) & (time < 3), 2.0, np.where((time > 4) & (time < 5), -2.0, swing))
    found = rest_window(make_recording(time, along(*place), frame="planar"))
    assert found == (pytest.approx(1.1, abs=0.02), pytest.approx(2.89, abs=0.02))


@pytest.mark.parametrize(("away", "early"), [(0.25, True), (0.26, False)])
def test_the_place_of_a_rest_is_its_mean(monkeypatch, away, early):
    monkeypatch.setattr("pliant.preprocessing.rest.EARLY_SHARE", 0.25)
    place = along(*[away] * 5, *[-0.5, 0.5] * 10, *[1.0] * 5)
    assert _precedes_motion(place, (5, 24)) == early
    moved = place + np.array([7.0, -3.0])
    assert _precedes_motion(moved, (5, 24)) == early
    place[10:14] = np.nan
    assert _precedes_motion(place, (5, 24)) == early
    unseen = np.concatenate([place, np.where(np.arange(30)[:, None, None] < 26, np.nan, 50.0 + place)], axis=1)
    assert _precedes_motion(unseen, (5, 24)) == early  # a station that was not seen in the rest says nothing
    assert not _precedes_motion(along(3.0, *[0.0] * 5, *[1.0] * 5), (1, 5))
    assert _precedes_motion(along(*[0.0] * 5, *[1.0] * 5), (0, 4))


def test_a_window_has_its_last_frame():
    place = along(*[0.0] * 10, 1.0, *[1.0] * 9)
    time = np.arange(20) / 16
    assert still_within(place, time, (0.0, 9 / 16))
    assert not still_within(place, time, (0.0, 10 / 16))
    assert not still_within(place, time, (9 / 16, 10 / 16))


def test_the_first_input_that_leaves_its_start_ends_the_wait():
    """Levels that do not begin at zero, two inputs and one that never moves."""
    time = np.arange(100) / 100
    place = along(*np.where(time < 0.7, 0.0, 1.0))
    first = np.where(time < 0.6, 1e5, 1.2e5)
    second = np.where(time < 0.4, -2e4, -3e4)
    never = np.full(100, 5e3)
    for columns, end in (((first,), 0.59), ((first, second), 0.39), ((never, second), 0.39), ((first, never), 0.59)):
        ds = make_recording(time, place, frame="planar", pressure=np.stack(columns, axis=1),
                            chamber=list("ab")[: len(columns)])  # fmt: skip
        assert before_inputs(ds) == (0.0, pytest.approx(end))
        assert clock_finding(ds) == []
    alone = make_recording(time, place, frame="planar", pressure=never, pressure_time=0.5 + time)
    assert before_inputs(alone) == (0.0, pytest.approx(0.49))


def test_the_share_out_of_the_plane_needs_four_places():
    place = np.zeros((4, 1, 3))
    place[:, 0] = [[0, 0, 0], [1, 0, 0], [0, 0.5, 0.1], [1, 1, 0.1]]
    assert np.isfinite(quality(make_recording(np.arange(4.0), place)).out_of_plane_share)
    place[2, 0, 1] = np.nan
    assert np.isnan(quality(make_recording(np.arange(4.0), place)).out_of_plane_share)
