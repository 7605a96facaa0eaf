"""Simulation of a batch on an NVIDIA GPU: transfer of the inputs, and collection of the results."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pliant.batch.samples import Samples
from pliant.batch.schedule import Schedule
from pliant.batch.simd import constant_arrays, outputs, unpack
from pliant.batch.simd_loops import Output
from pliant.errors import InputError

Array = np.ndarray
BYTES = 2**29  # memory of a launch on the GPU: a larger batch is split


def check_gpu(samples: Samples) -> None:
    """Raise InputError if no GPU is available, or the models are not supported there."""
    try:
        from pliant.batch.gpu_loops import present
    except ImportError:
        raise InputError("device='gpu' needs the extra 'gpu': pip install 'pliant[gpu]', or use device='cpu'") from None
    if not present():
        raise InputError(
            "device='gpu' needs an NVIDIA GPU with its driver and the extra 'gpu', pip install 'pliant[gpu]', but "
            "Numba finds no GPU on this machine: use device='cpu'"
        )
    if samples.template.memory or samples.remembering.any():
        raise InputError(
            "hysteresis states, viscoelastic lag and hyperelastic walls of chambers are not supported on the GPU: use "
            "device='cpu'"
        )


def run_gpu(samples: Samples, schedule: Schedule, start: Array, variables: Sequence[str]) -> dict[str, Array]:
    """Simulate all samples on the GPU; return the variables (N, T, ...) and failed_at (N,) [s]."""
    made = outputs(samples, schedule.times.size, variables)  # samples with the same time steps are launched together
    grids: dict[int, list[int]] = {}
    for i in range(samples.size):
        grids.setdefault(id(schedule.grid(i)), []).append(i)
    for members in grids.values():
        steps = schedule.grid(members[0]).keep.size
        part = max(1, BYTES // (8 * (steps + 4 * samples.template.n * schedule.times.size)))
        for first in range(0, len(members), part):
            march(samples, schedule, start, np.array(members[first : first + part]), made)
    return made


def march(samples: Samples, schedule: Schedule, start: Array, own: Array, made: dict[str, Array]) -> None:
    """Simulate on the GPU the samples with the indices `own`, which share their time steps, and fill `made`."""
    from pliant.batch.gpu_loops import launch

    n, rows, count = samples.template.n, schedule.times.size, own.size
    grid = schedule.grid(own[0])
    behind, which = inputs(samples, schedule, own)
    h = np.ascontiguousarray(grid.steps[:, 0])
    constants = [a[..., own] for a in constant_arrays(samples)]
    law = samples.values["torque"][:, own]
    given = (h, grid.keep, grid.intervals[:, 0], grid.parts, behind, which, law, *constants)
    scratch = ((n, n, count), (n, n, count), (6, n + 1, count), (h.size, count))
    state, failed = start[..., own].copy(), np.full(count, -1)
    kept = Output(np.empty((rows, n, count)), np.empty((rows, n, count)), np.empty((rows, n, 2, count)), failed)
    launch(n, given, scratch, (state, *kept))
    asked = {name: np.empty((count, *a.shape[1:])) for name, a in made.items() if name != "failed_at"}
    unpack(samples, kept, constants[-2], constants[-1], asked)
    for name, a in asked.items():
        made[name][own] = a
    for k in np.flatnonzero(failed >= 0):
        made["failed_at"][own[k]] = schedule.times[0] + h[: failed[k] + 1].sum()


def inputs(samples: Samples, schedule: Schedule, own: Array) -> tuple[Array, Array]:
    """Return the distinct pressures behind the valves (m, 4, K), and for each sample the index of its pressure."""
    places: dict[object, int] = {}
    tables: list[Array] = []
    which = np.empty(own.size, dtype=np.int64)
    for k, i in enumerate(own.tolist()):
        key = (id(schedule.pressure(i)), samples.valves[i])
        if key not in places:
            places[key] = len(tables)
            tables.append(schedule.behind(i, shared=False))
        which[k] = places[key]
    return np.stack(tables, axis=-1), which
