"""Films of one body show it a hair longer or shorter: joints sit at the same shares of it."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.recording import make_recording
from pliant.study.dense import scaled_nodes


@pytest.mark.parametrize(("length", "expected"), [(0.1701, 0.1701), (0.2, 0.17)])
def test_nodes_follow_a_small_difference_of_length_alone(length: float, expected: float) -> None:
    s = np.linspace(0.0, length, 5)
    body = make_recording([0.0, 1.0], np.zeros((2, 5, 2)), arc_length=s, frame="planar")
    nodes = scaled_nodes(np.array([0.0, 0.085, 0.17]), body)
    assert nodes == pytest.approx([0.0, expected / 2, expected])
