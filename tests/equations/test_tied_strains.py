"""Strains that change the stiffness of joints: a tube made of fibres, forces and slopes of the energy, steps."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.derivatives import complex_step
from oracles.space import lengthening, random_space_chain
from test_spatial_step import run, stored

from pliant.compiler.choose import twin
from pliant.compiler.trace import BOUNDED, CURVED
from pliant.equations import spatial, spatial_points, spatial_springs
from pliant.equations.elastic import TERMS, spring_curvature, spring_slope

BOTH = pytest.mark.parametrize("twist", [False, True])


def tied(rng, n, segments, *, twist=False):
    """A chain whose axial springs soften within a bound and stiffen again, with the stiffness of joints."""
    chain = lengthening(random_space_chain(rng, n, twist=twist), rng, segments)
    K = chain.joints.K[-segments:]
    axial = np.stack([-1.2 * K, 9.0 * K, np.full(segments, 2.0)])
    joints = chain.joints._replace(hardening=np.concatenate([chain.joints.hardening, axial], axis=1),
                                   tied=rng.uniform(0.3, 1.0, (n, segments)))  # fmt: skip
    return chain._replace(joints=joints)


def torques(chain, x):
    t = np.zeros(len(x), x.dtype)
    still = np.zeros(len(x))
    spatial_springs.joint_torques(x, still, chain.joints, still, 0.0, t)
    return t


def test_a_tube_of_fibres_has_this_energy():
    """Energy of 720 fibres on a ring, each with the cubic law of the wall, at a strain and small curvatures.

    The bending stiffness at rest is EI / l with I = A r^2 / 2, and nothing but the fibres' energies is compared.
    """
    force, radius, length, s, a = 700.0, 0.03, 0.1, -2.0, 60.0
    y = radius * np.cos(2 * np.pi * np.arange(720) / 720)

    def fibres(strain, angle):
        e = strain + y * angle / length
        return force * length * np.mean(e**2 / 2 + s * e**3 / 3 + a * e**4 / 4)

    axial, bending = force * length, force * radius**2 / 2 / length
    hardening = np.array([[0.0, 0.0, s * axial], [0.0, 0.0, a * axial], [0.0, 0.0, 0.0]])
    chain = random_space_chain(np.random.default_rng(1), 1)
    joints = chain.joints._replace(theta0=np.zeros(3), K=np.array([bending, bending, axial]), hardening=hardening,
                                   tied=np.ones((1, 1)))  # fmt: skip
    for strain in (-0.08, -0.02, 0.0, 0.05):
        for angle in (1e-2, 2e-2):
            x = np.array([0.6 * angle, 0.8 * angle, strain])
            straight = spatial_springs.elastic_energy(np.array([0.0, 0.0, strain]), joints)
            found = spatial_springs.elastic_energy(x, joints) - straight
            exact = fibres(strain, angle) - fibres(strain, 0.0)
            beyond = force * length * 3 / 32 * a * (radius * angle / length) ** 4  # fourth order: a <y^4> / 4
            assert found == pytest.approx(exact - beyond, rel=1e-9)
            assert beyond < 1e-3 * exact


def test_curvature_of_the_springs(rng):
    chain = tied(rng, 1, 1)
    for bend in (-0.7, 0.0, 0.4):
        second = complex_step(lambda q: np.array([spring_slope(2, chain.joints, q[0])]), np.array([bend]))
        third = complex_step(lambda q: np.array([spring_curvature(2, chain.joints, q[0])[0]]), np.array([bend]))
        assert spring_curvature(2, chain.joints, bend) == pytest.approx((second[0, 0], third[0, 0]), rel=1e-12)
    assert len(chain.joints.hardening) == TERMS + 1


@BOTH
def test_torques_are_the_slope_of_the_energy(rng, twist):
    chain = tied(rng, 3, 2, twist=twist)
    slope = complex_step(lambda x: np.array([spatial_springs.elastic_energy(x, chain.joints)]), chain.x)[0]
    assert np.abs(slope[-2:]).min() > 1e-3
    np.testing.assert_allclose(torques(chain, chain.x), -slope, rtol=0, atol=1e-12 * np.abs(slope).max())


@BOTH
def test_slopes_of_a_step_are_those_of_the_torques(rng, twist):
    chain = tied(rng, 3, 2, twist=twist)
    exact, A = -complex_step(lambda x: torques(chain, x), chain.x), np.zeros((len(chain.x), len(chain.x)))
    undamped = chain.joints._replace(D=0.0 * chain.joints.D)
    spatial_springs.add_spring_slopes(chain.x, 1.0, undamped, A)
    assert np.abs(exact[-2:, :-2]).max() > 1e-3
    np.testing.assert_allclose(A, np.tril(exact), rtol=0, atol=1e-12 * np.abs(exact).max())


@BOTH
def test_work_of_a_step_balances_the_energy(rng, twist):
    chain = tied(rng, 2, 2, twist=twist)
    size = len(chain.x)
    torque, before, left = rng.normal(0, 0.05, size), stored(chain, chain.x, chain.v), []
    for h in (4e-6, 2e-6):
        x, v, work, total = chain.x.copy(), chain.v.copy(), chain.work(), np.zeros(2)
        spatial.step(x, v, h, torque, chain.body, chain.joints, work)
        spatial_points.add_step_work(v, h, torque, chain.joints, work, total)
        left.append(abs(stored(chain, x, v) - before - total[0] + total[1]))
    assert left[1] < 0.01 * total[1]
    assert left[0] / left[1] > 7.0  # 8 for the third order


def test_without_ties_the_strain_leaves_the_bend_alone(rng):
    chain = tied(rng, 2, 1)
    loose = chain._replace(joints=chain.joints._replace(tied=np.zeros((2, 1))))
    moved = chain.x + np.array([0, 0, 0, 0, 0.1])
    assert torques(loose, moved)[:4] == pytest.approx(torques(loose, chain.x)[:4], rel=1e-14)
    assert not np.allclose(torques(chain, moved)[:4], torques(chain, chain.x)[:4], rtol=1e-3)


@pytest.mark.slow  # compiles the step
def test_compiled_is_what_is_written(rng):
    chain = tied(rng, 2, 2)
    results = []
    for step in (spatial.step, twin(spatial.step), twin(spatial.step, 2, 2, 2, 0, CURVED + BOUNDED)):
        x, v = chain.x.copy(), chain.v.copy()
        step(x, v, 1e-3, np.full(6, 0.01), chain.body, chain.joints, chain.work())
        results.append(np.concatenate([x, v]))
    np.testing.assert_allclose(results[1:], [results[0]] * 2, rtol=1e-12)


@pytest.mark.slow  # compiles the step
def test_energy_of_a_long_motion_drifts_with_the_square_of_the_step(rng):
    chain = tied(rng, 2, 1)
    chain = chain._replace(v=0.3 * chain.v, joints=chain.joints._replace(D=0.0 * chain.joints.D))
    before, drifts = stored(chain, chain.x, chain.v), []
    for h in (1e-4, 5e-5):
        energies = [stored(chain, *run(chain, h, round(t / h))) for t in (0.1, 0.2, 0.5)]
        drifts.append(np.abs(np.array(energies) - before).max() / abs(before))
    assert drifts[1] < 1e-3, drifts
    assert drifts[0] / drifts[1] > 3.0, drifts  # 4 for the second order
