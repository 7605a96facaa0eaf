"""The base frame, its directions and what is counted on the way, against cases worked out by hand."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pliant.errors import InputError
from pliant.preprocessing import detectors
from pliant.preprocessing.align import _out_of_plane, align, alignment_of
from pliant.preprocessing.angles import coarse_steps, from_rest, turns_back
from pliant.preprocessing.arc_length import station_arc_length, whole_frames
from pliant.preprocessing.base import base_rotation_at_rest, base_tangent
from pliant.preprocessing.clusters import assemble
from pliant.preprocessing.labels import exclude_swaps, undo_swaps
from pliant.preprocessing.quality import quality
from pliant.preprocessing.repair import undo_orientation_jumps
from pliant.preprocessing.rest import rest_window
from pliant.preprocessing.rotations import to_matrix
from pliant.preprocessing.sync import shift_pressure, sync
from pliant.recording import make_recording

TIME = np.arange(200) / 100
SWING = np.where(TIME > 1, np.sin(20 * (TIME - 1)), 0.0)


def poses(lost=()):
    """Five stations on a body that swings about z after 1 s, with orientations; the base moves and turns a little."""
    place = np.zeros((200, 5, 3))
    place[..., 1] = 0.05 * np.arange(5)
    place[..., 0] = -0.02 * SWING[:, None] * np.arange(5) ** 2 / 16
    place[:, 0, 1] += 0.001 * np.abs(SWING)
    turn = 0.3 * SWING[:, None] * (0.1 + np.arange(5) / 4)
    quaternion = np.zeros((200, 5, 4))
    quaternion[..., 2], quaternion[..., 3] = np.sin(turn / 2), np.cos(turn / 2)
    for frame, station in lost:
        quaternion[frame, station] = np.nan
    return place, quaternion, turn


def moved(place, quaternion, turn, shift):
    """The same body under a tracker that stands elsewhere."""
    turned = turn.apply(place.reshape(-1, 3)).reshape(place.shape) + shift
    frames = (turn * Rotation.from_quat(np.nan_to_num(quaternion, nan=0.5).reshape(-1, 4))).as_quat()
    return turned, np.where(np.isnan(quaternion), np.nan, frames.reshape(quaternion.shape))


OPTIONS = [
    {"origin_offset": 0.01},
    {"remove_base_motion": True, "tangent": "clamp", "clamp_length": 0.06},
    {"space": True, "tangent": "base:+y", "origin_offset": -0.02},
    {"space": True, "remove_base_motion": True, "plane": "base:+z", "tangent": "base:+y"},
    {"plane": "body", "tangent": "base:+y"},
]


@pytest.mark.parametrize("options", OPTIONS)
def test_a_recording_is_the_same_wherever_the_tracker_stands(options):
    place, quaternion, _ = poses(lost=[(3, 1), (150, 2)])
    made = []
    for turn, shift in ((Rotation.identity(), [0, 0, 0]), (Rotation.from_rotvec([0.4, -1.1, 0.7]), [3.0, -2.0, 0.5])):
        there, frames = moved(place, quaternion, turn, shift)
        made.append(align(make_recording(TIME, there, quaternion=frames), rest=(0.0, 0.9), **options))
    one, two = made
    np.testing.assert_allclose(one["position"], two["position"], atol=1e-10)
    name = "quaternion" if "space" in options else "angle"
    np.testing.assert_allclose(one[name], two[name], atol=1e-9)
    assert np.isnan(one[name].values[3, 1]).all()
    assert np.isfinite(np.delete(one[name].values, [3, 150], axis=0)).all()
    first, second = (alignment_of(ds) for ds in made)
    for field in ("flatness", "out_of_plane_rms_m", "out_of_plane_max_m", "out_of_plane_share", "base_travel_m",
                  "bending"):  # fmt: skip
        assert getattr(first, field) == pytest.approx(getattr(second, field), abs=1e-7), field
    assert first.base_travel_m == pytest.approx(0.001 * np.abs(SWING).max(), rel=1e-6)
    np.testing.assert_allclose(second.origin, turn.apply(first.origin) + np.array(shift), atol=1e-9)


def test_the_motion_of_the_base_is_taken_out():
    """The base stands and does not turn; every other station moves as seen from it."""
    place, quaternion, turn = poses()
    ds = make_recording(TIME, place + np.array([1.0, 2.0, 3.0]), quaternion=quaternion)
    made = align(ds, rest=(0.0, 0.9), tangent="+y", plane="+z", bend=None, remove_base_motion=True)
    back = Rotation.from_rotvec(np.outer(-turn[:, 0], [0, 0, 1]))
    for s in range(5):
        expected = back.apply(place[:, s] - place[:, 0])[:, :2]
        np.testing.assert_allclose(made["position"].values[:, s], expected, atol=1e-12)
        np.testing.assert_allclose(made["angle"].values[:, s], turn[:, s] - turn[:, 0], atol=1e-9)
    assert "its motion is removed" in made.attrs["history"]
    quaternion[:91, 0] = np.nan  # the base shows its orientation later only
    for ds in (make_recording(TIME, place, quaternion=quaternion), make_recording(TIME, place)):
        with pytest.raises(InputError, match="remove_base_motion needs the orientation of the base station"):
            align(ds, rest=(0.0, 0.9), tangent="+y", plane="+z", remove_base_motion=True)


def test_an_origin_is_one_number_or_three_and_finite():
    place, _, _ = poses()
    ds = make_recording(TIME, place)
    for wrong in ([0.0, np.nan, 0.0], [0.0, 0.1], "far", [[0.1]], np.nan):
        with pytest.raises(InputError, match="a length along the tangent or three numbers"):
            align(ds, rest=(0.0, 0.9), origin_offset=wrong)
    found = align(ds, rest=(0.0, 0.9), tangent="+y", plane="+z", bend=None, origin_offset=[0.01, 0.02, 0.03])
    np.testing.assert_allclose(found["position"].values[0, :, 0], -0.01)
    np.testing.assert_allclose(found["position"].values[0, :, 1], 0.05 * np.arange(5) - 0.02)


def test_one_point_out_of_the_plane():
    found = _out_of_plane(np.array([[[1.0, 2.0, 2.0]]]), np.zeros((1, 3)), np.array([0.0, 0.0, 1.0]))
    assert found == {"out_of_plane_rms_m": 2.0, "out_of_plane_max_m": 2.0, "out_of_plane_share": pytest.approx(2 / 3)}


def test_directions_at_a_base_that_is_not_the_first_station():
    rest = np.array([[5.0, 5.0, 5.0], [0, 0, 0], [0, 0.1, 0], [0, 0.2, 0], [0.2, 0.2, 0]])
    np.testing.assert_allclose(base_tangent("chord", rest, 1, None, None), np.array([1.0, 1.0, 0]) / np.sqrt(2))
    np.testing.assert_allclose(base_tangent("clamp", rest, 1, None, None), [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(base_tangent("clamp", rest, 1, None, 0.21), [0, 1, 0], atol=1e-12)
    bent = np.array([[0.0, 0, 0], [0.03, 0.04, 0], [0.06, 0.08, 0], [0.5, 0.08, 0.0]])
    np.testing.assert_allclose(base_tangent("clamp", bent, 0, None, 0.1001), [0.6, 0.8, 0], atol=1e-12)
    with pytest.raises(InputError, match="two stations in the clamp, but there is 1 within"):
        base_tangent("clamp", bent, 0, None, 0.049)
    dense = np.column_stack([np.append(0.002, np.zeros(9)), 0.005 * np.arange(10), np.zeros(10)])  # its end: off
    np.testing.assert_allclose(base_tangent("clamp", dense, 0, None, None), [0, 1, 0], atol=1e-12)
    assert base_tangent("clamp", dense[:9], 0, None, None)[0] < -0.1
    quaternion = np.tile([0.0, 0.0, 0.0, 1.0], (4, 2, 1))
    quaternion[:, 1, 0] = np.nan  # three of four numbers are no orientation
    window = np.ones(4, bool)
    np.testing.assert_allclose(base_rotation_at_rest(to_matrix(quaternion), 0, window), np.eye(3))
    assert base_rotation_at_rest(to_matrix(quaternion), 1, window) is None
    assert base_rotation_at_rest(None, 0, window) is None


@pytest.mark.parametrize(
    "step",
    [
        align, from_rest, sync, assemble, rest_window, quality, undo_swaps, exclude_swaps, undo_orientation_jumps,
        lambda ds: shift_pressure(ds, 0.1),
    ],
)  # fmt: skip
def test_every_step_refuses_what_is_no_recording(step):
    place, quaternion, _ = poses()
    ds = make_recording(TIME, place, quaternion=quaternion, pressure=5e4 * SWING**2)
    step = (lambda recording: assemble(recording, {"base": "s000"})) if step is assemble else step
    if step is from_rest:
        ds = make_recording(TIME, angle=0.3 * SWING[:, None], frame="planar", pressure=5e4 * SWING**2)
    if step is sync:
        ds = ds.drop_vars("quaternion")
    with pytest.raises(InputError, match="schema"):
        step(ds.assign_attrs(schema="another"))


# angles and arc lengths


def test_the_rest_of_angles_has_both_its_ends():
    angle = np.zeros((200, 1))
    angle[:, 0] = np.arange(200)
    ds = make_recording(TIME, angle=angle, frame="planar")
    assert from_rest(ds, (0.1, 0.11))["angle"].values[0, 0] == pytest.approx(-10.5)
    assert from_rest(ds, (0.1, 0.12))["angle"].values[0, 0] == pytest.approx(-11.0)


def test_the_pressure_at_the_start_is_the_median_of_five_samples():
    pressure = np.array([0.0, 0.0, 0.0, 10.0, 10.0, 10.0, 4.0, 4.0])
    angle = np.array([0.0, 0, 0, 0, 0, 0, 1.0, 1.0])
    for columns in (pressure, pressure[:, None]):
        ds = make_recording(np.arange(8.0), angle=angle[:, None], frame="planar", pressure=columns,
                            chamber=None if columns.ndim == 1 else ["a"])  # fmt: skip
        assert not turns_back(ds, angle)
        assert turns_back(ds, -angle)


def test_steps_of_a_two_hundredth_of_the_range_are_fine():
    counts = np.concatenate([np.arange(201), np.arange(200, -1, -1), [0, 1] * 20]) * 0.25
    assert coarse_steps(counts[:, None]) == [0.0]
    assert coarse_steps(counts[counts < 50.0][:, None]) == [0.25]


def test_stations_that_meet_in_some_frames_are_two_and_a_missing_arc_length_is_refused():
    place = np.zeros((4, 3, 2))
    place[..., 1] = [0.0, 0.01, 0.02]
    place[2, 1] = place[2, 0]
    ds = make_recording(np.arange(4.0), place, frame="planar")
    arc, _ = station_arc_length(ds, place)
    np.testing.assert_allclose(arc, [0.0, 0.0075, 0.02])
    assert whole_frames(ds)[2] == 0
    place[:, 1] = place[:, 0]
    with pytest.raises(InputError, match="stations 0 and 1, counted from 0, coincide"):
        station_arc_length(ds, place)
    unknown = ds.assign_coords(arc_length=("station", [0.0, np.nan, 0.02]))
    with pytest.raises(InputError, match="must increase strictly"):
        station_arc_length(unknown, ds["position"].values)


# clusters


def marked(noise=0.0, frames=50):
    """Three markers that turn together, and two on a line; the first is off by `noise` to both sides in turn."""
    shape = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0.3, 0, 0], [0.4, 0, 0]])
    place = np.tile(shape, (frames, 1, 1))
    place[:, 0, 2] = noise * (-1.0) ** np.arange(frames)
    return place


@pytest.mark.parametrize(("noise", "rigid"), [(5e-3, True), (8e-3, False)])
def test_markers_of_one_part_deviate_by_a_millimetre_at_most(noise, rigid):
    """A marker of three by n out of their plane: they tilt, and the best fit leaves a part of n."""
    place = marked()
    place[::2, 0, 0] += noise * 0.3
    place[1::2, 0, 0] -= noise * 0.3
    ds = make_recording(np.arange(50) / 10, place, station=list("abcde"))
    if rigid:
        made = assemble(ds, {"base": ["a", "b", "c"], "tip": ["d", "e"]})
        assert float(made["rigidity"][0]) < 1e-3
        return
    with pytest.raises(InputError, match=r"do not move as one rigid part: they deviate by 1\.\d\d mm .* 1\.00 mm"):
        assemble(ds, {"base": ["a", "b", "c"]})


def test_the_residual_is_the_root_mean_square_over_markers():
    """Two of four markers on a square are off by d along a diagonal, outwards and inwards in turn."""
    square = np.array([[1.0, 0, 0], [0, 1.0, 0], [-1.0, 0, 0], [0, -1.0, 0]]) * 0.1
    place = np.tile(square, (100, 1, 1))
    sign = (-1.0) ** np.arange(100)
    place[:, 0, 0] += 2e-4 * sign
    place[:, 2, 0] -= 2e-4 * sign
    place[40:46, 0, 0] += 1e-4 * sign[40:46]  # six in a hundred frames beyond the 95th percentile
    place[40:46, 2, 0] -= 1e-4 * sign[40:46]
    ds = make_recording(np.arange(100) / 10, place, station=list("abcd"))
    made = assemble(ds, {"base": list("abcd")})
    residual = np.sqrt(2 * np.append(np.full(94, 2e-4), np.full(6, 3e-4)) ** 2 / 4)
    assert float(made["rigidity"][0]) == pytest.approx(np.percentile(residual, 95), rel=1e-3)


def test_a_marker_without_one_coordinate_is_lost():
    place = marked()
    place[7, 3, 2] = np.nan
    place[9, 1, 0] = np.nan
    ds = make_recording(np.arange(50) / 10, place, station=list("abcde"))
    made = assemble(ds, {"base": ["a", "b", "c"], "tip": ["d", "e"]})
    assert "tip: position of 2 marker(s), no orientation, 1 frame(s) lack markers" in made.attrs["history"]
    assert "base: pose of 3 markers, rigid within 0.000 mm (95 % of the frames), 1 frame(s)" in made.attrs["history"]
    assert np.flatnonzero(np.isnan(made["position"].values[:, 0]).any(-1)).tolist() == [9]
    planar = make_recording(np.arange(3.0), np.zeros((3, 2, 2)), frame="planar")
    log = make_recording(pressure=np.arange(3.0), pressure_time=np.arange(3.0))
    for other in (planar, log):
        with pytest.raises(InputError, match="assemble them before the alignment"):
            assemble(other, {"base": "s000"})


# detectors


def test_means_of_what_was_seen_once_or_in_part():
    place = np.full((600, 2, 3), np.nan)
    place[3, 0] = [1.0, 2.0, 3.0]
    place[:, 1] = [4.0, np.nan, 4.0]
    found = detectors.mean_place(place)
    np.testing.assert_allclose(found[0], [1.0, 2.0, 3.0])
    assert np.isnan(found[1]).all()
    place[595, 0] = [3.0, 4.0, 5.0]
    np.testing.assert_allclose(detectors.mean_place(place)[0], [2.0, 3.0, 4.0])


def test_jumps_of_orientation_are_counted_from_sighting_to_sighting():
    half = np.radians(np.array([0.0, 0.0, 40.0, 40.0, 69.0, 100.0])) / 2
    q = np.stack([0 * half, 0 * half, np.sin(half), np.cos(half)], axis=1)[:, None]
    assert detectors.orientation_jumps(q).tolist() == [2]
    lost = np.insert(q, 2, [[[np.nan, 0.0, 0.0, 1.0]]], axis=0)
    assert detectors.orientation_jumps(np.insert(lost, 5, np.nan, axis=0)).tolist() == [2]


def test_a_fault_at_the_edge_is_compared_with_the_frame_at_the_edge():
    for row in (1, 2, 38, 39):
        size = np.zeros((41, 1))
        size[row] = 100.0
        assert detectors._stands_out(size, 2, np.array([50.0]))[row, 0]
        assert not detectors._stands_out(size, 2, np.array([100.0])).any()


def test_a_station_that_was_never_seen_is_out_of_no_plane():
    place = np.random.default_rng(1).normal(size=(50, 3, 3)) * [1.0, 0.0, 0.1] + np.arange(3)[:, None] * [0, 9.0, 0]
    place[:, 1] = np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert 0.0 < detectors.out_of_plane_share(place) < 0.2
        assert np.isnan(detectors.travel(place)).tolist() == [False, True, False]
