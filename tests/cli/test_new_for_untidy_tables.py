"""Drafts of tables as laboratories write them: each is recognised without a mapping, by `pliant new` alone."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from command_line import invoke
from small_study import TIMES, table

pytestmark = pytest.mark.usefixtures("untried")
LEVEL = 90.0
NAMES = ["base_x", "base_y", "base_z", "tip_x", "tip_y", "tip_z"]
DATA = table(LEVEL)


def written(path: Path, head: list[str], rows: list[list[str]], delimiter: str = ",", end: str = "") -> Path:
    path.write_text("\n".join([*head, *(delimiter.join(row) + end for row in rows), ""]), encoding="utf-8")
    return path


def cells(scale: float = 1e3, places: np.ndarray = DATA[:, 2:]) -> list[list[str]]:
    return [[f"{v:.4f}" for v in row] for row in scale * places]


def drafted(folder: Path, *files: Path) -> tuple[dict, str]:
    study = folder / "s.toml"
    done = invoke("new", study, *(part for file in files for part in ("--from", file)), "--length", "120mm",
                  "--mass", "50g")  # fmt: skip
    assert done.exit_code == 0, done.exception or done.output
    text = study.read_text(encoding="utf-8")
    assert "alignment fails" not in text
    assert "All-NaN" not in done.output
    return tomllib.loads(text), text


def test_units_in_a_row_of_their_own_and_decimal_commas(tmp_path):
    head = ["# gripper 3", "Zeit;" + ";".join(n.replace("_", " ") for n in NAMES) + ";Druck",
            "s;" + "mm;" * 6 + "mbar"]  # fmt: skip
    rows = [[f"{t:.3f}", *place, f"{10 * p:.2f}"] for t, place, p in zip(TIMES, cells(), DATA[:, 1], strict=True)]
    rows = [[cell.replace(".", ",") for cell in row] for row in rows]
    study, text = drafted(tmp_path, written(tmp_path / "grip.csv", head, rows, ";"))
    assert study["alignment"]["options"]["base"] == "base"
    assert "0 to 90 kPa" in text
    done = invoke("inspect", tmp_path / "grip.csv")
    assert "line 3 of grip.csv holds units" in done.output
    assert "100 Hz" in done.output


@pytest.mark.parametrize(("unit", "ticks"), [("ms", 10**3), ("us", 10**6), ("ns", 10**9)])
def test_times_since_1970_show_their_unit_by_their_size(tmp_path, unit, ticks):
    rows = [[str(round((1_715_600_000 + t) * ticks)), *place, f"{p:.3f}"]
            for t, place, p in zip(TIMES, cells(1.0), DATA[:, 1], strict=True)]  # fmt: skip
    _, text = drafted(tmp_path, written(tmp_path / "a.csv", [",".join(["timestamp", *NAMES, "p_kpa"])], rows))
    assert "at 100 Hz" in text
    assert f"the times of a.csv are {unit} since 1970" in invoke("inspect", tmp_path / "a.csv").output


def test_joined_axes_in_any_order_of_stations(tmp_path):
    """Time of day beside a date, no underscore before the axis, base behind the tip, delimiters behind the rows."""
    head = ["Date,Time,P1_bar,tipX,tipY,tipZ,m0x,m0y,m0z,baseX,baseY,baseZ,"]
    middle = 0.5 * (DATA[:, 2:5] + DATA[:, 5:8])
    places = np.column_stack([DATA[:, 5:8], middle, DATA[:, 2:5]])
    rows = [["2026-05-13", f"23:59:{58.5 + t:06.3f}" if t < 1.5 else f"00:00:{t - 1.5:06.3f}", f"{p / 100:.5f}", *place]
            for t, p, place in zip(TIMES, DATA[:, 1], cells(1.0, places), strict=True)]  # fmt: skip
    study, text = drafted(tmp_path, written(tmp_path / "a.csv", head, rows, end=","))
    assert study["alignment"]["options"]["base"] == "base"
    assert '"tip.along"' in text
    assert "0 to 90 kPa" in text


def test_pixels_by_the_names_of_columns_ask_for_their_scale(tmp_path):
    flat = np.column_stack([np.full(len(TIMES), 640.0), np.full(len(TIMES), 900.0),
                            640 + 4e3 * 0.02 * np.sin(TIMES), 900 - 480 + 0 * TIMES])  # fmt: skip
    flat += 0.05 * np.random.default_rng(1).standard_normal(flat.shape)
    head = ["frame,base_x_px,base_y_px,tip_x_px,tip_y_px,pressure_kPa"]
    rows = [[str(k), *row, f"{p:.2f}"] for k, (row, p) in enumerate(zip(cells(1.0, flat), DATA[:, 1], strict=True))]
    study, text = drafted(tmp_path, written(tmp_path / "cam.csv", head, rows))
    assert study["camera"] == {"pixels_per_mm": "?"}
    assert study["mapping"]["rate_hz"] == "?"
    assert study["mapping"]["pressure"] == {"columns": ["pressure_kPa"], "unit": "kpa"}
    assert "length_unit" not in text


def test_accelerations_beside_a_pressure_are_the_angle_of_the_body(tmp_path):
    turn = 0.4 * np.sin(2.0 * np.clip(TIMES - 0.3, 0.0, None))
    head = ["t_ms\tax_g\tay_g\taz_g\tP_kPa"]
    rows = [[f"{1e3 * t + 5123:.1f}", f"{np.sin(a):.5f}", "0.03", f"{np.cos(a):.5f}", f"{p:.3f}"]
            for t, a, p in zip(TIMES, turn, DATA[:, 1], strict=True)]  # fmt: skip
    study, text = drafted(tmp_path, written(tmp_path / "imu.txt", head, rows, "\t"))
    assert study["mapping"]["angles"] == {"tip": ["ax_g", "ay_g", "az_g"]}
    assert "alignment" not in study
    assert "in one plane" in text


def test_angles_that_are_never_at_rest_are_drafted_all_the_same(tmp_path):
    turn = 0.4 * np.sin(2.0 * TIMES)
    rows = [[f"{t:.3f}", f"{np.sin(a):.5f}", "0.03", f"{np.cos(a):.5f}", f"{p:.3f}"]
            for t, a, p in zip(TIMES, turn, 10.0 + DATA[:, 1] * np.sin(TIMES), strict=True)]  # fmt: skip
    study, _ = drafted(tmp_path, written(tmp_path / "imu.csv", ["t,acc_x,acc_y,acc_z,P_kPa"], rows))
    assert study["mapping"]["angles"] == {"tip": ["acc_x", "acc_y", "acc_z"]}


def test_a_pressure_of_unknown_unit_is_not_shown_in_kilopascals(tmp_path):
    rows = [[f"{t:.3f}", *place, f"{p / 6.9:.3f}"] for t, place, p in zip(TIMES, cells(1.0), DATA[:, 1], strict=True)]
    study, text = drafted(tmp_path, written(tmp_path / "a.csv", [",".join(["t", *NAMES, "line pressure"])], rows))
    assert study["mapping"]["pressure"]["unit"] == "?"
    assert "the highest value is 13.04" in text
    assert "# pressure" not in text


def test_millimetres_and_milliseconds_that_no_name_states(tmp_path):
    rows = [[str(round(1e3 * t)), *place] for t, place in zip(TIMES, cells(), strict=True)]
    log = [[f"{1e3 * t:.0f}", f"{p / 100:.4f}"] for t, p in zip(TIMES, DATA[:, 1], strict=True)]
    files = (written(tmp_path / "a.csv", [",".join(["time", *NAMES])], rows),
             written(tmp_path / "a_log.csv", ["Zeit;Druck", "ms;bar"], log, ";"))
    study, text = drafted(tmp_path, *files)
    assert study["mapping"]["time_unit"] == "?"  # equal steps of 10 may be seconds, too
    assert study["mapping"]["length_unit"] == "mm"
    assert "at 100 Hz" in text
    assert "0 to 90 kPa" in text


def test_topics_of_ros_with_stamps_in_two_parts(tmp_path):
    quaternion = ["/tip/pose/orientation/" + a for a in "xyzw"]
    names = ["header.stamp.sec", "header.stamp.nanosec", *(f"/{s}/pose/position/{a}" for s in ("base", "tip")
             for a in "xyz"), *quaternion, "/line/pressure"]  # fmt: skip
    rows = []
    for t, place, p in zip(TIMES, cells(1.0), DATA[:, 1], strict=True):
        ns = round(1e9 * (t + 0.3))
        turn = [f"{v:.5f}" for v in (0.0, np.sin(0.1 * t), 0.0, np.cos(0.1 * t))]
        rows.append([str(1_715_600_000 + ns // 10**9), str(ns % 10**9), *place, *turn, f"{p:.3f}"])
    study, text = drafted(tmp_path, written(tmp_path / "a.csv", ["// recorder", ",".join(names)], rows))
    assert study["mapping"]["time"] == ["header.stamp.sec", "header.stamp.nanosec"]
    assert list(study["mapping"]["stations"]) == ["base", "tip"]
    assert study["mapping"]["stations"]["tip"]["quaternion"] == quaternion
    assert "at 100 Hz" in text


def test_trials_that_begin_their_clock_anew_are_recordings(tmp_path):
    rows = [[str(k), f"{t:.3f}", *place, f"{p:.3f}"] for k in (1, 2, 3)
            for t, place, p in zip(TIMES, cells(1.0), DATA[:, 1], strict=True)]  # fmt: skip
    study, _ = drafted(tmp_path, written(tmp_path / "all.csv", [",".join(["trial", "time_s", *NAMES, "p_kPa"])], rows))
    assert study["recordings"]["all"]["select"] == {"column": "trial", "values": [1, 2, 3]}


def test_euler_angles_are_no_motors(tmp_path):
    rows = [[f"{t:.3f}", *place, f"{10 * np.sin(t):.3f}", f"{p:.3f}"]
            for t, place, p in zip(TIMES, cells(1.0), DATA[:, 1], strict=True)]  # fmt: skip
    study, text = drafted(
        tmp_path, written(tmp_path / "a.csv", [",".join(["t", *NAMES, "tip_yaw_deg", "pressure_kPa"])], rows))
    assert "tendons" not in study["actuator"]
    assert "pulley" not in text


def test_a_release_that_never_comes_to_rest_is_aligned_by_its_end(tmp_path):
    """It is held by a hand that sways, and the recording ends while it still swings."""
    t = np.arange(0.0, 4.0, 0.01)
    swing = np.where(t < 0.3, 0.03 + 0.003 * np.sin(40 * t),
                     0.03 * np.exp(-0.5 * (t - 0.3)) * np.cos(30 * (t - 0.3)))  # fmt: skip
    places = np.column_stack([0 * t, 0 * t, 0 * t, swing, 0 * t, -np.sqrt(0.12**2 - swing**2)])
    places += 5e-5 * np.random.default_rng(2).standard_normal(places.shape)
    rows = [[f"{when:.2f}", *row] for when, row in zip(t, cells(1.0, places), strict=True)]
    study, text = drafted(tmp_path, written(tmp_path / "let_go.csv", [",".join(["t", *NAMES])], rows))
    entry = study["recordings"]["let_go"]
    assert entry["excitation"] == "release"
    assert entry["alignment"]["options"]["rest"][1] == pytest.approx(3.99)
    assert "the body is never at rest; here it is nearest to it" in text
