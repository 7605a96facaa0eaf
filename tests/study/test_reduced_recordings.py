"""The recording that determines the links: one of training."""

from __future__ import annotations

import pytest

from pliant.study import Study
from pliant.study.adapted_run import study_of_day
from pliant.study.body import reduced_recording
from pliant.study.run import reduction_warnings


def study(recording: str | None) -> Study:
    return Study.model_validate({
        "name": "s", "actuator": {"length": 0.1, "mass": 0.1}, "reduction": {"recording": recording},
        "recordings": {n: {"file": f"{n}.nc"} for n in ("judge", "low", "high", "shape")},
        "fits": {"one": {"train": ["low", "high"], "held_out": ["judge"], "parameters": {"stiffness": "free"}}},
    })  # fmt: skip


def test_links_come_from_training_recordings_unless_the_study_says_otherwise():
    assert reduced_recording(study(None)) == "low"
    assert reduced_recording(study("high")) == "high"


@pytest.mark.parametrize(("recording", "warned"), [(None, False), ("high", False), ("judge", True), ("shape", False)])
def test_a_held_out_recording_that_determines_the_links_is_named(recording, warned):
    lines = reduction_warnings(study(recording))
    assert len(lines) == warned
    assert all("judge" in line and "[reduction]" in line for line in lines)


def test_links_of_a_recording_that_another_fit_holds_out_are_named():
    both = study("low")
    other = both.fits["one"].model_copy(update={"train": ["high"], "held_out": ["low"]})
    assert reduction_warnings(both.model_copy(update={"fits": {**both.fits, "two": other}}))


def test_a_new_day_has_the_axes_and_the_links_of_the_study():
    whole = study(None)
    day = study_of_day(whole, {"new": whole.recordings["low"]})
    assert list(day.recordings) == ["judge", "low", "new"]  # the first one fixes the axes
    assert reduced_recording(day) == "low"
