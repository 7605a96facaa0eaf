"""`pliant new` on files of one day that do not hold the same columns."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from command_line import invoke

RATE = 100.0


def trunk(path: Path, angles: np.ndarray | None, seed: int, *, still: bool = False, decay: bool = False) -> Path:
    """A hanging body of two stations under two motors, as a table with or without the angles of the motors."""
    count = 400
    inputs = np.zeros((count, 2)) if angles is None or still else angles
    side = 1e-3 * inputs
    if decay:
        time = np.arange(count) / RATE
        side[:, 0] = 0.05 * np.exp(-1.5 * time) * np.cos(25.0 * time)
    columns = {}
    for name, part in (("mid", 0.4), ("tip", 1.0)):
        place = np.column_stack([part * side, -0.3 * part - 2.0 * part * (side**2).sum(axis=1)])
        place += 1e-5 * np.random.default_rng(seed).standard_normal(place.shape)
        columns |= {f"{name}_{axis}": place[:, k] for k, axis in enumerate("xyz")}
    if angles is not None:
        columns |= {f"phi{k + 1}": angles[:, k] for k in range(2)}
    np.savetxt(path, np.column_stack([*columns.values()]), fmt="%.6f", delimiter=",", header=",".join(columns),
               comments="")  # fmt: skip
    return path


def turns(seed: int) -> np.ndarray:
    """Angles [degrees] of two motors that turn slowly after a second."""
    time = np.clip(np.arange(400) / RATE - 1.0, 0.0, None)
    return 40.0 * np.stack([np.sin((1.1 + 0.2 * seed) * time), np.sin(1.9 * time) ** 2], axis=1)


@pytest.mark.usefixtures("untried")
@pytest.mark.parametrize("first", ["a_decay", "z_decay"])  # the order of the files
def test_inputs_are_drafted_from_the_files_that_have_them(tmp_path: Path, first: str) -> None:
    files = [trunk(tmp_path / f"{first}.csv", None, 1, decay=True), trunk(tmp_path / "m_1.csv", turns(1), 2),
             trunk(tmp_path / "m_2.csv", turns(2), 3)]  # fmt: skip
    done = invoke("new", tmp_path / "s.toml", "--from", *sorted(files), "--length", "0.3", "--mass", "0.2")
    assert done.exit_code == 0, done.output
    study = tomllib.loads((tmp_path / "s.toml").read_text())
    assert [one["name"] for one in study["actuator"]["tendons"]] == ["phi1", "phi2"]
    assert "inputs" not in study["mapping"]
    for name in ("m_1", "m_2"):
        table = study["recordings"][name]
        assert table["mapping"]["inputs"][0]["columns"] == ["phi1", "phi2"]
        assert set(study["recordings"][name]["drive"]) == {"phi1", "phi2"}
    assert not {"mapping", "drive"} & set(study["recordings"][first])


@pytest.mark.usefixtures("untried")
def test_noise_at_rest_is_no_series_of_settled_poses(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    rest = trunk(tmp_path / "zeros.csv", 0.1 * rng.standard_normal((400, 2)), 5, still=True)
    done = invoke("new", tmp_path / "s.toml", "--from", rest, trunk(tmp_path / "m_1.csv", turns(1), 2), "--length",
                  "0.3", "--mass", "0.2")  # fmt: skip
    assert done.exit_code == 0, done.output
    assert not any("poses" in one for one in tomllib.loads((tmp_path / "s.toml").read_text())["recordings"].values())


def test_a_note_among_the_recordings_is_named(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("# read me\nDate: Jan 10-4\nSetup:\n1-3 seg-1 10psi seg-2 15psi\n\nsee it\n")
    done = invoke("new", tmp_path / "s.toml", "--from", trunk(tmp_path / "m_1.csv", turns(1), 2),
                  tmp_path / "notes.txt")  # fmt: skip
    assert done.exit_code != 0
    assert "notes.txt holds text and no rows of numbers: leave it out" in str(done.exception)
