"""New samples, repairs and quality of recordings at their limits and with places that are known in part."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pliant.errors import InputError
from pliant.preprocessing.quality import Quality, _clock, quality, standing_stations
from pliant.preprocessing.repair import fill_gaps, undo_orientation_jumps
from pliant.preprocessing.resample import pressure_on_shape_clock, resample_arc_length, resample_time
from pliant.preprocessing.side import bending_sign, planar_side
from pliant.recording import make_recording

EIGHTHS = np.arange(9) / 8 + 5.0  # seconds; sums and differences of them are exact


def ramp(frames=9, stations=1):
    """Places (T, S, 3) that are linear in time, by another rate for each coordinate."""
    k = np.arange(frames, dtype=float)[:, None, None]
    return k * np.array([1.0, 2.0, 4.0]) + np.arange(stations)[:, None] * np.array([0.0, 16.0, 0.0])


@pytest.mark.parametrize("longest", [0.25, 0.249])
def test_samples_over_a_lost_frame_are_bridged_up_to_the_longest_gap(longest):
    place = ramp()
    place[2, 0, 1] = np.nan  # a frame without one coordinate is lost
    place[6:8, 0] = np.nan  # two frames: a gap of 0.375 s
    ds = make_recording(EIGHTHS, place)
    made = resample_time(ds, rate_hz=8.0, longest_gap_s=longest)
    np.testing.assert_array_equal(made["time"], EIGHTHS)
    lost = [6, 7] if longest == 0.25 else [2, 6, 7]
    assert np.flatnonzero(np.isnan(made["position"].values[:, 0]).all(-1)).tolist() == lost
    np.testing.assert_allclose(np.delete(made["position"].values, lost, axis=0), np.delete(ramp(), lost, axis=0))
    assert f"resampled from 9 to 9 frames, gaps up to {longest:g} s bridged, {len(lost)} points missing" in (
        made.attrs["history"]
    )
    twice = resample_time(ds, rate_hz=16.0, longest_gap_s=longest)
    assert twice.sizes["time"] == 17
    rows = [11, 12, 13, 14, 15] if longest == 0.25 else [3, 4, 5, 11, 12, 13, 14, 15]
    assert np.flatnonzero(np.isnan(twice["position"].values[:, 0, 0])).tolist() == rows


@pytest.mark.parametrize(("longest", "filled"), [(0.25, 1), (0.249, 0), (0.375, 3)])
def test_gaps_are_filled_up_to_the_longest_and_the_rest_is_counted(longest, filled):
    place = ramp(stations=3)
    place[2, 0, 1] = np.nan
    place[6:8, 0] = np.nan
    place[:, 1] = np.nan
    place[4, 1] = 3.0  # seen once: nothing to draw a line to
    made = fill_gaps(make_recording(EIGHTHS, place), longest_s=longest)
    found = made["position"].values
    kept = {0: [2, 6, 7], 1: [6, 7], 3: []}[filled]
    assert np.flatnonzero(np.isnan(found[:, 0]).any(-1)).tolist() == kept
    np.testing.assert_allclose(np.delete(found[:, 0], kept, axis=0), np.delete(ramp()[:, 0], kept, axis=0))
    assert np.isnan(found[:, 1]).any(-1).sum() == 8
    np.testing.assert_array_equal(found[:, 2], ramp(stations=3)[:, 2])
    line = f"filled {filled} drop-out(s) of at most {longest:g} s by linear interpolation, {len(kept) + 8} are left"
    assert line in made.attrs["history"]
    for wrong in (0.0, -1.0, np.nan):
        with pytest.raises(InputError, match="a positive longest_s"):
            fill_gaps(make_recording(EIGHTHS, place), longest_s=wrong)


def test_pressures_of_some_chambers_may_be_missing():
    pressure = np.stack([np.arange(9.0), 2 * np.arange(9.0)], axis=1)
    pressure[4, 1] = np.nan
    ds = make_recording(EIGHTHS, ramp(), pressure=pressure, pressure_time=EIGHTHS, chamber=["l", "r"])
    made = pressure_on_shape_clock(ds)
    np.testing.assert_array_equal(made["pressure"].values, pressure)
    assert "9 samples to the times of the shape, 1 samples missing" in made.attrs["history"]
    for part in (make_recording(EIGHTHS, ramp()), make_recording(pressure=np.arange(3.0), pressure_time=EIGHTHS[:3])):
        with pytest.raises(InputError, match="needs a shape and a pressure, but the recording lacks one of them"):
            pressure_on_shape_clock(part)


def test_a_body_of_four_stations_is_sampled_and_one_without_a_whole_frame_is_not():
    s = np.arange(4) / 64
    place = np.zeros((3, 4, 2))
    place[..., 1] = s
    made = resample_arc_length(make_recording(np.arange(3.0), place, frame="planar"), spacing_mm=1000 / 128)
    np.testing.assert_allclose(made["position"].values[0, :, 1], np.arange(7) / 128, atol=1e-12)
    for wrong in (np.inf, 0.0, -1.0, np.nan):
        with pytest.raises(InputError, match="spacing_mm must be positive and finite"):
            resample_arc_length(make_recording(np.arange(3.0), place, frame="planar"), spacing_mm=wrong)
    with pytest.raises(InputError, match="at least 4 stations"):
        resample_arc_length(make_recording(np.arange(3.0), place[:, :3], frame="planar"), spacing_mm=1.0)
    for k in range(3):
        place[k, k, 0] = np.nan
    with pytest.raises(InputError, match="no frame has all stations"):
        resample_arc_length(make_recording(np.arange(3.0), place, frame="planar"), spacing_mm=1.0)


@pytest.mark.parametrize(("gap_mm", "bridged"), [(31.25, True), (31.2, False), (None, True)])
def test_a_lost_station_is_bridged_up_to_the_longest_gap(gap_mm, bridged):
    """Stations 1/64 m apart; where one coordinate is missing the station is lost."""
    place = np.zeros((2, 9, 2))
    place[..., 1] = np.arange(9) / 64
    place[..., 0] = place[..., 1] ** 3 * 64
    exact = place.copy()
    place[1, 3, 0] = np.nan
    ds = make_recording(np.arange(2.0), place, frame="planar", arc_length=np.arange(9) / 64)
    made = resample_arc_length(ds, spacing_mm=1000 / 64, longest_gap_mm=gap_mm)["position"].values
    np.testing.assert_allclose(made[0], exact[0], atol=1e-12)
    assert np.isfinite(made[1, 3]).all() == bridged
    np.testing.assert_allclose(np.delete(made[1], 3, axis=0), np.delete(exact[1], 3, axis=0), atol=1e-12)


def test_jumps_of_orientation_are_undone_around_lost_frames():
    """Turns by 120 degrees about a tilted axis for some frames, of a body that turns slowly itself."""
    slow = Rotation.from_rotvec(np.outer(0.01 * np.arange(60), [0.0, 0.6, 0.8]))
    jump = Rotation.from_rotvec(2 * np.pi / 3 * np.array([0.6, 0.0, 0.8]))
    quaternion = slow.as_quat()
    quaternion[20:30] = (slow[20:30] * jump).as_quat()
    quaternion[45:48] = (slow[45:48] * jump.inv()).as_quat()
    quaternion[10, 0] = np.nan  # three numbers of four
    quaternion[24] = np.nan
    made = undo_orientation_jumps(make_recording(np.arange(60.0), np.zeros((60, 1, 3)), quaternion=quaternion[:, None]))
    found = made["quaternion"].values[:, 0]
    rows = np.delete(np.arange(60), [10, 24])
    off = (slow[rows].inv() * Rotation.from_quat(found[rows])).magnitude()
    assert off.max() < 1e-6
    assert np.flatnonzero(np.isnan(found).any(-1)).tolist() == [10, 24]
    assert made.attrs["history"].endswith("frames rotated back: s000 12")


# quality


def test_clocks_of_two_and_three_frames_and_of_another_hour():
    assert _clock(np.array([7.0, 7.5]))["rate_hz"] == 2.0
    found = _clock(np.array([4.0, 5.0, 6.0, 7.25, 8.0, 9.0, 11.5, 14.0, 15.0, 16.0]))
    assert found == {"frames": 10, "duration_s": 12.0, "rate_hz": 1.0, "irregular_steps": 4, "gaps": ()}
    assert _clock(np.arange(8) * 4.0 + 1.0)["irregular_steps"] == 0
    slow = _clock(np.array([0.0, 4.0, 8.0, 12.0, 23.0, 27.0]))  # 11 s beside 4
    assert (slow["irregular_steps"], slow["gaps"]) == (1, ((12.0, 11.0),))


def test_jumps_of_more_than_half_of_the_stations_are_jumps_of_the_frame():
    time = np.arange(100) / 100
    place = np.zeros((100, 4, 3)) + np.arange(4)[:, None] * [0, 0.1, 0] + 1e-5 * np.sin(time * 9)[:, None, None]
    place[30:, :2] += 0.05  # two of four
    place[60:, :3] += 0.05  # three
    found = quality(make_recording(time, place, station=list("abcd")))
    assert found.station_jumps == {"a": 1, "b": 1}
    assert found.frame_jumps_s == (0.6,)
    assert "1 jump(s) of whole frames, at 0.6 s" in found.findings
    assert any(line.endswith("sudden jumps: a 1, b 1") for line in found.findings)


def test_facts_of_places_seen_in_part():
    time = np.arange(50) / 50
    place = np.zeros((50, 2, 3)) + np.array([[0, 0, 0], [0, 0.1, 0]])
    place[:, 1, 0] = 0.02 * np.sin(9 * time)
    place[5, 1, 2] = np.nan
    place[20:23, 1] = place[19, 1]
    place[20:23, 0] = place[19, 0]
    ds = make_recording(time, place, station=["a", "b"])
    found = quality(ds)
    assert (found.missing, found.repeated_frames, found.standing) == ({"b": 1}, 3, ("a",))
    assert standing_stations(ds) == ("a",)
    assert found.out_of_plane_share == pytest.approx(0.0, abs=1e-6)
    assert np.isnan(quality(make_recording(time, place[..., :2], frame="planar")).out_of_plane_share)
    text = found.summary()
    assert text.startswith("50 frames of 2 station(s), 0.98 s at 50 Hz\n")
    assert "largest displacement from the median" in text
    assert "% of the motion" in text
    turned = quality(make_recording(time, angle=np.where(time < 0.7, 0.1, 0.4)[:, None], frame="planar"))
    assert turned.travel_deg == {"s000": pytest.approx(np.degrees(0.3))}


@pytest.mark.parametrize(("travel", "hardly"), [(0.9e-3, True), (1.1e-3, False)])
def test_a_recording_hardly_moves_by_a_hundredth_of_its_extent(travel, hardly):
    """The box about two stations is 0.1 m long; a third one was never seen."""
    place = np.zeros((100, 3, 3))
    place[:, 1, 1] = 0.1
    place[:, 2] = np.nan
    place[:, 1, 0] = travel * np.sin(2 * np.pi * np.arange(100) / 100)
    found = quality(make_recording(np.arange(100) / 100, place))
    line = "the body hardly moves: its largest displacement is below 1 % of its extent"
    assert (line in found.findings) == hardly


def test_a_summary_tells_shapes_logs_and_inputs_apart():
    assert Quality().summary().startswith("log of 0 pressure samples\n")
    log = Quality(input_range={"m": (0.0, 2.5, "N"), "n": (-1.0, 1.0, "mm")})
    assert log.summary() == (
        "log of 2 inputs, without a shape\ninput m: 0 to 2.5 N\ninput n: -1 to 1 mm\nno faults were found"
    )
    both = Quality(input_range={"m": (0.0, 2.5, "N")}, pressure_samples=9, duration_s=4.0, rate_hz=2.0,
                   pressure_kpa={"l": (0.0, 5.0), "r": (1.0, 2.0)})  # fmt: skip
    assert both.summary().startswith("log of 9 pressure samples of 2 chambers, 4.00 s at 2 Hz\nit holds no shape: ")
    assert "\npressure l: 0 to 5 kPa\npressure r: 1 to 2 kPa\ninput m: 0 to 2.5 N\n" in both.summary()
    one = Quality(pressure_samples=9, pressure_kpa={"p": (0.0, 5.0)})
    assert one.summary().startswith("log of 9 pressure samples\n")
    shape = Quality(frames=4, stations=2, duration_s=3.0, rate_hz=1.0, travel_m={"a": 0.002, "b": np.nan},
                    noise_m={"a": 1e-5, "b": 3e-5, "c": 9e-5}, pressure_samples=7, pressure_duration_s=1.5,
                    pressure_rate_hz=4.0, out_of_plane_share=0.125)  # fmt: skip
    assert shape.summary().split("\n") == [
        "4 frames of 2 station(s), 3.00 s at 1 Hz", "pressure with its own times: 7 samples, 1.50 s at 4 Hz",
        "largest displacement from the median 2 mm, noise 0.03 mm (median station)",
        "out of the plane of bending: 12 % of the motion", "no faults were found",
    ]  # fmt: skip
    assert Quality(frames=4, travel_deg={"a": 7.0}).summary().split("\n")[:2] == [
        "4 frames of strain", "largest rotation from the median 7 degrees"]  # fmt: skip
    assert Quality(frames=4, findings=("x", "y")).summary().endswith("! x\n! y")


# the side


def test_one_chamber_says_the_side_and_two_do_not():
    time = np.arange(100) / 100
    place = np.zeros((100, 2, 2)) + np.array([[0.0, 0.0], [0.0, 0.1]])
    place[60:, 1, 0] = 0.05
    early = np.where(time < 0.5, 0.0, 1e5)
    for columns, chamber, side in ((early, None, -1), (early[:, None], ["l"], -1),
                                   (np.stack([early] * 2, axis=1), ["l", "r"], 0)):  # fmt: skip
        assert planar_side(make_recording(time, place, frame="planar", pressure=columns, chamber=chamber)) == side
    restless = place.copy()
    restless[:, 1, 0] = 0.05 * np.sin(40 * time) + 0.01
    assert planar_side(make_recording(time, restless, frame="planar")) == 0  # never at rest
    ds = make_recording(time, place, frame="planar", pressure=np.where(time < 0.5, np.nan, 1e5))
    assert bending_sign(ds, place, place[0], np.zeros(2), np.array([1.0, 0.0])) == -1
