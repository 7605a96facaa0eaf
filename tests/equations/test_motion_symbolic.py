"""The kernels' own text on SymPy symbols, n = 2, against Lagrange's equations derived from positions alone."""

from __future__ import annotations

import pytest
import sympy as sp
from oracles import lagrange as sym

from pliant.equations.chain import absolute_angles, body_hessian, body_jacobian, forward
from pliant.equations.elastic import gravity_absolute
from pliant.equations.energy import gravity_energy, kinetic_energy
from pliant.equations.inertia import (
    body_constants,
    coriolis_absolute,
    coriolis_from_hessian,
    inertia_absolute,
    inertia_from_jacobians,
    to_joint_angles,
)
from pliant.equations.motion import acceleration
from pliant.equations.symbols import Body, Joints

Q, DQ = sym.vector(sym.q), sym.vector(sym.dq)
L, C, M, I, THETA0 = (sym.vector(getattr(sym, name)) for name in ("l", "c", "m", "I", "theta0"))


def zero(expression):
    """Exact: in exponentials of the angles every expression here is a Laurent polynomial, which `expand` decides."""
    return sp.expand(sp.sympify(expression).rewrite(sp.exp)) == 0


@pytest.fixture(scope="module")
def absolute():
    phi, B, h = sym.zeros(2), sym.zeros((2, 2)), sym.zeros(2)
    sym.on_symbols(absolute_angles)(Q, THETA0, sym.base, phi)
    sym.on_symbols(body_constants)(L, M, C, sym.m_tip, B, h)
    cosines, sines = sym.vector([sp.cos(a) for a in phi]), sym.vector([sp.sin(a) for a in phi])
    w = sym.vector([sym.dq[0], sym.dq[0] + sym.dq[1]])
    return phi, w, cosines, sines, Body(B, I, h, sym.gx, sym.gy)


@pytest.fixture(scope="module")
def jacobians():
    out = [sym.zeros((2, 2, 2)), sym.zeros((2, 2, 2)), sym.zeros((2, 2, 2, 2)), sym.zeros((2, 2, 2, 2))]
    for kernel, (at_mass, at_tip) in ((body_jacobian, out[:2]), (body_hessian, out[2:])):
        sym.on_symbols(kernel)(Q, THETA0, L, C, at_mass)
        sym.on_symbols(kernel)(Q, THETA0, L, L, at_tip)
    return out


def joint(X):
    Y = sym.zeros((2, 2))
    sym.on_symbols(to_joint_angles)(X, Y)
    return sp.Matrix(Y)


def test_inertia_in_absolute_angles(absolute):
    _, _, c, s, body = absolute
    X = sym.zeros((2, 2))
    sym.on_symbols(inertia_absolute)(c, s, body.B, body.I, X)
    assert all(zero(x) for x in joint(X) - sym.lagrangian()[0])


def test_inertia_from_jacobians(jacobians):
    J, J_tip, _, _ = jacobians
    X = sym.zeros((2, 2))
    sym.on_symbols(inertia_from_jacobians)(J, M, I, J_tip[1], sym.m_tip, X)
    assert all(zero(x) for x in sp.Matrix(X) - sym.lagrangian()[0])


@pytest.mark.parametrize("route", ["absolute", "recursive"])
def test_coriolis_and_gravity(absolute, jacobians, route):
    _, w, c, s, body = absolute
    X, g = sym.zeros((2, 2)), sym.zeros(2)
    if route == "absolute":
        sym.on_symbols(coriolis_absolute)(c, s, body.B, w, X)
        X = joint(X)
    else:
        J, J_tip, H, H_tip = jacobians
        sym.on_symbols(coriolis_from_hessian)(J, H, M, J_tip[1], H_tip[1], sym.m_tip, DQ, X)
    sym.on_symbols(gravity_absolute)(c, s, body, g)
    gravity = sp.Matrix([g[0] + g[1], g[1]])
    found = sp.Matrix(X) * sp.Matrix(DQ) + gravity
    assert all(zero(x) for x in found - sym.lagrangian()[1])


def test_energies(absolute):
    _, w, c, s, body = absolute
    assert zero(sym.on_symbols(kinetic_energy)(c, s, w, body) - sym.lagrangian()[2])
    assert zero(sym.on_symbols(gravity_energy)(c, s, body) - sym.lagrangian()[3])


def test_forward_kinematics():
    out = [sym.zeros(shape) for shape in ((2, 2, 2), (2, 2), (2, 2, 2), (2, 2))]
    sym.on_symbols(forward)(Q, THETA0, L, *out)
    along = [sp.Matrix([-sp.sin(a), sp.cos(a)]) for a in (Q[0] + THETA0[0], sum(Q) + sum(THETA0))]
    assert all(zero(x) for x in sp.Matrix(out[3][1]) - L[0] * along[0] - L[1] * along[1])


@pytest.mark.slow
def test_whole_equation_of_motion(absolute, rng):
    """The accelerations, LDL^T and all, put back into Lagrange's equations; exact numbers keep it quick."""
    phi, w, _, _, body = absolute
    K, D = sym.vector(sym.K), sym.vector(sym.D)
    joints = Joints(sym.base, THETA0, K, D, sym.zeros((3, 2)), THETA0)
    drive = sym.vector([sym.torque, sp.Rational(3, 4) * sym.torque])
    a = sym.zeros(2)
    sym.on_symbols(acceleration)(phi, w, drive, body, joints, sym.workspace(), a)
    inertia, rest, _, _ = sym.lagrangian()
    ddq = sp.Matrix([a[0], a[1] - a[0]])
    torques = sp.Matrix([drive[i] - sym.K[i] * Q[i] - sym.D[i] * DQ[i] for i in range(2)])
    residual = inertia * ddq + rest - torques
    numbers = {x: sp.Rational(int(rng.integers(1, 100)), 64) for x in sorted(residual.free_symbols, key=str)}
    assert len(numbers) == 23  # every parameter takes part
    scale = max(abs(sp.N(t, 40, subs=numbers)) for t in torques)
    assert max(abs(sp.N(r, 40, subs=numbers)) for r in residual) < 1e-30 * scale
