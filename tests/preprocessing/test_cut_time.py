"""A part of a recording in time."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.preprocessing.cut import cut_time
from pliant.recording import make_recording


def test_a_window_keeps_shape_and_pressure_within_it() -> None:
    time, clock = np.arange(100) / 50.0, np.arange(200) / 100.0 - 0.2
    place = np.random.default_rng(0).standard_normal((100, 2, 3))
    ds = make_recording(time, place, pressure=clock * 1e4, pressure_time=clock)
    cut = cut_time(ds, 0.5, 1.0)
    np.testing.assert_array_equal(cut["position"], place[25:51])
    assert cut["pressure_time"].to_numpy()[[0, -1]] == pytest.approx([0.5, 1.0], abs=0.011)
    np.testing.assert_allclose(cut["pressure"], 1e4 * cut["pressure_time"].to_numpy())
    assert "cut to 0.5 to 1 s: 26 of 100 frames" in cut.attrs["history"]
    with pytest.raises(InputError, match=r"1 frames are between 1.97 and 5 s.* runs from 0 to 1.98 s"):
        cut_time(ds, 1.97, 5.0)
