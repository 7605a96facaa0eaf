"""The sweep over the family, on one seed of a coarse rod: its numbers, its table, and that it goes on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from benchmark_scripts import loaded

from pliant.sweep.scheduler import run_chunks
from pliant.sweep.store import Store
from pliant.testbed import family_member


@pytest.fixture(scope="module")
def family_sweep():
    return loaded("family_sweep")


def coarse(seed):
    """A member seen by few stations, seldom."""
    who = family_member(seed)
    return replace(who, rate=30.0, fibre=replace(who.fibre, spacing=1.6e-3))


@pytest.mark.slow
def test_one_seed_is_predicted_worse_the_farther_from_what_was_taught(family_sweep, tmp_path, monkeypatch):
    monkeypatch.setattr(family_sweep, "family_member", coarse)
    seeds = family_sweep.Seeds(1, first=1, elements=20, links=5)
    store = Store(tmp_path, {"sweep": "test"})
    assert run_chunks(seeds, store).made == 1
    samples = store.load(0, 0, 1)
    row = {name: samples[name].values[0] for name in samples.data_vars}
    assert (row["told"], row["failed"]) == ("", False)
    tips = [row[f"{case}_tip_percent"] for case in family_sweep.HELD_OUT]
    assert 0.1 < tips[0] < 10.0
    assert tips[2] > 1.5 * tips[0]
    assert abs(row["inside_frequency_percent"]) < 10.0
    assert row["inside_shape_percent"] < tips[0]  # the tip goes farthest of the body
    assert 0.0 < row["inside_joints_mrad"] < 300.0
    assert run_chunks(seeds, store).found == 1
    told = family_sweep.table(samples)
    assert f"{tips[0]:+7.2f}" in told
    assert f"seed 1, {row['terms']}, Iso6358" in family_sweep.worst(samples)


def test_joint_angles_of_a_chain_are_those_that_laid_it(family_sweep, rng):
    angle = rng.uniform(-0.5, 0.5, (4, 5))
    heading = np.cumsum(angle, axis=1)
    tips = np.cumsum(0.03 * np.stack([-np.sin(heading), np.cos(heading)], axis=-1), axis=1)
    assert family_sweep.joint_angles(tips) == pytest.approx(angle, abs=1e-12)


def test_a_prediction_that_is_refused_is_told_and_counted(family_sweep, monkeypatch):
    def refuse(*_args, **_late):
        raise family_sweep.PliantError("no such body")

    monkeypatch.setattr(family_sweep, "judged", refuse)
    row = family_sweep.Seeds(1, first=4).work(0)
    assert row["told"][0] == "no such body"
    assert row["failed"][0]
    assert np.isnan(row["inside_tip_percent"][0])
