"""Simulation of a batch on the processor: groups of `WIDTH` samples in SIMD vectors, on several threads."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from pliant.batch import simd_loops
from pliant.batch.one_by_one import march_alone
from pliant.batch.samples import Samples
from pliant.batch.schedule import Schedule
from pliant.batch.simd_loops import Lane, Output
from pliant.compiler.choose import lane_twin
from pliant.compiler.simd import WIDTH, aligned
from pliant.mechanics.springs import springs_of
from pliant.simulation import march_loops

Array = np.ndarray


def outputs(samples: Samples, rows: int, variables: Sequence[str]) -> dict[str, Array]:
    """Return arrays for the results of N samples: by variable name, arrays (N, rows, ...) over the output times and, as
    "failed_at" (N,) [s], the times of failure. The latter are NaN until a sample fails.
    """
    n, size = samples.template.n, samples.size
    shapes = {"joint_angle": (size, rows, n), "joint_rate": (size, rows, n), "tip_position": (size, rows, n, 2)}
    results = {name: np.empty(shapes[name]) for name in variables}
    return {**results, "failed_at": np.full(size, np.nan)}


def constant_arrays(samples: Samples) -> list[Array]:
    """Return the constants of N samples, which are along the last axis: inertia, gravity, joint
    springs, link lengths.
    """
    v = samples.values
    springs = springs_of(v)
    joints = np.stack([v["rest_angle"], springs.K, v["damping"], v["joint_gain"], *springs.hardening])
    base = v["base_length"] * np.stack([-np.sin(v["base_angle"]), np.cos(v["base_angle"])])
    place = np.concatenate([v["link_length"], base, v["base_angle"][None]])
    return [*samples.inertia(), samples.values["gravity"], joints, place]


def in_groups(a: Array) -> Array:
    """Rearrange an array (..., N) of N samples to (groups, ..., WIDTH).
    The last group is filled up with the last sample.
    """
    size = a.shape[-1]
    groups = -(-size // WIDTH)
    members = np.minimum(np.arange(groups * WIDTH), size - 1).reshape(groups, WIDTH)
    out = aligned((groups, *a.shape[:-1], WIDTH))
    out[...] = np.moveaxis(a[..., members], -2, 0)
    return out


def unpack(
    samples: Samples, kept: Output, joints: Array, place: Array, requested: dict[str, Array],
) -> None:
    """Copy the output rows of one SIMD group, whose samples are along the last axis, to the arrays of the batch."""
    n, rows = samples.template.n, len(kept.phi)
    tails = {"joint_angle": (n,), "joint_rate": (n,), "tip_position": (n, 2)}
    results = [requested[name] if name in requested else np.empty((0, rows, *tail)) for name, tail in tails.items()]
    lane_twin(simd_loops.unpack_lanes, n)(kept, joints[0], place[-1], *results)


class Groups:
    """Simulator of a batch in SIMD groups of `WIDTH` samples, which several threads take one by one."""

    def __init__(self, samples: Samples, schedule: Schedule, start: Array, results: dict[str, Array]) -> None:
        self.samples = samples
        self.schedule = schedule
        self.start = start
        self.results = results
        self.count = -(-samples.size // WIDTH)
        self.left = iter(range(self.count))  # all threads take from it
        self.prepare()

    def prepare(self) -> None:
        """Convert the samples' constants to group arrays and compile the loop for them."""
        self.constants = [in_groups(a) for a in (*constant_arrays(self.samples), self.start)]
        self.march = lane_twin(simd_loops.march_lanes, self.samples.template.n)

    def members(self, group: int) -> tuple[slice, list[int]]:
        """Return the samples of a group as a slice, and the sample index in each element of its SIMD vector."""
        first = group * WIDTH  # the last group is filled with its last sample
        last = self.samples.size - 1
        return slice(first, min(first + WIDTH, last + 1)), np.minimum(np.arange(first, first + WIDTH), last).tolist()

    def work(self) -> None:
        """Simulate groups until none is left. Each thread runs this method with scratch arrays of its own."""
        n, rows = self.samples.template.n, self.schedule.times.size
        shapes = ((rows, n, WIDTH), (rows, n, WIDTH), (rows, n, 2, WIDTH))
        phi, w, tips = map(aligned, shapes)
        kept = Output(phi, w, tips, np.full(WIDTH, -1))
        scratch = tuple(aligned(shape) for shape in ((n, n, WIDTH), (n, n, WIDTH), (7, n + 1, WIDTH)))
        torque = None
        for group in self.left:
            torque = self.run(group, kept, scratch, torque)

    def run(self, group: int, kept: Output, scratch: tuple[Array, ...], torque: Array | None) -> Array:
        """Simulate one group of samples and store its results. Return its array of torques, so that others reuse it."""
        own, members = self.members(group)
        h, torque, keep = self.schedule.group(members, torque)
        *fixed, joints, place, moving = (a[group] for a in self.constants)
        kept.failed[:] = -1
        self.march(moving, h, torque, keep, Lane(tuple(fixed), joints, place), scratch, kept)
        unpack(self.samples, kept, joints, place, {k: a[own] for k, a in self.results.items()})
        for lane in np.flatnonzero(kept.failed[: own.stop - own.start] >= 0):
            last = kept.failed[lane]
            self.results["failed_at"][own.start + lane] = self.schedule.times[0] + h[: last + 1, lane].sum()
        return torque


class ScalarGroups(Groups):
    """Simulator of a batch of chains with hysteresis, which simulates each chain alone and not in SIMD vectors.

    Slip elements switch at different times in different chains, which a SIMD vector cannot represent.
    """

    def prepare(self) -> None:
        """Do nothing, as chains with hysteresis share no arrays."""

    def work(self) -> None:
        """Simulate the chains of one group after another until none is left. Each thread runs this method."""
        torque = None
        for group in self.left:
            own, members = self.members(group)
            h, torque, keep = self.schedule.group(members, torque)
            for lane, i in enumerate(range(own.start, own.stop)):
                self.simulate_one(i, h[:, lane].copy(), torque[:, lane].copy(), keep)

    def simulate_one(self, i: int, h: Array, torque: Array, keep: Array) -> None:
        """Simulate sample `i` with steps h [s] and mean torques `torque` [N m], and store its results."""
        model, times = self.samples.model(i), self.schedule.times
        gain, none = np.array(model.actuation.gain), (np.zeros((0, 0, 2)), np.zeros((0, 5)))
        steps = march_loops.Steps(h, torque[:, None], gain, keep, *none)
        angle, rate = self.start[:, :, i]
        results, failed = march_alone(model, steps, angle.copy(), rate.copy(), times.size)
        if failed >= 0:
            self.results["failed_at"][i] = times[0] + h[: failed + 1].sum()
        for name in self.results.keys() & results.keys():
            self.results[name][i] = results[name]


def run_lanes(
    samples: Samples, schedule: Schedule, start: Array, variables: Sequence[str], threads: int,
) -> dict[str, Array]:
    """Simulate N samples on the processor. Return arrays (N, T, ...) over T output times by variable name and, as
    "failed_at" (N,) [s], the time at which each sample failed, NaN if it did not.
    """
    results = outputs(samples, schedule.times.size, variables)
    groups = (ScalarGroups if samples.template.memory else Groups)(samples, schedule, start, results)
    threads = min(threads, groups.count)
    if threads <= 1:
        groups.work()
        return results
    with ThreadPoolExecutor(max_workers=threads) as pool:
        for future in [pool.submit(groups.work) for _ in range(threads)]:
            future.result()
    return results
