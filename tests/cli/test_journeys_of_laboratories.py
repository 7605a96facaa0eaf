"""Files in the habits of laboratories, from `inspect` to a draft that asks for nothing but what only they know."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from command_line import invoke
from unit_tables import bending

pytestmark = pytest.mark.usefixtures("untried")


def journey(path: Path, *others: Path, mapping: str = "") -> tuple[dict, list[str], str]:
    """The draft, the questions that it asks, and what `inspect` says; `mapping` is what a person types."""
    assert len(mapping.splitlines()) <= 6
    options: list[str | Path] = []
    if mapping:
        path.with_name("m.toml").write_text(mapping)
        options = ["--mapping", path.with_name("m.toml")]
    shown = invoke("inspect", path, *options)
    assert shown.exit_code == 0, shown.exception or shown.output
    study = path.with_name("study.toml")
    done = invoke("new", study, "--from", path, *others, *options, "--length", "120mm", "--mass", "50g")
    assert done.exit_code == 0, done.exception or done.output
    asked = [line[2:].partition(":")[0] for line in done.output.splitlines() if line.startswith("? ")]
    return tomllib.loads(study.read_text()), asked, shown.output


def test_a_log_of_one_body_with_zeros_for_lost_and_psi(tmp_path: Path) -> None:
    """A VRPN client beside a controller: two clocks in one table, a single body, psi."""
    time, pressure, _, tip = bending()
    rows = []
    for k, t in enumerate(time):
        place = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0] if k in (0, 1, 90) else [*tip[k], 0.0, 0.0, 0.0, 1.0]
        rows.append(",".join([f"{1.7e9 + t:.4f}", *(f"{v:.6f}" for v in place), f"{pressure[k] / 6.894757:.4f}"]))
    path = tmp_path / "push.csv"
    path.write_text("\n".join(["timestamp,arm_x,arm_y,arm_z,arm_qx,arm_qy,arm_qz,arm_qw,Measured_pressure (psi)", *rows,
                               ""]))  # fmt: skip
    study, asked, shown = journey(path)
    assert asked == ["origin", "tangent"]
    assert "arm 3" in shown
    assert "0 to 60 kPa" in shown
    assert study["model_selection"]["train"] == ["push"]


def test_coils_with_status_words_and_counts_of_encoders(tmp_path: Path) -> None:
    """An NDI tracker and two encoders in one table; the coil at the tip is lost now and then."""
    time, pressure, base, tip = bending()
    head, rows = ["Tools"], []
    for k in (1, 2):
        head += [f"Port {k}: 34802", "Frame", "Face", "State", "Q0", "Qx", "Qy", "Qz", "Tx", "Ty", "Tz", "Error"]
    for k in range(len(time)):
        row = ["2"]
        for place in (base[k], tip[k]):
            row += ["OK", str(4 * k), "0", "OK", "1", "0", "0", "0", *(f"{1e3 * v:.3f}" for v in place), "0.1"]
        if k in (50, 51):
            row[13], row[16], row[17:25] = "MISSING", "MISSING", [""] * 8
        rows.append(",".join([*row, str(round(20 * pressure[k]))]))
    path = tmp_path / "coils.csv"
    path.write_text("\n".join([",".join([*head, "encoder"]), *rows, ""]))
    study, asked, shown = journey(path, mapping="rate_hz = 40\n")
    assert set(asked) == {"linear", "gravity", "lever"}
    assert "tool_2 2" in shown
    assert [one["name"] for one in study["actuator"]["tendons"]] == ["encoder"]


def test_bars_between_cells_and_behind_them(tmp_path: Path) -> None:
    """`|` between cells with one behind each row, and the quaternion of a base whose sign jumps."""
    time, pressure, base, tip = bending()
    rows = []
    for k, t in enumerate(time):
        sign = -1 if k % 50 > 25 else 1
        turn = [0.0, 0.0, 0.0, float(sign)]
        rows.append("|".join([f"{t:.3f}", *(f"{1e3 * v:.3f}" for v in base[k]), *(f"{v:.4f}" for v in turn),
                              *(f"{1e3 * v:.3f}" for v in tip[k]), f"{pressure[k]:.2f}"]) + "|")  # fmt: skip
    names = ["time [s]", *(f"base_{a} [mm]" for a in "xyz"), *(f"base_q{a}" for a in "xyzw"),
             *(f"tip_{a} [mm]" for a in "xyz"), "p [kPa]"]  # fmt: skip
    path = tmp_path / "bars.txt"
    path.write_text("\n".join(["|".join(names) + "|", *rows, ""]))
    study, asked, shown = journey(path)
    assert asked == []
    assert study["alignment"]["options"]["base"] == "base"
    assert "2 station(s)" in shown


def test_a_restarted_logger_of_three_pushes(tmp_path: Path) -> None:
    """An Arduino that was restarted twice: its milliseconds begin anew, and nothing is typed."""
    rows = []
    for level in (20.0, 60.0, 40.0):
        time, pressure, base, tip = bending(level)
        rows += [",".join([f"{1e3 * t:.0f}", *(f"{1e3 * v:.3f}" for v in (*b, *e)), f"{p:.2f}"])
                 for t, b, e, p in zip(time, base, tip, pressure, strict=True)]  # fmt: skip
    names = ["millis", *(f"{name}_{a} [mm]" for name in ("base", "tip") for a in "xyz"), "pressure [kPa]"]
    path = tmp_path / "day.csv"
    path.write_text("\n".join([",".join(names), *rows, ""]))
    study, asked, shown = journey(path)
    assert asked == []
    assert "holds 3 runs" in shown
    assert study["model_selection"]["held_out"] == ["day_3"]  # the middle pressure
    assert np.ptp(study["recordings"]["day"]["select"]["values"]) == 2
