"""The torque law over an interval: its secant, and its mean where the pressure settles within the interval."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.equations.chamber import mean_of_law, secant, torque
from pliant.equations.symbols import Interval

LAW = np.array([6e-7, -2e-12, 3e-18])


def test_secant_is_the_slope_between_two_pressures_and_the_tangent_at_one(rng):
    p0, p1 = rng.uniform(-1e5, 2e5, (2, 50))
    assert secant(p0, p1, LAW, 0) == pytest.approx((torque(p1, LAW) - torque(p0, LAW)) / (p1 - p0), rel=1e-9)
    assert secant(p0, p0, LAW, 0) == pytest.approx(LAW[0] + 2 * LAW[1] * p0 + 3 * LAW[2] * p0**2, rel=1e-12)
    assert secant(p0, p1, LAW[:1], 0) == pytest.approx(np.full(50, LAW[0]))


def test_mean_over_a_straight_pressure_is_exact():
    p0, p1 = 2e4, 1.4e5
    exact = sum(a / (k + 2) * (p1 ** (k + 2) - p0 ** (k + 2)) for k, a in enumerate(LAW)) / (p1 - p0)
    assert mean_of_law(Interval(p0, 8e4, p1, 8e4), LAW) == pytest.approx(exact, rel=1e-14)


@pytest.mark.parametrize("ratio", [0.1, 1.0, 10.0, 1000.0])
def test_mean_of_a_linear_law_is_exact_however_fast_the_valve(ratio):
    middle, end = 1 - np.exp(-ratio / 2), 1 - np.exp(-ratio)
    mean = 1 - end / ratio
    assert mean_of_law(Interval(0.0, middle, end, mean), np.array([3.0])) == pytest.approx(3 * mean, rel=1e-14)


def test_mean_of_a_square_law_is_right_for_slow_and_for_fast_valves():
    for ratio, within in ((0.1, 1e-3), (1.0, 0.02), (10.0, 0.06), (1e3, 1e-3)):
        middle, end = 1 - np.exp(-ratio / 2), 1 - np.exp(-ratio)
        exact = 1 - 2 * end / ratio + (1 - np.exp(-2 * ratio)) / (2 * ratio)
        p = Interval(0.0, middle, end, 1 - end / ratio)
        assert mean_of_law(p, np.array([0.0, 1.0])) == pytest.approx(exact, rel=within)
