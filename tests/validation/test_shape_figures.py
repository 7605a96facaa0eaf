from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.validation.selection_figures import chain_through, order_figure, shape_figure


def test_chain_meets_the_measured_shape(shape):
    points, joints, splines = chain_through(shape)
    assert points.shape[0] == joints.shape[0] == splines.shape[0] > 2
    assert joints.shape[1] == shape.links.n + 1
    np.testing.assert_allclose(joints[:, -1], points[:, -1], atol=1e-9)
    np.testing.assert_allclose(splines[:, -1], points[:, -1], atol=1e-9)
    np.testing.assert_allclose(joints[:, 0], 0.0, atol=1e-12)


def test_a_shape_and_a_chain_of_other_frames_are_refused(shape):
    with pytest.raises(InputError, match="38 complete frames, but its links were computed from 39"):
        chain_through(replace(shape, position=shape.position[:-1]))


def test_figures_say_what_they_show(shape):
    order, chain = order_figure(shape), shape_figure(shape)
    assert [ax.get_xlabel() for ax in order.axes] == ["time (s)", "number of segments n"]
    assert [ax.get_xlabel() for ax in chain.axes] == ["arc length (mm)", "x (mm)"]
    assert not order.get_suptitle()
    assert not chain.get_suptitle()
