"""Chains of pliant as a solver of the benchmark suite cosseratbench, which finds it by its entry point ``pliant``.

A rod becomes a chain of links in space with joints in the middle of its elements. Rods that are clamped or pinned at
their start and free at their end, with gravity and a load at the end, are simulated; other scenarios are refused.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from pliant.errors import InputError, SimulationError
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Model, Space
from pliant.simulation import Pulse, equilibrium, simulate
from pliant.simulation.forces import PointForce
from pliant.version import __version__

try:
    from cosseratbench.scenario import End, EndCondition, Rod, Scenario
    from cosseratbench.solver import Capability
    from cosseratbench.trajectory import Trajectory
except ImportError:
    raise InputError("cosseratbench is not installed: pip install cosseratbench") from None

Array = np.ndarray
LOOSE = 1e-9  # N m/rad, stiffness of the joint that stands for a pin
TIME_STEP = 1e-3  # s


@dataclass
class ChainSolver:
    """Solver of cosseratbench. Quasi-static scenarios end in the equilibrium, which is computed without time steps.

    Parameters
    ----------
    time_step_scale : float
        Factor of the time step of 1 ms.
    """

    time_step_scale: float = 1.0
    name: ClassVar[str] = "pliant"
    backend_version: ClassVar[str] = __version__
    capabilities: ClassVar[frozenset[Capability]] = frozenset()

    def settings(self, scenario: Scenario, *, n_elements: int, n_frames: int) -> dict[str, Any]:  # noqa: ARG002
        """Return the integrator and time step of a run, for the table of results."""
        if scenario.quasi_static:
            return {"integrator": "none: Newton's method for the equilibrium"}
        return {"integrator": "linearly implicit midpoint rule", "time_step": TIME_STEP * self.time_step_scale}

    def run(self, scenario: Scenario, *, n_elements: int, n_frames: int) -> Trajectory:
        """Return the motion of the rods of a scenario at `n_frames` times.

        Raises
        ------
        NotImplementedError
            When a rod has another support, or a load or motion elsewhere.
        FloatingPointError
            When a simulation fails.
        """
        times = np.linspace(0.0, scenario.duration, n_frames)
        try:
            rods = [self.rod_motion(scenario, rod, n_elements, times) for rod in scenario.rods]
        except SimulationError as error:
            raise FloatingPointError(str(error)) from error
        positions, directors = zip(*rods, strict=True)
        return Trajectory(times, tuple(positions), tuple(directors))

    def rod_motion(self, scenario: Scenario, rod: Rod, elements: int, times: Array) -> tuple[Array, Array]:
        """Return the nodes (T, elements + 1, 3) [m] and the material directions (T, elements, 3) of one rod."""
        check_rod(rod)
        model, frame = chain_of(rod, scenario.gravity, elements)
        start = angles_of(rod, frame, elements)
        load = frame.T @ np.sum([np.zeros(3), *(load.force for load in rod.loads)], axis=0)
        if scenario.quasi_static:
            x = np.tile(equilibrium(model, tip_force=load), (times.size, 1))
            x[0] = start
        else:
            forces = [PointForce(np.zeros(1), load[None], "tip")] if load.any() else []
            run = simulate(model, Pulse(0.0), times=times, time_step=TIME_STEP * self.time_step_scale,
                           initial_angle=start, forces=forces, check=False)  # fmt: skip
            x = np.empty((times.size, model.size))
            for kind in mechanics_of(model).kinds:
                x[:, kind.rows] = run[kind.names[0]].values
        return nodes_of(model, rod, frame, x)


def check_rod(rod: Rod) -> None:
    """Raise NotImplementedError for a rod that is no chain with a clamped or pinned start and a free end."""
    if rod.start is EndCondition.FREE or rod.end is not EndCondition.FREE:
        raise NotImplementedError("a rod whose start is free or whose end is held")
    if rod.start_motion is not None:
        raise NotImplementedError("a start that is moved")
    if any(load.at is not End.END for load in rod.loads):
        raise NotImplementedError("a load at the start")


def chain_of(rod: Rod, gravity: Any, elements: int) -> tuple[Model, Array]:
    """Return the chain of a rod, with joints in the middle of its elements, and the frame (3, 3) of its base.

    The frame's columns are the material direction of the first element, the direction across, and the tangent. A pinned
    rod has a loose joint at its base.
    """
    h, pinned = rod.length / elements, rod.start is EndCondition.PINNED
    length = np.full(elements, h)
    length[-1] = 0.5 * h
    stiffness = np.full(elements, rod.material.youngs_modulus * rod.second_moment_of_area / h)
    if pinned:
        length, stiffness = np.insert(length, 0, 0.5 * h), np.insert(stiffness, 0, LOOSE)
    frame = frames_of(rod, elements)[0]
    ratio = 2.0 * rod.material.shear_modulus / rod.material.youngs_modulus  # GJ / EI of a circular section
    model = Model(
        link_length=length, link_mass=rod.material.density * rod.area * length, stiffness=stiffness, damping=0.0,
        base_length=0.0 if pinned else 0.5 * h, gravity=tuple(frame.T @ np.asarray(gravity)),
        chambers=[Chamber(np.zeros(1))], space=Space(twist_ratio=ratio, radius=rod.radius), name="rod",
    )  # fmt: skip
    return model, frame


def frames_of(rod: Rod, elements: int) -> Array:
    """Return the initial frames (elements, 3, 3) of a rod's elements: direction, across, tangent as columns."""
    tangent = np.diff(rod.nodes(elements), axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    direction = rod.directors(elements)
    return np.stack([direction, np.cross(tangent, direction), tangent], axis=-1)


def angles_of(rod: Rod, frame: Array, elements: int) -> Array:
    """Return the coordinates (N,) [rad] of the chain in the initial shape of its rod, which has no twist."""
    from scipy.spatial.transform import Rotation

    tangent = frames_of(rod, elements)[:, :, 2] @ frame
    half = np.concatenate([tangent[:1], tangent[:-1] + tangent[1:], tangent[-1:]])  # of the links about each node
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    first, links = (0, half) if rod.start is EndCondition.PINNED else (1, half[1:])
    before, swings = np.eye(3) if first == 0 else turned(np.eye(3), half[0]), []
    for direction in links:
        after = turned(before, direction)
        swings.append(Rotation.from_matrix(before.T @ after).as_rotvec()[:2])
        before = after
    return np.concatenate([np.ravel(swings), np.zeros(len(swings))])


def turned(frame: Array, tangent: Array) -> Array:
    """Return the frame (3, 3) turned by the smallest rotation that takes its last axis to the unit vector `tangent`."""
    from scipy.spatial.transform import Rotation

    axis, cosine = np.cross(frame[:, 2], tangent), float(frame[:, 2] @ tangent)
    sine = float(np.linalg.norm(axis))
    vector = axis * (np.arctan2(sine, cosine) / sine) if sine > 0.0 else 0.0 * axis
    return np.asarray(Rotation.from_rotvec(vector).as_matrix() @ frame)


def nodes_of(model: Model, rod: Rod, frame: Array, x: Array) -> tuple[Array, Array]:
    """Return the nodes (T, elements + 1, 3) [m] and the material directions (T, elements, 3) of a rod whose chain has
    the coordinates x (T, N), in the frame of the scenario.
    """
    chain = mechanics_of(model)
    joints, R = chain.nodes(x), chain.link_frames(x)
    if rod.start is EndCondition.PINNED:  # its first joint is the origin, and its base part has no length
        joints, R = joints[:, 1:], R[:, 1:]
    nodes = np.concatenate([joints[:, :1], 0.5 * (joints[:, 1:-2] + joints[:, 2:-1]), joints[:, -1:]], axis=1)
    across = R[:, :-1, :, 0] + R[:, 1:, :, 0]
    tangent = np.diff(nodes, axis=1)
    tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
    across -= np.sum(across * tangent, axis=-1, keepdims=True) * tangent
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    return rod.nodes(1)[0] + nodes @ frame.T, across @ frame.T
