"""The parts that follow a body in a film, each on a picture or a motion whose answer is known in closed form."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.recording.camera import Camera
from pliant.video import Tracking
from pliant.video.follow import (
    BASIS,
    POINTS,
    Follower,
    Sampler,
    _median,
    crossing,
    edges,
    evenly,
    longest_run,
    mask_of,
    normals,
    rough_line,
    share,
)
from pliant.video.marks import ChainOfDots, Dots, _markers, chain
from pliant.video.overlay import drawn, movie, overlay
from pliant.video.reel import Reel, open_reel
from pliant.video.silhouette import Stillness
from pliant.video.surroundings import Surroundings
from pliant.video.track import _base_first, _even, _times, doubled_and_leaps, lost_in_times

cv2 = pytest.importorskip("cv2")


def around(width=320, height=240, always=None):
    """A dark body (lightness 0) before a light background (level 200), anywhere in the picture."""
    behind = np.full((height, width, 3), 200, np.uint8)
    weight = np.full(3, -1.0 / (3 * 160), np.float32)
    always = np.zeros((height, width), bool) if always is None else always
    return Surroundings(weight, 40 * 3 * float(weight[0]), behind, behind.astype(np.float32), 1.0, always,
                        np.ones((height, width), bool))  # fmt: skip


def picture_of(line, thick=12, width=320, height=240):
    """A dark line (N, 2) on light ground."""
    made = np.full((height, width, 3), 200, np.uint8)
    cv2.polylines(made, [np.round(line * 16).astype(np.int32)], False, (40, 40, 40), thick, cv2.LINE_AA, 4)
    return made


def arc(count=41, bend=0.9, length=150.0):
    s = np.linspace(0.0, 1.0, count)
    return np.stack([160 + length * (1 - np.cos(bend * s)) / bend, 220 - length * np.sin(bend * s) / bend], axis=1)


def off(line, truth):
    """Distance of points from a curve, pixels."""
    fine = evenly(truth, 2001)
    return np.linalg.norm(line[:, None] - fine[None], axis=2).min(axis=1)


def test_an_edge_lies_where_the_profile_crosses_one_half():
    u = np.arange(21.0)
    profile = np.clip(np.stack([0.5 + 0.25 * (5.25 - np.abs(u - 10.0)), 0.5 + 0.1 * (4.5 - np.abs(u - 10.0))]), 0, 1)
    left, right, slope = edges(profile, 10)
    np.testing.assert_allclose(left, [4.75, 5.5])
    np.testing.assert_allclose(right, [15.25, 14.5])
    np.testing.assert_allclose(slope, [0.2, 0.1], atol=0.021)
    at, _ = crossing(np.ones((1, 21)), np.array([10]))
    assert np.isnan(at).all()
    at, _ = crossing(np.zeros((1, 21)), np.array([10]))  # already outside at the middle
    assert np.isnan(at).all()
    at, _ = crossing(np.where(u < 10, 1.0, 0.0)[None], np.array([10]))
    assert np.isnan(at).all()


def test_shares_of_a_body_lie_between_ground_and_body():
    light, behind = np.array([[0.0, 0.5, 1.0, 2.0, -1.0]]), np.zeros((1, 5))
    np.testing.assert_allclose(share(light, behind, np.array([1.0])), [[0.0, 0.5, 1.0, 1.4, -0.2]])
    np.testing.assert_allclose(share(light, behind, np.array([0.1])), 0.0)  # body and ground look alike


def test_lines_are_spaced_evenly_and_smoothed_towards_what_weighs():
    line = np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 14.0]])
    np.testing.assert_allclose(evenly(line, 4), [[0, 0], [3, 4], [3, 9], [3, 14]])
    tangent, normal = normals(np.array([[0.0, 0.0], [0.0, 2.0], [0.0, 4.0]]))
    np.testing.assert_allclose(tangent, [[0, 1]] * 3)
    np.testing.assert_allclose(normal, [[1, 0]] * 3)
    s = np.linspace(0, 1, POINTS)
    smooth = np.stack([np.sin(2 * s), s**2], axis=1)
    weight = np.ones(POINTS)
    spoilt = smooth.copy()
    spoilt[20:24], weight[20:24] = 9.0, 0.0
    np.testing.assert_allclose(BASIS.smooth(spoilt, weight), smooth, atol=1e-4)
    noise = np.random.default_rng(1).normal(size=(POINTS, 2))
    assert BASIS.smooth(noise, weight).std() < 0.7 * noise.std()


def test_a_sampler_reads_the_lightness_between_pixels():
    ramp = np.repeat(np.arange(0, 200, 10, dtype=np.uint8)[None, :, None], 8, axis=0).repeat(3, axis=2)
    place = SimpleNamespace(weight=np.array([0.5, 0.25, 0.25], np.float32), background=np.full_like(ramp, 7))
    light, behind = Sampler(place)(ramp, np.array([[[2.5, 3.0], [4.0, 3.5]]]))
    np.testing.assert_allclose(light, [[25.0, 40.0]], atol=0.6)
    np.testing.assert_allclose(behind, 7.0)


def test_running_medians_and_runs():
    np.testing.assert_allclose(_median(np.array([1.0, 9.0, 1.0, 1.0, 5.0, 6.0, 7.0])), [1, 1, 1, 5, 5, 6, 7])
    assert [longest_run(np.array(f, bool)) for f in ([0, 1, 1, 0, 1], [0, 0], [1, 1, 1], [1, 0, 1, 1])] == [2, 0, 3, 2]


@pytest.mark.parametrize("base", [None, (160.0, 220.0)])
def test_a_rough_line_runs_through_the_body_from_its_base(base):
    truth = arc()
    mask = mask_of(picture_of(truth), around())
    mask_true = picture_of(truth)[..., 0] < 120
    assert np.mean(mask != mask_true) < 2e-3
    line = rough_line(mask, None if base is None else np.array(base))
    assert len(line) == 24
    assert off(line[1:-1], truth).max() < 1.0
    assert off(line, truth).max() < 3.5  # its ends are round
    ends = np.linalg.norm(line[[0, -1]] - truth[[0, -1]], axis=1)
    if base is None and ends[0] > 50:
        ends = np.linalg.norm(line[[-1, 0]] - truth[[0, -1]], axis=1)
    assert ends.max() < 12
    assert rough_line(np.zeros((20, 20), bool), None) is None
    assert not mask_of(np.full((240, 320, 3), 200, np.uint8), around()).any()


def test_of_two_bodies_the_one_that_never_leaves_is_taken():
    two = picture_of(arc())
    two[20:60, 20:120] = 40  # larger than the body
    always = np.zeros((240, 320), bool)
    assert mask_of(two, around())[40, 60]
    always[210:220, 155:166] = True
    kept = mask_of(two, around(always=always))
    assert not kept[40, 60]
    assert kept[200, 161]


@pytest.mark.parametrize("base", [True, False])
def test_a_follower_finds_the_middle_the_tip_and_the_width(base):
    always = np.zeros((240, 320), bool)
    always[205:221, 150:170] = True
    follow = Follower(around(always=always), arc()[0] if base else None)
    for k, bend in enumerate((0.9, 0.8, 0.72, 0.75)):
        truth = arc(bend=bend)
        found = follow(picture_of(truth))
        assert found is not None
        assert off(found.line[3:-3], truth).max() < 0.4
        assert np.linalg.norm(found.line[0] - truth[0]) < (1.0 if base else 7.5)  # round ends, as wide as the body
        assert np.linalg.norm(found.line[-1] - truth[-1]) < 7.5
        assert np.median(found.half) == pytest.approx(6.5, abs=0.8)
        assert found.seen[3:-3].all()
        assert k == 0 or np.abs(follow.known.step).max() > 1.0
    assert follow(np.full((240, 320, 3), 200, np.uint8)) is None
    assert not follow.known.step.any()
    half = picture_of(arc(bend=0.75))
    half[:150] = 200  # its tip is hidden
    assert follow(half) is None
    assert follow(picture_of(arc(bend=0.7))) is not None


def test_a_drawn_line_lies_over_the_body_with_its_ends_marked():
    line = np.stack([np.full(30, 100.0), np.linspace(200.0, 50.0, 30)], axis=1)
    clear = np.zeros((240, 320, 3), np.uint8)
    made = drawn(1.25, clear, line, (160, 120))  # half as large
    assert made.shape == (120, 160, 3)
    red = (made[..., 2] > 150) & (made[..., 0] < 120)
    rows, columns = np.nonzero(red[35:95])
    assert columns.mean() == pytest.approx(49.75, abs=0.6)
    assert set(range(2, 58)) <= set(rows.tolist())
    blue, orange = (np.argwhere(np.all(np.abs(made.astype(int) - colour) < 40, axis=2)) for colour in
                    ((255, 160, 0), (0, 200, 255)))  # fmt: skip
    np.testing.assert_allclose(blue.mean(axis=0), [99.75, 49.75], atol=1.5)
    np.testing.assert_allclose(orange.mean(axis=0), [24.75, 49.75], atol=3.0)
    few = drawn(0.0, clear, line[::10], (320, 240))
    rings = np.all(few > 200, axis=2)
    for x, y in line[::10]:
        assert rings[round(y), round(x) + 5]
    gone, part = drawn(0.0, clear, None, (320, 240)), line.copy()
    part[3] = np.nan
    hidden = drawn(0.0, clear, part, (320, 240))
    alarm = [np.all(np.abs(p.astype(int) - (60, 150, 255)) < 30, axis=2)[30:60] for p in (gone, hidden, few)]
    assert [bool(a.any()) for a in alarm] == [True, True, False]


def test_a_sheet_shows_frames_over_the_whole_film_and_where_gaps_begin(tmp_path):
    reel, clear = Reel(Path("f.mp4"), 64, 48, 30.0, 40), np.zeros((48, 64, 3), np.uint8)
    line = np.stack([np.full(5, 30.0), np.linspace(40, 10, 5)], axis=1)
    with overlay(reel, [tmp_path / "s.png", tmp_path / "o.mp4"]) as draw:
        for k in range(40):
            draw(k / 30, clear, None if k in (2, 5, 6, 13, 20) else line)
    sheet = cv2.imread(str(tmp_path / "s.png"))
    # 12 frames evenly, and the first three gaps begin at 2, 5 and 13, none of them among the twelve
    assert sheet.shape == (5 * (48 + 6) - 6, 3 * (64 + 6) - 6, 3)
    assert np.all(sheet[48:54] == 255)
    film = cv2.VideoCapture(str(tmp_path / "o.mp4"))
    assert int(film.get(cv2.CAP_PROP_FRAME_COUNT)) == 40
    film.release()


def test_dots_are_weighed_where_they_are_and_told_by_shape():
    picture = np.full((120, 200, 3), 128, np.uint8)
    for x, y in ((40.25, 60.5), (90.0, 61.75), (150.5, 20.0)):
        cv2.circle(picture, (round(16 * x), round(16 * y)), 16 * 6, (60, 40, 200), -1, cv2.LINE_AA, 4)
    picture[100:104, 20:160] = (60, 40, 200)  # a stripe
    find = Dots((60.0, 40.0, 200.0))
    every, _ = find.all(picture)
    places, masses = find.all(picture, round_ones=True)
    assert (len(every), len(places)) == (4, 3)
    places = places[np.argsort(places[:, 0])]
    np.testing.assert_allclose(places, [(40.25, 60.5), (90.0, 61.75), (150.5, 20.0)], atol=0.1)
    assert masses.max() < 1.1 * masses.min()
    inside, _ = Dots((60.0, 40.0, 200.0), (30.0, 50.0, 100.0, 70.0)).all(picture)
    assert len(inside) == 2
    with pytest.raises(InputError, match="#808080 of the dots is nearly grey"):
        Dots((128.0, 128.0, 128.0))


def test_dots_are_ordered_along_the_body_and_followed_through_gaps():
    place = np.array([[10.0 * k, 0.0] for k in range(5)])
    shuffled = np.array([3, 0, 4, 1, 2])
    order = chain(place[shuffled])
    assert shuffled[order].tolist() in ([0, 1, 2, 3, 4], [4, 3, 2, 1, 0])
    follow = ChainOfDots(place, np.full(5, 30.0))
    for k in range(1, 9):
        turn = 0.06 * k
        seen = 10.0 * np.arange(5)[:, None] * [np.cos(turn), np.sin(turn)]
        there = np.ones(5, bool)
        if 3 <= k <= 5:
            there[2] = False  # the middle one is hidden for three frames
        found = follow(seen[there], np.full(there.sum(), 30.0))
        np.testing.assert_allclose(found[there], seen[there], atol=1e-9)
        assert np.isnan(found[~there]).all()
    assert follow.gap.tolist() == [0.0] * 5
    assert follow.travel[4] > follow.travel[1] > follow.travel[0]
    assert np.isnan(follow(np.empty((0, 2)), np.empty(0))).all()
    follow = ChainOfDots(place, np.full(5, 30.0))
    both = np.concatenate([place, [[31.0, 2.5]]])  # beside the fourth dot lies one that is nearly where it should be
    np.testing.assert_allclose(follow(both, np.full(6, 30.0)), place)
    odd = np.concatenate([seen, [[20.0, 60.0]]])
    assert np.isfinite(follow(odd, np.array([30.0] * 5 + [90.0]))).all()  # a mark of another size is none of them


def test_a_marker_lies_where_its_diagonals_cross():
    corners = np.array([[10.0, 10.0], [30.0, 12.0], [34.0, 36.0], [8.0, 30.0]])
    finder = SimpleNamespace(detectMarkers=lambda _: ((corners[None],), np.array([[7]]), None))
    found = _markers(finder, None)[7]
    for one, other in ((0, 2), (1, 3)):
        along, to = corners[other] - corners[one], found - corners[one]
        assert along[0] * to[1] - along[1] * to[0] == pytest.approx(0.0, abs=1e-9)
    assert _markers(SimpleNamespace(detectMarkers=lambda _: ((), None, None)), None) == {}


def test_the_times_of_frames_are_the_middle_of_the_exposure():
    reel, time = Reel(Path("f.mp4"), 64, 48, 30.0, 9), np.arange(9) / 30.0
    known = Camera(pixels_per_mm=1.0, exposure_ms=4.0, readout_ms=10.0)
    at, told, unsure = _times(reel, known, time)
    np.testing.assert_allclose(at, time + 2e-3)
    assert unsure == pytest.approx(5e-3)
    assert told[-1].endswith("uncertain by 5.0 ms: shutter open for 4 ms, rows read within 10 ms")
    at, told, unsure = _times(reel, Camera(pixels_per_mm=1.0), time)
    np.testing.assert_allclose(at, time + 0.5 / 30)
    assert unsure == pytest.approx(1.0 / 30)
    assert "open for an unknown time, rows read within an unknown time" in told[-1]
    at, told, _ = _times(reel, Camera(pixels_per_mm=1.0, rate_hz=60.0, exposure_ms=1.0), time)
    np.testing.assert_allclose(at, np.arange(9) / 60.0 + 0.5e-3)
    assert told[0].startswith("the file states 30 frames per second, [camera] 60")
    assert len(_times(reel, Camera(pixels_per_mm=1.0, rate_hz=30.3), time)[1]) == 2
    with pytest.raises(InputError, match="the frame times of the file do not increase"):
        _times(reel, Camera(pixels_per_mm=1.0), np.zeros(9))


def test_marks_begin_at_the_base():
    swing = np.linspace(0.0, 1.0, 20)[:, None] * np.arange(4.0)
    points = np.stack([50 + swing, np.full((20, 4), 7.0) + 10 * np.arange(4)], axis=2)  # the first hardly moves
    how = Tracking("dots", colour="#ff0000")
    for turned in (points, points[:, ::-1]):
        made, names = _base_first(turned, [], how)
        np.testing.assert_array_equal(made, points)
        assert names == ["dot_1", "dot_2", "dot_3", "dot_4"]
    made, names = _base_first(points[:, ::-1], ["m4", "m3", "m2", "m1"], Tracking("aruco"))
    assert names == ["m1", "m2", "m3", "m4"]
    told = Tracking("dots", colour="#ff0000", base=(50.0, 40.0))
    np.testing.assert_array_equal(_base_first(points, [], told)[0], points[:, ::-1])


def test_stations_lie_evenly_along_a_body_and_wrong_lengths_are_gaps():
    s = np.linspace(0.0, 1.0, 61) ** 1.5  # unevenly
    turn = np.linspace(0.2, 1.0, 12)[:, None]
    shape = np.stack([0.1 * (1 - np.cos(turn * s)) / turn, 0.1 * np.sin(turn * s) / turn, 0 * turn * s], axis=2)
    shape[4] *= 1.2
    shape[7, 3] = np.nan
    made, arc_length, names, strange = _even(shape, 5)
    good = np.delete(np.arange(12), [4, 7])
    share = np.linspace(0, 1, 5)
    whole = turn * share
    exact = np.stack([0.1 * (1 - np.cos(whole)) / turn, 0.1 * np.sin(whole) / turn, 0 * whole], axis=2)
    np.testing.assert_allclose(made[good], exact[good], atol=2e-5)
    assert np.isnan(made[[4, 7]]).all()
    np.testing.assert_allclose(arc_length, 0.1 * share, rtol=1e-3)
    assert names == ["base", "s01", "s02", "s03", "tip"]
    assert strange == 1


def test_repeats_and_leaps_need_a_steady_motion():
    time, rows = np.arange(30) / 30.0, np.arange(30) * 3.0
    change = np.full(30, 2.0)

    def told(rows, change=change, time=time):
        points = np.stack([rows[:, None] + np.arange(4), np.zeros((30, 4))], axis=2)
        points[:, 1] = np.where(np.arange(30)[:, None] % 2, np.nan, points[:, 1])  # one dot is seen now and then
        return [np.flatnonzero(found).tolist() for found in doubled_and_leaps(points, change, time)]

    repeated = rows.copy()
    repeated[12] = repeated[11]
    quiet = np.where(np.arange(30) == 12, 0.1, 2.0)
    assert told(repeated, quiet)[0] == [12]
    assert told(repeated)[0] == []  # the picture changed: it is no repeat
    assert told(0.1 * repeated, quiet)[0] == []  # too slow to be told from rest
    leap = rows + 3.0 * (np.arange(30) >= 20)
    assert told(leap)[1] == [20]
    assert told(rows + 1.5 * (np.arange(30) >= 20))[1] == []  # half as far again: it accelerates
    late = time + 1 / 30 * (np.arange(30) >= 20)
    assert told(leap, time=late)[1] == []  # the times tell that frame
    there_and_back = np.where(np.arange(30) < 20, rows, rows[20] * 2 - rows)
    assert told(there_and_back) == [[], []]
    assert lost_in_times(np.delete(time, [3, 4, 9])) == (3, 2)


@pytest.mark.parametrize(("frames", "moved", "refused"), [(40, 0.4, False), (40, 3.0, True), (1, 3.0, False)])
def test_a_camera_that_moves_in_more_than_a_few_frames_is_refused(frames, moved, refused):
    rng = np.random.default_rng(5)
    board = cv2.GaussianBlur(rng.integers(0, 255, (240, 320, 3)).astype(np.uint8), (0, 0), 5.0)
    board = cv2.normalize(board, None, 0, 255, cv2.NORM_MINMAX)
    place = around()
    place = Surroundings(place.weight, place.body, board, board.astype(np.float32), 1.0, place.always,
                         np.zeros((240, 320), bool))  # fmt: skip
    watch = Stillness(place, Reel(Path("f.mp4"), 320, 240, 30.0, 100))
    shift = np.float32([[1, 0, moved], [0, 1, 0]])
    for k in range(100):
        watch(cv2.warpAffine(board, shift, (320, 240), borderMode=cv2.BORDER_REPLICATE) if k < frames else board)
    assert watch.shifts[0] == pytest.approx(moved, rel=0.2)
    if refused:
        with pytest.raises(InputError, match=r"the camera moves by .* pixels or more in 40 of 100 frames"):
            watch.refuse()
    else:
        watch.refuse()


def test_a_reel_reads_frames_over_the_whole_film(tmp_path):
    with movie(tmp_path / "f.mp4", 25.0, (64, 48)) as write:
        for k in range(20):
            write(np.full((48, 64, 3), 10 * k, np.uint8))
    reel = open_reel(tmp_path / "f.mp4")
    assert (reel.width, reel.height, reel.rate, reel.count) == (64, 48, 25.0, 20)
    levels = [float(p.mean()) for _, p in reel.frames()]
    np.testing.assert_allclose(levels, 10.0 * np.arange(20), atol=4)
    few = [float(p.mean()) for p in reel.pictures(5)]
    np.testing.assert_allclose(few, 10.0 * np.array([0, 4, 9, 14, 19]), atol=4)
    small = reel.sampled(3, 16)
    assert small.shape == (3, 12, 16, 3)
    np.testing.assert_allclose([t for t, _ in reel.frames()], np.arange(20) / 25, atol=1e-3)


def test_brightness_is_brought_to_that_of_the_reference():
    rng = np.random.default_rng(6)
    usual = rng.uniform(60, 180, (48, 64, 3)).astype(np.float32)
    reel = Reel(Path("f.mp4"), 64, 48, 25.0, 20, usual)
    gain = np.array([1.2, 0.9, 1.0])
    seen = np.clip(usual * gain, 0, 255).astype(np.uint8)
    np.testing.assert_allclose(reel.gain(seen), gain, rtol=0.01)
    assert np.abs(reel.even(seen) - usual).max() < 3
    dark = np.zeros_like(seen)
    np.testing.assert_array_equal(reel.gain(dark), 1.0)  # too few pixels tell
    assert reel.coarse == 1
    assert Reel(Path("f.mp4"), 640, 48, 25.0, 20).coarse == 4
