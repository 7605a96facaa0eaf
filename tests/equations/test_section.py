"""A, d and tau = p A d, Sec. III-C, with the numbers of the paper's actuator."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.chains import PAPER_GAIN

from pliant import basic
from pliant.equations.section import (
    bladder_area,
    inflated,
    inflated_interval,
    lever_arm,
    lever_growth,
    mean_inflated_torque,
    mean_swollen_torque,
    mean_torque,
    secant,
    slow_interval,
    swollen_torque,
    torque,
)

R2 = 0.010  # m


def test_section_of_the_papers_bladder():
    assert bladder_area(R2) == pytest.approx(1.5708e-4, rel=1e-5)
    assert lever_arm(R2) == pytest.approx(4.2441e-3, rel=1e-5)
    assert bladder_area(R2) * lever_arm(R2) == pytest.approx(PAPER_GAIN, rel=1e-14)
    assert (bladder_area(R2), lever_arm(R2)) == pytest.approx(basic.section(R2), rel=1e-15)


def test_lever_arm_is_the_centroid_of_a_half_disc():
    y = np.linspace(0.0, R2, 200_001)
    width = 2.0 * np.sqrt(R2**2 - y**2)
    assert lever_arm(R2) == pytest.approx(np.trapezoid(y * width, y) / np.trapezoid(width, y), rel=1e-6)


@pytest.mark.parametrize(("pressure", "expected"), [(119e3, 0.07933), (240e3, 0.160), (0.0, 0.0)])
def test_torque_of_the_paper(pressure, expected):
    gain = np.array([bladder_area(R2) * lever_arm(R2)])
    assert torque(pressure, gain) == pytest.approx(expected, rel=1e-4)
    assert torque(pressure, gain) == pytest.approx(basic.torque(pressure, basic.paper())[0], rel=1e-14)


def test_torque_polynomial_has_no_constant_term(rng):
    a = rng.normal(size=4)
    p = 1.7
    assert torque(p, a) == pytest.approx(sum(a[k] * p ** (k + 1) for k in range(4)), rel=1e-13)
    assert torque(0.0, a) == 0.0


def test_virtual_work_gives_every_joint_the_same_torque():
    """p dV/dq_i with V = A (arc length of the line through the chamber's centroid), for a bend of each joint alone."""
    A, d = bladder_area(R2), lever_arm(R2)
    l, q = 0.034, np.array([0.3, 0.1, 0.0, 0.2, 0.5])
    radius = l / np.where(q == 0.0, np.inf, q)  # of the flat face, which keeps its length
    arc = np.where(q == 0.0, l, (radius + d) * q)
    volume = A * arc
    assert volume - A * l == pytest.approx(A * d * q, rel=1e-12)


@pytest.mark.parametrize("terms", [1, 2, 4])
def test_secant_is_the_divided_difference(rng, terms):
    a = rng.normal(size=terms)
    assert secant(1.3, 0.4, a) == pytest.approx((torque(1.3, a) - torque(0.4, a)) / 0.9, rel=1e-12)
    slope = np.imag(torque(0.7 + 1e-30j, a)) / 1e-30
    assert secant(0.7, 0.7, a) == pytest.approx(slope, rel=1e-12)


def test_mean_torque_is_exact_for_the_papers_law():
    """Whatever the pressure did within the interval: here it settles in a small part of it."""
    lag = 0.01
    end, half, mean = 1 - np.exp(-1 / lag), 1 - np.exp(-0.5 / lag), 1 - lag * (1 - np.exp(-1 / lag))
    assert mean_torque(0.0, half, end, mean, np.array([2.0])) == pytest.approx(2 * mean, rel=1e-14)


@pytest.mark.parametrize("terms", [1, 2, 3])
def test_mean_torque_along_a_straight_pressure_is_exact_to_the_cubic_law(rng, terms):
    a = rng.normal(size=terms)
    p = np.linspace(0.2, 1.4, 100_001)
    expected = np.trapezoid(torque(p, a), p) / 1.2
    assert mean_torque(0.2, 0.8, 1.4, 0.8, a) == pytest.approx(expected, rel=1e-8)


LAW = np.array([6e-7, 2e-12, 3e-18])


def test_a_chamber_that_has_swollen_follows_the_law():
    assert swollen_torque(1e5, 1e5, 0.7, LAW) == pytest.approx(torque(1e5, LAW), rel=1e-15)
    assert swollen_torque(1e5, 2e4, 0.0, LAW) == torque(1e5, LAW)
    assert swollen_torque(1e5, 2e4, 1.0, LAW) == pytest.approx(1e5 * torque(2e4, LAW) / 2e4, rel=1e-15)
    assert swollen_torque(0.0, 2e5, 0.7, LAW) == 0.0


def test_slow_pressure_behind_a_straight_one_is_exact():
    """time s' = p - s with p = p0 + rise t / h, at the middle and the end; small and large h / time."""
    p0, p1, s0 = 2e4, 9e4, 5e4
    for h, time in ((1e-3, 10.0), (0.3, 0.2), (5.0, 0.1)):
        slope = (p1 - p0) / h
        expected = [p0 + slope * (t - time) + (s0 - p0 + slope * time) * np.exp(-t / time) for t in (h / 2, h)]
        assert slow_interval(h, p0, p1, 0.5 * (p0 + p1), s0, time) == pytest.approx(expected, rel=1e-9)


def test_mean_torque_of_a_swelling_chamber(rng):
    """The plain rule at share 0; the mean of the law along straight pressures; the mean of p for a linear law."""
    p, s = rng.uniform(0, 1e5, 4), rng.uniform(0, 1e5, 3)
    assert mean_swollen_torque(*p, *s, 0.0, LAW) == pytest.approx(mean_torque(*p, LAW), rel=1e-12)
    assert mean_swollen_torque(*p, *s, 0.6, LAW[:1]) == pytest.approx(LAW[0] * p[3], rel=1e-12)
    t = np.linspace(0, 1, 20001)
    straight = swollen_torque(2e4 + 6e4 * t, 3e4 + 1e4 * t, 0.6, LAW[:2])
    found = mean_swollen_torque(2e4, 5e4, 8e4, 5e4, 3e4, 3.5e4, 4e4, 0.6, LAW[:2])
    assert found == pytest.approx(np.trapezoid(straight, t), rel=1e-8)


LIMIT, WALL = 5e4, 0.05


def test_a_chamber_inflates_as_its_wall_lets_it():
    """At rest p = limit (1 - stretch^-4); the nearer the limit, the slower; nothing special at the limit itself."""
    for p in (0.0, 1e4, 4e4, -2e4):
        middle, end = inflated_interval(50.0, p, p, p, 1.0, LIMIT, WALL)
        assert p == pytest.approx(LIMIT * (1.0 - 1.0 / end), abs=1e-9)
        assert middle == pytest.approx(end)
    for p in (2e4, 4e4, LIMIT, LIMIT * (1 + 1e-10), 6e4):
        t = np.linspace(0.0, 0.1, 200_001)
        rate = (1.0 - p / LIMIT) / WALL
        expected = np.exp(-rate * 0.1) * 1.2 + np.trapezoid(np.exp(-rate * t), t) / WALL
        assert inflated(0.1, p, 1.2, LIMIT, WALL) == pytest.approx(expected, rel=1e-9)
    left = [1.0 / (1.0 - p / LIMIT) - inflated(0.1, p, 1.0, LIMIT, WALL) for p in (2e4, 4e4)]
    assert left[1] > 10 * left[0]


def test_mean_torque_of_an_inflating_chamber(rng):
    """The rule of the rigid wall at no stretch; the mean of the law along straight pressures and stretches."""
    p, s = rng.uniform(0, 1e5, 4), rng.uniform(0, 1e5, 3)
    rigid = mean_swollen_torque(*p, *s, 0.6, LAW)
    assert mean_inflated_torque(*p, *s, 1.0, 1.0, 1.0, 0.6, LAW) == rigid
    assert mean_inflated_torque(*p, *s, 16.0, 16.0, 16.0, 0.6, LAW) == pytest.approx(8.0 * rigid, rel=1e-14)
    t = np.linspace(0, 1, 20001)
    growing = lever_growth(1.2 + 0.1 * t) * swollen_torque(2e4 + 6e4 * t, 3e4 + 1e4 * t, 0.6, LAW[:2])
    found = mean_inflated_torque(2e4, 5e4, 8e4, 5e4, 3e4, 3.5e4, 4e4, 1.2, 1.25, 1.3, 0.6, LAW[:2])
    assert found == pytest.approx(np.trapezoid(growing, t), rel=1e-6)
