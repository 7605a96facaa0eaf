"""Public recordings in space are read by the mapping of a table alone: rates, motors, tendons, labels."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.preprocessing.align import align, alignment_of
from pliant.preprocessing.held import leave_out_frozen
from pliant.preprocessing.quality import quality
from pliant.recording import read
from pliant.recording.inputs import recorded_inputs
from pliant.study.draft_inputs import tendon_ends

DISKS = {name: {"position": [f"{axis}{k}" for axis in "xyz"]} for k, name in ((1, "top"), (2, "middle"), (3, "tip"))}
MOTORS = {"columns": [f"phi{k}" for k in range(1, 7)], "kind": "angle", "unit": "deg"}
TRUNK = {"header": True, "rate_hz": 100.0, "length_unit": "m", "stations": DISKS, "inputs": MOTORS}


def test_the_trunk_by_rate_and_motor_angles(shared_data):
    ds = read(shared_data / "spatial_tendon_trunk" / "observations_controlled_3.csv", mapping=TRUNK)
    assert dict(ds.sizes) == {"time": 1001, "station": 3, "axis": 3, "input_time": 1001, "input": 6}
    assert ds["time"].values[-1] == pytest.approx(10.0)
    assert np.rad2deg(ds["actuation"].values[0, 0]) == pytest.approx(-2.9921875)
    found = quality(ds)
    assert found.out_of_plane_share > 0.5
    body = align(ds, base="top", tangent="-y", rest=[0, 0.05], origin=[0.1018, 0.0, 0.105], space=True)
    np.testing.assert_allclose(body["position"].values[:, :, 2], -ds["position"].values[:, :, 1], atol=1e-12)
    assert alignment_of(body).flatness > 0.8
    assert [one.name for one in recorded_inputs(body)] == MOTORS["columns"]


def test_frozen_disks_and_held_angles_of_the_trunk(shared_data):
    ds = read(shared_data / "spatial_tendon_trunk" / "observations_controlled_3.csv", mapping=TRUNK)
    found = quality(ds)
    frames = [(round(100 * a), round(100 * b), count) for a, b, count in found.frozen["tip"]]
    assert frames == [(385, 435, 51), (885, 934, 50)]  # as read off the file by eye
    assert "middle" not in found.frozen
    assert found.input_held == {f"phi{k}": (5, pytest.approx(0.05)) for k in range(1, 7)}
    left = leave_out_frozen(ds)["position"].values
    assert np.isnan(left[385:436, 2]).all()
    assert np.isfinite(left[384, 2]).all()
    assert np.array_equal(np.isnan(left).any(-1).sum(0), [15, 0, 101])


def test_the_trunk_at_rest_has_orientations(shared_data):
    posed = {name: {**entry, "quaternion": [f"qx{k}", f"qy{k}", f"qz{k}", f"w{k}"]}
             for k, (name, entry) in enumerate(DISKS.items(), start=1)}  # fmt: skip
    ds = read(shared_data / "spatial_tendon_trunk" / "observations_zeros_0g.csv", mapping=TRUNK | {"stations": posed})
    assert not quality(ds).orientation_jumps
    body = align(ds, base="top", tangent="-y", rest=[0, 5], space=True)
    turned = 2 * np.linalg.norm(body["quaternion"].values[..., :3], axis=-1)
    assert turned.max() < np.deg2rad(0.5)  # at rest, though each disk's axes lie elsewhere


def test_the_robot_with_labels_and_tendon_displacements(shared_data):
    servos = [f"servo_{k}_mm" for k in (4, 3, 9, 5, 2, 8, 6, 1, 7)]
    ds = read(shared_data / "spatial_tendon_robot" / "v4_tendon_pull.csv", mapping={
        "header": True, "time": "timestamp", "length_unit": "mm",
        "stations": {"tip": {"position": ["tip_x", "tip_y", "tip_z"]}},
        "inputs": {"columns": servos, "kind": "displacement", "unit": "mm"},
    })  # fmt: skip
    assert dict(ds.sizes) == {"time": 134, "station": 1, "axis": 3, "input_time": 134, "input": 9}
    assert ds["actuation"].values[0, 0] == pytest.approx(-0.061359e-3)
    assert "pattern_label" in ds.attrs["history"]


def test_the_tentacle_by_index(shared_data):
    ds = read(shared_data / "spatial_tentacle" / "m1_u01.csv", mapping={
        "time": 1, "length_unit": "m", "points": {"count": 5, "first": 2}})  # fmt: skip
    assert dict(ds.sizes) == {"time": 1160, "station": 5, "axis": 3}
    spread = np.ptp(ds["position"].values, axis=0).max()
    assert spread < 0.02  # a static pose


def test_where_the_tendons_of_each_motor_end(shared_data):
    file = shared_data / "spatial_tendon_trunk" / "observations_controlled_1.csv"
    ds = read(file, mapping=TRUNK | {"rows": [0, 6000]})
    body = align(leave_out_frozen(ds), base="top", tangent="-y", rest=[0, 0.05], origin=[0.1018, 0.0, 0.105],
                 space=True)  # fmt: skip
    disks = np.median(body["position"].values[:10, :, 2], axis=0)
    ends = [int(np.argmin(abs(disks - end))) for _, end in tendon_ends(body, 6, held=True)]
    assert ends == [1, 2, 0, 2, 0, 1]  # of motors 1 to 6; as fits of all geometry to 150 s find them
