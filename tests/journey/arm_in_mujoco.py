"""A soft arm in MuJoCo: twelve rods on ball joints that hang from a plate, moved by a chamber or by three tendons.

Nothing of pliant computes these motions. The torque of the chamber grows a little faster than the pressure; tendons are
drawn in by a tension or by a displacement, and run slack where they are pushed. Positions and rotations are in the base
frame (z along the body, gravity along +z); `in_room` turns them into the axes of a tracker.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'pliant[bench]'")

Array = np.ndarray
LENGTH, MASS, RADIUS, RODS = 0.2, 0.06, 0.012, 12  # m, kg, m
BENDING, LOSS = 0.0138, 8e-3  # N m^2; s, damping of a joint over its stiffness
MOMENT, GROWTH = 1.25, 0.15  # N m/MPa of the chamber at low pressure; its rise at the working pressure
WORKING = 6e4  # Pa
LEVER, LINE = 8e-3, 4e3  # m, N/m of a tendon
TOWARDS = np.radians([90.0, 210.0, 330.0])  # azimuths of the tendons
PLANE = np.radians(35.0)  # azimuth towards which the chamber bends the body
ROOM = Rotation.from_euler("ZYX", [40.0, 0.0, 180.0], degrees=True)  # of the base in the tracker, whose z points up
ORIGIN = np.array([0.412, -0.135, 1.287])  # m
DOWN = ROOM.apply([0.0, 0.0, 9.81])


class Motion(NamedTuple):
    """Times (T,) [s], inputs (T, C), positions (T, 13, 3) [m] of base, joints' segments' ends, rotations (T, 13)."""

    time: Array
    inputs: Array
    position: Array
    rotation: Array  # quaternions x, y, z, w

    def at(self, *places: float) -> Array:
        """Positions (T, S, 3) at fractions of the length, which are multiples of a twelfth."""
        return self.position[:, [round(RODS * place) for place in places]]

    def turn(self, place: float) -> Rotation:
        """Rotation of the body at a fraction of its length, relative to the base."""
        return Rotation.from_quat(self.rotation[:, round(RODS * place)])

    def thinned(self, rows: Array) -> Motion:
        """The same motion at some of its times."""
        return Motion(*(values[rows] for values in self))


def xml() -> str:
    """The arm: each segment bends in its middle; the base carries half a segment, the last rod ends the body."""
    segment, mass = LENGTH / RODS, MASS / RODS
    stiffness, body = BENDING / segment, ""
    for k in reversed(range(RODS)):
        length = segment if k < RODS - 1 else segment / 2
        m = mass * length / segment
        across, along = m * (length**2 / 12 + RADIUS**2 / 4), 0.5 * m * RADIUS**2
        body = (
            f'<body pos="0 0 {segment if k else segment / 2}"><joint type="ball" stiffness="{stiffness}" '
            f'damping="{LOSS * stiffness}"/><inertial pos="0 0 {length / 2}" mass="{m}" '
            f'diaginertia="{across} {across} {along}"/>{body}</body>'
        )
    return (f'<mujoco><option gravity="0 0 9.81" timestep="0.001" integrator="implicitfast"/>'
            f"<worldbody>{body}</worldbody></mujoco>")  # fmt: skip


def moment(pressure: Array) -> Array:
    """Moment (..., 2) [N m] about x and y of every joint, by the pressure [Pa] of the chamber."""
    size = 1e-6 * MOMENT * pressure * (1.0 + GROWTH * pressure / WORKING)
    return np.multiply.outer(size, [-np.sin(PLANE), np.cos(PLANE)])


def pulled(tension: Array) -> Array:
    """Moment (..., 2) [N m] about x and y of every joint, by the tensions (..., 3) [N]."""
    return LEVER * np.stack([-tension @ np.sin(TOWARDS), tension @ np.cos(TOWARDS)], axis=-1)


def drawn(displacement: Array, bend: Array, pretension: float) -> Array:
    """Tensions (3,) [N] of tendons drawn in by displacements [m] on a body with the total bends (2,) about x and y."""
    shorter = LEVER * (bend[1] * np.cos(TOWARDS) - bend[0] * np.sin(TOWARDS))
    return np.clip(pretension + LINE * (displacement - shorter), 0.0, None)


def simulated(torque: Callable[[float, Array], Array], duration: float, rate: float, slow: bool = False) -> Motion:
    """The motion from rest under moments (2,) [N m] of every joint, by time and total bends (2,)."""
    model = mujoco.MjModel.from_xml_string(xml())
    data, frames, every = mujoco.MjData(model), [], round(1e3 / rate)
    if slow:
        model.dof_damping[:] = 10.0 * model.jnt_stiffness[0] * 0.02
        model.opt.timestep = 5e-3
    for k in range(round(1e3 * duration) + 1):
        if k % every == 0:
            mujoco.mj_kinematics(model, data)
            frames.append((data.xpos.copy(), data.xquat.copy(), 1e-3 * k))
        q = data.qpos.reshape(RODS, 4)
        bend = 2.0 * (q[:, 1:3] * np.sign(q[:, :1])).sum(axis=0)  # small turns of twelve joints
        data.qfrc_applied.reshape(RODS, 3)[:, :2] = torque(1e-3 * k, bend)
        mujoco.mj_step(model, data)
    where, turn, time = (np.array(part) for part in zip(*frames, strict=True))
    turned = Rotation.from_quat(turn[:, 1:].reshape(-1, 4)[:, [1, 2, 3, 0]])
    half = turned.apply([0.0, 0.0, LENGTH / RODS / 2]).reshape(len(time), RODS, 3)
    ends = np.concatenate([np.zeros((len(time), 1, 3)), where[:, 1:] + half], axis=1)
    quaternions = np.concatenate([np.tile([0.0, 0.0, 0.0, 1.0], (len(time), 1, 1)),
                                  turned.as_quat().reshape(len(time), RODS, 4)], axis=1)  # fmt: skip
    return Motion(time, np.zeros((len(time), 1)), ends, quaternions)


def lagged(edges: tuple[tuple[float, float], ...], time: Array, lag: float = 0.03) -> Array:
    """A level that follows steps to (time, level) behind a first-order lag."""
    value, before = np.zeros_like(time), 0.0
    for begin, level in edges:
        value += np.where(time > begin, (level - before) * -np.expm1(-np.clip(time - begin, 0.0, None) / lag), 0.0)
        before = level
    return value


@cache
def pushed(edges: tuple[tuple[float, float], ...], duration: float = 3.0, rate: float = 50.0) -> Motion:
    """The motion under pressures [Pa] of the chamber; `inputs` holds the pressure (T, 1)."""
    fine = np.arange(0.0, duration + 2e-3, 1e-3)
    torques = moment(lagged(edges, fine))
    motion = simulated(lambda t, _: torques[round(1e3 * t)], duration, rate)
    return motion._replace(inputs=lagged(edges, motion.time)[:, None])


@cache
def tugged(edges: tuple[tuple[float, float], ...], duration: float = 3.0, rate: float = 50.0) -> Motion:
    """The motion under displacements [m] of the first tendon, the others slack; `inputs` holds them (T, 1)."""
    fine = np.arange(0.0, duration + 2e-3, 1e-3)
    first = lagged(edges, fine)

    def torque(t: float, bend: Array) -> Array:
        return pulled(drawn(np.array([first[round(1e3 * t)], -1.0, -1.0]), bend, 0.0))

    return simulated(torque, duration, rate)._replace(inputs=lagged(edges, fine)[:: round(1e3 / rate)][:, None])


@cache
def settled(inputs: tuple[tuple[float, float, float], ...], displaced: bool = False) -> Motion:
    """One pose for each row of tensions [N], or of displacements [m] of pretensioned tendons."""
    poses = []
    for row in np.array(inputs):
        torque = partial(holding, row, displaced)
        poses.append(simulated(torque, 0.4, 2.5, slow=True).thinned(np.array([-1])))
    _, _, position, rotation = (np.concatenate(part) for part in zip(*poses, strict=True))
    return Motion(np.arange(float(len(poses))), np.array(inputs), position, rotation)


def holding(row: Array, displaced: bool, _: float, bend: Array) -> Array:
    """Moments (2,) [N m] of every joint under constant tensions [N], or displacements [m]."""
    return pulled(drawn(row, bend, 1.0) if displaced else row)


def in_room(points: Array, noise: float = 0.0, seed: int = 0) -> Array:
    """Points (..., 3) [m] of the base frame in the tracker's axes, with white noise [m]."""
    turned = ROOM.apply(points.reshape(-1, 3)).reshape(points.shape) + ORIGIN
    return turned + noise * np.random.default_rng(seed).standard_normal(points.shape)


def in_room_turned(turn: Rotation, noise_deg: float = 0.2, seed: int = 0) -> Array:
    """Quaternions (T, 4), x y z w, of rotations relative to the base in the tracker's axes, with white noise."""
    error = np.radians(noise_deg) * np.random.default_rng(seed).standard_normal((len(turn), 3))
    return np.asarray((ROOM * turn * Rotation.from_rotvec(error)).as_quat())
