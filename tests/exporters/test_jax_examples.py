"""The examples of the JAX export improve what they optimise, in few rounds."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def printed(name, *options, folder="jax"):
    """The numbers that an example prints in its first line."""
    pytest.importorskip("jax", reason="jax is not installed: pip install -e '.[jax]'")
    command = [sys.executable, str(EXAMPLES / folder / f"{name}.py"), *options]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return ast.literal_eval(done.stdout.splitlines()[0])


@pytest.mark.slow
def test_links_for_a_longer_reach():
    found = printed("design", "--rounds", "5")
    assert found["reach_after_mm"] > found["reach_mm"] + 0.5
    assert found["difference_of_slope"] < 1e-8


@pytest.mark.slow
def test_a_pressure_trace_within_its_limits():
    found = printed("trajectory", "--rounds", "40")
    assert found["miss_after_mm"] < 0.5 * found["miss_mm"]
    assert found["highest_kpa"] <= 120.0
    assert found["steepest_kpa_s"] <= 1500.0


@pytest.mark.slow
def test_a_policy_for_arms_that_it_has_not_seen():
    pytest.importorskip("osqp", reason="OSQP is not installed: pip install -e '.[mpc]'")
    found = printed("policy", "--rounds", "40", "--arms", "8")
    assert found["parameters"] > 1e4
    assert found["rms_after_mm"] < 0.5 * found["rms_mm"]
    assert 0.1 < found["rms_mpc_mm"] < 2.0, "arms that differ from the mean one"


@pytest.mark.slow
def test_a_policy_that_reaches_in_space():
    pytest.importorskip("gymnasium", reason="Gymnasium is not installed: pip install 'pliant[gym]'")
    found = printed("reach_in_space", "--rounds", "8", "--policies", "32", folder="learning")
    assert found["distance_after"] < 0.8 * found["distance"]
