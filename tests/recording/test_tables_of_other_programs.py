"""Text tables as spreadsheets, loggers and scripts write them: rows of names, comments, marks between thousands, times
and units. Each is one table, written in another way, and must read as the plain one.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from command_line import invoke

from pliant.errors import InputError
from pliant.recording import read

TIMES = 0.01 * np.arange(150)
PLACES = np.column_stack([np.zeros((150, 3)), 5 * np.sin(4 * TIMES), 4 * np.sin(4 * TIMES), 120 - TIMES]) + 1300.0  # mm
KILOPASCALS = 30.0 + 30.0 * np.sin(2 * TIMES)
NAMES = [f"{station}_{axis} [mm]" for station in ("base", "tip") for axis in "xyz"]
HEAD = ["time [s]", *NAMES, "pressure [kPa]"]


def cells(columns=None, places=4):
    table = np.column_stack([TIMES, PLACES, KILOPASCALS]) if columns is None else columns
    return [[f"{v:.{places}f}" for v in row] for row in table]


def text(rows, head=HEAD, delimiter=","):
    return "".join(delimiter.join(row) + "\n" for row in [head, *rows])


def is_the_table(recording, tolerance=1e-6):
    assert recording["time"].values - recording["time"].values[0] == pytest.approx(TIMES, abs=2e-4)
    assert recording["position"].values.reshape(150, -1) == pytest.approx(1e-3 * PLACES, abs=tolerance)
    assert recording["pressure"].values.reshape(-1) == pytest.approx(1e3 * KILOPASCALS, rel=1e-3, abs=2.0)
    return recording.attrs["history"]


def written(folder, content, encoding="utf-8"):
    (folder / "a.csv").write_bytes(content.encode(encoding))
    return folder / "a.csv"


def grouped(mark, point):
    """Cells with a mark between thousands."""
    swap = {",": mark, ".": point}
    return [["".join(swap.get(c, c) for c in f"{float(cell):,.4f}") for cell in row] for row in cells()]


@pytest.mark.parametrize(("mark", "point"), [(",", "."), (".", ","), ("\u202f", ","), ("\u00a0", "."), ("'", "."),
                                             (" ", ",")])  # fmt: skip
def test_marks_between_thousands_are_left_out_and_named(tmp_path, mark, point):
    history = is_the_table(read(written(tmp_path, text(grouped(mark, point), delimiter=";"))))
    assert "between thousands" in history


def test_quoted_numbers_with_marks_between_thousands(tmp_path):
    rows = [[f'"{cell}"' for cell in row] for row in grouped(",", ".")]
    assert "between thousands" in is_the_table(read(written(tmp_path, text(rows))))
    rows = [['"' + cell.replace(".", ",") + '"' for cell in row] for row in cells()]
    assert "decimal commas" in is_the_table(read(written(tmp_path, text(rows))))


@pytest.mark.parametrize("mark", [",", "."])
def test_whole_thousands_beside_smaller_numbers_are_no_decimals(tmp_path, mark):
    rows = [[f"{1e3 * t:,.0f}".replace(",", mark), *(f"{v:.0f}" for v in place), f"{1e3 * p:,.0f}".replace(",", mark)]
            for t, place, p in zip(TIMES, PLACES, KILOPASCALS, strict=True)]  # fmt: skip
    head = ["time [ms]", *NAMES, "pressure [Pa]"]
    is_the_table(read(written(tmp_path, text(rows, head, "\t"))), tolerance=6e-4)


def test_decimals_of_three_digits_stay_decimals(tmp_path):
    rows = [[cell.replace(".", ",") for cell in row] for row in cells(places=3)]
    assert "between thousands" not in is_the_table(read(written(tmp_path, text(rows, delimiter=";"))), tolerance=1e-6)


BEGIN = datetime(2026, 11, 28, 23, 59, 59, 300000, tzinfo=UTC)
NOON = datetime(2026, 2, 1, 11, 59, 59, 300000, tzinfo=UTC)

AMBIGUOUS = datetime(2026, 2, 1, 23, 59, 59, tzinfo=UTC)


@pytest.mark.parametrize(("begin", "form", "remark"), [
    (NOON, "%m/%d/%Y %I:%M:%S.%f %p", ""), (BEGIN, "%d.%m.%Y %H:%M:%S.%f", ""),
    (AMBIGUOUS, "%d/%m/%Y %H:%M:%S.%f", "day-month-year; month-day-year would be possible"),
    (BEGIN, "%d-%b-%Y %H:%M:%S.%f", ""), (BEGIN, "%Y-%m-%dT%H:%M:%S.%fZ", ""), (NOON, "%I:%M:%S.%f %p", ""),
    (datetime(2026, 1, 1, tzinfo=UTC), "%M:%S.%f", ""), (BEGIN, "%H:%M:%S:%f", ""),
])  # fmt: skip
def test_dates_and_times_of_day(tmp_path, begin, form, remark):
    clock = [(begin + timedelta(seconds=float(t))).strftime(form) for t in TIMES]
    rows = [[time, *row[1:]] for time, row in zip(clock, cells(), strict=True)]
    history = is_the_table(read(written(tmp_path, text(rows, ["Timestamp", *HEAD[1:]]))))
    assert remark in history
    commas = [[time, *(cell.replace(".", ",") for cell in row[1:])] for time, row in zip(clock, rows, strict=True)]
    is_the_table(read(written(tmp_path, text(commas, ["elapsed (hh:mm:ss.ms)", *HEAD[1:]], ";"))))


def test_a_date_that_is_none_is_refused(tmp_path):
    rows = [["2026-13-45 10:00:00.0", *row[1:]] for row in cells()]
    with pytest.raises(InputError, match=r"a\.csv: '2026-13-45' in the column of time is not a date"):
        read(written(tmp_path, text(rows, ["time", *HEAD[1:]])))


@pytest.mark.parametrize(("name", "values"), [
    ("time [min]", TIMES / 60), ("time_h", TIMES / 3600), ("Date", 46354.5 + TIMES / 86400),
    ("time (msec)", 1e3 * TIMES), ("Time [seconds]", TIMES),
])  # fmt: skip
def test_units_of_times(tmp_path, name, values):
    rows = [[f"{t:.11f}", *row[1:]] for t, row in zip(values, cells(), strict=True)]
    history = is_the_table(read(written(tmp_path, text(rows, [name, *HEAD[1:]]))))
    assert ("days of a spreadsheet" in history) == (name == "Date")


def test_seconds_of_a_long_log_are_no_days(tmp_path):
    rows = [[f"{46354.5 + t:.5f}", *row[1:]] for t, row in zip(TIMES, cells(), strict=True)]
    is_the_table(read(written(tmp_path, text(rows))))


@pytest.mark.parametrize(("unit", "factor"), [
    ("bar(g)", 1e-2), ("barg", 1e-2), ("psig", 1 / 6.894757), ("inHg", 1 / 3.386389), ("mm Hg", 7.50062), ("hPa", 10.0),
    ("kgf/cm2", 1 / 98.0665), ("MPa", 1e-3), ("cmH2O", 10.19716),
])  # fmt: skip
def test_units_of_pressures(tmp_path, unit, factor):
    rows = [[*row[:-1], f"{factor * p:.6f}"] for row, p in zip(cells(), KILOPASCALS, strict=True)]
    for name in (f"pressure [{unit}]", f"pressure ({unit})"):
        is_the_table(read(written(tmp_path, text(rows, [*HEAD[:-1], name]))))


@pytest.mark.parametrize(("unit", "factor"), [("cm", 0.1), ("inch", 1 / 25.4), ("inches", 1 / 25.4), ("ft", 1 / 304.8),
                                              ("dm", 1e-2), ("\u00b5m", 1e3), ("Millimeters", 1.0)])  # fmt: skip
def test_units_of_positions(tmp_path, unit, factor):
    head = [name.replace("mm", unit) for name in HEAD]
    is_the_table(read(written(tmp_path, text(cells(np.column_stack([TIMES, factor * PLACES, KILOPASCALS]), 6), head))))
    underscored = [name.replace(" [mm]", f"_{unit}") for name in HEAD]
    is_the_table(read(written(tmp_path, text(cells(np.column_stack([TIMES, factor * PLACES, KILOPASCALS]), 6),
                                             underscored))))  # fmt: skip


@pytest.mark.parametrize(("below", "count"), [
    ("mean,1,1,1,1,1,1,1\nstd,0,0,0,0,0,0,0\n", 2), ("\nMean:\n,1,1,1,1,1,1,1\n", 2), ("END OF FILE\n", 1),
    ("recording stopped, by the operator\n", 1),
])  # fmt: skip
def test_rows_below_a_table_are_left_out_and_counted(tmp_path, below, count):
    assert f"{count} row(s) below the table" in is_the_table(read(written(tmp_path, text(cells()) + below)))


def test_comments_and_names_among_the_rows_are_left_out_and_counted(tmp_path):
    rows = text(cells()).splitlines(keepends=True)
    content = "".join([*rows[:40], "# paused\n", *rows[40:90], rows[0], *rows[90:], "# end\n"])
    history = is_the_table(read(written(tmp_path, content)))
    assert "2 line(s) of a.csv are comments among its rows and are left out, the first in line 41" in history
    assert "1 line(s) of a.csv repeat the names of its columns" in history


@pytest.mark.parametrize("above", [
    "# " + ",".join(HEAD) + "\n", "% " + "\t".join(HEAD) + "\n", "\t".join(HEAD) + "\n",
    "# exported\n#" + ";".join(HEAD) + "\n# 100 Hz\n",
])  # fmt: skip
def test_names_in_a_comment_or_with_another_delimiter(tmp_path, above):
    rows = text(cells()).partition("\n")[2]
    assert "holds the names of its columns" in is_the_table(read(written(tmp_path, above + rows)))


@pytest.mark.parametrize("above", [
    ",base,,,tip,,,chamber\ntime [s],x [mm],y [mm],z [mm],x [mm],y [mm],z [mm],kPa\n",
    ",base,base,base,tip,tip,tip,pressure\ntime,x,y,z,x,y,z,kPa\ns,mm,mm,mm,mm,mm,mm,kPa\n",
    "Gripper 3\n,base,,,tip,,,p\ntime [s],x [mm],y [mm],z [mm],x [mm],y [mm],z [mm],kPa\n",
])  # fmt: skip
def test_two_rows_of_names(tmp_path, above):
    recording = read(written(tmp_path, above + text(cells()).partition("\n")[2]))
    assert "name its columns together" in is_the_table(recording)
    assert recording["station"].values.tolist() == ["base", "tip"]


def test_coordinates_without_names_of_bodies_are_numbered(tmp_path):
    head = ["time [s]", *["x [mm]", "y [mm]", "z [mm]"] * 2, "pressure [kPa]"]
    recording = read(written(tmp_path, text(cells(), head)))
    assert "bodies p1 to p2" in is_the_table(recording)
    assert recording["station"].values.tolist() == ["p1", "p2"]


def test_units_behind_the_numbers(tmp_path):
    rows = [[f"{row[0]} s", *(f"{cell} mm" for cell in row[1:-1]), f"{row[-1]}kPa"] for row in cells()]
    head = ["time", *(name.replace(" [mm]", "") for name in NAMES), "pressure"]
    assert "units in the cells of 8 column(s)" in is_the_table(read(written(tmp_path, text(rows, head))))


def test_marks_of_missing_numbers_are_gaps(tmp_path):
    rows = cells()
    for k, mark in enumerate(("-", "N/A", "#DIV/0!", "None", "-1.#IND")):
        rows[20 + k][4:7] = [mark] * 3
    recording = read(written(tmp_path, text(rows)))
    assert int(recording["position"].isnull().any("axis").sum()) == 5


def test_a_table_of_utf_16_with_a_degree(tmp_path):
    rows = [[*row, "21.5"] for row in cells()]
    for encoding in ("utf-16", "cp1252"):
        path = written(tmp_path, text(rows, [*HEAD, "room [\u00b0C]"]), encoding)
        assert "a.csv is read as" in is_the_table(read(path))
        assert invoke("inspect", path).exit_code == 0


def test_a_second_table_is_not_joined_to_the_first(tmp_path):
    rows = text(cells()).partition("\n")[2]
    path = written(tmp_path, text(cells()) + "\n# trial 2\n" + rows)
    with pytest.raises(InputError, match=r"a\.csv holds 2 runs below each other"):
        read(path)
    assert read(path, mapping={"select": {"column": "run", "value": 2}}).sizes["time"] == len(cells())


def test_a_pressure_that_was_never_measured_is_left_out_and_named(tmp_path):
    rows = [[*row, ""] for row in cells()]
    history = is_the_table(read(written(tmp_path, text(rows, [*HEAD, "spare [kPa]"]))))
    assert "1 column(s) of pressure of a.csv hold no number" in history


def test_a_command_beside_a_measured_pressure_is_no_chamber(tmp_path):
    rows = [[*row[:-1], "99", row[-1]] for row in cells()]
    recording = read(written(tmp_path, text(rows, [*HEAD[:-1], "p_set [kPa]", "p_meas [kPa]"])))
    assert "p_set [kPa]" in is_the_table(recording)


def test_repeated_names_are_refused_as_the_file_writes_them(tmp_path):
    rows = [[*row, "0"] for row in cells()]
    with pytest.raises(InputError, match=r"repeated column names: pressure \[kPa\]: .* by index"):
        read(written(tmp_path, text(rows, [*HEAD, "pressure [kPa]"])))
