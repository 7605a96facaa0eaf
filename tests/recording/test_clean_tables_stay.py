"""Tables that another reading would damage: what looks like a thousands mark, a summary or a comment, and is none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

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
