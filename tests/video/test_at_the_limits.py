"""What counts at a limit itself: numbers that a computer holds exactly, so that equal is equal."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.recording import make_recording
from pliant.video import silhouette, track
from pliant.video.follow import mask_of, rough_line
from pliant.video.marks import ChainOfDots, _first_dots
from pliant.video.reel import Reel
from pliant.video.track import doubled_and_leaps, lost_in_times


@pytest.mark.parametrize(
    ("sizes", "at", "change", "found"),
    [
        ((2.0, 0.25, 2.0), 0.125, 1.0, (True, False)),
        ((0.75, 0.125, 2.0), 0.125, 1.0, (False, False)),  # the slower neighbour moves by just enough to tell rest
        ((2.0, 0.5, 2.0), 0.125, 1.0, (False, False)),  # a quarter of the neighbours' steps
        ((2.0, 0.25, 2.0), 0.5, 2.0, (False, False)),  # a quarter of the neighbours' changes
        ((2.0, 4.0, 2.0), 1.0, 1.0, (False, True)),
        ((2.0, 3.5, 2.0), 1.0, 1.0, (False, False)),  # seven quarters
        ((0.75, 1.5, 0.75), 1.0, 1.0, (False, False)),
        ((0.875, 1.75, 0.875), 1.0, 1.0, (False, True)),
    ],
)
def test_repeats_and_leaps_at_the_limits(monkeypatch, sizes, at, change, found):
    for name, value in {"MOVES": 0.75, "STANDS": 0.25, "LEAPS": 1.75, "ALIKE": 0.25}.items():
        monkeypatch.setattr(track, name, value)
    steps = np.full(9, sizes[0])
    steps[4], steps[5:] = sizes[1], sizes[2]
    changes = np.full(9, change)
    changes[4] = at
    points = np.stack([np.cumsum(steps), np.zeros(9)], axis=1)[:, None]
    doubled, leaps = doubled_and_leaps(points, changes, np.arange(9) / 32)
    assert (doubled[4], leaps[4]) == found
    two = np.concatenate([points, points + 8.0], axis=1)  # a second station tells the same
    two[2, 1] = np.nan
    doubled, leaps = doubled_and_leaps(two, changes, np.arange(9) / 32)
    assert (doubled[4], leaps[4]) == found


def test_a_step_to_the_side_keeps_no_direction_and_no_frame_is_lost_from_an_even_clock():
    place = np.array([[0.0, 0], [4, 0], [8, 0], [8, 0.25], [8, 4.0], [8, 8.0], [8, 12.0]])[:, None]
    doubled, _ = doubled_and_leaps(place, np.array([9.0, 9, 9, 0, 9, 9, 9]), np.arange(7) / 32)
    assert not doubled.any()
    assert lost_in_times(np.arange(7) / 32) == (0, 0)
    assert lost_in_times(np.array([0.0, 1, 2, 5, 6, 8, 9, 10, 11])) == (3, 2)


def dots(count=5):
    return np.stack([10.0 * np.arange(count), np.zeros(count)], axis=1)


@pytest.mark.parametrize(("mass", "alike"), [(18.0, False), (18.1, True), (47.9, True), (48.0, False)])
def test_a_mass_of_six_to_sixteen_tenths_is_a_dots(mass, alike):
    found = ChainOfDots(dots(), np.full(5, 30.0))(dots(), np.array([30.0, 30.0, mass, 30.0, 30.0]))
    assert np.isfinite(found[2]).all() == alike
    assert np.isfinite(np.delete(found, 2, axis=0)).all()


@pytest.mark.parametrize(("away", "found"), [(4.9, True), (5.0, False), (-4.9, True), (-5.0, False)])
def test_the_slowest_dot_is_sought_within_half_a_distance(away, found):
    chain = ChainOfDots(dots(), np.full(5, 30.0))
    centre = np.array([[0.0, away]])
    assert chain._nearest(0, centre, np.array([30.0])) == (0 if found else -1)
    assert chain._nearest(4, centre, np.array([30.0])) == -1
    chain.gap[0], chain.step[0] = 1.0, [3.0, 4.0]  # seen two frames ago, with a step of 5: 2 * (5 + 5) of reach
    assert chain._nearest(0, np.array([[3.0, 23.9]]), np.array([30.0])) == 0
    assert chain._nearest(0, np.array([[3.0, 24.0]]), np.array([30.0])) == -1


@pytest.mark.parametrize(
    ("at", "found"), [((7.5, 0.0), False), ((7.6, 0.0), True), ((11.9, 0.0), True), ((12.0, 0.0), False),
                      ((10 * np.cos(1.19), 10 * np.sin(1.19)), True), ((10 * np.cos(1.21), -10 * np.sin(1.21)), False)],
)  # fmt: skip
def test_the_next_dot_lies_at_its_distance_and_about_its_direction(at, found):
    chain = ChainOfDots(dots(2), np.full(2, 30.0))
    chosen = np.array([0, -1])
    chain._along(chosen, 0, 1, np.array([[0.0, 0.0], at]), np.full(2, 30.0))
    assert chosen.tolist() == [0, 1 if found else -1]


@pytest.mark.parametrize("turn", [0.0, 1.0, 2.0, 3.0, -3.0, -2.0, -1.0])
def test_a_chain_is_followed_in_every_direction(turn):
    """A body that points anywhere, and bends by half a radian from dot to dot; the straighter of two marks is taken."""
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    bent = np.concatenate([np.zeros((1, 2)), np.cumsum(
        [[10 * np.cos(a), 10 * np.sin(a)] for a in 0.5 * np.arange(4)], axis=0)])  # fmt: skip
    chain = ChainOfDots(dots() @ rotation.T, np.full(5, 30.0))
    order = np.array([3, 0, 4, 1, 2])
    chosen = np.full(5, -1)
    chosen[0] = int(np.flatnonzero(order == 0)[0])
    beside = bent[1] + np.array([[0.0, 2.0]])
    centres = np.concatenate([bent[order], beside]) @ rotation.T
    chain._along(chosen, 0, 1, centres, np.full(6, 30.0))
    assert order[chosen].tolist() == [0, 1, 2, 3, 4]
    back = np.full(5, -1)
    back[4] = int(np.flatnonzero(order == 4)[0])
    chain = ChainOfDots(bent @ rotation.T, np.full(5, 30.0))
    chain._along(back, 4, -1, centres, np.full(6, 30.0))
    assert order[back].tolist() == [0, 1, 2, 3, 4]


def test_the_longest_chain_of_all_starts_is_taken():
    """The two slowest dots are seen apart from the rest, of which three hang together."""
    chain = ChainOfDots(dots(6), np.full(6, 30.0))
    chain.travel = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0])
    seen = np.array([[0.0, 0.0], [10.0, 0.0]])
    found = chain._from_slowest(np.concatenate([seen, [[300.0, 300.0], [310.0, 300.0]]]), np.full(4, 30.0))
    assert found.tolist() == [0, 1, -1, -1, -1, -1]
    lost = np.concatenate([[[0.0, 3.0]], [[28.0, 4.0], [36.0, -2.0], [45.0, 0.5], [55.0, 0.5]]])
    found = chain._from_slowest(lost, np.full(5, 30.0))
    assert (found >= 0).sum() >= 4


@pytest.mark.parametrize(("size", "alike"), [(4.0, False), (4.1, True), (24.9, True), (25.0, False)])
def test_first_dots_are_alike_within_two_fifths_to_five_halves_of_their_median(size, alike):
    centres = np.array([[0.0, 0.0], [10.0, 0.0], [20.0, 0.0], [30.0, 0.0]])
    finder = SimpleNamespace(all=lambda picture, round_ones: (centres, np.array([10.0, 10.0, 10.0, size])))
    reel = SimpleNamespace(frames=lambda: iter([(0.0, None)]), path=Path("f.mp4"))
    found, masses, told = _first_dots(reel, finder, (0.0, 0.0, 255.0), None)
    assert len(found) == len(masses) == (4 if alike else 3)
    assert told == []


def test_a_film_of_one_row_is_made_small():
    reel = Reel(Path("f.mp4"), 640, 2, 30.0, 9)
    table = Reel(Path("f.mp4"), 320, 40, 30.0, 9, np.full((20, 160, 3), 100.0))
    picture = np.full((40, 320, 3), 125, np.uint8)
    picture[5, 7], picture[5, 9], picture[5, 11] = 255, 1, 0
    made = table.even(picture)
    assert (made[0, 0, 0], made[5, 7, 0], made[5, 9, 0], made[5, 11, 0]) == (100, 204, 1, 0)
    assert reel.coarse == 4


def test_every_frame_of_a_film_is_checked_for_a_moving_camera(monkeypatch):
    seen = []

    class Watch:
        def __init__(self, around, reel):
            assert (around, reel) == ("ground", film)

        def __call__(self, picture):
            seen.append(picture)

        def refuse(self):
            raise InputError(f"the camera moves in {len(seen)} frames")

    film = SimpleNamespace(frames=lambda: iter([(0.0, "a"), (0.5, "b")]))
    monkeypatch.setattr(silhouette, "surroundings", lambda reel: "ground")
    monkeypatch.setattr(silhouette, "Stillness", Watch)
    monkeypatch.setattr(silhouette, "Follower", lambda around, base: lambda picture: (
        None if picture == "b" else SimpleNamespace(line=base + 1.0)))  # fmt: skip
    frames = silhouette.follow_silhouette(film, (3.0, 4.0))
    time, picture, line = next(frames)
    assert (time, picture, line.tolist()) == (0.0, "a", [4.0, 5.0])
    assert next(frames) == (0.5, "b", None)
    with pytest.raises(InputError, match="moves in 2 frames"):
        next(frames)


@pytest.mark.parametrize("turned", [False, True])
def test_a_rough_line_goes_from_the_end_that_lies_farthest_and_leaves_no_gap(turned):
    """A hook: a long bar and a short one; where a level of the distance has no pixel there is no point."""
    mask = np.zeros((60, 80), bool)
    mask[5:8, 5:70] = True
    mask[8:30, 67:70] = True
    mask[50:52, 10:30] = not turned  # apart from it
    mask = mask[::-1, ::-1] if turned else mask
    line = rough_line(mask, None)
    ends = {tuple(np.round(line[k]).astype(int).tolist()) for k in (0, -1)}
    expected = {(6, 6), (68, 28)} if not turned else {(73, 53), (11, 31)}
    assert all(min(np.hypot(x - a, y - b) for a, b in expected) < 3.0 for x, y in ends)
    assert len(ends) == 2
    assert np.hypot(*np.diff(line, axis=0).T).max() < 5.0
    assert np.isfinite(line).all()
    assert line.min() > 4.0


def test_shares_take_the_background_for_what_it_is():
    """Neither lightness is zero: a body of 3 before a ground of 1."""
    place = SimpleNamespace(weight=np.full(3, 1 / 3, np.float32), small=np.full((40, 40, 3), 1.0, np.float32), body=3.0,
                            reach=np.ones((40, 40), bool), always=np.zeros((40, 40), bool))  # fmt: skip
    picture = np.ones((40, 40, 3), np.float32)
    picture[10:20, 10:30] = 2.25
    picture[25:35, 10:30] = 2.0
    assert np.argwhere(mask_of(picture, place)).min(axis=0).tolist() == [10, 10]
    assert np.argwhere(mask_of(picture, place)).max(axis=0).tolist() == [19, 29]


def test_a_film_is_followed_frame_by_frame_and_its_changes_are_noted(monkeypatch, tmp_path):
    """Mean change of every eighth pixel, in levels; the fraction that is done; what the follower tells."""
    taken, done, drawn = {}, [], []
    levels = [10, 14, 11, 250]
    pictures = [np.full((24, 40, 3), 99, np.uint8) for _ in levels]
    for picture, level in zip(pictures, levels, strict=True):
        picture[::8, ::8] = level
    lines = [np.array([[1.0, 2.0], [3.0, 4.0]]), None, np.array([[5.0, 6.0], [7.0, 8.0]]), None]
    frames = [(0.25 * k, picture, line) for k, (picture, line) in enumerate(zip(pictures, lines, strict=True))]

    @contextmanager
    def overlay(reel, paths):
        yield lambda time, picture, found: drawn.append((time, found))

    def recording(reel, camera, how, names, seen):
        taken.update(names=names, seen=seen)
        return make_recording([0.0, 1.0], np.zeros((2, 2, 3)))

    monkeypatch.setattr(track, "open_reel", lambda path: Reel(path, 40, 24, 4.0, 5))
    monkeypatch.setattr(track, "_followed", lambda reel, how: (["a", "b"], ["a line"], iter(frames)))
    monkeypatch.setattr(track, "overlay", overlay)
    monkeypatch.setattr(track, "_recording", recording)
    made = track.track_video(tmp_path / "f.mp4", {"pixels_per_mm": 1.0}, progress=done.append)
    seen = taken["seen"]
    np.testing.assert_allclose(seen.change, [np.nan, 4.0, 3.0, 239.0])
    np.testing.assert_allclose(seen.time, [0.0, 0.25, 0.5, 0.75])
    np.testing.assert_allclose(seen.points[[0, 2]], [lines[0], lines[2]])
    assert np.isnan(seen.points[[1, 3]]).all()
    assert done == [0.2, 0.4, 0.6, 0.8]
    assert [time for time, _ in drawn] == [0.0, 0.25, 0.5, 0.75]
    assert [line is None for _, line in drawn] == [False, True, False, True]
    assert made.attrs["history"].endswith("a line")
    assert taken["names"] == ["a", "b"]
