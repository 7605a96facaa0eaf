"""Swings against SciPy's rotations, and chains against their own directions."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pliant.reduction.links import link_frames, swing_matrices, swings_along, swings_to


@settings(max_examples=50)
@given(st.floats(-7, 7), st.floats(-7, 7))
def test_a_swing_is_the_rotation_vector_without_a_z_component(a, b):
    expected = Rotation.from_rotvec([a, b, 0]).as_matrix()
    np.testing.assert_allclose(swing_matrices([a, b]), expected, atol=1e-14)


@pytest.mark.parametrize("size", [0.0, 1e-200, 1e-12, 1e-7])
def test_hardly_bent_is_as_exact(size):
    swing = size * np.array([0.6, -0.8])
    np.testing.assert_allclose(swing_matrices(swing)[:2, 2], [swing[1], -swing[0]], rtol=1e-13)
    np.testing.assert_allclose(swings_to(swing_matrices(swing)[:, 2]), swing, rtol=1e-13)


def test_the_swing_to_a_direction_is_the_least_rotation(rng):
    u = rng.normal(size=(200, 3))
    swing = swings_to(u)
    size = np.linalg.norm(u, axis=1, keepdims=True)
    np.testing.assert_allclose(swing_matrices(swing)[:, :, 2], u / size, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(swing, axis=1), np.arccos(u[:, 2] / size[:, 0]), atol=1e-7)
    np.testing.assert_allclose(swing_matrices(swings_to([0.0, 0.0, -3.0]))[:, 2], [0, 0, -1], atol=1e-15)


def test_a_chain_points_where_it_was_asked_to(rng):
    rest = Rotation.random(6, rng=rng).as_matrix()
    u = rng.normal(size=(4, 6, 3))
    frames = link_frames(swings_along(u, rest), rest)
    np.testing.assert_allclose(frames[..., 2], u / np.linalg.norm(u, axis=-1, keepdims=True), atol=1e-13)
    np.testing.assert_allclose(link_frames(swings_along(u))[..., 2], frames[..., 2], atol=1e-13)


def test_frames_along_a_curve_do_not_twist():
    s = np.linspace(0, 2 * np.pi, 2001)
    k, torsion = 0.8, 0.6  # of a helix of unit speed: parallel transport turns back by the integral of the torsion
    tangent = np.stack([-k * np.sin(s), k * np.cos(s), np.full_like(s, torsion)], -1)
    frames = link_frames(swings_along(tangent))
    normal = np.stack([-np.cos(s), -np.sin(s), 0 * s], -1)
    angle = np.unwrap(np.arctan2((frames[..., 1] * normal).sum(-1), (frames[..., 0] * normal).sum(-1)))
    np.testing.assert_allclose(np.diff(angle[1:]), torsion * np.diff(s[1:]), rtol=1e-4)
    wave = np.stack([0 * s, np.sin(np.sin(s)), np.cos(np.sin(s))], -1)  # inflections, in a plane
    side = link_frames(swings_along(wave))[..., 0]
    np.testing.assert_allclose(side, np.broadcast_to([1, 0, 0], side.shape), atol=1e-12)
