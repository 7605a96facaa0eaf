"""Dots, frames and overlays at the edges of what counts: hand-made cases just below and just above each limit."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.recording.camera import Camera
from pliant.video import Tracking, marks
from pliant.video.marks import ChainOfDots, Dots, _first_dots, _on_one_body, hexadecimal
from pliant.video.overlay import _size, drawn, overlay
from pliant.video.reel import Reel
from pliant.video.track import _base_first, _even, _recording, _Seen, _stacked, _times, doubled_and_leaps, lost_in_times

cv2 = pytest.importorskip("cv2")
GREY, RED = np.array([90.0, 90.0, 90.0]), (60.0, 40.0, 200.0)  # blue, green, red


@dataclass(frozen=True)
class Numbered(Reel):
    """A film whose pictures are their numbers."""

    def frames(self):
        yield from ((0.1 * k, k) for k in range(self.count))


FILM = Numbered(Path("f.mp4"), 64, 48, 30.0, 50)


def dotted(parts, size=(60, 80)):
    """A picture with parts (rows, columns, share of the dots' colour)."""
    away = np.array(RED) - np.mean(RED)
    picture = np.full((*size, 3), 90.0)
    for rows, columns, share in parts:
        picture[rows, columns] = GREY + share * away
    return picture


@pytest.mark.parametrize(("share", "count"), [(0.38, 0), (0.42, 1)])
def test_a_pixel_has_the_colour_of_a_dot_from_two_fifths_on(share, count):
    assert len(Dots(RED).all(dotted([(slice(10, 16), slice(20, 26), share)]))[0]) == count


@pytest.mark.parametrize(("rows", "columns", "count"), [(2, 4, 0), (3, 3, 1)])
def test_a_dot_has_nine_pixels_at_least(rows, columns, count):
    assert len(Dots(RED).all(dotted([(slice(10, 10 + rows), slice(20, 20 + columns), 1.0)]))[0]) == count


def test_a_dot_lies_where_its_colour_is_weighed_beyond_a_fifth():
    """A faint column beside the dot shifts it by what it weighs; what lies farther away does not, nor another dot."""
    place, mass = Dots(RED).all(dotted([(slice(10, 15), slice(20, 25), 1.0), (slice(10, 15), slice(25, 26), 0.3)]))
    np.testing.assert_allclose(mass, [25 * 0.8 + 5 * 0.1], rtol=1e-4)
    np.testing.assert_allclose(place, [[22 + 5 * 0.1 * 3 / 20.5, 12.0]], rtol=1e-5)
    place, mass = Dots(RED).all(dotted([(slice(10, 15), slice(20, 25), 1.0), (slice(10, 15), slice(27, 28), 0.3),
                                        (slice(17, 18), slice(20, 25), 0.3)]))  # fmt: skip
    np.testing.assert_allclose(place, [[22.0, 12.0]], atol=1e-4)
    place, mass = Dots(RED).all(dotted([(slice(10, 15), slice(20, 25), 1.0), (slice(10, 15), slice(26, 31), 1.0)]))
    np.testing.assert_allclose(place, [[22.0, 12.0], [28.0, 12.0]], atol=1e-4)
    np.testing.assert_allclose(mass, 20.0, rtol=1e-4)
    for rows, columns in ((slice(0, 4), slice(0, 4)), (slice(56, 60), slice(76, 80))):  # at the picture's corners
        place, mass = Dots(RED).all(dotted([(rows, columns, 1.0)]))
        np.testing.assert_allclose(place, [[columns.start + 1.5, rows.start + 1.5]], atol=1e-4)
    region = (21.99, 11.99, 22.01, 12.01)
    assert len(Dots(RED, region).all(dotted([(slice(10, 15), slice(20, 25), 1.0)]))[0]) == 1
    for k, shift in ((0, 1), (1, 1), (2, -1), (3, -1)):
        other = tuple(v + 0.02 * shift * (j == k) for j, v in enumerate(region))
        assert len(Dots(RED, other).all(dotted([(slice(10, 15), slice(20, 25), 1.0)]))[0]) == 0


@pytest.mark.parametrize(("width", "height", "filled", "taken"), [
    (10, 10, 70, True), (10, 10, 66, False), (10, 10, 87, True), (10, 10, 90, False),
    (15, 10, 117, True), (17, 10, 133, False), (10, 16, 125, True), (10, 17, 133, False),
])
def test_a_disc_fills_a_part_of_its_box_and_is_about_as_wide_as_high(width, height, filled, taken):
    box = np.ones((height, width), bool)
    inner = np.argwhere(box[1:-1, 1:-1]) + 1
    drop = width * height - filled
    box[tuple(inner[:: max(1, len(inner) // drop)][:drop].T)] = False  # holes; its border is whole
    assert box.sum() == filled
    picture = dotted([])
    picture[20 : 20 + height, 30 : 30 + width][box] = GREY + np.array(RED) - np.mean(RED)
    assert len(Dots(RED).all(picture, round_ones=True)[0]) == taken
    assert len(Dots(RED).all(picture)[0]) == 1


@pytest.mark.parametrize(("red", "grey"), [(148.0, True), (150.0, False)])
def test_a_colour_differs_from_grey_by_forty_levels(red, grey):
    if not grey:
        Dots((100.0, 100.0, red))
        return
    with pytest.raises(InputError, match="the colour #946464 of the dots is nearly grey"):
        Dots((100.0, 100.0, red))
    assert hexadecimal((1.0, 2.4, 254.6)) == "#ff0201"


def row_of_dots(count=4, mass=30.0):
    return ChainOfDots(np.stack([10.0 * np.arange(count), np.zeros(count)], axis=1), np.full(count, mass))


def test_a_dot_keeps_its_size_unless_it_is_blurred():
    follow, masses = row_of_dots(), np.array([10.4, 10.6, 17.9, 18.1, 47.9, 48.1])
    slow, fast = [False, False, False, True, True, False], [False, True, True, True, True, False]
    wide = 2 * np.sqrt(30.0 / np.pi)
    for step, gap, alike in ((0.0, 0, slow), (0.99 * wide, 0, slow), (1.01 * wide, 0, fast), (0.0, 1, fast)):
        follow.step[1], follow.gap[1] = (step, 0.0), gap
        assert follow._alike(1, masses).tolist() == alike


@pytest.mark.parametrize(("step", "gap", "reach"), [(0.0, 0, 5.0), (0.0, 1, 10.0), (2.0, 0, 7.0), (2.0, 2, 21.0)])
def test_the_slowest_dot_is_sought_within_a_reach_that_grows(step, gap, reach):
    follow = ChainOfDots(np.array([[0.0, 0.0], [10.0, 0.0], [20.0, 0.0], [37.0, 0.0]]), np.full(4, 30.0))
    follow.step[1], follow.gap[1] = (0.0, step), gap
    for share, found in ((0.98, 1), (1.02, -1)):
        centres = np.array([[60.0, 0.0], [10.0 - share * reach, step], [10.0, 99.0]])
        assert follow._nearest(1, centres, np.full(3, 30.0)) == found
    centres = np.array([[10.0, step], [10.3, step]])
    assert follow._nearest(1, centres, np.array([90.0, 30.0])) == 1  # the nearest is of another size


@pytest.mark.parametrize(("far", "turn", "found"), [
    (7.6, 0.0, True), (7.4, 0.0, False), (11.9, 0.0, True), (12.1, 0.0, False),
    (10.0, 1.15, True), (10.0, 1.25, False), (10.0, -1.15, True), (10.0, -1.25, False),
])
def test_the_next_dot_lies_at_about_its_distance_and_direction(far, turn, found):
    for way, start in ((1, 0), (-1, 3)):
        follow = row_of_dots()
        here = follow.place[start]
        centres = np.array([here, here + way * far * np.array([np.cos(turn), np.sin(turn)])])
        chosen = np.full(4, -1)
        chosen[start] = 0
        follow._along(chosen, start, way, centres, np.full(2, 30.0))
        assert chosen[start + way] == (1 if found else -1)
        assert (chosen >= 0).sum() == 1 + found


def test_the_next_dot_is_the_one_that_fits_best_and_a_hidden_one_is_passed():
    follow, chosen = row_of_dots(), np.array([0, -1, -1, -1])
    centres = np.array([[0.0, 0.0], 10.0 * np.array([np.cos(0.2), np.sin(0.2)]), [11.5, 0.0], [8.1, 0.0]])
    follow._along(chosen, 0, 1, centres, np.full(4, 30.0))
    assert chosen[1] == 2  # farther by 0.15, against a turn of 0.2 and nearer by 0.19
    chosen = np.array([0, -1, -1, -1])
    follow._along(chosen, 0, 1, centres, np.array([30.0, 30.0, 90.0, 30.0]))
    assert chosen[1] == 3  # what fits best is of another size
    turned = np.array([np.cos(0.9), np.sin(0.9)]), np.array([np.cos(1.8), np.sin(1.8)])
    path = np.array([[0.0, 0.0], 10 * turned[0], 10 * turned[0] + 10 * turned[1]])
    chosen = np.array([0, -1, -1, -1])
    follow._along(chosen, 0, 1, path, np.full(3, 30.0))
    assert chosen.tolist() == [0, 1, 2, -1]  # each turn counts from that of the dot before
    chosen = np.array([0, -1, -1, -1])
    follow._along(chosen, 0, 1, np.array([[0.0, 0.0], [19.0, 0.5], [30.0, 0.0]]), np.full(3, 30.0))
    assert chosen.tolist() == [0, -1, 1, 2]  # over a hidden one: twice the distance


def test_the_slowest_dot_leads_and_speed_and_gaps_are_counted():
    follow = row_of_dots(5)
    follow.travel[:] = [5.0, 4.0, 0.0, 3.0, 9.0]
    up = np.array([0.0, 1.0])
    everyone = follow.place + up
    np.testing.assert_allclose(follow(everyone[::-1], np.full(5, 30.0)), everyone)
    np.testing.assert_allclose(follow.travel, [6.0, 5.0, 1.0, 4.0, 10.0])
    np.testing.assert_allclose(follow.step, np.tile([0.0, 1.0], (5, 1)))
    some = np.delete(everyone + up, 3, axis=0)
    found = follow(some, np.full(4, 30.0))
    assert np.isnan(found[3]).all()
    assert follow.gap.tolist() == [0, 0, 0, 1, 0]
    assert follow.place[3].tolist() == everyone[3].tolist()
    follow(some, np.full(4, 30.0))
    assert follow.gap.tolist() == [0, 0, 0, 2, 0]
    follow(everyone + 3 * up, np.full(5, 30.0))
    assert follow.gap.tolist() == [0, 0, 0, 0, 0]
    assert follow.step[3].tolist() == [0.0, 0.0]  # a step over a gap is no speed
    assert follow.travel[3] == 4.0
    far = row_of_dots(5)
    far.travel[:] = [0.0, 1.0, 2.0, 3.0, 4.0]
    moved = far.place.copy()
    moved[0] = [0.0, 60.0]  # the slowest one is lost: the next leads, and four of five are found
    np.testing.assert_allclose(far(moved, np.full(5, 30.0))[1:], moved[1:])


class Sees:
    """Dots that see a row of so many of the given sizes in each numbered picture."""

    def __init__(self, sizes):
        self.sizes = sizes

    def all(self, picture, *, round_ones=False):
        assert round_ones
        sizes = np.array(self.sizes(picture), float)
        return np.stack([10.0 * np.arange(len(sizes)), np.full(len(sizes), float(picture))], axis=1), sizes


def test_the_dots_are_those_of_the_first_thirty_frames_with_most():
    counts = {30: 4, 29: 3, 7: 3}
    place, mass, told = _first_dots(FILM, Sees(lambda k: [5.0] * counts.get(k, 2)), RED, None)
    np.testing.assert_allclose(place[np.argsort(place[:, 0])], [[0, 7], [10, 7], [20, 7]])
    assert (mass.tolist(), told) == ([5.0] * 3, [])
    place, mass, _ = _first_dots(FILM, Sees(lambda k: [10.0, 4.1, 3.9, 24.9, 25.1, 10.0, 10.0] if not k else [9.0] * 4),
                                 RED, None)  # fmt: skip
    assert sorted(mass.tolist()) == [4.1, 10.0, 10.0, 10.0, 24.9]
    place, _, _ = _first_dots(FILM, Sees(lambda k: [5.0] * (3 if k == 29 else 2)), RED, 3)
    assert place[0, 1] == 29.0
    with pytest.raises(InputError, match=r"f\.mp4: 1 dots of the colour #c8283c were found in its first frames"):
        _first_dots(FILM, Sees(lambda k: [5.0] * (1 if k < 30 else 4)), RED, None)
    with pytest.raises(InputError, match=r"f\.mp4: 0 dots"):
        _first_dots(FILM, Sees(lambda _: []), RED, None)
    assert len(_first_dots(FILM, Sees(lambda _: [5.0] * 2), RED, None)[0]) == 2


@pytest.mark.parametrize(("gap", "one"), [(24.0, True), (26.0, False)])
def test_a_body_is_what_lies_within_two_and_a_half_spacings(gap, one):
    points = np.array([[10.0 * k, 0.0] for k in range(4)] + [[30.0 + gap, 0.0]])
    assert _on_one_body(points, None).tolist() == [True] * 4 + [one]


def test_markers_are_sought_in_every_book_until_one_shows_some(monkeypatch):
    asked = []
    shown = {0: {}, 1: {3: (20.0, 0.0), 9: (0.0, 0.0), 4: (10.0, 0.0)}, 29: {k: (10.0 * k, 1.0) for k in range(4)}}

    def seen(finder, picture):
        books.setdefault(id(finder), len(books))
        asked.append((picture, books[id(finder)]))
        if books[id(finder)] != 2:
            return {1: np.zeros(2), 2: np.ones(2), 5: np.ones(2) * 2, 6: np.ones(2) * 3} if picture == 5 else {}
        return {n: np.array(p) for n, p in shown.get(picture, {}).items()}

    books: dict[int, int] = {}
    monkeypatch.setattr(marks, "_markers", seen)
    shown[30] = {k: (10.0 * k, 1.0) for k in range(7)}
    numbers, frames = marks.follow_aruco(FILM)
    assert numbers in ([0, 1, 2, 3], [3, 2, 1, 0])
    assert [p for p, book in asked if book != 2] == [0, 0, 0, 1, 1, 1]
    assert max(p for p, _ in asked) == 29
    times, pictures, places = zip(*frames, strict=True)
    np.testing.assert_allclose(times, 0.1 * np.arange(50))
    assert pictures == tuple(range(50))
    found = dict(zip(numbers, places[1], strict=True))
    np.testing.assert_allclose(found[3], [20.0, 0.0])
    assert np.isnan(found[0]).all()
    monkeypatch.setattr(marks, "_markers", lambda _, picture: {7: np.zeros(2)} if picture == 3 else {})
    with pytest.raises(InputError, match=r"f\.mp4: 1 ArUco or AprilTag markers were found"):
        marks.follow_aruco(FILM)


def pace(rows, change=None, time=None, stations=1):
    rows = np.asarray(rows, float)
    points = np.stack([rows[:, None] + np.arange(stations), np.zeros((len(rows), stations))], axis=2)
    change = np.full(len(rows), 2.0) if change is None else change
    time = np.arange(len(rows)) / 30 if time is None else time
    return [np.flatnonzero(found).tolist() for found in doubled_and_leaps(points, change, time)]


def steps(at, size, usual=3.0, count=14):
    return np.cumsum(np.where(np.arange(count) == at, size, usual))


def quiet(at, value=0.1, count=14):
    return np.where(np.arange(count) == at, value, 2.0)


@pytest.mark.parametrize(("usual", "seen"), [(0.68, False), (0.72, True)])
def test_repeats_and_leaps_are_told_from_rest_by_seven_tenths_of_a_pixel(usual, seen):
    assert pace(steps(6, 0.0, usual), quiet(6))[0] == [6] * seen
    assert pace(steps(6, 2 * usual, usual))[1] == [6] * seen


@pytest.mark.parametrize(("size", "doubled", "leapt"), [
    (0.54, True, False), (0.66, False, False), (4.95, False, False), (5.25, False, True),
])
def test_a_repeat_hardly_moves_and_a_leap_is_nearly_twice_as_long(size, doubled, leapt):
    assert pace(steps(6, size), quiet(6)) == [[6] * doubled, [6] * leapt]
    assert pace(steps(6, size), quiet(6), stations=4) == [[6] * doubled, [6] * leapt]


def test_the_neighbour_that_tells_less_decides():
    faster = np.array([3.0] * 6 + [0.66] + [6.0] * 7)  # more than a fifth of the slower neighbour, less of the faster
    assert pace(np.cumsum(faster), quiet(6))[0] == []
    faster[6] = 0.58
    assert pace(np.cumsum(faster), quiet(6))[0] == [6]
    slow = np.array([0.6] * 6 + [0.0] + [3.0] * 7)
    assert pace(np.cumsum(slow), quiet(6))[0] == []
    leap = np.array([3.0] * 6 + [9.0] + [6.0] * 7)  # 1.5 times the longer neighbour
    assert pace(np.cumsum(leap))[1] == []
    leap[6] = 10.5
    assert pace(np.cumsum(leap))[1] == [6]
    slow = np.array([0.6] * 6 + [9.0] + [3.0] * 7)
    assert pace(np.cumsum(slow))[1] == []


@pytest.mark.parametrize(("change", "alike"), [(0.34, True), (0.36, False)])
def test_a_repeated_picture_changes_by_a_third_of_the_lesser_neighbour(change, alike):
    for before, after in ((1.0, 3.0), (3.0, 1.0)):
        shown = quiet(6, change)
        shown[5], shown[7] = before, after
        assert pace(steps(6, 0.0), shown)[0] == [6] * alike


@pytest.mark.parametrize("at", range(1, 14))
def test_the_first_two_frames_and_the_last_are_never_judged(at):
    inside = 2 <= at <= 12
    assert pace(steps(at, 0.0), quiet(at))[0] == [at] * inside
    assert pace(steps(at, 6.0))[1] == [at] * inside
    time = np.arange(14) / 30
    late = time + (np.arange(14) >= at) / 30
    assert pace(steps(6, 6.0), time=late)[1] == ([] if at in (5, 6, 7) else [6])  # the clock tells of a frame there


def test_a_turn_and_a_hidden_neighbour_are_no_repeats():
    there_and_back = np.array([3.0] * 6 + [0.0] + [-3.0] * 7)
    assert pace(np.cumsum(there_and_back), quiet(6)) == [[], []]
    for hidden in (4, 5, 6, 7):
        rows = steps(6, 0.0)
        rows[hidden] = np.nan
        assert pace(rows, quiet(6)) == [[], []]
    rows = np.cumsum([3.0] * 6 + [0.0, 6.0] + [3.0] * 6)  # it catches up
    assert pace(rows, quiet(6)) == [[6], []]
    fast = np.array([10.0] * 6 + [1.5, 18.5] + [10.0] * 6)  # it hardly moved, and catches up in a leap
    assert pace(np.cumsum(fast), quiet(6)) == [[6], []]
    assert lost_in_times(np.array([0.0, 1.0, 2.0, 3.4, 4.4, 6.9, 7.9, 8.9, 9.9])) == (2 - 1 + 1 - 1, 1)
    assert lost_in_times(np.array([0.0, 1.0, 2.0, 3.6, 4.6, 7.2, 8.2, 9.2, 10.2])) == (1 + 2, 2)


REEL = Reel(Path("f.mp4"), 64, 48, 30.0, 9)
FREE = Camera(pixels_per_mm=1.0)


@pytest.mark.parametrize(("rate", "told"), [(30.58, False), (30.65, True), (29.42, False), (29.35, True)])
def test_a_stated_rate_is_told_where_it_is_off_by_a_fiftieth(rate, told):
    _, said, _ = _times(REEL, Camera(pixels_per_mm=1.0, rate_hz=rate), np.arange(9) / 30.0)
    assert any("which is used" in line for line in said) == told
    assert said[-2] == "0 frames are missing in 0 gap(s) of the file's times"


@pytest.mark.parametrize(("exposure", "readout", "shift", "unsure", "told"), [
    (8.0, None, 4e-3, 0.5 / 30, "uncertain by 16.7 ms: shutter open for 8 ms, rows read within an unknown time"),
    (None, 6.0, 0.5 / 30, 0.5 / 30 + 3e-3,
     "uncertain by 19.7 ms: shutter open for an unknown time, rows read within 6 ms"),
])
def test_what_is_not_known_of_the_shutter_makes_times_unsure(exposure, readout, shift, unsure, told):
    time = np.arange(9) / 30.0
    at, said, known = _times(REEL, Camera(pixels_per_mm=1.0, exposure_ms=exposure, readout_ms=readout), time)
    np.testing.assert_allclose(at, time + shift)
    assert known == pytest.approx(unsure)
    assert said[-1] == f"times are the middle of the exposure, {told}"
    with pytest.raises(InputError, match="the frame times of the file do not increase"):
        _times(REEL, FREE, np.array([0.0, 0.1, 0.1, 0.2]))


@pytest.mark.parametrize(("longer", "dropped"), [(1.028, 0), (1.032, 1), (0.972, 0), (0.968, 1)])
def test_a_shape_may_be_longer_by_three_in_a_hundred(longer, dropped):
    shape = np.tile(np.linspace([0.0, 0.0, 0.0], [0.06, 0.08, 0.0], 20), (5, 1, 1))
    shape[2] *= longer
    made, arc, names, strange = _even(shape, 4)
    assert strange == dropped
    assert np.isnan(made[2]).all() == bool(dropped)
    np.testing.assert_allclose(made[0], np.linspace([0, 0, 0], [0.06, 0.08, 0], 4), atol=1e-12)
    np.testing.assert_allclose(arc, np.linspace(0, 0.1, 4), atol=1e-12)
    assert names == ["base", "s01", "s02", "tip"]
    assert len(_even(shape, 12)[2]) == 12
    assert _even(shape, 12)[2][10] == "s10"


@pytest.mark.parametrize(("hidden", "refused"), [(5, False), (6, True)])
def test_a_body_is_seen_in_half_of_the_frames_at_least(hidden, refused):
    seen = np.arange(8.0).reshape(4, 2)
    gone = [None if k % 2 else np.full((4, 2), np.nan) for k in range(hidden)]
    partly = seen.copy()
    partly[0] = np.nan  # counts as seen
    frames = [*gone, *[partly] * (10 - hidden)]
    if refused:
        with pytest.raises(InputError, match=r"f\.mp4: the whole body was found in only 4 of 10 frames"):
            _stacked(frames, REEL)
        return
    made = _stacked(frames, REEL)
    assert np.isnan(made[:5]).all()
    np.testing.assert_array_equal(made[5:, 1:], np.broadcast_to(seen[1:], (5, 3, 2)))
    with pytest.raises(InputError, match="in only 0 of 0 frames"):
        _stacked([], REEL)


def test_marks_are_ordered_from_the_stated_base():
    points = np.tile(np.array([[10.0, 0.0], [20.0, 0.0], [40.0, 0.0]]), (6, 1, 1))
    points[3, 0] = np.nan
    for base, turned in (((24.0, 0.0), False), ((26.0, 0.0), True), ((10.0, 20.0), False), ((40.0, 20.0), True)):
        made, _ = _base_first(points, [], Tracking("dots", colour="#ff0000", base=base))
        np.testing.assert_array_equal(made, points[:, ::-1] if turned else points)


@pytest.mark.parametrize(("options", "said"), [
    ({"stations": 4}, None), ({"stations": 200}, None), ({"stations": 3}, "between 4 and 200, not 3"),
    ({"stations": 201}, "between 4 and 200, not 201"), ({"count": 2}, None), ({"count": 2.0}, "2 or more, not 2.0"),
    ({"region": (1, 2, 3, 4)}, None), ({"region": [1.0, 2, 3, 4]}, None), ({"region": (3, 2, 3, 4)}, "region must be"),
    ({"region": (1, 4, 3, 4)}, "region must be"), ({"region": (1, 2, 3)}, "region must be"),
    ({"region": (1, 2, "c", 4)}, "region must be"), ({"region": 5}, "region must be"),
])
def test_options_of_tracking_at_their_limits(options, said):
    whole = {"method": "silhouette" if "stations" in options else "dots",
             "colour": None if "stations" in options else "#0a141e", **options}
    if said:
        with pytest.raises(InputError, match=said):
            Tracking(**whole)
        return
    tracking = Tracking(**whole)
    if tracking.colour:
        assert tracking.blue_green_red == (30.0, 20.0, 10.0)


def test_a_recording_tells_what_was_hidden_repeated_and_missing(tmp_path):
    (tmp_path / "f.mp4").write_bytes(b"film")
    reel = Reel(tmp_path / "f.mp4", 200, 100, 30.0, 14)
    rows = np.cumsum([3.0] * 5 + [0.0] + [3.0] * 3 + [6.0] + [3.0] * 4)
    points = np.stack([rows[:, None] + [0.0, 30.0], np.full((14, 2), 50.0)], axis=2)
    points[12, 1] = np.nan
    camera = Camera(pixels_per_mm=2.0, exposure_ms=2.0, readout_ms=0.0)
    ds = _recording(reel, camera, Tracking("dots", colour="#ff0000", base=(0, 50)), [],
                    _Seen(np.arange(14) / 30, points, quiet(5)))  # fmt: skip
    told = ds.attrs["history"]
    for line in ("followed dots through 14 frames of f.mp4", "1 of 14 frames are gaps: the body was hidden",
                 "1 frames repeat the previous frame and are gaps", "1 steps are twice as long as their neighbours"):
        assert line in told
    place = ds["position"].values
    assert np.flatnonzero(np.isnan(place).any(axis=(1, 2))).tolist() == [5, 12]
    assert np.isfinite(place[12, 0]).all()
    np.testing.assert_allclose(place[4, 1, :2] - place[4, 0, :2], [0.015, 0.0], atol=1e-12)
    assert ds.attrs["time_uncertainty_s"] == 0.0
    np.testing.assert_allclose(ds["time"], np.arange(14) / 30 + 1e-3)
    plain = _Seen(np.arange(14) / 30, np.tile(np.linspace([0.0, 0.0], [0.0, 80.0], 20), (14, 1, 1)), np.full(14, 2.0))
    ds = _recording(reel, camera, Tracking(stations=5), [], plain)
    assert "the body is 40.00 mm long in the picture" in ds.attrs["history"]
    assert "differs by more than" not in ds.attrs["history"]
    assert "twice as long" not in ds.attrs["history"]
    plain.points[3] *= 1.1
    told = _recording(reel, camera, Tracking(stations=5), [], plain).attrs["history"]
    assert "1 frames in which the length differs by more than 3 % are gaps" in told


@pytest.mark.parametrize(("width", "height", "most", "size"), [
    (101, 77, 560, (100, 76)), (1921, 1080, 1280, (1280, 720)), (1200, 900, 560, (560, 420)), (64, 48, 64, (64, 48)),
])
def test_a_film_is_made_smaller_to_even_numbers_of_pixels(width, height, most, size):
    assert _size(Reel(Path("f.mp4"), width, height, 30.0, 9), most) == size


def test_a_sheet_has_twelve_tiles_three_across_and_three_gaps(tmp_path):
    reel, line = Reel(Path("f.mp4"), 640, 480, 30.0, 56), np.stack([np.full(5, 30.0), np.linspace(40, 10, 5)], axis=1)
    for gaps, rows in (((), 4), ((2,), 5), ((2, 7, 12), 5), ((2, 7, 12, 17), 5)):
        with overlay(reel, [tmp_path / "s.png"]) as draw:
            for k in range(56):
                hidden = None if k % 2 else np.where(np.arange(5)[:, None] < 2, np.nan, line)
                draw(k / 30, np.full((480, 640, 3), 4 * k, np.uint8), hidden if k in gaps else line)
        sheet = cv2.imread(str(tmp_path / "s.png"))
        assert sheet.shape == (rows * (420 + 6) - 6, 3 * (560 + 6) - 6, 3)
        tiles = [sheet[426 * (k // 3) + 300, 566 * (k % 3) + 300] for k in range(12 + len(gaps[:3]))]
        shown = sorted({*range(0, 56, 5), *gaps[:3]})
        assert [int(t[0]) for t in tiles] == [4 * k for k in shown]
        assert (sheet[420:426] == 255).all()
        assert (sheet[:, 560:566] == 255).all()
        last = 12 + len(gaps[:3])
        if last % 3:
            assert (sheet[426 * (rows - 1) :, 566 * (last % 3) :] == 255).all()


def test_lines_rings_and_texts_have_their_place_and_width():
    clear = np.zeros((240, 320, 3), np.uint8)
    line = np.stack([np.full(30, 100.0), np.linspace(200.0, 50.0, 30)], axis=1)
    made = drawn(1.25, clear, line, (320, 240)).astype(int)
    across = made[125, 90:111]
    assert ((across[:, 2] > 128) & (across[:, 0] < 128)).sum() in (2, 3)  # the red line
    assert (across[:, 2] > 128).sum() in (4, 5)  # and its white edge
    assert 95 in np.flatnonzero(made[200, :, 0] > 200).tolist()  # a ring of five pixels about the base
    assert made[200, 102:104].max() > 100
    text = np.argwhere((made[:45] > 200).all(axis=2))
    (wide, high), _ = cv2.getTextSize("1.250 s", cv2.FONT_HERSHEY_SIMPLEX, 0.6, 2)
    assert abs(text[:, 0].max() - 24) <= 1
    assert 10 <= np.ptp(text[:, 0]) <= high
    assert 8 <= text[:, 1].min() <= 12
    assert abs(text[:, 1].max() - (8 + wide)) <= 3
    few = drawn(0.0, clear, line[:24], (320, 240)).astype(int)  # to 24 points, each has its ring
    assert all((few[int(y), 92:108].min(axis=1) > 180).any() for y in line[:24, 1])
    ends = drawn(0.0, clear, line[:25], (320, 240)).astype(int)
    assert not (ends[int(line[12, 1]), 92:97].min(axis=1) > 180).any()
    texts = []
    for points in (None, np.full((30, 2), np.nan), np.where(np.arange(30)[:, None] < 2, np.nan, line)):
        shown = drawn(0.0, clear, points, (320, 240)).astype(int)
        alarm = np.argwhere(np.all(np.abs(shown - (60, 150, 255)) < 30, axis=2))
        texts.append(tuple(alarm.min(axis=0)) + tuple(alarm.max(axis=0)))
    assert texts[0] == texts[1]  # "gap"
    (wide, _), _ = cv2.getTextSize("2 hidden", cv2.FONT_HERSHEY_SIMPLEX, 0.6, 2)
    assert abs(texts[2][3] - (8 + wide)) <= 3
    assert abs(texts[2][2] - 50) <= 1
    assert texts[0][3] < texts[2][3] - 30
