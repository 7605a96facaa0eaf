"""What the paper's numbers predict: natural modes under three readings of the mass, damped poles, statics."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.chains import PAPER_GAIN, paper_chain, workspace
from scipy.linalg import eigh
from scipy.optimize import brentq

from pliant import basic
from pliant.equations.chain import tips
from pliant.equations.motion import acceleration, acceleration_jacobian
from pliant.equations.symbols import Slopes


def state_matrix(chain, q=None):
    """d(phi, w)/dt linearised at rest in the shape q: (2n, 2n)."""
    n = chain.n
    phi = chain.phi(np.zeros(n) if q is None else q)
    a, a_phi, a_w = np.zeros(n), np.zeros((n, n)), np.zeros((n, n))
    args = (np.zeros(n), chain.body(), chain.joints(), workspace(n))
    acceleration_jacobian(phi, np.zeros(n), *args, Slopes(a, a_phi, a_w))
    return np.block([[np.zeros((n, n)), np.eye(n)], [a_phi.T, a_w.T]])


def frequencies(chain):
    """Undamped natural frequencies, Hz, ascending."""
    poles = np.linalg.eigvals(state_matrix(chain._replace(D=0 * chain.D)))
    assert np.abs(poles.real).max() < 1e-6 * np.abs(poles).max()
    return np.sort(poles.imag[poles.imag > 0]) / (2 * np.pi)


def damping_of_first(chain):
    poles = np.linalg.eigvals(state_matrix(chain))
    swing = poles[np.abs(poles.imag) > 1e-6]
    first = swing[np.argmin(np.abs(swing))]
    return -first.real / abs(first)


READINGS = [
    ("tip", [5.0062, 31.2163, 81.7253, 139.2889, 184.7917]),
    ("rod", [5.9156, 37.7728, 107.0265, 206.8308, 308.0252]),
    ("middle", [5.95, 39.8, 125, 314, 1132]),
]


@pytest.mark.parametrize(("mass", "expected"), READINGS)
def test_modes_of_each_reading(mass, expected):
    precision = 0.00006 if mass != "middle" else 0.5
    assert np.abs(frequencies(paper_chain(mass)) - expected).max() < precision


@pytest.mark.parametrize(("cap", "expected"), [(0.005, 5.26), (0.0075, 5.00), (0.010, 4.77), (0.020, 4.10)])
def test_a_cap_on_the_rod_lowers_the_first_mode(cap, expected):
    assert frequencies(paper_chain("rod", m_tip=cap))[0] == pytest.approx(expected, abs=0.006)


def test_the_cap_that_makes_the_rod_ring_at_five_hertz():
    assert frequencies(paper_chain("rod", m_tip=7.464e-3))[0] == pytest.approx(5.0, abs=5e-5)


@pytest.mark.parametrize(("share", "expected"), [(1 / 12, 4.98), (1 / 3, 4.91)])
def test_rotary_inertia_at_the_tips(share, expected):
    chain = paper_chain()
    assert frequencies(chain._replace(I=share * chain.m * chain.l**2))[0] == pytest.approx(expected, abs=0.005)


@pytest.mark.parametrize(("gy", "expected"), [(9.81, 6.10), (-9.81, 5.73)])
def test_gravity_along_the_rod_stiffens_or_softens(gy, expected):
    assert frequencies(paper_chain("rod", gy=gy))[0] == pytest.approx(expected, abs=0.005)


@pytest.mark.parametrize(
    ("mass", "cap", "expected"), [("tip", 0, 0.078), ("rod", 0, 0.0925), ("rod", 0.0075, 0.078), ("middle", 0, 0.093)]
)
def test_damping_ratio_of_the_first_mode(mass, cap, expected):
    assert damping_of_first(paper_chain(mass, m_tip=cap)) == pytest.approx(expected, abs=0.0006)


@pytest.mark.parametrize(("mass", "fastest"), [("tip", -6.5e3), ("rod", -1.84e4), ("middle", -2.5e5)])
def test_fastest_pole(mass, fastest):
    assert np.linalg.eigvals(state_matrix(paper_chain(mass))).real.min() == pytest.approx(fastest, rel=0.02)


@pytest.mark.parametrize("mass", ["tip", "rod"])
def test_each_damped_mode_solves_its_own_quadratic(mass):
    """lambda^2 + (D/K) omega^2 lambda + omega^2 = 0, as D is proportional to K."""
    chain = paper_chain(mass)
    omega, ratio = 2 * np.pi * frequencies(chain), chain.D[0] / chain.K[0]
    expected = np.concatenate([np.roots([1, ratio * w**2, w**2]) for w in omega])
    poles = np.linalg.eigvals(state_matrix(chain))
    assert np.sort_complex(poles) == pytest.approx(np.sort_complex(expected), rel=1e-6)


def test_slow_poles_of_overdamped_modes_tend_to_stiffness_over_damping():
    chain = paper_chain("middle")
    poles = np.linalg.eigvals(state_matrix(chain))
    slow = np.sort(poles[np.abs(poles.imag) < 1e-9].real)[::-1][:2]
    limit = -chain.K[0] / chain.D[0]
    assert limit == pytest.approx(-200.8, abs=0.1)
    assert slow.min() == pytest.approx(limit, rel=0.08)
    assert slow.max() < limit  # they come from below


@pytest.mark.parametrize(
    ("pressure", "degrees", "tip"),
    [(119e3, 2.8291, (-25.029, 167.729)), (240e3, 5.7057, (-49.540, 160.863))],
)
def test_static_bend_of_the_paper(pressure, degrees, tip):
    chain = paper_chain()
    q = PAPER_GAIN * pressure / chain.K
    p = np.zeros((5, 2))
    tips(chain.phi(q), chain.l, 0.0, 0.0, p)
    assert np.degrees(q) == pytest.approx(np.full(5, degrees), abs=5e-5)
    assert p[-1] * 1e3 == pytest.approx(tip, abs=5e-4)


def test_sideways_gravity_is_not_small():
    """In a vertical plane the tip of the straight actuator sinks by about 11 mm, joint 1 by 2.05 degrees."""
    chain = paper_chain("rod", gx=-9.81)
    phi = np.zeros(5)
    A = state_matrix(chain)
    work, body, joints, a, rest = workspace(5), chain.body(), chain.joints(), np.ones(5), np.zeros(5)
    for _ in range(30):
        acceleration(phi, rest, rest, body, joints, work, a)
        phi -= np.linalg.solve(A[5:, :5], a)
    assert np.abs(a).max() < 1e-6
    p = np.zeros((5, 2))
    tips(phi, chain.l, 0.0, 0.0, p)
    assert np.degrees(phi[0]) == pytest.approx(2.05, abs=0.02)
    assert p[-1, 0] * 1e3 == pytest.approx(-11, abs=0.5)


def test_joints_at_mid_segment_come_closer_to_the_continuous_beam():
    """Links l, ..., l, l/2 behind a stub l/2: 7.17 Hz for the beam's 7.10 Hz; joints at the bases: 5.92 Hz."""
    rod = paper_chain("rod")
    l = np.array([0.034, 0.034, 0.034, 0.034, 0.017])
    m = 0.069 / 0.17 * l
    middle = rod._replace(l=l, m=m, c=l / 2, I=m * l**2 / 12)
    stiffness, density, length = 1.6067 * 0.034, 0.069 / 0.17, 0.17
    root = brentq(lambda x: np.cos(x) * np.cosh(x) + 1, 1.5, 2.5)
    beam = (root / length) ** 2 * np.sqrt(stiffness / density) / (2 * np.pi)
    assert beam == pytest.approx(7.10, abs=0.01)
    assert frequencies(middle)[0] == pytest.approx(7.17, abs=0.01)


def test_modes_once_more_from_the_readable_twin():
    """From K and M, so that the table does not rest on one kernel."""
    squares = eigh(np.diag(paper_chain().K), basic.inertia(np.zeros(5), basic.paper()), eigvals_only=True)
    assert np.sqrt(squares) / (2 * np.pi) == pytest.approx(frequencies(paper_chain()), rel=1e-6)
