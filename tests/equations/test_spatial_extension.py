"""Chains in space whose segments lengthen: Lagrange's equations, the chain of the plane, energies, loads, steps."""

from __future__ import annotations

import numpy as np
import pytest
from oracles import extensible
from oracles import space_lagrange as lagrange
from oracles.allocation import allocations
from oracles.derivatives import complex_step
from oracles.space import (
    SpaceChain,
    lengthening,
    no_tendons,
    random_joints,
    random_space_chain,
    rotation_about_x,
    with_tendons,
)
from test_spatial_step import many, run, stored

from pliant.compiler.choose import twin
from pliant.compiler.trace import BOUNDED
from pliant.compiler.twin import makes_arrays, reached, rebuild
from pliant.equations import extension, spatial, spatial_points, tendon
from pliant.equations.symbols import SpatialBody, SpatialJoints

BOTH = pytest.mark.parametrize("twist", [False, True])


def accelerate(chain, torque):
    a = np.zeros(len(chain.x))
    spatial.acceleration(chain.x, chain.v, torque, chain.body, chain.joints, chain.work(), a)
    return a


@BOTH
@pytest.mark.parametrize(("n", "segments"), [(1, 1), (2, 1), (2, 2)])
def test_accelerations_by_lagrange(rng, n, segments, twist):
    chain = random_space_chain(rng, n, twist=twist, springs=False)
    chain = lengthening(chain, rng, segments, springs=False)
    torque = rng.normal(0, 0.1, len(chain.x))
    expected = lagrange.acceleration(chain, chain.x, chain.v, torque)
    assert accelerate(chain, torque) == pytest.approx(expected, abs=1e-10 * np.abs(expected).max())


@BOTH
def test_inertia_and_energies_by_the_places_of_masses(rng, twist):
    chain = lengthening(random_space_chain(rng, 4, twist=twist), rng, 2)
    work, M = chain.work(), np.zeros((len(chain.x), len(chain.x)))
    spatial.pose_links(chain.x, chain.body, work)
    spatial.inertia(0.0, chain.body, work, M)
    expected = lagrange.inertia(chain, chain.x)
    np.testing.assert_allclose(M, np.tril(expected), rtol=0, atol=1e-13 * np.abs(expected).max())
    kinetic = spatial_points.kinetic_energy(chain.x, chain.v, chain.body, work)
    assert kinetic == pytest.approx(lagrange.kinetic_energy(chain, chain.x, chain.v), rel=1e-12)
    weight = spatial_points.gravity_energy(chain.x, chain.body, work)
    assert weight == pytest.approx(lagrange.gravity_energy(chain, chain.x), rel=1e-12)


def in_space(flat, x, v):
    """A planar chain that lengthens (`oracles.extensible`), and its state, in space: planar (x, y) = (Y, Z)."""
    n, S = flat.n, flat.size - flat.n
    m, c, lateral = flat.m[1:].copy(), flat.c[1:].copy(), flat.m[1:] * flat.rho[1:] ** 2
    m[-1] += flat.m_tip
    c[-1] = (flat.m[-1] * flat.c[-1] + flat.m_tip * flat.l[-1]) / m[-1]
    lateral[-1] += flat.m[-1] * (flat.c[-1] - c[-1]) ** 2 + flat.m_tip * (flat.l[-1] - c[-1]) ** 2
    size = 2 * n + S
    body = SpatialBody(
        flat.l, m, c, lateral, np.zeros(n), rotation_about_x(flat.theta0), rotation_about_x(flat.base_angle)[0],
        0.0, *flat.gravity, *no_tendons(n, size)[:-1], flat.share,
    )  # fmt: skip

    def spread(values):
        return np.append(np.repeat(values[:n], 2), values[n:])

    hardening = np.repeat(flat.joints().hardening, 2, axis=1)
    none = np.zeros(n), np.zeros((0, 3)), np.zeros((n, 0))
    joints = SpatialJoints(0.0, np.zeros(size), spread(flat.K), spread(flat.D), hardening, *none)
    y, w = np.zeros(size), np.zeros(size)
    y[: 2 * n : 2], w[: 2 * n : 2] = np.diff(x[:n], prepend=flat.base_angle) - flat.theta0, np.diff(v[:n], prepend=0.0)
    y[2 * n :], w[2 * n :] = x[n:], v[n:]
    return SpaceChain(body, joints, y, w)


@pytest.fixture(params=[(1, 1), (3, 2), (5, 3)], ids=str)
def plane(rng, request):
    """A planar chain, bent to the side that its springs count, with its state and a drive."""
    n, S = request.param
    flat = extensible.random_extensible(rng, n, S)
    x, v = extensible.random_state(rng, flat)
    x[:n] = flat.base_angle + np.cumsum(flat.theta0 + rng.uniform(0.3, 0.9, n))
    return flat, x, v, rng.normal(0, 0.05, n + S)


def test_accelerations_of_the_plane(plane):
    flat, x, v, drive = plane
    n, chain, expected = flat.n, in_space(flat, x, v), np.zeros(flat.size)
    work = extensible.workspace(n, flat.size - n)
    extension.acceleration(x, v, drive, flat.body(), flat.joints(), work, expected)
    torque = np.zeros(len(chain.x))
    torque[: 2 * n : 2], torque[2 * n :] = drive[:n], drive[n:]
    found = accelerate(chain, torque)
    np.testing.assert_allclose(np.cumsum(found[: 2 * n : 2]), expected[:n], rtol=0, atol=1e-10 * np.abs(expected).max())
    np.testing.assert_allclose(found[2 * n :], expected[n:], rtol=0, atol=1e-10 * np.abs(expected).max())
    assert not found[1 : 2 * n : 2].any()


def test_steps_of_the_plane(plane):
    """Ten steps: springs, dampers and gravity's slope are implicit in both."""
    flat, x, v, drive = plane
    n, chain = flat.n, in_space(flat, x, v)
    torque, work, flat_work = np.zeros(len(chain.x)), chain.work(), extensible.workspace(n, flat.size - n)
    torque[: 2 * n : 2], torque[2 * n :] = drive[:n], drive[n:]
    for _ in range(10):
        extension.step(x, v, 2e-4, drive, flat.body(), flat.joints(), flat_work)
        spatial.step(chain.x, chain.v, 2e-4, torque, chain.body, chain.joints, work)
    assert (chain.x[: 2 * n : 2] > 0).all()  # the law of the plane counts the side
    bend = np.cumsum(chain.x[: 2 * n : 2] + flat.theta0) + flat.base_angle
    np.testing.assert_allclose(np.append(bend, chain.x[2 * n :]), x, rtol=0, atol=1e-11)
    rate = np.append(np.cumsum(chain.v[: 2 * n : 2]), chain.v[2 * n :])
    np.testing.assert_allclose(rate, v, rtol=0, atol=1e-10 * np.abs(v).max())


@BOTH
def test_points_and_the_forces_at_them(rng, twist):
    """Jacobians by complex steps; forces at points of all links, the part before the first joint too, by their work."""
    chain = lengthening(random_space_chain(rng, 3, twist=twist), rng, 2)
    size, work, force = len(chain.x), chain.work(), rng.normal(size=(4, 3))
    aside, across, along = point = 0.01, -0.02, 0.03
    expected, load = np.zeros(size), np.zeros((4, 3, 5))
    spatial.pose_links(chain.x, chain.body, work)

    def position(z, link):
        scratch, p = chain.work(complex), np.zeros(3, complex)
        spatial.pose_links(z, chain.body, scratch)
        spatial_points.point_position(link, *point, scratch, p)
        return p

    for link in range(-1, 3):
        p, J = np.zeros(3), np.zeros((3, size))
        spatial_points.point_position(link, *point, work, p)
        spatial_points.point_slope(link, along, p, chain.body, work, J)
        slope = complex_step(lambda z, link=link: position(z, link), chain.x)
        np.testing.assert_allclose(J, slope, rtol=0, atol=1e-14)
        expected += slope.T @ force[link + 1]
        load[link + 1, :, :4] = np.outer(force[link + 1], (aside, -across, along, 1.0))
    work.tau[:] = 0.0
    spatial_points.add_link_loads(chain.x, chain.v, 0.0, load, chain.body, chain.joints, work)
    assert work.tau == pytest.approx(expected, abs=1e-13)


@BOTH
def test_the_slope_of_the_weight_in_a_step(rng, twist):
    """Exact in all rows of the strains."""
    chain = lengthening(random_space_chain(rng, 3, twist=twist), rng, 2)

    def weight(z):
        work = chain.work(complex)
        spatial.pose_links(z, chain.body, work)
        spatial.inertial_forces(z, 0.0 * z, chain.body, work, work.f)
        return work.f

    exact, work, (A, M) = complex_step(weight, chain.x), chain.work(), np.zeros((2, len(chain.x), len(chain.x)))
    spatial.pose_links(chain.x, chain.body, work)
    spatial.inertia(1.0, chain.body, work, A)
    spatial.inertia(0.0, chain.body, work, M)
    assert np.abs(exact[-2:]).max() > 1e-3
    np.testing.assert_allclose((A - M)[-2:], np.tril(exact)[-2:], rtol=0, atol=1e-13)


def test_work_of_a_step_balances_the_energy(rng):
    """Input work less the loss of the dampers is the change of the energy, to third order in the step."""
    chain = lengthening(random_space_chain(rng, 2, twist=True), rng, 2)
    torque, before, left = rng.normal(0, 0.05, 8), stored(chain, chain.x, chain.v), []
    for h in (1e-5, 5e-6):
        x, v, work, total = chain.x.copy(), chain.v.copy(), chain.work(), np.zeros(2)
        spatial.step(x, v, h, torque, chain.body, chain.joints, work)
        spatial_points.add_step_work(v, h, torque, chain.joints, work, total)
        left.append(abs(stored(chain, x, v) - before - total[0] + total[1]))
    assert left[1] < 0.01 * total[1]
    assert left[0] / left[1] > 7.0  # 8 for the third order


@pytest.mark.slow  # compiles the step
def test_energy_of_a_long_motion_drifts_with_the_square_of_the_step(rng):
    """Ten thousand steps without dampers, bent and stretched far, springs of all terms."""
    chain = lengthening(random_space_chain(rng, 2), rng, 1)
    chain = chain._replace(v=0.3 * chain.v, joints=chain.joints._replace(D=0.0 * chain.joints.D))
    before, drifts = stored(chain, chain.x, chain.v), []
    for h in (1e-4, 5e-5):
        energies = [stored(chain, *run(chain, h, round(t / h))) for t in (0.1, 0.2, 0.5)]
        drifts.append(np.abs(np.array(energies) - before).max() / abs(before))
    assert drifts[1] < 1e-4, drifts
    assert drifts[0] / drifts[1] > 3.0, drifts  # 4 for the second order


def test_derivatives_of_a_step_by_every_kind_of_parameter(rng):
    """Complex steps through the text against differences of it, tendons that shorten with their segments among them."""
    chain = lengthening(with_tendons(random_space_chain(rng, 2, twist=True), rng, friction=0.2), rng, 2)
    chain = chain._replace(body=chain.body._replace(spin=rng.normal(size=(2, 3))))
    given = {"x": chain.x, "v": chain.v, **chain.body._asdict(), **chain.joints._asdict()}
    left_out = ("unloaded", "base_angle", "line", "tied")
    given = {name: np.asarray(value) for name, value in given.items() if name not in left_out}

    def after(z, name, direction):
        moved = {key: value.astype(complex) + (z * direction if key == name else 0) for key, value in given.items()}
        body = type(chain.body)(*(moved[f] for f in chain.body._fields))
        joints = chain.joints._replace(**{f: moved[f] for f in ("theta0", "K", "D", "hardening")})
        x, v, torque = moved["x"], moved["v"], np.append(np.zeros(8), [60.0, 60.0, 1.0])
        tendon.step(x, v, 1e-3, torque, body, joints, chain.work(complex))
        return np.concatenate([x, v])

    for name, value in given.items():
        direction = rng.normal(size=value.shape) * (np.abs(value).mean() or 1.0)
        slope = after(1e-30j, name, direction).imag / 1e-30
        difference = (after(1e-5, name, direction) - after(-1e-5, name, direction)).real / 2e-5
        assert np.abs(slope).max() > 0, name
        np.testing.assert_allclose(slope, difference, rtol=0, atol=1e-6 * np.abs(slope).max() + 2e-7, err_msg=name)


@pytest.mark.slow  # compiles the step
def test_compiled_is_what_is_written_and_makes_no_arrays(rng):
    from numba import njit

    chain = lengthening(random_space_chain(rng, 2), rng, 2)
    results = []
    for step in (spatial.step, twin(spatial.step), twin(spatial.step, 2, 2, 2, 0, BOUNDED)):
        x, v = chain.x.copy(), chain.v.copy()
        step(x, v, 1e-3, np.full(6, 0.01), chain.body, chain.joints, chain.work())
        results.append(np.concatenate([x, v]))
    np.testing.assert_allclose(results[1:], [results[0]] * 2, rtol=1e-12)
    assert not [f.__name__ for f in reached(spatial.step) if makes_arrays(f)]
    still = chain._replace(x=0.1 * chain.x, v=0.1 * chain.v)
    arguments = (still.x, still.v, 1e-5, np.zeros(6), chain.body, chain.joints, chain.work())
    compiled = rebuild(many, njit, {"spatial_step": twin(spatial.step)})
    once, often = allocations(compiled, arguments)
    assert once == often


def test_joints_of_unequal_directions_keep_their_order(rng):
    """The step is second order with strains: against steps of an eighth."""
    chain = lengthening(random_space_chain(rng, 1, twist=True), rng, 1)
    joints = random_joints(rng, 1, 3, isotropic=False)
    wide = {f: np.append(getattr(joints, f), getattr(chain.joints, f)[3:]) for f in ("K", "D")}
    chain = chain._replace(joints=chain.joints._replace(**wide))

    def end(steps):
        x, v, work = chain.x.copy(), 0.3 * chain.v, chain.work()
        for _ in range(steps):
            spatial.step(x, v, 0.01 / steps, np.zeros(4), chain.body, chain.joints, work)
        return x

    fine = end(320)
    errors = [np.abs(end(n) - fine).max() for n in (20, 40)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.15)
