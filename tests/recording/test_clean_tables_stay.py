"""Tables that another reading would damage: what looks like a thousands mark, a summary or a comment, and is none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.recording import read


def written(folder: Path, text: str) -> Path:
    path = folder / "log.csv"
    path.write_text(text, encoding="utf-8")
    return path


def rows(count: int, row: str) -> str:
    return "".join(row.format(k=k, t=0.1 * k) + "\n" for k in range(count))


def test_whole_numbers_beside_three_decimals_are_no_thousands(tmp_path: Path) -> None:
    lines = "0,100.125,5.250,120.000,100\n1,101.125,5.250,120.000,137.895\n2,102.125,5.250,120.000,100\n"
    path = written(tmp_path, "time [s],tip_x [mm],tip_y [mm],tip_z [mm],p_kpa\n" + lines)
    recording = read(path)
    np.testing.assert_allclose(recording["position"].values[:, 0, 0], [0.100125, 0.101125, 0.102125])
    np.testing.assert_allclose(np.ravel(recording["pressure"].values)[:2], [100e3, 137895.0])


def test_a_date_beside_decimal_commas_is_no_mark_of_thousands(tmp_path: Path) -> None:
    text = "Datum;time [s];tip_x [mm];tip_y [mm];p_kpa\n" + rows(4, "03.05.2026;{k};101,125;5,250;10,500")
    recording = read(written(tmp_path, text))
    np.testing.assert_allclose(recording["position"].values[:, 0], [[0.101125, 0.00525, 0.0]] * 4)
    np.testing.assert_allclose(np.ravel(recording["pressure"].values), 10.5e3)


def test_rows_labelled_by_a_phase_are_data(tmp_path: Path) -> None:
    phases = ("rise", "rise", "max", "max", "fall", "fall")
    lines = "".join(f"{phase},{0.1 * k:.1f},{k + 1},2,3\n" for k, phase in enumerate(phases))
    assert read(written(tmp_path, "phase,t,tip_x_mm,tip_y_mm,tip_z_mm\n" + lines)).sizes["time"] == 6


def test_minutes_beside_seconds_are_the_same_clock_again(tmp_path: Path) -> None:
    lines = "".join(f"{k},{k},2,3,{k / 60:.5f}\n" for k in range(5))
    recording = read(written(tmp_path, "time [s],tip_x [mm],tip_y [mm],tip_z [mm],time [min]\n" + lines))
    np.testing.assert_allclose(recording["time"].values, np.arange(5.0))


@pytest.mark.parametrize("header", ["t,x tip,y tip,z tip", "t,x (tip),y (tip),z (tip)"])
def test_names_with_a_station_behind_the_axis_stay(tmp_path: Path, header: str) -> None:
    from pliant.study.column_guess import guessed_table

    path = written(tmp_path, header + "\n" + rows(12, "{t:.1f},{k}.5,2.5,3.5"))
    guess = guessed_table(path)
    assert guess is not None
    assert "p_1" not in str(guess.mapping)


WIDE = "t,tip_x_mm,tip_y_mm,tip_z_mm,p_kpa"


@pytest.mark.parametrize("row", [
    "EVENT,valve open,,,", "EVENT,valve 2 open,,,", "trigger,,,,", "EVENT", ",valve opened,,,", "Pause;,,,,",
])  # fmt: skip
def test_rows_of_words_between_rows_of_numbers_are_left_out_and_counted(tmp_path: Path, row: str) -> None:
    lines = rows(12, "{t:.1f},{k}.5,2.5,3.5,1.25").splitlines()
    plain = read(written(tmp_path, "\n".join([WIDE, *lines, ""])))
    recording = read(written(tmp_path, "\n".join([WIDE, *lines[:5], row, *lines[5:9], row, *lines[9:], ""])))
    np.testing.assert_array_equal(recording["position"], plain["position"])
    np.testing.assert_array_equal(recording["time"], plain["time"])
    assert "2 line(s) of log.csv hold words between its rows of numbers and are left out, the first in line 7" in (
        recording.history)


@pytest.mark.parametrize(("header", "row", "count"), [
    (f"{WIDE},note", "{t:.1f},{k}.5,2.5,3.5,1.25,valve open", 12),
    (f"{WIDE},note,remark,who,why,where,when", "{t:.1f},,,,,valve open,,,,,", 12),  # a time, and a gap
    (f"phase,{WIDE}", "rise,{t:.1f},{k}.5,2.5,3.5,1.25", 12),
    (f"clock,{WIDE},a,b,c,d,e,f", "Nov,{t:.1f},{k}.5,,,,,,,,,", 12),
    ("time,tip_x_mm,tip_y_mm,tip_z_mm,p_kpa", "10:11:0{k},,,,", 10),
])  # fmt: skip
def test_rows_with_a_time_are_no_rows_of_words(tmp_path: Path, header: str, row: str, count: int) -> None:
    lines = rows(count, row).splitlines()
    first = {"time": "10:11:00,1.5,2.5,3.5,1.25", "phas": "rise,0.0,1,2,3,4"}.get(header[:4])
    recording = read(written(tmp_path, "\n".join([header, *([first] if first else lines[:1]), *lines[1:], ""])))
    assert recording.sizes.get("time", recording.sizes.get("pressure_time")) == count
    assert "hold words" not in recording.history


@pytest.mark.parametrize("more", [",,,,\n", "EVENT,valve open,,,\nEVENT,valve closed,,,\n", "EVENT,,,,\n# note\n"])
def test_blank_rows_and_several_rows_of_words_are_left_out(tmp_path: Path, more: str) -> None:
    lines = rows(12, "{t:.1f},{k}.5,2.5,3.5,1.25").splitlines(keepends=True)
    plain = read(written(tmp_path, "".join([WIDE + "\n", *lines, ""])))
    for text in ([WIDE + "\n", *lines[:5], more, *lines[5:]], [WIDE + "\n", *lines, ",,,,\n", ",,,,\n"]):
        recording = read(written(tmp_path, "".join([*text, ""])))
        np.testing.assert_array_equal(recording["position"], plain["position"])


def test_rows_of_a_mapping_count_rows_of_words(tmp_path: Path) -> None:
    lines = rows(12, "{t:.1f},{k}.5,2.5,3.5,1.25").splitlines()
    path = written(tmp_path, "\n".join(["t,x,y,z,p", *lines[:5], "EVENT,,,,", *lines[5:], ""]))
    stated = {"time": "t", "length_unit": "mm", "stations": {"tip": {"position": ["x", "y", "z"]}}, "header": True,
              "na": ["EVENT"], "rows": [7, 9]}  # fmt: skip
    np.testing.assert_allclose(read(path, mapping=stated)["time"], [0.6, 0.7])


def test_a_row_with_a_number_among_words_is_refused(tmp_path: Path) -> None:
    lines = rows(12, "{t:.1f},{k}.5,2.5,3.5,1.25").splitlines()
    with pytest.raises(InputError, match="is not a number: 'EVENT'"):
        read(written(tmp_path, "\n".join([WIDE, *lines[:5], "EVENT,3,,,", *lines[5:], ""])))


def test_a_column_that_repeats_another_in_every_row_is_left_out(tmp_path: Path) -> None:
    text = "t,tip_x_mm,tip_y_mm,p_kpa,t,state,p_kpa,state\n" + rows(6, "{t:.1f},{k}.5,2.5,{k},{t:.1f},OK,{k},OK")
    recording = read(written(tmp_path, text))
    np.testing.assert_allclose(np.ravel(recording["pressure"].values), 1e3 * np.arange(6))
    assert "3 column(s) of log.csv repeat another by name and in every row, and are left out: t, p_kpa, state" in (
        recording.history)
    stated = {"time": 4, "length_unit": "mm", "stations": {"tip": {"position": [1, 2]}},
              "pressure": {"columns": [6], "unit": "kPa"}}  # fmt: skip
    np.testing.assert_array_equal(read(written(tmp_path, text), mapping=stated)["position"].values[..., :2],
                                  recording["position"].values[..., :2])  # fmt: skip


@pytest.mark.parametrize(("header", "row"), [
    ("t,tip_x_mm,tip_y_mm,p_kpa,p_kpa", "{t:.1f},{k}.5,2.5,{k},1"),
    ("t,tip_x_mm,tip_y_mm,p_kpa,t", "{t:.1f},{k}.5,2.5,{k},{t:.2f}"),
    ("t,tip_x_mm,tip_y_mm,p_kpa,note,note", "{t:.1f},{k}.5,2.5,{k},ok,o{k}"),
])  # fmt: skip
def test_columns_with_one_name_and_other_cells_are_refused(tmp_path: Path, header: str, row: str) -> None:
    with pytest.raises(InputError, match="has repeated column names"):
        read(written(tmp_path, header + "\n" + rows(6, row)))


def test_bodies_without_names_that_stand_at_one_place_stay_bodies(tmp_path: Path) -> None:
    recording = read(written(tmp_path, "t,x,y,z,x,y,z\n" + rows(6, "{t:.1f},1.5,2.5,{k},1.5,2.5,{k}")))
    assert recording.sizes["station"] == 2


def test_means_below_a_table_with_units_are_left_out(tmp_path: Path) -> None:
    text = "t,tip_x,tip_y,p\n[s],[mm],[mm],[kPa]\n" + rows(6, "{t:.1f},{k}.5,2.5,1") + "\nMean,3,2.5,1\n"
    recording = read(written(tmp_path, text))
    assert recording.sizes["time"] == 6
    assert "1 row(s) below the table of log.csv are left out" in recording.history


@pytest.mark.parametrize(("names", "expected"), [
    (["pressure", "pressure temp"], ["pressure"]), (["pressure temp"], ["pressure temp"]),
    (["pressure_left", "pressure_template"], ["pressure_left", "pressure_template"]),
    (["pressureTemp", "p1"], ["p1"]), (["tempered_pressure", "p1"], ["tempered_pressure", "p1"]),
])  # fmt: skip
def test_a_temperature_beside_pressures_is_none(names: list[str], expected: list[str]) -> None:
    from pliant.recording.column_names import unitless_pressures

    assert unitless_pressures(names) == expected


def test_a_second_table_with_other_columns_is_not_joined_by_leaving_out_its_names(tmp_path: Path) -> None:
    lines = rows(12, "{t:.1f},{k}.5,2.5,3.5,1.25").splitlines()
    for names in ("time,force,,,", "zeit,kraft,,,", "force,,,,"):
        text = "\n".join([WIDE, *lines, names, *lines, ""])
        with pytest.raises(InputError, match="is not a number"):
            read(written(tmp_path, text))


def test_rows_labelled_by_a_word_at_first_and_then_by_numbers_are_data(tmp_path: Path) -> None:
    labels = ("rise", *("1" for _ in range(5)), *("max" for _ in range(6)))
    text = "".join(f"{label},{0.1 * k:.1f},{k},2.5,3.5,1.25\n" for k, label in enumerate(labels))
    assert read(written(tmp_path, f"phase,{WIDE}\n{text}")).sizes["time"] == 12
