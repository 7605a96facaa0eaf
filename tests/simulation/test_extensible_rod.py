"""A chain that lengthens against an extensible rod: Kirchhoff's balance of force and moment, solved by shooting."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Extension, chain_model
from pliant.simulation import equilibrium, modes

LENGTH, DENSITY, EI, EA, TIP_MASS = 0.3, 0.8, 0.02, 25.0, 0.02  # m, kg/m, N m^2, N, kg
GRAVITY, PULL = np.array([3.0, -6.0]), np.array([0.15, 0.1])  # m/s^2; N at the tip
PRESSURE, AREA, OFFSET = 1e4, 2e-4, 0.02  # Pa, m^2, m: a chamber beside the whole rod
CLAMPED = np.vstack([np.zeros((3, 3)), np.eye(3)])  # moment and force at the base are free


def slope(y):
    """Along the unstretched rod, of place, angle, moment and force (6, ...): n' = -rho g, m' = -(1 + e) t x n.

    The chamber pushes with p A at its offset, so the wall carries the tension n . t + p A and the moment m + p A r.
    """
    _, _, angle, moment, fx, fy = y
    s, c, push = np.sin(angle), np.cos(angle), PRESSURE * AREA
    stretch = 1.0 + (c * fy - s * fx + push) / EA
    weight = -DENSITY * GRAVITY
    return np.array([-stretch * s, stretch * c, (moment + push * OFFSET) / EI, stretch * (s * fy + c * fx),
                     weight[0] + 0.0 * fx, weight[1] + 0.0 * fy])  # fmt: skip


def along(f, start, rtol):
    return solve_ivp(f, (0.0, LENGTH), start, method="DOP853", rtol=rtol, atol=1e-12, dense_output=True)


def rod_at_rest(pull):
    """Place, angle, moment and force (6,) at any place of the clamped rod: no moment is left at its tip."""
    base = pull + (TIP_MASS + DENSITY * LENGTH) * GRAVITY

    def shot(moment):
        return along(lambda _, y: slope(y), [0.0, 0.0, 0.0, moment, *base], 1e-10)

    return shot(brentq(lambda moment: shot(moment).y[3, -1], -0.5, 0.5, xtol=1e-13)).sol


def rod_modes(rest, highest):
    """Frequencies up to `highest` [Hz] of small motions about the rest: moment and force can vanish at the tip."""

    def left_at_tip(hertz):
        square = (2.0 * np.pi * hertz) ** 2

        def move(s, moved):
            moved = moved.reshape(6, 3)
            rate = slope(rest(s)[:, None] + 1e-20j * moved).imag / 1e-20  # exact derivative along each column
            rate[4:] -= DENSITY * square * moved[:2]
            return rate.ravel()

        tip = along(move, CLAMPED.ravel(), 1e-8).y[:, -1].reshape(6, 3)
        return np.linalg.det(np.vstack([tip[3], tip[4:] - TIP_MASS * square * tip[:2]]))

    grid = np.arange(0.25, highest, 0.5)
    signs = np.sign([left_at_tip(hertz) for hertz in grid])
    return np.array([brentq(left_at_tip, *grid[i : i + 2]) for i in np.flatnonzero(np.diff(signs))])


def chain(links, segments):
    edges = np.linspace(0.0, LENGTH, segments + 1)
    return chain_model(
        length=LENGTH, mass=DENSITY * LENGTH, links=links, joint_placement="midsegment", stiffness=EI * links / LENGTH,
        damping=0.0, gravity=GRAVITY, tip_mass=TIP_MASS, chambers=(Chamber.at_offset(AREA, OFFSET, np.ones(links)),),
        extensions=[Extension(EA, 0.0, a, b, f"{a:.3f}") for a, b in pairwise(edges)],
    )  # fmt: skip


@pytest.fixture(scope="module")
def rod():
    """Tip of the loaded rod, and the modes of the rod without the pull: bent by 55 degrees, longer by 7 %."""
    return rod_at_rest(PULL)(LENGTH)[:2], rod_modes(rod_at_rest(np.zeros(2)), 7.0)


def errors(rod, links, segments):
    """Of the tip in parts of the length, and of the first three frequencies in parts of themselves."""
    model = chain(links, segments)
    tip = mechanics_of(model).tips(mechanics_of(model).coordinates(equilibrium(model, PRESSURE, PULL)))[-1]
    hertz = modes(model, equilibrium(model, PRESSURE))[0][:3]
    return np.append(np.linalg.norm(tip - rod[0]) / LENGTH, np.abs(hertz / rod[1] - 1.0))


def test_the_chain_tends_to_the_rod(rod):
    """With a strain for each link: second order, 0.07 % of the length and 0.36 % of the frequencies at twenty links."""
    assert rod[1] == pytest.approx([0.711, 3.877, 5.636], abs=1e-3)  # the second and third bend and stretch
    coarse, fine = errors(rod, 10, 10), errors(rod, 20, 20)
    assert (fine < [0.001, 0.001, 0.004, 0.001]).all(), fine
    assert (np.log2(coarse / fine) > 1.9).all(), np.log2(coarse / fine)


def test_few_strains_are_an_approximation(rod):
    """Of twenty links: what one uniform strain leaves out stays with more links, four strains leave a third of it."""
    one, four = errors(rod, 20, 1), errors(rod, 20, 4)
    assert one == pytest.approx([0.0092, 0.0070, 0.0419, 0.0308], rel=0.02)
    assert four == pytest.approx([0.0024, 0.0023, 0.0102, 0.0031], rel=0.02)
