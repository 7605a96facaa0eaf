"""Force and moment at a moving base, as variables of a simulated motion."""

from __future__ import annotations

import numpy as np

from pliant.mechanics import mechanics_of
from pliant.mechanics.reaction import BaseTwist, accelerations
from pliant.simulation import memory
from pliant.simulation.base_motion import inward
from pliant.simulation.drive import Drive
from pliant.simulation.forces import at_time, link_loads, station_of
from pliant.simulation.initial_value import InitialValueProblem, Marched

Array = np.ndarray
Entry = tuple[tuple[str, ...], Array]


def base_variables(problem: InitialValueProblem, marched: Marched, plan: Drive) -> dict[str, Entry]:
    """Return pose, force and moment of a moving base at T output times as dataset variables; {} for a base at rest.

    The force acts on the body, the moment about the base frame's origin, both in the axes of the moved base. They
    follow from the accelerations of the links under the inputs, whose value at an output time is the mean of the steps
    before and after it.
    """
    if problem.base is None:
        return {}
    chain, (x, v, _, states) = mechanics_of(problem.model), marched
    pose = problem.base.at(problem.times)
    twist = BaseTwist(
        inward(pose.axes, problem.model.gravity), inward(pose.axes, pose.velocity),
        inward(pose.axes, pose.acceleration), *((pose.rate, pose.turning) if chain.dimension == 2 else
                                                (inward(pose.axes, pose.rate), inward(pose.axes, pose.turning))),
    )  # fmt: skip
    torque = torques_at(plan, len(x))
    if problem.model.memory:
        torque[:, : chain.remembering] -= memory.torques(problem.model, x, states)
    pulls = [at_time(force, problem.times) for force in problem.forces]
    if pulls:
        loads = link_loads(problem.model, problem.forces, np.stack(pulls, axis=1))
        pushed = np.array([chain.load_forces(*pair) for pair in zip(x, loads, strict=True)])
        torque[:, : chain.size] += pushed @ chain.from_joints
    force, moment = chain.reaction(x, v, accelerations(chain, x, v, torque, twist), twist)
    for pull, given in zip(pulls, problem.forces, strict=True):
        point = mechanics_of(problem.model.with_(stations=(station_of(problem.model, given),))).stations(x)[0][:, 0]
        turned = np.cross(in_space(point), in_space(pull))[:, -moment.shape[1] :]
        force, moment = force - pull, moment - turned
    turn: dict[str, Entry] = {"base_angle": (("time",), pose.angle)} if chain.dimension == 2 else {
        "base_axes": (("time", "axis", "base_axis"), pose.axes)}  # fmt: skip
    return {
        "base_position": (("time", "axis"), pose.position), **turn, "base_force": (("time", "axis"), force),
        "base_moment": (("time",), moment[:, 0]) if chain.dimension == 2 else (("time", "axis"), moment),
    }


def in_space(vectors: Array) -> Array:
    """Return vectors (T, 2 or 3) as vectors in space (T, 3)."""
    return np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))


def torques_at(plan: Drive, rows: int) -> Array:
    """Return the torques of joints and inputs of tendons (T, N + R) at T output times: the mean of the steps before and
    after each.
    """
    mean = plan.joint_torque
    ends = np.append(-1, np.flatnonzero(plan.keep >= 0))[:rows]
    last = len(mean) - 1
    return np.asarray(0.5 * (mean[np.maximum(ends, 0)] + mean[np.minimum(ends + 1, last)]))
