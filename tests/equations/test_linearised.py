"""The Jacobian of the implicit step against complex steps through the step's own text."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.chains import SIZES, random_chain, random_state, workspace
from oracles.derivatives import complex_step, dual_slopes, plain_slopes
from oracles.extensible import random_extensible
from oracles.extensible import random_state as random_extension
from oracles.extensible import workspace as extensible_workspace

from pliant.compiler.choose import twin
from pliant.compiler.twin import rebuild
from pliant.equations import extension
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
    slopes = dual_slopes(workspace(n))
    at, rate = phi.copy(), w.copy()
    twin(step_jacobian, n)(at, rate, h, chain.drive(0.03), body, joints, slopes)
    same = moved(np.concatenate([phi, w, np.zeros(n)]).astype(complex)).real
    np.testing.assert_allclose(np.concatenate([at, rate]), same, rtol=1e-12)
    np.testing.assert_allclose(slopes.J.T, wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize("n", [2, 7])  # one block of derivatives, and several
def test_step_jacobian_twin_is_the_same_text(rng, n):
    chain = random_chain(rng, n)._replace(stiffening=-0.7, cubic_stiffening=0.5)
    q, dq = random_state(rng, n)
    made = []
    for kernel, slopes in (
        (step_jacobian, plain_slopes(workspace(n, complex))), (twin(step_jacobian, n), dual_slopes(workspace(n))),
    ):  # fmt: skip
        phi, w = chain.phi(q), np.cumsum(dq)
        kernel(phi, w, 2e-3, chain.drive(0.03), chain.body(), chain.joints(), slopes)
        made.append(np.concatenate([slopes.J.ravel(), phi, w]))
    np.testing.assert_allclose(made[0], made[1], rtol=1e-10, atol=1e-13)


def lengthening(rng, n, segments, curved):
    """A chain whose segments lengthen in fast motion, and its step with a torque more on each joint and strain."""
    chain = random_extensible(rng, n, segments)
    axial = np.stack([-rng.uniform(0.5, 1.5, segments), rng.uniform(0.2, 1.0, segments), rng.uniform(5, 20, segments)])
    joints = chain.joints(axial, 0.03 * rng.normal(size=segments)) if curved else chain.joints()
    x, v = random_extension(rng, chain)
    N, torque = n + segments, rng.normal(size=n + segments)

    def moved(z, h):
        at, rate = z[:N].copy(), z[N : 2 * N].copy()
        work = extensible_workspace(n, segments, complex)
        extension.step(at, rate, h, torque + z[2 * N :], chain.body(), joints, work)
        return np.concatenate([at, rate])

    return (chain.body(), joints), np.concatenate([x, v, np.zeros(N)]), torque, moved


@pytest.mark.parametrize("size", [(1, 1), (3, 1), (5, 2), (6, 3)], ids=str)
@pytest.mark.parametrize("h", [1e-3, 8e-3])
@pytest.mark.parametrize("curved", [False, True])
def test_step_jacobian_of_a_body_that_lengthens_against_complex_step(rng, size, h, curved):
    parts, start, torque, moved = lengthening(rng, *size, curved)
    N = sum(size)
    wanted = complex_step(lambda z: moved(z, h), start)
    plain = rebuild(step_jacobian, lambda kernel: kernel, {"step": extension.step})  # as `choose.jacobian_twin` does
    made = []
    for kernel, slopes in (
        (plain, plain_slopes(extensible_workspace(*size, complex))),
        (twin(step_jacobian, *size, laws=3 * curved), dual_slopes(extensible_workspace(*size))),
    ):
        at, rate = start[:N].copy(), start[N : 2 * N].copy()
        kernel(at, rate, h, torque, *parts, slopes)
        np.testing.assert_allclose(np.concatenate([at, rate]), moved(start.astype(complex), h).real, rtol=1e-12)
        made.append(slopes.J)
    np.testing.assert_allclose(made[0].T, wanted, rtol=1e-9, atol=1e-12 * np.abs(wanted).max())
    np.testing.assert_allclose(made[0], made[1], rtol=1e-10, atol=1e-13 * np.abs(wanted).max())
