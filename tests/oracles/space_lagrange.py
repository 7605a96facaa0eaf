"""Lagrange's equations of a chain in space from the positions of its bodies alone, for any number of links.

Rotations come from the matrix exponential; one of blocks [[X, dX], [0, X]] brings the derivative along a direction, and
a complex step through all of it the second one. No axis, no Jacobian of a rotation vector and no recursion of forces.
A link is two halves of its mass on its axis, which its strain moves apart, and a disk that turns.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from oracles.derivatives import STEP


def generators(x, n):
    """[a, b, 0]^ and [0, 0, c]^ (n, 3, 3) of all joints."""
    swing, twist = np.zeros((n, 3, 3), x.dtype), np.zeros((n, 3, 3), x.dtype)
    a, b = x[0 : 2 * n : 2], x[1 : 2 * n : 2]
    swing[:, 1, 2], swing[:, 2, 1], swing[:, 0, 2], swing[:, 2, 0] = -a, a, b, -b
    if x.size > 2 * n:
        twist[:, 1, 0], twist[:, 0, 1] = x[2 * n :], -x[2 * n :]
    return swing, twist


def blocks(X, dX):
    """[[X, dX], [0, X]] of stacked matrices (..., 3, 3): products and exponentials carry the derivative along."""
    whole = np.zeros((*X.shape[:-2], 6, 6), np.result_type(X, dX))
    whole[..., :3, :3] = whole[..., 3:, 3:] = X
    whole[..., :3, 3:] = dX
    return whole


def motion(chain, x, dx):
    """Half masses (n, 2, 3), their velocities, rotations (n, 3, 3) and angular velocities (n, 3) at x moving by dx."""
    n, body, segments = chain.n, chain.body, chain.body.share.shape[1]
    strained = [body.share @ z[z.size - segments :] if segments else np.zeros(n + 1) for z in (x, dx)]
    reach = np.sqrt((body.lateral - 0.5 * body.axial) / body.mass)
    x, dx = x[: x.size - segments], dx[: dx.size - segments]
    swing, twist = (expm(blocks(X, dX)) for X, dX in zip(generators(x, n), generators(dx, n), strict=True))
    R = blocks(body.base, 0.0 * body.base)
    p = np.zeros((6, 6), np.result_type(swing.dtype, *strained))
    found = [[], [], [], []]
    for k in range(n + 1):
        stretched = R @ blocks((1.0 + strained[0][k]) * np.eye(3), strained[1][k] * np.eye(3))
        if k:
            halves = [p + place * stretched for place in body.centre[k - 1] + reach[k - 1] * np.array([1.0, -1.0])]
            spin = R[:3, 3:] @ R[:3, :3].T
            parts = (np.stack([h[:3, 2] for h in halves]), np.stack([h[:3, 5] for h in halves]), R[:3, :3],
                     np.array([spin[2, 1], spin[0, 2], spin[1, 0]]))  # fmt: skip
            for many, one in zip(found, parts, strict=True):
                many.append(one)
        if k < n:
            p = p + body.length[k] * stretched
            R = R @ blocks(body.rest[k], 0.0 * body.rest[k]) @ swing[k] @ twist[k]
    return tuple(map(np.stack, found))


def kinetic_energy(chain, x, v):
    body = chain.body
    _, speed, R, omega = motion(chain, x, v)
    local = np.einsum("kji,kj->ki", R, omega)
    return 0.5 * (0.5 * body.mass @ (speed**2).sum(axis=(1, 2)) + (disks(body) * local**2).sum())


def disks(body):
    """Moments of inertia (n, 3) of the cross-sections, which no strain changes."""
    return np.stack([0.5 * body.axial, 0.5 * body.axial, body.axial], axis=1)


def gravity_energy(chain, x):
    body = chain.body
    return -body.mass @ motion(chain, x, 0.0 * x)[0].mean(axis=1) @ np.array([body.gx, body.gy, body.gz])


def inertia(chain, x):
    """M (N, N) from the velocities that unit rates make."""
    body, moments = chain.body, disks(chain.body)
    moved = [motion(chain, x, e) for e in np.eye(x.size)]
    speed = np.stack([s for _, s, _, _ in moved])
    local = np.stack([np.einsum("kji,kj->ki", R, omega) for _, _, R, omega in moved])
    turning = np.einsum("ikd,kd,jkd->ij", local, moments, local)
    return np.einsum("ikhd,k,jkhd->ij", speed, 0.5 * body.mass, speed) + turning


def acceleration(chain, x, v, forces):
    """a (N,) from d/dt(M v) - dT/dx + dV/dx = forces (N,)."""
    rate = inertia(chain, x + 1j * STEP * v).imag / STEP @ v
    ahead = [x + 1j * STEP * e for e in np.eye(x.size)]
    slope = [(kinetic_energy(chain, z, v) - gravity_energy(chain, z)).imag / STEP for z in ahead]
    return np.linalg.solve(inertia(chain, x), forces - rate + np.array(slope))
