"""Timing of the compiled simulation code: of a time step, and of the joint accelerations without and with Jacobian."""

from __future__ import annotations

from time import process_time

import numpy as np

from pliant.actuators import chen2018
from pliant.equations import motion
from pliant.equations.symbols import Slopes
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.simulation import Pulse, state
from pliant.simulation.drive import drive
from pliant.simulation.initial_value import march
from speed import kernel_loops
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

    accelerate = kernel_loops.compiled(kernel_loops.many_accelerations, motion.acceleration, n)
    differentiate = kernel_loops.compiled(kernel_loops.many_jacobians, motion.acceleration_jacobian, n)
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
