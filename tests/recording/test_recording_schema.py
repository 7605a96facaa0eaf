"""The schema accepts what it describes and names the rule that anything else breaks."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.recording.schema import append_history, check_recording, make_recording

TIME = np.arange(5) * 0.01
POSITION = np.zeros((5, 2, 3))


def test_a_full_recording_keeps_units_and_names():
    quaternion = np.zeros((5, 2, 4))
    quaternion[..., 3] = 1
    quaternion[:, 1] = np.nan
    ds = make_recording(
        TIME, POSITION, station=["base", "tip"], quaternion=quaternion, pressure=np.zeros((7, 2)),
        pressure_time=np.arange(7.0), arc_length=[0, 0.1], history="made", nominal_pressure=100,
    )  # fmt: skip
    assert ds.attrs["frame"] == "tracker"
    assert ds["pressure"].dims == ("pressure_time", "chamber")
    assert all(v.attrs["units"] and v.attrs["long_name"] for v in ds.data_vars.values())
    assert append_history(ds, "one", "two").attrs["history"] == "made\none\ntwo"
    assert ds.attrs["history"] == "made"
    assert check_recording(ds) is ds


def test_the_arrays_are_copied():
    position = POSITION.copy()
    ds = make_recording(TIME, position)
    position += 1
    assert ds["position"].values.max() == 0


def test_pressure_alone_and_strain_alone_are_recordings():
    make_recording(pressure=[0, 1, 2], pressure_time=[0, 1, 2])
    make_recording(TIME, strain=np.zeros((5, 3, 4)), gauge_position=np.arange(4.0))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"time": TIME[::-1]}, "increase strictly"),
        ({"time": TIME[:0], "position": POSITION[:0]}, "empty"),
        ({"time": [0, 1, np.nan, 2, 3]}, "not finite"),
        ({"time": TIME[:4]}, "do not match"),
        ({"position": POSITION[..., :1]}, "2 .planar. or 3"),
        ({"position": POSITION[..., :2]}, "axes of a recording"),
        ({"position": POSITION + np.inf}, "infinite"),
        ({"position": POSITION[0]}, "3 dimension"),
        ({"position": "text"}, "array of numbers"),
        ({"station": ["a", "a"]}, "repeat: a"),
        ({"station": ["a"]}, "need 2 names"),
        ({"quaternion": np.ones((5, 2, 4))}, "unit length"),
        ({"angle": np.zeros((5, 2))}, "planar recordings only"),
        ({"frame": "lab"}, "one of tracker, planar"),
        ({"pressure": [1, 2]}, "do not match"),
        ({"strain": np.zeros((5, 1, 2))}, "gauge_position"),
        ({"nominal_pressure": np.nan}, "finite number of pascals"),
        ({"attrs": {"schema_version": 99}}, "schema_version"),
        ({"position": None}, "holds no variable"),
    ],
)
def test_each_broken_rule_is_named(arguments, message):
    with pytest.raises(InputError, match=message):
        make_recording(**({"time": TIME, "position": POSITION} | arguments))


def test_another_dataset_is_refused():
    ds = make_recording(TIME, POSITION)
    with pytest.raises(InputError, match="schema="):
        check_recording(ds.drop_attrs())
    with pytest.raises(InputError, match="float64"):
        check_recording(ds.assign(position=ds["position"].astype("float32")))
    renamed = ds.copy()
    renamed["position"].attrs.pop("units")
    with pytest.raises(InputError, match="units"):
        check_recording(renamed)
