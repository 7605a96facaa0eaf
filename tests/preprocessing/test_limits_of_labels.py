"""Labels that trackers exchange: each limit of the search from just below, at and just above."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.preprocessing.labels import _continuation, _expected, _last_seen, _suspects, exchanged, label_order

TIME = np.arange(40) / 100


def rows(*ends):
    """Two stations at rest, and in the last frames at the given places along x."""
    place = np.zeros((40, 2, 2))
    place[:, 1, 0] = 5.0
    for k, (first, second) in enumerate(ends, 40 - len(ends)):
        place[k, :, 0] = first, second
    return place


@pytest.mark.parametrize("time", [TIME, TIME + 1e3])
def test_two_points_that_pass_each_other_exchange_labels_to_the_end(time):
    place = rows((5.0, 0.0), (5.0, 0.0), (5.0, 0.0))
    order = label_order(place, time)
    assert (order[:37] == [0, 1]).all()
    assert (order[37:] == [1, 0]).all()
    assert exchanged(place, time, ["a", "b"]) == {"a-b": 3}
    assert exchanged(place[:, :1], time, ["a"]) == {}
    twice = rows((5.0, 0.0), (0.0, 5.0), (5.0, 0.0), (0.0, 5.0))
    assert exchanged(twice, time, ["a", "b"]) == {"a-b": 2}


def test_three_points_in_turn_come_back_to_their_own_labels():
    place = np.zeros((40, 3, 2))
    place[..., 0] = [0.0, 5.0, 10.0]
    still = place.copy()
    place[10:20] = still[10:20][:, [2, 0, 1]]
    place[20:26] = still[20:26][:, [1, 2, 0]]
    order = label_order(place, TIME)
    found = np.take_along_axis(place, order[..., None], axis=1)
    np.testing.assert_array_equal(found, still)


def test_four_frames_show_an_exchange_and_three_do_not():
    assert label_order(rows((5.0, 0.0))[-4:], TIME[-4:]).tolist() == [[0, 1]] * 3 + [[1, 0]]
    assert label_order(rows((5.0, 0.0))[-3:], TIME[-3:]).tolist() == [[0, 1]] * 3


@pytest.mark.parametrize(("off", "found"), [(1.0, True), (1.01, False)])
def test_labels_are_exchanged_where_that_makes_the_steps_four_times_shorter(off, found):
    """Steps of 2 off against 2 (5 - off)."""
    place = rows((5.0 - off, off))
    order = _continuation(place, _last_seen(place), TIME, 39)
    assert (order is not None) == found


@pytest.mark.parametrize(("step", "found"), [(4.05, False), (4.15, True)])
def test_a_leap_is_four_usual_steps_and_clear_of_the_noise(step, found):
    """Usual steps of 1, of 3 and 4 fifths along x and y; the floor is 3e-3 of a travel of about 21."""
    lengths = np.ones(40)
    lengths[[0, 39]] = 0.0, step
    place = np.cumsum(lengths)[:, None, None] * np.array([0.6, 0.8])
    assert _suspects(place, _last_seen(place), TIME).tolist() == ([39] if found else [])


def test_the_first_step_may_be_a_leap_and_a_station_that_appears_has_made_none():
    place = rows()
    place[0, 0] = 3.0
    assert _suspects(place, _last_seen(place), TIME).tolist() == [1]
    place = rows()
    place[:3, 0] = np.nan  # it appears where it stays for a while, and ends elsewhere by small steps
    place[20:, 0, 0] = np.linspace(0.0, 0.5, 20)
    assert _last_seen(place)[:5, 0].tolist() == [-1, -1, -1, -1, 3]
    assert _suspects(place, _last_seen(place), TIME).tolist() == []
    place[5, 1, 0] = np.nan  # half of a place is none
    assert _last_seen(place)[4:8, 1].tolist() == [3, 4, 4, 6]


@pytest.mark.parametrize(("gap", "found"), [(0.2, True), (0.21, False)])
def test_sightings_a_fifth_of_a_second_apart_are_compared(gap, found):
    time = np.append(np.arange(-38, 1) / 100, gap)
    place = rows((5.0, 0.0))
    last = _last_seen(place)
    assert (_suspects(place, last, time).size > 0) == found
    assert (_continuation(place, last, time, 39) is not None) == found
    moved = np.array([[[0.0, 0.0]], [[2.0, 1.0]], [[9.0, 9.0]]])
    clock = np.array([0.0, gap, 2 * gap])
    expected = [4.0, 2.0] if found else [2.0, 1.0]  # a speed from sightings farther apart says nothing
    np.testing.assert_allclose(_expected(moved, _last_seen(moved), clock, 2, np.array([0])), [expected])
    later = [*clock[:2].tolist(), 1e-9 + gap]
    np.testing.assert_allclose(_expected(moved, _last_seen(moved), np.array(later), 2, np.array([0])), [[2.0, 1.0]],
                               atol=1e-7)  # fmt: skip


def test_a_speed_is_that_of_the_last_two_sightings_at_any_time_of_the_day():
    moved = np.array([[[0.0, 0.0]], [[2.0, 1.0]], [[9.0, 9.0]]])
    for start in (0.0, 7.0, 5e4):
        time = start + np.array([0.0, 0.125, 0.1875])
        np.testing.assert_allclose(_expected(moved, _last_seen(moved), time, 2, np.array([0])), [[3.0, 1.5]])


def test_a_hidden_station_keeps_a_label_that_is_left():
    place = np.concatenate([rows((5.0, 0.0)), np.full((40, 1, 2), 9.0)], axis=1)
    place[39, 2] = np.nan
    assert _continuation(place, _last_seen(place), TIME, 39).tolist() == [1, 0, 2]
    never = place.copy()
    never[:, 2] = np.nan
    assert _continuation(never, _last_seen(never), TIME, 39).tolist() == [1, 0, 2]
    place[39, :, 0] = 5.0, np.nan, 0.0  # the second is hidden, and the first shows under the label of the third
    place[:39, :, 0], place[:39, :, 1] = [0.0, 5.0, 9.0], 0.0
    place[39, :, 1] = 0.0, np.nan, 0.0
    assert _continuation(place, _last_seen(place), TIME, 39).tolist() == [2, 0, 1]
    partly = rows((5.0, 0.0))
    partly[39, 0, 1] = np.nan  # half of a place is none: one point is left, which may be either
    assert _continuation(partly, _last_seen(partly), TIME, 39).tolist() == [1, 0]
