"""Energies and power of the chain: what the tests balance and what a trajectory reports. All in absolute angles."""

from __future__ import annotations

from pliant.equations.elastic import bending_energy, spring_energy


def kinetic_energy(c, s, w, body):
    """1/2 w^T M w, J, given c = cos(phi), s = sin(phi) and w = dphi/dt."""
    n = len(w)
    value = 0.0 * w[0]
    for k in range(n):
        value = value + 0.5 * (body.B[k, k] + body.I[k]) * w[k] * w[k]
        for j in range(k):
            value = value + body.B[k, j] * (c[k] * c[j] + s[k] * s[j]) * w[k] * w[j]
    return value


def elastic_energy(phi, joints):
    """Energy of the springs, J, 0 in the rest shape; those of the strains (n..n+S) of `phi` count too."""
    value = bending_energy(phi, joints)
    for i in range(len(joints.theta0), joints.hardening.shape[1]):
        value = value + spring_energy(i, joints, phi[i], phi[i])
    for i in range(joints.hardening.shape[1], len(phi)):
        value = value + 0.5 * joints.K[i] * phi[i] * phi[i]
    return value


def gravity_energy(c, s, body):
    """-sum m (gx x + gy y), J, zero where every link lies at the first joint; c = cos(phi), s = sin(phi)."""
    value = 0.0 * c[0]
    for k in range(len(c)):
        value = value + body.h[k] * (body.gx * s[k] - body.gy * c[k])
    return value


def damping_power(w, joints):
    """sum_i D_i dq_i^2, W, what the dampers take; those of the extensions stand behind those of the joints."""
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
    """sum_i torque_i dq_i + sum_s torque_s de_s, W, what the pressure gives: p dV/dt by virtual work."""
    value = 0.0 * w[0]
    before = 0.0 * w[0]
    for i in range(len(joints.theta0)):
        value = value + torque[i] * (w[i] - before)
        before = w[i]
    for i in range(len(joints.theta0), len(w)):
        value = value + torque[i] * w[i]
    return value


def add_step_work(w, h, torque, joints, work, total):
    """Add what a step of `motion.step` took to total (2,) [J]: input work, and loss of the dampers, by the middle rate.

    w: rates (n,) after the step, which leaves its turns over half the time in work.a.
    """
    for i in range(len(w)):
        work.c[i] = w[i] - 0.5 * work.a[i]
    total[0] = total[0] + h * input_power(work.c, torque, joints)
    total[1] = total[1] + h * damping_power(work.c, joints)
