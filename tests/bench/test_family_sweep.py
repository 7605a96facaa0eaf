"""The sweep over the family, on one seed of a coarse rod: its numbers, and its table."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmark_scripts import loaded

from pliant.testbed import family_member


@pytest.fixture(scope="module")
def family_sweep():
    return loaded("family_sweep")


def coarse(seed):
    """A member measured by few stations, seldom."""
    who = family_member(seed)
    return replace(who, rate=30.0, fibre=replace(who.fibre, spacing=1.6e-3))


@pytest.mark.slow
def test_one_seed_is_predicted_worse_the_farther_from_the_training(family_sweep, monkeypatch):
    monkeypatch.setattr(family_sweep, "family_member", coarse)
    row = family_sweep.row_of(1, elements=20)
    assert row["message"] == ""
    tips = [row[f"{case}_tip_percent"] for case in family_sweep.CASES]
    assert 0.1 < tips[0] < 10.0
    assert tips[2] > 1.5 * tips[0]
    assert abs(row["inside_frequency_percent"]) < 10.0
    assert row["inside_shape_percent"] < tips[0]  # the tip goes farthest of the body
    assert 0.0 < row["inside_joints_mrad"] < 300.0
    text = family_sweep.summary([row])["tip, RMS, % of length"]["0.66 times"]
    assert text.startswith(f"{tips[0]:.1f}, ")


def test_joint_angles_of_a_chain_are_those_that_laid_it(family_sweep, rng):
    angle = rng.uniform(-0.5, 0.5, (4, 5))
    heading = np.cumsum(angle, axis=1)
    tips = np.cumsum(0.03 * np.stack([-np.sin(heading), np.cos(heading)], axis=-1), axis=1)
    assert family_sweep.joint_angles(tips) == pytest.approx(angle, abs=1e-12)


def test_a_prediction_that_is_refused_is_reported(family_sweep, monkeypatch):
    def refuse(*_args):
        raise family_sweep.PliantError("no such body")

    monkeypatch.setattr(family_sweep, "judged", refuse)
    row = family_sweep.row_of(4)
    assert row["message"] == "no such body"
    assert np.isnan(row["inside_tip_percent"])


def test_the_summary_counts_and_finds_the_worst(family_sweep):
    names = [f"{case}_{metric}" for case in family_sweep.CASES for metric in family_sweep.METRICS]
    rows = [dict.fromkeys(names, value) for value in (60.0, 90.0, np.nan, 100.0)]
    lines = family_sweep.summary(rows)
    assert lines["tip, RMS, % of length"]["2 times"] == "90.0, 98.0, 100.0 (3)"
    assert lines["within the 95 % band, %"]["2 times"] == "90.0, 66.0, 60.0 (3)"


def test_the_documented_command_renews_the_figure_of_the_page(family_sweep, tmp_path):
    path = Path(re.search(r"--figure (\S+)", family_sweep.__doc__)[1])
    names = [f"{case}_{metric}" for case in family_sweep.CASES for metric in family_sweep.METRICS]
    family_sweep.figure([dict.fromkeys(names, value) for value in (60.0, 90.0)], tmp_path / path.name)
    written = [file.name for file in tmp_path.iterdir()]
    assert f"figures/{written[0]}" in (family_sweep.KEPT.parents[2] / "docs/judging_a_fit.md").read_text("utf-8")
    assert written == [path.name]
