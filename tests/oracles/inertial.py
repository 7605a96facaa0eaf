"""An arm in space with inertial sensors: MuJoCo's motion under pressures, and the tables that its sensors write."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from oracles.moving_base import mujoco, xml
from pliant.model import Chamber, Model, Space, Station, chain_model
from pliant.simulation import equilibrium

DOWN = np.array([0.6, 0.0, 0.8])  # in the base frame: the arm is held at a slant
SENSOR = ("y", "-x", "z")  # axes of a sensor along x, y, z of its link
AXES = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # the same as rows: link = AXES @ sensor
LEVEL = 3e4  # Pa
MOMENT = 4e-7  # N m/Pa of each chamber


def arm() -> Model:
    """Three links with two chambers across each other, stations at the ends of the second and the last link."""
    length = 0.06
    chambers = (Chamber(name="left", torque=[MOMENT], joint_gain=1.0, cross_gain=0.0),
                Chamber(name="right", torque=[MOMENT], joint_gain=0.0, cross_gain=1.0))
    return chain_model(
        length=3.5 * length, mass=0.05, links=3, stiffness=0.08, damping=6e-4, space=Space(radius=0.01),
        gravity=9.81 * DOWN, chambers=chambers,
    ).with_(stations=(Station("mid", 1, 0.04), Station("tip", 2, 0.05)))


def pressures(t: np.ndarray) -> np.ndarray:
    """Both pressures (T, 2) [Pa]: smooth and slow, each to one side, so that the sensors show gravity."""
    t = np.asarray(t, dtype=float)
    rise = np.clip(t - 0.3, 0.0, None)
    return LEVEL * np.stack([0.5 - 0.5 * np.cos(1.6 * rise), 0.5 - 0.5 * np.cos(2.3 * rise)], axis=-1)


def balls(q: np.ndarray) -> np.ndarray:
    """Map (n, 3, 2) from the rates of n swings (n, 2) to the angular velocities of balls in their own axes."""
    angle = np.sqrt((q * q).sum(axis=1) + 1e-8)
    first, second = (1.0 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
    zero = np.zeros_like(angle)
    cross = np.array([[zero, zero, q[:, 1]], [zero, zero, -q[:, 0]], [-q[:, 1], q[:, 0], zero]]).transpose(2, 0, 1)
    return (np.eye(3) - first[:, None, None] * cross + second[:, None, None] * (cross @ cross))[..., :2]


class Pushed:
    """The chain in MuJoCo on a base at rest, with torques (2 n,) [N m] of time on the swings of its joints."""

    def __init__(self, model: Model, torque: Callable[[float], np.ndarray]) -> None:
        self.model, self.torque = model, torque
        self.mj = mujoco.MjModel.from_xml_string(xml(model, 3).replace("<freejoint/>", ""))
        self.data = mujoco.MjData(self.mj)

    def accelerations(self, t: float, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
        """Accelerations (2 n,) of the swings, from MuJoCo's mass matrix and bias forces of balls."""
        swing, rate = q.reshape(-1, 2), dq.reshape(-1, 2)
        maps = balls(swing)
        moved = np.einsum("nij,nj->ni", balls(swing + 1e-20j * rate).imag / 1e-20, rate).ravel()
        S = np.zeros((3 * len(maps), q.size))
        for k, one in enumerate(maps):
            S[3 * k : 3 * k + 3, 2 * k : 2 * k + 2] = one
        self.data.qpos[:] = Rotation.from_rotvec(np.pad(swing, ((0, 0), (0, 1)))).as_quat(scalar_first=True).ravel()
        self.data.qvel[:] = S @ dq
        mujoco.mj_forward(self.mj, self.data)
        M = np.zeros((self.mj.nv, self.mj.nv))
        mujoco.mj_fullM(self.mj, self.data, M)
        held = np.repeat(self.model.stiffness, 2) * q + np.repeat(self.model.damping, 2) * dq
        needed = S.T @ (self.data.qfrc_bias + M @ moved)
        return np.linalg.solve(S.T @ M @ S, self.torque(t) - held - needed)

    def swings(self, times: np.ndarray, rest: np.ndarray, parts: int = 4) -> np.ndarray:
        """Swings (T, 2 n) of the joints from rest at `rest`, by Runge-Kutta steps of a part of the interval."""
        n, y, listed = rest.size, np.append(rest, 0.0 * rest), [rest]

        def slope(t: float, y: np.ndarray) -> np.ndarray:
            return np.append(y[n:], self.accelerations(t, y[:n], y[n:]))

        for start, end in pairwise(times):
            h = (end - start) / parts
            for t in start + h * np.arange(parts):
                one = slope(t, y)
                two = slope(t + h / 2, y + h / 2 * one)
                three = slope(t + h / 2, y + h / 2 * two)
                y = y + h / 6 * (one + 2 * two + 2 * three + slope(t + h, y + h * three))
            listed.append(y[:n])
        return np.array(listed)


def frames(q: np.ndarray) -> np.ndarray:
    """Rotations (T, n, 3, 3) of the links, the product of the rotations of their joints."""
    turns = [Rotation.from_rotvec(np.pad(part, ((0, 0), (0, 1)))) for part in np.split(q, q.shape[1] // 2, axis=1)]
    whole, listed = Rotation.identity(len(q)), []
    for turn in turns:
        whole = whole * turn
        listed.append(whole.as_matrix())
    return np.stack(listed, axis=1)


def tips(q: np.ndarray, model: Model) -> np.ndarray:
    """Positions (T, 3) [m] of the last link's end."""
    ends = frames(q)[..., 2] * model.link_length[:, None]
    return np.array([0.0, 0.0, model.base_length]) + ends.sum(axis=1)


def measured(seconds: float = 3.0, noise: float = 2e-3, seed: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (T,) [s], accelerations (T, 2, 3) [g] of the sensors of both stations, and positions (T, 3) [m] of the tip,
    from rest.
    """
    model = arm()
    columns = np.array(model.actuation.columns)
    times = np.arange(0.0, seconds, 0.02)
    q = Pushed(model, lambda t: MOMENT * pressures(t) @ columns).swings(times, equilibrium(model))
    gravity = np.einsum("tnij,i->tnj", frames(q)[:, [p.link for p in model.points]], DOWN)
    up = -gravity @ AXES + noise * np.random.default_rng(seed).standard_normal(gravity.shape)
    return times, up, tips(q, model)


def table(path: Path, times: np.ndarray, up: np.ndarray) -> Path:
    """A table of accelerations and pressures, as a logger writes it."""
    kpa = 1e-3 * pressures(times)
    names = ["t_s", *(f"a{axis}_{who}_g" for who in ("mid", "tip") for axis in "xyz"), "left_kPa", "right_kPa"]
    rows = np.column_stack([times, up.reshape(len(times), -1), kpa])
    path.write_text(",".join(names) + "\n" + "\n".join(",".join(f"{v:.6f}" for v in row) for row in rows) + "\n")
    return path
