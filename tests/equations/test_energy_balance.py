"""Energies and power: what goes in is stored, dissipated, or moves."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.chains import SIZES, random_chain, random_state, station, workspace
from oracles.derivatives import complex_step

from pliant import basic
from pliant.equations.elastic import gravity_absolute, to_joint_torques
from pliant.equations.energy import (
    add_step_work,
    damping_power,
    elastic_energy,
    gravity_energy,
    input_power,
    kinetic_energy,
)
from pliant.equations.motion import acceleration, step

TORQUE = 0.08


@pytest.fixture(params=SIZES)
def case(rng, request):
    return random_chain(rng, request.param), *random_state(rng, request.param)


def energy(phi, w, chain):
    c, s, body = np.cos(phi), np.sin(phi), chain.body()
    stored = elastic_energy(phi, chain.joints()) + gravity_energy(c, s, body)
    return kinetic_energy(c, s, w, body) + stored


def test_power_balance(case):
    """d/dt (kinetic + elastic + gravity) = input - dissipated, along the motion that `acceleration` gives."""
    chain, q, dq = case
    phi, w, a = chain.phi(q), np.cumsum(dq), np.zeros(chain.n)
    acceleration(phi, w, chain.drive(TORQUE), chain.body(), chain.joints(), workspace(chain.n), a)
    rate = complex_step(lambda t: energy(phi + t[0] * w, w + t[0] * a, chain), np.zeros(1))[0]
    supplied = input_power(w, chain.drive(TORQUE), chain.joints())
    lost = damping_power(w, chain.joints())
    assert lost > 0.0
    assert rate == pytest.approx(supplied - lost, rel=1e-9, abs=1e-9 * (abs(supplied) + lost))


def test_kinetic_energy_is_that_of_the_inertia_matrix(case):
    chain, q, dq = case
    phi = chain.phi(q)
    found = kinetic_energy(np.cos(phi), np.sin(phi), np.cumsum(dq), chain.body())
    assert found == pytest.approx(0.5 * dq @ basic.inertia(q, chain.actuator()) @ dq, rel=1e-12)


def test_kinetic_energy_is_that_of_the_moving_masses(case):
    chain, q, dq = case
    phi, w = chain.phi(q), np.cumsum(dq)

    def position(t, link, along):
        p = np.zeros(2, complex)
        station(phi + t[0] * w, chain.l, (0.0, 0.0), 0.0, (link, along, 0.0), p)
        return p

    total = 0.5 * chain.I @ w**2
    masses = [(i, chain.m[i], chain.c[i]) for i in range(chain.n)] + [(chain.n - 1, chain.m_tip, chain.l[-1])]
    for link, mass, along in masses:
        velocity = complex_step(lambda t, at=(link, along): position(t, *at), np.zeros(1))[:, 0]
        total += 0.5 * mass * velocity @ velocity
    assert kinetic_energy(np.cos(phi), np.sin(phi), w, chain.body()) == pytest.approx(total, rel=1e-12)


def test_gravity_is_the_slope_of_its_energy(case):
    chain, q, _ = case
    phi, body, g = chain.phi(q), chain.body(), np.zeros(chain.n)
    gravity_absolute(np.cos(phi), np.sin(phi), body, g)
    slope = complex_step(lambda at: gravity_energy(np.cos(at), np.sin(at), body), phi)
    assert g == pytest.approx(slope, rel=1e-12)
    to_joint_torques(g)
    assert -g == pytest.approx(basic.gravity(q, chain.actuator()), abs=1e-12)


def test_elastic_energy_is_zero_only_in_the_rest_shape(case):
    chain, q, _ = case
    joints = chain.joints()
    assert elastic_energy(chain.phi(0 * q), joints) == pytest.approx(0.0, abs=1e-28)
    assert elastic_energy(chain.phi(q), joints) == pytest.approx(0.5 * chain.K @ q**2, rel=1e-12)


def test_powers_in_joint_angles(case):
    chain, _, dq = case
    w = np.cumsum(dq)
    assert damping_power(w, chain.joints()) == pytest.approx(chain.D @ dq**2, rel=1e-12)
    supplied = input_power(w, chain.drive(TORQUE), chain.joints())
    assert supplied == pytest.approx(TORQUE * chain.gain @ dq, rel=1e-11, abs=1e-12)


def test_work_of_a_step(case):
    """Torque times turn, and D turn^2 / h, of the turns that the joints made: the middle rate is turn / h."""
    chain, q, dq = case
    phi, w, work, h = chain.phi(q), np.cumsum(dq), workspace(chain.n), 1e-3
    before, torque = phi.copy(), chain.drive(TORQUE)
    step(phi, w, h, torque, chain.body(), chain.joints(), work)
    total = np.array([1.0, 2.0, 3.0])
    add_step_work(w, h, torque, chain.joints(), work, total)
    turn = np.diff(phi - before, prepend=0.0)
    assert total == pytest.approx([1.0 + TORQUE * chain.gain @ turn, 2.0 + chain.D @ turn**2 / h, 3.0], rel=1e-11)
