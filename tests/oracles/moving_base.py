"""MuJoCo as the reference of a chain on a moving base: the coordinates of the base are prescribed functions of time.

MuJoCo gives mass matrix and bias forces of base and links; the accelerations of the base are known, those of the joints
follow, and the forces of the base's own coordinates are the reaction. (The velocity of a mocap body counts as zero in
MuJoCo, so that its children do not feel its acceleration.) In space MuJoCo's joints are balls, reduced to the two swing
angles of each joint by the velocity of a ball in terms of its rotation vector.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'pliant[bench]'")
FREE = {
    2: '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint type="hinge" axis="0 0 1"/>',
    3: "<freejoint/>",
}
JOINT = {2: '<joint type="hinge" axis="0 0 1"/>', 3: '<joint type="ball"/>'}
LIGHT = '<inertial pos="0 0 0" mass="1e-9" diaginertia="1e-9 1e-9 1e-9"/>'  # of the base


def xml(model, d):
    """The chain in MuJoCo's language, with rods as links."""
    length, mass, radius = model.link_length, model.link_mass, model.space.radius if model.space else 0.0
    axis = "0 {} 0" if d == 2 else "0 0 {}"
    links = ""
    for k in reversed(range(model.n)):
        across = mass[k] * (length[k] ** 2 / 12 + radius**2 / 4)
        along = 0.5 * mass[k] * radius**2 if d == 3 else across
        links = (
            f'<body pos="{axis.format(length[k - 1] if k else model.base_length)}">{JOINT[d]}<inertial '
            f'pos="{axis.format(length[k] / 2)}" mass="{mass[k]}" diaginertia="{across} {across} {along}"/>'
            f"{links}</body>"
        )
    gravity = " ".join(map(str, np.append(model.gravity, 0.0)[:3]))
    return (f'<mujoco><option gravity="{gravity}"/><compiler boundmass="0" boundinertia="0"/><worldbody><body>{FREE[d]}'
            f"{LIGHT}{links}</body></worldbody></mujoco>")  # fmt: skip


def ball_rates(q, dq):
    """Angular velocities (3,) of a ball in its own axes at the swing q (2,), by the rates dq (2,): J_r(q) dq."""
    v = np.append(q, 0.0)
    y, cross = v @ v, np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    c2 = sum((-y) ** k / np.prod(np.arange(1.0, 2 * k + 3)) for k in range(8))
    c3 = sum((-y) ** k / np.prod(np.arange(1.0, 2 * k + 4)) for k in range(8))
    return (np.eye(3) - c2 * cross + c3 * cross @ cross)[:, :2] @ dq


def lifted(q, dq):
    """Map S (3 n, 2 n) from the rates of n swings to those of n balls, and the acceleration dS/dt dq (3 n,)."""
    n = len(q) // 2
    S, moved = np.zeros((3 * n, 2 * n)), np.zeros(3 * n)
    for k in range(n):
        rows, own = slice(3 * k, 3 * k + 3), slice(2 * k, 2 * k + 2)
        S[rows, own] = np.column_stack([ball_rates(q[own], e) for e in np.eye(2)])
        moved[rows] = ball_rates(q[own] + 1e-20j * dq[own], dq[own]).imag / 1e-20
    return S, moved


class OnMovingBase:
    """A chain of rods with linear springs and dampers whose base moves as `motion`, computed with MuJoCo."""

    def __init__(self, model, motion):
        self.model, self.motion, self.d = model, motion, motion.dimension
        self.mj = mujoco.MjModel.from_xml_string(xml(model, self.d))
        self.data = mujoco.MjData(self.mj)

    def base(self, t):
        """Coordinates, velocity and acceleration of MuJoCo's base; the angular ones in the axes of the body."""
        now = self.motion.at(np.array([t]))
        if self.d == 2:
            return (np.append(now.position[0], now.angle), np.append(now.velocity[0], now.rate),
                    np.append(now.acceleration[0], now.turning))  # fmt: skip
        turn = Rotation.from_matrix(now.axes[0])
        return (np.append(now.position[0], turn.as_quat(scalar_first=True)),
                np.append(now.velocity[0], turn.inv().apply(now.rate[0])),
                np.append(now.acceleration[0], turn.inv().apply(now.turning[0])))  # fmt: skip

    def step(self, t, q, dq):
        """Joint accelerations, and the force and moment at the base, in the axes that MuJoCo uses for them."""
        place, rate, accelerated = self.base(t)
        S, moved = (np.eye(q.size), np.zeros(q.size)) if self.d == 2 else lifted(q, dq)
        turns = q if self.d == 2 else Rotation.from_rotvec(
            np.pad(q.reshape(-1, 2), ((0, 0), (0, 1)))).as_quat(scalar_first=True).ravel()  # fmt: skip
        self.data.qpos[:], self.data.qvel[:] = np.append(place, turns), np.append(rate, S @ dq)
        mujoco.mj_forward(self.mj, self.data)
        M, b = np.zeros((self.mj.nv, self.mj.nv)), len(rate)
        mujoco.mj_fullM(self.mj, self.data, M)
        bias = self.data.qfrc_bias
        held = np.repeat(self.model.stiffness, self.d - 1) * q + np.repeat(self.model.damping, self.d - 1) * dq
        needed = S.T @ (bias[b:] + M[b:, :b] @ accelerated + M[b:, b:] @ moved)
        a = np.linalg.solve(S.T @ M[b:, b:] @ S, -held - needed)
        return a, M[:b, :b] @ accelerated + M[:b, b:] @ (S @ a + moved) + bias[:b]

    def run(self, times, q0):
        """Joint coordinates and rates at the times, and force and moment of the base in its own axes."""
        n = q0.size
        found = solve_ivp(lambda t, y: np.append(y[n:], self.step(t, y[:n], y[n:])[0]), times[[0, -1]],
                          np.append(q0, np.zeros(n)), t_eval=times, rtol=1e-7, atol=1e-9, method="DOP853")  # fmt: skip
        q, dq = found.y[:n].T, found.y[n:].T
        load = np.array([self.step(*row)[1] for row in zip(times, q, dq, strict=True)])
        force = np.einsum("tji,tj->ti", self.motion.at(times).axes, load[:, : self.d])
        return q, dq, force, load[:, self.d :]
