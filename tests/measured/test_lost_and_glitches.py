"""A log of a pneumatic arm writes zeros before its tracker starts, and single readings of pressure that nobody saw."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.preprocessing.glitches import leave_out_glitches
from pliant.preprocessing.quality import quality
from pliant.recording import read

ARM = {
    "header": True, "time": "time", "length_unit": "m", "pressure": {"columns": list(range(5, 17)), "unit": "psi"},
    "stations": {"tip": {"position": [17, 18, 19], "quaternion": [20, 21, 22, 23]}},
}  # fmt: skip
POINTS = ARM | {"stations": {"tip": {"position": [17, 18, 19]}}}
LOST = {1: 2, 2: 3, 4: 2, 5: 1, 8: 4, 18: 1}  # first rows of zeros, counted in the files
GLITCHES = {1: {}, 2: {}, 4: {"6": 2.98, "10": 0.97}, 5: {"6": 2.81}, 8: {"6": 2.63}, 18: {}}  # s, column of the file


@pytest.mark.parametrize("number", list(LOST))
def test_first_rows_of_zeros_are_gaps(shared_data, number):
    path = shared_data / "spatial_pneumatic_arm" / f"experiment_{number}.csv"
    for mapping in (ARM, POINTS):
        ds = read(path, mapping=mapping)
        found = quality(ds)
        assert np.flatnonzero(np.isnan(ds["position"].values).any(axis=(1, 2))).tolist() == list(range(LOST[number]))
        assert found.missing == {"tip": LOST[number]}
        assert found.travel_m["tip"] < 0.1


@pytest.mark.parametrize("number", list(GLITCHES))
def test_readings_that_sister_pouches_contradict_are_glitches(shared_data, number):
    ds = read(shared_data / "spatial_pneumatic_arm" / f"experiment_{number}.csv", mapping=ARM)
    found = {name: round(spans[0][0], 2) for name, spans in quality(ds).input_glitches.items()}
    assert found == GLITCHES[number]
    assert np.nanmax(leave_out_glitches(ds)["pressure"].values) < 15 * 6894.76
