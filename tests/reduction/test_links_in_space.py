"""Chains laid through shapes in space: against planar ones, a helix, and their own forward kinematics."""

import numpy as np
import pytest
from planar_bodies import wavy
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from pliant.numerics.curve import spatial_curve
from pliant.recording import make_recording
from pliant.reduction import links_of, select_order
from pliant.reduction.links import beside_links, link_frames, swing_matrices

S = np.linspace(0, 0.3, 121)
TIME = np.arange(30) / 10


def bodies():
    """Curvature that turns its direction along the body and over time, in the base frame: z along the base."""
    rest = np.stack([3 + 4 * np.sin(20 * S), 5 * np.cos(15 * S)], -1)
    motion = np.sin(2 * TIME)[:, None, None] * np.stack([4 + 0 * S, -6 * S / 0.3], -1)
    place = spatial_curve(rest + motion, S)[0]
    return place[..., [2, 0, 1]]  # the tangent there is y


def spatial(place):
    return make_recording(TIME[: len(place)], place, frame="spatial", arc_length=S)


def test_planar_motion_is_the_first_of_each_pair_of_swings():
    flat, _ = wavy()
    place = flat["position"].values
    deep = np.concatenate([np.zeros((*place.shape[:2], 1)), place], -1)
    ds = make_recording(flat["time"].values, deep, frame="spatial", arc_length=flat["arc_length"].values)
    plane, space = links_of(flat, 5), links_of(ds, 5)
    np.testing.assert_allclose(space.joint_angle[:, ::2], plane.joint_angle, atol=1e-13)
    np.testing.assert_allclose(space.joint_angle[:, 1::2], 0, atol=1e-14)
    np.testing.assert_allclose(space.rest_angle[::2], plane.rest_angle, atol=1e-13)
    np.testing.assert_allclose(space.link_length, plane.link_length, rtol=1e-13)
    np.testing.assert_allclose(space.residual, plane.residual, atol=1e-13)
    for bound in (None, 1e-3):
        a, b = select_order(flat, bound=bound), select_order(ds, bound=bound)
        np.testing.assert_allclose(a.max_error, b.max_error, atol=1e-14)
        assert a.chosen == b.chosen


@pytest.mark.parametrize("n", [1, 3, 8])
def test_the_chain_goes_through_the_joints_of_every_frame(n):
    links = links_of(spatial(bodies()), n, rest=(0, 0))
    frames = link_frames(links.joint_angle.reshape(-1, n, 2), links.rest_rotation)
    length = np.linalg.norm(np.diff(np.concatenate([np.zeros((30, 1, 3)), links.tips], axis=1), axis=1), axis=-1)
    np.testing.assert_allclose(np.cumsum(frames[..., 2] * length[..., None], axis=1), links.tips, atol=1e-14)
    np.testing.assert_allclose(links.joint_angle[0], 0, atol=1e-13)
    np.testing.assert_allclose(links.residual[0], 0, atol=1e-14)
    turn = Rotation.from_matrix(links.rest_rotation).as_rotvec()
    np.testing.assert_allclose(turn[:, 2], 0, atol=1e-12)  # no twist
    np.testing.assert_allclose(turn[:, :2].ravel(), links.rest_angle, atol=1e-12)


def test_joints_in_the_middle_leave_a_base_and_more_links_follow_closer():
    ds, wide = spatial(bodies()), []
    for n in (4, 8, 16):
        half = 0.15 / n
        links = links_of(ds, node_arc_length=[*np.arange(half, 0.3, 2 * half), 0.3])
        assert links.node_arc_length[0] == half
        assert links.n == n
        wide.append(links.residual.max())
    assert wide[0] > 1.5 * wide[1] > 2 * wide[2]


def test_order_does_not_depend_on_how_the_body_lies():
    place = bodies()
    turned = Rotation.random(rng=5).apply(place.reshape(-1, 3)).reshape(place.shape) + 0.4
    at_base, anywhere = spatial(place), make_recording(TIME, turned, arc_length=S)
    for boundary in ("natural", "not-a-knot"):
        a, b = (select_order(ds, boundary=boundary) for ds in (at_base, anywhere))
        np.testing.assert_allclose(a.max_error, b.max_error, atol=1e-13)
    found = select_order(at_base, bound=1e-3, boundary="not-a-knot")
    apart = []
    for knots in found.node_arc_length:  # an independent spline through the same joints, frame by frame
        joints = CubicSpline(S, place, axis=1)(knots)
        apart.append(np.linalg.norm(CubicSpline(knots, joints, axis=1)(S) - place, axis=-1).max())
    np.testing.assert_allclose(found.max_error.max(axis=1), apart, rtol=1e-4)
    assert found.chosen == next(n for n, error in zip(found.orders, apart, strict=True) if error <= 1e-3)


def test_points_beside_the_links():
    links = links_of(spatial(bodies()), node_arc_length=[0.02, 0.1, 0.2, 0.3], rest=(0, 0))
    frames = np.concatenate([np.eye(3)[None], link_frames(np.zeros((3, 2)), links.rest_rotation)])
    starts = np.cumsum(frames[:, :, 2] * np.append(0.02, links.link_length)[:, None], axis=0)
    inside = np.array([0.004, -0.003, 0.03])  # aside, -across, along
    place = [frames[0] @ [0.001, 0.002, 0.01], *(starts[k] + frames[k + 1] @ inside for k in range(3))]
    found = links.beside(place)
    expected = [(-1, 0.01, -0.002, 0.001), *((k, 0.03, 0.003, 0.004) for k in range(3))]
    np.testing.assert_allclose(found, expected, atol=1e-12)
    straight = beside_links(np.array([[0.0, 0.0, 0.5]]), 0.0, np.array([0.1, 0.1]), swing_matrices(np.zeros((2, 2))))
    np.testing.assert_allclose(straight[0], (1, 0.4, 0, 0), atol=1e-15)  # beyond the tip: the last link
