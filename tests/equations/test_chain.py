"""Eqs. (1) to (3): where the links are."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.chains import SIZES, random_chain, random_state

from pliant import basic
from pliant.equations.chain import (
    absolute_angles,
    angles_from_tips,
    forward,
    link_transform,
    relative_angles,
    tips,
)
from pliant.equations.observation import place_links, position
from pliant.equations.symbols import ObservedChain


def run_forward(q, theta0, l):
    n = len(l)
    R_rel, p_rel = np.zeros((n, 2, 2)), np.zeros((n, 2))
    R_abs, p_abs = np.zeros((n, 2, 2)), np.zeros((n, 2))
    forward(q, theta0, l, R_rel, p_rel, R_abs, p_abs)
    return R_rel, p_rel, R_abs, p_abs


def run_station(phi, l, link, along, across):
    """A point of a chain behind a base part of 0.03 m at 0.4 rad."""
    links = np.zeros((5, len(l) + 1))
    place_links(phi, 0.4, ObservedChain(0.03, l, np.zeros((len(l) + 1, 0))), links)
    return np.array([position(axis, link, along, across, links) for axis in range(2)])


def run_tips(phi, l, x0=0.0, y0=0.0):
    p = np.zeros((len(l), 2))
    tips(phi, l, x0, y0, p)
    return p


def test_link_transform_turns_about_z_and_moves_along_y():
    R, p = np.zeros((2, 2)), np.zeros(2)
    link_transform(0.3, 0.2, 0.05, R, p)
    assert np.column_stack([R, p]) == pytest.approx(basic.link_transform(0.3, 0.2, 0.05)[:2], abs=1e-16)
    assert pytest.approx(np.array([-np.sin(0.5), np.cos(0.5)]) * 0.05, abs=1e-16) == p
    assert pytest.approx(np.eye(2), abs=1e-15) == R @ R.T


@pytest.mark.parametrize("n", SIZES)
def test_recursion_is_the_product_of_transforms(rng, n):
    chain, (q, _) = random_chain(rng, n), random_state(rng, n)
    _, _, R_abs, p_abs = run_forward(q, chain.theta0, chain.l)
    T = basic.chain(q, chain.actuator()._replace(theta0=chain.theta0))
    assert pytest.approx(T[:, :2, :2], abs=1e-14) == R_abs
    assert p_abs == pytest.approx(T[:, :2, 2], abs=1e-14)


@pytest.mark.parametrize("n", SIZES)
def test_absolute_angles_put_the_tips_where_the_recursion_does(rng, n):
    chain, (q, _) = random_chain(rng, n), random_state(rng, n)
    phi, back = np.zeros(n), np.zeros(n)
    absolute_angles(q, chain.theta0, chain.base_angle, phi)
    assert phi == pytest.approx(chain.phi(q), abs=1e-14)
    assert run_tips(phi, chain.l) == pytest.approx(basic.tips(q, chain.actuator()), abs=1e-14)
    relative_angles(phi, chain.theta0, chain.base_angle, back)
    assert back == pytest.approx(q, abs=1e-14)


@pytest.mark.parametrize("n", SIZES)
def test_angles_from_tips_undo_tips(rng, n):
    phi = np.cumsum(rng.uniform(-2.5, 2.5, n))  # winds more than once, neighbours within pi
    l = rng.uniform(0.01, 0.1, n)
    l_back, phi_back = np.zeros(n), np.zeros(n)
    angles_from_tips(run_tips(phi, l, 0.3, -0.2), 0.3, -0.2, l_back, phi_back)
    assert l_back == pytest.approx(l, abs=1e-14)
    assert phi_back == pytest.approx(phi, abs=1e-12)


def test_angles_from_tips_take_the_near_turn_across_the_cut():
    phi = np.array([3.0, 3.3, -3.0 + 2 * np.pi])  # crosses +pi, where atan2 jumps
    l_back, phi_back = np.zeros(3), np.zeros(3)
    angles_from_tips(run_tips(phi, np.full(3, 0.1)), 0.0, 0.0, l_back, phi_back)
    assert phi_back == pytest.approx(phi, abs=1e-12)


def test_equal_bends_lie_on_a_circle():
    n, l, q = 6, 0.03, 0.25
    p = np.vstack([[0.0, 0.0], run_tips(q * np.arange(1, n + 1), np.full(n, l))])
    middle = -l / (2 * np.sin(q / 2)) * np.array([np.cos(q / 2), np.sin(q / 2)])
    assert np.hypot(*(p - middle).T) == pytest.approx(np.full(n + 1, l / (2 * np.sin(q / 2))), rel=1e-13)


@pytest.mark.parametrize("n", [1, 3, 6])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.8])
def test_splitting_a_link_leaves_the_tips_where_they_were(rng, n, share):
    l, phi = rng.uniform(0.02, 0.06, n), rng.uniform(-2, 2, n)
    i = n // 2
    l_split = np.insert(l, i, share * l[i])
    l_split[i + 1] *= 1 - share
    p = run_tips(np.insert(phi, i, phi[i]), l_split)
    assert np.delete(p, i, axis=0) == pytest.approx(run_tips(phi, l), abs=1e-15)


@pytest.mark.parametrize("n", SIZES)
def test_negated_angles_mirror_x_alone(rng, n):
    phi, l = rng.uniform(-3, 3, n), rng.uniform(0.02, 0.06, n)
    assert run_tips(-phi, l) == pytest.approx(run_tips(phi, l) * [-1, 1], abs=1e-16)


@pytest.mark.parametrize("n", [1, 4])
def test_a_station_is_fixed_to_its_link(rng, n):
    phi, l = rng.uniform(-2, 2, n), rng.uniform(0.02, 0.06, n)
    first = 0.03 * np.array([-np.sin(0.4), np.cos(0.4)])
    every = np.vstack([first, run_tips(phi, l, *first)])
    for link in range(n):
        assert run_station(phi, l, link, l[link], 0.0) == pytest.approx(every[link + 1], abs=1e-15)
        left = np.array([-np.cos(phi[link]), -np.sin(phi[link])])
        assert run_station(phi, l, link, 0.0, 0.003) == pytest.approx(every[link] + 0.003 * left, abs=1e-15)


def test_a_station_on_the_base_turns_with_the_base_only(rng):
    p = run_station(rng.uniform(-2, 2, 3), np.full(3, 0.1), -1, 0.05, 0.003)
    assert p == pytest.approx(basic.link_transform(0.4, 0.0, 1.0)[:2, :2] @ [-0.003, 0.05], abs=1e-16)
