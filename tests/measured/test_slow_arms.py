"""Arms that follow their pressures slowly: a model chosen without start values predicts another recording."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pliant.identification import Experiment, predict
from pliant.identification.result import FitResult
from pliant.selection import select_model, terms_for
from pliant.study import load_study
from pliant.study.run import prepare_all

pytestmark = pytest.mark.slow
EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def error(result: FitResult, exp: Experiment) -> float:
    """RMS distance [m] of the last station from its prediction."""
    shown = np.asarray(predict(result.model, exp, result.values, result.time_step)["compared"])
    off = (shown - exp.compared)[:, -1]
    return float(np.sqrt(np.nanmean(np.sum(off**2, axis=1))))


def test_a_planar_arm_of_four_chambers_that_lengthens(shared_data, monkeypatch):
    """With three terms alone; the hand-made study, trained on two trials, has 1.4 % of the peak displacement."""
    monkeypatch.setenv("PLIANT_DATA", str(shared_data))
    ready = prepare_all(load_study(EXAMPLES / "planar_two_segment_arm_lengthens.toml"), lambda _line: None)
    bare = ready.model.with_(extensions=(), stiffness=1.0, damping=1e-3, chambers=tuple(
        replace(c, torque=np.zeros(1)) for c in ready.model.chambers))  # fmt: skip
    third = ready.experiments["third"]
    train = [e.thinned(3) for name, e in ready.experiments.items() if name != "third"]
    terms = terms_for(bare, train, only=["lengthening", "torque_3", "settle"])
    found = select_model(train, bare, terms=terms)
    assert "lengthening" in found.terms
    assert error(found.result, third) < 0.045 * third.travel


def test_a_fabric_arm_in_space_from_the_entries_of_a_draft(shared_data, tmp_path):
    """2.6 mm before any other term; the RMS motion is 6 mm, and a linear map of the inputs is 2.8 mm off."""
    text = (EXAMPLES / "spatial_pneumatic_arm.toml").read_text(encoding="utf-8")
    (tmp_path / "arm.toml").write_text(text.replace("every = 20", "every = 40"), encoding="utf-8")
    (tmp_path / "spatial_pneumatic_arm").symlink_to(shared_data / "spatial_pneumatic_arm")
    study = load_study(tmp_path / "arm.toml")
    ready = prepare_all(study, lambda _line: None)
    held_out = ready.experiments["e4"]
    train = [e for name, e in ready.experiments.items() if name != "e4"]
    bare = ready.model.with_(extensions=(), stiffness=1.0, damping=1e-3)
    terms = terms_for(bare, train, only=["lengthening"])
    common = ["tip.along", "tip.across", "tip.aside"]
    found = select_model(train, bare, common=common, terms=terms)
    assert "lengthening" in found.terms
    assert error(found.result, held_out) < 2.9e-3
