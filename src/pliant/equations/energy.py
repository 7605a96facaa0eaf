"""Energies and power of the planar chain, in absolute angles; tests check their balance."""

from __future__ import annotations

from pliant.equations.elastic import bending_energy, spring_energy


def kinetic_energy(c, s, w, body):
    """Return the kinetic energy 1/2 w^T M w [J], from c = cos(phi), s = sin(phi) and w = dphi/dt [rad/s]."""
    n = len(w)
    value = 0.0 * w[0]
    for k in range(n):
        value = value + 0.5 * (body.B[k, k] + body.I[k]) * w[k] * w[k]
        for j in range(k):
            value = value + body.B[k, j] * (c[k] * c[j] + s[k] * s[j]) * w[k] * w[j]
    return value


def elastic_energy(phi, joints):
    """Return the energy [J] of all springs, 0 in the rest shape.

    `phi` holds the absolute angles (n,), and behind them the strains (S,) of segments that lengthen.
    """
    value = bending_energy(phi, joints)
    for i in range(len(joints.theta0), joints.hardening.shape[1]):
        value = value + spring_energy(i, joints, phi[i], phi[i])
    for i in range(joints.hardening.shape[1], len(phi)):
        value = value + 0.5 * joints.K[i] * phi[i] * phi[i]
    return value


def gravity_energy(c, s, body):
    """Return the potential energy -sum m (gx x + gy y) [J], from c = cos(phi) and s = sin(phi).

    It is zero where every link lies at the first joint.
    """
    value = 0.0 * c[0]
    for k in range(len(c)):
        value = value + body.h[k] * (body.gx * s[k] - body.gy * c[k])
    return value


def damping_power(w, joints):
    """Return the power [W] dissipated by the dampers, sum_i D_i dq_i^2, of joints and of segments that lengthen."""
    value = 0.0 * w[0]
    before = 0.0 * w[0]
    for i in range(len(joints.theta0)):
        dq = w[i] - before
        value = value + joints.D[i] * dq * dq
        before = w[i]
    for i in range(len(joints.theta0), len(w)):
        value = value + joints.D[i] * w[i] * w[i]
    return value


def input_power(w, torque, joints):
    """Return the power [W] of the actuation, sum_i torque_i dq_i + sum_s torque_s de_s (p dV/dt by virtual work)."""
    value = 0.0 * w[0]
    before = 0.0 * w[0]
    for i in range(len(joints.theta0)):
        value = value + torque[i] * (w[i] - before)
        before = w[i]
    for i in range(len(joints.theta0), len(w)):
        value = value + torque[i] * w[i]
    return value


def add_step_work(w, h, torque, joints, work, total):
    """Add the input work and the damper loss of one `motion.step` to total (2,) [J], both at the rates in mid-step.

    `w` (n,) are the rates after the step. `work.a` still holds the change of the rates over the step.
    """
    for i in range(len(w)):
        work.c[i] = w[i] - 0.5 * work.a[i]
    total[0] = total[0] + h * input_power(work.c, torque, joints)
    total[1] = total[1] + h * damping_power(work.c, joints)
