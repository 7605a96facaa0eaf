"""Alignment in space: the same body, however the tracker's axes lie, ends in the same base frame."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pliant.errors import InputError
from pliant.preprocessing.align import align, alignment_of
from pliant.preprocessing.quality import quality
from pliant.preprocessing.rest import rest_window
from pliant.recording import make_recording, read, write

TIME = np.arange(300) / 50
S = np.linspace(0, 0.2, 6)
TOWARDS_Y = 2 * np.where(TIME < 1, 0.0, np.sin(3 * (TIME - 1)))  # 1/m: curvature of a circular arc by its direction
TOWARDS_X = 0.8 * np.where(TIME < 1, 0.0, np.sin(7 * (TIME - 1)))


def body(x=TOWARDS_X, y=TOWARDS_Y):
    """Circular arcs in the base frame, z along the base: (T, S, 3) places and (T, S, 3) swings about z x direction."""
    size = np.maximum(np.hypot(x, y), 1e-9)
    angle = size[:, None] * S
    away = (1 - np.cos(angle)) / size[:, None]
    place = np.stack([away * (x / size)[:, None], away * (y / size)[:, None], np.sin(angle) / size[:, None]], -1)
    axis = np.stack([-y / size, x / size, 0 * x], -1)
    return place, axis[:, None] * angle[..., None]


def tracked(turn, shift=(0.3, -0.1, 0.7), *, noise=1e-5, orientations=True, parts=None, **inputs):
    place, swing = body(**(parts or {}))
    position = turn.apply(place.reshape(-1, 3)).reshape(place.shape) + shift
    position = position + noise * np.random.default_rng(0).normal(size=position.shape)
    marked = Rotation.random(S.size, rng=3)  # how the markers sit on each part
    bodies = [turn * Rotation.from_rotvec(swing[:, s]) * marked[s] for s in range(S.size)]
    quaternion = np.stack([b.as_quat() for b in bodies], 1) if orientations else None
    return make_recording(TIME, position, station=["base", *"abcd", "tip"], quaternion=quaternion, **inputs)


def rotations(ds):
    return Rotation.from_quat(ds["quaternion"].values.reshape(-1, 4))


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10_000))
def test_any_rigid_placement_gives_the_same_places_and_orientations(seed):
    turn = Rotation.random(rng=seed)
    across = turn.apply([1.0, 0, 0])
    ds = align(tracked(turn), space=True, plane=across)
    place, swing = body()
    np.testing.assert_allclose(ds["position"], place, atol=2e-4)
    apart = rotations(ds).inv() * Rotation.from_rotvec(swing.reshape(-1, 3))
    assert apart.magnitude().max() < 1e-3
    assert ds["quaternion"].attrs["reference"] == "rest"
    report = alignment_of(ds)
    np.testing.assert_allclose(report.rotation, turn.inv().as_matrix(), atol=2e-3)
    np.testing.assert_allclose(report.normal, across, atol=2e-3)
    np.testing.assert_allclose(report.base_tangent, turn.apply([0, 0, 1.0]), atol=2e-3)
    out = (place - place.mean(axis=0))[..., 0]
    assert report.out_of_plane_rms_m == pytest.approx(np.sqrt((out**2).mean()), rel=0.02)


def test_the_base_frame_in_space_is_the_planar_one_with_its_axes_named_anew():
    ds = tracked(Rotation.random(rng=1), parts={"x": 0 * TIME, "y": -TOWARDS_Y})
    flat, space = align(ds), align(ds, space=True)
    np.testing.assert_array_equal(space["position"].values[..., 1:], flat["position"])
    assert np.abs(space["position"].values[..., 0]).max() < 1e-4  # the noise
    assert alignment_of(space).normal == alignment_of(flat).normal
    assert alignment_of(space).out_of_plane_rms_m == alignment_of(flat).out_of_plane_rms_m
    np.testing.assert_allclose(rotations(space).as_rotvec()[:, 0], flat["angle"].values.ravel(), atol=1e-6)
    assert "left out" in flat.attrs["history"]
    assert "left out" not in space.attrs["history"]


@pytest.mark.parametrize("kind", ["pressure", "angle"])
def test_the_first_input_gives_the_plane_and_its_sign(kind):
    turn = Rotation.random(rng=2)
    first, second = -3e3 * TOWARDS_Y, 5e3 * TOWARDS_X  # the first bends towards -y, about +x
    inputs = np.stack([first, second], -1)
    given = {"pressure": inputs} if kind == "pressure" else {"actuation": 1e-4 * inputs, "input_kind": "angle"}
    ds = align(tracked(turn, **given), space=True, plane="input")
    np.testing.assert_allclose(alignment_of(ds).normal, turn.apply([1.0, 0, 0]), atol=5e-3)
    swapped = {name: value[:, ::-1] if np.ndim(value) else value for name, value in given.items()}
    other = align(tracked(turn, **swapped), space=True, plane="input")
    np.testing.assert_allclose(alignment_of(other).normal, turn.apply([0, 1.0, 0]), atol=5e-3)
    flat = align(tracked(turn, **given), plane="input")  # the plane's rule is the same
    assert alignment_of(flat).bending == 1
    np.testing.assert_allclose(alignment_of(flat).normal, alignment_of(ds).normal, atol=1e-12)
    with pytest.raises(InputError, match="holds none"):
        align(tracked(turn), space=True, plane="input")


def test_markers_on_the_base_and_axes_of_the_tracker_give_the_direction_of_x():
    turn = Rotation.from_euler("x", 30, degrees=True)
    ds = tracked(turn)
    marked = Rotation.random(S.size, rng=3)[0]  # of the base
    wanted = turn.apply(marked.apply([0, 1.0, 0]))
    tangent = turn.apply([0, 0, 1.0])
    wanted = wanted - (wanted @ tangent) * tangent
    found = alignment_of(align(ds, space=True, plane="base:+y", tangent=tangent)).normal
    np.testing.assert_allclose(found, wanted / np.linalg.norm(wanted), atol=1e-6)
    np.testing.assert_allclose(alignment_of(align(ds, space=True, plane="+x", tangent=tangent)).normal, [1, 0, 0],
                               atol=1e-12)  # fmt: skip
    np.testing.assert_allclose(alignment_of(align(ds, space=True, plane="-x", tangent=tangent)).normal, [-1, 0, 0],
                               atol=1e-12)  # fmt: skip
    with pytest.raises(InputError, match="orientation"):
        align(tracked(turn, orientations=False), space=True, plane="base:+y")


def test_an_origin_that_no_station_shows():
    ds = tracked(Rotation.identity())
    moved = align(ds, space=True, plane="+x", tangent="+z", origin=[0.3, -0.1, 0.65])
    np.testing.assert_allclose(moved["position"], body()[0] + [0, 0, 0.05], atol=2e-4)
    with pytest.raises(InputError, match="origin"):
        align(ds, origin=[0, 0, 0], origin_offset=0.1)


def test_an_aligned_recording_in_space_survives_files(tmp_path):
    ds = align(tracked(Rotation.random(rng=4), actuation=np.stack([TIME, TIME**2], -1),
                       input_kind=["tension", "angle"], input_names=["cable", "motor"]), space=True)  # fmt: skip
    write(ds, tmp_path / "a.nc")
    back = read(tmp_path / "a.nc")
    assert back.drop_attrs().equals(ds.drop_attrs())
    assert list(back["kind"].values) == ["tension", "angle"]
    assert back["quaternion"].attrs["reference"] == "rest"
    with pytest.raises(InputError, match=r"wide CSV cannot hold .*actuation"):
        write(ds, tmp_path / "a.csv")
    write(ds.drop_dims("input_time").drop_vars(["input", "kind"], errors="ignore"), tmp_path / "a.csv")
    np.testing.assert_array_equal(read(tmp_path / "a.csv")["position"], ds["position"])


def test_inputs_of_any_kind_end_the_rest_and_show_their_range():
    still = np.where(TIME < 1.5, 0.0, np.sin(TIME - 1.5))
    inputs = np.stack([0.1 * still, 3 + 0 * TIME], -1)
    ds = tracked(Rotation.identity(), actuation=inputs, input_kind=["angle", "tension"], input_names=["motor", "cable"],
                 parts={"x": 0 * TIME, "y": -2 * still})  # fmt: skip
    start, end = rest_window(ds)
    assert start == 0
    assert end == TIME[np.argmax(np.abs(still) > 0.05 * np.ptp(still)) - 1]
    found = quality(ds)
    assert found.input_range["motor"][1:] == (pytest.approx(5.7296, rel=0.01), "degrees")
    assert "input cable: 3 to 3 N" in found.summary()
    holed = ds.assign(actuation=ds["actuation"].where(ds["input_time"] > 0.1))
    assert "12 samples of inputs other than pressure are missing" in quality(holed).summary()


def test_faults_of_rigid_bodies_are_counted_and_undone_before_the_base_frame():
    turn = Rotation.random(rng=6)
    clean = tracked(turn, noise=0.0)
    q = clean["quaternion"].values.copy()
    flip = np.array([0.0, 0.0, 1.0, 0.0])  # half a turn about the markers' own z, which they do not tell apart
    q[100:160, 3] = (Rotation.from_quat(q[100:160, 3]) * Rotation.from_quat(flip)).as_quat()
    q[200:, 1] *= -1.0
    q[120, 5] = (Rotation.from_quat(q[120, 5]) * Rotation.from_rotvec([0.2, 0, 0])).as_quat()
    faulty = clean.assign(quaternion=clean["quaternion"].copy(data=q))
    found = quality(faulty)
    assert found.orientation_jumps == {"c": 2}
    assert found.sign_flips["a"] == 1
    assert found.orientation_spikes == {"tip": 1}
    assert not quality(clean).orientation_spikes
    with pytest.raises(InputError, match=r"jumps by more than 30 degrees .*\(c 2\)"):
        align(faulty, space=True)
    mended, wanted = align(faulty, space=True, undo_jumps=True), align(clean, space=True)
    assert "frames rotated back: c 60" in mended.attrs["history"]
    apart = (rotations(mended).inv() * rotations(wanted)).magnitude().reshape(-1, 6)
    assert apart[np.arange(300) != 120].max() < 0.01  # the turn is known to the motion between two frames
    assert apart[120, 5] == pytest.approx(0.2, abs=1e-6)  # a spike stays, for a robust loss to pass over
