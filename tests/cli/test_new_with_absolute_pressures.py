"""Drafts of recordings whose pressure seems absolute: the offset is asked for, or the warning stays."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from command_line import invoke
from unit_tables import bending

pytestmark = pytest.mark.usefixtures("untried")
ATMOSPHERE = 101.3  # kPa
KNOWN = ["t_s", *(f"{s}_{a}_mm" for s in ("base", "tip") for a in "xyz"), "p_kpa"]
PROPOSED = ["Zeit", *(f"Marker {s} {a}" for s in (1, 2) for a in "XYZ"), "Druck [kPa]"]


def drafted(folder: Path, head: list[str], *, scale: float = 1.0, skip: int = 0, gaps: int = 0) -> tuple[dict, str]:
    """Return the content of a draft and what `pliant new` says, of a table without its first `skip` rows and without
    the first `gaps` pressures [kPa times `scale`].
    """
    time, pressure, base, tip = bending()
    rows = [[f"{v:.4f}" for v in (t, *(1e3 * b), *(1e3 * e), scale * (p + ATMOSPHERE))]
            for t, p, b, e in zip(time, pressure, base, tip, strict=True)][skip:]  # fmt: skip
    rows = [[*row[:-1], ""] if k < gaps else row for k, row in enumerate(rows)]
    path, study = folder / "push.csv", folder / "s.toml"
    path.write_text("\n".join([",".join(head), *(",".join(row) for row in rows), ""]))
    done = invoke("new", study, "--from", path, "--length", "120mm", "--mass", "50g")
    assert done.exit_code == 0, done.exception or done.output
    return tomllib.loads(study.read_text()), done.output


@pytest.mark.parametrize("head", [KNOWN, PROPOSED])
@pytest.mark.parametrize("rows", [{}, {"skip": 60}, {"gaps": 6}])  # at rest, under load at first, gaps at first
def test_the_offset_of_an_absolute_pressure_is_asked_for(tmp_path: Path, head: list[str], rows: dict[str, int]) -> None:
    study, said = drafted(tmp_path, head, **rows)
    assert study["mapping"]["linear"] == {"pressure": {"offset": "?", "unit": "kPa"}}
    assert "? offset: the pressure reads 101.3 kPa without load: -101.3 subtracts" in said


def test_an_absolute_pressure_of_unknown_unit_stays_a_warning(tmp_path: Path) -> None:
    study, said = drafted(tmp_path, [*KNOWN[:-1], "pressure"], scale=1e3)
    assert study["mapping"]["pressure"]["unit"] == "?"
    assert "linear" not in study["mapping"]
    assert "! push.csv: the pressure reads 101.3 kPa without load" in said
