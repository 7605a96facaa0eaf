"""Weights of a free decay's frames: inversely proportional to the motion still to come."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.identification import Experiment, fit
from pliant.identification.residuals import Observations
from pliant.model import Model, Station
from pliant.simulation import Pulse, simulate

TIMES = np.arange(0.0, 3.0, 0.01)


def decay(swing: np.ndarray) -> Experiment:
    """Two stations that move along x by `swing` (T,) [m] and by half of it."""
    still = np.zeros((TIMES.size, 2, 2))
    still[:, 0, 0], still[:, 1, 0] = 0.5 * swing, swing
    return Experiment("r", TIMES, still + 0.3, ("a", "tip"), "release")


def test_weights_of_an_exponential_decay_grow_to_a_limit() -> None:
    """The weight is 1 / (e^-3t + 0.05), but for a factor."""
    seen = decay(0.1 * np.exp(-3.0 * TIMES))
    weight = Observations(seen, "decay").frame_weight
    expected = 1.0 / (np.exp(-3.0 * TIMES) + 0.05)
    np.testing.assert_allclose(weight, expected / np.sqrt(np.mean(expected**2)), rtol=5e-3)
    np.testing.assert_array_equal(Observations(seen, "travel").frame_weight, 1.0)


def test_a_swing_through_the_final_position_weighs_as_its_next_turning_point() -> None:
    seen = decay(0.1 * np.exp(-TIMES) * np.cos(2.0 * np.pi * TIMES))
    weight = Observations(seen, "decay").frame_weight
    assert np.ptp(weight[TIMES < 0.5][3:40]) < 0.35 * weight[20]
    assert np.all(np.diff(weight) >= 0.0)


def test_residuals_carry_the_weight_of_their_frame() -> None:
    seen = decay(0.1 * np.exp(-3.0 * TIMES))
    seen.position[7, 0] = np.nan
    weighed, plain = Observations(seen, "decay"), Observations(seen, "travel")
    rows = np.zeros((TIMES.size, 2, 3))
    ratio = weighed.residual(rows)[plain.residual(rows) != 0] / plain.residual(rows)[plain.residual(rows) != 0]
    np.testing.assert_allclose(ratio, weighed.frame_weight[plain.rows[plain.residual(rows) != 0]])
    slopes = np.ones((1, TIMES.size, 2, 3))
    np.testing.assert_allclose(weighed.slopes(slopes)[0] / plain.slopes(slopes)[0], weighed.frame_weight[plain.rows])


@pytest.mark.slow
def test_small_swings_decide_the_stiffness_of_a_joint_that_softens() -> None:
    body = {"link_length": [0.1], "link_mass": 0.5, "damping": 3e-3, "torque": [1e-6]}
    true = Model(**body, stiffness=0.3, stations=(Station("tip", 0, 0.1, 0.0),), cubic_stiffening=-0.3)
    seen = simulate(true, Pulse(0.0), times=TIMES, initial_angle=[0.8])["station_position"].values
    exp = Experiment("r", TIMES, seen, ("tip",), "release", held=seen[0])
    linear, off = true.with_(cubic_stiffening=0.0), {}
    for weighting in ("travel", "decay"):
        found = fit([exp], linear, ["stiffness", "damping"], starts=1, weighting=weighting)
        off[weighting] = abs(found.values["stiffness"] - 0.3)
    assert 1e-3 < off["decay"] < 0.6 * off["travel"]
