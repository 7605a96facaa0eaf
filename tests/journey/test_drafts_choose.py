"""A drafted study chooses the terms of its model: `new` and `run` through the program, up to the verdict."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pytest
from command_line import invoke

from pliant.testbed.bundle import FOLDER


def drafted(folder: Path, *names: str) -> dict:
    """The study that `pliant new` writes for bundled recordings of the fibre."""
    files = [FOLDER / f"{name}.nc" for name in names]
    done = invoke("new", folder / "s.toml", "--from", *files, "--length", "170mm", "--mass", "69g")
    assert done.exit_code == 0, done.output
    return tomllib.loads((folder / "s.toml").read_text(encoding="utf-8"))


def test_a_single_recording_chooses_too(tmp_path):
    content = drafted(tmp_path, "pulse_119")
    assert content["model_selection"] == {"train": ["pulse_119"], "minutes": 5}
    assert "fits" not in content


@pytest.mark.slow
@pytest.mark.parametrize(("names", "bound"), [(["pulse_60", "pulse_119", "pulse_180"], 2.5), (["pulse_119"], 2.5)])
def test_the_report_of_a_draft_has_a_verdict(tmp_path, names, bound):
    drafted(tmp_path, *names)
    done = invoke("run", tmp_path / "s.toml", "-o", tmp_path / "out", "--workers", 1)
    assert done.exit_code == 0, done.output
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text(encoding="utf-8"))
    assert metrics["records"]["pulse_119"]["rmse_percent_of_travel"] < bound
    assert metrics["model_selection"]["terms"]
    assert "The target is met." in done.stdout
