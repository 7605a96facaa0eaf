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


def test_a_draft_is_tried(tmp_path):
    """The first lines state the time of a run, or with which assumed values the study cannot be run, and why."""
    drafted(tmp_path, "pulse_119")
    assert "Tried as it is, this study can be run. Forecast of the time of a run:" in (tmp_path / "s.toml").read_text()
    done = invoke("new", tmp_path / "t.toml", "--from", FOLDER / "pulse_119.nc", "--length", "170mm", "--json")
    answer = json.loads(done.stdout)
    assert answer["problem"] == ""
    assert 1.0 < answer["forecast_s"] < 420.0
    assert "# Tried with assumed values for mass, this study can be run." in (tmp_path / "t.toml").read_text()


def test_a_draft_that_cannot_be_run_is_written_all_the_same(tmp_path):
    """A body too long for the recording: the fibre has no point so far from its cap."""
    done = invoke("new", tmp_path / "s.toml", "--from", FOLDER / "pulse_119.nc", "--length", "2m", "--mass", "69g")
    assert done.exit_code == 0, done.output
    text = (tmp_path / "s.toml").read_text(encoding="utf-8")
    assert "# ! Tried as it is, this study cannot be run: the tip lies 186.3 mm along the fibre, less than" in text
    assert "next: change what its first lines name, then run: pliant run" in done.stdout
