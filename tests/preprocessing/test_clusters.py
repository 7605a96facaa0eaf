"""Rigid clusters give the pose that moved them; what is no rigid cluster is refused by name."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pliant.errors import InputError
from pliant.preprocessing import rotations
from pliant.preprocessing.clusters import assemble
from pliant.recording import make_recording

SHAPE = np.array([[0.0, 0, 0], [0.05, 0, 0], [0, 0.04, 0], [0, 0, 0.03]])
NAMES = ["Base - 1", "Base - 2", "Base - 3", "Base - 4", "Tip - 1", "Tip - 2", "Tip - 3", "lamp"]
MAPPING = {"base": "Base*", "tip": ["Tip - 1", "Tip - 2", "Tip - 3"]}


@pytest.fixture
def markers(rng):
    turn = Rotation.from_rotvec(np.linspace(0, 1.2, 50)[:, None] * [0, 0.6, 0.8])
    tip = turn.as_matrix()[:, None] @ (SHAPE[:3] - SHAPE[:3].mean(0))[None, ..., None]
    tip = tip[..., 0] + np.linspace(0, 0.1, 50)[:, None, None]
    base = np.broadcast_to(SHAPE, (50, 4, 3))
    points = np.concatenate([base, tip, np.ones((50, 1, 3))], 1) + 1e-5 * rng.normal(size=(50, 8, 3))
    return points, turn


def recording(points):
    return make_recording(np.arange(len(points)) / 100, points, station=NAMES, pressure=np.zeros(len(points)))


def test_poses_are_recovered(markers):
    points, turn = markers
    ds = assemble(recording(points), MAPPING)
    assert ds["station"].values.tolist() == ["base", "tip"]
    relative = turn * turn[0].inv()
    found = Rotation.from_quat(ds["quaternion"].values[:, 1])
    assert (found * relative.inv()).magnitude().max() < 2e-3
    np.testing.assert_allclose(ds["position"].values[:, 0], np.broadcast_to(SHAPE.mean(0), (50, 3)), atol=3e-5)
    assert ds["rigidity"].values.max() < 5e-5
    assert "left out: lamp" in ds.attrs["history"]
    assert "pressure" in ds


def test_a_named_point_and_an_offset_move_with_the_body(markers):
    points, _ = markers
    mapping = {"tip": {"markers": ["Tip*"], "point": "Tip - 2", "offset": [0, 0, 0]}}
    ds = assemble(recording(points), mapping)
    np.testing.assert_allclose(ds["position"].values[:, 0], points[:, 5], atol=5e-5)
    offset = (points[0, 5] - points[0, 4:7].mean(0)).tolist()
    turned = assemble(recording(points), {"tip": {"markers": ["Tip*"], "offset": offset}})
    np.testing.assert_allclose(turned["position"].values[:, 0], points[:, 5], atol=1e-4)


def test_a_marker_may_be_lost_while_three_are_left(markers):
    points, _ = markers
    points[10:20, 1] = np.nan
    points[30, 5] = np.nan
    ds = assemble(recording(points), MAPPING)
    assert np.isfinite(ds["position"].values[10:20, 0]).all()
    assert np.isnan(ds["position"].values[30, 1]).all()
    assert "1 frame(s) lack markers" in ds.attrs["history"]


@pytest.mark.parametrize("markers_of_tip", [["Tip - 1"], ["Tip - 1", "Tip - 2"]])
def test_two_markers_have_no_orientation(markers, markers_of_tip):
    ds = assemble(recording(markers[0]), {"base": "Base*", "tip": markers_of_tip})
    assert np.isnan(ds["quaternion"].values[:, 1]).all()
    assert "no orientation" in ds.attrs["history"]


def test_markers_on_one_line_have_no_orientation():
    points = np.broadcast_to(np.linspace(0, 1, 8)[:, None] * [0.1, 0, 0], (20, 8, 3))
    assert "quaternion" not in assemble(recording(points), {"tip": ["Tip*"]})


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        ({"tip": ["Tip - 9"]}, "'Tip - 9' that is not in the recording: correct the name; available: Base - 1"),
        ({"base": "Base*", "tip": ["Base - 4", "Tip*"]}, "belongs to two stations, 'base' and 'tip'"),
        ({"base_left": ["Base - 1"], "base_right": ["Base - 2"]}, "2 clusters have the role base"),
        ({"a": {"markers": ["Tip*"], "role": "base"}, "base": "Base*"}, "2 clusters have the role base"),
        ({"tip": {"markers": ["Tip*"], "point": "lamp"}}, "not among its markers"),
        ({"tip": {"markers": ["Tip*"], "colour": 1}}, "unknown key 'colour'"),
        ({"tip": {"markers": ["Tip - 1"], "offset": [0, 0, 1]}}, "has an offset, which needs an orientation"),
        ({"all": ["Base*", "Tip*"]}, "do not move as one rigid part"),
        ({"tip": []}, "has no marker"),
        ({}, "no cluster"),
    ],
)
def test_wrong_mappings_are_named(markers, mapping, message):
    with pytest.raises(InputError, match=message):
        assemble(recording(markers[0]), mapping)


def test_rotations_agree_with_an_independent_implementation():
    turn = Rotation.random(200, rng=1)
    matrix = turn.as_matrix()
    np.testing.assert_allclose(rotations.to_matrix(turn.as_quat()), matrix, atol=1e-14)
    np.testing.assert_allclose(rotations.to_matrix(rotations.from_matrix(matrix)), matrix, atol=1e-14)
    axis = np.array([1.0, 2, 3]) / np.sqrt(14)
    q = turn.as_quat()
    twist = 2 * np.arctan2(q[:, :3] @ axis, q[:, 3])
    np.testing.assert_allclose(rotations.angle_about(matrix, axis), (twist + np.pi) % (2 * np.pi) - np.pi, atol=1e-12)


def test_signs_of_quaternions_are_made_continuous():
    q = np.tile([0.0, 0, 0, 1], (6, 1, 1))
    q[2:4] *= -1
    q[3] = np.nan
    result, turned = rotations.continuous(q)
    assert turned == 1
    assert np.nanmin(result[..., 3]) == 1


@pytest.mark.parametrize("kind", ["noisy", "flat", "mirrored"])
def test_the_best_rotation_is_one_even_where_a_reflection_lies_nearer(kind):
    rng = np.random.default_rng(7)
    shape = rng.normal(size=(6, 3)) * [1.0, 1.0, 0.0 if kind == "flat" else 0.8] + [0.3, 0.0, -1.0]
    turn = Rotation.random(5, random_state=8)
    mirror = [1.0, 1.0, -1.0 if kind == "mirrored" else 1.0]
    seen = np.einsum("tij,nj->tni", turn.as_matrix(), shape - shape.mean(0)) * mirror
    seen = seen + 0.02 * rng.normal(size=seen.shape) + rng.normal(size=(5, 1, 3))
    found = rotations.best_rotation(shape, seen)
    np.testing.assert_allclose(np.linalg.det(found), 1.0)
    for k in range(5):
        best, _ = Rotation.align_vectors(seen[k] - seen[k].mean(0), shape - shape.mean(0))
        np.testing.assert_allclose(found[k], best.as_matrix(), atol=1e-6)


def test_the_mean_rotation_is_one_even_of_turns_far_apart():
    turns = Rotation.random(40, random_state=9).as_matrix().reshape(20, 2, 3, 3)
    far = Rotation.from_rotvec(np.pi * np.eye(3) * 0.97).as_matrix()[:, None]
    for rows in (turns, far):
        found = rotations.mean_rotation(rows)
        np.testing.assert_allclose(np.linalg.det(found), 1.0)
        for s in range(rows.shape[1]):
            np.testing.assert_allclose(found[s], Rotation.from_matrix(rows[:, s]).mean().as_matrix(), atol=1e-9)
    some = turns.copy()
    some[3, 0], some[:, 1] = np.nan, np.nan
    rest = Rotation.from_matrix(np.delete(turns[:, 0], 3, axis=0)).mean().as_matrix()
    np.testing.assert_allclose(rotations.mean_rotation(some)[0], rest, atol=1e-9)
    assert np.isnan(rotations.mean_rotation(some)[1]).all()
