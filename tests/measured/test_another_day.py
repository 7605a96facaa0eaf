"""A fitted arm on another day of public recordings, through the console script."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import pytest
from command_line import invoke

pytestmark = pytest.mark.slow
EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
TRAIN = ["e1", "e2", "e4", "e5", "e8"]


def linear_study(folder: Path) -> dict[str, Any]:
    """The example of the fabric arm with its linear fit alone, trained on all recordings of the first session."""
    study = tomllib.loads((EXAMPLES / "spatial_pneumatic_arm.toml").read_text(encoding="utf-8"))
    study.pop("model_selection")
    study["fits"]["linear"] |= {"train": TRAIN, "held_out": []}
    for name, entry in study["recordings"].items():
        if name != "defaults":
            entry["file"] = str(folder / Path(entry["file"]).name)
    return study


def test_a_later_session_of_the_fabric_arm(shared_data, tmp_path):
    folder = shared_data / "spatial_pneumatic_arm"
    (tmp_path / "arm.json").write_text(json.dumps(linear_study(folder)), encoding="utf-8")
    done = invoke("run", tmp_path / "arm.json", "-o", tmp_path / "arm", "--quiet", "--workers", "1")
    assert done.exit_code == 0, done.output
    done = invoke("adapt", tmp_path / "arm", "--recording", folder / "experiment_18.csv", "-o", tmp_path / "later",
                  "--json", "--quiet")  # fmt: skip
    assert done.exit_code == 0, (done.output, done.exception)
    found = json.loads(done.stdout)["adaptations"]["adapted"]
    rest = found["errors"]["experiment_18_rest"]
    assert found["verdict"] == "re-mounted"
    assert rest["before_mm"] > 13.0  # as plain maps of the first session
    assert rest["after_mm"] < 3.0


def test_the_two_segment_arm_three_months_later(shared_data, tmp_path):
    folder = shared_data / "planar_two_segment_arm"
    study = tomllib.loads((EXAMPLES / "planar_two_segment_arm_chambers.toml").read_text(encoding="utf-8"))
    for name, entry in study["recordings"].items():
        if name != "defaults":
            entry["file"] = str(folder / Path(entry["file"]).name)
    (tmp_path / "arm.json").write_text(json.dumps(study), encoding="utf-8")
    done = invoke("run", tmp_path / "arm.json", "-o", tmp_path / "arm", "--quiet", "--workers", "1")
    assert done.exit_code == 0, done.output
    done = invoke("adapt", tmp_path / "arm", "--recording", folder / "apr4_steps_chamber1_1.txt", "-o",
                  tmp_path / "april", "--json", "--quiet")  # fmt: skip
    assert done.exit_code == 0, (done.output, done.exception)
    found = json.loads(done.stdout)["adaptations"]["adapted"]
    rest = found["errors"]["apr4_steps_chamber1_1_rest"]
    assert found["verdict"] == "re-mounted"
    assert rest["before_mm"] > 30.0
    assert rest["after_mm"] < 8.5  # the first 20 s inflate and hold, the rest vents
