"""Times of the compiled simulation code beside plain C for five links, which is compiled on this machine if possible,
and of batches beside a plain loop: eight chains side by side, then all cores.

A time in nanoseconds depends on the machine as much as on pliant. The ratio to the time of `floor.c`, measured in the
same minute, shows how much faster pliant's kernels could still become.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from functools import cache, partial
from pathlib import Path
from time import perf_counter, process_time
from types import FunctionType
from typing import Any

import numpy as np
from numba import njit

from pliant.actuators import chen2018
from pliant.batch import simulate_batch
from pliant.compiler.choose import MOST_LINKS, straight
from pliant.compiler.twin import options, rebuild
from pliant.equations.motion import acceleration, acceleration_jacobian
from pliant.equations.symbols import Slopes
from pliant.errors import InputError
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.parallel import cores
from pliant.simulation import Pulse, simulate, state
from pliant.simulation.drive import drive
from pliant.simulation.initial_value import march
from speed.timing import best, in_turn, of_processor

Array = np.ndarray
LINKS, CALLS = 5, 20_000
TORQUE = 0.0793  # N m, the paper's at 119 kPa
STEP = 1e-3  # s
SOURCE = Path(__file__).with_name("floor.c")
FLAGS = ("-O3", "-march=native")  # fused operations but no reordering, as in pliant's kernels
PULSE = Pulse(chen2018.PULSE_PRESSURE, chen2018.PULSE_START, chen2018.PULSE_WIDTH)
SAMPLES = 1024  # as many as a Monte Carlo run takes: the label on the arrays is then a small part
COPIED = 64 * 2**20  # bytes: more than a cache holds
POINTER = ctypes.POINTER(ctypes.c_double)


def shared_library(source: Path, *flags: str) -> Any:
    """Compile a C file and return it as a library; None if there is no C compiler, or it fails."""
    compiler = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)
    if compiler is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        binary = Path(folder) / "code.so"
        command = [compiler, *flags, "-shared", "-fPIC", str(source), "-o", str(binary), "-lm"]
        done = subprocess.run(command, capture_output=True, check=False)
        return ctypes.CDLL(str(binary)) if done.returncode == 0 else None


@cache
def floor_c() -> Any:
    """Return floor.c as a library; None if there is no C compiler."""
    return shared_library(SOURCE, *FLAGS)


def constants(model: Model) -> Array:
    """Return the parameters of a model of five links as one array, in the order of the C struct `Chain` in floor.c."""
    body, joints = mechanics_of(model).body, mechanics_of(model).joints
    second, third, *later = joints.hardening  # the law in the form that floor.c uses
    if np.any(later):
        raise InputError("floor.c has the first two terms of the springs only: use a model without others and bounds")
    parts = (
        body.B, body.I, body.h, body.gx, body.gy, joints.base_angle, joints.theta0, joints.K, joints.D, second,
        joints.unloaded, third,
    )
    return np.concatenate([np.ravel(part) for part in parts]).astype(float)


class Floor:
    """The functions of floor.c, called for one model of five links."""

    def __init__(self, model: Model) -> None:
        self.constants, self.code = constants(model), floor_c()

    def call(self, name: str, count: int, *arguments: Array | float) -> None:
        """Call the function `name` of floor.c `count` times, in a loop that runs in C."""
        given = [
            a.ctypes.data_as(POINTER) if isinstance(a, np.ndarray) else ctypes.c_double(a)
            for a in (self.constants, *arguments)
        ]
        getattr(self.code, name)(ctypes.c_long(count), *given)


def floor(model: Model, count: int, time_step: float, torque: Array) -> dict[str, float]:
    """Return the times [ns] that plain C takes for one time step, for one evaluation of the joint accelerations, and
    for one evaluation of the joint accelerations and their Jacobian.

    The result is empty if there is no C compiler or the model does not have five links.
    """
    made, n = Floor(model), LINKS
    if made.code is None or model.n != n:
        return {}
    a, a_phi, a_w = np.zeros(n), np.zeros((n, n)), np.zeros((n, n))

    def at() -> tuple[Array, Array]:
        return np.linspace(0.05, 0.25, n), np.linspace(0.1, 1.0, n)

    jobs = {
        "c_step_ns": lambda: made.call("many_steps", count, *at(), time_step, torque),
        "c_rhs_ns": lambda: made.call("many_accelerations", count, *at(), torque, a),
        "c_rhs_jacobian_ns": lambda: made.call("many_jacobians", count, *at(), torque, a, a_phi, a_w),
    }
    return {name: 1e9 * best(job, clock=process_time) / count for name, job in jobs.items()}


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
    seconds, count = march_time(model, np.array([0.0, 4.0]))
    return 1e9 * seconds / count


def march_time(model: Model, times: Array) -> tuple[float, int]:
    """Return the shortest time [s] of the compiled march under the paper's pulse, and the number of its steps."""
    plan = drive(model, PULSE, times, STEP)
    start = (mechanics_of(model).coordinates(state.equilibrium(model, plan.initial)), np.zeros(model.n))
    return best(lambda: march(model, plan, start, times.size), clock=process_time), plan.h.size


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


def bandwidth() -> float:
    """Return the bytes per second that one core reads and writes in a plain copy."""
    source = np.zeros(COPIED // 8)
    target = np.empty_like(source)
    return 2.0 * COPIED / best(lambda: np.copyto(target, source), clock=process_time)


def lanes_of(flags: set[str]) -> int:
    """Return the number of doubles in the widest register of a processor with these flags; 2 if the flags name none."""
    return 8 if "avx512f" in flags else 4 if "avx" in flags else 2


def batches() -> dict[str, Any]:
    """Return the speed-up by SIMD vectors on one core, by a second core, and the largest difference from single runs.

    The plain loop is the compiled march of one sample after the other with everything before it done once: what lanes
    are compared with is the arithmetic alone, the batch with all that it needs; both in processor time, which a busy
    machine lengthens less. The cores are compared by the clock on the wall.
    """
    rng = np.random.default_rng(7)
    model = chen2018.model()
    times = np.arange(301) / 75.0
    changes = {"stiffness": 1.6067 * rng.uniform(0.8, 1.2, SAMPLES), "damping": 8e-3 * rng.uniform(0.7, 1.3, SAMPLES)}

    def batch(threads: int) -> Any:
        return simulate_batch(model, PULSE, parameters=changes, times=times, time_step=STEP, threads=threads)

    one, steps = march_time(model, times)
    single = best(lambda: simulate(model, PULSE, times=times, time_step=STEP))
    work = best(lambda: batch(1), seconds=2.0, clock=process_time) / SAMPLES
    most = max(2, cores())
    counts = sorted({1, 2, most})
    for count in counts:
        batch(count)
    runs = in_turn([partial(batch, c) for c in counts], 5, seconds=6.0, clock=perf_counter)
    took = dict(zip(counts, runs.min(axis=1), strict=True))
    lanes, pair, everything = (took[c] / SAMPLES for c in (1, 2, most))
    made, difference = batch(2), 0.0
    for i in range(0, SAMPLES, 73):
        alone = simulate(
            model.with_(**{name: value[i] for name, value in changes.items()}), PULSE, times=times, time_step=STEP
        )
        difference = max(difference, float(np.abs(alone["tip_position"] - made["tip_position"][i]).max()))
    ns, memory, lanes_there = 1e9 * work / steps, bandwidth(), lanes_of(set(of_processor("flags").split()))
    under = floor(model, 20_000, STEP, np.full(model.n, TORQUE))
    beside = {"batch_over_c": ns * lanes_there / under["c_step_ns"], "batch_lanes": lanes_there} if under else {}
    written = sum(v.nbytes for v in made.data_vars.values()) / SAMPLES
    return {
        **beside, "memory_gb_s": 1e-9 * memory, "batch_memory_share": written / work / memory,
        "batch_speedup_simd": one / work, "batch_speedup_cores": lanes / pair, "batch_cores": 2,
        "batch_speedup_all_cores": lanes / everything, "batch_all_cores": most,
        "batch_speedup_over_simulate": single / pair, "batch_us_per_sample": 1e6 * everything,
        "batch_ns_per_step_one_core": ns, "batch_difference_mm": 1e3 * difference,
        "batch_times_real_time": float(times[-1]) / everything,
    }
