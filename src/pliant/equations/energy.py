"""Energies and power of a planar chain, in absolute link angles, with which tests check the energy balance."""

from __future__ import annotations

from pliant.equations.elastic import bending_energy, spring_energy


def kinetic_energy(c, s, w, body):
    """Return the kinetic energy 1/2 w^T M w [J] of a planar chain, from cosines c, sines s and rates w [rad/s] of the
    link angles.
    """
    n = len(w)
    value = 0.0 * w[0]
    for k in range(n):
        value = value + 0.5 * (body.B[k, k] + body.I[k]) * w[k] * w[k]
        for j in range(k):
            value = value + body.B[k, j] * (c[k] * c[j] + s[k] * s[j]) * w[k] * w[j]
    return value


def elastic_energy(phi, joints):
    """Return the elastic energy [J] of all joint springs and axial springs of a planar chain, 0 in the rest shape.

    `phi` holds the absolute angles (n,), and behind them the strains (S,) of segments that lengthen.
    """
    value = bending_energy(phi, joints)
    for i in range(len(joints.theta0), joints.hardening.shape[1]):
        value = value + spring_energy(i, joints, phi[i], phi[i])
    for i in range(joints.hardening.shape[1], len(phi)):
        value = value + 0.5 * joints.K[i] * phi[i] * phi[i]
    return value


def gravity_energy(c, s, body):
    """Return the gravitational energy -sum m (gx x + gy y) [J] of a planar chain, from cosines c and sines s of the
    link angles.

    It is zero where every link lies at the first joint.
    """
    value = 0.0 * c[0]
    for k in range(len(c)):
        value = value + body.h[k] * (body.gx * s[k] - body.gy * c[k])
    return value


def damping_power(w, joints):
    """Return the power [W] that the dampers of the joints and of extensible segments dissipate at the rates w.

    sum_i D_i dq_i^2
    """
    value = 0.0 * w[0]
    before = joints.spin[0]
    for i in range(len(joints.theta0)):
        dq = w[i] - before
        value = value + joints.D[i] * dq * dq
        before = w[i]
    for i in range(len(joints.theta0), len(w)):
        value = value + joints.D[i] * w[i] * w[i]
    return value


def input_power(w, torque, joints):
    """Return the mechanical power [W] which the actuation `torque` supplies to joints and extensible segments at the
    rates w.

    sum_i torque_i dq_i + sum_s torque_s de_s, which is p dV/dt by virtual work.
    """
    value = 0.0 * w[0]
    before = joints.spin[0]
    for i in range(len(joints.theta0)):
        value = value + torque[i] * (w[i] - before)
        before = w[i]
    for i in range(len(joints.theta0), len(w)):
        value = value + torque[i] * w[i]
    return value


def add_step_work(w, h, torque, joints, work, total):
    """Add the work of the actuation and the loss in the dampers over one time step to total (2,) [J], using the
    mid-step rates.

    The step is one of `motion.step`.

    `w` (n,) are the rates after the step. `work.a` still holds the change of the rates over the step.
    """
    for i in range(len(w)):
        work.c[i] = w[i] - 0.5 * work.a[i]
    total[0] = total[0] + h * input_power(work.c, torque, joints)
    total[1] = total[1] + h * damping_power(work.c, joints)
