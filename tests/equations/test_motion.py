"""Eq. (5): acceleration by every route there is, and its derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from oracles import newton_euler, pendulum
from oracles.chains import SIZES, Chain, paper_chain, random_chain, random_state, workspace
from oracles.derivatives import complex_step

from pliant import basic
from pliant.equations.motion import acceleration, acceleration_jacobian, acceleration_recursive
from pliant.equations.symbols import Slopes

TORQUE = 0.08  # N m, about that of 119 kPa


def dense(phi, w, chain, torque=TORQUE):
    """Angular accelerations (n,) of the links by the dense form in absolute angles."""
    kind = (phi + w + torque).dtype
    a = np.zeros(chain.n, kind)
    acceleration(phi, w, chain.drive(torque), chain.body(), chain.joints(), workspace(chain.n, kind), a)
    return a


def dense_joint(q, dq, chain, torque=TORQUE):
    return np.diff(dense(chain.phi(q), np.cumsum(dq), chain, torque), prepend=0.0)


def recursive(q, dq, chain, torque=TORQUE):
    ddq = np.zeros(chain.n)
    torques = chain.torques(q, dq, torque)
    acceleration_recursive(q, dq, torques, chain.links(), ddq)
    return ddq


def readable(q, dq, chain, torque=TORQUE):
    return basic.acceleration(q, dq, chain.gain * torque, chain.actuator())


def articulated(q, dq, chain, torque=TORQUE):
    return newton_euler.forward(chain, q, dq, chain.torques(q, dq, torque))


@pytest.fixture(params=SIZES)
def case(rng, request):
    return random_chain(rng, request.param), *random_state(rng, request.param)


@pytest.mark.parametrize("oracle", [readable, articulated])
@pytest.mark.parametrize("route", [dense_joint, recursive])
def test_routes_agree(case, route, oracle):
    chain, q, dq = case
    expected = oracle(q, dq, chain)
    assert route(q, dq, chain) == pytest.approx(expected, abs=1e-11 * np.abs(expected).max())


def test_newton_and_euler_take_the_torque_back(case):
    """Inverse dynamics of the acceleration found are the torques that made it."""
    chain, q, dq = case
    back = newton_euler.inverse(chain, q, dq, dense_joint(q, dq, chain))
    expected = chain.torques(q, dq, TORQUE)
    assert back == pytest.approx(expected, abs=1e-11 * np.abs(expected).max())


@pytest.mark.parametrize("repeat", range(4))
def test_double_pendulum_in_closed_form(rng, repeat):
    l, m, Q, g = rng.uniform(0.02, 0.1, 2), rng.uniform(0.01, 0.1, 2), rng.normal(size=2), 9.81
    zero = np.zeros(2)
    K, D = rng.uniform(0.1, 2, 2), rng.uniform(1e-3, 1e-2, 2)
    chain = Chain(l, zero, m, l, zero, K, D, np.ones(2), gy=-g)
    phi, w = rng.uniform(-3, 3, 2), rng.normal(0, 10, 2)
    t = TORQUE - K * np.diff(phi, prepend=0.0) - D * np.diff(w, prepend=0.0)
    Q = np.array([t[0] - t[1], t[1]])
    assert dense(phi, w, chain) == pytest.approx(pendulum.accelerations(phi, w, l, m, g, Q), rel=1e-10)


def test_one_link_is_a_torsion_pendulum():
    chain = paper_chain(n=1)
    q = 0.3
    natural = np.sqrt(chain.K[0] / (chain.m[0] * chain.l[0] ** 2))
    assert dense(np.array([q]), np.zeros(1), chain, 0.0) == pytest.approx([-(natural**2) * q], rel=1e-14)


def test_rest_shape_is_at_rest(rng):
    chain = random_chain(rng, 5, gravity=False)
    assert dense(chain.phi(np.zeros(5)), np.zeros(5), chain, 0.0) == pytest.approx(np.zeros(5), abs=1e-9)


def test_acceleration_is_mirror_symmetric(case):
    chain, q, dq = case
    mirrored = chain._replace(theta0=-chain.theta0, base_angle=-chain.base_angle, gx=-chain.gx)
    expected = -dense(chain.phi(q), np.cumsum(dq), chain)
    found = dense(mirrored.phi(-q), -np.cumsum(dq), mirrored, -TORQUE)
    assert found == pytest.approx(expected, rel=1e-13)


def test_base_angle_and_gravity_turn_together(case):
    """Turning base and gravity by one angle changes nothing that the joints feel."""
    chain, q, dq = case
    turn = 0.7
    c, s = np.cos(turn), np.sin(turn)
    gx, gy = c * chain.gx - s * chain.gy, s * chain.gx + c * chain.gy
    turned = chain._replace(base_angle=chain.base_angle + turn, gx=gx, gy=gy)
    expected = dense_joint(q, dq, chain)
    assert dense_joint(q, dq, turned) == pytest.approx(expected, abs=1e-11 * np.abs(expected).max())


def test_jacobian_against_complex_step(case):
    chain, q, dq = case
    phi, w, n = chain.phi(q), np.cumsum(dq), chain.n
    a, a_phi, a_w = np.zeros(n), np.zeros((n, n)), np.zeros((n, n))
    args = (chain.drive(TORQUE), chain.body(), chain.joints(), workspace(n))
    acceleration_jacobian(phi, w, *args, Slopes(a, a_phi, a_w))
    by_phi = complex_step(lambda at: dense(at, w, chain), phi)
    by_w = complex_step(lambda at: dense(phi, at, chain), w)
    assert a == pytest.approx(dense(phi, w, chain), rel=1e-14)
    assert pytest.approx(by_phi, abs=1e-11 * np.abs(by_phi).max()) == a_phi.T
    assert pytest.approx(by_w, abs=1e-11 * np.abs(by_w).max()) == a_w.T


def test_derivative_by_the_torque_is_the_static_compliance_at_rest():
    """Held by its springs alone, the chain settles at q_i = tau / K: the two derivatives say so together."""
    chain, n = paper_chain(), 5
    a, a_phi, a_w = np.zeros(n), np.zeros((n, n)), np.zeros((n, n))
    args = (np.zeros(n), chain.body(), chain.joints(), workspace(n))
    acceleration_jacobian(np.zeros(n), np.zeros(n), *args, Slopes(a, a_phi, a_w))
    by_torque = complex_step(lambda at: dense(np.zeros(n), np.zeros(n), chain, at[0]), np.zeros(1))[:, 0]
    settled = -np.linalg.solve(a_phi.T, by_torque)
    assert np.diff(settled, prepend=0.0) == pytest.approx(1 / chain.K, rel=1e-9)
