"""The loops that run compiled: many steps of the chain, with and without memory.

Plain text here; `pliant.compiler.choose.twin` makes what runs.
"""

from __future__ import annotations

from functools import cache
from types import FunctionType
from typing import NamedTuple

import numpy as np

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
    """The steps of a march."""

    h: np.ndarray  # (steps,) s
    torque: np.ndarray  # (steps, C) N m, mean of each chamber over each step
    gain: np.ndarray  # (C, n) share of it that each joint feels
    keep: np.ndarray  # (steps,) row of the output after the step, negative: none
    load: np.ndarray  # (steps, n, 2) N m of `contact.add_link_loads`; no rows where no force pulls


class Rows(NamedTuple):
    """What a march writes."""

    phi: np.ndarray  # (rows, n) rad
    w: np.ndarray  # (rows, n) rad/s
    energy: np.ndarray  # (rows, 3) J so far: input work, loss of the dampers, loss of the memory
    state: np.ndarray  # (rows, n, branches) rad, of the memory; in space (rows, m, branches)
    total: np.ndarray  # (3,) the energies after the last step


def rows_for(rows, size, states, energies):
    """`Rows` of zeros: of so many angles, states of the memory of a shape (n, branches), and 2 or 3 energies."""
    shapes = ((rows, size), (rows, size), (rows, energies), (rows, *states), 3)
    return Rows(*map(np.zeros, shapes))


class Drives(NamedTuple):
    """The chambers of a body that moves one step at a time, advanced in place."""

    actuation: ActuationConstants
    valve: np.ndarray  # (C, 4) a `Lag` for each chamber
    pressure: np.ndarray  # (C,) Pa, behind the valves
    state: np.ndarray  # (C, 2) slow states, see `equations.chamber.advance`


def march(phi, w, steps, body, joints, work, out):
    """Take all `steps` (`Steps`) under the mean torques of each; phi and w (n,) are advanced in place.

    Of a body that lengthens, (n + S,) hold the strains of its segments behind the angles: its twin takes the step of
    `equations.extension`, and all other arrays are as long.

    The whole march is refused where a spring has softened to nothing, or a link turns by more than a radian in one
    step: the rule takes the turn of half a step as straight, and what it returned beyond would be finite and wrong.

    Where keep[k] >= 0, the state after step k goes to row keep[k] of `out` (`Rows`), with the input work and the
    dissipated energy so far [J], both by the midpoint rate that the step itself uses.
    Returns the index of the first step that fails, or -1.
    """
    n = len(phi)
    for k in range(len(steps.h)):
        h = steps.h[k]
        for c in range(len(steps.gain)):
            share_out(c, steps.torque[k, c], steps.gain, work.tau)
        if len(steps.load) > 0:
            add_link_loads(phi, w, 0.5 * h, steps.load[k], body, joints, work)
        step(phi, w, h, work.tau, body, joints, work)
        if not follows(phi, w, h, joints):
            return k
        add_step_work(w, h, work.tau, joints, work, out.total)
        row = steps.keep[k]
        if row >= 0:
            for i in range(n):
                out.phi[row, i] = phi[i]
                out.w[row, i] = w[i]
            out.energy[row, 0] = out.total[0]
            out.energy[row, 1] = out.total[1]
    return -1


def march_with_memory(phi, w, steps, body, joints, past, work, out):
    """As `march`, with the memory of the joints (`symbols.Past`): its state is advanced in place and kept.

    The last column of the energy takes what the memory dissipated. Returns -1; the index k of a step that turns a link
    by more than a radian; or -2 - k where the branches of step k find no agreement.
    """
    n = len(phi)
    for k in range(len(steps.h)):
        h = steps.h[k]
        for c in range(len(steps.gain)):
            share_out(c, steps.torque[k, c], steps.gain, work.tau)
        if len(steps.load) > 0:
            add_link_loads(phi, w, 0.5 * h, steps.load[k], body, joints, work)
        taken = step_with_memory(phi, w, h, work.tau, body, joints, past, work)
        if not follows(phi, w, h, joints):
            return k
        if not taken >= 0.0:
            return -2 - k
        add_step_work(w, h, work.tau, joints, work, out.total)
        out.total[2] = out.total[2] + taken
        row = steps.keep[k]
        if row >= 0:
            for i in range(n):
                out.phi[row, i] = phi[i]
                out.w[row, i] = w[i]
            for i in range(past.state.shape[0]):
                for j in range(past.state.shape[1]):
                    out.state[row, i, j] = past.state[i, j]
            for i in range(3):
                out.energy[row, i] = out.total[i]
    return -1


def take_torques(h, command, drives, tau):
    """Mean torques tau (n,) [N m] of the joints over h [s] under commands (C,) [Pa]; `drives` (`Drives`) moves on."""
    for c in range(len(command)):
        valve = drives.valve
        lag = Lag(valve[c, 0], valve[c, 1], valve[c, 2], valve[c, 3])
        p = held_interval(h, command[c], lag, drives.pressure[c])
        made = advance_one(c, h, p, drives.actuation, drives.state)
        drives.pressure[c] = p.end
        share_out(c, made, drives.actuation.gain, tau)


def held_step(phi, w, h, command, drives, body, joints, work):
    """One step of `march` behind valves, under commands (C,) [Pa] held constant; 0, or -1 where the step failed."""
    take_torques(h, command, drives, work.tau)
    step(phi, w, h, work.tau, body, joints, work)
    if follows(phi, w, h, joints):
        return 0
    return -1


def held_step_with_memory(phi, w, h, command, drives, chain, past, work):
    """As `held_step` with memory (`symbols.Past`); `chain` is (body, joints)."""
    body, joints = chain
    take_torques(h, command, drives, work.tau)
    taken = step_with_memory(phi, w, h, work.tau, body, joints, past, work)
    if taken >= 0.0 and follows(phi, w, h, joints):
        return 0
    return -1


def hold(phi, w, held, drives, body, joints, work):
    """As `held_step`, several times and under a force, of plain tuples; the index of the step that fails, or -1.

    `held` is (h, steps, command, load, total): load (n, 2) is that of `equations.contact.add_link_loads`, (0, 2) for
    none; total (3,) takes input work, loss of the dampers and loss of the memory, J. Python hands the arrays of plain
    tuples over in a third of the time of named ones.
    """
    h, steps, command, load, total = held
    actuation, valve, pressure, state = drives
    chambers = Drives(ActuationConstants(*actuation), valve, pressure, state)
    mass, springs, scratch = Body(*body), Joints(*joints), Workspace(*work)
    for k in range(steps):
        take_torques(h, command, chambers, scratch.tau)
        if len(load) > 0:
            add_link_loads(phi, w, 0.5 * h, load, mass, springs, scratch)
        step(phi, w, h, scratch.tau, mass, springs, scratch)
        if not follows(phi, w, h, springs):
            return k
        add_step_work(w, h, scratch.tau, springs, scratch, total)
    return -1


def hold_with_memory(phi, w, held, drives, chain, past, work):
    """As `hold` with memory; chain is (body, joints)."""
    h, steps, command, load, total = held
    actuation, valve, pressure, state = drives
    chambers = Drives(ActuationConstants(*actuation), valve, pressure, state)
    body, joints = chain
    mass, springs, scratch = Body(*body), Joints(*joints), Workspace(*work)
    memory, branches, before = past
    own = Past(MemoryLaw(*memory), branches, Held(*before[:-1], Joints(*before[-1])))
    for k in range(steps):
        take_torques(h, command, chambers, scratch.tau)
        if len(load) > 0:
            add_link_loads(phi, w, 0.5 * h, load, mass, springs, scratch)
        taken = step_with_memory(phi, w, h, scratch.tau, mass, springs, own, scratch)
        if not (taken >= 0.0 and follows(phi, w, h, springs)):
            return k
        add_step_work(w, h, scratch.tau, springs, scratch, total)
        total[2] = total[2] + taken
    return -1


@cache
def of_records(kernel, body, joints, workspace, law=MemoryLaw):
    """Return a kernel's text with other records in the place of `Body`, `Joints`, `Workspace` and `MemoryLaw`."""
    if (body, joints, workspace) == (Body, Joints, Workspace):
        return kernel
    scope = {**kernel.__globals__, "Body": body, "Joints": joints, "Workspace": workspace, "MemoryLaw": law}
    if joints is SpatialJoints:
        scope["Held"] = SpatialHeld
    if law is AxialMemoryLaw:
        scope["Held"] = ExtensibleHeld
    name = f"{kernel.__name__}_{body.__name__}{'_axial' * (law is AxialMemoryLaw)}"
    copy = FunctionType(kernel.__code__, scope, name)
    copy.__doc__, copy.__module__ = f"As `{kernel.__name__}`, of a {body.__name__}.", kernel.__module__
    return copy
