"""Each limit of the trackers from just below and just above, and each measure against a body drawn to known size."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.testbed.camera.scene import coverage
from pliant.video import silhouette
from pliant.video.follow import (
    BASIS,
    Basis,
    Follower,
    Known,
    Ribbon,
    _distances,
    crossing,
    edges,
    mask_of,
    rough_line,
    share,
)
from pliant.video.reel import Reel, even_exposure, open_reel
from pliant.video.silhouette import Stillness

cv2 = pytest.importorskip("cv2")
NONE = np.zeros((240, 320), bool)


def around(scale=1, always=NONE, width=320, height=240):
    """A body of lightness 1 (level 40) on ground of lightness 0 (level 200), which may be anywhere."""
    behind = np.full((height, width, 3), 200, np.uint8)
    small = np.full((height // scale, width // scale, 3), 200, np.float32)
    weight = np.full(3, -1.0 / (3 * 160), np.float32)
    base = float(200 * weight.sum())
    return SimpleNamespace(
        weight=weight,
        body=base + 1.0,
        background=behind,
        small=small,
        scale=float(scale),
        always=always,
        reach=~NONE if scale == 1 else np.ones(small.shape[:2], bool),
        light=base,
    )


def ribbon(line, half=8.0, picture=None, level=40):
    """A body with sharp, square ends whose edges lie `half` pixels from a straight or bent line (N, 2)."""
    made = np.full((240, 320, 3), 200, np.uint8) if picture is None else picture
    way = np.gradient(line, axis=0)
    way /= np.hypot(*way.T)[:, None]
    out = np.broadcast_to(half, len(line))[:, None] * np.stack([way[:, 1], -way[:, 0]], axis=1)
    part = coverage([np.concatenate([line + out, (line - out)[::-1]])], (0, 0, 320, 240)).astype(float)[..., None]
    return np.round(part * level + (1 - part) * made).astype(np.uint8)


def straight(first=60.0, last=240.0, y=120.0, count=61):
    return np.stack([np.linspace(first, last, count), np.full(count, y)], axis=1)


def known(line, half=8.0, light=None, length=0.0, place=None):
    light = (place or around()).body if light is None else light
    return Known(line, np.zeros_like(line), np.full(61, half), np.full(61, light), length)


def test_the_middle_is_found_from_a_line_that_is_off_by_half_a_width():
    follow = Follower(around(), np.array([60.0, 120.0]))
    picture = ribbon(straight())
    for off in (-5.0, 3.0):
        centred = follow._centred(picture, straight(y=120.0 + off), known(straight()))
        assert np.abs(centred[8:-3, 1] - 120.0).max() < 0.25
        measured = follow._measured(picture, centred, known(straight()))
        assert np.abs(measured.line[8:-3, 1] - 120.0).max() < 0.05
        assert np.abs(measured.half[3:-3] - 8.0).max() < 0.1
        assert np.abs(measured.light[3:-3] - around().body).max() < 0.02
        assert measured.seen[3:-3].all()


@pytest.mark.parametrize(
    ("half", "usual", "seen"),
    [(3.7, 8.0, False), (4.3, 8.0, True), (12.4, 8.0, True), (13.3, 8.0, False), (30.0, 30.0, True), (13, 30.0, False)],
)
def test_a_body_is_centred_where_half_to_eight_fifths_of_its_width_show(half, usual, seen):
    """The middle of a body that lies 10 pixels off is found along each normal."""
    follow, taken = Follower(around(), np.array([60.0, 120.0])), []
    follow._smooth = lambda line, weight: taken.append((line, weight)) or line
    follow._centred(ribbon(straight(y=130.0), half), straight(), known(straight(), usual))
    line, weight = taken[0]
    assert weight[5:-5].all() == weight[5:-5].any() == seen
    np.testing.assert_allclose(line[5:-5, 1], 130.0 if seen else 120.0, atol=1.0)
    np.testing.assert_allclose(line[:, 0], straight()[:, 0])


@pytest.mark.parametrize(("wide", "seen"), [(5.0, False), (7.0, True), (9.6, True), (11.5, False), (14.0, False)])
def test_a_width_far_from_the_usual_one_is_not_the_body(wide, seen):
    """From three quarters to thirteen tenths of it."""
    half = np.where(np.abs(np.arange(61) - 30) < 8, wide, 8.0)
    found = Follower(around(), np.array([60.0, 120.0]))._measured(
        ribbon(straight(), half), straight(), known(straight())
    )
    assert found.seen[26:35].all() == seen
    assert found.seen[26:35].any() == seen
    assert found.seen[5:18].all()
    np.testing.assert_allclose(found.half[28:33], wide if seen else 8.0, atol=0.1)


@pytest.mark.parametrize(("lightness", "seen"), [(0.6, True), (0.5, False), (1.4, True), (1.5, False)])
def test_a_body_changes_its_lightness_by_less_than_half_its_contrast(lightness, seen):
    place = around()
    found = Follower(place, np.array([60.0, 120.0]))._measured(
        ribbon(straight()), straight(), known(straight(), light=place.light + 2.0 - lightness)
    )
    assert found.seen[5:-5].all() == seen
    assert found.seen[5:-5].any() == seen


@pytest.mark.parametrize(("shift", "seen"), [(5.0, True), (7.0, False)])
def test_a_place_that_leaps_from_its_neighbours_is_not_the_body(shift, seen):
    line = straight()
    line[29:31, 1] += shift
    picture = np.full((240, 320, 3), 200, np.uint8)
    for k in range(60, 241):
        middle = int(line[int(np.clip(round((k - 60) / 3), 0, 60)), 1])
        picture[middle - 8 : middle + 9, k] = 40
    found = Follower(around(), np.array([60.0, 120.0]))._measured(picture, straight(), known(straight(), 8.5))
    assert found.seen[29:31].tolist() == [seen] * 2
    assert found.seen[5:28].all()


def test_lightness_is_that_of_the_inner_part_alone():
    picture = ribbon(straight(), 2.6, ribbon(straight(), 10.0), 100)
    found = Follower(around(), np.array([60.0, 120.0]))._measured(picture, straight(), known(straight(), 10.0))
    np.testing.assert_allclose(found.light[5:-5], around().light + 0.625, atol=0.01)


@pytest.mark.parametrize(
    ("drawn", "reached"), [(228.0, True), (252.0, True), (269.0, True), (275.0, False), (223.0, False)]
)
def test_an_end_is_found_within_two_widths_beyond_the_line_or_one_before(drawn, reached):
    follow, line = Follower(around(), np.array([60.0, 120.0])), straight()
    state = known(line)
    state.half[:-4], state.light[:-6] = 30.0, around().light  # of the base alone: they do not count at the tip
    made, tip = follow._ended(ribbon(straight(60.0, drawn)), line, state, at_tip=True)
    assert tip == reached
    assert made[-1] == pytest.approx((drawn if reached else 240.0, 120.0), abs=0.15)
    np.testing.assert_allclose(np.diff(made[:, 0]), (made[-1, 0] - 60.0) / 60, atol=1e-6)
    state.half[:], state.light[:] = 30.0, around().light  # of the tip alone
    state.half[:4], state.light[:6] = 8.0, around().body
    made, base = follow._ended(ribbon(straight(60.0, drawn)), line, state, at_tip=False)
    assert base == reached
    assert made[-1, 0] == pytest.approx(drawn if reached else 240.0, abs=0.15)


def test_a_slanted_end_is_where_its_middle_is():
    """The body's end is looked at over about half of its width to both sides."""
    picture = np.full((240, 320, 3), 200, np.uint8)
    cv2.fillPoly(picture, [np.array([[60, 112], [246, 112], [234, 128], [60, 128]], np.int32)], (40, 40, 40))
    picture[110:115, 246:] = 40  # a cable along its edge, beyond that part
    made, tip = Follower(around(), np.array([60.0, 120.0]))._ended(picture, straight(), known(straight()), at_tip=True)
    assert tip
    assert made[-1, 0] == pytest.approx(240.0, abs=0.8)


@pytest.mark.parametrize(("rise", "weight"), [(0.05, (0.05 / 0.08) ** 2), (0.07, (0.07 / 0.08) ** 2), (0.2, 1.0)])
def test_blurred_edges_weigh_less(rise, weight):
    """With the square of their steepness, from 0.08 of the contrast in a pixel on fully."""
    rows = np.arange(240.0)[:, None, None]
    picture = np.broadcast_to(200 - 160 * np.clip(0.5 + rise * (24 - np.abs(rows - 120)), 0, 1), (240, 320, 3))
    follow, taken = Follower(around(), np.array([60.0, 120.0])), []
    follow._smooth = lambda line, trust: taken.append(trust) or line
    follow._measured(np.round(picture).astype(np.uint8), straight(), known(straight(), 24.0))
    np.testing.assert_allclose(taken[0][5:-5], weight, rtol=0.06)


def test_the_base_is_the_end_that_never_moves():
    mask = np.zeros((240, 320), bool)
    mask[100:110, 60:200] = True
    for columns, end in ((slice(60, 70), 62.0), (slice(190, 200), 197.0)):
        always = NONE.copy()
        always[100:110, columns] = True
        found = Follower(around(always=always))._begin(mask)
        assert found[0] == pytest.approx(end, abs=3.5)
        assert 100 <= found[1] < 110
    assert Follower(around())._begin(mask) is None
    assert Follower(around(always=mask))._begin(NONE) is None


def found_body(hidden=(), length=100.0, tip=True):
    seen = np.ones(61, bool)
    seen[list(hidden)] = False
    line = np.stack([np.linspace(0.0, length, 61), np.zeros(61)], axis=1)
    return Ribbon(line, np.full(61, 8.0), np.ones(61), seen, tip)


@pytest.mark.parametrize(
    ("hidden", "whole"),
    [
        ((), True),
        (range(20, 27), True),
        (range(20, 28), False),  # seven in one piece, eight
        ((0, 1, *range(2, 8)), True),
        (range(2, 10), False),  # the two at the base never count
        (range(5, 39, 2), True),
        (range(5, 41, 2), False),  # 17 of 59, 18
        ((55, 57, 59), True),
        ((55, 57, 59, 60), False),
        ((54, 55, 57, 59), True),  # of the last six three must show
    ],
)
def test_so_much_of_a_body_may_be_hidden(hidden, whole):
    follow = Follower(around())
    assert follow._whole(found_body(hidden), known(straight(), length=100.0)) == whole
    assert not follow._whole(found_body(hidden, tip=False), known(straight(), length=100.0))


@pytest.mark.parametrize(("length", "whole"), [(104.0, True), (106.0, False), (96.0, True), (94.0, False)])
def test_a_body_keeps_its_length_from_frame_to_frame(length, whole):
    follow = Follower(around())
    assert follow._whole(found_body(length=length), known(straight(), length=100.0)) == whole
    assert follow._whole(found_body(length=length), known(straight(), length=0.0))  # none was seen before


def test_what_is_known_follows_slowly_where_the_body_was_seen():
    follow = Follower(around())
    first = found_body(range(3))
    follow._learn(replace(first, half=np.arange(61.0), light=np.full(61, 0.9)))
    assert (follow.known.length, follow.known.step.any()) == (pytest.approx(100.0), False)
    np.testing.assert_allclose(follow.known.half, [31.5] * 3 + list(range(3, 61)))  # the median of those seen
    np.testing.assert_allclose(follow.known.light, 0.9)
    half = follow.known.half.copy()
    second = found_body(range(58, 61), length=110.0)
    follow._learn(replace(second, half=np.full(61, 10.0), light=np.full(61, 1.9)))
    seen = np.arange(61) < 58
    np.testing.assert_allclose(follow.known.half, np.where(seen, 0.8 * half + 0.2 * 10.0, half))
    np.testing.assert_allclose(follow.known.light, np.where(seen, 1.1, 0.9))
    np.testing.assert_allclose(follow.known.step[:, 0], np.linspace(0, 10, 61))
    assert follow.known.length == pytest.approx(110.0)


def test_the_ends_are_smoothed_by_their_neighbours_and_a_known_base_holds():
    wild = np.random.default_rng(3).normal(size=(61, 2))
    free = np.ones(61)
    free[[0, -1]], free[-2] = 0.0, 0.5
    np.testing.assert_allclose(Follower(around())._smooth(wild, np.ones(61)), BASIS.smooth(wild, free))
    held, base = free.copy(), np.array([3.0, -4.0])
    held[0] = 50.0
    moved = wild.copy()
    moved[0] = base
    np.testing.assert_allclose(Follower(around(), base)._smooth(wild, np.ones(61)), BASIS.smooth(moved, held))
    for count, smoothed in ((18, False), (19, True)):  # as many as the spline has numbers
        weight = np.zeros(61)
        weight[3 * np.arange(count) + 1] = 1.0
        assert (Follower(around())._smooth(wild, weight) is not wild) == smoothed


@pytest.mark.parametrize("scale", [1, 2])
@pytest.mark.parametrize("known_base", [True, False])
def test_a_body_is_found_afresh_from_a_small_picture(scale, known_base):
    """To a fifth of a pixel across, and its square ends to one, of a picture made smaller."""
    s = np.linspace(0, 1, 80)
    line = np.stack([70 + 170 * s, 130 - 60 * s**2], axis=1)
    truth = line[[0, -1]]
    always = np.zeros((240 // scale, 320 // scale), bool)
    always[int(125 / scale) : int(136 / scale), int(72 / scale) : int(84 / scale)] = True
    follow = Follower(around(scale, always), truth[0] if known_base else None)
    found = follow(ribbon(line))
    fine = np.stack([np.interp(np.linspace(0, 1, 4001), s, line[:, k]) for k in (0, 1)], axis=1)
    off = np.linalg.norm(found.line[:, None] - fine, axis=2).min(axis=1)
    assert off[2:-2].max() < 0.2
    np.testing.assert_allclose(found.line[[0, -1]], truth, atol=1.0)
    assert np.abs(found.half[4:-4] - 8.0).max() < 0.15
    assert found.tip


def test_shares_are_cut_and_look_alikes_say_nothing():
    behind = np.zeros((1, 4))
    np.testing.assert_allclose(share(np.array([[0.1, 0.21, 5.0, -5.0]]), behind, np.array([0.21])),
                               [[0.1 / 0.21, 1.0, 1.4, -0.2]])  # fmt: skip
    np.testing.assert_allclose(share(np.full((1, 4), 0.1), behind, np.array([-0.25])), -0.2)
    np.testing.assert_allclose(share(np.full((1, 4), 0.1), behind, np.array([0.19])), 0.0)


def test_the_slope_of_an_edge_is_taken_over_five_columns():
    ramp = 1.0 - 0.04 * np.arange(26.0)  # one half at 12.5
    at, slope = crossing(ramp[None], np.array([3]))
    assert (at[0], slope[0]) == (pytest.approx(12.5), pytest.approx(0.04))
    short = np.array([0.9, 0.8, 0.3, 0.25, 0.1])  # at the profile's ends so many columns as there are
    at, slope = crossing(short[None], np.array([0]))
    assert (at[0], slope[0]) == (pytest.approx(1.6), pytest.approx((0.9 - 0.1) / 5))
    at, slope = crossing(np.array([[0.9, 0.7, 0.2]]), np.array([1]))
    assert (at[0], slope[0]) == (pytest.approx(1.4), pytest.approx((0.9 - 0.2) / 5))
    at, slope = crossing(np.array([[0.9, 0.4, 0.4, 0.3, 0.3, 0.2]]), np.array([0]))
    assert (at[0], slope[0]) == (pytest.approx(0.8), pytest.approx((0.9 - 0.3) / 5))
    left, right, _ = edges(np.array([[0.0, 0.25, 0.75, 1.0, 1.0, 0.8, 0.3, 0.1]]), 3)
    assert (left[0], right[0]) == (pytest.approx(1.5), pytest.approx(5.6))


def test_the_spline_along_the_body_has_sixteen_spans_and_the_stated_roughness():
    """That of s^3, whose third derivative is 6 everywhere; the last two spans weigh five times as much."""
    basis = Basis(61)
    assert basis.matrix.shape == (61, 19)
    s = np.linspace(0, 1, 61)
    cubic = np.linalg.lstsq(basis.matrix, s**3, rcond=None)[0]
    np.testing.assert_allclose(basis.matrix @ cubic, s**3, atol=1e-12)
    assert cubic @ basis.rough @ cubic == pytest.approx(5e-11 * 61 * 36.0 * (14 + 2 * 5) / 16, rel=1e-6)
    late = np.linalg.lstsq(basis.matrix, np.maximum(s - 0.875, 0.0) ** 3, rcond=None)[0]
    assert late @ basis.rough @ late == pytest.approx(5e-11 * 61 * 36.0 * 2 * 5 / 16, rel=1e-6)
    earlier = np.linalg.lstsq(basis.matrix, np.maximum(s - 0.8125, 0.0) ** 3, rcond=None)[0]
    assert earlier @ basis.rough @ earlier == pytest.approx(5e-11 * 61 * 36.0 * (1 + 2 * 5) / 16, rel=1e-6)


def test_distances_within_a_mask_are_those_of_a_king_on_a_chess_board():
    mask = np.ones((7, 9), bool)
    place = np.argwhere(mask)[:, ::-1].astype(float)
    apart = np.abs(place - [2.0, 5.0])
    octile = apart.max(axis=1) + (np.sqrt(2) - 1) * apart.min(axis=1)
    np.testing.assert_allclose(_distances(mask, place, np.array([2.2, 4.9])), octile)
    hook = np.zeros((5, 5), bool)
    hook[0], hook[:, 4], hook[4] = True, True, True  # around a corner, and a part that hangs apart
    hook[2, 0] = True
    place = np.argwhere(hook)[:, ::-1].astype(float)
    found = {tuple(p): d for p, d in zip(place.astype(int).tolist(), _distances(hook, place, np.zeros(2)), strict=True)}
    assert found[0, 0] == 0.0
    assert found[4, 2] == pytest.approx(3 + np.sqrt(2) + 1)  # the corner is cut
    assert found[0, 4] == pytest.approx(6 + 2 * np.sqrt(2) + 2)
    assert np.isinf(found[0, 2])


def test_a_rough_line_needs_forty_pixels_and_begins_at_an_end():
    for length, there in ((39, False), (40, True)):
        mask = np.zeros((5, 60), bool)
        mask[2, 5 : 5 + length] = True
        assert (rough_line(mask, None) is not None) == there
    mask = np.zeros((40, 60), bool)
    mask[10:13, 5:53] = True
    line = rough_line(mask, np.array([5.0, 11.0]))
    assert len(line) == 24
    np.testing.assert_allclose(line[:, 1], 11.0, atol=0.4)
    np.testing.assert_allclose(line[:, 0], 5.5 + 2 * np.arange(24), atol=0.6)
    again = rough_line(mask, None)
    np.testing.assert_allclose(again[::-1] if again[0, 0] > 30 else again, line, atol=1.0)


def test_a_mask_is_what_is_more_than_half_body_within_reach():
    place = around()
    picture = np.full((240, 320, 3), 200, np.uint8)
    picture[50:90, 50:150] = 115  # a little more than half of the way to the body
    picture[150:160, 50:150] = 125  # a little less
    assert np.argwhere(mask_of(picture, place)).min(axis=0).tolist() == [50, 50]
    assert np.argwhere(mask_of(picture, place)).max(axis=0).tolist() == [89, 149]
    picture[70, 100] = 200  # one pixel is closed
    assert mask_of(picture, place)[70, 100]
    place.reach = np.ones((240, 320), bool)
    place.reach[:, :100] = False
    assert np.argwhere(mask_of(picture, place)).min(axis=0).tolist() == [50, 100]
    place.body = place.light + 0.1  # too little contrast is taken for 0.3: no noise becomes a body
    faint = np.full((240, 320, 3), 200, np.uint8)
    faint[50:90, 150:250] = 200 - 22
    assert not mask_of(faint, place).any()
    faint[50:90, 150:250] = 200 - 30
    assert mask_of(faint, place)[60, 200]


@pytest.mark.parametrize(("moved", "refused"), [(2, False), (3, True)])
def test_a_camera_may_tremble_in_two_frames_of_a_hundred(moved, refused):
    watch = Stillness.__new__(Stillness)
    watch.reel, watch.shifts = Reel(Path("f.mp4"), 320, 240, 30.0, 100), [1.6] * moved + [1.45] * (100 - moved)
    if not refused:
        watch.refuse()
        return
    with pytest.raises(InputError, match=r"f\.mp4: the camera moves by 1\.6 pixels or more in 3 of 100 frames"):
        watch.refuse()
    watch.shifts = []
    watch.refuse()


@pytest.mark.parametrize("shift", [(0.6, 0.0), (0.0, -0.8), (0.5, 0.5)])
def test_the_shift_of_a_picture_is_measured_in_both_directions(shift):
    rng = np.random.default_rng(7)
    board = cv2.GaussianBlur(rng.integers(0, 255, (240, 320, 3)).astype(np.uint8), (0, 0), 5.0)
    board = cv2.normalize(board, None, 0, 255, cv2.NORM_MINMAX)
    reach = np.zeros((120, 160), bool)
    reach[:60] = True  # the body may be in the upper half: nothing is looked at there
    place = SimpleNamespace(background=board, reach=reach)
    watch = Stillness(place, Reel(Path("f.mp4"), 320, 240, 30.0, 100))
    assert 8 <= len(watch.patches) <= 12
    for (rows, columns), patch, _ in watch.patches:
        assert patch.shape == (25, 25)
        assert rows.start + 12 >= 120
        assert rows.stop <= 240 - 11
        assert columns.start >= 12
        assert columns.stop <= 320 - 11
    moved = cv2.warpAffine(board, np.float32([[1, 0, shift[0]], [0, 1, shift[1]]]), (320, 240),
                           borderMode=cv2.BORDER_REPLICATE)  # fmt: skip
    moved[:100] = 0  # whatever happens there
    watch(moved)
    assert watch.shifts[0] == pytest.approx(np.hypot(*shift), rel=0.1)


@dataclass(frozen=True)
class Shown(Reel):
    """A film of given pictures."""

    pictures_shown: tuple = ()

    def pictures(self, count):
        assert count == 32
        return iter(self.pictures_shown)

    def frames(self):
        yield from enumerate(self.pictures_shown)


@pytest.mark.parametrize(
    ("gains", "told"),
    [
        ((1.0, 1.0, 0.985, 1.015, 1.0), None),
        ((1.0, 1.028, 1.0, 1.0, 1.0), "3 %"),
        ((1.0, 0.74, 1.0, 1.1, 1.0), "26 %"),
    ],
)
def test_a_change_of_brightness_beyond_a_fiftieth_is_told(gains, told):
    rng = np.random.default_rng(6)
    usual = rng.uniform(60, 180, (48, 320, 3))
    usual[1::2], usual[:, 1::2] = 5.0, 250.0  # between the points that are compared
    reel, said = even_exposure(Shown(Path("f.mp4"), 320, 48, 25.0, 5, None, tuple(usual * g for g in gains)))
    assert (reel.reference is None) == (told is None)
    assert said == (
        [] if told is None else [f"brightness changes by up to {told} and was compensated: lock the camera's exposure"]
    )
    if told:
        np.testing.assert_allclose(reel.reference, usual[::2, ::2], rtol=1e-5)


@pytest.mark.parametrize(("count", "gain"), [(200, 1.0), (201, 1.2)])
def test_brightness_is_compared_where_two_hundred_points_show_it(count, gain):
    usual = np.full((20, 20, 3), 20.0)  # too dark
    usual.reshape(-1, 3)[:count] = 100.0
    reel = Reel(Path("f.mp4"), 20, 20, 25.0, 20, usual)
    np.testing.assert_allclose(reel.gain(1.2 * usual), gain)
    np.testing.assert_allclose(Reel(Path("f.mp4"), 20, 20, 25.0, 20).gain(usual), np.ones(3))


@pytest.mark.parametrize(
    ("reference", "part", "compared"),
    [
        (31.0, 45.0, True),
        (29.0, 40.0, False),
        (214.0, 230.0, True),
        (216.0, 230.0, False),
        (100.0, 16.0, True),
        (100.0, 14.0, False),
        (200.0, 249.0, True),
        (200.0, 251.0, False),
        (30.0, 45.0, False),  # at the limits themselves
        (215.0, 230.0, False),
        (100.0, 15.0, False),
        (200.0, 250.0, False),
    ],
)
def test_what_is_dark_or_saturated_says_nothing_of_brightness(reference, part, compared):
    reel = Reel(Path("f.mp4"), 20, 20, 25.0, 20, np.full((20, 20, 3), reference))
    np.testing.assert_allclose(reel.gain(np.full((20, 20, 3), part)), part / reference if compared else 1.0)


def test_a_picture_is_evened_level_by_level():
    reference = np.full((20, 20, 3), 100.0)
    picture = np.full((20, 20, 3), 125, np.uint8)
    picture[::2] = 50  # less than half of the points
    picture[:1, :11] = 125
    picture[:2, :2, 0] = 200
    made = Reel(Path("f.mp4"), 20, 20, 25.0, 20, reference).even(picture)
    assert set(np.unique(made).tolist()) == {40, 100, 160}
    assert Reel(Path("f.mp4"), 480, 20, 25.0, 20).coarse == 3
    assert Reel(Path("f.mp4"), 479, 20, 25.0, 20).coarse == 2
    assert Reel(Path("f.mp4"), 80, 20, 25.0, 20).coarse == 1


@pytest.mark.parametrize(("frames", "said"), [(7, r"f\.mp4 has 7 frames, but tracking needs 8 or more"), (8, None)])
def test_a_film_has_eight_frames_at_least(tmp_path, frames, said):
    from pliant.video.overlay import movie

    with movie(tmp_path / "f.mp4", 25.0, (64, 48)) as write:
        for k in range(frames):
            write(np.full((48, 64, 3), 20 * k, np.uint8))
    if said is None:
        assert open_reel(tmp_path / "f.mp4").count == 8
        assert open_reel(tmp_path / "f.mp4").sampled(40, 32).shape == (8, 24, 32, 3)
        return
    with pytest.raises(InputError, match=said):
        open_reel(tmp_path / "f.mp4")
    with pytest.raises(InputError, match="this is a folder, not a file"):
        open_reel(tmp_path)
    with pytest.raises(InputError, match="there is no such file"):
        open_reel(tmp_path / "no.mp4")


def test_the_base_is_the_median_of_the_first_ten_frames_that_show_it(monkeypatch):
    """Looked for in 120 frames."""
    taken = []

    class Every:
        def __init__(self, _around):
            pass

        def __call__(self, picture):
            taken.append(picture)
            return None if picture % 3 else SimpleNamespace(line=np.array([[picture, 2.0 * picture], [0.0, 0.0]]))

    monkeypatch.setattr(silhouette, "Follower", Every)
    reel = Shown(Path("f.mp4"), 320, 48, 25.0, 500, None, tuple(range(500)))
    np.testing.assert_allclose(silhouette.base_of(reel, None), [13.5, 27.0])
    assert taken == list(range(28))
    taken.clear()
    monkeypatch.setattr(Every, "__call__", lambda _, picture: taken.append(picture))
    with pytest.raises(InputError, match="no whole body was found in the first 120 frames"):
        silhouette.base_of(reel, None)
    assert len(taken) == 120


@pytest.mark.parametrize("base", [None, (60.0, 120.0)])
def test_both_ends_are_sought_twice_and_the_tip_once_more(base):
    """A stated base is never sought."""
    follow, sought = Follower(around(), None if base is None else np.array(base)), []

    def ended(picture, line, state, *, at_tip):
        sought.append((float(line[0, 0]), float(line[-1, 0]), at_tip))
        return line, True

    follow._ended, follow._centred = ended, lambda picture, line, state: line
    follow._measured = lambda picture, line, state: replace(found_body(), line=line)
    found = follow._refined(None, straight(), known(straight()))
    assert found.line[[0, -1], 0].tolist() == [60.0, 240.0]
    tip, start = (60.0, 240.0, True), (240.0, 60.0, False)
    assert sought == ([tip, start, tip, start, tip] if base is None else [tip, tip, tip])


@pytest.mark.parametrize(("points", "tried"), [(3, False), (4, True)])
@pytest.mark.parametrize("base", [None, (60.0, 120.0)])
def test_a_body_is_sought_afresh_from_its_base_along_four_points_at_least(monkeypatch, points, tried, base):
    starts, refined = [], []

    def rough(mask, start):
        starts.append(start)
        return np.stack([np.linspace(10.0, 40.0, points), np.full(points, 30.0)], axis=1)

    monkeypatch.setattr("pliant.video.follow.rough_line", rough)
    follow = Follower(around(2, np.zeros((120, 160), bool)), None if base is None else np.array(base))
    follow._begin = lambda mask: np.array([7.0, 8.0])
    follow._refined = lambda picture, line, state: refined.append((line, state))
    follow._afresh(ribbon(straight()))
    assert starts[0].tolist() == ([7.0, 8.0] if base is None else [30.0, 60.0])
    assert bool(refined) == tried
    if tried:
        line, state = refined[0]
        np.testing.assert_allclose(line[[0, -1]], [[20.0, 60.0], [80.0, 60.0]])
        assert (state.length, state.step.any(), len(state.half)) == (0.0, False, 61)
        assert state.half[0] == pytest.approx(0.5 * 180 * 16 / 60, rel=0.05)  # the area of the body over this length
        np.testing.assert_allclose(state.light, follow.around.body)
        follow.known = known(straight(), 9.0)
        follow._afresh(ribbon(straight()))
        assert refined[1][1].half[0] == 9.0
        np.testing.assert_allclose(refined[1][1].line, line)


@pytest.mark.parametrize("up", [True, False])
def test_the_base_of_an_upright_body_is_the_end_nearest_to_what_never_moves(up):
    mask, always = np.zeros((240, 320), bool), NONE.copy()
    mask[60:200, 100:110] = True
    always[slice(60, 70) if up else slice(190, 200), 100:110] = True
    always[10 if not up else 230, 300] = True  # a speck far from both
    found = Follower(around(always=always))._begin(mask)
    assert found == pytest.approx((104.5, 62.5 if up else 196.5), abs=3.5)


def test_a_body_is_sought_where_its_last_step_leads():
    """In steps of 18 pixels, more than its width; nothing but the line and the step of before is known."""
    follow = Follower(around(), np.array([60.0, 100.0]))
    for y in (100.0, 118.0):
        follow.base = np.array([60.0, y])
        assert follow(ribbon(straight(y=y))) is not None
    follow._afresh = lambda picture: None
    follow.base = np.array([60.0, 136.0])
    found = follow(ribbon(straight(y=136.0)))
    assert np.abs(found.line[3:-3, 1] - 136.0).max() < 0.1
    np.testing.assert_allclose(follow.known.step[3:-3, 1], 18.0, atol=0.2)
    follow.base = np.array([60.0, 208.0])
    assert follow(ribbon(straight(y=208.0))) is None  # too far from there
    assert not follow.known.step.any()
