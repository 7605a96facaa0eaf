"""Torque laws with kernels: found under their numbers, their slopes, and the closed form of each."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.equations import laws, saturating_law
from pliant.equations.chamber import torque
from pliant.errors import InputError
from pliant.model import Chamber

LEVELS = np.linspace(1e4, 1.2e5, 12)  # Pa
EACH_LAW = pytest.mark.parametrize("law", laws.LAWS, ids=lambda law: law.name)


def numbers(law):
    """Of a torque that rises less and less."""
    return law.numbers(law.start(LEVELS, 2e-6 * LEVELS / (1.0 + LEVELS / 1e5)))


@EACH_LAW
def test_a_law_is_found_under_its_number(law):
    own = numbers(law)
    for p in (3e4, 3e4 + 1e-20j, LEVELS):
        np.testing.assert_array_equal(laws.lever(p, own, laws.NUMBERS[law.name]), law.lever(p, own))


def test_the_polynomial_is_the_papers_law_under_number_0():
    a = np.array([3e-7, 2e-12, -1e-18])
    np.testing.assert_array_equal(laws.law_torque(LEVELS, a, laws.NUMBERS["polynomial"]), torque(LEVELS, a))
    np.testing.assert_allclose(laws.law_slope(LEVELS, a, 0.0), a[0] + 2 * a[1] * LEVELS + 3 * a[2] * LEVELS**2)


@EACH_LAW
def test_slopes_of_a_law_are_those_of_the_complex_step(law):
    chamber = Chamber(torque=numbers(law), law=law.name)
    exact = laws.law_torque(LEVELS + 1e-8j, chamber.torque, laws.NUMBERS[law.name]).imag / 1e-8
    np.testing.assert_allclose(chamber.law_slope(LEVELS), exact, rtol=1e-7)
    np.testing.assert_allclose(chamber.torque_at(LEVELS) / LEVELS, chamber.lever_at(LEVELS), rtol=1e-15)


def test_a_saturating_law_is_straight_at_first_and_levels_off():
    chamber = Chamber(torque=[2e-6, 5e4], law="saturating")
    assert chamber.torque_at(1.0) == pytest.approx(2e-6, rel=1e-9)
    assert chamber.torque_at(5e4) == pytest.approx(2e-6 * 5e4 / np.sqrt(2.0))
    assert chamber.torque_at(np.array([-1e9, 1e9])) == pytest.approx([-0.1, 0.1], rel=1e-8)
    assert saturating_law.start(LEVELS, chamber.torque_at(LEVELS)) == pytest.approx({"lever": 2e-6, "level": 5e4})
    assert saturating_law.start(LEVELS, 3e-6 * LEVELS)["lever"] == pytest.approx(3e-6)
    with pytest.raises(InputError, match=r"level of the law 'saturating' must lie within 1000 ... 1e\+08 Pa, got 50"):
        Chamber(torque=[2e-6, 50.0], law="saturating")
