"""Lagrange's equations of a two-link chain by SymPy, from the positions of its masses alone; and how to run a
kernel on the same symbols."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import sympy as sp

from pliant.compiler.twin import rebuild

N = 2
q, dq, ddq = sp.symbols("q:2"), sp.symbols("dq:2"), sp.symbols("ddq:2")
l, c, m, I, K, D, theta0 = (sp.symbols(f"{name}:2", positive=True) for name in ["l", "c", "m", "I", "K", "D", "theta"])
m_tip, gx, gy, base, torque = sp.symbols("m_tip gx gy base torque")


class Numbers:
    """What kernels ask of NumPy, on symbols: scalar functions, and arrays that can hold an expression."""

    pi = sp.pi
    cos, sin, sqrt = sp.cos, sp.sin, sp.sqrt

    @staticmethod
    def zeros(shape, dtype=None):
        return zeros(shape)


def zeros(shape):
    array = np.empty(shape, object)
    array.fill(sp.S.Zero)
    return array


def on_symbols(kernel: Any) -> Any:
    """The kernel's own text, with SymPy where it says np."""
    return rebuild(kernel, lambda f: f, {"np": Numbers})


def vector(symbols):
    return np.array(symbols, object)


def workspace():
    rows = {name: zeros(2) for name in ("c", "s", "r", "a", "tau")}
    return SimpleNamespace(A=zeros((2, 2)), S=zeros((2, 2)), t=zeros(3), **rows)


@cache
def lagrangian():
    """Inertia matrix M, the rest b (Coriolis and gravity), total energy: M ddq + b = tau - K q - D dq."""
    angle, joint, kinetic, potential = base, sp.Matrix([0, 0]), sp.S.Zero, sp.S.Zero
    g = sp.Matrix([gx, gy])
    state, rates = sp.Matrix(q), sp.Matrix(dq)
    for i in range(N):
        angle = angle + q[i] + theta0[i]
        along = sp.Matrix([-sp.sin(angle), sp.cos(angle)])
        masses = [(m[i], joint + c[i] * along)]
        joint = joint + l[i] * along
        if i == N - 1:
            masses.append((m_tip, joint))
        for mass, point in masses:
            velocity = point.jacobian(state) * rates
            kinetic += mass * velocity.dot(velocity) / 2
            potential -= mass * g.dot(point)
        kinetic += I[i] * sum(dq[: i + 1]) ** 2 / 2
    momentum = sp.Matrix([kinetic]).jacobian(rates).T
    M = momentum.jacobian(rates)
    b = momentum.jacobian(state) * rates - sp.Matrix([kinetic - potential]).jacobian(state).T
    return M, b, kinetic, potential
