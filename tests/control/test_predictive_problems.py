"""Random problems of predictive control: every one is solved, and to its conditions of optimality."""

from __future__ import annotations

import numpy as np
import predictive_problems
import pytest

from pliant.control.mpc import QuadraticProgram
from pliant.errors import InputError


@pytest.mark.parametrize("zero", [False, True])
@pytest.mark.parametrize("slew", [False, True])
def test_every_feasible_problem_is_solved(slew, zero):
    """Ten for each of two bodies."""
    done = predictive_problems.tried(3, 20, slew=slew, zero=zero)
    assert (done["problems"], done["failed"]) == (20, 0)
    assert done["worst_optimality"] < 1e-4


def test_what_is_no_problem_is_not_solved():
    """A cost that is not convex, one that is not finite, and limits that exclude each other."""
    program = QuadraticProgram(np.full(3, 100.0), np.eye(3) - np.eye(3, k=-1))
    free, g, start = np.full(3, 1e3), np.array([-30.0, 5.0, -300.0]), np.zeros(3)
    np.testing.assert_allclose(program.solve(np.eye(3), g, -free, free, start), [30.0, 0.0, 100.0], atol=1e-3)
    assert program.solve(np.diag([1.0, -1.0, 1.0]), g, -free, free, start) is None
    assert program.status == "the cost is not convex"
    assert program.solve(np.full((3, 3), np.nan), g, -free, free, start) is None
    assert program.status == "the prediction is not finite"
    assert program.solve(np.eye(3), g, free, free, start) is None
    assert "infeasible" in program.status
    np.testing.assert_allclose(program.solve(np.eye(3), g, -free, free, start), [30.0, 0.0, 100.0], atol=1e-3)


def test_without_the_solver_a_sentence(monkeypatch):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr("pliant.plugins.import_module", missing)
    with pytest.raises(InputError, match=r"needs OSQP: pip install 'pliant\[mpc\]'"):
        QuadraticProgram(np.ones(2), np.zeros((0, 2)))
