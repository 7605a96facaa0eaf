"""Detectors of faults against what a plain loop finds, and at the edges of their definitions."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.preprocessing import detectors
from pliant.preprocessing.quality import _standing, quality
from pliant.preprocessing.rest import rest_window
from pliant.recording import make_recording

TIME = np.arange(100) / 100


def gappy(rng, frames=1100, stations=5):
    """Places with a share of points lost, whole or in one coordinate."""
    place = rng.normal(size=(frames, stations, 3))
    place[rng.random((frames, stations)) < 0.2] = np.nan
    place[rng.random((frames, stations)) < 0.1, 1] = np.nan
    return place


@pytest.mark.parametrize("stations", [1, 2, 15, 16, 17, 32, 33, 40])
def test_stations_in_blocks_give_what_all_at_once_do(rng, stations):
    place, known = rng.normal(size=(3, stations, 2)), rng.normal(size=stations)
    np.testing.assert_array_equal(
        detectors.by_blocks(lambda p, v: p[..., 0] * v, place, known), place[..., 0] * known)
    if stations > 1:
        np.testing.assert_array_equal(
            detectors.by_blocks(lambda p: np.diff(p[..., 0], axis=1), place, overlap=1), np.diff(place[..., 0], axis=1))


def test_means_medians_and_travel_leave_out_what_was_not_seen(rng):
    place = gappy(rng)
    place[:, 4] = np.nan
    whole = np.isfinite(place).all(-1)
    for s in range(4):
        np.testing.assert_allclose(detectors.mean_place(place)[s], place[whole[:, s], s].mean(axis=0))
    assert np.isnan(detectors.mean_place(place)[4]).all()
    some = place[:, :4]
    np.testing.assert_allclose(detectors._nanmedian(some), np.nanmedian(some, axis=0))
    away = np.linalg.norm(some - np.nanmedian(some, axis=0), axis=2)
    np.testing.assert_allclose(detectors.travel(some), np.nanmax(away, axis=0))
    np.testing.assert_allclose(detectors.rms_deviation(some), np.sqrt(np.nanvar(some, axis=0).sum(axis=-1)))
    points = np.concatenate(list(detectors.seen_points(some, np.zeros((4, 3)))))
    np.testing.assert_allclose(np.sort(points, axis=0), np.sort(some[np.isfinite(some).all(-1)], axis=0))


def test_noise_is_that_of_third_differences(rng):
    smooth = np.stack([0.1 * np.sin(2 * TIME), 0.1 * TIME**2], axis=1)[:, None]
    seen = np.tile(smooth, (20, 1, 1))[:1999] * 0 + 2e-4 * rng.normal(size=(1999, 1, 2))
    assert detectors.noise_level(seen) == pytest.approx(2e-4, rel=0.06)
    assert detectors.noise_level(smooth) < 1e-6
    assert np.isfinite(detectors.noise_level(seen[:8])).all()
    assert np.isnan(detectors.noise_level(seen[:7])).all()


def test_a_frame_repeats_where_every_number_does(rng):
    place, turn = gappy(rng), rng.normal(size=(1100, 5, 4))
    repeated = [3, 4, 511, 512, 513, 1024, 1099]
    for k in repeated:
        place[k], turn[k] = place[k - 1], turn[k - 1]
    assert np.flatnonzero(detectors.repeated_frames(place)).tolist() == repeated
    turn[512] += 1e-9
    still = [k for k in repeated if k not in (512, 513)]
    assert np.flatnonzero(detectors.repeated_frames(place, turn)).tolist() == still
    place[20:23] = np.nan  # nothing is seen: that is no repeat
    assert not detectors.repeated_frames(place)[20:23].any()


@pytest.mark.parametrize("step", [0.5, 3e-4])
def test_the_step_of_a_sensor_is_found_where_it_counts(step, rng):
    counts = np.round(20 * np.sin(9 * TIME)).astype(int)
    assert detectors.quantum(step * counts) == pytest.approx(step)
    assert detectors.quantum(step * 2 * counts) == pytest.approx(2 * step)
    assert detectors.quantum(np.where(TIME < 0.1, np.nan, step * counts)) == pytest.approx(step)
    assert detectors.quantum(rng.normal(size=100)) == 0.0
    assert detectors.quantum(np.repeat([0.0, 1.0], 50)) == 0.0  # a switch
    assert detectors.quantum(np.repeat([0.0, 1.0, 2.3], 30)) == 0.0  # three levels on no grid
    assert detectors.quantum(np.arange(100.0)) == 0.0  # as many levels as samples: it may be anything


def test_a_spike_is_one_frame_that_comes_back(rng):
    place = 1e-6 * rng.normal(size=(100, 3, 2)) + np.stack([0.01 * np.sin(3 * TIME), 0.05 * TIME], axis=1)[:, None]
    for k in (1, 2, 50, 97, 98):
        spoilt = place.copy()
        spoilt[k, 1] += [0.02, -0.01]
        found = detectors.spikes(spoilt)
        assert np.argwhere(found).tolist() == ([[k, 1]] if 2 <= k <= 97 else [])
        if found.any():
            assert np.isnan(detectors.without_spikes(spoilt)[k, 1]).all()
            bridged, rest = detectors.spikes_bridged(spoilt), np.arange(100) != k
            np.testing.assert_allclose(bridged[k, 1], 0.5 * (place[k - 1, 1] + place[k + 1, 1]))
            np.testing.assert_array_equal(bridged[rest], place[rest])
    two, moved = place.copy(), place.copy()
    two[50:52] += 0.02  # two frames: no spike
    moved[50:] += 0.02  # it stays there
    assert not detectors.spikes(two).any()
    assert not detectors.spikes(moved).any()
    assert detectors.without_spikes(two) is two
    assert detectors.spikes_bridged(moved) is moved
    assert not detectors.spikes(np.zeros((11, 1, 2))).any()


def test_a_jump_stays_and_a_gap_in_time_is_none(rng):
    place = 1e-6 * rng.normal(size=(100, 3, 2)) + np.stack([0.01 * np.sin(3 * TIME), 0.05 * TIME], axis=1)[:, None]
    moved = place.copy()
    moved[50:, 1] += [0.02, -0.01]
    assert np.argwhere(detectors.jumps(moved, TIME)).tolist() == [[50, 1]]
    late = TIME + 0.3 * (np.arange(100) >= 50)
    assert not detectors.jumps(moved, late).any()
    assert not detectors.jumps(place, TIME).any()
    spike = place.copy()
    spike[50] += 1e-7
    assert not detectors.jumps(spike, TIME).any()
    assert not detectors.jumps(moved[45:56], TIME[45:56]).any()  # too short to judge


@pytest.mark.parametrize(("degrees", "counted"), [(29.0, 0), (31.0, 2)])
def test_orientations_jump_beyond_thirty_degrees(degrees, counted):
    turn = np.tile([1.0, 0.0, 0.0, 0.0], (60, 2, 1))
    half = 0.5 * np.radians(degrees)
    turn[20:40, 1] = [np.cos(half), np.sin(half), 0.0, 0.0]
    turn[25:30, 1] = np.nan
    assert detectors.orientation_jumps(turn).tolist() == [0, counted]
    turn[10:, 0] *= -1.0  # the same pose by the opposite sign
    assert detectors.orientation_jumps(turn).tolist() == [0, counted]
    assert detectors.sign_flips(turn).tolist() == [1, 0]


def test_spacing_and_motion_out_of_the_plane():
    place = np.zeros((50, 3, 3))
    place[:, 1:, 1] = [0.1, 0.2]
    place[5, 1:, 1] += 0.0051
    place[6, 1:, 1] += 0.0049
    assert np.argwhere(detectors.stretched(place, 0.05)).tolist() == [[5, 0]]
    swing = np.sin(np.linspace(0, 20, 400))[:, None] * np.linspace(0, 0.05, 5)
    body = np.zeros((400, 5, 3))
    body[..., 0], body[..., 1], body[..., 2] = swing, np.linspace(0, 0.2, 5), 0.25 * swing**2 / 0.05
    out = body[..., 2] - body[..., 2].mean(axis=0)
    across = swing - swing.mean(axis=0)
    expected = np.sqrt((out**2).sum() / (out**2 + across**2).sum())
    assert detectors.out_of_plane_share(body) == pytest.approx(expected, rel=0.05)
    turned = body @ np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    assert detectors.out_of_plane_share(turned) == pytest.approx(detectors.out_of_plane_share(body), rel=1e-9)


def test_what_stands_still_moves_by_no_more_than_its_noise_or_a_share_of_the_largest():
    deviation, noise = np.array([1e-3, 1e-5, 5e-4, np.nan]), np.array([1e-6, 1e-6, 1e-4, np.nan])
    assert _standing(list("abcd"), deviation, noise) == ("b", "c")
    assert _standing(["a"], np.array([np.nan]), np.array([np.nan])) == ()


def test_counts_are_told_from_the_largest_and_shortened():
    rng = np.random.default_rng(2)
    place = np.zeros((100, 9, 3)) + 0.02 * np.arange(9)[:, None]
    place[..., 1] += 0.01 * np.sin(6 * TIME)[:, None] * np.arange(9) + 1e-5 * rng.normal(size=(100, 9))
    for s, lost in enumerate((1, 2, 3, 9, 5, 4, 8, 7)):
        place[10 : 10 + lost, s] = np.nan
    (line,) = (f for f in quality(make_recording(TIME, place)).findings if f.startswith("drop-outs"))
    assert line == "drop-outs: s003 9, s006 8, s007 7, s004 5, s005 4, s002 3 and 2 more"
    place[10:15] = np.nan
    place[15:20] = place[20]
    found = quality(make_recording(TIME + 0.5 * (TIME > 0.7) + 0.3 * (TIME > 0.3), place))
    text = "\n".join(found.findings)
    assert "2 gap(s) in time, the longest 0.51 s at 1 s" in text
    assert "5 of 100 frames repeat the previous frame (5.0 %)" in text
    assert "the times are irregular: 2 of 99 steps differ" in text


@pytest.mark.parametrize("measured", [True, False])
def test_the_rest_ends_where_the_pressure_or_the_body_first_moves(measured):
    time, rng = np.arange(0.0, 3.0, 0.01), np.random.default_rng(3)
    place = np.zeros((300, 3, 2)) + 0.05 * np.arange(3)[:, None]
    place[..., 0] += 0.02 * np.clip(time - 1.0, 0, 0.5)[:, None] * np.arange(3) + 1e-5 * rng.normal(size=(300, 3))
    place[30, 2] += 0.01  # a spike of one frame is passed over
    more = {"pressure": 4e4 * np.clip(time - 0.9, 0, 1), "pressure_time": time} if measured else {}
    start, end = rest_window(make_recording(time, place, frame="planar", **more))
    assert start == 0.0
    assert end == pytest.approx(0.9 + 0.05 if measured else 1.0, abs=0.11)
