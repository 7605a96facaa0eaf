"""The recording that determines the links: one of training."""

from __future__ import annotations

import pytest

from pliant.study import Study
from pliant.study.body import reduced_recording
from pliant.study.run import reduction_warnings


def study(recording: str | None) -> Study:
    return Study.model_validate({
        "name": "s", "actuator": {"length": 0.1, "mass": 0.1}, "reduction": {"recording": recording},
        "recordings": {n: {"file": f"{n}.nc"} for n in ("judge", "low", "high")},
        "fits": {"one": {"train": ["low", "high"], "held_out": ["judge"], "parameters": {"stiffness": "free"}}},
    })  # fmt: skip


def test_links_come_from_training_recordings_unless_the_study_says_otherwise():
    assert reduced_recording(study(None)) == "low"
    assert reduced_recording(study("high")) == "high"


@pytest.mark.parametrize(("recording", "warned"), [(None, False), ("high", False), ("judge", True)])
def test_a_held_out_recording_that_determines_the_links_is_named(recording, warned):
    lines = reduction_warnings(study(recording))
    assert len(lines) == warned
    assert all("judge" in line and "[reduction]" in line for line in lines)
