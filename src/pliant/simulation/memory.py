"""Hysteresis states of a simulation: the first ones, and their conversion to dataset variables."""

from __future__ import annotations

import numpy as np

from pliant.equations import memory as kernels
from pliant.equations.symbols import MemoryLaw
from pliant.errors import InputError
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.simulation import state

Array = np.ndarray
Entry = tuple[tuple[str, ...], Array]


def first_states(model: Model, q0: Array, given: Array | None) -> Array:
    """Return the initial hysteresis states: those `given` or, if None, those in equilibrium at the N joint coordinates
    q0 (N,).
    """
    rest = state.relaxed(model, q0)
    if given is None:
        return rest
    shape = (len(rest), max(len(model.memory.labels), len(model.memory.axial.labels)))
    states = np.asarray(given, dtype=float)
    if states.shape != shape:
        rows = "joint and segment" if model.memory.has_axial else "joint"
        raise InputError(
            f"initial_memory must be angles of shape ({rows}, memory) = {shape}, got shape {states.shape}"
        )
    if bad := int((~np.isfinite(states)).sum()):
        raise InputError(f"initial_memory must be finite, but {bad} of its {states.size} angles are not: correct them")
    rest[:, : shape[1]] = states
    return rest


def laws_of(model: Model) -> list[MemoryLaw]:
    """Return the hysteresis law of every coordinate that has hysteresis, first of the joints, then of the extensible
    segments.
    """
    joints, axial, segments = model.memory.law(), model.memory.axial.law(), len(model.extensions)
    rows = mechanics_of(model).remembering
    return [axial if i >= model.size - segments else joints for i in range(rows)]


def memory_energy(model: Model, x: Array, states: Array) -> Array:
    """Return the energy (T,) [J] that hysteresis branches hold at T instants."""
    chain = mechanics_of(model)
    rows = chain.remembering
    q, moved = chain.joint_coordinates(x)[:, :rows], np.moveaxis(states, 0, -1)  # (rows, branches, T)
    stored = [kernels.memory_stored(i, q[:, i], moved, law) for i, law in enumerate(laws_of(model))]
    return np.asarray(np.stack(stored, axis=1) @ chain.joints.K[:rows])


def torques(model: Model, x: Array, states: Array) -> Array:
    """Return the torques [N m] of hysteresis against the bend, (T, m) of the first m coordinates at T instants."""
    chain = mechanics_of(model)
    rows = chain.remembering
    q, moved = chain.joint_coordinates(x)[:, :rows], np.moveaxis(states, 0, -1)  # (rows, branches, T) for the kernels
    laws = laws_of(model)
    angle = np.stack([kernels.memory_angle(i, q[:, i], moved, laws[i]) for i in range(rows)], axis=1)
    return np.asarray(chain.joints.K[:rows] * angle)


def outputs(model: Model, x: Array, states: Array) -> dict[str, Entry]:
    """Return dataset variables, by name, for hysteresis states and torque; {} for a chain without hysteresis."""
    if not model.memory:
        return {}
    chain = mechanics_of(model)
    torque = torques(model, x, states)
    values: dict[str, Entry] = {}
    for kind in chain.kinds:
        if kind.over == "joint":
            axis = kind.names[0].removeprefix("joint_angle")  # "" in a plane
            values["memory_state" + axis] = (
                ("time", "joint", "memory"), states[:, kind.rows, : len(model.memory.labels)],
            )
            values["memory_torque" + axis] = (("time", "joint"), torque[:, kind.rows])
        elif model.memory.has_axial:
            labels = model.memory.axial.labels
            values["axial_memory_state"] = (("time", "segment", "axial_memory"), states[:, kind.rows, : len(labels)])
            values["axial_memory_force"] = (("time", "segment"), torque[:, kind.rows] / model.segment_length)
    return values
