"""A unit of length that no name states is doubted where the stated length of the body contradicts it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from command_line import invoke
from unit_tables import bending

METRES = {"cm": 0.01, "in": 0.0254, "mm": 1e-3, "m": 1.0}


@pytest.mark.parametrize("unit", METRES)
@pytest.mark.parametrize("offset", [0.0, 1.2])  # m, of the tracker's origin
def test_the_entry_that_mends_a_wrong_unit_is_named(tmp_path: Path, unit: str, offset: float) -> None:
    time, pressure, base, tip = bending()
    columns = np.column_stack([time, (base + offset) / METRES[unit], (tip + offset) / METRES[unit], pressure])
    path = tmp_path / "a.csv"
    names = "time,base_x,base_y,base_z,tip_x,tip_y,tip_z,pressure_kPa"
    path.write_text("\n".join([names, *(",".join(f"{v:.6f}" for v in row) for row in columns)]) + "\n")
    drafted = invoke("new", tmp_path / "s.toml", "--from", path, "--length", "120mm", "--mass", "50g")
    assert drafted.exit_code == 0, drafted.output
    output = " ".join(drafted.output.split())
    assert ("is read as" in output or "positions are in" in output) == (unit in ("cm", "in")), output
    assert (f'state length_unit = "{unit}" in the mapping' in output) == (unit in ("cm", "in"))


def test_a_single_point_that_moves_more_than_its_body_allows(tmp_path: Path) -> None:
    time, _, _, tip = bending()
    path = tmp_path / "point.txt"
    rows = [f"0:00:{t:06.3f} {x:.3f} {z:.3f}" for t, (x, z) in zip(time, 100 * tip[:, [0, 2]], strict=True)]
    path.write_text("\n".join(["#T X Y", *rows]) + "\n")
    drafted = invoke("new", tmp_path / "s.toml", "--from", path, "--length", "120mm", "--mass", "50g")
    assert drafted.exit_code == 0, drafted.output
    output = " ".join(drafted.output.split())
    assert "a point of the recording moves by" in output
    assert "length_unit" in output
