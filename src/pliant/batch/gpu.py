"""Simulation of a batch on an NVIDIA GPU: transfer of the inputs, and collection of the results."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pliant.batch.samples import Samples
from pliant.batch.schedule import Schedule
from pliant.batch.simd import constant_arrays, outputs, unpack
from pliant.batch.simd_loops import Output
from pliant.errors import InputError
from pliant.plugins import optional

Array = np.ndarray
BYTES = 2**29  # memory of a launch on the GPU: a larger batch is split


def check_gpu(samples: Samples) -> None:
    """Raise InputError if there is no GPU, or if the models have features that the GPU code lacks."""
    missing = "device='gpu' needs the extra 'gpu': pip install 'pliant[gpu]', or use device='cpu'"
    if not optional("pliant.batch.gpu_loops", missing).present():
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
    """Simulate N samples on the GPU. Return arrays (N, T, ...) over T output times by variable name and, as "failed_at"
    (N,) [s], the time at which each sample failed, NaN if it did not.
    """
    results = outputs(samples, schedule.times.size, variables)  # samples with the same time steps are launched together
    grids: dict[int, list[int]] = {}
    for i in range(samples.size):
        grids.setdefault(id(schedule.grid(i)), []).append(i)
    for members in grids.values():
        steps = schedule.grid(members[0]).keep.size
        part = max(1, BYTES // (8 * (steps + 4 * samples.template.n * schedule.times.size)))
        for first in range(0, len(members), part):
            launch_samples(samples, schedule, start, np.array(members[first : first + part]), results)
    return results


def launch_samples(
    samples: Samples, schedule: Schedule, start: Array, indices: Array, results: dict[str, Array],
) -> None:
    """Simulate on the GPU the samples at `indices`, which have equal time steps; write to `results` in place."""
    from pliant.batch.gpu_loops import launch

    n, rows, count = samples.template.n, schedule.times.size, indices.size
    grid = schedule.grid(indices[0])
    behind, which = inputs(samples, schedule, indices)
    h = np.ascontiguousarray(grid.steps[:, 0])
    constants = [a[..., indices] for a in constant_arrays(samples)]
    law = samples.values["torque"][:, indices]
    given = (h, grid.keep, grid.intervals[:, 0], grid.parts, behind, which, law, *constants)
    scratch = ((n, n, count), (n, n, count), (6, n + 1, count), (h.size, count))
    state, failed = start[..., indices].copy(), np.full(count, -1)
    kept = Output(np.empty((rows, n, count)), np.empty((rows, n, count)), np.empty((rows, n, 2, count)), failed)
    launch(n, given, scratch, (state, *kept))
    part_results = {name: np.empty((count, *a.shape[1:])) for name, a in results.items() if name != "failed_at"}
    unpack(samples, kept, constants[-2], constants[-1], part_results)
    for name, a in part_results.items():
        results[name][indices] = a
    for k in np.flatnonzero(failed >= 0):
        results["failed_at"][indices[k]] = schedule.times[0] + h[: failed[k] + 1].sum()


def inputs(samples: Samples, schedule: Schedule, indices: Array) -> tuple[Array, Array]:
    """Return the K distinct pressure series behind the valves as one array (m, 4, K) [Pa], and for each sample the
    index of its series. The four values in each of m intervals are at start, middle and end, and the mean.
    """
    places: dict[object, int] = {}
    tables: list[Array] = []
    which = np.empty(indices.size, dtype=np.int64)
    for k, i in enumerate(indices.tolist()):
        key = (id(schedule.pressure(i)), samples.valves[i])
        if key not in places:
            places[key] = len(tables)
            tables.append(schedule.behind(i, shared=False))
        which[k] = places[key]
    return np.stack(tables, axis=-1), which
