"""Lengths of arcs through points, in the plane and in space."""

import numpy as np

from pliant.numerics.curve import arc_lengths, spatial_curve


def test_arcs_of_any_plane_keep_their_length(rng):
    ends = np.array([0.0, 0.1, 0.15, 0.3])
    s = np.sort(np.concatenate([ends, ends[1:-1] - 1e-9, ends[1:-1] + 1e-9]))
    pieces = np.clip(np.searchsorted(ends, s, side="right") - 1, 0, 2)
    curvature = rng.uniform(-8, 8, (5, 3, 2))[:, pieces]  # constant between the ends, its direction another each time
    place = spatial_curve(curvature, s)[0][..., [2, 0, 1]][:, np.searchsorted(s, ends)]
    np.testing.assert_allclose(arc_lengths(place[:, 1:]), 0.3, rtol=1e-6)
    straight = np.zeros((2, 3, 3))
    straight[..., 2] = [0.1, 0.2, 0.4]
    np.testing.assert_allclose(arc_lengths(straight), 0.4, rtol=1e-15)


def test_the_plane_is_the_case_without_x(rng):
    flat = np.cumsum(rng.uniform(0.02, 0.05, (4, 6, 2)) * [-1, 1], axis=1)
    deep = np.concatenate([np.zeros((4, 6, 1)), flat], axis=2)
    np.testing.assert_allclose(arc_lengths(deep), arc_lengths(flat), rtol=1e-12)
