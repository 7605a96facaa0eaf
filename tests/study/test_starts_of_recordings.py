"""The start of recordings in a study: in motion, with a warm-up, thinned; run by the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import invoke

from pliant.identification import Experiment
from pliant.identification.prediction import predict
from pliant.model import Station, chain_model
from pliant.recording import make_recording, write
from pliant.simulation import Trace

TIME = np.arange(0.0, 3.0, 0.01)
PUSH = 3e4 * (1 + np.sin(4.4 * TIME)) * np.minimum(TIME / 0.3, 1.0)
STUDY = """
name = "arm"
[actuator]
length = 0.3
mass = 0.1
links = 3
stiffness = 0.1
[alignment.options]
rest = [0.0, 0.02]
origin = [0.0, 0.0, 0.0]
tangent = "+y"
plane = "+z"
bend = "negative"
[[actuator.stations]]
name = "tip"
at = 0.3
[recordings.defaults]
file = "motion.nc"
stations = ["tip"]
[recordings.first]
window = [0.0, 1.5]
[recordings.late]
window = [1.1, 3.0]
alignment.options.rest = [1.1, 1.12]
{entries}
[fits.one]
train = ["first"]
held_out = ["late"]
starts = 1
parameters = {{ stiffness = {{ value = 0.1, free = false }}, damping = 2e-3, torque_1 = 8e-7 }}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    model = chain_model(length=0.3, mass=0.1, damping=4e-3, stiffness=0.1, links=3, torque=[1e-6])
    model = model.with_(stations=(Station("tip", 2, float(model.link_length[2])),))
    blank = Experiment("x", TIME, np.random.default_rng(0).normal(size=(TIME.size, 1, 2)), ("tip",), "trace",
                       Trace(TIME, PUSH))  # fmt: skip
    tip = predict(model, blank, {}, 1e-3)["position"]
    place = np.concatenate([np.zeros_like(tip), tip], axis=1)
    place = np.concatenate([place, np.zeros((*place.shape[:2], 1))], axis=2)
    place[:, 1] += 1e-5 * np.random.default_rng(1).normal(size=(TIME.size, 3))
    write(make_recording(TIME, place, station=["base", "tip"], pressure=PUSH), tmp_path / "motion.nc")
    return tmp_path


def ran(folder: Path, entries: str) -> tuple[str, float]:
    """Output of a run, and the error of the held-out recording in % of its peak displacement."""
    (folder / "arm.toml").write_text(STUDY.format(entries=entries))
    result = invoke("run", folder / "arm.toml", "--output", folder / "out")
    assert result.exit_code == 0, f"{result.exception}{result.output}"
    metrics = json.loads((folder / "out" / "metrics.json").read_text())
    return result.output, float(metrics["records"]["late"]["rmse_percent_of_travel"])


def test_a_part_of_a_recording_starts_in_motion_unless_the_study_says_otherwise(folder: Path) -> None:
    text, error = ran(folder, "")
    assert "late: the recording begins in motion" in text
    assert "first: the recording begins in motion" not in text
    text, wrong = ran(folder, 'start = "rest"')
    assert "begins in motion" not in text
    assert error < 3.0 < 10.0 * error < wrong
    text, late = ran(folder, 'start = "rest"\nwarm_up = 1.2\nevery = 2')
    assert "the first 1.2 s, 60 of 95 frames, are a warm-up" in text
    assert late < wrong


def test_a_recording_may_start_in_the_pose_of_its_first_frames(folder: Path) -> None:
    text, _ = ran(folder, 'start = "pose"')
    assert "late: its simulation starts where the body was left, in the pose of the first frames" in text
    text, _ = ran(folder, "warm_up = 0.4")
    assert "late: the recording begins in motion" in text, "a motion is known better than by its pose"


def test_a_wrong_start_is_refused(folder: Path) -> None:
    for entries, message in (('start = "sitting"', "start"), ("warm_up = 9.0", "shorter than the recording"),
                             ("every = 0", "every")):  # fmt: skip
        (folder / "arm.toml").write_text(STUDY.format(entries=entries))
        result = invoke("run", folder / "arm.toml", "--output", folder / "out")
        assert result.exit_code != 0
        assert message in f"{result.exception}{result.output}"
        assert not (folder / "out" / "metrics.json").exists()
