"""Chains that remember: their march, and the outputs of their hysteresis states."""

from __future__ import annotations

import numpy as np

from pliant.compiler.choose import twin
from pliant.equations import memory as kernels
from pliant.equations.symbols import Past
from pliant.errors import InputError, SimulationError
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.simulation import march_loops, state
from pliant.simulation.drive import Drive, too_fast

Array = np.ndarray
Entry = tuple[tuple[str, ...], Array]


def march_with_memory(
    model: Model, plan: Drive, start: tuple[Array, Array], states: Array, rows: int,
) -> tuple[Array, Array, Array, Array]:
    """Absolute angles and rates (rows, n), work and losses (rows, 3), states of the memory (rows, n, branches).

    The losses are those of the dampers, then those of the memory. A model without memory gives, bit for bit, what the
    march without memory gives.
    """
    out = march_loops.rows_for(rows, model.size, states.shape, 3)
    out.phi[0], out.w[0], out.state[0] = *start, states
    now, past = start[0].copy(), Past(model.memory.law(), states.copy(), state.held(model))
    body, joints, work = mechanics_of(model).parts()
    failed = twin(march_loops.march_with_memory, model.n, len(model.extensions))(
        now, start[1].copy(), plan.steps, body, joints, past, work, out
    )
    if failed >= 0:
        raise too_fast(plan, failed, state.given_way(model, now))
    if failed < -1:
        raise SimulationError(
            f"{plan.h[: -1 - failed].sum():.6g} s after the start the slip elements find no agreement with the motion "
            f"within a step of {plan.h[-2 - failed] * 1e3:.3g} ms; use a shorter step"
        )
    return out.phi, out.w, out.energy, out.state


def first_states(model: Model, q0: Array, given: Array | None) -> Array:
    """States of the memory at the start: as given, else relaxed at the joint angles q0."""
    rest = state.relaxed(model, q0)
    if given is None:
        return rest
    shape = (model.n, len(model.memory.labels))
    states = np.asarray(given, dtype=float)
    if states.shape != shape or not np.isfinite(states).all():
        raise InputError(f"initial_memory must be finite angles (joint, memory) = {shape}, got shape {states.shape}")
    rest[:, : shape[1]] = states
    return rest


def outputs(model: Model, phi: Array, states: Array, loss: Array) -> dict[str, Entry]:
    """States, torque, stored and dissipated energy of the memory along a trajectory, with their dimensions."""
    if not model.memory:
        return {}
    q, law, K = mechanics_of(model).joint_angles(phi), model.memory.law(), model.stiffness
    moved = np.moveaxis(states, 0, -1)  # (n, branches, T), as the kernels index
    angle = np.stack([kernels.memory_angle(i, q[:, i], moved, law) for i in range(model.n)], axis=1)
    stored = np.stack([kernels.memory_stored(i, q[:, i], moved, law) for i in range(model.n)], axis=1)
    return {
        "memory_state": (("time", "joint", "memory"), states[..., : len(model.memory.labels)]),
        "memory_torque": (("time", "joint"), K * angle),
        "memory_energy": (("time",), stored @ K),
        "memory_dissipation": (("time",), loss),
    }
