"""Logs of angle and pressure: semicolons, decimal commas, lone carriage returns, units in the name or the mapping."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.recording import make_recording, read, write

LOG = "time;angle;pressure;set_point\r0,00;12,8;0,02;0\r0,05;12,8;0,02;0\r0,10;13,6;20,30;30\r0,15;14,4;29,30;30\r"
UNITS = {"angle_unit": "deg", "pressure_unit": "kPa"}


def log_file(folder, text=LOG, name="log.txt"):
    path = folder / name
    path.write_bytes(text.encode())
    return path


def test_semicolons_decimal_commas_and_lone_carriage_returns(tmp_path):
    ds = read(log_file(tmp_path), mapping=UNITS)
    np.testing.assert_allclose(np.rad2deg(ds["angle"].values[:, 0]), [12.8, 12.8, 13.6, 14.4])
    np.testing.assert_allclose(ds["pressure"].values, [20.0, 20.0, 20300.0, 29300.0])
    np.testing.assert_allclose(ds["time"].values, [0, 0.05, 0.1, 0.15])
    assert ds["station"].values.tolist() == ["tip"]
    assert "position" not in ds
    assert ds.attrs["frame"] == "planar"
    assert "left out: set_point" in ds.attrs["history"]


@pytest.mark.parametrize("ends", ["\n", "\r\n", "\r\r\n"])
def test_other_line_ends_read_the_same(tmp_path, ends):
    same = read(log_file(tmp_path, LOG.replace("\r", ends), "other.txt"), mapping=UNITS)
    np.testing.assert_array_equal(same["angle"].values, read(log_file(tmp_path), mapping=UNITS)["angle"].values)


def test_the_header_may_state_units_and_several_angles(tmp_path):
    text = "t_ms,flex_angle (deg),imu_angle_deg,p_psi\n0,359.0,1,0\n50,359.5,2,1\n100,0.5,3,2\n"
    ds = read(log_file(tmp_path, text, "two.csv"))
    assert ds["station"].values.tolist() == ["flex", "imu"]
    np.testing.assert_allclose(np.rad2deg(ds["angle"].values[:, 0]), [359.0, 359.5, 360.5])  # the whole turn is undone
    np.testing.assert_allclose(ds["time"].values, [0, 0.05, 0.1])
    np.testing.assert_allclose(ds["pressure"].values[1], 6894.757)
    assert "1 jump(s) of an angle by a full turn" in ds.attrs["history"]


def test_times_that_are_no_seconds_are_not_taken_for_seconds(tmp_path):
    text = "time;angle_deg\n0;1\n50;2\n100;3\n"
    with pytest.raises(InputError, match="are 50 apart, too long for seconds: set time_unit"):
        read(log_file(tmp_path, text))
    assert read(log_file(tmp_path, text), mapping={"time_unit": "ms"})["time"].values.tolist() == [0, 0.05, 0.1]


def test_units_that_nobody_states_are_asked_for(tmp_path):
    with pytest.raises(InputError, match="unit of angle: set angle_unit"):
        read(log_file(tmp_path))
    with pytest.raises(InputError, match="unit of pressure: set pressure_unit"):
        read(log_file(tmp_path), mapping={"angle_unit": "deg"})
    with pytest.raises(InputError, match="several units of angle"):
        read(log_file(tmp_path, "t,angle_deg\n0,1\n1,2\n", "b.csv"), mapping={"angle_unit": "rad"})


def test_a_table_without_header_needs_a_mapping(tmp_path):
    rows = LOG.partition("\r")[2].replace("\r", "\n")
    mapping = {"delimiter": ";", "time": 0, "angles": {"tip": 1}, "angle_unit": "deg",
               "pressure": {"columns": [2], "unit": "kPa"}}  # fmt: skip
    ds = read(log_file(tmp_path, rows), mapping=mapping)
    np.testing.assert_allclose(np.rad2deg(ds["angle"].values[:, 0]), [12.8, 12.8, 13.6, 14.4])
    with pytest.raises(InputError, match="need angle_unit"):
        read(log_file(tmp_path, rows), mapping={k: v for k, v in mapping.items() if k != "angle_unit"})


def test_angles_alone_go_through_netcdf_and_keep_the_rules(tmp_path):
    ds = make_recording([0.0, 0.1], angle=[[0.0, 0.1], [0.2, np.nan]], station=["a", "b"], frame="planar")
    same = read(write(ds, tmp_path / "a.nc"))
    np.testing.assert_array_equal(same["angle"].values, ds["angle"].values)
    assert same["station"].values.tolist() == ["a", "b"]
    with pytest.raises(InputError, match="planar recordings only"):
        make_recording([0.0, 0.1], angle=[[0.0], [0.2]])
    with pytest.raises(InputError, match="increase strictly"):
        make_recording([0.1, 0.1], angle=[[0.0], [0.2]], frame="planar")
    with pytest.raises(InputError, match="repeat"):
        make_recording([0.0, 0.1], angle=[[0.0, 0.1], [0.2, 0.3]], station=["a", "a"], frame="planar")


@pytest.mark.parametrize("text", ["time;angle;pressure\n0;1\n", "time;angle;pressure\n0;1;2\n0,1;x;2\n",
                                  "time;angle;time_s\n0;1;2\n", "time;angle;p;pressure\n0;1;2;3\n"])  # fmt: skip
def test_what_does_not_fit_is_one_sentence(tmp_path, text):
    with pytest.raises(InputError):
        read(log_file(tmp_path, text), mapping=UNITS, format="angles")
