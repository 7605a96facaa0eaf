"""Chain in a plane. Coordinates are n absolute link angles [rad], then the strains of segments that lengthen.

`space` has functions of the same names for chains in space; an export contains one of the two files.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from pliant.exporters.jax_source.springs import (
    axial_constants,
    hardening_of,
    nonlinear_slope,
    nonlinear_torque,
)
from pliant.exporters.jax_source.structure import CURVED, LINKS, POINT, POINT_LINK, ROD, SEGMENTS

SIZE = LINKS + SEGMENTS
TO_JOINTS = np.eye(SIZE) - np.diag((np.arange(SIZE - 1) < LINKS - 1).astype(float), -1)  # rates of joints from v
EVERY_LINK = np.pad(np.eye(LINKS), ((1, 0), (0, 0)))  # (n + 1, n)


def constants(p):
    """Return the constants of inertia and springs as a dict, from the parameters p of the model."""
    length = jnp.concatenate([p["base_length"][None], p["link_length"]])
    mass = jnp.concatenate([jnp.zeros_like(p["link_mass"][:1]), p["link_mass"]])
    centre = 0.5 * length if ROD else length
    rotary = mass * length * length / 12.0 if ROD else 0.0 * mass
    reach = jnp.tril(jnp.ones_like(length)[:, None] * length, -1) + jnp.diag(centre)
    B = (reach.T * mass) @ reach + p["tip_mass"] * jnp.outer(length, length) + jnp.diag(rotary)
    h = mass @ reach + p["tip_mass"] * length
    K, D, hardening = p["stiffness"], p["damping"], hardening_of(p, p["stiffness"])
    share = jnp.zeros((LINKS + 1, 0), K.dtype)
    if SEGMENTS:
        share = p["share"]
        axial = axial_constants(p, length)
        K, D = jnp.concatenate([K, axial[0]]), jnp.concatenate([D, axial[1]])
        hardening = jnp.concatenate([hardening, axial[2]], axis=1)
    rest = jnp.concatenate([p["rest_angle"], jnp.zeros_like(K[LINKS:])])
    return dict(p, length=length, B=B, h=h, share=share, K=K, D=D, hardening=hardening, rest=rest)


def to_joints(c, v):
    """Return the rates of joint angles and strains (N,) for the rates v (N,) of the coordinates."""
    return jnp.asarray(TO_JOINTS, v.dtype) @ v


def from_joints(c, torque):
    """Return the generalised forces (N,) of torques (N,) at the joints."""
    return torque @ jnp.asarray(TO_JOINTS, torque.dtype)


def from_joint_matrix(c, K):
    """Return the matrix (N, N) in the coordinates of a stiffness matrix (N, N) in joint angles."""
    T = jnp.asarray(TO_JOINTS, K.dtype)
    return T.T @ K @ T


def joint_coordinates(c, x):
    """Return the joint angles from the rest shape, then the strains (N,), at coordinates x (N,)."""
    first = jnp.concatenate([c["base_angle"][None], jnp.zeros(SIZE - 1, x.dtype)])
    return to_joints(c, x) - first - c["rest"]


def coordinates(c, q):
    """Return the coordinates x (N,) of joint angles and strains q (N,)."""
    angles = c["base_angle"] + jnp.cumsum(q[:LINKS] + c["rest"][:LINKS])
    return jnp.concatenate([angles, q[LINKS:]])


def pose(c, x):
    """Return cosines, sines and stretches (n + 1,) of base part and links, and how the coordinates move them.

    The last two are (n + 1, N): derivatives of the two components of stretch times direction.
    """
    angle = jnp.concatenate([c["base_angle"][None], x[:LINKS]])
    stretch = 1.0 + c["share"] @ x[LINKS:]
    cos, sin = jnp.cos(angle), jnp.sin(angle)
    each = jnp.asarray(EVERY_LINK, x.dtype)
    across = jnp.concatenate([each * (-stretch * cos)[:, None], c["share"] * -sin[:, None]], axis=1)
    along = jnp.concatenate([each * (-stretch * sin)[:, None], c["share"] * cos[:, None]], axis=1)
    return cos, sin, stretch, across, along


def inertia(c, posed, quarter):
    """Return the inertia (N, N) plus `quarter` [s^2] times the stiffness by gravity."""
    cos, sin, stretch, across, along = posed
    gx, gy = c["gravity"]
    M = across.T @ c["B"] @ across + along.T @ c["B"] @ along
    M = M.at[LINKS - 1, LINKS - 1].add(c["tip_inertia"])
    turning = quarter * (c["h"] * stretch * (gy * cos - gx * sin))[1:]
    M = M + jnp.diag(jnp.concatenate([turning, jnp.zeros(SEGMENTS, M.dtype)]))
    if SEGMENTS:
        mixed = quarter * (c["share"] * (c["h"] * (gx * cos + gy * sin))[:, None])[1:]
        full = jnp.zeros((LINKS, LINKS), M.dtype), jnp.zeros((SEGMENTS, SEGMENTS), M.dtype)
        M = M + jnp.block([[full[0], mixed], [mixed.T, full[1]]])
    return M


def inertial_forces(c, posed, v):
    """Return the centrifugal, Coriolis and gravity forces (N,) at rates v (N,)."""
    cos, sin, stretch, across, along = posed
    turn = jnp.concatenate([jnp.zeros_like(v[:1]), v[:LINKS]])
    growth = c["share"] @ v[LINKS:]
    inward, sideways = stretch * turn * turn, 2.0 * growth * turn
    x = inward * sin - sideways * cos
    y = -inward * cos - sideways * sin
    gx, gy = c["gravity"]
    return (c["B"] @ x - c["h"] * gx) @ across + (c["B"] @ y - c["h"] * gy) @ along


def spring_torques(c, q):
    """Return the torques (N,) of all springs at joint angles and strains q (N,)."""
    curved = LINKS + SEGMENTS * CURVED
    more = nonlinear_torque(c["hardening"], q[:curved])
    return c["K"] * q + jnp.concatenate([more, jnp.zeros(SIZE - curved, q.dtype)])


def spring_slopes(c, q):
    """Return the stiffness (N, N) of all springs at joint angles and strains q (N,)."""
    return jnp.diag(spring_stiffness(c, q))


def spring_stiffness(c, q):
    """Return the stiffness (N,) of each spring at joint angles and strains q (N,)."""
    curved = LINKS + SEGMENTS * CURVED
    more = nonlinear_slope(c["hardening"], q[:curved])
    return c["K"] + jnp.concatenate([more, jnp.zeros(SIZE - curved, q.dtype)])


def metric(c):
    """Return the blocks of coordinates with hysteresis: start, stop, coordinates together, law and weights."""
    blocks = [(0, LINKS, 1, "", None)]
    return [*blocks, (LINKS, SIZE, 1, "axial_", None)] if SEGMENTS else blocks


def line_matrix(own, across):
    """Return the matrix (N, N) of slopes: by the coordinate itself, and (only in space) by its partner."""
    return jnp.diag(own)


def holds(c, x, v, h):
    """Return whether a step of h [s] is valid: no rate too high, every spring stiff, no segment compressed to 5 %."""
    slow = jnp.all(jnp.abs(v * h) <= 1.0)
    stiff = jnp.all(spring_stiffness(c, joint_coordinates(c, x)) > 0.0)
    return slow & stiff & jnp.all(x[LINKS:] > -0.95)


def nodes(c, x):
    """Return where base part and links start and end (n + 2, 2) [m], and their directions e and n (n + 1, 2)."""
    cos, sin, stretch, _, _ = pose(c, x)
    ahead, left = jnp.stack([-sin, cos], axis=1), jnp.stack([-cos, -sin], axis=1)
    steps = (c["length"] * stretch)[:, None] * ahead
    return jnp.concatenate([jnp.zeros((1, 2), x.dtype), jnp.cumsum(steps, axis=0)]), ahead, left, stretch


def observed(c, x):
    """Return a dict of what an observer sees at coordinates x (N,).

    position (S, 2) [m] and angle (S,) [rad] of the S observed points and their links; tips (n, 2) [m] of the links.
    """
    start, ahead, left, stretch = nodes(c, x)
    k, at = jnp.asarray(POINT_LINK + 1), jnp.asarray(POINT, x.dtype)
    along, across = (at[:, 0] * stretch[k])[:, None], at[:, 1][:, None]
    angle = jnp.concatenate([c["base_angle"][None], x[:LINKS]])
    return {"position": start[k] + along * ahead[k] + across * left[k], "angle": angle[k], "tips": start[2:]}
