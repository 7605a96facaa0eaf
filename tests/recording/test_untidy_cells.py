"""Cells that tables of laboratories hold beside numbers: quoted ones with delimiters, and rows that end with one."""

from __future__ import annotations

import pytest

from pliant.errors import InputError
from pliant.recording import read
from pliant.recording.units_row import with_units
from pliant.recording.vocabulary import base_to_tip

MAPPING = {"time": "t", "length_unit": "m", "stations": {"tip": {"position": ["x", "y", "z"]}}}


def test_a_quoted_delimiter_stays_in_its_cell_where_marks_are_gaps(tmp_path):
    rows = [f'"{0.1 * k:.1f}","{0.01 * k:.2f}","0.0","0.1","ok, fine"' for k in range(6)]
    rows[3] = '"0.3","MISSING","MISSING","MISSING","lost, again"'
    (tmp_path / "a.csv").write_text('"t","x","y","z","note"\n' + "\n".join(rows) + "\n")
    recording = read(tmp_path / "a.csv", mapping={**MAPPING, "na": ["MISSING"]})
    assert recording["position"].isnull().all(("station", "axis")).values.tolist() == [False] * 3 + [True] + [False] * 2


def test_rows_without_a_header_may_end_with_a_delimiter(tmp_path):
    (tmp_path / "a.txt").write_text("".join(f"{0.1 * k:.1f}\t0.0\t{0.01 * k:.2f}\t0.1\t\n" for k in range(6)))
    mapping = {"time": 0, "length_unit": "m", "stations": {"tip": {"position": [1, 2, 3]}}}
    assert read(tmp_path / "a.txt", mapping=mapping).sizes["time"] == 6


def test_a_mapping_names_columns_without_the_units_below_them(tmp_path):
    (tmp_path / "a.csv").write_text("t,x,y,z\ns,mm,mm,mm\n" + "".join(f"{k},0,{k},100\n" for k in range(6)))
    recording = read(tmp_path / "a.csv", mapping={**MAPPING, "length_unit": "mm"})
    assert float(recording["position"].max()) == pytest.approx(0.1)


@pytest.mark.parametrize("below", ["1,2,3", "s,2,mm", "s,mm", "open,closed,shut", ""])
def test_a_row_that_is_no_row_of_units_stays(below):
    lines = ["t,x,y", below, "1,2,3"]
    assert with_units(lines, 0, ",", "a.csv") == (lines, [])


@pytest.mark.parametrize(("names", "below", "expected"), [
    ("t,x_tip,y_tip", "(s),(mm),(mm)", "t [s],x_tip [mm],y_tip [mm]"),
    ("t,x_tip,y_tip", "[ms],<mm>,", "t [ms],x_tip [mm],y_tip"),
    ("time_ms,tip_x_mm,tip [mm]", "ms,mm,mm", "time_ms,tip_x_mm,tip [mm]"),
    ("time_sec,tip_x (mm),p_kPa", "s,mm,kPa", "time_sec,tip_x (mm),p_kPa"),
    ("x_m,tip_px,p_min,x_in", "mm,mm,kPa,mm", "x_m [mm],tip_px [mm],p_min [kPa],x_in [mm]"),
    ("time,tip_x,temp,room,angle", "sec,mm,°C,degC,°", "time [s],tip_x [mm],temp,room,angle [deg]"),
    ("time,tip_x,note", "µs,mm,", "time [us],tip_x [mm],note"),
])  # fmt: skip
def test_a_row_of_units(names, below, expected):
    lines, history = with_units([names, below, "1,2,3"], 0, ",", "a.csv")
    assert lines == [expected, "", "1,2,3"]
    assert history == ["line 2 of a.csv holds units: they are read as those of its columns"]


@pytest.mark.parametrize("name", ["tip_x_mm", "tip_x [mm]"])
def test_a_name_and_a_row_of_units_that_differ_are_refused(name):
    with pytest.raises(InputError, match=r"a.csv: the name of the column '.*' states mm, but .* states cm: correct"):
        with_units([f"t,{name}", "s,cm", "1,2"], 0, ",", "a.csv")


def test_bracketed_units_below_the_names_are_used(tmp_path):
    rows = [f"{20 * k},{k},5\n" for k in range(6)]
    (tmp_path / "a.csv").write_text("time_ms,tip_x,tip_y\n(ms),(mm),(mm)\n" + "".join(rows))
    recording = read(tmp_path / "a.csv")
    assert recording["time"].values[-1] == pytest.approx(0.1)
    assert float(recording["position"].max()) == pytest.approx(0.005)


def test_stations_go_from_base_to_tip_by_their_names():
    assert base_to_tip(["tip", "mid", "BasePlate"]) == ["BasePlate", "mid", "tip"]
    assert base_to_tip(["p2", "p1"]) == ["p2", "p1"]
    assert base_to_tip(["marker3_tip", "marker2", "marker1_base"]) == ["marker1_base", "marker2", "marker3_tip"]
    assert base_to_tip(["tip_1", "m2", "root"]) == ["root", "m2", "tip_1"]


@pytest.mark.parametrize("stations", [
    ["s1_base", "s1_tip", "s2_base", "s2_tip"], ["base", "seg1_end", "seg2_mid"], ["base", "s1_tip", "s2_tip"],
    ["tip1", "tip2", "root", "base"], ["base_to_tip", "p1"],
])  # fmt: skip
def test_stations_of_several_segments_stay_in_the_order_of_their_columns(stations):
    assert base_to_tip(stations) == stations


def test_pixels_without_a_scale_are_no_metres(tmp_path):
    (tmp_path / "a.csv").write_text("t,tip_x_px,tip_y_px\n" + "".join(f"{k},{k},5\n" for k in range(6)))
    with pytest.raises(InputError, match=r"a.csv are in pixels.*camera = \{ pixels_per_mm"):
        read(tmp_path / "a.csv")


def test_a_stated_unit_of_time_is_not_replaced_by_that_of_a_name(tmp_path):
    (tmp_path / "a.csv").write_text("time,x_tip,y_tip\n" + "".join(f"{20 * k},{k},5\n" for k in range(6)))
    recording = read(tmp_path / "a.csv", mapping={"time_unit": "ms", "length_unit": "mm"})
    assert recording["time"].values.tolist() == pytest.approx([0.02 * k for k in range(6)])


@pytest.mark.parametrize(("header", "name", "stated", "factor"), [
    ("time [ms]", "time", {}, 1e-3),
    ("time [us]", "time", {}, 1e-6),
    ("time [ms]", "time [ms]", {}, 1e-3),
    ("time_ms", "time_ms", {}, 1e-3),
    ("millis", "millis", {}, 1e-3),
    ("time", "time", {}, 1.0),
    ("time [ms]", "time", {"time_unit": "ms"}, 1e-3),
    ("time", "time", {"time_unit": "ms"}, 1e-3),
    ("time_ms", "time_ms", {"time_unit": "s"}, 1.0),
])  # fmt: skip
def test_a_column_of_time_has_the_unit_in_its_name(tmp_path, header, name, stated, factor):
    (tmp_path / "a.csv").write_text(f"{header},x,y,z\n" + "".join(f"{20 * k},{k},5,0\n" for k in range(6)))
    recording = read(tmp_path / "a.csv", mapping={**MAPPING, "time": name, **stated})
    assert recording["time"].values.tolist() == pytest.approx([factor * 20 * k for k in range(6)])


@pytest.mark.parametrize("stated", ["s", "us"])
def test_a_mapping_that_states_another_unit_of_time_than_the_column_is_refused(tmp_path, stated):
    (tmp_path / "a.csv").write_text("time,x,y,z\nms,mm,mm,mm\n" + "".join(f"{20 * k},{k},5,0\n" for k in range(6)))
    with pytest.raises(InputError, match=rf"time_unit = '{stated}', but the column 'time \[ms\]' of a.csv is in ms"):
        read(tmp_path / "a.csv", mapping={**MAPPING, "time": "time", "time_unit": stated})


@pytest.mark.parametrize("stated", [{}, {"time_unit": "ms"}])
def test_times_of_day_are_seconds_whatever_their_name_says(tmp_path, stated):
    (tmp_path / "a.csv").write_text("time [ms],x,y,z\n" + "".join(f"10:00:0{k}.500,{k},5,0\n" for k in range(6)))
    recording = read(tmp_path / "a.csv", mapping={**MAPPING, "time": "time", **stated})
    assert recording["time"].values.tolist() == pytest.approx([*range(6)])
