"""Simulate the rod under a history of pressures and tip loads, or find its static equilibrium."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pliant.errors import InputError, SimulationError
from pliant.testbed.rod import RodBody, RodParameters, build_body, node_position, prony_decay

Array = np.ndarray
STATIC_STEP = 1e6  # s: a step so long that inertia, viscosity and relaxation have died out
CHUNK = 400  # steps between two calls of the progress callback


class RodState(NamedTuple):
    """State of the rod between two steps; the compiled loop changes it in place."""

    x: Array  # (V, 2) m
    x_before: Array
    v: Array  # (V, 2) m/s
    v_before: Array
    curvature: Array  # (B,) 1/m
    curvature_before: Array
    length: Array  # (E,) m
    length_before: Array
    prony: Array  # (B, P) inner curvature changes, 1/m
    slip: Array  # (B, J) N m
    chamber: Array  # (C, 2) m3 and m3/s


class StepClock(NamedTuple):
    """Constants of the time integration that depend on the length of a time step."""

    dt: float  # s
    h: float  # s, of the second-order backward difference
    per_h2: float  # 1/s2, factor of the accelerations; 0 for quasi-static steps
    decay: Array  # (P, 3) of the Prony branches, see `prony_decay`


class Span(NamedTuple):
    """Range of time steps to simulate, and the number of steps between two stored states."""

    first: int
    stop: int
    stride: int


class Work(NamedTuple):
    """Scratch arrays of the compiled time loop."""

    x: Array
    drift: Array
    force: Array
    gradient: Array
    step: Array
    band: Array
    torque: Array
    curvature: Array
    six: Array
    load: Array


class Out(NamedTuple):
    """Arrays into which the compiled time loop writes R states of the rod."""

    position: Array
    velocity: Array
    curvature: Array
    force: Array
    pressure: Array
    volume: Array
    energy: Array


@dataclass(frozen=True)
class RodMotion:
    """The simulated, true motion of the rod at R times, with V nodes, B bending vertices and C chambers.

    Attributes
    ----------
    time : (R,) s
    arc_length : (V,) m, of the nodes at rest
    position, velocity, force : (R, V, 2) m, m/s, N (force of the obstacles on the nodes)
    curvature : (R, B) 1/m, at the first B nodes
    pressure : (R,) Pa gauge, in the chamber; (R, C) for several chambers
    volume : (R,) or (R, C) m3, chamber volume minus that of the straight shape
    energy : (R, 5) J: kinetic, elastic, stored in Prony and slip elements, gravity, contact
    iterations : float, Newton iterations per step
    """

    time: Array
    arc_length: Array
    position: Array
    velocity: Array
    curvature: Array
    force: Array
    pressure: Array
    volume: Array
    energy: Array
    iterations: float


def rest_state(body: RodBody) -> RodState:
    """Return the rod at standstill in its stress-free shape."""
    turn = body.weight * body.rest_curvature
    angle = np.cumsum(turn)
    edge = body.rest_length[:, None] * np.column_stack([-np.sin(angle), np.cos(angle)])[: body.rest_length.size]
    x = np.vstack([np.zeros(2), np.cumsum(edge, axis=0)])
    b = body.weight.size
    now = [np.sum(gain * body.weight * body.rest_curvature * (1.0 + 0.5 * slope * body.rest_curvature))
           for gain, slope in zip(body.gain, body.gain_slope, strict=True)]  # fmt: skip
    return RodState(
        x, x.copy(), np.zeros_like(x), np.zeros_like(x), body.rest_curvature.copy(), body.rest_curvature.copy(),
        body.rest_length.copy(), body.rest_length.copy(), np.zeros((b, body.prony_share.size)),
        np.zeros((b, body.slip_limit.shape[1])), np.column_stack([now, np.zeros(len(now))]),
    )  # fmt: skip


def _work(body: RodBody) -> Work:
    edges, (chambers, vertices) = body.rest_length.size, body.gain.shape
    sizes = (2 * edges, 6), edges, vertices, 6, chambers + 3
    return Work(*np.zeros((3, edges + 1, 2)), *np.zeros((2, 2 * edges)), *map(np.zeros, sizes))


def _out(records: int, nodes: int, body: RodBody) -> Out:
    chambers, vertices = body.gain.shape
    shapes = (nodes, 2), (nodes, 2), (vertices,), (nodes, 2), (chambers,), (chambers,), (5,)
    return Out(*(np.zeros((records, *shape)) for shape in shapes))


def _clock(body: RodBody, time_step: float, *, static: bool) -> StepClock:
    h = 2.0 * time_step / 3.0
    return StepClock(float(time_step), h, 0.0 if static else 1.0 / h**2, prony_decay(body.prony_time, time_step))


def settle(
    p: RodParameters, loads: ArrayLike | None = None, *, obstacles: ArrayLike | None = None, increments: int = 40,
) -> RodState:
    """Compute the static equilibrium of the rod under constant loads, with all viscoelastic (Prony) branches relaxed.

    Parameters
    ----------
    p : RodParameters
    loads : (C + 3,) array, optional
        Pressure of each chamber (Pa), force on the pushed node (x and y, N), couple on the last edge (N m).
        Default: zero loads.
    obstacles : (O, 7) array, optional
        Rows of `pliant.testbed.scenarios.obstacle_rows`.
    increments : int
        Number of equal steps in which loads and gravity are applied.

    Raises
    ------
    InputError
        For loads that are not finite or not of length C + 3.
    SimulationError
        When an increment does not converge.
    """
    from pliant.compiler.choose import twin
    from pliant.testbed.stepping_loops import march

    body = build_body(p)
    whole = _loads(p, np.zeros((1, len(p.chambers) + 3)) if loads is None else [loads])
    state = rest_state(body)
    work = _work(body)
    out = _out(1, state.x.shape[0], body)
    clock = _clock(body, STATIC_STEP, static=True)
    rows = _obstacles(obstacles)
    for share in np.linspace(0.0, 1.0, increments + 1)[1:]:
        part = body._replace(gravity=body.gravity * share, cap_weight=body.cap_weight * share)
        _halt(state)
        status, _, update, _ = twin(march)(whole * share, Span(0, 1, 2), part, rows, state, clock, work, out)
        if status != 0:
            raise SimulationError(
                f"no static equilibrium at {share:.0%} of the loads {whole[0].tolist()} "
                f"(last update {update:.1e} m): use smaller loads or more increments than {increments}"
            )
    _halt(state)
    return state


def _halt(state: RodState) -> None:
    state.x_before[:], state.v[:], state.v_before[:] = state.x, 0.0, 0.0
    state.curvature_before[:], state.length_before[:] = state.curvature, state.length
    state.chamber[:, 1] = 0.0


def _loads(p: RodParameters, loads: Any) -> Array:
    table = np.ascontiguousarray(loads, dtype=float)
    columns = len(p.chambers) + 3
    if table.ndim != 2 or table.shape[1] != columns:
        raise InputError(
            f"loads must have {columns} columns (pressure of each chamber, force in x and y, couple), got shape "
            f"{table.shape}"
        )
    if not np.all(np.isfinite(table)):
        raise InputError("loads must be finite numbers: replace NaN and infinite values")
    return table


def _obstacles(rows: ArrayLike | None) -> Array:
    table = np.zeros((0, 7)) if rows is None else np.atleast_2d(np.asarray(rows, dtype=float))
    if table.ndim != 2 or table.shape[1] != 7:
        raise InputError(f"obstacles must be rows of 7 numbers, as obstacle_rows returns them, got shape {table.shape}")
    return np.ascontiguousarray(table)


def simulate(
    p: RodParameters, loads: ArrayLike, time_step: float, *, stride: int = 4, obstacles: ArrayLike | None = None,
    start: RodState | None = None, static: bool = False, progress: Callable[[float], None] | None = None,
) -> RodMotion:
    """Simulate the motion of the rod under loads given at the end of every step.

    Parameters
    ----------
    p : RodParameters
    loads : (S, C + 3) array
        For each step: regulated pressure of each chamber (Pa gauge), force on the pushed node (x and y, N), couple on
        the last edge (N m).
    time_step : float, s
    stride : int
        Number of steps between two records.
    obstacles : (O, 7) array, optional
    start : RodState, optional
        Initial state. Default: static equilibrium without pressure.
    static : bool
        Compute a sequence of equilibria, without inertia, viscosity and relaxation. Time has no meaning then.
    progress : callable, optional
        Called with the completed fraction.

    Raises
    ------
    SimulationError
        When a step does not converge or a value is no longer finite.
    """
    from pliant.compiler.choose import twin
    from pliant.testbed.stepping_loops import energies, march

    table = _loads(p, loads)
    if not (time_step > 0 and stride >= 1):
        raise InputError(f"time_step must be > 0 and the stride >= 1, got {time_step} and {stride}")
    body, rows = build_body(p), _obstacles(obstacles)
    state = settle(p, obstacles=obstacles) if start is None else RodState(*(array.copy() for array in start))
    steps, chambers = table.shape[0], len(p.chambers)
    out = _out(steps // stride + 1, state.x.shape[0], body)
    out.position[0], out.velocity[0], out.curvature[0] = state.x, state.v, state.curvature
    out.volume[0] = state.chamber[:, 0]
    out.pressure[0] = table[0, :chambers] if steps else 0.0
    work = _work(body)
    clock = _clock(body, STATIC_STEP if static else time_step, static=static)
    twin(energies)(body, rows, state, out.energy[0])
    total = 0
    for first in range(0, steps, CHUNK):
        span = Span(first, min(first + CHUNK, steps), stride)
        status, step, update, count = twin(march)(table, span, body, rows, state, clock, work, out)
        total += count
        if status != 0:
            why = "did not converge" if status == 1 else "left the range where the section law is defined"
            pressure = " and ".join(f"{p:.0f}" for p in table[step, :chambers])
            raise SimulationError(
                f"the rod {why} at {step * time_step:.4f} s, pressure {pressure} Pa, last update {update:.1e} m: "
                f"use a time_step shorter than {time_step:g} s or gentler loads"
            )
        if progress is not None:
            progress(span.stop / steps)
    fields = out._asdict()
    if chambers == 1:
        fields |= {"pressure": out.pressure[:, 0], "volume": out.volume[:, 0]}
    return RodMotion(
        time=np.asarray(np.arange(out.energy.shape[0]) * (time_step * stride), dtype=float),
        arc_length=node_position(p),
        **fields, iterations=total / max(steps, 1),
    )  # fmt: skip
