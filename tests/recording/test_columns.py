"""A mapping alone reads a foreign table; what does not fit the table is named."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.recording import read
from pliant.recording.inputs import recorded_inputs

TABLE = "ID,x1,y1,z1,x2,y2,z2\n0,1,2,3,4,5,6\n0,1,2,3,4,5,7\n3,1,2,3,4,5,8\n3,1,2,3,4,5,9\n"
MAPPING = {
    "header": True, "rate_hz": 100.0, "length_unit": "mm", "select": {"column": "ID", "value": 3},
    "stations": {"base": {"position": ["x1", "y1", "z1"]}, "tip": {"position": ["x2", "y2", "z2"]}},
}  # fmt: skip


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(TABLE)
    return path


def test_a_trial_is_selected_and_counted(table):
    ds = read(table, mapping=MAPPING)
    assert ds["station"].values.tolist() == ["base", "tip"]
    np.testing.assert_allclose(ds["position"].values[:, 1, 2], [0.008, 0.009])
    assert ds["time"].values.tolist() == [0, 0.01]
    assert "kept 2 of 4 rows: ID = 3" in ds.attrs["history"]
    assert ds.attrs["source_format"] == "columns"


def test_points_side_by_side_in_white_space(tmp_path):
    (tmp_path / "a.txt").write_text("1 2 3  4 5 6\n1 2 3 4 5 7\n")
    ds = read(tmp_path / "a.txt", mapping={"delimiter": "space", "rate_hz": 1, "length_unit": "m",
                                           "points": {"count": 2, "order": "zyx"}})  # fmt: skip
    assert ds["position"].values[1].tolist() == [[3, 2, 1], [7, 5, 4]]


def test_time_pressure_and_quaternions_by_index(tmp_path):
    (tmp_path / "a.txt").write_text("0,10,1,2,3,0,0,0,-1\n20,11,1,2,3,0,0,0,9\n")
    ds = read(tmp_path / "a.txt", mapping={
        "time": 0, "time_unit": "ms", "length_unit": "m", "pressure": {"columns": [1], "unit": "psi"},
        "stations": {"tip": {"position": [2, 3, 4], "quaternion": [5, 6, 7, 8]}}})  # fmt: skip
    assert ds["time"].values.tolist() == [0, 0.02]
    assert ds["pressure"].values[0] == pytest.approx(68947.57)
    assert ds["quaternion"].values[0, 0].tolist() == [0, 0, 0, -1]
    assert np.isnan(ds["quaternion"].values[1]).all()
    assert np.isnan(ds["position"].values[1]).all()
    assert "quaternion that is incomplete or not of unit length; read as gaps: tip 1" in ds.attrs["history"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"select": {"column": "ID", "value": 7}}, "no row .* the column holds 0, 3"),
        ({"select": {"column": "trial", "value": 3}}, "no column 'trial': correct the mapping; available: ID"),
        ({"stations": {"tip": {"position": [1, 2, 99]}}}, "no column 99"),
        ({"stations": {"tip": {"position": [1]}}}, "stations.tip.position"),
        ({"stations": None, "pressure": None, "skip_lines": 1},
         "stations, points or angles; or, for a log without a shape, pressure"),
        ({"stations": None, "points": {"count": 4e8}}, "points take columns 0 to 1199999999, but those of .* are 0 to"),
        ({"stations": None, "points": {"count": 1, "first": 9**9}}, "correct points.count, points.first"),
        ({"points": {"count": 2}}, "either stations or points"),
        ({"rate_hz": None}, "either time \\(the column of time\\) or rate_hz"),
        ({"rate_hz": -1}, "rate_hz"),
        ({"length_unit": "elbow"}, "elbow"),
        ({"colour": "red"}, "unknown key 'colour'; the known keys are delimiter"),
        ({"stations": {"tip": {"position": [1, 2], "spin": [3, 4, 5]}}},
         "unknown key 'stations.tip.spin'; the known keys of stations.tip are position, quaternion, euler, status"),
        ({"inputs": {"columns": [1], "kind": "tension", "unit": "N", "name": ["a"]}},
         "unknown key 'inputs.0.name'; the known keys of inputs.0 are columns, kind, unit, names, scale"),
        ({"rows": [0, 9]}, "is not within the 2 rows"),
        ({"header": False}, "line 1, cell 1 .* 'ID'"),
        ({"delimiter": ";"}, "no column 'ID': correct the mapping; available: ID,x1,y1"),
        ({"skip_lines": 50}, "no table row after"),
        ({"arc_length": [0, 0.1, 0.2]}, "do not match"),
        ({"time": "ID", "rate_hz": None}, "increase strictly"),
    ],
)
def test_what_does_not_fit_is_named(table, change, message):
    with pytest.raises(InputError, match=message):
        read(table, mapping=MAPPING | change)


def test_a_table_without_a_mapping_is_refused(tmp_path):
    (tmp_path / "a.txt").write_text("1 2 3\n")
    with pytest.raises(InputError, match="give a mapping that names its columns"):
        read(tmp_path / "a.txt")
    with pytest.raises(InputError, match="must be a dict"):
        read(tmp_path / "a.txt", mapping=["points"])


def test_tensions_displacements_and_motor_angles_by_column(tmp_path):
    (tmp_path / "a.csv").write_text("label,x,y,z,m1,m2,u\nslow,1,2,3,90,-180,4\nfast,1,2,3,45,0,-2\n")
    mapping = {
        "header": True, "rate_hz": 10, "length_unit": "mm", "stations": {"tip": {"position": ["x", "y", "z"]}},
        "inputs": [{"columns": ["m1", "m2"], "kind": "angle", "unit": "deg", "names": ["left", "right"]},
                   {"columns": ["u"], "kind": "displacement", "unit": "mm"}],
    }  # fmt: skip
    ds = read(tmp_path / "a.csv", mapping=mapping)
    np.testing.assert_allclose(ds["actuation"], [[np.pi / 2, -np.pi, 4e-3], [np.pi / 4, 0, -2e-3]])
    assert ds["input"].values.tolist() == ["left", "right", "u"]
    assert [(one.kind, one.unit) for one in recorded_inputs(ds)] == [("angle", "rad")] * 2 + [("displacement", "m")]
    assert "1 column(s) of a.csv are not in the mapping and were left out: label" in ds.attrs["history"]
    halved = read(tmp_path / "a.csv", mapping=mapping | {"linear": {"u": {"scale": 0.5, "offset": 1, "unit": "mm"}}})
    np.testing.assert_allclose(halved["actuation"].values[:, 2], [3e-3, 0])
    log = read(tmp_path / "a.csv", mapping={k: v for k, v in mapping.items() if k not in ("stations", "length_unit")})
    assert "time" not in log.coords
    assert log["input_time"].values.tolist() == [0, 0.1]
    for change, message in (
        ({"inputs": {"columns": ["m1"], "kind": "speed", "unit": "deg"}}, "inputs.0.kind"),
        ({"inputs": {"columns": ["m1"], "kind": "angle", "unit": "N"}}, "unit of angle 'N'"),
        ({"inputs": {"columns": ["m1"], "kind": "angle", "unit": "deg", "names": ["a", "b"]}},
         "gives 2 names to 1 columns of inputs"),
        ({"inputs": {"columns": ["label"], "kind": "angle", "unit": "deg"}}, "cell 1 .* is not a number: 'slow'"),
        ({"inputs": {"columns": ["m1", "m1"], "kind": "angle", "unit": "deg"}}, "input names must differ"),
        ({"pressure": {"columns": ["m1", "m2"], "unit": "kPa", "chamber": ["p", "p"]}}, "chamber names must differ"),
    ):
        with pytest.raises(InputError, match=message):
            read(tmp_path / "a.csv", mapping=mapping | change)
