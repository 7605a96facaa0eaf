"""Compiled time-stepping loops of the chain, with and without hysteresis.

The functions are plain Python; `pliant.compiler.choose.twin` compiles them.
"""

from __future__ import annotations

from functools import cache
from types import FunctionType
from typing import NamedTuple

import numpy as np

from pliant.equations.base import begin_step, end_step
from pliant.equations.chamber import advance_one, share_out
from pliant.equations.contact import add_link_loads
from pliant.equations.elastic import follows
from pliant.equations.energy import add_step_work
from pliant.equations.memory import step_with_memory
from pliant.equations.motion import step
from pliant.equations.symbols import (
    ActuationConstants,
    AxialMemoryLaw,
    Body,
    ExtensibleHeld,
    Held,
    Joints,
    Lag,
    MemoryLaw,
    Past,
    SpatialHeld,
    SpatialJoints,
    Workspace,
)
from pliant.simulation.pressure_loops import held_interval


class Steps(NamedTuple):
    """Time steps as input of a compiled simulation: length, mean chamber torques, loads and output row of each step."""

    h: np.ndarray  # (steps,) s
    torque: np.ndarray  # (steps, C) N m, mean of each chamber over each step
    gain: np.ndarray  # (C, n) fraction of the chamber's torque at each joint
    keep: np.ndarray  # (steps,) output row of the state after the step; negative: no output
    load: np.ndarray  # (steps, n, 2) N m, see `contact.add_link_loads`; no rows if there are no forces
    base: np.ndarray  # (steps, 5), in space (steps, 6), motion of the base, see `base.begin_step`; no rows at rest


class Rows(NamedTuple):
    """Output of a time-stepping loop: angles, rates, energies and hysteresis states, one row per output time."""

    phi: np.ndarray  # (rows, n) rad
    w: np.ndarray  # (rows, n) rad/s
    energy: np.ndarray  # (rows, 3) J since the start: input work, loss of the dampers, loss of hysteresis
    state: np.ndarray  # (rows, n, branches) rad, hysteresis states; in space (rows, m, branches)
    total: np.ndarray  # (3,) the energies after the last step


def rows_for(rows, size, states, energies):
    """Return zeroed output arrays (`Rows`) of a simulation for a number of rows, coordinates, hysteresis states and
    energies.

    `states` is the shape (n, branches) of the hysteresis states.
    """
    shapes = ((rows, size), (rows, size), (rows, energies), (rows, *states), 3)
    return Rows(*map(np.zeros, shapes))


class Drives(NamedTuple):
    """Torque laws, valves, pressures and slow states of C chambers, updated in place at each simulated step."""

    actuation: ActuationConstants
    valve: np.ndarray  # (C, 4) the `Lag` of each chamber
    pressure: np.ndarray  # (C,) Pa, behind the valves
    state: np.ndarray  # (C, 2) slow states, see `equations.chamber.advance`


def march(phi, w, steps, body, joints, work, out, past=None):
    """Integrate a chain of n links over all `steps`. Angles phi, rates w (n,) and the hysteresis states in `past` (a
    `symbols.Past`; None: no hysteresis) change in place, and output rows are written to `out`.

    For a body that lengthens, all arrays are (n + S,), with strains behind the angles, and the compiled loop uses the
    step of `equations.extension`.

    The loop stops at a step in which a spring loses its stiffness or a link turns by more than 1 rad. The rule assumes
    a constant rate over half a step, so that results of larger turns would be finite but wrong.

    Where keep[k] >= 0, row keep[k] of `out` receives the state after step k, with the hysteresis states, the input work
    and the energies that dampers and hysteresis dissipate since the start [J], all by the mid-step rates. Where the
    base moves, its motion in each step is a row of steps.base, and coordinates and rates are relative to it. Returns
    -1, the index k of the first step that fails, or -2 - k if the hysteresis of step k does not converge.
    """
    for k in range(len(steps.h)):
        h = steps.h[k]
        for c in range(len(steps.gain)):
            share_out(c, steps.torque[k, c], steps.gain, work.tau)
        if len(steps.base) > 0:
            begin_step(steps.base[k], w, body, joints)
        if len(steps.load) > 0:
            add_link_loads(phi, w, 0.5 * h, steps.load[k], body, joints, work)
        lost = 0.0
        if past is None:  # Numba compiles one of the two branches
            step(phi, w, h, work.tau, body, joints, work)
        else:
            lost = step_with_memory(phi, w, h, work.tau, body, joints, past, work)
        if not follows(phi, w, h, joints):
            return k
        if not lost >= 0.0:
            return -2 - k
        add_step_work(w, h, work.tau, joints, work, out.total)
        out.total[2] = out.total[2] + lost
        if len(steps.base) > 0:
            end_step(steps.base[k], phi, w, body, joints)
        if steps.keep[k] >= 0:
            keep_row(steps.keep[k], phi, w, past, out)
    return -1


def keep_row(row, phi, w, past, out):
    """Write the state of a chain and its energies since the start to row number `row` of `out`."""
    for i in range(len(phi)):
        out.phi[row, i] = phi[i]
        out.w[row, i] = w[i]
    if past is not None:
        for i in range(past.state.shape[0]):
            for j in range(past.state.shape[1]):
                out.state[row, i, j] = past.state[i, j]
    for i in range(out.energy.shape[1]):
        out.energy[row, i] = out.total[i]


def take_torques(h, command, drives, tau):
    """Write to tau (n,) [N m] the mean torques of n joints over the next h [s] under constant pressure commands (C,)
    [Pa] to C chambers. Pressures and slow states in `drives` (a `Drives`) advance by h in place.
    """
    for c in range(len(command)):
        valve = drives.valve
        lag = Lag(valve[c, 0], valve[c, 1], valve[c, 2], valve[c, 3])
        p = held_interval(h, command[c], lag, drives.pressure[c])
        torque = advance_one(c, h, p, drives.actuation, drives.state)
        drives.pressure[c] = p.end
        share_out(c, torque, drives.actuation.gain, tau)


def held_step(phi, w, h, command, drives, body, joints, work):
    """Advance a chain of n links by one step h [s] under constant commands (C,) [Pa] to the valves of C chambers.
    Angles phi and rates w (n,) change in place. Return 0, or -1 if the step fails.

    Pressures and slow states in `drives` (a `Drives`) change in place too.
    """
    take_torques(h, command, drives, work.tau)
    step(phi, w, h, work.tau, body, joints, work)
    if follows(phi, w, h, joints):
        return 0
    return -1


def held_step_with_memory(phi, w, h, command, drives, chain, past, work):
    """Advance a chain of n links with hysteresis by one step h [s] under constant commands (C,) [Pa] to the valves of C
    chambers. Angles phi, rates w (n,) and the states in `past` change in place. Return 0, or -1 if the step fails.

    `chain` is (body, joints), `past` a `symbols.Past`.
    """
    body, joints = chain
    take_torques(h, command, drives, work.tau)
    taken = step_with_memory(phi, w, h, work.tau, body, joints, past, work)
    if taken >= 0.0 and follows(phi, w, h, joints):
        return 0
    return -1


def hold(phi, w, held, drives, body, joints, work, past=None):
    """Advance a chain of n links by several steps under constant commands and forces. Angles phi, rates w (n,) and the
    hysteresis states in `past` (None: no hysteresis) change in place. Return the index of a failed step, or -1.

    `held` is (h, steps, command, load, total). `load` (n, 2) is that of `equations.contact.add_link_loads`, (0, 2) for
    none. Input work, loss of the dampers and loss of hysteresis [J] are added to `total` (3,). All records are plain
    tuples, which Python passes to a compiled function in a third of the time of named ones.
    """
    h, steps, command, load, total = held
    actuation, valve, pressure, state = drives
    chambers = Drives(ActuationConstants(*actuation), valve, pressure, state)
    mass, springs, scratch = Body(*body), Joints(*joints), Workspace(*work)
    if past is not None:
        memory, branches, before = past
        hysteresis = Past(MemoryLaw(*memory), branches, Held(*before[:-1], Joints(*before[-1])))
    for k in range(steps):
        take_torques(h, command, chambers, scratch.tau)
        if len(load) > 0:
            add_link_loads(phi, w, 0.5 * h, load, mass, springs, scratch)
        lost = 0.0
        if past is None:  # Numba compiles one of the two branches
            step(phi, w, h, scratch.tau, mass, springs, scratch)
        else:
            lost = step_with_memory(phi, w, h, scratch.tau, mass, springs, hysteresis, scratch)
        if not (lost >= 0.0 and follows(phi, w, h, springs)):
            return k
        add_step_work(w, h, scratch.tau, springs, scratch, total)
        total[2] = total[2] + lost
    return -1


@cache
def of_records(kernel, body, joints, workspace, law=MemoryLaw):
    """Return a copy of the loop `kernel` that takes records of the given types in place of `Body`, `Joints`,
    `Workspace` and `MemoryLaw`.
    """
    if (body, joints, workspace) == (Body, Joints, Workspace):
        return kernel
    scope = {**kernel.__globals__, "Body": body, "Joints": joints, "Workspace": workspace, "MemoryLaw": law}
    if joints is SpatialJoints:
        scope["Held"] = SpatialHeld
    elif law is AxialMemoryLaw:
        scope["Held"] = ExtensibleHeld
    name = f"{kernel.__name__}_{body.__name__}{'_axial' * (law is AxialMemoryLaw)}"
    copy = FunctionType(kernel.__code__, scope, name, kernel.__defaults__)
    copy.__doc__, copy.__module__ = f"`{kernel.__name__}` for records of the type {body.__name__}.", kernel.__module__
    return copy
