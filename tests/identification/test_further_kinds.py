"""A fit compares a kind of observation beside positions and angles, given by its values and what the model says."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.identification import Experiment, Parameter
from pliant.identification.problem import Problem
from pliant.model import Model, Station
from pliant.simulation import Pulse, Trace, simulate

BODY = Model(
    link_length=[0.05, 0.05], link_mass=0.02, stiffness=[0.5, 0.4], damping=0.004, torque=[3e-6], tip_mass=0.01,
    gravity=[2.0, -9.0], stations=[Station("tip", 1, 0.05)],
)
TIMES, START = np.arange(0.0, 0.4, 0.01), 0.1
FIXED = np.array([0.03, -0.01])  # m, where a draw wire to the tip leaves its drum


def wire(rows):
    """Length (..., T, 1, 3) of the wire to the tip; complex numbers keep their derivative."""
    off = rows[..., :2] - FIXED
    return np.sqrt(np.sum(off * off, axis=-1, keepdims=True)) * np.array([1.0, np.nan, np.nan])


@pytest.mark.slow  # loads the compiler of dual numbers
@pytest.mark.parametrize("known", [True, False])
def test_the_length_of_a_wire_has_the_derivative_of_differences(known):
    seen = simulate(BODY, Pulse(3e4, START, 1.0), times=TIMES, time_step=2e-3, check=False).station_position.values
    exp = Experiment("e", TIMES, seen, ("tip",), "trace", pressure=Trace([0.0, START, START], [0.0, 0.0, 3e4]))
    problem = Problem([exp], BODY, [Parameter("stiffness", 0.6), Parameter("damping", 0.005)], 2e-3, "metre")
    observed = problem.observed[0]
    before = observed.count
    rows = np.concatenate([seen, np.zeros((TIMES.size, 1, 1))], axis=2)
    observed.add(wire(rows), np.full((1, 3), 2.0), wire, noise_known=known)
    problem.ends = np.array([observed.count])
    assert observed.count == before + TIMES.size
    assert (1, (0, 1, 2)) in observed.unknown_noise() or known
    assert np.abs(observed.residual(rows)).max() < 1e-12
    J = problem.data_jacobian(problem.start)
    assert J.shape == (observed.count, 2)
    for k in range(2):
        h = 1e-6 * np.eye(2)[k]
        slope = (problem.data_residual(problem.start + h) - problem.data_residual(problem.start - h)) / 2e-6
        np.testing.assert_allclose(J[:, k], slope, atol=1e-6 * np.abs(slope).max())
        wires = J[observed.station == 1, k]
        assert np.abs(wires).max() > 1e-3
