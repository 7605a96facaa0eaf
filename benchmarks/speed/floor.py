"""Reference times of plain C code for the equations of motion of five links, compiled on this machine if possible.

A time in nanoseconds depends on the machine as much as on pliant. The ratio to the time of `floor.c`, measured in the
same minute, shows how much faster pliant's kernels could still become.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from pliant.errors import InputError
from pliant.mechanics import mechanics_of
from pliant.model import Model
from speed.timing import best

Array = np.ndarray
LINKS = 5
SOURCE = Path(__file__).with_name("floor.c")
FLAGS = ("-O3", "-march=native", "-shared", "-fPIC")  # fused operations but no reordering, as in pliant's kernels
POINTER = ctypes.POINTER(ctypes.c_double)


@cache
def library() -> Any:
    """Compile floor.c and return it as a library; None if there is no C compiler."""
    compiler = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)
    if compiler is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        binary = Path(folder) / "floor.so"
        done = subprocess.run(
            [compiler, *FLAGS, str(SOURCE), "-o", str(binary), "-lm"], capture_output=True, check=False
        )
        return ctypes.CDLL(str(binary)) if done.returncode == 0 else None


def constants(model: Model) -> Array:
    """Return the parameters of a model of five links as one array, in the order of the C struct `Chain` in floor.c."""
    body, joints = mechanics_of(model).body, mechanics_of(model).joints
    second, third, *later, scale = joints.hardening  # the law in the form that floor.c uses
    if np.any(later):
        raise InputError("floor.c has the first two terms of the springs only: use a model without later terms")
    parts = (
        body.B, body.I, body.h, body.gx, body.gy, joints.base_angle, joints.theta0, joints.K, joints.D, second,
        joints.unloaded, third, scale,
    )
    return np.concatenate([np.ravel(part) for part in parts]).astype(float)


class Floor:
    """The functions of floor.c, called for one model of five links."""

    def __init__(self, model: Model) -> None:
        self.constants, self.code = constants(model), library()

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
