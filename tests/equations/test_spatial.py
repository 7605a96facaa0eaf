"""The chain in space: equal to the chain of the plane where it bends in one plane, and to Lagrange's equations."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from oracles import space_lagrange as lagrange
from oracles import space_pinocchio as pinocchio
from oracles.chains import SIZES, random_chain, random_state
from oracles.chains import workspace as planar_workspace
from oracles.derivatives import complex_step
from oracles.space import of_the_plane, random_joints, random_space_chain

from pliant.compiler.choose import twin
from pliant.equations import motion, spatial, spatial_points, spatial_springs


def driven(torque, n, size):
    """Torques (N,) of coordinates from those of planar joints (n,)."""
    whole = np.zeros(size)
    whole[: 2 * n : 2] = torque
    return whole


@pytest.fixture(params=[(n, twist) for n in SIZES for twist in (False, True)])
def plane(rng, request):
    """A planar chain with all terms of its springs, and the same in space; bent to the side that both soften on."""
    n, twist = request.param
    chain = random_chain(rng, n)._replace(stiffening=-0.3, cubic_stiffening=0.4, bend_scale=0.25)
    q, dq = random_state(rng, n)
    return chain, np.abs(q), dq, of_the_plane(chain, np.abs(q), dq, twist=twist, base_length=0.03)


def test_accelerations_of_the_plane(plane):
    chain, q, dq, space = plane
    n, size = chain.n, len(space.x)
    expected, found = np.zeros(n), np.zeros(size)
    parts = (chain.drive(0.08), chain.body(), chain.joints(), planar_workspace(n))
    motion.acceleration(chain.phi(q), np.cumsum(dq), *parts, expected)
    drive = driven(chain.drive(0.08), n, size)
    spatial.acceleration(space.x, space.v, drive, space.body, space.joints, space.work(), found)
    expected = np.diff(expected, prepend=0.0)
    assert found[: 2 * n : 2] == pytest.approx(expected, abs=2e-12 * np.abs(expected).max())
    assert np.abs(found[1 : 2 * n : 2]).max() == 0.0


def test_steps_of_the_plane(plane):
    """Ten steps, gravity's slope and every term of the springs implicit in both."""
    chain, q, dq, space = plane
    n, size = chain.n, len(space.x)
    phi, w, x, v = chain.phi(q), np.cumsum(dq), space.x.copy(), space.v.copy()
    work, planar_work = space.work(), planar_workspace(n)
    for _ in range(10):
        motion.step(phi, w, 2e-4, chain.drive(0.08), chain.body(), chain.joints(), planar_work)
        spatial.step(x, v, 2e-4, driven(chain.drive(0.08), n, size), space.body, space.joints, work)
    assert (np.diff(phi, prepend=chain.base_angle) - chain.theta0 > 0).all()  # the law of the plane counts the side
    np.testing.assert_allclose(np.cumsum(x[: 2 * n : 2] + chain.theta0) + chain.base_angle, phi, rtol=0, atol=1e-11)
    np.testing.assert_allclose(np.cumsum(v[: 2 * n : 2]), w, rtol=0, atol=1e-11 * np.abs(w).max())
    assert not x[1 : 2 * n : 2].any()
    assert not x[2 * n :].any()


def accelerate(chain, torque):
    a = np.zeros(len(chain.x))
    spatial.acceleration(chain.x, chain.v, torque, chain.body, chain.joints, chain.work(), a)
    return a


@pytest.mark.parametrize("twist", [False, True])
@pytest.mark.parametrize("n", [1, 2, 3])
def test_accelerations_by_lagrange(rng, n, twist):
    chain = random_space_chain(rng, n, twist=twist, springs=False)
    torque = rng.normal(0, 0.1, len(chain.x))
    expected = lagrange.acceleration(chain, chain.x, chain.v, torque)
    assert accelerate(chain, torque) == pytest.approx(expected, abs=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize("n", range(1, 13))
def test_inertia_and_accelerations_by_pinocchio(rng, n):
    pin = pytest.importorskip("pinocchio", reason="Pinocchio is not installed: pip install -e '.[bench]'")
    for twist in (False, True):
        chain = random_space_chain(rng, n, twist=twist, springs=False)
        torque, size = rng.normal(0, 0.1, len(chain.x)), len(chain.x)
        expected, held = pinocchio.equations(pin, chain, chain.x, chain.v)
        work, M = chain.work(), np.zeros((size, size))
        spatial.pose_links(chain.x, chain.body, work)
        spatial.inertia(0.0, chain.body, work, M)
        np.testing.assert_allclose(np.tril(M), np.tril(expected), rtol=0, atol=1e-13 * np.abs(expected).max())
        a = np.linalg.solve(expected, torque - held)
        assert accelerate(chain, torque) == pytest.approx(a, abs=1e-10 * np.abs(a).max())


@pytest.mark.parametrize("isotropic", [True, False])
def test_springs_hold_what_their_energy_says(rng, isotropic):
    n, size = 4, 12
    joints = random_joints(rng, n, size, isotropic=isotropic)._replace(D=np.zeros(size))
    x = rng.uniform(-2, 2, size)
    held, slope = np.zeros(size), np.zeros((size, size))
    spatial_springs.joint_torques(x, 0.0 * x, joints, np.zeros(size), 0.0, held)
    expected = complex_step(lambda z: spatial_springs.elastic_energy(z, joints), x)
    assert -held == pytest.approx(expected, rel=1e-12)

    def torques(z):
        t = np.zeros(size, complex)
        spatial_springs.joint_torques(z, 0.0 * z, joints, np.zeros(size), 0.0, t)
        return -t

    spatial_springs.add_spring_slopes(x, 1.0, joints, slope)
    np.testing.assert_allclose(slope, np.tril(complex_step(torques, x)), rtol=0, atol=1e-12)


def test_no_direction_of_a_swing_is_preferred(rng):
    joints = random_joints(rng, 1, 2)
    sizes = []
    for angle in np.linspace(0, 2 * np.pi, 7):
        t, x = np.zeros(2), 0.8 * np.array([np.cos(angle), np.sin(angle)])
        spatial_springs.joint_torques(x, 0.0 * x, joints, np.zeros(2), 0.0, t)
        assert t[0] * x[1] == pytest.approx(t[1] * x[0], abs=1e-15)
        sizes.append(np.hypot(*t))
    assert np.ptp(sizes) < 1e-14


def test_straight_joints_have_finite_derivatives(rng):
    joints, x = random_joints(rng, 1, 2), np.zeros(2)

    def torques(z):
        t = np.zeros(2, complex)
        spatial_springs.joint_torques(z, 0.0 * z, joints, np.zeros(2), 0.0, t)
        return -t

    assert complex_step(torques, x) == pytest.approx(np.diag(joints.K[:2]), rel=1e-10)


@pytest.mark.parametrize("twist", [False, True])
def test_energies_by_the_positions_alone(rng, twist):
    chain = random_space_chain(rng, 4, twist=twist)
    kinetic = spatial_points.kinetic_energy(chain.x, chain.v, chain.body, chain.work())
    assert kinetic == pytest.approx(lagrange.kinetic_energy(chain, chain.x, chain.v), rel=1e-13)
    weight = spatial_points.gravity_energy(chain.x, chain.body, chain.work())
    assert weight == pytest.approx(lagrange.gravity_energy(chain, chain.x), rel=1e-12)


@pytest.mark.parametrize("twist", [False, True])
def test_points_and_the_forces_at_them(rng, twist):
    """A point's Jacobian by complex step; forces and moments by the work that they do."""
    chain = random_space_chain(rng, 3, twist=twist)
    aside, across, along = point = 0.01, -0.02, 0.03
    size, work = len(chain.x), chain.work()

    def position(z, link):
        scratch, p = chain.work(complex), np.zeros(3, complex)
        spatial.pose_links(z, chain.body, scratch)
        spatial_points.point_position(link, *point, scratch, p)
        return p

    force, moment = rng.normal(size=(2, 3, 3))
    expected, load = np.zeros(size), np.zeros((4, 3, 5))
    spatial.pose_links(chain.x, chain.body, work)
    for link in range(3):
        p, J = np.zeros(3), np.zeros((3, size))
        spatial_points.point_position(link, *point, work, p)
        spatial_points.point_slope(link, along, p, chain.body, work, J)
        slope = complex_step(lambda z, link=link: position(z, link), chain.x)
        np.testing.assert_allclose(J, slope, rtol=0, atol=1e-14)
        turned = [lagrange.motion(chain, chain.x, e)[3][link] for e in np.eye(size)]
        expected += slope.T @ force[link] + np.array(turned) @ moment[link]
        load[link + 1, :, :3] = np.outer(force[link], (aside, -across, along))
        load[link + 1, :, 3], load[link + 1, :, 4] = force[link], moment[link]
    work.tau[:] = 0.0
    spatial_points.add_link_loads(chain.x, chain.v, 0.0, load, chain.body, chain.joints, work)
    assert work.tau == pytest.approx(expected, abs=1e-13)


def test_series_of_stumpff_up_to_four_radians():
    """Closed forms in 80 digits, beyond pi."""
    with mpmath.workdps(80):
        for v in (1e-9, 0.3, 1.0, 2.0, np.pi, 4.0):
            y = mpmath.mpf(v) ** 2
            c2, c3 = (1 - mpmath.cos(v)) / y, (v - mpmath.sin(v)) / mpmath.mpf(v) ** 3
            expected = (c2, c3, (mpmath.sin(v) / v - 2 * c2) / (2 * y), (c2 - 3 * c3) / (2 * y))
            for found, exact in zip(spatial.stumpff(float(y)), expected, strict=True):
                assert abs(found - float(exact)) <= 5e-16


def test_compiled_is_what_is_written(rng):
    chain = random_space_chain(rng, 2, twist=True)
    results = []
    for step in (spatial.step, twin(spatial.step)):
        x, v = chain.x.copy(), chain.v.copy()
        step(x, v, 1e-3, np.full(6, 0.01), chain.body, chain.joints, chain.work())
        results.append(np.concatenate([x, v]))
    np.testing.assert_allclose(results[1], results[0], rtol=1e-12)
