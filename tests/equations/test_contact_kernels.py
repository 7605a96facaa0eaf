"""Point forces and momentum on the chain, against virtual work and the equation of motion."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from oracles.chains import SIZES, random_chain, random_state, station, workspace
from oracles.derivatives import complex_step

from pliant.equations.contact import add_link_loads, momentum, momentum_rate, point_force
from pliant.equations.elastic import joint_torques
from pliant.equations.inertia import inertia_absolute
from pliant.equations.motion import acceleration


@pytest.mark.parametrize("n", SIZES)
def test_point_force_is_virtual_work(rng, n):
    chain = random_chain(rng, n)
    phi = chain.phi(random_state(rng, n)[0])
    force = rng.normal(size=2)
    for link in range(n):
        along, across = rng.uniform(0, chain.l[link]), rng.normal(0, 0.01)

        def place(at, link=link, along=along, across=across):
            p = np.zeros(2, at.dtype)
            station(at, chain.l, (0.0, 0.0), 0.0, (link, along, across), p)
            return p

        Q = np.empty(n)
        point_force(phi, chain.l, link, along, across, *force, Q)
        np.testing.assert_allclose(Q, force @ complex_step(place, phi), atol=1e-15)


def test_joint_torques_of_a_point_force_are_its_moments(rng):
    chain = random_chain(rng, 4)
    phi, f = chain.phi(random_state(rng, 4)[0]), np.array([0.3, -0.7])
    Q, at, joint = np.empty(4), np.empty(2), np.empty(2)
    point_force(phi, chain.l, 2, 0.01714, 0.0, *f, Q)
    station(phi, chain.l, (0.0, 0.0), 0.0, (2, 0.01714, 0.0), at)
    r = np.cumsum(Q[::-1])[::-1]
    for k in range(3):
        station(phi, chain.l, (0.0, 0.0), 0.0, (k, 0.0, 0.0), joint)
        lever = at - joint
        assert r[k] == pytest.approx(lever[0] * f[1] - lever[1] * f[0], abs=1e-15)
    assert r[3] == 0


@pytest.mark.parametrize("n", SIZES)
def test_rate_of_momentum_is_that_of_the_motion(rng, n):
    """d(M w)/dt along the free motion, by complex step in time."""
    chain = random_chain(rng, n)
    q, dq = random_state(rng, n)
    phi, w = chain.phi(q), np.cumsum(dq)
    body, joints, work = chain.body(), chain.joints(), workspace(n)
    a, t, p, rate = np.empty(n), np.empty(n + 1), np.empty(n, complex), np.empty(n)
    acceleration(phi, w, chain.drive(0.03), body, joints, work, a)
    joint_torques(phi, w, joints, chain.drive(0.03), 0.0, t)
    momentum_rate(phi, w, t, body, rate)
    momentum(phi + 1e-30j * w, w + 1e-30j * a, body, p)
    np.testing.assert_allclose(rate, p.imag / 1e-30, rtol=1e-9, atol=1e-12)
    M = np.empty((n, n))
    inertia_absolute(np.cos(phi), np.sin(phi), body.B, body.I, M)
    np.testing.assert_allclose(p.real, M @ w, rtol=1e-12)


@pytest.mark.parametrize("n", SIZES)
def test_loads_of_links_are_the_joint_torques_of_point_forces(rng, n):
    chain = random_chain(rng, n)
    phi, w = chain.phi(random_state(rng, n)[0]), rng.normal(size=n)
    load, expected = np.zeros((n, 2)), np.zeros(n)
    for link in range(n):
        f, along, across, Q = rng.normal(size=2), rng.uniform(0, 0.03), rng.normal(0, 0.01), np.empty(n)
        load[:link] += np.outer(chain.l[:link], f)
        load[link] += along * f + across * np.array([f[1], -f[0]])
        point_force(phi + 0.01 * w, chain.l, link, along, across, *f, Q)
        expected += np.cumsum(Q[::-1])[::-1]
    before = rng.normal(size=n + 1)
    t = before.copy()
    add_link_loads(phi, w, 0.01, load, chain.body(), chain.joints(), SimpleNamespace(tau=t))
    np.testing.assert_allclose(t - before, np.append(expected, 0.0), atol=1e-14)
