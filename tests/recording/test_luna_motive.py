"""Luna strain tables and OptiTrack Motive exports."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from pliant.errors import InputError
from pliant.recording import read
from pliant.recording.luna import combine_cores

LUNA = """Test name:\tbench
Product:\tODiSI 6108
Gage Pitch (mm):\t0.65
Units:\tmicrostrain
Length (m):\t0.00195
--------------------
Gage/Segment Name\t\t\tall gages[0]\tall gages[1]\tall gages[2]
Tare\t\t\t0.1\t0.2\t0.3
x-axis\t\t\t0.0000\t0.00065\t0.0013
2023-09-06 12:51:28.888946\tmeasurement\tstrain\t1.0\t2.0\t-3
2023-09-06 12:51:28.908946\tmeasurement\tstrain\t1.5\t\tNaN
"""

MOTIVE = """Format Version,1.23,Take Name,take,Capture Frame Rate,100.0,Rotation Type,Quaternion,Length Units,Millimeters

,Type,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body Marker,Rigid Body Marker,Rigid Body Marker,Marker,Marker,Marker
,Name,base,base,base,base,base,base,base,base,base:1,base:1,base:1,tip,tip,tip
,ID,1,1,1,1,1,1,1,1,2,2,2,3,3,3
,,Rotation,Rotation,Rotation,Rotation,Position,Position,Position,Mean Marker Error,Position,Position,Position,Position,Position,Position
Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,,X,Y,Z,X,Y,Z
0,0.0,0,0,0,1,10,20,30,0.1,1,2,3,4,5,6
1,0.01,0,0,0.6,0.8,10,20,31,0.1,1,2,3,,,
"""  # noqa: E501


def put(tmp_path, text, name):
    (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path / name


def test_luna_strain_is_dimensionless_and_drop_outs_stay(tmp_path):
    ds = read(put(tmp_path, LUNA, "a.tsv"))
    assert ds.attrs["source_format"] == "luna"
    np.testing.assert_allclose(ds["strain"].values[:, 0], [[1e-6, 2e-6, -3e-6], [1.5e-6, np.nan, np.nan]])
    np.testing.assert_allclose(ds["gauge_position"], [0, 0.00065, 0.0013])
    np.testing.assert_allclose(ds["time"], [0, 0.02])
    assert ds.attrs["start_time"].startswith("2023-09-06T12:51:28")


def test_cores_are_joined(tmp_path):
    path = put(tmp_path, LUNA, "a.tsv")
    cores = [read(path, mapping={"core": f"c{i}"}) for i in range(3)]
    joined = combine_cores(cores)
    assert joined["strain"].shape == (2, 3, 3)
    assert "joined 3 cores" in joined.attrs["history"]
    with pytest.raises(InputError, match="must differ"):
        combine_cores([cores[0], cores[0]])
    shifted = cores[1].assign_coords(time=cores[1]["time"] + 1)
    with pytest.raises(InputError, match="differ in time"):
        combine_cores([cores[0], shifted])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("Units:\tmicrostrain", "Units:\tGHz", "microstrain"),
        ("Units:\tmicrostrain\n", "", "not stated"),
        ("--------------------\n", "", "line of dashes"),
        ("x-axis", "axis", "no x-axis"),
        ("0.0013\n", "0.0001\n", "increase"),
        ("\t-3\n", "\n", "2 cell.s. instead of 3"),
        ("2023-09-06 12:51:28.908946", "later", "time stamp: 'later'"),
        ("28.908946", "28.888946", "increase strictly"),
        ("1.5", "1,5", "mixes decimal"),
        ("1.5", "x", "not a number"),
    ],
)
def test_broken_luna_tables_are_named(tmp_path, old, new, message):
    with pytest.raises(InputError, match=message):
        read(put(tmp_path, LUNA.replace(old, new), "a.tsv"), format="luna")


def test_luna_without_rows_is_refused(tmp_path):
    with pytest.raises(InputError, match="no measurement"):
        read(put(tmp_path, LUNA[: LUNA.index("2023")], "a.tsv"))


def test_motive_bodies_and_markers(tmp_path):
    ds = read(put(tmp_path, MOTIVE, "a.csv"))
    assert ds.attrs["source_format"] == "motive"
    assert ds["station"].values.tolist() == ["base", "tip"]
    np.testing.assert_allclose(ds["position"].values[0], [[0.01, 0.02, 0.03], [0.004, 0.005, 0.006]])
    assert np.isnan(ds["position"].values[1, 1]).all()
    np.testing.assert_allclose(ds["quaternion"].values[1, 0], [0, 0, 0.6, 0.8])
    assert np.isnan(ds["quaternion"].values[:, 1]).all()
    assert "3 columns of assets other than" in ds.attrs["history"]


def test_motive_3_has_a_row_of_parents(tmp_path):
    lines = MOTIVE.split("\n")
    lines.insert(5, ",Parent" + "," * 14)
    ds = read(put(tmp_path, "\n".join(lines), "a.csv"))
    xr.testing.assert_equal(ds, read(put(tmp_path, MOTIVE, "b.csv")))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (",Length Units,Millimeters", "", "length_unit"),
        (",Type,", ",Kind,", "not a Motive export"),
        ("Frame,Time", "Number,Time", "not a Motive export"),
        (",Name,base", ",Name,", r"row Name of a\.csv is empty in column 3"),
        (",4,5,6", ",4,5", "15 cell.s. instead of 16"),
        ("10,20,31", "10,x,31", "cell 8 .* not a number: 'x'"),
        ("Position", "Place", "with a position"),
    ],
)
def test_broken_motive_exports_are_named(tmp_path, old, new, message):
    with pytest.raises(InputError, match=message):
        read(put(tmp_path, MOTIVE.replace(old, new), "a.csv"))
