"""Limits of preprocessing from just below and just above, and its numbers against cases worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from pliant.errors import InputError
from pliant.preprocessing import detectors
from pliant.preprocessing.angles import angle_facts, angle_sentences, coarse_steps, from_rest, sensor_noise, turns_back
from pliant.preprocessing.arc_length import chord_lengths, station_arc_length, whole_frames
from pliant.preprocessing.cut import cut_body, cut_time
from pliant.preprocessing.held import runs
from pliant.preprocessing.labels import (
    _continuation,
    _cycles,
    _expected,
    _last_seen,
    exchanged,
    exclude_swaps,
    label_order,
    undo_swaps,
)
from pliant.preprocessing.pressure_clock import clock_sentences, pressure_clock
from pliant.preprocessing.repair import rotation_angle, undo_orientation_jumps
from pliant.preprocessing.rest import (
    _away,
    _precedes_motion,
    _still,
    _width,
    before_inputs,
    clock_finding,
    rest_window,
    shown,
    still_within,
)
from pliant.preprocessing.side import bending_sign, half_turn, planar_side, x_sign
from pliant.recording import make_recording

TIME = np.arange(100) / 100


# detectors


@pytest.mark.parametrize(
    ("levels", "samples", "step"), [(3, 6, 1.0), (3, 5, 0.0), (2, 90, 0.0), (10, 20, 1.0), (10, 19, 0.0)]
)
def test_a_grid_has_three_levels_and_twice_as_many_samples(levels, samples, step):
    assert detectors.quantum(np.arange(samples) % levels * 1.0) == step


@pytest.mark.parametrize(("off", "step"), [(0.18, (3 + 2.18) / 5), (0.22, 0.0), (-0.18, (3 + 1.82) / 5)])
def test_a_grid_may_be_off_by_a_fifth_of_its_step(off, step):
    values = np.tile([0.0, 1.0, 2.0, 3.0, 5.0 + off], 9)
    assert detectors.quantum(values) == pytest.approx(step)
    assert detectors.quantum(np.append(values, [1.0 + 4e-6, np.nan])) == pytest.approx(step, rel=1e-5)  # rounding


def one(at, size, count=60, axes=2):
    place = np.zeros((count, 1, axes))
    place[at, 0, 0] = size
    return place


def test_a_spike_stands_out_of_the_floor_and_ten_times_out_of_its_surroundings():
    for size, found in ((0.99e-3, False), (1.01e-3, True)):  # the residual of a lone value is that value
        assert detectors.spikes(one(30, size), np.array([1e-3])).any() == found
    wavy = np.zeros((60, 1, 1))
    wavy[::2] = 1.0
    wavy[1::2] = -1.0  # the residual of a change of sign is 16/6 of it
    for size, found in ((24.5, True), (23.5, False)):  # and 8/3, against ten times 8/3
        spiky = wavy.copy()
        spiky[30] += size
        assert detectors.spikes(spiky, np.zeros(1)).any() == found
    assert detectors.fault_floor(np.array([2e-4, np.nan]), np.array([0.5, 1.0])) == pytest.approx([2e-3 + 1.5e-3, 3e-3])


def test_the_surroundings_of_a_fault_are_twelve_frames_less_a_hole():
    size = np.zeros((41, 2))
    size[20, 1] = 100.0
    for hole, count in ((3, 8), (2, 10)):
        offsets = [k for k in range(-6, 7) if abs(k) >= hole]
        assert len(offsets) == count
        for loud in range(count // 2 - 1, count // 2 + 2):
            around = size.copy()
            around[[20 + k for k in offsets[:loud]], 1] = 11.0  # more than half of them: the median is 11
            around[[20 + k for k in (-7, 7, *range(1 - hole, 0), *range(1, hole))], 1] = 11.0  # these do not count
            median = np.median([11.0] * loud + [0.0] * (count - loud))
            found = detectors._stands_out(around, hole, np.array([50.0, 50.0]))
            assert found[20, 1] == (10 * median + 50.0 < 100.0)
            assert found.sum() == found[20, 1]


@pytest.mark.parametrize(("back", "found"), [(0.45, True), (0.55, False)])
def test_a_spike_comes_back_to_within_half_of_its_size(back, found):
    place = one(30, 1.0)
    place[31:, 0, 0] = 0.0
    place[31:, 0, 1] = back  # where it lands, seen from where it came
    residual = place[30, 0] - (4 * (place[29, 0] + place[31, 0]) - place[28, 0] - place[32, 0]) / 6
    assert detectors.spikes(place, np.array([1e-3])).any() == (back < 0.5 * np.hypot(*residual)) == found


def test_a_spike_is_the_residual_of_a_cubic_through_its_neighbours():
    """No spike in a cubic, however steep; the steps to and from a spike oppose each other."""
    t = np.arange(60.0)
    cubic = (0.002 * (t - 30) ** 3 + t)[:, None, None]
    assert not detectors.spikes(cubic, np.array([1e-9])).any()
    assert detectors.spikes(np.zeros((12, 1, 1)) + one(6, 1.0, 12, 1), np.array([1e-3])).any()
    assert not detectors.spikes(one(5, 1.0, 11), np.array([1e-3])).any()  # twelve frames are needed
    stair = np.zeros((60, 1, 1))
    stair[30], stair[31:] = 1.0, 1.2
    assert not detectors.spikes(stair, np.array([1e-3])).any()


@pytest.mark.parametrize(("ratio", "found"), [(2.2, True), (1.8, False)])
def test_a_jump_exceeds_twice_what_its_neighbours_speeds_make_plausible(ratio, found):
    """At a steady speed v the step expected is v dt; beyond it the jump must exceed 2 (v + v) dt."""
    place = (0.01 * np.arange(100.0))[:, None, None] * np.array([1.0, 0.0])
    place[50:, 0, 1] += ratio * 0.02
    jumped = detectors.jumps(place, TIME, np.array([1e-4]))
    assert np.argwhere(jumped).tolist() == ([[50, 0]] if found else [])
    far = place.copy()
    far[50:, 0, 1] += 0.1
    for late, counts in ((0.4, True), (0.6, False)):  # of a step in time half as long again nothing is said
        clock = TIME + 0.01 * late * (np.arange(100) >= 50)
        assert detectors.jumps(far, clock, np.array([1e-4])).any() == counts
    short = place[44:56]
    assert detectors.jumps(short, TIME[44:56], np.array([1e-4])).any() == found
    assert not detectors.jumps(short[1:], TIME[45:56], np.array([1e-4])).any()
    uneven = np.cumsum(np.where(np.arange(100) % 2, 0.012, 0.008))
    steady = (uneven * 1.0)[:, None, None] * np.array([1.0, 0.0])
    assert not detectors.jumps(steady, uneven, np.array([1e-4])).any()  # the same speed in steps of two lengths


def test_signs_flip_at_about_the_same_pose():
    quaternion = np.zeros((4, 2, 4))
    for s, degrees in enumerate((28.0, 32.0)):
        half = 0.5 * np.radians(degrees)
        quaternion[0, s] = quaternion[1, s] = [1.0, 0, 0, 0]
        quaternion[2, s] = quaternion[3, s] = [-np.cos(half), -np.sin(half), 0, 0]
    assert detectors.sign_flips(quaternion).tolist() == [1, 0]


def test_noise_by_third_differences_in_closed_form():
    """Third differences of 0, 0, 0, a, ...: their median over 0.6745 and the root of 20."""
    place = np.cumsum(np.cumsum(np.cumsum(np.full((20, 1, 2), [3e-3, 4e-3]), axis=0), axis=0), axis=0)
    assert detectors.noise_level(place) == pytest.approx(np.sqrt((3e-3**2 + 4e-3**2) / 2) / 0.6745 / np.sqrt(20))


def test_out_of_plane_share_of_one_station_and_of_a_still_body():
    t = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    lone = np.stack([3 * np.sin(t), np.cos(5 * t), 0.5 * np.sin(7 * t)], axis=1)[:, None]
    assert detectors.out_of_plane_share(lone) == pytest.approx(0.5 / np.sqrt(9 + 1 + 0.25), rel=1e-6)
    body = np.concatenate([0 * lone, lone * [1.0, 0.0, 1.0] + [0.0, 2.0, 0.0]], axis=1)
    assert detectors.out_of_plane_share(body) == pytest.approx(0.5 / np.sqrt(9 + 0.25), rel=1e-6)
    three = np.concatenate([0 * lone, lone + 9.0, lone * [1.0, 0.0, 1.0] + [0.0, 2.0, 0.0]], axis=1)
    chord = np.array([0.0, 1.0, 0.0])  # from the first station to the last
    across = np.concatenate([m - (m @ chord)[:, None] * chord for m in (lone[:, 0], lone[:, 0] * [1, 0, 1])])
    whole = (lone**2).sum() + (across[400:] ** 2).sum()
    least = np.linalg.svd(across, compute_uv=False)[1]
    assert detectors.out_of_plane_share(three) == pytest.approx(least / np.sqrt(whole), rel=1e-6)
    assert detectors.out_of_plane_share(np.zeros((9, 3, 3))) == 0.0


# the clock of a pressure


def log(time):
    return xr.Dataset({"pressure": ("pressure_time", np.zeros(len(time)))}, {"pressure_time": np.asarray(time, float)})


def test_gaps_of_a_regular_clock():
    time = np.delete(np.arange(40) * 0.5, [7, 8, 20])
    found = pressure_clock(log(time))
    assert found == {"pressure_samples": 37, "pressure_duration_s": 19.5, "pressure_rate_hz": 2.0,
                     "pressure_gaps": ((7, 3.0, 1.5, 2), (18, 9.5, 1.0, 1))}  # fmt: skip
    (line,) = clock_sentences(37, found["pressure_gaps"], ())
    assert line == ("3 of 40 samples of the pressure are missing, in 2 gap(s) after sample 7 (3 s), 18 (9.5 s); the "
                    "longest gap is 1.5 s (2 missing) at 3 s")  # fmt: skip
    seven = tuple((k, float(k), 1.0, 1) for k in range(1, 8))
    assert "after sample 1 (1 s), 2 (2 s), 3 (3 s), 4 (4 s), 5 (5 s) and 2 more; " in clock_sentences(9, seven, ())[0]
    assert "5 (5 s); " in clock_sentences(9, seven[:5], ())[0]
    assert clock_sentences(9, (), ()) == []
    assert clock_sentences(9, (), (0.1, 0.25)) == ["the times of the pressure are irregular: steps of 0.1 to 0.25 s"]
    assert pressure_clock(log([3.0])) == {"pressure_samples": 1, "pressure_duration_s": 0.0}
    assert pressure_clock(log([3.0, 5.0]))["pressure_rate_hz"] == 0.5
    same = make_recording([0.0, 1.0, 2.0], np.zeros((3, 2, 2)), pressure=[0, 1, 2.0], frame="planar")
    assert pressure_clock(same) == {}


@pytest.mark.parametrize(("off", "near"), [(0.18, True), (0.22, False)])
@pytest.mark.parametrize(("count", "regular"), [(5, False), (7, True)])
def test_a_clock_is_regular_where_six_tenths_of_its_steps_are(off, near, count, regular):
    steps = np.array([1.0] * count + [2.0 + off] * (10 - count))
    time = np.append(0.0, np.cumsum(steps))
    found = pressure_clock(log(time))
    assert ("pressure_steps_s" in found) == (not near and not regular)
    if "pressure_steps_s" in found:
        assert found["pressure_steps_s"] == pytest.approx((1.0, 2.0 + off))


def test_the_usual_step_is_found_where_most_samples_are_missing():
    time = np.append(np.arange(5.0), 4.0 + 3.0 * np.arange(1, 10))
    assert pressure_clock(log(time))["pressure_rate_hz"] == 1.0
    wide = np.append(0.0, np.cumsum([1.0, 1.0, 1.0, 1.4, 1.4, 1.6]))  # steps to half as long again are usual ones
    assert pressure_clock(log(wide))["pressure_rate_hz"] == pytest.approx(5 / 5.8)  # the mean of the usual steps
    even = np.append(0.0, np.cumsum([1.0, 1.0, 1.4, 1.4, 1.4, 1.6, 1.6]))
    assert pressure_clock(log(even))["pressure_rate_hz"] == pytest.approx(7 / 9.4)


# angles without places


@pytest.mark.parametrize(("steps", "coarse"), [(198, True), (202, False)])
def test_steps_are_told_beyond_a_two_hundredth_of_the_range(steps, coarse):
    counts = np.concatenate([np.arange(steps + 1), np.arange(steps, -1, -1), [0, 1] * 20])
    angle = np.radians(0.5) * (counts + 300.0)
    both = np.stack([angle, np.sin(np.arange(len(angle)))], axis=1)
    assert coarse_steps(both) == pytest.approx([np.radians(0.5) if coarse else 0.0, 0.0])
    if coarse:
        assert sensor_noise(both)[0] == pytest.approx(np.radians(0.5) / np.sqrt(12))
        assert sensor_noise(both)[1] == pytest.approx(detectors.noise_level(both[:, 1:, None])[0])
    assert angle_sentences({"tip": 0.5}) == [
        "the angle of tip has a resolution of 0.5 degrees, which acts as 0.14 degrees of noise"
    ]


def test_facts_of_angles_are_in_degrees():
    angle = np.radians(np.stack([10 * np.sin(6 * TIME), np.round(40 * TIME)], axis=1))
    angle[7, 0] = np.nan
    angle[50, 0] += 1.0
    facts = angle_facts(make_recording(TIME, angle=angle, station=["a", "b"], frame="planar"))
    assert facts["stations"] == 2
    assert facts["missing"] == {"a": 1}
    assert facts["spikes"] == {"a": 1}
    assert facts["step_deg"] == {"b": pytest.approx(1.0)}
    assert facts["noise_deg"]["b"] == pytest.approx(1 / np.sqrt(12))
    assert facts["travel_deg"]["b"] == pytest.approx(20.0, abs=0.6)
    assert facts["travel_deg"]["a"] == pytest.approx(
        np.degrees(1) + 10 * np.sin(3.0) - np.median(10 * np.sin(6 * TIME)), abs=0.2
    )


def test_angles_are_measured_from_rest_and_turned_to_the_pressures_side():
    turn = np.where(TIME > 0.5, 1.0, 0.0)
    angle = np.stack([0.2 + 0.3 * turn, 0.1 - 0.4 * turn, np.full(100, np.nan)], axis=1)
    angle[3, 0], angle[4, 1] = 9.0, np.nan
    pressure = np.where(TIME > 0.5, 5e4, 1e4)
    ds = make_recording(TIME, angle=angle, station=["a", "b", "c"], frame="planar", pressure=pressure)
    found = from_rest(ds, (0.0, 0.4))
    np.testing.assert_allclose(found["angle"].values[60], [0.3, 0.4, np.nan], atol=1e-12)
    np.testing.assert_allclose(found["angle"].values[0, :2], 0.0, atol=1e-12)
    assert "rest at 0 to 0.4 s, subtracted degrees: a 11.5, b 5.73, c 0" in found.attrs["history"]
    assert "positive pressure turned b to the negative side: the sign was changed" in found.attrs["history"]
    assert found["angle"].attrs["reference"] == "rest"
    late = from_rest(ds, (0.6, 0.9))
    np.testing.assert_allclose(late["angle"].values[0, :2], [-0.3, 0.4], atol=1e-12)  # nothing turns under pressure
    free = ds.drop_vars(["pressure", "pressure_time"])
    assert turns_back(free, np.array([0.1, -0.3, 0.2]))
    assert not turns_back(free, np.array([-0.1, np.nan, 0.2]))
    assert not turns_back(free, np.array([-0.2, 0.2]))
    assert not turns_back(free, np.full(3, np.nan))
    both = np.stack([pressure] * 2, axis=1)
    two = make_recording(TIME, angle=angle, station=["a", "b", "c"], frame="planar", pressure=both, chamber=["l", "r"])
    assert not turns_back(two, -turn)
    assert turns_back(ds, -turn)
    assert not turns_back(ds, turn)
    dropping = ds.assign(pressure=("pressure_time", 6e4 - pressure))  # the pressure falls from what it begins with
    assert turns_back(dropping, turn)


# arc length, cutting, sampling


def straight(frames=4, stations=5, spacing=0.01, stretch=1.0):
    place = np.zeros((frames, stations, 2))
    place[..., 1] = spacing * np.arange(stations) * np.linspace(1.0, stretch, frames)[:, None]
    return place


@pytest.mark.parametrize(("stretch", "told"), [(1.019, False), (1.0215, True)])
def test_a_change_of_length_by_a_fiftieth_is_told(stretch, told):
    place = straight(stretch=stretch)
    ds = make_recording(np.arange(4) / 10, place, frame="planar")
    arc, lines = station_arc_length(ds, place)
    np.testing.assert_allclose(arc, 0.01 * np.arange(5) * (1 + stretch) / 2)
    varies = "the length varies by 2.1 % over the frames; the arc lengths are those of the mean"
    assert lines == ("arc length: time-mean sum of chords", *[varies] * told)
    known = make_recording(
        np.arange(4) / 10, straight(), frame="planar", arc_length=0.3 + stretch * 0.01 * np.arange(5)
    )
    arc, lines = station_arc_length(known, straight())
    np.testing.assert_allclose(arc, stretch * 0.01 * np.arange(5))
    assert lines == ("arc length: as recorded",
                     *([f"the chords add up to {1 / stretch:.3f} times the recorded arc length"] * told))  # fmt: skip
    np.testing.assert_allclose(chord_lengths(place[:1] + 3.0), 0.01)


def test_stations_that_coincide_or_are_missing_are_named():
    place = straight()
    place[:, 3] = place[:, 2]
    ds = make_recording(np.arange(4) / 10, place, frame="planar")
    with pytest.raises(InputError, match="stations 2 and 3, counted from 0, coincide"):
        station_arc_length(ds, place)
    place = straight()
    place[1:, 3] = np.nan
    place[:2, 1] = np.nan
    place[0, 0, 1] = np.nan
    with pytest.raises(InputError, match="station 3, counted from 0, is missing in 3 of 4 frames"):
        whole_frames(make_recording(np.arange(4) / 10, place, frame="planar"))
    place = straight()
    place[1, 2] = np.nan
    kept, time, dropped = whole_frames(make_recording(np.arange(4) / 10, place, frame="planar"))
    assert (kept.shape, time.tolist(), dropped) == ((3, 5, 2), [0.0, 0.2, 0.3], 1)
    backwards = make_recording(np.arange(4) / 10, straight(), frame="planar").assign_coords(
        arc_length=("station", [0.0, 0.01, 0.01, 0.02, 0.03])
    )
    with pytest.raises(InputError, match="must increase strictly"):
        station_arc_length(backwards, straight())


@pytest.mark.parametrize(("end", "frames"), [(0.9, 10), (0.85, 9)])
def test_ten_frames_are_left_at_least(end, frames):
    ds = make_recording(
        np.arange(40) / 10, straight(40), frame="planar", pressure=np.arange(80.0), pressure_time=np.arange(80) / 20
    )
    if frames < 10:
        with pytest.raises(InputError, match=r"9 frames are between 0 and 0\.85 s, but 10 are needed: .* 0 to 3\.9 s"):
            cut_time(ds, 0.0, end)
        return
    cut = cut_time(ds, 0.0, end)
    assert (cut.sizes["time"], cut.sizes["pressure_time"]) == (10, 19)
    assert "cut to 0 to 0.9 s: 10 of 40 frames" in cut.attrs["history"]
    assert cut_time(ds, 1.0, 2.5)["time"].values[[0, -1]].tolist() == [1.0, 2.5]


def test_a_body_is_cut_at_its_ends():
    """A parabola, which a cubic meets exactly."""
    s = np.linspace(0, 0.1, 11)
    place = np.tile(np.stack([0 * s, s], axis=1), (3, 1, 1))
    ds = make_recording(np.arange(3.0), place, frame="planar", arc_length=s)
    for base, tip in ((0.004, 0.096), (0.0, 0.1), (0.025, 0.061), (0.001, 0.099)):
        cut = cut_body(ds, base, tip)
        inside = s[(s > base + 1e-9) & (s < tip - 1e-9)]
        np.testing.assert_allclose(cut["position"].values[0, :, 1], [base, *inside, tip], atol=1e-12)
        np.testing.assert_allclose(cut["arc_length"], np.array([base, *inside, tip]) - base, atol=1e-12)
        assert len(cut["station"]) == len(inside) + 2
    assert (
        "cut to the body from 25.00 to 61.00 mm: 3 station(s) of lead, 4 of tail"
        in cut_body(ds, 0.025, 0.061).attrs["history"]
    )
    with pytest.raises(InputError, match=r"within 0 to 0\.1 m of the fibre, base first, not 0\.06 to 0\.06 m"):
        cut_body(ds, 0.06, 0.06)
    with pytest.raises(InputError, match="only 3 station"):
        cut_body(ds, 0.035, 0.065)
    assert cut_body(ds, 0.03, 0.1 + 5e-10).sizes["station"] == 8


# repair


@pytest.mark.parametrize(("off", "told"), [(24.0, True), (36.0, False)])
def test_turns_of_a_symmetry_are_alike_within_twenty_five_degrees(off, told):
    """Jumps by 90 degrees and back by 90 less or more than what is one symmetry."""

    def about_z(degrees):
        half = np.radians(degrees) / 2
        return np.stack([0 * half, 0 * half, np.sin(half), np.cos(half)], axis=-1)

    turn = np.zeros(60)
    turn[20:40] = 90.0
    turn[40:] = 90.0 - (90.0 - off)
    ds = make_recording(np.arange(60) / 10, np.zeros((60, 1, 3)), quaternion=about_z(turn)[:, None])
    made = undo_orientation_jumps(ds)
    left = 2 * np.degrees(np.arctan2(made["quaternion"].values[:, 0, 2], made["quaternion"].values[:, 0, 3]))
    steps = np.abs((np.diff(left) + 180) % 360 - 180)
    assert steps.max() <= 30.0
    assert ("frames rotated back: none" in made.attrs["history"]) is False
    np.testing.assert_allclose(rotation_angle(np.eye(3)[None]), 0.0)
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(rotation_angle(turned), np.pi / 2)
    assert told == (off < 25.0)


# rest


def moving(start=0.5, amount=0.02, count=300, rate=100.0):
    time = np.arange(count) / rate
    place = np.zeros((count, 2, 2)) + np.array([[0.0, 0.0], [0.0, 0.1]])
    place[:, 1, 0] = amount * np.clip((time - start) / 0.5, 0, 1)
    return time, place


def test_runs_and_widths():
    assert runs(np.array([True, True, False, True, False, False, True]), 1) == [(0, 2), (3, 4), (6, 7)]
    assert runs(np.array([False, False]), 1) == []
    place = np.array([0.0, 0.0, 3.0, 3.0, 3.0, np.nan, 3.0])[:, None, None] * np.array([1.0, 4.0 / 3.0])
    np.testing.assert_allclose(_width(place, 1)[:, 0], [0, 5, 5, 0, 0, 0, 0])
    np.testing.assert_allclose(_width(place, 2)[:, 0], [5, 5, 5, 5, 0, 0, 0])
    np.testing.assert_allclose(_width(np.full((3, 1, 2), np.nan), 1), 0.0)
    np.testing.assert_allclose(_away(place)[:, 0], [5, 5, 0, 0, 0, 0, 0])


@pytest.mark.parametrize(("drift", "still"), [(0.095, True), (0.105, False)])
def test_a_body_at_rest_may_drift_by_a_tenth_of_its_travel(drift, still):
    place = np.zeros((200, 1, 2))
    place[100:, 0, 0] = 1.0  # the median place is between: it travels by one half
    place[20:30, 0, 1] = drift * 0.5
    time = np.arange(200) / 100
    travel = detectors.travel(place)[0]
    place[20:30, 0, 1] = drift * travel
    assert still_within(place, time, (0.0, 0.5)) == still
    place[20:30, 0, 1] = drift  # of the metre that it goes from its place in the run
    assert _precedes_motion(place, (40, 90)) == still
    place[20:30], place[95:99, 0, 1] = 0.0, drift  # behind the run
    assert _precedes_motion(place, (40, 90))


@pytest.mark.parametrize(("off", "still"), [(5, True), (6, False)])
def test_one_frame_in_twenty_may_be_off(off, still):
    place = np.zeros((200, 1, 2))
    place[100:, 0, 0] = 1.0
    place[10 : 10 + off, 0, 1] = 0.3
    assert still_within(place, np.arange(200) / 100, (0.0, 0.995)) == still


@pytest.mark.parametrize(("amount", "end"), [(0.028, 1.4), (0.032, 0.4)])
def test_what_moves_by_three_hundredths_of_the_travel_is_still(amount, end):
    """Within 0.1 s about a frame, a step of that size is no motion."""
    time = np.arange(400) / 100
    place = np.zeros((400, 1, 2))
    place[150:] = [1.0, 0.0]
    place[300:] = [0.0, 0.0]
    travel = 1.0
    place[50:150, 0, 1] = amount * travel
    still = np.flatnonzero(_still(place, time))
    assert time[still[still < 145].max()] == pytest.approx(1.39)
    assert (_still(place, time)[45:55].all()) == (end > 1)


def test_a_frame_is_still_where_some_station_is_seen_to_be():
    time, place = moving(1.5)
    place[20:30, 0] = np.nan
    place[60:63] = np.nan
    still = _still(place, time)
    assert still[20:30].all()
    assert not still[60:63].any()


def test_the_first_motion_of_an_input_ends_the_rest():
    time = np.arange(100) / 100
    for level, found in ((0.045, 0.49), (0.055, 0.29)):  # of its range
        pressure = np.where(time >= 0.5, 1.0, np.where(time >= 0.3, level, 0.0)) * 1e5
        ds = make_recording(time, np.zeros((100, 1, 2)), frame="planar", pressure=pressure)
        assert before_inputs(ds) == (0.0, pytest.approx(found))
    noisy = np.where(time >= 0.5, 1e5, 0.0)
    noisy[[1, 3]] = 8e4  # the median of the first five is the start
    ds = make_recording(time, np.zeros((100, 1, 2)), frame="planar", pressure=noisy)
    assert before_inputs(ds) is None  # it leaves it in the second frame
    assert before_inputs(make_recording(time, np.zeros((100, 1, 2)), frame="planar")) is None
    _, place = moving(0.2, count=100)
    late = make_recording(time, place, frame="planar", pressure=np.where(time >= 0.6, 1e5, 0.0))
    assert clock_finding(late) == [
        ("the body moves before the pressure does (0.59 s): it was touched, or their clocks differ (clock = 'align'); "
         "rest is taken from the shape")]  # fmt: skip
    fine = make_recording(time, place, frame="planar", pressure=np.where(time >= 0.2, 1e5, 0.0))
    assert clock_finding(fine) == []
    with pytest.raises(InputError, match="positions or angles"):
        shown(xr.Dataset({"x": ("time", [1.0])}))


def test_the_first_still_stretch_counts_unless_the_body_moved_before_it():
    time = np.arange(300) / 100
    place = np.zeros((300, 1, 2))
    place[:, 0, 0] = np.interp(time, [0.0, 0.6, 0.9, 1.0, 1.2, 1.5, 3.0], [0.0, 0.0, 1.0, 1.0, 1.0, 0.5, 0.5])
    start, end = rest_window(make_recording(time, place, frame="planar"))
    assert (start, end) == (0.0, pytest.approx(0.5, abs=0.02))
    swung = place.copy()
    swung[:30, 0, 0] = np.linspace(1.0, 0.0, 30)  # it comes from somewhere: then the longest counts
    start, end = rest_window(make_recording(time, swung, frame="planar"))
    assert (start, end) == (pytest.approx(1.6, abs=0.03), 2.99)
    short = place.copy()
    short[:, 0, 0] = np.where(time < 0.06, 0.0, np.sin(20 * time))
    with pytest.raises(InputError, match=r"never at rest for 0\.1 s"):
        rest_window(make_recording(time, short, frame="planar"))


# the side to which a body bends


def bent(side, pressure=None, tip=0.05):
    time = np.arange(100) / 100
    place = np.zeros((100, 3, 2)) + np.array([[0.0, 0.0], [0.0, 0.1], [0.0, 0.2]])
    place[60:, 2, 0] = side * tip
    place[30:40, 1, 0] = -side * 0.5 * tip
    return make_recording(time, place, frame="planar", pressure=pressure)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_station_that_moves_most_says_the_side(side):
    assert planar_side(bent(side)) == -side
    early = np.where(np.arange(100) < 50, 0.0, 1e5)
    assert planar_side(bent(side, early)) == -side
    ds = bent(side, early)
    ds["position"].values[20:25, 2, 0] = -3 * side * 0.05  # farther, but before the pressure's higher half
    pose = np.array([[0.0, 0.0], [0.0, 0.1], [0.0, 0.2]])
    assert bending_sign(ds, ds["position"].values, pose, np.zeros(2), np.array([1.0, 0.0])) == -side
    low = np.where(np.arange(100) < 20, 1e5, np.where(np.arange(100) < 25, 1.4e5, 2e5))
    ds["pressure"].values[:] = low  # 40 % of its range
    assert (
        bending_sign(
            ds, ds["position"].values, np.array([[0.0, 0.0], [0.0, 0.1], [0.0, 0.2]]), np.zeros(2), np.array([1.0, 0.0])
        )
        == -side
    )
    ds["pressure"].values[:] = np.where(np.arange(100) < 20, 1e5, np.where(np.arange(100) < 25, 1.6e5, 2e5))
    assert (
        bending_sign(
            ds, ds["position"].values, np.array([[0.0, 0.0], [0.0, 0.1], [0.0, 0.2]]), np.zeros(2), np.array([1.0, 0.0])
        )
        == side
    )
    still = np.zeros((9, 2, 2)) + np.array([[0.0, 0.0], [side * 0.1, 0.2]])
    assert (
        bending_sign(ds.drop_vars("pressure"), still, still[0], np.array([side * 0.05, 0.0]), np.array([1.0, 0.0]))
        == -side
    )
    assert (
        bending_sign(ds.drop_vars("pressure"), still, still[0], np.array([side * 0.1, 0.0]), np.array([1.0, 0.0])) == 0
    )
    assert planar_side(bent(side, np.stack([early, early], axis=1)).drop_vars("position", errors="ignore")) == 0
    assert planar_side(make_recording(TIME, np.zeros((100, 2, 3)))) == 0


def test_a_half_turn_is_counted():
    ds = bent(1.0)
    assert [x_sign(ds), x_sign(half_turn(ds)), x_sign(half_turn(half_turn(ds)))] == [1, -1, 1]
    np.testing.assert_array_equal(half_turn(ds)["position"].values, ds["position"].values * [-1.0, 1.0])


# labels


def test_labels_go_on_where_others_lead():
    time = np.arange(40) / 100
    place = np.zeros((40, 4, 2))
    place[..., 0], place[..., 1] = 0.1 * np.arange(4), 0.002 * np.arange(40)[:, None]
    assert (label_order(place, time) == np.arange(4)).all()
    assert exchanged(place, time, list("abcd")) == {}
    mixed = place.copy()
    mixed[10:20, [1, 2, 3]] = place[10:20, [2, 3, 1]]
    order = label_order(mixed, time)
    assert (order[10:20] == [0, 3, 1, 2]).all()
    assert exchanged(mixed, time, list("abcd")) == {"b-c-d": 10}
    ds = make_recording(time, mixed, frame="planar", station=list("abcd"))
    np.testing.assert_allclose(undo_swaps(ds)["position"], place)
    assert "exchanged labels are undone, frames: b-c-d 10" in undo_swaps(ds).attrs["history"]
    left = exclude_swaps(ds)["position"].values
    assert np.isnan(left[10:20, 1:]).all()
    assert np.isnan(left).sum() == 10 * 3 * 2
    assert "are left out, frames: b-c-d 10" in exclude_swaps(ds).attrs["history"]
    half = place.copy()
    half[15:, [0, 3]] = place[15:, [3, 0]]  # the order of most frames is the right one
    assert exchanged(half, time, list("abcd")) == {"a-d": 15}
    assert _cycles(np.array([1, 0, 2, 4, 3])) == [[0, 1], [3, 4]]
    assert _cycles(np.array([2, 0, 1])) == [[0, 1, 2]]
    lone = label_order(place[:, :1], time)
    assert lone.tolist() == [[0]] * 40
    assert label_order(mixed[:2], time[:2]).tolist() == [[0, 1, 2, 3]] * 2


def test_places_go_on_as_their_last_two_sightings_do():
    time = np.array([0.0, 0.1, 0.2, 0.4])
    place = np.array([[[0.0, 0.0]], [[1.0, 2.0]], [[np.nan, np.nan]], [[9.0, 9.0]]])
    last = _last_seen(place)
    assert last[:, 0].tolist() == [-1, 0, 1, 1]
    np.testing.assert_allclose(_expected(place, last, time, 2, np.array([0])), [[2.0, 4.0]])
    np.testing.assert_allclose(_expected(place, last, time, 3, np.array([0])), [[4.0, 8.0]])
    np.testing.assert_allclose(_expected(place, last, time, 1, np.array([0])), [[0.0, 0.0]])  # seen once: it stays
    late = np.array([0.0, 0.21, 0.3, 0.4])  # sightings farther apart say nothing of its speed
    np.testing.assert_allclose(_expected(place, last, late, 3, np.array([0])), [[1.0, 2.0]])
    near = np.array([0.0, 0.19, 0.3, 0.4])
    np.testing.assert_allclose(_expected(place, last, near, 3, np.array([0])), [[1 + 0.21 / 0.19, 2 + 0.42 / 0.19]])


@pytest.mark.parametrize(("off", "swapped"), [(0.019, True), (0.026, False)])
def test_an_exchange_shortens_the_steps_to_a_quarter(off, swapped):
    time = np.arange(4) / 100
    place = np.tile([[0.0, 0.0], [0.1, 0.0]], (4, 1, 1))
    place[3] = [[0.1, off], [0.0, off]]
    last = _last_seen(place)
    share = off / np.hypot(0.1, off)
    assert (share <= 0.25) == swapped
    found = _continuation(place, last, time, 3)
    assert (found is not None) == swapped
    if swapped:
        assert found.tolist() == [1, 0]
