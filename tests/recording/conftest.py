"""A small recording with everything in it."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.recording import make_recording


@pytest.fixture
def recording(rng):
    time = np.cumsum(rng.uniform(0.009, 0.011, 40))
    position = rng.normal(size=(40, 3, 3))
    position[5, 1] = np.nan
    quaternion = rng.normal(size=(40, 3, 4))
    quaternion /= np.linalg.norm(quaternion, axis=-1, keepdims=True)
    quaternion[:, 0] = np.nan
    return make_recording(
        time, position, station=["base", "mid", "tip"], quaternion=quaternion,
        pressure=rng.uniform(0, 1e5, (40, 2)), chamber=["left", "right"], arc_length=[0, 0.1, 0.2],
        history="made for a test", nominal_pressure=1e4,
    )  # fmt: skip
