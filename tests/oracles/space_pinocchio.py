"""A chain in space in Pinocchio: ball joints, to whose angular velocities the rates of the coordinates are mapped."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from oracles.derivatives import STEP
from oracles.space_lagrange import blocks, generators


def model(pin, chain):
    """A ball joint at each joint and a body of revolution behind it."""
    body, made, parent = chain.body, pin.Model(), 0
    before = pin.SE3(body.base, np.zeros(3))
    for k in range(chain.n):
        frame = before * pin.SE3(body.rest[k], np.array([0.0, 0.0, body.length[k]]))
        parent = made.addJoint(parent, pin.JointModelSpherical(), frame, f"joint{k}")
        moments = np.diag([body.lateral[k], body.lateral[k], body.axial[k]])
        inertia = pin.Inertia(body.mass[k], np.array([0.0, 0.0, body.centre[k]]), moments)
        made.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
        before = pin.SE3.Identity()
    made.gravity.linear = np.array([body.gx, body.gy, body.gz])
    return made


def turns(chain, x):
    """Rotations (n, 3, 3) of the joints and T (3 n, N): their angular velocities in the link's frame by unit rates."""
    n, columns = chain.n, []
    for e in np.eye(x.size):
        swing, twist = (expm(blocks(X, dX)) for X, dX in zip(generators(x, n), generators(e, n), strict=True))
        E = swing @ twist
        spin = np.swapaxes(E[:, :3, :3], 1, 2) @ E[:, :3, 3:]
        columns.append(np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1).ravel())
    return E[:, :3, :3], np.stack(columns, axis=1)


def equations(pin, chain, x, v):
    """M (N, N) and the forces (N,) that no acceleration needs."""
    made = model(pin, chain)
    data = made.createData()
    E, T = turns(chain, x)
    turning = turns(chain, x + 1j * STEP * v)[1].imag / STEP @ v
    q = np.concatenate([pin.Quaternion(R).coeffs() for R in E])
    M = pin.crba(made, data, q)
    M = np.triu(M) + np.triu(M, 1).T
    held = pin.nonLinearEffects(made, data, q, T @ v)
    return T.T @ M @ T, T.T @ (held + M @ turning)
