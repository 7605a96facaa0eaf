"""Chain in space. Coordinates are two swings (a, b) of each joint, then the twists [rad], then the strains.

All vectors are in the fixed axes of the base frame. Sums over links are cumulative sums; only the rotations are a loop.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from pliant.equations.spatial import stumpff
from pliant.exporters.jax_source.numerics import beyond, cross
from pliant.exporters.jax_source.springs import (
    axial_constants,
    curvature,
    hardening_of,
    nonlinear_energy,
    nonlinear_slope,
    nonlinear_torque,
)
from pliant.exporters.jax_source.structure import CURVED, LINKS, POINT, POINT_LINK, SEGMENTS, TIED, TURNS

TURNED = LINKS * TURNS
SIZE = TURNED + SEGMENTS
JOINT = np.concatenate([np.repeat(np.arange(LINKS), 2), np.tile(np.arange(LINKS), TURNS - 2)])  # of each angle
MOVED = (JOINT[None] <= np.arange(LINKS)[:, None])[:, :, None]  # (n, T, 1) whether a link moves with an angle
ORDER = JOINT * 4 + np.where(np.arange(TURNED) < 2 * LINKS, np.arange(TURNED) % 2, 2)  # from base to tip
INNER = ORDER[:, None] <= ORDER[None]
PAIR = (JOINT[:, None] == JOINT[None]) & (np.maximum.outer(np.arange(TURNED), np.arange(TURNED)) < 2 * LINKS)
MIXED = PAIR & ~np.eye(TURNED, dtype=bool)
TINY = 1e-24  # rad^2, under a root, so that the size of a swing has a derivative where the joint is straight


def rotations(vector):
    """Return the rotation matrices (..., 3, 3) of rotation vectors (..., 3) [rad] of at most 4 rad."""
    square = jnp.sum(vector * vector, axis=-1)[..., None, None]
    c2, c3, _, _ = stumpff(square)
    x, y, z = jnp.moveaxis(vector, -1, 0)
    zero = jnp.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    skew = jnp.stack([jnp.stack(row, axis=-1) for row in rows], axis=-2)
    outer = vector[..., :, None] * vector[..., None, :]
    one = jnp.eye(3, dtype=vector.dtype)
    return (1.0 - square * c2) * one + (1.0 - square * c3) * skew + c2 * outer


def each_coordinate(x, y, twist):
    """Return values of swings about x and y (n,) and of twists (n,) in the order of the coordinates."""
    values = jnp.stack([x, y], axis=-1).reshape(-1)
    return jnp.concatenate([values, twist]) if TURNS == 3 else values


def constants(p):
    """Return the constants of inertia and springs as a dict, from the parameters p of the model."""
    length = jnp.concatenate([p["base_length"][None], p["link_length"]])
    mass, square = p["link_mass"], p["radius"] ** 2
    centre, lateral = 0.5 * p["link_length"], mass * (p["link_length"] ** 2 / 12.0 + square / 4.0)
    axial, rod, tip = 0.5 * mass * square, mass[-1], p["tip_mass"]
    lateral = lateral.at[-1].add(rod * tip / (rod + tip) * (length[-1] - centre[-1]) ** 2)
    centre = centre.at[-1].set((rod * centre[-1] + tip * length[-1]) / (rod + tip))
    mass, lateral = mass.at[-1].add(tip), lateral.at[-1].add(p["tip_inertia"])
    axial = axial.at[-1].add(2.0 * p["tip_inertia"])
    ratio, twist = p["stiffness_ratio"], p.get("twist_ratio", 0.0)
    K, D = (each_coordinate(k, ratio * k, twist * k) for k in (p["stiffness"], p["damping"]))
    share = jnp.zeros((LINKS + 1, 0), K.dtype)
    hardening, axial_terms = hardening_of(p, p["stiffness"]), None
    if SEGMENTS:
        share = p["share"]
        own = axial_constants(p, length)
        K, D, axial_terms = jnp.concatenate([K, own[0]]), jnp.concatenate([D, own[1]]), own[2]
    return dict(
        p, length=length, mass=mass, centre=centre, slender=lateral - 0.5 * axial, half_axial=0.5 * axial, K=K, D=D,
        share=share, hardening=hardening, axial_hardening=axial_terms, rest=rotations(p["rest_turn"]),
        base=rotations(p["base_tilt"]),
    )


def to_joints(c, v):
    """Return the rates of the joint coordinates, which are the coordinates themselves."""
    return v


def from_joints(c, torque):
    """Return the generalised forces (N,) of torques (N,) at the joints."""
    return torque


def from_joint_matrix(c, K):
    """Return the matrix (N, N) in the coordinates of a stiffness matrix (N, N) in joint coordinates."""
    return K


def joint_coordinates(c, x):
    """Return the joint coordinates (N,), which are the coordinates themselves."""
    return x


def coordinates(c, q):
    """Return the coordinates x (N,) of joint coordinates q (N,)."""
    return q


def pose(c, x):
    """Return the pose of the links at coordinates x (N,) as a dict of arrays.

    R (n + 1, 3, 3) rotations, base part first; r (n + 1, 3) [m] where the parts start; P (n, 3, 3) frames of the
    joints; S (T, 3) axes of the angles; rows (10 n, N) and weight (10 n,): M = rows^T weight rows.
    """
    a, b, strain = x[0 : 2 * LINKS : 2], x[1 : 2 * LINKS : 2], x[TURNED:]
    series = stumpff(a * a + b * b)
    E, axes = swings(a, b, *series[:2])
    turned = E
    if TURNS == 3:
        cos, sin = jnp.cos(x[2 * LINKS : TURNED])[:, None], jnp.sin(x[2 * LINKS : TURNED])[:, None]
        first, second = cos * E[:, :, 0] + sin * E[:, :, 1], cos * E[:, :, 1] - sin * E[:, :, 0]
        turned = jnp.stack([first, second, E[:, :, 2]], axis=-1)
    R, P = [c["base"]], []
    for rest, turn in zip(c["rest"], turned, strict=True):
        P.append(R[-1] @ rest)
        R.append(P[-1] @ turn)
    R, P = jnp.stack(R), jnp.stack(P)
    S = jnp.einsum("kij,kaj->kai", P, axes).reshape(-1, 3)
    if TURNS == 3:
        S = jnp.concatenate([S, R[1:, :, 2]])
    stretch = 1.0 + c["share"] @ strain
    z = R[:, :, 2]
    step = (stretch * c["length"])[:, None] * z
    r = jnp.concatenate([jnp.zeros((1, 3), x.dtype), jnp.cumsum(step, axis=0)])
    posed = {"R": R, "P": P, "S": S, "z": z, "r": r[:-1], "end": r[1:], "stretch": stretch, "a": a, "b": b,
             "series": series}  # fmt: skip
    return posed | jacobians(c, posed)


def swings(a, b, c2, c3):
    """Return the rotations (n, 3, 3) of swings (a, b) in the frames of their joints, and their axes (n, 2, 3)."""
    y = a * a + b * b
    c1 = 1.0 - y * c3
    rows = [[1.0 - c2 * b * b, c2 * a * b, c1 * b], [c2 * a * b, 1.0 - c2 * a * a, -c1 * a],
            [-c1 * b, c1 * a, 1.0 - c2 * y]]  # fmt: skip
    axes = [[1.0 - c3 * b * b, c3 * a * b, -c2 * b], [c3 * a * b, 1.0 - c3 * a * a, c2 * a]]
    return tuple(jnp.stack([jnp.stack(row, axis=-1) for row in m], axis=-2) for m in (rows, axes))


def jacobians(c, posed):
    """Return the rows by which the coordinates move each link, their weights, and the links' centres of mass (n, 3).

    The rows are the centre of mass, the vector along the link, and the turn and the spin of its cross-sections.
    """
    S, z, r, stretch = posed["S"], posed["z"], posed["r"], posed["stretch"]
    centre = r[1:] + (stretch[1:] * c["centre"])[:, None] * z[1:]
    along = stretch[1:, None] * z[1:]
    joint, turn = jnp.asarray(JOINT + 1), jnp.where(MOVED, S, 0.0)  # (n, T, 3)
    moved = cross(turn, centre[:, None] - r[joint])
    swung = cross(turn, along[:, None])
    if SEGMENTS:
        share = c["share"]
        grown = share[:, :, None] * z[:, None]  # (n + 1, S, 3)
        carried = jnp.cumsum(c["length"][:, None, None] * grown, axis=0)[:-1]
        moved = jnp.concatenate([moved, carried + c["centre"][:, None, None] * grown[1:]], axis=1)
        swung = jnp.concatenate([swung, grown[1:]], axis=1)
        turn = jnp.concatenate([turn, jnp.zeros((LINKS, SEGMENTS, 3), turn.dtype)], axis=1)
    spin = jnp.einsum("kni,ki->kn", turn, z[1:])
    parts = [jnp.swapaxes(part, 1, 2).reshape(-1, SIZE) for part in (moved, swung, turn)]
    weights = [jnp.repeat(c[name], 3) for name in ("mass", "slender", "half_axial")]
    return {"rows": jnp.concatenate([*parts, spin]), "weight": jnp.concatenate([*weights, c["half_axial"]]),
            "centre": centre}  # fmt: skip


def inertia(c, posed, quarter):
    """Return the inertia (N, N) plus `quarter` [s^2] times the stiffness by gravity.

    The stiffness that couples the two bending coordinates of a joint is made symmetric by its mean with its transpose.
    """
    rows, S = posed["rows"], posed["S"]
    M = (rows.T * posed["weight"]) @ rows
    joint = jnp.asarray(JOINT)
    first = beyond(c["mass"][:, None] * posed["centre"]) - beyond(c["mass"])[:, None] * posed["r"][1:]
    force = cross(S, first[joint])
    slope = S @ cross(c["gravity"][None], force).T
    slope = quarter * jnp.where(PAIR, 0.5 * (slope + slope.T), jnp.where(INNER, slope, slope.T))
    if not SEGMENTS:
        return M + slope
    moment = c["mass"] * c["centre"] + (jnp.sum(c["mass"]) - jnp.cumsum(c["mass"])) * c["length"][1:]
    pushed = beyond(c["share"][1:, :, None] * (moment[:, None] * posed["z"][1:])[:, None])  # (n, S, 3)
    turning = cross(c["gravity"], pushed)[joint]
    mixed = quarter * jnp.einsum("ti,tsi->ts", S, turning)
    return M + jnp.block([[slope, mixed], [mixed.T, jnp.zeros((SEGMENTS, SEGMENTS), M.dtype)]])


def inertial_forces(c, posed, v):
    """Return the centrifugal, Coriolis and gravity forces (N,) at rates v (N,)."""
    z, stretch = posed["z"][1:], posed["stretch"]
    omega, alpha = turning(posed, v)
    dz = cross(omega, z)
    ddz = cross(alpha, z) + cross(omega, dz)
    growth = (c["share"] @ v[TURNED:])[1:, None]
    along = stretch[1:, None] * ddz + 2.0 * growth * dz
    before = jnp.cumsum(c["length"][1:, None] * along, axis=0) - c["length"][1:, None] * along
    centre = before - c["gravity"] + c["centre"][:, None] * along
    spin = jnp.sum(omega * z, axis=1, keepdims=True)
    gain = jnp.sum(alpha * z, axis=1)
    acting = jnp.concatenate([part.reshape(-1) for part in (centre, along, alpha + spin * dz, gain)])
    return (acting * posed["weight"]) @ posed["rows"]


def turning(posed, v):
    """Return the angular velocities and, at constant rates v (N,), the angular accelerations of the links (n, 3)."""
    a, b, S, P = posed["a"], posed["b"], posed["S"], posed["P"]
    da, db = v[0 : 2 * LINKS : 2], v[1 : 2 * LINKS : 2]
    kappa, growth = a * db - b * da, 2.0 * (a * da + b * db)
    _, c3, d2, d3 = posed["series"]
    d3 = d3 * growth
    local = jnp.stack([kappa * (d3 * b + c3 * db), -kappa * (d3 * a + c3 * da), kappa * d2 * growth], axis=-1)
    swing = S[0 : 2 * LINKS : 2] * da[:, None] + S[1 : 2 * LINKS : 2] * db[:, None]
    twist = S[2 * LINKS :] * v[2 * LINKS : TURNED, None] if TURNS == 3 else jnp.zeros_like(swing)
    omega = jnp.cumsum(swing + twist, axis=0)
    before = omega - swing - twist
    more = jnp.einsum("kij,kj->ki", P, local) + cross(before, swing) + cross(before + swing, twist)
    return omega, jnp.cumsum(more, axis=0)


def swing_size(c, a, b):
    """Return the sizes (n,) [rad] of swings, weighted by stiffness, and the ratio K_b / K_a."""
    ratio = stiffness_ratio(c)
    return jnp.sqrt(a * a + ratio * (b * b) + TINY), ratio


def stiffness_ratio(c):
    """Return the ratio (n,) of the two bending stiffnesses of each joint."""
    K = c["K"][0 : 2 * LINKS : 2]
    return c["K"][1 : 2 * LINKS : 2] / jnp.where(K > 0.0, K, 1.0)


def bending(c, q):
    """Return torques (T,), slopes (T, T) and energies (n,) of the springs of all swings and twists at q (N,)."""
    a, b, twist = q[0 : 2 * LINKS : 2], q[1 : 2 * LINKS : 2], q[2 * LINKS : TURNED]
    m, ratio = swing_size(c, a, b)
    more = nonlinear_torque(c["hardening"], m) / m
    steeper = nonlinear_slope(c["hardening"], m) - more
    u, w = a / m, ratio * b / m
    K = c["K"][:TURNED]
    Ka, Kb, Kc = K[0 : 2 * LINKS : 2], K[1 : 2 * LINKS : 2], K[2 * LINKS :]
    torque = K * q[:TURNED] + each_coordinate(more * a, more * ratio * b, 0.0 * twist)
    diagonal = K + each_coordinate(more + steeper * u * u, more * ratio + steeper * w * w, 0.0 * twist)
    mixed = each_coordinate(steeper * u * w, steeper * u * w, 0.0 * twist)
    slope = jnp.diag(diagonal) + jnp.where(MIXED, mixed[:, None], 0.0)
    energy = 0.5 * (Ka * a * a + Kb * b * b) + nonlinear_energy(c["hardening"], m)
    return torque, slope, energy + 0.5 * Kc * twist * twist if TURNS == 3 else energy


def stiffened(c, strain):
    """Return the axial stiffness of each segment over that at rest, less 1, and its first two derivatives (S,)."""
    terms, K = c["axial_hardening"], c["K"][TURNED:]
    second, third = curvature(terms, strain)
    return nonlinear_slope(terms, strain) / K, second / K, third / K


def spring_torques(c, q):
    """Return the torques (N,) of all springs at coordinates q (N,)."""
    torque, _, energy = bending(c, q)
    if not SEGMENTS:
        return torque
    strain = q[TURNED:]
    axial = c["K"][TURNED:] * strain
    if CURVED:
        axial = axial + nonlinear_torque(c["axial_hardening"], strain)
        more, rate, _ = stiffened(c, strain)
        tied = jnp.asarray(TIED, q.dtype)
        torque = torque + (tied @ more)[jnp.asarray(JOINT)] * torque
        axial = axial + rate * (energy @ tied)
    return jnp.concatenate([torque, axial])


def spring_slopes(c, q):
    """Return the stiffness (N, N) of all springs at coordinates q (N,)."""
    torque, slope, energy = bending(c, q)
    if not SEGMENTS:
        return slope
    strain, axial = q[TURNED:], c["K"][TURNED:]
    mixed = jnp.zeros((TURNED, SEGMENTS), q.dtype)
    if CURVED:
        more, rate, bend = stiffened(c, strain)
        tied, joint = jnp.asarray(TIED, q.dtype), jnp.asarray(JOINT)
        slope = slope + (tied @ more)[joint][:, None] * slope
        mixed = tied[joint] * rate * torque[:, None]
        axial = axial + nonlinear_slope(c["axial_hardening"], strain) + bend * (energy @ tied)
    return jnp.block([[slope, mixed], [mixed.T, jnp.diag(axial)]])


def metric(c):
    """Return the blocks of coordinates with hysteresis: start, stop, coordinates together, law and weights."""
    ratio = stiffness_ratio(c)
    blocks = [(0, 2 * LINKS, 2, "", jnp.stack([jnp.ones_like(ratio), ratio], axis=1))]
    return [*blocks, (2 * LINKS, TURNED, 1, "", None)] if TURNS == 3 else blocks


def line_matrix(own, across):
    """Return the matrix (N, N) of slopes: by the coordinate itself, and by its partner in a swing."""
    mixed = jnp.pad(jnp.where(MIXED, across[:TURNED, None], 0.0), ((0, SEGMENTS), (0, SEGMENTS)))
    return jnp.diag(own) + mixed


def holds(c, x, v, h):
    """Return whether a step of h [s] is valid: no rate too high, every spring stiff, no segment compressed to 5 %."""
    slow = jnp.all(jnp.abs(v * h) <= 1.0)
    a, b = x[0 : 2 * LINKS : 2], x[1 : 2 * LINKS : 2]
    m, _ = swing_size(c, a, b)
    stiff = jnp.all(c["K"][0 : 2 * LINKS : 2] + nonlinear_slope(c["hardening"], m) > 0.0)
    near = jnp.all(a * a + b * b <= 16.0) & jnp.all(x[TURNED:] > -0.95)
    if CURVED:
        stiff &= jnp.all(c["K"][TURNED:] + nonlinear_slope(c["axial_hardening"], x[TURNED:]) > 0.0)
    return slow & stiff & near


def observed(c, x):
    """Return a dict of what an observer sees at coordinates x (N,).

    position (S, 3) [m], angle (S,) [rad] from +z and rotation (S, 3, 3) of the S observed points and their links, and
    tips (n, 3) [m] of the links.
    """
    posed = pose(c, x)
    k, at = jnp.asarray(POINT_LINK + 1), jnp.asarray(POINT, x.dtype)
    R, along = posed["R"][k], (at[:, 0] * posed["stretch"][k])[:, None]
    position = posed["r"][k] + along * R[:, :, 2] - at[:, 1:2] * R[:, :, 1] + at[:, 2:] * R[:, :, 0]
    square = R[:, 0, 2] ** 2 + R[:, 1, 2] ** 2
    level = square > 0.0
    across = jnp.where(level, jnp.sqrt(jnp.where(level, square, 1.0)), 0.0)
    return {"position": position, "angle": jnp.arctan2(across, R[:, 2, 2]), "rotation": R, "tips": posed["end"][1:]}
