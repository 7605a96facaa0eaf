"""The Jacobian of the implicit step against complex steps through the step's own text."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.chains import SIZES, random_chain, random_state, workspace
from oracles.derivatives import complex_step

from pliant.compiler.choose import twin
from pliant.equations.linearised import step_jacobian
from pliant.equations.motion import step


@pytest.mark.parametrize("n", SIZES)
@pytest.mark.parametrize("h", [1e-3, 8e-3])
@pytest.mark.parametrize(("stiffening", "cubic"), [(0.0, 0.0), (-0.7, 0.0), (-0.7, 0.5)])
def test_step_jacobian_against_complex_step(rng, n, h, stiffening, cubic):
    chain = random_chain(rng, n)._replace(stiffening=stiffening, cubic_stiffening=cubic)
    q, dq = random_state(rng, n)
    phi, w = chain.phi(q), np.cumsum(dq)
    body, joints = chain.body(), chain.joints()

    def moved(x):
        at, rate = x[:n].copy(), x[n : 2 * n].copy()
        pushed = joints._replace(theta0=joints.theta0 + x[2 * n :] / joints.K)  # a torque t moves the rest by t / K
        step(at, rate, h, chain.drive(0.03), body, pushed, workspace(n, complex))
        return np.concatenate([at, rate])

    wanted = complex_step(moved, np.concatenate([phi, w, np.zeros(n)]))
    J = np.empty((3 * n, 2 * n))
    at, rate = phi.copy(), w.copy()
    step_jacobian(at, rate, h, chain.drive(0.03), body, joints, workspace(n), J)
    same = moved(np.concatenate([phi, w, np.zeros(n)]).astype(complex)).real
    np.testing.assert_allclose(np.concatenate([at, rate]), same, rtol=1e-12)
    np.testing.assert_allclose(J.T, wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize("n", [2, 7])  # a straight line, and the loops
def test_step_jacobian_twin_is_the_same_text(rng, n):
    chain = random_chain(rng, n)._replace(stiffening=-0.7, cubic_stiffening=0.5)
    q, dq = random_state(rng, n)
    made = []
    for kernel in (step_jacobian, twin(step_jacobian, n)):
        J = np.empty((3 * n, 2 * n))
        phi, w = chain.phi(q), np.cumsum(dq)
        kernel(phi, w, 2e-3, chain.drive(0.03), chain.body(), chain.joints(), workspace(n), J)
        made.append(np.concatenate([J.ravel(), phi, w]))
    np.testing.assert_allclose(made[0], made[1], rtol=1e-10, atol=1e-13)
