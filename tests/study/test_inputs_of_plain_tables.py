"""Columns of valves, sensors, motors and positions that no mapping describes: what only the laboratory knows is asked,
and nothing is read as what it is not.
"""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
from command_line import invoke
from small_study import TIMES, table

from pliant.recording import read
from pliant.study.column_guess import guessed_table
from pliant.study.draft import draft_study
from pliant.study.named_levels import named_pressure

pytestmark = pytest.mark.usefixtures("untried")
DATA = table(90.0)
PRESSURE = DATA[:, 1]
NAMES = ["time [s]", *(f"{station}_{axis} [mm]" for station in ("base", "tip") for axis in "xyz")]


def written(path, names, *columns):
    rows = np.column_stack([TIMES, 1e3 * DATA[:, 2:]])
    lines = [",".join([*(f"{v:.6g}" for v in row), *cells]) for row, *cells in zip(rows, *columns, strict=True)]
    path.write_text("\n".join([",".join([*NAMES, *names]), *lines, ""]), encoding="utf-8")
    return path


def drafted(folder, names, *columns):
    path = written(folder / "a.csv", names, *columns)
    done = invoke("new", folder / "s.toml", "--from", path, "--length", "120mm", "--mass", "50g")
    assert done.exit_code == 0, done.exception or done.output
    return tomllib.loads((folder / "s.toml").read_text(encoding="utf-8")), done.output


def plain(values):
    return [f"{v:.6g}" for v in values]


STATE = PRESSURE > 1.0


@pytest.mark.parametrize(("name", "cells", "asked"), [
    ("valve", ["1" if on else "0" for on in STATE], {"unit": "kPa", "scale": "?"}),
    ("valve_open", ["True" if on else "False" for on in STATE], {"unit": "kPa", "scale": "?"}),
    ("solenoid 1", ["ON" if on else "OFF" for on in STATE], {"unit": "kPa", "scale": "?"}),
    ("PWM duty [%]", plain(PRESSURE / 0.9), {"unit": "kPa", "scale": "?"}),
    ("pressure [V]", plain(0.5 + PRESSURE / 50), {"unit": "kPa", "scale": "?", "zero": "?"}),
    ("pressure_counts", plain(np.rint(102 + 9 * PRESSURE)), {"unit": "kPa", "scale": "?", "zero": "?"}),
    ("P [bar(a)]", plain(1.013 + PRESSURE / 100), {"unit": "bar", "zero": "?"}),
    ("pressure_abs [kPa]", plain(101.3 + PRESSURE), {"unit": "kpa", "zero": "?"}),
])  # fmt: skip
def test_a_valve_or_a_sensor_asks_for_what_makes_it_a_pressure(tmp_path, name, cells, asked):
    study, output = drafted(tmp_path, [name], cells)
    assert study["mapping"]["pressure"] == {"columns": [name], **asked}
    assert "? pressure: " in output
    answered = {**study["mapping"], "pressure": {**study["mapping"]["pressure"], **dict.fromkeys(
        {"scale", "zero"} & set(asked), 2.0)}}  # fmt: skip
    recording = read(tmp_path / "a.csv", mapping=answered)
    stored = np.array([{"True": 1, "False": 0, "ON": 1, "OFF": 0}.get(c, c) for c in cells], float)
    zero, scale = 2.0 * ("zero" in asked), 2.0 if "scale" in asked else 1.0
    pascal = {"kPa": 1e3, "kpa": 1e3, "bar": 1e5}[asked["unit"]]
    assert recording["pressure"].values.reshape(-1) == pytest.approx((stored - zero) * scale * pascal)


def test_a_servo_beside_positions_is_no_log_of_angles(tmp_path):
    study, _ = drafted(tmp_path, ["servo angle"], plain(PRESSURE))
    assert study["mapping"]["inputs"] == [{"columns": ["servo angle"], "kind": "angle", "unit": "deg"}]
    assert set(study["mapping"]["stations"]) == {"base", "tip"}


@pytest.mark.parametrize(("name", "values", "kind", "unit"), [
    ("motor [turns]", PRESSURE / 90, "angle", "rev"), ("tendon [inch]", PRESSURE / 400, "displacement", "in"),
    ("tendon", PRESSURE / 9e3, "displacement", "m"), ("tendon", PRESSURE / 9.1, "displacement", "mm"),
])  # fmt: skip
def test_units_of_motors_and_tendons(tmp_path, name, values, kind, unit):
    guess = guessed_table(written(tmp_path / "a.csv", [name], plain(values)))
    assert guess is not None
    assert guess.mapping["inputs"] == [{"columns": [name], "kind": kind, "unit": unit}]
    assert any("taken in" in note and name in note for note in guess.notes) == (name == "tendon")


def test_two_units_of_pressure_are_two_chambers(tmp_path):
    path = written(tmp_path / "a.csv", ["1_P [kPa]", "P [psi]", "note_x"], plain(PRESSURE), plain(PRESSURE[::-1] / 6.9),
                   plain(PRESSURE))
    guess = guessed_table(path)
    assert guess is not None
    pressures = read(path, mapping=guess.readable)["pressure"].values
    assert np.nanmax(pressures, axis=0) == pytest.approx([9e4, 9e4], rel=2e-3)


def test_supplies_and_the_atmosphere_beside_a_pressure_are_no_chambers(tmp_path):
    changing = plain(101.3 + 0.01 * np.sin(TIMES))
    guess = guessed_table(written(tmp_path / "a.csv", ["atm [kPa]", "P [kPa]"], changing, plain(PRESSURE)))
    assert guess is not None
    assert guess.mapping["pressure"]["columns"] == ["P [kPa]"]


def test_a_draft_without_inputs_names_the_columns_that_change(tmp_path):
    _, output = drafted(tmp_path, ["u"], plain(PRESSURE))
    assert "left-out column(s) of a.csv changes during the recording: u; if one of them moves the body" in output


@pytest.mark.parametrize(("unit", "message"), [
    ("furlong", "the column 'base_x \\[furlong\\]' of a.csv states no known unit of length"),
    ("mixed", "a.csv states several units of length in its column names"),
])
def test_positions_in_unknown_or_several_units_are_refused(tmp_path, unit, message):
    path = written(tmp_path / "a.csv", ["pressure [kPa]"], plain(PRESSURE))
    lines = path.read_text(encoding="utf-8").split("\n")
    lines[0] = lines[0].replace("mm", unit) if unit == "furlong" else lines[0].replace("tip_x [mm]", "tip_x [cm]")
    path.write_text("\n".join(lines), encoding="utf-8")
    for command in (["inspect", path], ["new", tmp_path / "s.toml", "--from", path]):
        done = invoke(*command)
        assert done.exit_code == 1
        with pytest.raises(type(done.exception), match=message):
            raise done.exception
    assert not (tmp_path / "s.toml").exists()


def test_times_that_go_back_are_no_question_for_a_rate(tmp_path):
    path = written(tmp_path / "a.csv", ["valve"], ["1" if on else "0" for on in STATE])
    head, *rows = path.read_text(encoding="utf-8").strip().split("\n")
    path.write_text("\n".join([head, *rows[::-1], ""]), encoding="utf-8")
    done = invoke("new", tmp_path / "s.toml", "--from", path)
    assert done.exit_code == 1
    assert "goes back from 1.59 to 1.58" in str(done.exception)


def test_a_station_that_no_frame_shows_is_left_out_and_named(tmp_path):
    path = tmp_path / "a.csv"
    rows = [",".join([*plain([t]), *plain(1e3 * row[:3]), "", "NaN", "", *plain(1e3 * row[3:]), *plain([p])])
            for t, row, p in zip(TIMES, DATA[:, 2:], PRESSURE, strict=True)]  # fmt: skip
    head = ["time [s]", *(f"{s}_{a} [mm]" for s in ("base", "mid", "tip") for a in "xyz"), "p_kPa"]
    path.write_text("\n".join([",".join(head), *rows, ""]), encoding="utf-8")
    draft = draft_study([path], tmp_path / "s.toml", length=0.12, mass=0.05)
    assert draft.inspected is not None
    aligned = draft.inspected.first.aligned
    assert aligned is not None
    assert aligned["station"].values.tolist() == ["base", "tip"]
    assert "mid: never labelled, left out" in aligned.attrs["history"]
    assert not draft.questions


@pytest.mark.parametrize(("stem", "kilopascals"), [
    ("pulse_60kPa", 60.0), ("p60kPa", 60.0), ("vent_-20kPa", -20.0), ("p1_12.5kPa", 12.5), ("trial_1_60kPa", 60.0),
    ("100mbar", 10.0), ("1.2bar_02", 120.0), ("60kPa_60kPa", 60.0),
    ("p-20kPa", None), ("p1_12,5kPa", None), ("2_5bar", None), ("arm_12_40kPa", None), ("minus_20kPa", None),
    ("vac20kPa", None), ("60kPa_left_30kPa", None), ("arm", None),
])  # fmt: skip
def test_a_pressure_in_a_name_has_the_sign_of_the_name_or_is_not_read(stem, kilopascals):
    assert named_pressure(stem) == (None if kilopascals is None else pytest.approx(1e3 * kilopascals))


@pytest.mark.parametrize(("stem", "asked"), [("p-60kPa", True), ("p_60kPa", False)])
def test_an_unclear_pressure_in_a_name_is_asked_and_no_release(tmp_path, stem, asked):
    path = written(tmp_path / f"{stem}.csv", [])
    done = invoke("new", tmp_path / "s.toml", "--from", path, "--length", "120mm", "--mass", "50g")
    assert done.exit_code == 0, done.exception
    entry = tomllib.loads((tmp_path / "s.toml").read_text(encoding="utf-8"))["recordings"][path.stem]
    assert entry["nominal_pressure"] == ("?" if asked else 60.0)
    assert entry.get("excitation") != "release"
