"""A body that lengthens: its kernels against Lagrange's equations, complex steps, power balance, the plain chain."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import sympy as sp
from oracles.chains import random_chain
from oracles.chains import workspace as plain_workspace
from oracles.derivatives import complex_step
from oracles.extensible import Extensible, random_extensible, random_state, workspace
from oracles.lagrange import on_symbols

from pliant.equations import elastic, extension, motion
from pliant.equations.energy import damping_power, elastic_energy, input_power
from pliant.equations.symbols import ExtensibleBody, ExtensibleJoints
from pliant.mechanics.planar import pull_of

SIZES = [(1, 1), (3, 1), (5, 2), (6, 3)]


@pytest.fixture(params=SIZES, ids=str)
def case(request, rng):
    chain = random_extensible(rng, *request.param)
    return chain, *random_state(rng, chain)


def mass_matrix(chain, x):
    size, kind = chain.size, np.asarray(x).dtype
    work, M = workspace(chain.n, size - chain.n, kind), np.zeros((size, size), kind)
    extension.place(x, 0 * x, 0.0, chain.body(), chain.joints(), work)
    extension.inertia(chain.body(), work, M)
    return M + np.tril(M, -1).T


def forces(chain, x, v):
    """Centrifugal, Coriolis and gravity forces (n + S,)."""
    work = workspace(chain.n, chain.size - chain.n, np.asarray(x).dtype)
    f = np.zeros_like(work.a)
    extension.place(x, v, 0.0, chain.body(), chain.joints(), work)
    extension.inertial_forces(v, chain.body(), chain.joints(), work, f)
    return f


def potential(chain, x):
    return -sum(m * (chain.gravity[0] * px + chain.gravity[1] * py) for m, px, py in chain.masses(x))


@pytest.mark.slow
def test_lagrange_two_links_one_segment():
    """n = 2, S = 1 on symbols: M and all forces from the places of the masses alone, exactly."""
    n, size = 2, 3
    x, v = (sp.symbols(f"{name}:{size}") for name in "xv")
    names = [sp.symbols(f"{name}:{n + 1}", positive=True) for name in ("l", "m", "c", "rho", "a")]
    l, m, c, rho, a = (np.array(row, object) for row in names)
    m[0] = sp.S.Zero
    m_tip, gx, gy, base = sp.symbols("m_tip gx gy base")
    zeros = np.array([sp.S.Zero] * size, object)
    chain = Extensible(l, m, c, rho, a[:, None], m_tip, np.array([gx, gy], object), base, zeros[:n], zeros, zeros,
                       zeros[:n])  # fmt: skip
    places = chain.masses([*x], sp.cos, sp.sin)
    kinetic = sum(
        mass * sum((sp.Matrix([p]).jacobian(sp.Matrix(x)) * sp.Matrix(v))[0] ** 2 for p in point) / 2
        for mass, *point in places
    )
    weight = -sum(mass * (gx * px + gy * py) for mass, px, py in places)
    momentum = sp.Matrix([kinetic]).jacobian(sp.Matrix(v)).T
    M = momentum.jacobian(sp.Matrix(v))
    rest = momentum.jacobian(sp.Matrix(x)) * sp.Matrix(v) - sp.Matrix([kinetic - weight]).jacobian(sp.Matrix(x)).T
    work = workspace(n, 1, object)
    found, f = np.zeros((size, size), object), np.zeros(size, object)
    there, rates = np.array(x, object), np.array(v, object)
    on_symbols(extension.place)(there, rates, 0, chain.body(), chain.joints(), work)
    on_symbols(extension.inertia)(chain.body(), work, found)
    on_symbols(extension.inertial_forces)(rates, chain.body(), chain.joints(), work, f)
    assert all(zero(found[i, j] - M[i, j]) for i in range(size) for j in range(i + 1))
    assert all(zero(f[i] - rest[i]) for i in range(size))
    on_symbols(extension.place)(there, rates, 0, chain.body(), chain.joints(), work)
    energy = on_symbols(extension.kinetic_energy)(there, rates, chain.body(), chain.joints(), work)
    assert zero(energy - kinetic)


def zero(expression):
    """Exact: in exponentials of the angles every expression here is a Laurent polynomial, which `expand` decides."""
    return sp.expand(sp.nsimplify(sp.sympify(expression)).rewrite(sp.exp)) == 0


def test_mass_matrix_is_that_of_the_positions(case):
    """T from complex-step velocities of the masses; M symmetric and positive."""
    chain, x, v = case
    J = complex_step(lambda at: np.array([p for _, *point in chain.masses(at) for p in point]), x)
    m = np.repeat([mass for mass, *_ in chain.masses(x)], 2)
    M = mass_matrix(chain, x)
    np.testing.assert_allclose(M, J.T @ (m[:, None] * J), rtol=1e-11, atol=1e-16)
    assert np.linalg.eigvalsh(M).min() > 0
    work = workspace(chain.n, chain.size - chain.n)
    energy = extension.kinetic_energy(x, v, chain.body(), chain.joints(), work)
    assert energy == pytest.approx(0.5 * v @ M @ v, rel=1e-12)
    assert extension.gravity_energy(x, v, chain.body(), chain.joints(), work) == pytest.approx(potential(chain, x))


def test_rates_of_the_mass_matrix_do_no_work_of_their_own(case):
    """Forces are Mdot v - dT/dx + dV/dx; so v . (Mdot v / 2 - forces without weight) = 0: Mdot - 2 C is skew."""
    chain, x, v = case
    dM = complex_step(lambda at: mass_matrix(chain, at), x)  # (N, N, N), the variable last
    dV = complex_step(lambda at: np.array([potential(chain, at)]), x)[0]
    expected = (dM @ v) @ v - 0.5 * np.einsum("i,ijk,j->k", v, dM, v) + dV
    found = forces(chain, x, v)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-11 * np.abs(expected).max())
    power = 0.5 * v @ (dM @ v) @ v - v @ (found - dV)
    assert abs(power) < 1e-11 * np.abs(v @ found)


@pytest.mark.parametrize("curved", [False, True])
def test_power_balance_of_the_whole_equation(case, rng, curved):
    """What the drive gives is what energies take up and dampers lose, at any instant."""
    chain, x, v = case
    body, joints = chain.body(), chain.joints(axial(rng, chain) if curved else None)
    work = workspace(chain.n, chain.size - chain.n)
    drive, a = rng.normal(size=chain.size), np.zeros(chain.size)
    extension.acceleration(x, v, drive, body, joints, work, a)
    M = mass_matrix(chain, x)
    dM = complex_step(lambda at: mass_matrix(chain, at), x) @ v
    by_x = complex_step(lambda at: np.array([elastic_energy(at, joints) + potential(chain, at)]), x)[0]
    taken = v @ M @ a + 0.5 * v @ dM @ v + by_x @ v
    assert taken == pytest.approx(input_power(v, drive, joints) - damping_power(v, joints), rel=1e-9)


def axial(rng, chain):
    """Coefficients (3, S) of axial springs that soften within a bound and stiffen again."""
    S = chain.size - chain.n
    return np.stack([-rng.uniform(0.5, 1.5, S), rng.uniform(0.2, 1.0, S), rng.uniform(5.0, 20.0, S)])


def test_an_axial_spring_is_that_of_a_joint(rng):
    """Force, slope and energy of a segment by its strain are those of a joint by its angle, one law for both."""
    chain = random_extensible(rng, 1, 1)
    curve = axial(rng, chain)
    joint = chain.joints()._replace(K=chain.K[1:], hardening=curve, unloaded=np.zeros(1), theta0=np.zeros(1))
    joints, drive = chain.joints(curve, [0.02]), np.zeros(2)
    for e in (-0.4, 0.0, 0.3):
        f = np.zeros(2)
        extension.axial_forces(np.array([0.0, e]), np.zeros(2), joints, drive, 0.0, f)
        assert f[1] == pytest.approx(-elastic.spring_torque(0, joint, e - 0.02, e), rel=1e-14)
        bent, straight = (elastic_energy(np.array([0.0, at]), chain.joints(curve)) for at in (e, 0.0))
        assert bent - straight == pytest.approx(elastic.spring_energy(0, joint, e, e), rel=1e-12)


def test_stiff_segments_are_the_plain_chain(rng):
    """EA -> infinity is the chain of `motion`: accelerations of the angles agree, and a step too."""
    plain = random_chain(rng, 4)
    plain = plain._replace(c=0.5 * plain.l, I=plain.m * plain.l**2 / 12)
    B, h = np.zeros((5, 5)), np.zeros(5)
    own = plain.body()
    B[1:, 1:], h[1:] = own.B + np.diag(own.I), own.h
    body = ExtensibleBody(B, np.append(0.0, plain.l), h, np.ones((5, 1)), own.gx, own.gy)
    joints = plain.joints()
    stiff = joints._replace(K=np.append(joints.K, 1e14), D=np.append(joints.D, 0.0))
    stiff = ExtensibleJoints(*stiff[:6], np.zeros(0))
    phi, w = np.cumsum(rng.uniform(-0.5, 0.5, 4)), rng.normal(size=4)
    drive, a, b = rng.normal(size=4), np.zeros(4), np.zeros(5)
    motion.acceleration(phi, w, drive, own, joints, plain_workspace(4), a)
    strained = forces_at_rest(body, stiff, phi, w, a)
    x = np.append(phi, strained / 1e14)  # the strain that carries what the motion asks: then it stays
    extension.acceleration(x, np.append(w, 0.0), np.append(drive, 0.0), body, stiff, workspace(4, 1), b)
    np.testing.assert_allclose(b[:4], a, rtol=1e-7)
    one, two = (np.append(phi, 0.0), np.append(w, 0.0)), (phi.copy(), w.copy())
    extension.step(*one, 1e-3, np.append(drive, 0.0), body, stiff, workspace(4, 1))
    motion.step(*two, 1e-3, drive, own, joints, plain_workspace(4))
    np.testing.assert_allclose(one[0][:4], two[0], rtol=1e-9)
    np.testing.assert_allclose(one[1][:4], two[1], rtol=1e-9)


def forces_at_rest(body, joints, phi, w, a):
    """The axial force times length that keeps the strain still while the links accelerate by a."""
    work, M, f = workspace(4, 1), np.zeros((5, 5)), np.zeros(5)
    x, v = np.append(phi, 0.0), np.append(w, 0.0)
    extension.place(x, v, 0.0, body, joints, work)
    extension.inertia(body, work, M)
    extension.inertial_forces(v, body, joints, work, f)
    return -(M[4, :4] @ a + f[4])


def test_loads_of_links_are_the_virtual_work_of_point_forces(case, rng):
    """Slopes, by complex steps, of the way of points that sit along and across stretching links times their forces."""
    chain, x, v = case
    n, S, load = chain.n, chain.size - chain.n, np.zeros((chain.n + 1, 4))
    held = [(k, rng.uniform(0.0, 0.03), rng.normal(0, 0.01), rng.normal(size=2)) for k in range(1, n + 1)]
    for link, along, across, f in held:
        load[:link, :2] += np.outer(chain.l[:link], f)
        load[link] += [*along * f, across * f[1], -across * f[0]]

    def work(at):
        angle, stretch = np.append(chain.base_angle, at[:n]), 1.0 + chain.share @ at[n:]
        ahead, left = np.stack([-np.sin(angle), np.cos(angle)], 1), np.stack([-np.cos(angle), -np.sin(angle)], 1)
        joint = np.cumsum((chain.l * stretch)[:, None] * ahead, axis=0)
        ways = [joint[k - 1] + along * stretch[k] * ahead[k] + across * left[k] for k, along, across, _ in held]
        return np.array([sum(f @ way for (*_, f), way in zip(held, ways, strict=True))])

    Q = complex_step(work, x)[0]
    before = rng.normal(size=chain.size + 1)
    t = before.copy()
    extension.add_link_loads(x - 0.01 * v, v, 0.01, load, chain.body(), chain.joints(), SimpleNamespace(tau=t))
    np.testing.assert_allclose((t - before)[:n], np.cumsum(Q[:n][::-1])[::-1], atol=1e-14)
    np.testing.assert_allclose((t - before)[n : n + S], Q[n:], atol=1e-14)
    np.testing.assert_allclose(pull_of(x, load, chain.share, chain.base_angle), Q, atol=1e-14)


@pytest.mark.parametrize("curved", [False, True])
def test_a_step_is_second_order(rng, curved):
    chain = random_extensible(rng, 3, 2)
    joints = chain.joints(axial(rng, chain), [0.03, -0.05]) if curved else chain.joints()
    start, drive = random_state(rng, chain), rng.normal(size=5)
    start = start[0], 0.1 * start[1]

    def end(steps):
        x, v = (row.copy() for row in start)
        work = workspace(3, 2)
        for _ in range(steps):
            extension.step(x, v, 0.02 / steps, drive, chain.body(), joints, work)
        return np.append(x, v)

    fine = end(1600)
    errors = [np.abs(end(n) - fine).max() for n in (50, 100, 200)]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert (np.abs(orders - 2.0) < 0.1).all(), orders


def test_one_sweep_each_way_is_the_matrix(rng):
    chain = random_extensible(rng, 5, 1)
    work = workspace(5, 1)
    work.ax[:], work.ay[:] = rng.normal(size=(2, 6))
    extension.carried(chain.body(), work)
    np.testing.assert_allclose(work.bx, chain.body().B @ work.ax, rtol=1e-12)
    np.testing.assert_allclose(work.by, chain.body().B @ work.ay, rtol=1e-12)
