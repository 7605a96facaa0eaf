"""A, d and tau = p A d, Sec. III-C, with the numbers of the paper's actuator."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.chains import PAPER_GAIN

from pliant import basic
from pliant.equations.chamber import bladder_area, lever_arm, torque

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
