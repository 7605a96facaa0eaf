"""Left-out errors of a linear problem with a prior, against explicit fits without each block."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from pliant.adaptation.widening import BLOCKS, blocks_of, left_out_error
from pliant.identification import Parameter
from pliant.identification.joint_prior import JointPrior


def test_left_out_blocks_are_predicted_as_by_fits_without_them(rng):
    names = ("stiffness", "damping", "torque_1")
    A, y = rng.normal(size=(60, 3)), rng.normal(size=60)
    prior = JointPrior(names, np.array([0.5, 1.0, 0.2]), np.diag([0.3, 0.2, 0.1]))
    size, x = 0.7, np.array([0.4, 1.2, 0.1])
    problem = SimpleNamespace(free=[Parameter(n, 1.0) for n in names], scale=np.ones(3), start=x, size=size)
    blocks = np.array_split(np.arange(60), 6)
    expected = 0.0
    root = np.diag(size / np.sqrt(np.diag(prior.covariance)))
    for block in blocks:
        rest = np.setdiff1d(np.arange(60), block)
        without = np.linalg.lstsq(np.vstack([A[rest], root]), np.concatenate([y[rest], root @ prior.mean]))[0]
        expected += np.sum((A[block] @ without - y[block]) ** 2)
    assert left_out_error(problem, x, A @ x - y, A, blocks, prior) == pytest.approx(expected, rel=1e-6)


def test_blocks_hold_consecutive_frames_and_every_residual():
    rows = np.repeat(np.arange(10, 47), 2)
    blocks = blocks_of([(SimpleNamespace(rows=rows), np.arange(rows.size))])
    assert len(blocks) == BLOCKS
    np.testing.assert_array_equal(np.concatenate(blocks), np.arange(rows.size))
