"""What a time step knows before it is solved: pose and springs in the middle of the step."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp

from pliant.exporters.jax_source.plane import (
    SIZE,
    inertia,
    inertial_forces,
    joint_coordinates,
    pose,
    spring_slopes,
    spring_torques,
    to_joints,
)


class Beginning(NamedTuple):
    """State at the start of a step of h [s], and matrices and forces in the middle of it."""

    x: jnp.ndarray  # (N,)
    v: jnp.ndarray  # (N,)
    h: jnp.ndarray  # s
    torque: jnp.ndarray  # (N + R,) mean inputs
    middle: jnp.ndarray  # (N,) coordinates in the middle
    posed: Any  # pose there
    first: jnp.ndarray  # (N,) inertial forces at the rates v
    A: jnp.ndarray  # (N, N) inertia and stiffness by gravity
    K: jnp.ndarray  # (N, N) implicit terms of springs and dampers, in joint coordinates
    net: jnp.ndarray  # (N,) torques of inputs, springs and dampers there


def begin(c, x, v, torque, h):
    """Return the `Beginning` of a step from coordinates x and rates v (N,) under mean inputs (N + R,)."""
    middle = x + 0.5 * h * v
    q, posed, quarter = joint_coordinates(c, middle), pose(c, middle), 0.25 * h * h
    K = 0.5 * h * jnp.diag(c["D"]) + quarter * spring_slopes(c, q)
    net = torque[:SIZE] - spring_torques(c, q) - c["D"] * to_joints(c, v)
    first = inertial_forces(c, posed, v)
    return Beginning(x, v, h, torque, middle, posed, first, inertia(c, posed, quarter), K, net)
