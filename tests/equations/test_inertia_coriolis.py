"""M and C of Eq. (5): by the paper's recursion, in absolute angles, and their identities."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.chains import SIZES, paper_chain, random_chain, random_state
from oracles.derivatives import complex_step

from pliant import basic
from pliant.equations.chain import body_hessian, body_jacobian
from pliant.equations.inertia import (
    coriolis_absolute,
    coriolis_from_hessian,
    inertia_absolute,
    inertia_derivative,
    inertia_from_jacobians,
    to_joint_angles,
)


def jacobians(q, chain):
    n, kind = chain.n, np.asarray(q).dtype
    J, J_tips = np.zeros((n, 2, n), kind), np.zeros((n, 2, n), kind)
    body_jacobian(q, chain.theta0, chain.l, chain.c, J)
    body_jacobian(q, chain.theta0, chain.l, chain.l, J_tips)
    return J, J_tips[-1]


def hessians(q, chain):
    n = chain.n
    H, H_tips = np.zeros((n, 2, n, n)), np.zeros((n, 2, n, n))
    body_hessian(q, chain.theta0, chain.l, chain.c, H)
    body_hessian(q, chain.theta0, chain.l, chain.l, H_tips)
    return H, H_tips[-1]


def recursive_inertia(q, chain):
    M = np.zeros((chain.n, chain.n), np.asarray(q).dtype)
    J, J_tip = jacobians(q, chain)
    inertia_from_jacobians(J, chain.m, chain.I, J_tip, chain.m_tip, M)
    return M


def recursive_coriolis(q, dq, chain):
    C = np.zeros((chain.n, chain.n))
    (J, J_tip), (H, H_tip) = jacobians(q, chain), hessians(q, chain)
    coriolis_from_hessian(J, H, chain.m, J_tip, H_tip, chain.m_tip, dq, C)
    return C


def absolute(q, dq, chain):
    """M and C in absolute angles, (n, n) each."""
    M, C = np.zeros((chain.n, chain.n)), np.zeros((chain.n, chain.n))
    phi, body = chain.phi(q), chain.body()
    inertia_absolute(np.cos(phi), np.sin(phi), body.B, body.I, M)
    coriolis_absolute(np.cos(phi), np.sin(phi), body.B, np.cumsum(dq), C)
    return M, C


def relative(X):
    Y = np.full_like(X, np.nan)
    to_joint_angles(X, Y)
    return Y


@pytest.fixture(params=SIZES)
def case(rng, request):
    return random_chain(rng, request.param), *random_state(rng, request.param)


def close(X, Y):
    assert pytest.approx(Y, abs=1e-12 * max(np.abs(Y).max(), 1e-6)) == X


def test_inertia_agrees_with_the_readable_twin(case):
    chain, q, dq = case
    expected = basic.inertia(q, chain.actuator())
    close(recursive_inertia(q, chain), expected)
    close(relative(absolute(q, dq, chain)[0]), expected)


def test_coriolis_agrees_with_the_readable_twin(case):
    chain, q, dq = case
    expected = basic.coriolis(q, dq, chain.actuator())
    close(recursive_coriolis(q, dq, chain), expected)


def test_both_coriolis_matrices_are_the_same_matrix(case):
    """Not only C dq: the suffix sums carry the Christoffel matrix of one angle set into that of the other."""
    chain, q, dq = case
    close(relative(absolute(q, dq, chain)[1]), recursive_coriolis(q, dq, chain))


def test_suffix_sums_are_the_congruence_by_the_triangle_of_ones(rng):
    X, T = rng.normal(size=(5, 5)), np.tri(5)
    assert relative(X) == pytest.approx(T.T @ X @ T, abs=1e-13)


def test_inertia_is_symmetric_positive_definite(case):
    chain, q, dq = case
    for M in (recursive_inertia(q, chain), absolute(q, dq, chain)[0], relative(absolute(q, dq, chain)[0])):
        assert pytest.approx(M.T, rel=1e-12) == M
        assert np.linalg.eigvalsh(M).min() > 0.0


@pytest.mark.parametrize(("mass", "condition"), [("tip", 1.3e3), ("rod", 2.7e3)])
def test_condition_of_the_papers_inertia_falls_with_bend(mass, condition):
    chain = paper_chain(mass)
    straight = np.linalg.cond(recursive_inertia(np.zeros(5), chain))
    assert straight == pytest.approx(condition, rel=0.05)
    assert np.linalg.cond(recursive_inertia(np.full(5, 0.5), chain)) < straight


def test_inertia_derivative_against_complex_step(case):
    chain, q, _ = case
    n = chain.n
    (J, J_tip), (H, H_tip) = jacobians(q, chain), hessians(q, chain)
    pairs = np.ndindex(n, n, n)
    found = [inertia_derivative(J, H, chain.m, (J_tip, H_tip, chain.m_tip), abr) for abr in pairs]
    close(np.reshape(found, (n, n, n)), complex_step(lambda at: recursive_inertia(at, chain), q))


def test_rate_of_inertia_minus_twice_coriolis_is_skew(case):
    chain, q, dq = case
    rate = complex_step(lambda at: recursive_inertia(at, chain), q) @ dq
    for C in (recursive_coriolis(q, dq, chain), relative(absolute(q, dq, chain)[1])):
        N = rate - 2 * C
        assert np.abs(N + N.T).max() <= 1e-12 * max(np.abs(C).max(), np.abs(rate).max(), 1e-300)
