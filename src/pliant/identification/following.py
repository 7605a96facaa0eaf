"""Simulation of a forward problem at its observed points, on floats and on dual numbers with derivatives."""

from __future__ import annotations

from typing import Any

import numpy as np

from pliant.compiler.choose import twin
from pliant.equations import spatial_memory
from pliant.equations.symbols import ExtensibleHeld, MemoryLaw, Past
from pliant.errors import SimulationError
from pliant.identification import follow_loops
from pliant.identification.follow_loops import Before, Course, Seen
from pliant.identification.loop_inputs import Numbers, SetUp
from pliant.identification.observation_kind import (
    TINY,
    ObservationKind,
    copied,
    in_kind,
    places_in_plane,
    places_in_space,
)
from pliant.identification.poses import pose_rows
from pliant.identification.sensor import behind_sensors
from pliant.mechanics import mechanics_of
from pliant.simulation import state

Array = np.ndarray


REAL = ObservationKind(copied, lambda a: a, twin)


def dual_kind() -> ObservationKind:
    """Return the number kind of dual numbers (`pliant.compiler.duals`) for the compiled loops."""
    from pliant.compiler.duals import dual_twin, duals  # loads the compiler

    return ObservationKind(duals, lambda a: a[..., 0], dual_twin)


def moved(made: SetUp, numbers: Numbers, rows: int) -> Array:
    """Simulate a forward problem and return the observed rows (T, S, 3): x [m], y [m], angle [rad]; x, y, z in space.

    Raises
    ------
    SimulationError
        Where a link turns by more than a radian in one step, or a pose finds no rest.
    """
    if made.poses:
        return pose_rows(made, numbers)
    out = followed(made, in_kind(numbers, REAL), REAL, rows)
    return out if made.between is None else behind_sensors(out, made.between, numbers.sensor_lag)


def moved_slopes(made: SetUp, numbers: Numbers, rows: int, count: int) -> Array:
    """Return the first `count` derivatives (count, T, S, 3) of `moved` that the dual `numbers` carry."""
    out = followed(made, numbers, dual_kind(), rows)
    value, slopes = out[..., 0], np.moveaxis(out[..., out.shape[-1] // 2 :][..., :count], -1, 0)
    if made.between is None:
        return slopes
    lag = numbers.sensor_lag
    tilted = zip(slopes, lag[:, lag.shape[-1] // 2 :].T, strict=False)
    return np.stack([
        behind_sensors(value + 1j * TINY * rate, made.between, lag[:, 0] + 1j * TINY * late).imag / TINY
        for rate, late in tilted
    ])


def followed(made: SetUp, numbers: Numbers, kind: ObservationKind, rows: int) -> Array:
    """Simulate a forward problem with float or dual numbers; return the observed rows (T, S, 3) before sensor lag."""
    model, chain = made.model, mechanics_of(made.model)
    n, *more = chain.sizes
    rows = rows if made.between is None else made.between[0].size
    work = in_kind(chain.workspace(), kind)
    places = places_in_space(made, numbers, kind) if chain.dimension == 3 else places_in_plane(made, numbers, kind)
    out: Array = kind.of(np.zeros((rows, made.carrier.size, 3)))
    course = Course(numbers.h, numbers.torque, numbers.gain, made.keep, numbers.load)
    before = Before(made.still, numbers.held, numbers.held_base)
    start = numbers.phi, kind.of(np.zeros(chain.size))
    if model.memory:
        past = Past(numbers.memory, slipped(made, numbers, kind), held_of(made, numbers.joints, kind))
        failed = kind.twin(follow_loops.follow_with_memory, n if any(more) else None, *more)(
            *start, course, before, (numbers.body, numbers.joints), past, work, Seen(places, out)
        )
    else:
        failed = kind.twin(follow_loops.follow, n, *more)(
            *start, course, before, numbers.body, numbers.joints, work, Seen(places, out)
        )
    if failed >= 0:
        h, phi = kind.value(numbers.h), kind.value(numbers.phi)
        raise lost(made, float(np.sum(h[: failed + 1])), float(h[failed]), phi)
    return out


def lost(made: SetUp, after: float, length: float, phi: Array) -> SimulationError:
    """Return the error for a step of `length` [s] that fails `after` [s], with the links at phi (n,)."""
    if gone := state.given_way(made.model, phi):
        return SimulationError(f"{after:.6g} s after the start {gone}")
    return SimulationError(
        f"{after:.6g} s after the start a link turns by more than a radian within the step of {length * 1e3:.3g} "
        "ms, faster than the step can follow; use a shorter step or a smaller pressure"
    )


def slipped(made: SetUp, numbers: Numbers, kind: ObservationKind) -> Array:
    """Return the hysteresis states at the start: zero, or those left by the pull into a measured pose."""
    states: Array = kind.of(state.relaxed(made.model, np.zeros(made.model.size)))
    if not made.pulled:
        return states
    if mechanics_of(made.model).dimension == 3:
        return slipped_in_space(made, numbers, kind, states)
    last = numbers.joints.base_angle
    for i in range(made.model.n):
        q, last = numbers.phi[i] - last - numbers.joints.theta0[i], numbers.phi[i]
        for j, limit in enumerate(numbers.memory.slip_angle, len(made.model.memory.creep_share)):
            turn = float(kind.value(q))
            states[i, j] = np.sign(turn) * limit if abs(turn) > kind.value(limit) else q
    return states


def slipped_in_space(made: SetUp, numbers: Numbers, kind: ObservationKind, states: Array) -> Array:
    """Return the result of `slipped` for a chain in space, pulled straight from its unloaded to the measured pose."""
    held = held_of(made, numbers.joints, kind)
    held.dq[:] = numbers.phi[: len(held.dq)]
    law = MemoryLaw(*numbers.memory)._replace(boucwen_share=kind.of(0.0))
    kind.twin(spatial_memory.remember, None)(kind.of(0.0), numbers.joints, Past(law, states, held))
    return states


def held_of(made: SetUp, joints: Any, kind: ObservationKind) -> Any:
    """Return scratch arrays, in float or dual numbers, for the time steps of a model with hysteresis or creep."""
    fresh = mechanics_of(made.model).held()
    rows = {name: kind.of(row) for name, row in fresh._asdict().items() if name != "springs"}
    if mechanics_of(made.model).dimension == 3:
        moved = kind.of(np.zeros(made.model.size))
        return type(fresh)(springs=joints._replace(theta0=moved, line=rows["line"]), **rows)
    rows["K"][:] = joints.K  # with axial ones: the step writes those of the joints alone
    seen = joints._replace(theta0=rows["theta0"], K=rows["K"])
    if isinstance(fresh, ExtensibleHeld):
        seen = seen._replace(rest=rows["rest"])
    return type(fresh)(springs=seen, **rows)
