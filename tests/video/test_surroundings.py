"""What is body and what is not, on stacks of small pictures whose answer is known in closed form."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.video.reel import Reel
from pliant.video.surroundings import (
    _always,
    _background,
    _binned,
    _blurred,
    _large_background,
    commonest,
    discriminant,
    moving_pixels,
    refuse_moving_camera,
    surroundings,
)

cv2 = pytest.importorskip("cv2")
REEL = Reel(Path("f.mp4"), 200, 200, 30.0, 9)


def pictures(rows, columns, change, *, count=9, channel=slice(None), size=200):
    """Even pictures, and one in which a block of one channel or of all is brighter; and the picture in the middle."""
    stack = np.full((count, size, size, 3), 100, np.uint8)
    middle = stack[0].copy()
    stack[4, 50 : 50 + rows, 60 : 60 + columns, channel] += np.uint8(change)
    return stack, middle


@pytest.mark.parametrize(
    ("change", "channel", "seen"),
    [
        (15, slice(None), True),
        (15, 1, True),
        (13, slice(None), False),
        (14, slice(None), False),
    ],
)
def test_a_pixel_moves_where_it_changes_by_more_than_fourteen_levels(change, channel, seen):
    stack, middle = pictures(20, 30, change, channel=channel)
    if not seen:
        with pytest.raises(InputError, match=r"f\.mp4: no motion .*: 0 % of .* by more than 14 of 255"):
            moving_pixels(stack, middle, REEL)
        return
    moving, noise = moving_pixels(stack, middle, REEL)
    assert np.argwhere(moving).min(axis=0).tolist() == [50, 60]
    assert np.argwhere(moving).max(axis=0).tolist() == [69, 89]
    assert (moving.sum(), noise) == (600, 0.5)


@pytest.mark.parametrize(("change", "seen"), [(45, False), (50, True)])
def test_a_pixel_moves_where_it_changes_by_more_than_eight_times_the_noise(change, seen):
    stack, middle = pictures(20, 30, change)
    stack[:4, ::4, ::4] += np.uint8(4)  # the noise is that of a coarse grid
    stack[4:, ::4, ::4] -= np.uint8(4)
    if not seen:
        with pytest.raises(InputError, match="by more than 47 of 255 levels"):
            moving_pixels(stack, middle, REEL)
        return
    assert moving_pixels(stack, middle, REEL)[1] == pytest.approx(1.4826 * 4)


@pytest.mark.parametrize(("rows", "columns", "seen"), [(4, 4, True), (3, 5, False), (2, 30, False), (3, 6, True)])
def test_what_moves_covers_an_area_and_is_no_thin_line(rows, columns, seen):
    """Four parts in ten thousand, 16 of these 40000 pixels, and three pixels across."""
    stack, middle = pictures(rows, columns, 60)
    if seen:
        assert moving_pixels(stack, middle, REEL)[0].sum() == rows * columns
        return
    with pytest.raises(InputError, match="no motion found"):
        moving_pixels(stack, middle, REEL)


def test_the_share_of_the_picture_that_moves_is_told():
    stack, middle = pictures(3, 5, 60)
    with pytest.raises(InputError, match=r": 0\.037 % of the picture"):  # 15 of 40000 pixels
        moving_pixels(stack, middle, REEL)


def test_colours_are_counted_in_sixteen_steps():
    colours = np.array([[0, 0, 0], [255, 255, 255], [16, 0, 0], [0, 16, 0], [0, 0, 16], [15, 15, 15], [33, 50, 70]])
    assert _binned(colours.astype(np.uint8)).tolist() == [0, 4095, 256, 16, 1, 0, 2 * 256 + 3 * 16 + 4]
    one = np.zeros(4096)
    one[8 * 256 + 8 * 16 + 8] = 1.0
    blurred = _blurred(one).reshape(16, 16, 16)
    assert blurred.sum() == pytest.approx(1.0)
    assert blurred[9, 8, 8] / blurred[8, 8, 8] == pytest.approx(np.exp(-0.5 / 0.8**2))


def crossing(count=32, colour=(60, 50, 40), behind=(180, 190, 200), hand=()):
    """A block that crosses the picture, (count, 60, 100, 3); a hand of another colour in some frames."""
    stack = np.empty((count, 60, 100, 3), np.uint8)
    stack[:] = np.array(behind, np.uint8)
    moving = np.zeros((60, 100), bool)
    moving[20:40, 10:90] = True
    for k in range(count):
        left = 10 + 70 * k // count
        stack[k, 20:40, left : left + 10] = colour
        if k in hand:
            stack[k, 20:40, 10:90] = (90, 120, 220)
    return stack, moving


@pytest.mark.parametrize("colour", [(60, 50, 40), (200, 120, 30), (250, 250, 250), (0, 0, 0)])
def test_the_commonest_new_colour_is_the_bodys(colour):
    stack, moving = crossing(colour=colour)
    np.testing.assert_allclose(commonest(stack, moving), colour, atol=1e-3)


def test_a_hand_that_passes_and_what_is_all_around_are_no_body():
    stack, moving = crossing(hand=range(10, 15))
    np.testing.assert_allclose(commonest(stack, moving), (60, 50, 40), atol=1e-3)
    striped, moving = crossing()
    striped[:, 20:40, 10:90:2][(striped[:, 20:40, 10:90:2] == (180, 190, 200)).all(-1)] = (90, 210, 20)
    striped[:, :20, ::2] = (90, 210, 20)  # the background has two colours, around as well as behind
    striped[:, 40:, ::2] = (90, 210, 20)
    np.testing.assert_allclose(commonest(striped, moving), (60, 50, 40), atol=1e-3)
    whole, _ = crossing()
    assert np.isfinite(commonest(whole, np.ones((60, 100), bool))).all()  # nothing beside it


def test_the_colour_of_the_body_is_the_mean_of_what_is_near_it():
    stack, moving = crossing(colour=(60, 60, 60))
    half = stack[:, 20:30]
    half[(half == 60).all(-1)] = (70, 60, 60)
    np.testing.assert_allclose(commonest(stack, moving), (65, 60, 60), atol=1e-3)


def flat(level, body=(0.0, 0.0, 0.0), size=40):
    middle = np.full((size, size, 3), level, np.uint8)
    moving = np.zeros((size, size), bool)
    moving[10:30, 10:30] = True
    return middle, moving, np.array(body, np.float32)


@pytest.mark.parametrize(("noise", "said"), [
    (16.0, None), (17.0, "differ by only 5.9 times the noise, but 6 are needed:"),
])
def test_a_body_differs_from_its_background_by_six_times_the_noise(noise, said):
    """A black body before grey of level 100: the contrast is the root of three times that over the noise."""
    middle, moving, body = flat(58)
    if said:
        with pytest.raises(InputError, match=said):
            discriminant(middle, moving, body, noise, REEL)
        return
    weight = discriminant(middle, moving, body, noise, REEL)
    np.testing.assert_allclose(weight, -1 / (3 * 58), rtol=1e-5)


@pytest.mark.parametrize(("noise", "size"), [(0.5, 12.0), (20.0, 20.0)])
def test_weights_are_those_of_fishers_discriminant(noise, size):
    """Beside the colours' scatter, of which a flat background has none, a fiftieth of the body's and a codec's."""
    body = np.array([200.0, 40.0, 90.0], np.float32)
    middle, moving, _ = flat(30)
    away = body.astype(float) - 30.0
    along = away - 0.02 * body * (body @ away) / (size**2 + 0.02 * body.astype(float) @ body)  # Sherman and Morrison
    np.testing.assert_allclose(discriminant(middle, moving, body, noise, REEL), along / (along @ away), rtol=1e-4)


def test_what_looks_like_the_body_is_no_background():
    """Only what is beside the moving part counts, and of that what differs by 35 levels, or by 12 where that is all."""
    middle, moving, body = flat(100)
    middle[:3] = 250  # far from what moves
    middle[12:28, 12:28] = 15  # 26 levels from the body
    np.testing.assert_allclose(discriminant(middle, moving, body, 1.0, REEL), -1 / 300, rtol=1e-5)
    middle[3:] = 15
    middle[10:12, 10:24] = 100  # too few of them
    middle[12, 10] = 100
    weight = discriminant(middle, moving, body, 1.0, REEL)
    count, whole = 29, 34 * 34
    mean = (15 * (whole - count) + 100 * count) / whole
    np.testing.assert_allclose(weight, -1 / (3 * mean), rtol=1e-3)
    nearer = middle.copy()
    nearer[nearer == 15] = 8  # 13.9 levels from the body: still a background
    nearer[14:20, 14:20] = 0  # and this is the body
    mean = (8 * (whole - count - 36) + 100 * count) / (whole - 36)
    np.testing.assert_allclose(discriminant(nearer, moving, body, 1.0, REEL), -1 / (3 * mean), rtol=1e-3)
    middle[12, 11:13] = 100
    np.testing.assert_allclose(discriminant(middle, moving, body, 1.0, REEL), -1 / 300, rtol=1e-5)


def test_the_background_is_what_a_pixel_shows_without_the_body():
    ground = np.broadcast_to((150 + np.arange(100) // 2)[:, None], (60, 100, 3)).astype(np.uint8)
    stack, moving = np.repeat(ground[None], 32, axis=0), np.zeros((60, 100), bool)
    moving[20:40, 10:90] = True
    for k in range(32):
        stack[k, 25:35, 4 : 20 + 2 * k + 4 * (k > 0)] = 20  # its base never moves
    stack[5, 22, 60] = 255  # something else, once
    weight = np.full(3, -1.0 / (3 * 160), np.float32)
    middle = np.median(stack, axis=0).astype(np.uint8)
    behind, always = _background(stack, middle, np.full(3, 20.0, np.float32), weight, moving)
    assert np.argwhere(always).min(axis=0).tolist() == [25, 4]
    assert np.argwhere(always).max(axis=0).tolist() == [34, 19]
    free = moving.copy()
    free[20:40, :22] = False
    np.testing.assert_allclose(behind[free], ground[free], atol=0.01)
    np.testing.assert_allclose(behind[~moving & (np.arange(100) > 24)], ground[~moving & (np.arange(100) > 24)])
    filled = np.zeros_like(always)
    filled[23:37, 2:22] = True  # two pixels beyond it: filled in from beside
    assert np.abs(behind[filled] - ground[filled].astype(float)).max() < 12
    near = np.zeros_like(always)
    near[22:38, 1:23] = True
    beside = near & ~filled & ~moving
    np.testing.assert_array_equal(behind[beside], middle[beside])


@pytest.mark.parametrize(("changed", "counts"), [(0.30, True), (0.40, False)])
def test_the_background_is_the_mean_of_what_is_alike(changed, counts):
    """Frames that differ from the usual one by less than a third of the contrast; the body is another four tenths."""
    stack = np.full((9, 20, 20, 3), 200, np.uint8)
    stack[:3, 5:15, 5:15] = round(200 + 160 * changed) if changed < 0.34 else 200 + 55
    stack[8, 5:15, 5:15] = 40
    moving = np.zeros((20, 20), bool)
    moving[5:15, 5:15] = True
    weight = np.full(3, -1.0 / (3 * (160 if counts else 140)), np.float32)
    behind, always = _background(stack, stack[5], np.full(3, 40.0, np.float32), weight, moving)
    other = float(stack[0, 10, 10, 0])
    np.testing.assert_allclose(behind[10, 10], (3 * other + 5 * 200) / 8 if counts else 200.0, rtol=1e-5)
    assert not always.any()


@pytest.mark.parametrize(("frames", "kept"), [(7, False), (8, True)])
def test_what_is_always_bodily_belongs_to_the_body_that_touches_it(frames, kept):
    """In more than seven tenths of the frames; holes in it are filled."""
    bodily = np.zeros((10, 40, 60), bool)
    bodily[:, 10:15, 5:12] = True
    bodily[:, 12, 8] = False
    bodily[:, 30:36, 40:50] = True  # looks alike, and lies apart
    moving = np.zeros((40, 60), bool)
    moving[8:20, 12:30] = True
    for k in range(10):
        first = 12 if k < frames else 14
        bodily[k, 12:14, first : 20 + k % 3] = True
    found = _always(bodily, moving)
    assert found[10:15, 5:12].all() == kept
    assert found[12, 8] == kept
    assert not found[30:36, 40:50].any()
    assert not found[8:10].any()


@dataclass(frozen=True)
class Shown(Reel):
    """A film of given pictures."""

    shown: tuple = ()

    def pictures(self, count):
        assert count == 32
        return iter(self.shown)


def test_the_large_background_is_the_mean_of_what_shows_no_body():
    """In the box of what the body may reach; elsewhere it is the first picture."""
    rng = np.random.default_rng(4)
    ground = np.full((80, 120, 3), 180, np.uint8)
    shots = [np.clip(ground + rng.normal(0, 2, ground.shape), 0, 255).astype(np.uint8) for _ in range(8)]
    for k, shot in enumerate(shots):
        shot[30:40, 20 + 8 * k : 28 + 8 * k] = 40
    shots[3][50, 60] = 255  # half of the contrast away
    for k, shot in enumerate(shots):
        shot[55, 70] = 174 if k == 2 else 40  # the background shows once
    small = np.full((40, 60, 3), 180.0, np.float32)
    reach = np.zeros((40, 60), bool)
    reach[10:30, 5:50] = True
    weight = np.full(3, -1.0 / (3 * 140), np.float32)
    made = _large_background(Shown(Path("f.mp4"), 120, 80, 30.0, 8, None, tuple(shots)), small, weight, reach)
    assert made.dtype == np.uint8
    mean, seen = np.zeros(ground.shape), np.zeros(ground.shape[:2])
    for shot in shots:
        near = np.abs(shot.astype(float).mean(axis=2) - 180) < 49
        mean[near] += shot[near]
        seen += near
    inside = np.zeros(ground.shape[:2], bool)
    inside[20:61, 10:101] = True  # with one row and one column more
    np.testing.assert_allclose(made[inside], (mean / seen[..., None])[inside], atol=0.51)
    np.testing.assert_array_equal(made[~inside], shots[0][~inside])
    body = small.copy()
    body[:] = 40.0  # nothing is alike: the guess stays
    film = Shown(Path("f.mp4"), 120, 80, 30.0, 8, None, (shots[0], ground))
    np.testing.assert_array_equal(_large_background(film, body, weight, reach)[50, 50], [40, 40, 40])


@pytest.mark.parametrize(("shift", "refused"), [(1.3, False), (1.8, True)])
@pytest.mark.parametrize("scale", [1, 2])
def test_a_camera_moves_where_most_corners_do(shift, refused, scale):
    """By more than one and a half pixels of the film, in half of the frames."""
    rng = np.random.default_rng(2)
    board = np.kron(rng.integers(0, 255, (12, 16, 1)), np.ones((14, 14, 3))).astype(np.uint8)
    board = cv2.GaussianBlur(board, (0, 0), 1.2)
    moved = cv2.warpAffine(board, np.float32([[1, 0, shift / scale], [0, 1, 0]]), (224, 168),
                           borderMode=cv2.BORDER_REPLICATE)  # fmt: skip
    far = cv2.warpAffine(board, np.float32([[1, 0, 4.0 / scale], [0, 1, 0]]), (224, 168),
                         borderMode=cv2.BORDER_REPLICATE)  # fmt: skip
    reel = Reel(Path("f.mp4"), 224 * scale, 168 * scale, 30.0, 9)
    stack = np.array([board, moved, moved, moved, moved, board, far])
    if refused:
        with pytest.raises(InputError, match=r"f\.mp4: the camera moves by up to 4 pixels: fix it"):
            refuse_moving_camera(stack, reel)
    else:
        refuse_moving_camera(stack, reel)
    refuse_moving_camera(np.array([board, far, far, board, board, board]), reel)  # in less than half of the frames
    body = stack.copy()
    body[1:] = board
    body[1:, :80, :100] = 90  # some corners are hidden, or go with the body
    refuse_moving_camera(body, reel)
    refuse_moving_camera(np.full((4, 60, 80, 3), 90, np.uint8), reel)  # nothing to hold on to


@dataclass(frozen=True)
class Sliding(Reel):
    """A dark bar that slides over even ground above a scale, and waits in the middle for 13 of 32 frames."""

    def film(self):
        places = [*range(20, 56, 4), *[60] * 13, *range(64, 104, 4)]
        made = np.full((len(places), 120, 160, 3), 200, np.uint8)
        made[:, 96:116] = np.kron(np.resize([150, 230, 190, 120, 250], (2, 16)), np.ones((10, 10)))[..., None]
        for picture, x in zip(made, places, strict=True):
            picture[30:80, x : x + 12] = (60, 50, 40)
        return made

    def sampled(self, count, width):
        assert (count, width) == (32, 160)
        return self.film()

    def pictures(self, count):
        assert count == 32
        return iter(self.film())


def test_the_surroundings_of_a_sliding_bar():
    found = surroundings(Sliding(Path("f.mp4"), 160, 120, 30.0, 32))
    np.testing.assert_allclose(found.background[:90], 200, atol=1)  # behind the place where it waits, too
    np.testing.assert_allclose(found.small[:90], 200, atol=1)
    assert found.scale == 1.0
    assert found.body == pytest.approx(float(np.array([60.0, 50.0, 40.0]) @ found.weight), abs=0.05)
    assert found.body - 200 * float(found.weight.sum()) == pytest.approx(1.0, abs=0.02)
    assert not found.always.any()
    reach = np.zeros((120, 160), bool)
    reach[30 - 4 : 80 + 4, 20 - 4 : 112 + 4] = True  # four pixels about where it was seen
    np.testing.assert_array_equal(found.reach, reach)


def test_a_camera_that_moves_is_refused_before_a_body_is_looked_for():
    class Shaken(Sliding):
        def film(self):
            rng = np.random.default_rng(2)
            board = np.kron(rng.integers(0, 255, (12, 16, 1)), np.ones((10, 10, 3))).astype(np.uint8)
            board = cv2.GaussianBlur(board, (0, 0), 1.2)
            return np.array([np.roll(board, 3 * (k > 0), axis=1) for k in range(7)])

    with pytest.raises(InputError, match="the camera moves by up to 3 pixels"):
        surroundings(Shaken(Path("f.mp4"), 160, 120, 30.0, 7))
