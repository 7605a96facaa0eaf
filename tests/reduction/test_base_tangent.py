"""The tangent at the base of a recording that is not aligned: a unit vector along the body."""

from __future__ import annotations

import numpy as np

from pliant.recording import make_recording
from pliant.reduction.body import body_of


def test_the_tangent_is_a_unit_vector_whatever_the_abscissa():
    """An arc in space, its arc length given in units of half: the slope by it is about 2, the tangent of length 1."""
    direction = np.array([2.0, -1.0, 2.0]) / 3.0
    s = np.linspace(0.0, 0.2, 41)
    bent = np.stack([np.cos(9.0 * s) - 1.0, np.sin(9.0 * s), 0.0 * s], axis=1) / 9.0  # an arc that starts along y
    across = np.cross(direction, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    arc = bent[:, 1:2] * direction + bent[:, :1] * across
    body = body_of(make_recording(np.arange(3) / 50, np.stack([arc] * 3), arc_length=2.0 * s))
    np.testing.assert_allclose(np.linalg.norm(body.tangent, axis=1), 1.0, rtol=1e-12)
    np.testing.assert_allclose(body.tangent, np.broadcast_to(direction, (3, 3)), atol=2e-3)
