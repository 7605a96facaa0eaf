"""Timing of the compiled simulation code: of a time step, and of the joint accelerations without and with Jacobian."""

from __future__ import annotations

from functools import cache
from time import process_time
from types import FunctionType
from typing import Any

import numpy as np
from numba import njit

from pliant.actuators import chen2018
from pliant.compiler.choose import MOST_LINKS, straight
from pliant.compiler.twin import options, rebuild
from pliant.equations.motion import acceleration, acceleration_jacobian
from pliant.equations.symbols import Slopes
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.simulation import Pulse, state
from pliant.simulation.drive import drive
from pliant.simulation.initial_value import march
from speed.floor import floor
from speed.timing import best

CALLS = 20_000
TORQUE = 0.0793  # N m, the paper's at 119 kPa
STEP = 1e-3  # s


def kernels(links: int = 5) -> dict[str, float]:
    """Return the times [ns] of one implicit time step, of one evaluation of the joint accelerations, and of one
    evaluation of the joint accelerations and their Jacobian. If there is a C compiler, also return the times of plain C
    and the ratios to these.
    """
    model = chen2018.model(links=links)
    n, parts = links, mechanics_of(model).parts()
    out, torque = Slopes(np.zeros(n), np.zeros((n, n)), np.zeros((n, n))), np.full(n, TORQUE)

    def at() -> tuple[np.ndarray, np.ndarray]:
        return np.linspace(0.05, 0.25, n), np.linspace(0.1, 1.0, n)

    accelerate = compiled(many_accelerations, acceleration, n)
    differentiate = compiled(many_jacobians, acceleration_jacobian, n)
    jobs = {
        "rhs_ns": lambda: accelerate(CALLS, *at(), torque, parts, out.a),
        "rhs_jacobian_ns": lambda: differentiate(CALLS, *at(), torque, parts, out),
    }
    times = {name: 1e9 * best(job, clock=process_time) / CALLS for name, job in jobs.items()}
    times = {"step_ns": step_ns(model), **times}
    under = floor(model, CALLS, STEP, torque)
    ratios = {f"{name.removesuffix('_ns')}_over_c": ns / under[f"c_{name}"] for name, ns in times.items() if under}
    return {**times, **under, **ratios}


def step_ns(model: Model) -> float:
    """Return the mean time [ns] of one implicit time step in a simulation of 4 s that also computes the energies."""
    pressure = Pulse(chen2018.PULSE_PRESSURE, chen2018.PULSE_START, chen2018.PULSE_WIDTH)
    ends = np.array([0.0, 4.0])
    plan = drive(model, pressure, ends, STEP)
    start = (mechanics_of(model).coordinates(state.equilibrium(model, plan.initial)), np.zeros(model.n))
    return 1e9 * best(lambda: march(model, plan, start, ends.size), clock=process_time) / plan.h.size


@cache
def compiled(loop: FunctionType, kernel: FunctionType, links: int) -> Any:
    """Return a loop compiled by Numba, which calls the version of `kernel` that is fastest for this
    number of links.
    """
    few = links <= MOST_LINKS
    return rebuild(loop, njit(**options(loop)), {kernel.__name__: straight(kernel, links)} if few else None)


def many_accelerations(count, phi, w, torque, parts, a):
    """Compute the joint accelerations `count` times into `a`. The angle phi[0] changes slightly each time, so that the
    compiler cannot skip a call.
    """
    for _ in range(count):
        acceleration(phi, w, torque, parts[0], parts[1], parts[2], a)
        phi[0] = phi[0] + 1e-18 * a[0]


def many_jacobians(count, phi, w, torque, parts, out):
    """Compute the joint accelerations and their Jacobian `count` times into `out`."""
    for _ in range(count):
        acceleration_jacobian(phi, w, torque, parts[0], parts[1], parts[2], out)
        phi[0] = phi[0] + 1e-18 * out.a[0]
