"""Repairs and quality of recordings at their limits and with places that are known in part."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pliant.preprocessing.quality import Quality, _clock, quality, standing_stations
from pliant.preprocessing.repair import undo_orientation_jumps
from pliant.preprocessing.side import bending_sign, planar_side
from pliant.recording import make_recording

EIGHTHS = np.arange(9) / 8 + 5.0  # seconds; sums and differences of them are exact


def ramp(frames=9, stations=1):
    """Places (T, S, 3) that are linear in time, by another rate for each coordinate."""
    k = np.arange(frames, dtype=float)[:, None, None]
    return k * np.array([1.0, 2.0, 4.0]) + np.arange(stations)[:, None] * np.array([0.0, 16.0, 0.0])


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
