"""Column names as laboratories write them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pliant import read
from pliant.errors import InputError
from pliant.recording.column_names import standard_names
from pliant.study.first_reading import with_logs


@pytest.mark.parametrize(("names", "expected", "unit"), [
    (["time_ms", "tip_x_mm", "tip_y_mm", "Pressure (mbar)"], ["t_ms", "x_tip", "y_tip", "p_mbar"], "mm"),
    (["Time (s)", "M 1.X [cm]", "M 1.Y [cm]", "p_kPa"], ["t", "x_M 1", "y_M 1", "p_kpa"], "cm"),
    (["t", "x_tip", "y_tip", "p_kpa_left", "force_x", "force_y"],) * 2 + ("",),
    (["t", "x_tip_mm", "y_tip_mm", "pressure_left_kPa", "right pressure [psi]"],
     ["t", "x_tip", "y_tip", "p_kpa_left", "p_psi_right"], "mm"),
    (["t", "tip_x", "tip_y", "acc_x", "acc_y"], ["t", "x_tip", "y_tip", "acc_x", "acc_y"], ""),
    (["t", "x_m", "y_m"],) * 2 + ("",),  # a station called m
    (["t", "x_000", "y_000", "qx_000", "angle_000", "psi"],) * 2 + ("",),
    (["timestamp_us", "tip x", "tip y"], ["t_us", "x_tip", "y_tip"], ""),
    (["t", "tip X [mm]", "tip Y [mm]", "P1 [kPa]", "P2 [kPa]", "supply [kPa]", "P1 set (kPa)"],
     ["t", "x_tip", "y_tip", "p_kpa_P1", "p_kpa_P2", "supply [kPa]", "P1 set (kPa)"], "mm"),
    (["t", "x_tip", "y_tip", "Kammer (mbar)", "mass [g]"], ["t", "x_tip", "y_tip", "p_mbar", "mass [g]"], ""),
    (["t", "x_tip", "y_tip", "p_kpa", "CH2_kPa"], ["t", "x_tip", "y_tip", "p_kpa", "p_kpa_CH2"], ""),
])  # fmt: skip
def test_spellings(names: list[str], expected: list[str], unit: str) -> None:
    renamed = standard_names(names, "a.csv")
    assert (renamed.names, renamed.length_unit) == (expected, unit)
    assert bool(renamed.findings) == (names != expected)


@pytest.mark.parametrize("names", [
    "t bx by bz tx ty tz -> t x_b y_b z_b x_t y_t z_t",
    "t bx_mm by_mm bz_mm mx_mm my_mm mz_mm -> t x_b y_b z_b x_m y_m z_m",
    "t P_Q0 P_Qx P_Qy P_Qz P_Tx P_Ty P_Tz -> t qw_P qx_P qy_P qz_P x_P y_P z_P",
    "t P1_Tx_mm P1_Ty_mm P1_Tz_mm P2_Tx_mm P2_Ty_mm P2_Tz_mm -> t x_P1 y_P1 z_P1 x_P2 y_P2 z_P2",
    "t tx ty tz q0 qx qy qz -> t x_body y_body z_body qw_body qx_body qy_body qz_body",
    "t tip_x tip_y tip_z tip_q0 tip_qx tip_qy tip_qz -> t x_tip y_tip z_tip qw_tip qx_tip qy_tip qz_tip",
    "t px py pz vx vy vz ax ay az -> t x_body y_body z_body vx vy vz ax ay az",
    "t Fx Fy Fz Tx Ty Tz -> t Fx Fy Fz Tx Ty Tz",  # a load cell
    "t ax ay az gx gy gz mx my mz -> t ax ay az gx gy gz mx my mz",  # an inertial sensor
    "t tip_x tip_y tip_q1 tip_q2 tip_q3 tip_q4 -> t x_tip y_tip tip_q1 tip_q2 tip_q3 tip_q4",
    "t field.fluid_pressure field.variance -> t p_pa field.variance",
    "t fluid_pressure chamber_kpa -> t fluid_pressure p_kpa",
    "t baro.fluid_pressure p_kpa -> t baro.fluid_pressure p_kpa",
    "t baro.fluid_pressure tip_x tip_y -> t baro.fluid_pressure x_tip y_tip",
    "ms p_kpa -> t_ms p_kpa",
    "sec ms p_kpa -> sec ms p_kpa",
    "t ms p_kpa -> t ms p_kpa",
    "time_ms ms p_kpa -> t_ms ms p_kpa",
])
def test_short_names(names: str) -> None:
    recorded, expected = (part.split() for part in names.split(" -> "))
    assert standard_names(recorded, "a.csv").names == expected


@pytest.mark.parametrize(("places", "others"), [
    ("tx ty tz", "rx ry rz"), ("px py pz", "rx ry rz"), ("px py pz", "ux uy uz"), ("px py pz", "dx dy dz"),
    ("px py pz", "Bx By Bz"), ("tx ty tz", "Bx By Bz"), ("tx ty tz", "mx my mz"), ("tx_mm ty_mm tz_mm", "fx fy fz"),
    ("tx ty tz", "Fx Fy Fz"), ("tx ty tz", "fx fy fz"), ("x y z", "q0 q1 q2 q3"), ("tx ty tz", "q0 q1 q2 q3"),
    ("", "wrist_Tx wrist_Ty wrist_Tz"), ("", "mx my mz"), ("", "Bx By Bz"), ("", "angle_deg mx my mz"),
    ("", "angle_deg Bx By Bz"), ("", "angle_deg rx ry rz"), ("", "px_mm py_mm pz_mm tx_mm ty_mm tz_mm"),
])  # fmt: skip
def test_rotations_fields_and_angles_of_joints_are_no_places(places: str, others: str) -> None:
    named = ["t", *places.split(), *others.split(), "p_kpa"]
    body = [f"{axis}_body" for axis in "xyz" if places]
    assert standard_names(named, "a.csv").names == ["t", *body, *others.split(), "p_kpa"]


def test_a_french_article_is_no_set_point() -> None:
    names = ["t", "pression des tubes [kPa]", "consigne [kPa]"]
    assert standard_names(names, "a.csv").names == ["t", "p_kpa", "consigne [kPa]"]


@pytest.mark.parametrize("names", [
    "t soll_kPa -> t p_kpa",  # alone in a log, a set point is what is known
    "t soll_a_kPa consigne_b_kPa -> t p_kpa_soll_a p_kpa_consigne_b",
    "t x_tip y_tip soll_kPa -> t x_tip y_tip soll_kPa",  # the measured pressure may be in a log
    "t tip_x tip_y soll_kPa P1_kPa -> t x_tip y_tip soll_kPa p_kpa",
    "t tx ty tz target_psi -> t x_body y_body z_body target_psi",
    "t soll_kPa pressure_left -> t soll_kPa pressure_left",  # measured, in a unit to be stated
    "t soll_kPa chamber_abs_kPa -> t soll_kPa chamber_abs_kPa",  # measured, to become a gauge pressure
    "t supply_kPa -> t supply_kPa", "t set_tank_kPa -> t set_tank_kPa", "t soll_kPa p_kpa -> t soll_kPa p_kpa",
    "t soll_1_kPa ist_1 -> t soll_1_kPa ist_1", "t druck_soll_kPa druck_ist -> t druck_soll_kPa druck_ist",
    "t reference_kPa p1_raw -> t reference_kPa p1_raw", "t ref_kPa -> t ref_kPa",
    "t soll_kPa CH2_kPa -> t soll_kPa p_kpa", "t soll_deg -> t soll_deg",
])  # fmt: skip
def test_a_set_point_is_the_pressure_only_of_a_log_without_another(names: str) -> None:
    recorded, expected = (part.split() for part in names.split(" -> "))
    assert standard_names(recorded, "a.csv").names == expected


def written(path: Path, names: str) -> Path:
    rows = [",".join(f"{0.01 * k + 0.1 * j:.2f}" for j, _ in enumerate(names.split())) for k in range(20)]
    path.write_text("\n".join([names.replace(" ", ","), *rows, ""]))
    return path


@pytest.mark.parametrize(("names", "sentence"), [
    ("t fx fy fz tx ty tz p_kpa", "tx, ty, tz of a.csv are the torques of a load cell or the place of a body"),
    ("t x_tip y_tip soll_kPa", "'soll_kPa' of a.csv is a set point by its name, and is not read"),
    ("t Fx Fy Fz Tx Ty Tz p_kpa", ""), ("t tx ty tz fx fy fz p_kpa", ""), ("t x_tip y_tip fx fy fz p_kpa", ""),
    ("t x_tip y_tip supply_kPa", ""), ("t x_tip y_tip p_kpa", ""),
])  # fmt: skip
def test_columns_that_may_be_meant_are_named_with_the_entry_that_reads_them(tmp_path, names, sentence):
    recording = read(written(tmp_path / "a.csv", names))
    lines = [line for line in recording.history.splitlines() if "if nothing measured" in line or "if a place" in line]
    assert len(lines) == bool(sentence)
    assert all(line.startswith(sentence) for line in lines)
    assert ("position" in recording) == ("x_tip" in names or names.startswith("t tx"))


def test_the_entries_named_for_such_columns_read_them(tmp_path):
    path = written(tmp_path / "a.csv", "t fx fy fz tx ty tz soll_kPa")
    stated = {"stations": {"tip": {"position": ["tx", "ty", "tz"]}}, "length_unit": "m",
              "pressure": {"columns": ["soll_kPa"], "unit": "kpa"}}  # fmt: skip
    recording = read(path, mapping=stated)
    np.testing.assert_allclose(recording.position.values[0, 0], [0.4, 0.5, 0.6])
    np.testing.assert_allclose(recording.pressure.values[:2], [700.0, 710.0])
    with pytest.raises(InputError, match=r"add the recording to which it belongs.*tx, ty, tz of a.csv are the torques"):
        with_logs([path])


def test_two_names_of_one_column_stay_as_they_are() -> None:
    names = ["t", "time", "x_tip", "tip_x", "y_tip"]
    assert standard_names(names, "a.csv").names == names
    assert standard_names(["t", "x_tip_mm", "y_tip_mm", "p_kPa", "pressure_kPa"], "a.csv") == (
        ["t", "x_tip", "y_tip", "p_kPa", "pressure_kPa"], "mm",
        ["2 column(s) are read under standard names, such as 'x_tip_mm' as 'x_tip'; positions are in mm"],
    )


def test_units_that_differ_are_refused() -> None:
    with pytest.raises(InputError, match=r"several units of length .* \(m, mm\)"):
        standard_names(["t", "x_a_mm", "y_a_m"], "a.csv")
    with pytest.raises(InputError, match=r"several units of length .* \(mm, no unit\)"):
        standard_names(["t", "x_a_mm", "y_a"], "a.csv")


def test_a_table_in_millimetres_and_milliseconds(tmp_path) -> None:
    path = tmp_path / "lab.csv"
    rows = [f"{10 * k};{k}.5;{2 * k};0.0;{k}" for k in range(12)]
    path.write_text("time_ms;tip_x_mm;tip_y_mm;tip_z_mm;Pressure (mbar)\n" + "\n".join(rows) + "\n")
    ds = read(path)
    assert ds.time.values[-1] == pytest.approx(0.11)
    np.testing.assert_allclose(ds.position.values[3, 0], [3.5e-3, 6e-3, 0.0])
    np.testing.assert_allclose(ds.pressure.values[:2], [0.0, 100.0])
    assert "5 column(s) are read under standard names, such as 'tip_x_mm' as 'x_tip'; positions are in mm" in ds.history
    path.with_suffix(".json").write_text('{"length_unit": "m"}')
    with pytest.raises(InputError, match=r"the column names state mm, but length_unit is m: correct one"):
        read(path)
