"""A drafted study chooses the terms of its model: `new` and `run` through the program, up to the verdict."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pytest
from command_line import invoke
from small_study import table, write_recording

from pliant.testbed.bundle import FOLDER


def drafted(folder: Path, *names: str) -> dict:
    """The study that `pliant new` writes for bundled recordings of the fibre."""
    files = [FOLDER / f"{name}.nc" for name in names]
    done = invoke("new", folder / "s.toml", "--from", *files, "--length", "170mm", "--mass", "69g")
    assert done.exit_code == 0, done.output
    return tomllib.loads((folder / "s.toml").read_text(encoding="utf-8"))


@pytest.mark.usefixtures("untried")
def test_a_single_recording_chooses_too(tmp_path):
    file = write_recording(tmp_path / "push.csv", table(60.0))
    assert invoke("new", tmp_path / "s.toml", "--from", file).exit_code == 0
    content = tomllib.loads((tmp_path / "s.toml").read_text(encoding="utf-8"))
    assert content["model_selection"]["train"] == ["push"]
    assert "held_out" not in content["model_selection"]
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


def tried(folder: Path, *options: str) -> tuple[str, str]:
    """The text of a draft of one small recording, and what the program says."""
    file = write_recording(folder / "push.csv", table(60.0))
    done = invoke("new", folder / "s.toml", "--from", file, *options)
    assert done.exit_code == 0, done.output
    return (folder / "s.toml").read_text(encoding="utf-8"), done.stdout


@pytest.mark.slow
def test_a_draft_is_tried(tmp_path):
    """The first lines state the time of a run and the entries for which values were assumed."""
    text, said = tried(tmp_path, "--length", "120mm", "--json")
    assert "# Tried with assumed values for mass, this study can be run. Forecast of the time of a run:" in text
    answer = json.loads(said)
    assert answer["problem"] == ""
    assert 0.5 < answer["forecast_s"] < 420.0


def test_a_draft_that_cannot_be_run_is_written_all_the_same(tmp_path):
    text, said = tried(tmp_path, "--length", "30mm", "--mass", "50g")
    first = text.partition("\nname = ")[0].replace("\n# ", " ")
    assert "! Tried as it is, this study cannot be run: " in first
    assert "station tip is" in first
    assert "check the tracking there and the stated length" in first
    study = tmp_path / "s.toml"
    assert f"next: change in {study} what its first lines name\nthen: pliant run {study} -o results/s" in said
