from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.validation.shape_figures import chain_through, order_figure, shape_figure


def test_chain_meets_the_measured_shape(shape):
    points, joints, splines = chain_through(shape)
    assert points.shape[0] == joints.shape[0] == splines.shape[0] > 2
    assert joints.shape[1] == shape.links.n + 1
    np.testing.assert_allclose(joints[:, -1], points[:, -1], atol=1e-9)
    np.testing.assert_allclose(splines[:, -1], points[:, -1], atol=1e-9)
    np.testing.assert_allclose(joints[:, 0], 0.0, atol=1e-12)


def test_a_shape_and_a_chain_of_other_frames_are_refused(shape):
    with pytest.raises(InputError, match="38 whole frames, but a chain through 39"):
        chain_through(replace(shape, position=shape.position[:-1]))


def test_figures_say_what_they_show(shape):
    assert "bending" in order_figure(shape).get_suptitle()
    assert "chain of 3 links" in shape_figure(shape).get_suptitle()
