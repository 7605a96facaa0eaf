"""Simulation of the observed points of one experiment of a fit, also with exact derivatives by dual numbers."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from pliant.compiler.choose import dual_twin, twin
from pliant.equations.memory import follow_change
from pliant.equations.symbols import ExtensibleHeld, Past, SpatialBody
from pliant.identification import follow_loops
from pliant.identification.follow_loops import Before, Course, Seen
from pliant.identification.loop_inputs import ForwardProblem, Numbers
from pliant.identification.observation import (
    TINY,
    NumberKind,
    behind_sensors,
    in_kind,
    places_of,
)
from pliant.identification.poses import pose_rows
from pliant.mechanics import mechanics_of
from pliant.mechanics.complex_slopes import of_kind
from pliant.mechanics.lengths import check_lengths
from pliant.simulation import state
from pliant.simulation.drive import too_fast

Array = np.ndarray


REAL = NumberKind(partial(of_kind, kind=float), lambda a: a, twin)


def dual_kind() -> NumberKind:
    """Return dual numbers as a number type for the compiled loops, with functions that convert floats to them and back,
    and that compile a loop for them.
    """
    from pliant.compiler.duals import duals  # loads the compiler

    return NumberKind(duals, lambda a: a[..., 0], dual_twin)


def observed_rows(forward: ForwardProblem, numbers: Numbers, rows: int) -> Array:
    """Simulate one experiment of a fit, and return the coordinates (T, S, 3) of S observed points in T frames: x [m], y
    [m], angle [rad]; in space x, y, z [m].

    Raises
    ------
    SimulationError
        Where a link turns by more than a radian in one step, or a pose finds no rest.
    """
    if forward.poses:
        return pose_rows(forward, numbers)
    out = integrated_rows(forward, in_kind(numbers, REAL), REAL, rows)
    return out if forward.between is None else behind_sensors(out, forward.between, numbers.sensor_lag)


def observed_slopes(forward: ForwardProblem, numbers: Numbers, rows: int, count: int) -> Array:
    """Simulate with dual numbers, and return the derivatives (count, T, S, 3) of positions and angles of S observed
    points in T frames with respect to `count` parameters.
    """
    out = integrated_rows(forward, numbers, dual_kind(), rows)
    value, slopes = out[..., 0], np.moveaxis(out[..., out.shape[-1] // 2 :][..., :count], -1, 0)
    if forward.between is None:
        return slopes
    lag = numbers.sensor_lag
    tilted = zip(slopes, lag[:, lag.shape[-1] // 2 :].T, strict=False)
    return np.stack([
        behind_sensors(value + 1j * TINY * rate, forward.between, lag[:, 0] + 1j * TINY * late).imag / TINY
        for rate, late in tilted
    ])


def integrated_rows(forward: ForwardProblem, numbers: Numbers, kind: NumberKind, rows: int) -> Array:
    """Simulate an experiment with float or dual numbers. Return positions and angles (T, S, 3) of S observed points at
    T output times, before the lag of the sensors is applied.
    """
    model, chain = forward.model, mechanics_of(forward.model)
    numbers = with_own_spin(numbers, kind)
    check_lengths(chain, x=kind.value(numbers.phi), torque=kind.value(numbers.gain))
    rows = rows if forward.between is None else forward.between[0].size
    work = in_kind(chain.workspace(), kind)
    points = places_of(forward, numbers, kind)
    out: Array = kind.of(np.zeros((rows, forward.carrier.size, 3)))
    course = Course(numbers.h, numbers.torque, numbers.gain, forward.keep, numbers.load, numbers.base)
    before = Before(forward.still, numbers.held, numbers.held_base)
    past: tuple[Past, ...] = ()
    if model.memory:
        states, held = initial_hysteresis(forward, numbers, kind), hysteresis_workspace(forward, numbers.joints, kind)
        past = (Past(numbers.memory, states, held),)
    failed = kind.twin(follow_loops.follow, *chain.sizes)(
        numbers.phi, numbers.rate, course, before, (numbers.body, numbers.joints), work,
        Seen(points, out), *past,
    )
    if failed >= 0:
        h, phi = kind.value(numbers.h), kind.value(numbers.phi)
        raise too_fast(float(np.sum(h[: failed + 1])), float(h[failed]), state.given_way(model, phi))
    return out


def with_own_spin(numbers: Numbers, kind: NumberKind) -> Numbers:
    """Return the simulation inputs with arrays of their own for the spin of a moving base, which the loop writes to."""
    if not len(numbers.base):
        return numbers
    if isinstance(numbers.body, SpatialBody):
        return numbers._replace(body=numbers.body._replace(spin=kind.of(np.zeros((2, 3)))))
    return numbers._replace(joints=numbers.joints._replace(spin=kind.of(np.zeros(2))))


def initial_hysteresis(forward: ForwardProblem, numbers: Numbers, kind: NumberKind) -> Array:
    """Return the hysteresis states at the start of a simulation: zero or, for a body that was pulled to its held pose,
    those after the pull.
    """
    states: Array = kind.of(state.relaxed(forward.model, np.zeros(forward.model.size)))
    if not forward.pulled:
        return states
    if mechanics_of(forward.model).dimension == 3:
        return initial_hysteresis_in_space(forward, numbers, kind, states)
    previous = numbers.joints.base_angle
    for i in range(forward.model.n):
        q, previous = numbers.phi[i] - previous - numbers.joints.theta0[i], numbers.phi[i]
        for j, limit in enumerate(numbers.memory.slip_angle, len(forward.model.memory.creep_share)):
            turn = float(kind.value(q))
            states[i, j] = np.sign(turn) * limit if abs(turn) > kind.value(limit) else q
    return states


def initial_hysteresis_in_space(forward: ForwardProblem, numbers: Numbers, kind: NumberKind, states: Array) -> Array:
    """Return the hysteresis states at the start of a simulation in space, for a body that was pulled straight from its
    unloaded to its held pose.
    """
    workspace = hysteresis_workspace(forward, numbers.joints, kind)
    past = Past(numbers.memory._replace(boucwen_share=kind.of(0.0)), states, workspace)
    straight: Array = kind.of(np.zeros(forward.model.size))
    kind.twin(follow_change, *mechanics_of(forward.model).sizes)(straight, numbers.phi, numbers.joints, past)
    return states


def hysteresis_workspace(forward: ForwardProblem, joints: Any, kind: NumberKind) -> Any:
    """Return scratch arrays, of floats or dual numbers, for time steps of a chain with hysteresis or creep."""
    workspace = mechanics_of(forward.model).held()
    rows = {name: kind.of(row) for name, row in workspace._asdict().items() if name != "springs"}
    if mechanics_of(forward.model).dimension == 3:
        turned_rest = kind.of(np.zeros(forward.model.size))
        return type(workspace)(springs=joints._replace(theta0=turned_rest, line=rows["line"]), **rows)
    rows["K"][:] = joints.K  # with axial ones: the step writes those of the joints alone
    springs = joints._replace(theta0=rows["theta0"], K=rows["K"])
    if isinstance(workspace, ExtensibleHeld):
        springs = springs._replace(rest=rows["rest"])
    return type(workspace)(springs=springs, **rows)
