"""Eq. (4): body velocities, Jacobians and Hessian."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.chains import SIZES, random_chain, random_state
from oracles.derivatives import complex_step

from pliant import basic
from pliant.equations.chain import body_hessian, body_jacobian, body_velocities, tips


def run_velocities(q, dq, chain):
    omega, v = np.zeros(chain.n), np.zeros((chain.n, 2))
    body_velocities(q, dq, chain.theta0, chain.l, omega, v)
    return omega, v


def run_jacobian(q, chain, point):
    J = np.zeros((chain.n, 2, chain.n), np.asarray(q).dtype)
    body_jacobian(q, chain.theta0, chain.l, point, J)
    return J


@pytest.fixture(params=SIZES)
def case(rng, request):
    return random_chain(rng, request.param), *random_state(rng, request.param)


def test_velocities_are_the_papers_matrices(case):
    chain, q, dq = case
    omega, v = run_velocities(q, dq, chain)
    Omega, v_paper = basic.body_velocities(q, dq, chain.actuator())
    assert omega == pytest.approx(Omega[:, 1, 0], rel=1e-13)
    assert v == pytest.approx(v_paper, abs=1e-13)


def test_velocities_are_the_jacobian_times_rates(case):
    chain, q, dq = case
    omega, v = run_velocities(q, dq, chain)
    assert run_jacobian(q, chain, chain.l) @ dq == pytest.approx(v, abs=1e-13)
    assert omega == pytest.approx(np.cumsum(dq), rel=1e-13)


def test_velocities_are_the_rate_of_the_tips_seen_from_the_links(case):
    chain, q, dq = case

    def positions(at):
        p = np.zeros((chain.n, 2), complex)
        tips(np.cumsum(at + chain.theta0), chain.l, 0.0, 0.0, p)
        return p

    rate = complex_step(positions, q) @ dq
    phi = np.cumsum(q + chain.theta0)
    c, s = np.cos(phi), np.sin(phi)
    seen = np.stack([c * rate[:, 0] + s * rate[:, 1], -s * rate[:, 0] + c * rate[:, 1]], axis=1)
    assert run_velocities(q, dq, chain)[1] == pytest.approx(seen, abs=1e-13)


def test_jacobian_of_any_point_is_the_lever_turned_by_its_joints(case):
    chain, q, _ = case
    expected = basic.jacobians(q, chain.actuator(), chain.c)[1]
    assert run_jacobian(q, chain, chain.c) == pytest.approx(expected, abs=1e-14)


@pytest.mark.parametrize("which", ["l", "c"])
def test_hessian_is_the_derivative_of_the_jacobian(case, which):
    chain, q, _ = case
    point = getattr(chain, which)
    H = np.zeros((chain.n, 2, chain.n, chain.n))
    body_hessian(q, chain.theta0, chain.l, point, H)
    expected = complex_step(lambda at: run_jacobian(at, chain, point), q)
    assert pytest.approx(expected, abs=1e-14) == H
