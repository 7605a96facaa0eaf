"""Wide CSV: what is written comes back; what is wrong is named."""

from __future__ import annotations

import json

import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from oracles.wire import NAME, add_wire

from pliant.errors import InputError
from pliant.recording import make_recording, read, write

SIMPLE = "t,p_kpa,x_000,y_000,z_000,x_001,y_001,z_001\n0,0,0,0,0,0,0,1\n0.1,5,0,0,0,0,.5,1\n"


def put(tmp_path, text, name="a.csv", encoding="utf-8"):
    path = tmp_path / name
    path.write_bytes(text.encode(encoding))
    return path


def test_what_is_written_comes_back(recording, tmp_path):
    again = read(write(recording, tmp_path / "a.csv"))
    xr.testing.assert_equal(again, recording)
    assert again.attrs["nominal_pressure"] == 1e4
    assert again.attrs["history"] == "made for a test\nread a.csv as csv"


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(arrays(np.float64, (4, 2, 3), elements=st.floats(-1e6, 1e6) | st.just(np.nan)))
def test_every_number_comes_back_exactly(tmp_path, position):
    ds = make_recording([0, 1, 2, 3], position)
    np.testing.assert_array_equal(read(write(ds, tmp_path / "a.csv"))["position"], position)


def test_a_planar_recording_with_angles_comes_back(tmp_path):
    ds = make_recording([0, 1], np.ones((2, 1, 2)), frame="planar", angle=[[0.1], [np.nan]],
                        angle_reference="base")  # fmt: skip
    xr.testing.assert_identical(read(write(ds, tmp_path / "a.csv")).drop_attrs(deep=False),
                                ds.drop_attrs(deep=False))  # fmt: skip


def test_pressure_at_the_door_becomes_pascal(tmp_path):
    ds = read(put(tmp_path, SIMPLE))
    assert ds["pressure"].values.tolist() == [0, 5000]
    assert ds["station"].values.tolist() == ["s000", "s001"]
    ds = read(put(tmp_path, SIMPLE.replace("p_kpa", "p_psi_left")))
    assert ds["pressure"].dims == ("pressure_time", "chamber")
    assert ds["pressure"].values[1, 0] == pytest.approx(5 * 6894.757)


def test_columns_may_stand_in_any_order(tmp_path):
    rows = [line.split(",") for line in SIMPLE.split()]
    mixed = "\n".join(",".join(row[::-1]) for row in rows)
    xr.testing.assert_equal(read(put(tmp_path, mixed)), read(put(tmp_path, SIMPLE, "b.csv")))


def test_metadata_stand_in_a_comment_or_beside_the_file(tmp_path):
    metadata = {"length_unit": "mm", "station": ["base", "tip"], "operator": "anyone"}
    ds = read(put(tmp_path, "# " + json.dumps(metadata) + "\n" + SIMPLE))
    assert ds["position"].values.max() == 1e-3
    assert json.loads(ds.attrs["metadata"]) == {"operator": "anyone"}
    path = put(tmp_path, SIMPLE, "b.csv")
    put(tmp_path, json.dumps(metadata), "b.json")
    xr.testing.assert_equal(read(path), ds)
    assert read(path, mapping={"length_unit": "cm"})["position"].values.max() == 1e-2


@pytest.mark.parametrize("name", ["arc_lenght", "Arc-Length", "arclength"])
def test_a_misspelt_entry_of_the_metadata_is_named(tmp_path, name):
    ds = read(put(tmp_path, "# " + json.dumps({name: [0, 1], "operator": "anyone"}) + "\n" + SIMPLE))
    said = [line for line in ds.attrs["history"].split("\n") if "metadata entry" in line]
    assert said == [f"the metadata entry {name!r} is unknown and was not used: did you mean 'arc_length'?"]


def test_empty_cells_are_drop_outs(tmp_path):
    ds = read(put(tmp_path, SIMPLE.replace(".5", "")))
    assert np.isnan(ds["position"].values).sum() == 1


def test_decimal_commas_between_semicolons_are_read(tmp_path):
    ds = read(put(tmp_path, SIMPLE.replace(",", ";").replace(".", ",")))
    xr.testing.assert_equal(ds, read(put(tmp_path, SIMPLE, "b.csv")))


def test_a_byte_order_mark_and_windows_lines_are_read(tmp_path):
    ds = read(put(tmp_path, SIMPLE.replace("\n", "\r\n"), encoding="utf-8-sig"))
    assert ds.sizes["time"] == 2


def test_two_coordinates_become_three_with_a_line_of_history(tmp_path):
    ds = read(put(tmp_path, "t,x_tip,y_tip\n0,1,2\n1,1,3\n"))
    assert ds["position"].values[:, 0].tolist() == [[1, 2, 0], [1, 3, 0]]
    assert "z = 0" in ds.attrs["history"]


def test_columns_of_no_known_kind_are_told(tmp_path):
    ds = read(put(tmp_path, "t,x_tip,y_tip,temperature\n0,1,2,20\n1,1,3,20\n"))
    assert "temperature" in ds.attrs["history"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty"),
        ("\n \n", "empty"),
        ("# {}\n", "only comments"),
        ("t,x_000,y_000,z_000\n", "no row"),
        (SIMPLE.replace("y_001", "temperature"), "lacks the column.s. y_001"),
        (SIMPLE.replace("_001", "_003"), "x_001"),
        (SIMPLE.replace("y_001", "x_001"), "repeated column names: x_001"),
        (SIMPLE.replace("t,p", "moment,p"), "one column t"),
        (SIMPLE.replace("p_kpa", "p"), "does not state its unit"),
        ("t,q\n0,1\n", "neither columns of stations"),
        (SIMPLE[:-3] + "\n", r"line 3 .* 7 cell.s. instead of 8"),
        (SIMPLE.replace("0.1", "0,1"), "decimal commas"),
        (SIMPLE.replace(".5", "five"), "line 3, cell 7 .* 'five'"),
        (SIMPLE.replace(".5", "inf"), "infinite"),
        (SIMPLE.replace("0.1", "0"), "increase strictly"),
        (SIMPLE.replace("0.1", ""), "not finite"),
        ("# {not json\n" + SIMPLE, "not JSON"),
        ('# {"rows": 3}\n' + SIMPLE, "only 2 of 3 were read: the file is truncated"),
        ('# {"length_unit": "furlong"}\n' + SIMPLE, "furlong"),
        ('# {"frame": "lab"}\n' + SIMPLE, "tracker, planar"),
        ('# {"station": ["one"]}\n' + SIMPLE, "need 2 names"),
        (SIMPLE.replace(",", ";").replace("0.1", "1.000,5"), "mixes decimal"),
        ("x" * 5_000_000, "not a text table"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        read(put(tmp_path, text))


@pytest.mark.parametrize(("encoding", "note"), [("utf-16", "UTF-16"), ("latin-1", "Windows-1252")])
def test_encodings_of_spreadsheets_are_read_and_named(tmp_path, encoding, note):
    ds = read(put(tmp_path, SIMPLE + "# é\n", encoding=encoding))
    assert ds.sizes["time"] == read(put(tmp_path, SIMPLE)).sizes["time"]
    assert f"is read as {note} text" in ds.history


def test_other_encodings_are_refused(tmp_path):
    with pytest.raises(InputError):
        read(put(tmp_path, SIMPLE, encoding="utf-32"))
    with pytest.raises(InputError, match="not UTF-8 text: some of its bytes are no letters"):
        read(put(tmp_path, SIMPLE + "# \xa6\n", encoding="latin-1"))


def test_attributes_come_back(tmp_path):
    ds = make_recording([0, 1], np.ones((2, 1, 3)), attrs={"cap_curvature": np.float64(50.0), "note": "a fibre"})
    again = read(write(ds, tmp_path / "a.csv"))
    assert (again.attrs["cap_curvature"], again.attrs["note"]) == (50.0, "a fibre")
    with pytest.raises(InputError, match=r"cannot hold the attribute note, array\(.*write netCDF"):
        write(ds.assign_attrs(note=np.ones(3)), tmp_path / "b.csv")
    assert not (tmp_path / "b.csv").exists()


def test_what_a_table_cannot_hold_is_refused_by_its_name(tmp_path, monkeypatch):
    add_wire(monkeypatch)
    further = {NAME: np.ones((2, 1)), f"{NAME}_constants": np.zeros((1, 3))}
    ds = make_recording([0, 1], np.ones((2, 1, 3)), frame="spatial", further=further)
    with pytest.raises(InputError, match=f"cannot hold {NAME}, {NAME}_constants, only positions.*write netCDF"):
        write(ds, tmp_path / "a.csv")
    tensions = make_recording([0, 1], np.ones((2, 1, 3)), actuation=np.ones((2, 1)), input_time=[0, 1],
                              input_names=["a"], input_kind=["tension"])  # fmt: skip
    with pytest.raises(InputError, match="cannot hold actuation, input_time, input, kind"):
        write(tensions, tmp_path / "a.csv")
    assert list(tmp_path.iterdir()) == []


def test_two_clocks_do_not_fit_one_table(recording, tmp_path):
    shifted = recording.assign_coords(pressure_time=recording["pressure_time"] + 0.001)
    shifted["pressure_time"].attrs = recording["pressure_time"].attrs
    with pytest.raises(InputError, match="pressure and shape have different times"):
        write(shifted, tmp_path / "a.csv")
