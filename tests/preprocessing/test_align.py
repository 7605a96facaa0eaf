"""Alignment: the same body, however the tracker's axes lie, ends in the same planar frame."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pliant.errors import InputError
from pliant.preprocessing.align import align, alignment_of
from pliant.preprocessing.rest import before_inputs, rest_window
from pliant.recording import make_recording

TIME = np.arange(500) / 100
CURVATURE = np.where(TIME < 1, 0.0, 6 * (1 - np.exp(-3 * (TIME - 1)) * np.cos(30 * (TIME - 1))))
STATIONS = 12
S = np.linspace(0, 0.17, STATIONS)
NOISE = 2e-5


def arcs(curvature):
    """Circular arcs in the planar frame, positive bending toward -x: (T, S, 2) places and (T, S) angles."""
    k = np.where(np.abs(curvature) < 1e-9, 1e-9, curvature)[:, None]
    place = np.stack([(np.cos(k * S) - 1) / k, np.sin(k * S) / k], -1)
    return place, k * S


def tracked(turn, shift=(0.1, -0.2, 0.5), *, seed=0, pressure=None, stations=slice(None), noise=NOISE):
    place, angle = arcs(CURVATURE)
    local = np.concatenate([place, np.zeros((*place.shape[:2], 1))], -1)
    position = turn.apply(local.reshape(-1, 3)).reshape(local.shape) + shift
    position = position + noise * np.random.default_rng(seed).normal(size=position.shape)
    body = Rotation.from_rotvec(np.stack([0 * angle, 0 * angle, angle], -1).reshape(-1, 3))
    quaternion = (turn * body).as_quat().reshape(*angle.shape, 4)
    names = [f"s{i}" for i in range(STATIONS)]
    return make_recording(
        TIME, position[:, stations], station=np.array(names)[stations], quaternion=quaternion[:, stations],
        pressure=pressure, pressure_time=None if pressure is None else TIME,
    )  # fmt: skip


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from(["motion", "body"]), st.sampled_from(["chord", "clamp"]))
def test_any_rigid_placement_gives_the_same_planar_recording(seed, plane, tangent):
    turn = Rotation.random(rng=seed)
    ds = align(tracked(turn), plane=plane, tangent=tangent)
    place, angle = arcs(CURVATURE)
    # the clamp's tangent comes from three noisy stations: a few mrad
    np.testing.assert_allclose(ds["position"], place, atol=5e-4 if tangent == "chord" else 2e-3)
    np.testing.assert_allclose(ds["angle"], angle, atol=5e-3)
    report = alignment_of(ds)
    assert report.bending == 1
    assert report.out_of_plane_share < 0.02
    assert np.linalg.det(report.rotation) == pytest.approx(1)
    np.testing.assert_allclose(report.rotation, turn.inv().as_matrix(), atol=0.02)
    np.testing.assert_allclose(ds["arc_length"], S, atol=1e-4)


def test_the_tangent_by_every_way_of_saying_it():
    turn = Rotation.from_euler("x", 90, degrees=True)  # body along +z of the tracker
    ds = tracked(turn)
    for tangent in ("chord", "+z", [0, 0, 2.0], "base:+y"):
        np.testing.assert_allclose(alignment_of(align(ds, tangent=tangent)).rotation[1], [0, 0, 1], atol=2e-3)


def test_the_sign_of_bending_is_chosen_and_told():
    ds = tracked(Rotation.identity())
    assert align(ds)["position"].values[-1, -1, 0] < -0.05
    negative = align(ds, bend="negative")
    assert negative["position"].values[-1, -1, 0] > 0.05
    assert alignment_of(negative).bending == -1
    assert negative["angle"].values[-1, -1] < -0.5
    kept = align(ds, bend=None, plane=[0, 0, -1])
    assert alignment_of(kept).bending == -1
    assert alignment_of(align(ds, plane=[0, 0, -1])).bending == 1


def test_planar_recordings_are_turned_where_they_bend_to_the_other_side():
    planar = align(tracked(Rotation.identity()))
    xr.testing.assert_identical(align(planar), planar)
    back = align(planar, bend="negative")
    assert back["position"].values[-1, -1, 0] > 0.05
    np.testing.assert_array_equal(back["angle"], -planar["angle"])
    assert "turned by pi about the base tangent" in back.attrs["history"]
    again = align(back)
    np.testing.assert_array_equal(again["position"], planar["position"])
    assert again["position"].attrs == planar["position"].attrs
    moving = back.isel(time=slice(95, 200))  # never at rest: which way it bends is not known
    assert align(moving)["position"].values[-1, -1, 0] > 0


def test_measured_pressure_decides_the_sign():
    """A body that hangs to one side at rest and is pressed less far to the other."""
    turn = Rotation.identity()
    pressure = np.where((TIME > 0.2) & (TIME < 0.8), 1e5, 0.0)
    ds = tracked(turn, pressure=pressure)
    place = ds["position"].values.copy()
    place[20:80, :, 0] += 0.3 * S
    ds["position"].values[:] = place
    assert alignment_of(align(ds, rest=(0, 0.15))).bending == 1
    assert align(ds, rest=(0, 0.15))["position"].values[50, -1, 0] < 0


def test_the_origin_may_lie_off_the_base_station():
    ds = tracked(Rotation.identity())
    assert align(ds, origin_offset=0.05)["position"].values[0, 0, 1] == pytest.approx(-0.05, abs=1e-4)
    moved = align(ds, origin_offset=[0.0, 0.0, 0.01])
    assert moved["position"].values[0, 0, 1] == pytest.approx(0.0, abs=1e-3)


def test_a_moving_base_is_told_or_removed():
    ds = tracked(Rotation.identity())
    sway = Rotation.from_rotvec(0.02 * np.sin(3 * TIME)[:, None] * [0, 0, 1])
    shift = 0.003 * np.sin(2 * TIME)[:, None, None] * np.array([1.0, 0, 0])
    position = np.einsum("tij,tsj->tsi", sway.as_matrix(), ds["position"].values) + shift
    q = ds["quaternion"].values
    turned = (Rotation.from_quat(np.repeat(sway.as_quat(), STATIONS, 0)) * Rotation.from_quat(q.reshape(-1, 4)))
    swaying = ds.assign(position=ds["position"].copy(data=position),
                        quaternion=ds["quaternion"].copy(data=turned.as_quat().reshape(q.shape)))  # fmt: skip
    kept = align(swaying, rest=(0, 0.02))
    assert alignment_of(kept).base_travel_m > 0.003
    assert "kept as part of the motion" in kept.attrs["history"]
    removed = align(swaying, rest=(0, 0.02), remove_base_motion=True)
    np.testing.assert_allclose(removed["position"], arcs(CURVATURE)[0], atol=5e-4)


def test_what_else_is_in_the_recording_stays():
    pressure = np.where(TIME > 1, 1e5, 0.0)
    ds = tracked(Rotation.identity(), pressure=pressure, stations=[0, 5, 11]).assign_attrs(nominal_pressure=1e5)
    planar = align(ds, base="s0", arc_length=[0, 0.08, 0.17])
    np.testing.assert_array_equal(planar["pressure"], pressure)
    assert planar.attrs["nominal_pressure"] == 1e5
    assert planar["arc_length"].values.tolist() == [0, 0.08, 0.17]
    assert "aligned: base s0" in planar.attrs["history"]


def test_the_rest_window_is_the_still_stretch_before_the_motion():
    start, end = rest_window(tracked(Rotation.identity()))
    assert start == 0.0
    assert 0.85 < end < 1.0


def test_a_pressure_that_rises_after_the_body_moved_says_nothing_of_rest():
    """The log's clock is 0.7 s late: before its rise the body has moved already."""
    late = tracked(Rotation.identity(), pressure=np.where(TIME > 1.7, 1e5, 0.0))
    assert rest_window(late)[1] < 1.0
    assert "the body moves before the pressure does" in align(late).attrs["history"]
    right = tracked(Rotation.identity(), pressure=np.where(TIME > 0.995, 1e5, 0.0))
    assert rest_window(right) == (0.0, pytest.approx(0.99))
    assert "the body moves before" not in align(right).attrs["history"]
    spiky = right.copy(deep=True)
    spiky["position"].values[30, 5] += 0.2  # one bad frame is no motion
    assert rest_window(spiky)[1] == pytest.approx(0.99)


def test_a_body_that_never_rests_asks_for_a_window():
    position = 0.1 * np.sin(6 * TIME[:, None, None] + np.arange(9).reshape(3, 3))
    with pytest.raises(InputError, match="never at rest"):
        rest_window(make_recording(TIME, position))


def test_jumping_orientations_are_refused_or_undone():
    ds = tracked(Rotation.identity())
    q = ds["quaternion"].values.copy()
    flip = Rotation.from_euler("y", 180, degrees=True)
    q[200:300, 6] = (Rotation.from_quat(q[200:300, 6]) * flip).as_quat()
    broken = ds.assign(quaternion=ds["quaternion"].copy(data=q))
    with pytest.raises(InputError, match="s6 2"):
        align(broken)
    np.testing.assert_allclose(align(broken, undo_jumps=True)["angle"], arcs(CURVATURE)[1], atol=5e-3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"base": "foot"}, "base is 'foot', but there is no such station: set base to one of s0"),
        ({"base": "s11"}, "last station is the base"),
        ({"tangent": "up"}, "tangent must be 'chord', 'clamp'"),
        ({"tangent": [0, 0, 0]}, "not all zero"),
        ({"tangent": [1, 2]}, "three finite numbers"),
        ({"tangent": "clamp", "clamp_length": 0.001}, "increase clamp_length"),
        ({"plane": "flat"}, "plane must be 'motion', 'body'"),
        ({"plane": [0, 1, 0]}, "must not be parallel"),
        ({"plane": ["a", 1, 0]}, "three numbers"),
        ({"bend": "left"}, "'positive', 'negative' or None"),
        ({"rest": (90, 91)}, "contains no frame"),
        ({"rest": "start"}, "two times in seconds"),
        ({"rest": (1,)}, "two times in seconds"),
        ({"origin_offset": [1, 2]}, "origin_offset"),
        ({"origin_offset": "far"}, "origin_offset"),
        ({"arc_length": [0, 1]}, "do not match"),
    ],
)
def test_options_that_cannot_be_are_named(options, message):
    with pytest.raises(InputError, match=message):
        align(tracked(Rotation.identity()), **options)


def test_recordings_that_cannot_be_aligned_are_named(rng):
    ds = tracked(Rotation.identity())
    with pytest.raises(InputError, match="needs positions"):
        align(align(ds).drop_vars("position"))
    still = make_recording(TIME, np.array([[0, 0, 0], [0, 0, 0.2]]) + 1e-5 * rng.normal(size=(500, 2, 3)))
    with pytest.raises(InputError, match="no station moves"):
        align(still)
    with pytest.raises(InputError, match="needs the orientation of the base station"):
        align(ds.drop_vars("quaternion"), tangent="base:+x")
    with pytest.raises(InputError, match="remove_base_motion needs the orientation of the base station"):
        align(ds.drop_vars("quaternion"), remove_base_motion=True)
    lost = ds.copy(deep=True)
    lost["position"].values[:100, 3] = np.nan
    with pytest.raises(InputError, match="s3 is never seen in the rest window"):
        align(lost, rest=(0, 0.9))
    with pytest.raises(InputError, match="no report"):
        alignment_of(ds)


def test_sign_comes_from_the_station_that_moves(rng):
    """A standing station that is listed last must not decide the sign by its noise."""
    time = np.arange(200) / 100.0
    lift = np.where(time > 0.5, 0.02, 0.0)
    position = 1e-6 * rng.normal(size=(200, 3, 3))
    position[:, 1, 1] += 0.1
    position[:, 1, 0] += lift
    position[:, 2, 1] += 0.05
    ds = make_recording(time, position, station=["base", "tip", "post"])
    flat = align(ds, base="base", tangent=[0.0, 1.0, 0.0])
    assert flat["position"].sel(station="tip", axis="x").values[-1] < -0.019


@pytest.mark.parametrize(("frames", "found"), [(2, None), (3, (0.0, 0.02)), (4, (0.0, 0.03))])
def test_rest_before_a_pressure_takes_three_frames(frames, found):
    pressure = np.where(np.arange(20) < frames, 0.0, 1e5)
    ds = xr.Dataset({"pressure": ("pressure_time", pressure)},
                    {"time": 0.01 * np.arange(20), "pressure_time": 0.01 * np.arange(20) - 1e-9})  # fmt: skip
    assert before_inputs(ds) == (None if found is None else pytest.approx(found))


def test_poses_that_follow_each_other_at_random_show_a_plane():
    rng = np.random.default_rng(3)
    angle = rng.uniform(-0.6, 0.6, 40)  # one station on an arc in the x-z plane, in another pose in each frame
    tip = 0.1 * np.column_stack([np.sin(angle), 0 * angle, np.cos(angle)]) + 1e-5 * rng.standard_normal((40, 3))
    recording = make_recording(np.arange(40.0), tip[:, None], station=["tip"])
    options = {"origin": [0.0, 0.0, 0.0], "tangent": "+z", "space": True}
    aligned = align(recording, rest=(0.0, 39.0), **options)
    assert abs(alignment_of(aligned).normal[1]) > 0.999
    with pytest.raises(InputError, match="no station moves"):
        align(recording, rest=(0.0, 5.0), **options)
