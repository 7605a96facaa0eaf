"""Compiled loops of a batch simulation on an NVIDIA GPU, where each thread integrates one sample.

This module is imported only when a GPU is used. Each thread treats its sample as a vector of width one, so that an
array of vectors is the array itself, and nothing of `batch.simd_loops` or `pliant.equations` has to be written twice.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np

from pliant.batch import simd_loops
from pliant.batch.simd_loops import Lane, Output
from pliant.compiler import trace
from pliant.compiler.choose import MOST_LINKS
from pliant.compiler.twin import rebuild
from pliant.equations import motion

cuda: Any = import_module("numba.cuda")
THREADS = 64  # of a block: small, because each thread keeps some hundred numbers in registers


def itself(array):
    """Return the array unchanged. GPU kernels call this in place of `as_lanes`, which arranges samples in SIMD vectors,
    because each GPU thread has only one sample.
    """
    return array


def within(x, limit):
    """Return 1 if |x| is at most `limit`, else 0; NaN gives 0."""
    if abs(x) <= limit:
        return 1
    return 0


def device(function: Callable[..., Any]) -> Any:
    """Compile a Python function so that GPU kernels can call it."""
    return cuda.jit(device=True)(function)


def straight_line(kernel: Any, links: int) -> Any:
    """Return a Python function that computes the same as the loop `kernel` for a chain of `links` links, but with every
    pass of the loop written out as lines of its own.
    """
    made = trace.recording(kernel, links)

    def line(row: int) -> str:
        what, operands = made.rows[row]
        names = [f"t{o.row}" if isinstance(o, trace.Mark) else repr(o) for o in operands]
        if what in ("cos", "sin", "sqrt"):
            return f"t{row} = np.{what}({names[0]})"
        return f"t{row} = {' '.join([*names[:-1], what, *names[-1:]])}"  # a number, - a, or a + b

    lines = [*map(line, made.needed), *(f"{where} = t{mark.row}" for where, mark in made.stores)]
    scope: dict[str, Any] = {"np": np}
    exec(f"def {kernel.__name__}({', '.join(made.names)}):\n    " + "\n    ".join(lines), scope)  # noqa: S102  our own text
    return scope[kernel.__name__]


@cache
def kernels(links: int) -> tuple[Any, Any]:
    """Return the GPU versions of two compiled loops for a chain of `links` links: the mean torque in each time step
    (`simd_loops.mean_torques`), and the integration of the motion (`simd_loops.march_lanes`).
    """
    names = {"as_lanes": device(itself), "within": device(within), "WIDTH": 1}
    if links <= MOST_LINKS:
        names["step"] = device(straight_line(motion.step, links))
    both: Sequence[Any] = (simd_loops.mean_torques, simd_loops.march_lanes)
    torques, march = (rebuild(kernel, device, names) for kernel in both)
    return torques, march


@cache
def every_sample(links: int) -> Any:
    """Return the GPU kernel whose thread i integrates sample i, for arrays with the samples along the last axis."""
    mean_torques, march = kernels(links)

    def run(given, scratch, state, out):
        i = cuda.grid(1)
        h, keep, intervals, parts, behind, which, law, B, I, first_moment, g, joints, place = given
        A, S, vectors, torque = scratch
        if i < which.size:
            mean_torques(intervals, parts, behind[:, :, which[i]], law[:, i], torque[:, i])
            body = (B[:, :, i], I[:, i], first_moment[:, i], g[:, i])
            march(
                state[:, :, i], h, torque[:, i], keep, Lane(body, joints[:, :, i], place[:, i]),
                (A[:, :, i], S[:, :, i], vectors[:, :, i]),
                Output(out[0][:, :, i], out[1][:, :, i], out[2][:, :, :, i], out[3][i : i + 1]),
            )

    return cuda.jit(run)


def present() -> bool:
    """Return whether Numba finds a usable GPU."""
    return bool(cuda.is_available())


def launch(
    links: int, given: Sequence[np.ndarray], scratch: Sequence[tuple[int, ...]], kept: Sequence[np.ndarray],
) -> None:
    """Run the simulation on the GPU with copies of the arrays `given`. Results are copied to the arrays `kept`."""
    there = [cuda.to_device(np.ascontiguousarray(a)) for a in (*given, *kept)]
    own = [cuda.device_array(shape) for shape in scratch]
    count = kept[-1].size
    threads = min(THREADS, count)
    state, *out = there[len(given) :]
    every_sample(links)[-(-count // threads), threads](tuple(there[: len(given)]), tuple(own), state, tuple(out))
    for array, made in zip(kept, there[len(given) :], strict=True):
        made.copy_to_host(array)
