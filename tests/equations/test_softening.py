"""Springs that soften, then stiffen with their angle: K q (1 + s q + a q^2)."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.chains import random_chain, random_state, workspace
from oracles.derivatives import complex_step

from pliant.compiler.choose import twin
from pliant.compiler.trace import BOUNDED
from pliant.equations.articulated import step_articulated
from pliant.equations.elastic import joint_tangents, joint_torques, tangent
from pliant.equations.energy import elastic_energy
from pliant.equations.motion import acceleration, acceleration_jacobian, acceleration_recursive, step
from pliant.equations.symbols import Slopes

TORQUE = 0.05


@pytest.fixture(params=[(0.0, 0.0), (0.4, 0.0), (0.0, 4.0)], ids=["soft", "stiff-again", "bounded"])
def bent(rng, request):
    """A softening chain of five links, which may stiffen again or soften within a bound, and where it is."""
    cubic, scale = request.param
    chain = random_chain(rng, 5)._replace(stiffening=-0.6, cubic_stiffening=cubic, bend_scale=scale)
    q, dq = random_state(rng, 5)
    return chain, q, dq


def springs(phi, joints, n):
    t, rest = np.zeros(n + 1, np.result_type(phi)), np.zeros(n, np.result_type(phi))
    joint_torques(phi, rest, joints._replace(D=0 * joints.D), np.zeros(n), 0.0, t)
    return t[:n]


def test_torque_is_the_slope_of_the_energy_and_the_tangent_that_of_the_torque(bent):
    chain, q, dq = bent
    joints, phi, n, a = chain.joints(), chain.phi(q), chain.n, chain.cubic_stiffening
    assert springs(phi, joints, n) == pytest.approx(chain.torques(q, 0.0 * q, 0.0), rel=1e-12)
    by_phi = complex_step(lambda at: np.array([elastic_energy(at, joints)]), phi)[0]
    t = springs(phi, joints, n)
    assert by_phi == pytest.approx(np.append(t[1:], 0.0) - t, abs=1e-13)
    slopes = -complex_step(lambda at: springs(chain.phi(at), joints, n), q)
    found = np.zeros(n)
    joint_tangents(phi, np.cumsum(dq), joints, 0.0, found)
    assert np.diag(found) == pytest.approx(slopes, abs=1e-12)
    assert [tangent(i, phi, joints) for i in range(n)] == pytest.approx(found, rel=1e-13)
    joint_tangents(phi, np.cumsum(dq), joints, 0.01, found)
    ahead = q + 0.01 * dq
    if chain.bend_scale:
        slopes = -complex_step(lambda x: chain.torques(x, 0.0 * x, 0.0), ahead)
        assert found == pytest.approx(np.diag(slopes), rel=1e-12)
        return
    assert found == pytest.approx(chain.K * (1 - 1.2 * ahead + 3 * a * ahead**2), rel=1e-12)


def test_without_stiffening_the_torque_is_the_linear_one_bit_for_bit(bent):
    chain, q, dq = bent[0]._replace(stiffening=0.0, cubic_stiffening=0.0), *bent[1:]  # whatever the bound
    joints, phi, w = chain.joints(), chain.phi(q), np.cumsum(dq)
    t = np.zeros(6)
    joint_torques(phi, w, joints, chain.drive(TORQUE), 5e-4, t)
    angle, rate = np.diff(phi, prepend=chain.base_angle) - joints.theta0, np.diff(w, prepend=0.0)
    linear = chain.drive(TORQUE) - joints.K * (angle + 5e-4 * rate) - joints.D * rate
    assert np.array_equal(t[:5], linear)


def test_acceleration_and_its_jacobian(bent):
    chain, q, dq = bent
    phi, w, n, body, joints = chain.phi(q), np.cumsum(dq), chain.n, chain.body(), chain.joints()

    def accelerated(x):
        work, a = workspace(n, complex), np.zeros(n, complex)
        acceleration(x[:n], x[n:], chain.drive(TORQUE), body, joints, work, a)
        return a

    wanted = complex_step(accelerated, np.concatenate([phi, w]))
    a, a_phi, a_w, ddq = np.zeros(n), np.zeros((n, n)), np.zeros((n, n)), np.zeros(n)
    acceleration_jacobian(phi, w, chain.drive(TORQUE), body, joints, workspace(n), Slopes(a, a_phi, a_w))
    assert pytest.approx(wanted, abs=1e-11 * np.abs(wanted).max()) == np.hstack([a_phi.T, a_w.T])
    acceleration_recursive(
        q, dq, chain.torques(q, dq, TORQUE), chain.links(), ddq,
    )
    assert a == pytest.approx(np.cumsum(ddq), abs=1e-10 * np.abs(a).max())


def test_articulated_bodies_take_the_same_step(bent):
    chain, q, dq = bent
    made = []
    for kernel in (step, step_articulated, twin(step, 5, laws=BOUNDED * (chain.bend_scale > 0))):
        moved = (chain.phi(q), 0.1 * np.cumsum(dq))
        kernel(*moved, 2e-3, chain.drive(TORQUE), chain.body(), chain.joints(), workspace(5))
        made.append(np.concatenate(moved))
    assert made[1] == pytest.approx(made[0], rel=1e-10)
    assert made[2] == pytest.approx(made[0], rel=1e-12)
