"""A body without tendons: a step is two solutions with the same factors. `tendons` has functions of the same names."""

from __future__ import annotations

import jax.numpy as jnp

from pliant.exporters.jax_source.numerics import solver
from pliant.exporters.jax_source.plane import from_joint_matrix, from_joints, inertial_forces


def changed(c, begun, K, net):
    """Return the change of the rates (N,) over a step with stiffness K and net torques of the joints, and True."""
    solve, push = solver(begun.A + from_joint_matrix(c, K)), from_joints(c, net)
    change = solve(begun.h * (push - begun.first))
    change = solve(begun.h * (push - inertial_forces(c, begun.posed, begun.v + 0.5 * change)))
    return change, jnp.array(True)


def rest_pull(c, x, torque):
    """Return the generalised forces (N,) of the tendons, of which there are none."""
    return jnp.zeros_like(x)
