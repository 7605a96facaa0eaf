"""Simulation of chains with hysteresis, and conversion of their hysteresis states to dataset variables."""

from __future__ import annotations

import numpy as np

from pliant.compiler.choose import twin
from pliant.equations import memory as kernels
from pliant.equations.symbols import MemoryLaw, Past
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
    """Integrate a chain with hysteresis over the steps `plan`; return coordinates, rates, energies and hysteresis
    states.

    Coordinates and rates are (rows, N). Energies (rows, 3) [J] are input work, loss of the dampers and loss of
    hysteresis. States are (rows, m, branches). For a model without hysteresis the result equals, bit for bit, that of
    the loop without hysteresis.
    """
    out = march_loops.rows_for(rows, model.size, states.shape, 3)
    out.phi[0], out.w[0], out.state[0] = *start, states
    now, past = start[0].copy(), Past(model.memory.law(), states.copy(), mechanics_of(model).held())
    body, joints, work = mechanics_of(model).parts()
    failed = twin(march_loops.march_with_memory, *mechanics_of(model).sizes)(
        now, start[1].copy(), plan.steps, body, joints, past, work, out
    )
    if failed >= 0:
        raise too_fast(plan, failed, state.given_way(model, now))
    if failed < -1:
        raise SimulationError(
            f"{plan.h[: -1 - failed].sum():.6g} s after the start the iteration for slip elements does not converge "
            f"within a step of {plan.h[-2 - failed] * 1e3:.3g} ms; use a shorter step"
        )
    return out.phi, out.w, out.energy, out.state


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


def outputs(model: Model, x: Array, states: Array, loss: Array) -> dict[str, Entry]:
    """Return dataset variables, by name, for hysteresis states, torque and energies; {} for a chain
    without hysteresis.
    """
    if not model.memory:
        return {}
    chain = mechanics_of(model)
    rows = chain.remembering
    q, K = chain.joint_coordinates(x)[:, :rows], chain.joints.K[:rows]
    moved = np.moveaxis(states, 0, -1)  # (rows, branches, T), as the kernels index
    laws = laws_of(model)
    angle = np.stack([kernels.memory_angle(i, q[:, i], moved, laws[i]) for i in range(rows)], axis=1)
    stored = np.stack([kernels.memory_stored(i, q[:, i], moved, laws[i]) for i in range(rows)], axis=1)
    values: dict[str, Entry] = {}
    for kind in chain.kinds:
        if kind.over == "joint":
            axis = kind.names[0].removeprefix("joint_angle")  # "" in a plane
            values["memory_state" + axis] = (
                ("time", "joint", "memory"), states[:, kind.rows, : len(model.memory.labels)],
            )
            values["memory_torque" + axis] = (("time", "joint"), (K * angle)[:, kind.rows])
        elif model.memory.has_axial:
            labels = model.memory.axial.labels
            values["axial_memory_state"] = (("time", "segment", "axial_memory"), states[:, kind.rows, : len(labels)])
            values["axial_memory_force"] = (("time", "segment"), (K * angle)[:, kind.rows] / model.segment_length)
    return values | {"memory_energy": (("time",), stored @ K), "memory_dissipation": (("time",), loss)}
