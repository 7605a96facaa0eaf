"""Stations and sensors that the names of the columns of a table show."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.recording.column_names import standard_names, stations_of
from pliant.study.table_columns import PlainTable, sensors_by_name, stations_by_name, stations_by_standard


def sensors(names: str) -> dict[str, list[int]]:
    listed = names.split(",")
    assert not stations_by_name(listed)
    assert not stations_by_standard(listed)
    return sensors_by_name(PlainTable(listed, np.zeros((3, len(listed))), ","))


@pytest.mark.parametrize(("names", "expected"), [
    ("time,ax,ay,az,gx,gy,gz,p_kpa", {"tip": [1, 2, 3]}),
    ("time,gx,gy,gz,ax,ay,az", {"tip": [4, 5, 6]}),
    ("time,a_x,a_y,a_z,g_x,g_y,g_z", {"tip": [1, 2, 3]}),
    ("time,acc_x,acc_y,acc_z,grav_x,grav_y,grav_z", {"tip": [1, 2, 3]}),
    ("time,acc_x,grav_x,grav_y,grav_z", {"tip": [2, 3, 4]}),
    ("time,gx,gy,gz", {"tip": [1, 2, 3]}),
    ("time,mid_ax,mid_ay,mid_az,mid_gx,mid_gy,mid_gz,end_gx,end_gy,end_gz", {"mid": [1, 2, 3], "end": [7, 8, 9]}),
    ("time,gyr_x,gyr_y,gyr_z", {}),
    ("time,gyro_x,gyro_y,gyro_z,gyroscope_x,gyroscope_y,gyroscope_z", {}),
])  # fmt: skip
def test_a_gyroscope_is_no_gravity_and_no_place(names, expected):
    assert sensors(names) == expected


@pytest.mark.parametrize("other", [
    "tipVel", "linAcc", "angVel", "wrench", "loadcell", "loadCell", "goal", "target", "tipRef", "reference", "cmdTip",
    "tipCommand", "des", "desiredTip", "setpoint", "setPoint", "tipSpeed", "force", "gyr", "velTip",
])  # fmt: skip
@pytest.mark.parametrize("join", ["", "_"])
def test_words_joined_in_camel_case_name_no_place(other, join):
    owners = ["tip", other]
    names = ["t", *(f"{owner}{join}{axis if join else axis.upper()}" for owner in owners for axis in "xyz")]
    renamed = standard_names(names, "a.csv").names
    assert [*stations_of(renamed, names)] == ["tip"]
    assert [*(stations_by_name(names) or stations_by_standard(names))] == ["tip"]


@pytest.mark.parametrize("owner", ["markerA", "magnet", "A_1", "reflector", "midPlate"])
def test_places_stay_places(owner):
    names = ["t", f"{owner}_x", f"{owner}_y", f"{owner}_z"]
    assert [*stations_of(standard_names(names, "a.csv").names, names)] == [owner]
    assert stations_by_name(names) or stations_by_standard(names)
