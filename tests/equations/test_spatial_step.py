"""`spatial.step`: its order, its stability, what it keeps, a heavy top, and its derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.allocation import allocations
from oracles.derivatives import complex_step
from oracles.space import SpaceChain, free_joints, no_tendons, random_joints, random_space_chain
from scipy.integrate import solve_ivp

from pliant.compiler.choose import twin
from pliant.compiler.twin import makes_arrays, reached, rebuild
from pliant.equations import spatial, spatial_points, spatial_springs
from pliant.equations.symbols import SpatialBody


def run(chain, h, steps, torque=None):
    """Coordinates and rates (2, N) after so many compiled steps."""
    x, v, step = chain.x.copy(), chain.v.copy(), twin(spatial.step)
    args = (np.zeros(x.size) if torque is None else torque, chain.body, chain.joints, chain.work())
    for _ in range(steps):
        step(x, v, h, *args)
    return np.stack([x, v])


def reference(chain, end, torque):
    """Coordinates and rates at the end by an adaptive method of order 8."""
    args, size, kernel = (torque, chain.body, chain.joints, chain.work()), chain.x.size, spatial.acceleration

    def rate(_, y):
        a = np.empty(size)
        kernel(y[:size], y[size:], *args, a)
        return np.concatenate([y[size:], a])

    found = solve_ivp(rate, (0, end), np.concatenate([chain.x, chain.v]), "DOP853", rtol=1e-9, atol=1e-10)
    return found.y[:, -1].reshape(2, size)


@pytest.mark.parametrize(("n", "twist"), [(2, False), (2, True)])
def test_second_order(rng, n, twist):
    """Fast motion under gravity with every term of the springs, unequal in the two directions."""
    chain = random_space_chain(rng, n, twist=twist)
    chain = chain._replace(joints=random_joints(rng, n, chain.x.size, isotropic=False))
    torque, end = rng.normal(0, 0.05, chain.x.size), 0.02
    exact = reference(chain, end, torque)[0]
    steps = np.array([100, 200, 400, 800])
    errors = [np.abs(run(chain, end / k, k, torque)[0] - exact).max() for k in steps]
    assert -np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.1), errors


def stored(chain, x, v):
    """Energy, J."""
    still, work = spatial_springs.elastic_energy(x, chain.joints), chain.work()
    weight = spatial_points.gravity_energy(x, chain.body, work)
    return still + weight + spatial_points.kinetic_energy(x, v, chain.body, work)


@pytest.mark.parametrize("stiffness", [1e-3, 1.0, 1e4])
@pytest.mark.parametrize("h", [1e-4, 1e-2, 0.3])
def test_small_undamped_motion_keeps_its_energy_at_any_step(rng, h, stiffness):
    """Springs and the slope of gravity are implicit, in a hanging chain that is heavy or stiff."""
    chain = hanging(3)
    chain = chain._replace(x=1e-10 * rng.normal(size=6), v=np.zeros(6),
                           joints=chain.joints._replace(K=stiffness * chain.joints.K))  # fmt: skip
    S, M = slope_of_rest(chain), inertia(chain, np.zeros(6))
    energies = []
    for steps in (0, 1, 100, 300):
        x, v = run(chain, h, steps)
        energies.append(0.5 * v @ M @ v + 0.5 * x @ S @ x)
    assert np.ptp(energies) < 1e-5 * energies[0]


def inertia(chain, x):
    """M (N, N)."""
    work, M = chain.work(), np.zeros((x.size, x.size))
    spatial.pose_links(x, chain.body, work)
    spatial.inertia(0.0, chain.body, work, M)
    return M + np.tril(M, -1).T


def hanging(n):
    """Equal links that hang straight down, isotropic springs with all terms, no dampers."""
    length, mass = np.full(n + 1, 0.2), np.full(n, 0.1)
    body = SpatialBody(length, mass, length[1:] / 2, mass * length[1:] ** 2 / 12, mass * 1e-4,
                       np.tile(np.eye(3), (n, 1, 1)), np.eye(3), 0.0, 0.0, 9.81, *no_tendons(n, 2 * n))  # fmt: skip
    K = np.full(2 * n, 0.5)
    joints = free_joints(n, 2 * n)._replace(K=K, hardening=np.stack([-0.3 * K, 0.4 * K, np.full(2 * n, 0.25)]))
    start = np.linspace(-0.6, 0.5, 2 * n)
    return SpaceChain(body, joints, start, 4 * np.cos(7 * start))


def slope_of_rest(chain):
    """Slope (N, N) of all static forces in the straight shape."""

    def held(x):
        work, t = chain.work(complex), np.zeros(x.size, complex)
        spatial.pose_links(x, chain.body, work)
        spatial_springs.joint_torques(x, 0.0 * x, chain.joints, 0.0 * x, 0.0, t)
        spatial.inertial_forces(x, 0.0 * x, chain.body, work, work.f)
        return work.f - t

    return complex_step(held, np.zeros(chain.x.size))


def turning(chain, x, v):
    """What the symmetry about gravity keeps of a chain that hangs: sum a p_b - b p_a, p = M v."""
    p = inertia(chain, x) @ v
    return x[::2] @ p[1::2] - x[1::2] @ p[::2]


def test_energy_and_angular_momentum_about_gravity_drift_with_the_square_of_the_step():
    chain, drifts = hanging(2), []
    before = np.array([stored(chain, chain.x, chain.v), turning(chain, chain.x, chain.v)])
    moving = spatial_points.kinetic_energy(chain.x, chain.v, chain.body, chain.work())
    for h in (1e-3, 5e-4, 2.5e-4):
        x, v = run(chain, h, round(0.5 / h))
        assert np.abs(x - chain.x).max() > 0.1
        after = np.array([stored(chain, x, v), turning(chain, x, v)])
        drifts.append(np.abs(after - before) / [moving, abs(before[1])])
    assert (drifts[-1] < 2e-4).all(), drifts
    assert (drifts[0] / drifts[-1] > 10).all(), drifts  # 16 for the second order


def test_a_heavy_top_precesses_regularly():
    """Lagrange's top: spin and rate of precession of a steady tilt from its closed form, the axis on its cone."""
    m, c, across, along, g, tilt, turn = 0.2, 0.05, 3e-4, 2e-4, 9.81, 0.5, 4.0
    body = SpatialBody(np.array([0.0, 0.1]), np.array([m]), np.array([c]), np.array([across]), np.array([along]),
                       np.eye(3)[None], np.eye(3), 0.0, 0.0, -g, *no_tendons(1, 3))  # fmt: skip
    about = across + m * c * c
    spin = (m * g * c + about * np.cos(tilt) * turn**2) / (along * turn)  # about the axis
    axis = np.array([np.sin(tilt), 0.0, np.cos(tilt)])
    omega = spin * axis + turn * (np.array([0.0, 0.0, 1.0]) - np.cos(tilt) * axis)
    top = SpaceChain(body, free_joints(1, 3), np.array([0.0, tilt, 0.0]), np.zeros(3))
    work = top.work()
    spatial.pose_links(top.x, body, work)
    top = top._replace(v=np.linalg.solve(work.S.T, omega))
    errors = []
    for h in (5e-4, 2.5e-4):
        x, _ = run(top, h, round(1.0 / h))
        spatial.pose_links(x, body, work)
        expected = [np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)]
        errors.append(np.abs(work.R[1, :, 2] - expected).max())
    assert errors[-1] < 2e-4
    assert errors[0] / errors[1] == pytest.approx(4.0, abs=0.5)


def test_derivatives_of_a_step_by_every_kind_of_parameter(rng):
    """Complex steps through the text against differences of it: state, geometry, inertia, springs, weight, base."""
    chain = random_space_chain(rng, 2, twist=True)
    chain = chain._replace(body=chain.body._replace(spin=rng.normal(size=(2, 3))))
    given = {"x": chain.x, "v": chain.v, **chain.body._asdict(), **chain.joints._asdict()}
    left_out = ("unloaded", "base_angle", "share", "beyond", "lever", "chord", "tendon_stiffness", "pretension",
                "friction", "slip_rate", "entry_friction", "line", "tied")  # fmt: skip
    given = {name: np.asarray(value) for name, value in given.items() if name not in left_out}

    def after(z, name, direction):
        moved = {key: value.astype(complex) + (z * direction if key == name else 0) for key, value in given.items()}
        body = chain.body._replace(**{f: moved[f] for f in chain.body._fields if f not in left_out})
        joints = chain.joints._replace(**{f: moved[f] for f in ("theta0", "K", "D", "hardening")})
        x, v = moved["x"], moved["v"]
        spatial.step(x, v, 1e-3, np.zeros(6), body, joints, chain.work(complex))
        return np.concatenate([x, v])

    for name, value in given.items():
        direction = rng.normal(size=value.shape) * (np.abs(value).mean() or 1.0)
        slope = after(1e-30j, name, direction).imag / 1e-30
        difference = (after(1e-5, name, direction) - after(-1e-5, name, direction)).real / 2e-5
        assert np.abs(slope).max() > 0
        np.testing.assert_allclose(slope, difference, rtol=0, atol=1e-6 * np.abs(slope).max() + 1e-8, err_msg=name)


def test_no_kernel_makes_arrays():
    kernels = (spatial.step, spatial.acceleration, spatial_points.add_link_loads, spatial_points.kinetic_energy)
    assert not [f.__name__ for kernel in kernels for f in reached(kernel) if makes_arrays(f)]


def many(count, arguments):
    for _ in range(count):
        spatial_step(*arguments)  # noqa: F821  given below


@pytest.mark.slow
def test_no_allocation(rng):
    from numba import njit

    chain = random_space_chain(rng, 2, twist=True)
    arguments = (0.1 * chain.x, 0.1 * chain.v, 1e-5, np.zeros(6), chain.body, chain.joints, chain.work())
    compiled = rebuild(many, njit, {"spatial_step": twin(spatial.step)})
    once, often = allocations(compiled, arguments)
    assert once == often


@pytest.mark.parametrize("twist", [False, True])
def test_the_slope_of_the_weight_in_a_step(rng, twist):
    """Exact between different joints and between swing and twist; within a swing where its joint is straight."""
    chain = random_space_chain(rng, 3, twist=twist)
    x, size = chain.x.copy(), chain.x.size
    x[2:4] = 0.0

    def weight(z):
        work = chain.work(complex)
        spatial.pose_links(z, chain.body, work)
        spatial.inertial_forces(z, 0.0 * z, chain.body, work, work.f)
        return work.f

    exact, work, (A, M) = complex_step(weight, x), chain.work(), np.zeros((2, size, size))
    spatial.pose_links(x, chain.body, work)
    spatial.inertia(1.0, chain.body, work, A)
    spatial.inertia(0.0, chain.body, work, M)
    compared = np.tril(np.ones((size, size), dtype=bool))
    compared[:2, :2] = compared[4:6, 4:6] = False
    assert abs(exact[3, 2]) > 1e-4
    np.testing.assert_allclose((A - M)[compared], exact[compared], rtol=0, atol=1e-13)


def test_work_of_a_step_balances_the_energy(rng):
    """Input work less the loss of the dampers is the change of the energy, to third order in the step."""
    chain = random_space_chain(rng, 2, twist=True)
    torque, before, left = rng.normal(0, 0.05, 6), stored(chain, chain.x, chain.v), []
    for h in (1e-3, 5e-4):
        x, v, work, total = chain.x.copy(), chain.v.copy(), chain.work(), np.zeros(2)
        spatial.step(x, v, h, torque, chain.body, chain.joints, work)
        spatial_points.add_step_work(v, h, torque, chain.joints, work, total)
        left.append(abs(stored(chain, x, v) - before - total[0] + total[1]))
        assert total[1] > 0
    assert left[1] < 0.01 * total[1]
    assert left[0] / left[1] > 7.0  # 8 for the third order


def test_steps_that_cannot_be_followed():
    chain, joints = hanging(2), hanging(2).joints
    follows, fine, still = spatial_springs.follows, np.full(4, 0.5), np.zeros(4)
    assert follows(fine, still + 900.0, 1e-3, joints)
    assert not follows(fine, still + 1100.0, 1e-3, joints)
    assert not follows(fine * np.nan, still, 1e-3, joints)
    assert follows(np.array([2.7, 2.7, 0, 0]), still, 1e-3, joints)
    assert not follows(np.array([0, 0, 2.9, 2.9]), still, 1e-3, joints)  # 4.1 rad
    K = chain.joints.K
    softened = joints._replace(hardening=np.stack([-0.6 * K, 0.0 * K, 0.0 * K]))
    assert follows(np.array([0.55, 0.55, 0, 0]), still, 1e-3, softened)
    assert not follows(np.array([0.65, 0.65, 0, 0]), still, 1e-3, softened)  # 1 / 1.2 = 0.83 rad
    twisted = joints._replace(**{name: np.tile(getattr(joints, name), 2)[:6] for name in ("theta0", "K", "D")},
                              hardening=np.tile(softened.hardening, 2)[:, :6])  # fmt: skip
    assert follows(np.array([0, 0, 0, 0, 0.8, 0.8]), np.zeros(6), 1e-3, twisted)
    assert not follows(np.array([0, 0, 0, 0, 0.8, 0.9]), np.zeros(6), 1e-3, twisted)
