"""The march of a batch on the processor: groups of `WIDTH` samples side by side, taken by as many threads as asked."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from threading import Lock

import numpy as np

from pliant.batch import simd_loops
from pliant.batch.one_by_one import march_alone
from pliant.batch.samples import Samples
from pliant.batch.schedule import Schedule
from pliant.batch.simd_loops import Lane, Output
from pliant.compiler.simd import WIDTH, aligned, lane_twin
from pliant.mechanics.springs import springs_of
from pliant.simulation import march_loops

Array = np.ndarray


def outputs(samples: Samples, rows: int, variables: Sequence[str]) -> dict[str, Array]:
    """Empty arrays (N, rows, ...) of the variables that are asked for, and failed_at (N,) [s], not a number."""
    n, size = samples.template.n, samples.size
    shapes = {"joint_angle": (size, rows, n), "joint_rate": (size, rows, n), "tip_position": (size, rows, n, 2)}
    made = {name: np.empty(shapes[name]) for name in variables}
    return {**made, "failed_at": np.full(size, np.nan)}


def constant_arrays(samples: Samples) -> list[Array]:
    """Return what stays constant in time: B, I, h, gravity, joints (5 + terms, n, N), lengths and base (n + 3, N)."""
    v = samples.values
    springs = springs_of(v)
    joints = np.stack([v["rest_angle"], springs.K, v["damping"], v["joint_gain"], *springs.hardening])
    base = v["base_length"] * np.stack([-np.sin(v["base_angle"]), np.cos(v["base_angle"])])
    place = np.concatenate([v["link_length"], base, v["base_angle"][None]])
    return [*samples.inertia(), samples.values["gravity"], joints, place]


def in_groups(a: Array) -> Array:
    """An array (..., N) as (groups, ..., WIDTH); the last group repeats its last sample."""
    size = a.shape[-1]
    groups = -(-size // WIDTH)
    members = np.minimum(np.arange(groups * WIDTH), size - 1).reshape(groups, WIDTH)
    out = aligned((groups, *a.shape[:-1], WIDTH))
    out[...] = np.moveaxis(a[..., members], -2, 0)
    return out


def unpack(
    samples: Samples, kept: Output, joints: Array, place: Array, asked: dict[str, Array],
) -> None:
    """Write the kept rows (rows, n[, 2], W) of a SIMD batch to the result arrays (samples, rows, n[, 2])."""
    n, rows = samples.template.n, len(kept.phi)
    tails = {"joint_angle": (n,), "joint_rate": (n,), "tip_position": (n, 2)}
    made = [asked[name] if name in asked else np.empty((0, rows, *tail)) for name, tail in tails.items()]
    lane_twin(simd_loops.unpack_lanes, n)(kept, joints[0], place[-1], *made)


class Groups:
    """The groups of a batch, and what marching one of them takes and gives."""

    def __init__(self, samples: Samples, schedule: Schedule, start: Array, made: dict[str, Array]) -> None:
        self.samples = samples
        self.schedule = schedule
        self.start = start
        self.made = made
        self.count = -(-samples.size // WIDTH)
        self._left = iter(range(self.count))
        self._lock = Lock()
        self.prepare()

    def prepare(self) -> None:
        """Prepare the arrays and the compiled march that all groups share."""
        self.constants = [in_groups(a) for a in (*constant_arrays(self.samples), self.start)]
        self.march = lane_twin(simd_loops.march_lanes, self.samples.template.n)

    def members(self, group: int) -> tuple[slice, list[int]]:
        """The samples of a group, and who is in its vectors: the last group repeats its last sample."""
        first = group * WIDTH
        last = self.samples.size - 1
        return slice(first, min(first + WIDTH, last + 1)), np.minimum(np.arange(first, first + WIDTH), last).tolist()

    def next(self) -> int | None:
        """The next group that nobody works on: a thread that is done with one takes another."""
        with self._lock:
            return next(self._left, None)

    def work(self) -> None:
        """March one group after the other until none is left; one thread's part, with arrays of its own."""
        n, rows = self.samples.template.n, self.schedule.times.size
        shapes = ((rows, n, WIDTH), (rows, n, WIDTH), (rows, n, 2, WIDTH))
        phi, w, tips = map(aligned, shapes)
        kept = Output(phi, w, tips, np.full(WIDTH, -1))
        scratch = tuple(aligned(shape) for shape in ((n, n, WIDTH), (n, n, WIDTH), (6, n + 1, WIDTH)))
        torque = None
        while (group := self.next()) is not None:
            torque = self.run(group, kept, scratch, torque)

    def run(self, group: int, kept: Output, scratch: tuple[Array, ...], torque: Array | None) -> Array:
        """March one group and put its samples where they belong; returns the array of torques, to be used again."""
        own, members = self.members(group)
        h, torque, keep = self.schedule.group(members, torque)
        *fixed, joints, place, moving = (a[group] for a in self.constants)
        kept.failed[:] = -1
        self.march(moving, h, torque, keep, Lane(tuple(fixed), joints, place), scratch, kept)
        unpack(self.samples, kept, joints, place, {k: a[own] for k, a in self.made.items()})
        for lane in np.flatnonzero(kept.failed[: own.stop - own.start] >= 0):
            last = kept.failed[lane]
            self.made["failed_at"][own.start + lane] = self.schedule.times[0] + h[: last + 1, lane].sum()
        return torque


class Alone(Groups):
    """Groups of chains with hysteresis: inputs are prepared together, each chain is integrated by itself.

    Which elements slip differs from chain to chain, and vectors cannot part.
    """

    def prepare(self) -> None:
        """Nothing that all chains need."""

    def work(self) -> None:
        """Same as `Groups.work`."""
        torque = None
        while (group := self.next()) is not None:
            own, members = self.members(group)
            h, torque, keep = self.schedule.group(members, torque)
            for lane, i in enumerate(range(own.start, own.stop)):
                self.alone(i, h[:, lane].copy(), torque[:, lane].copy(), keep)

    def alone(self, i: int, h: Array, torque: Array, keep: Array) -> None:
        """March sample `i` and put it where it belongs."""
        model, times = self.samples.model(i), self.schedule.times
        steps = march_loops.Steps(h, torque[:, None], np.array(model.actuation.gain), keep, np.zeros((0, 0, 2)))
        angle, rate = self.start[:, :, i]
        made, failed = march_alone(model, steps, angle.copy(), rate.copy(), times.size)
        if failed >= 0:
            self.made["failed_at"][i] = times[0] + h[: failed + 1].sum()
        for name in self.made.keys() & made.keys():
            self.made[name][i] = made[name]


def run_lanes(
    samples: Samples, schedule: Schedule, start: Array, variables: Sequence[str], threads: int,
) -> dict[str, Array]:
    """March all samples: the variables (N, T, ...) that are asked for, and failed_at (N,)."""
    made = outputs(samples, schedule.times.size, variables)
    groups = (Alone if samples.template.memory else Groups)(samples, schedule, start, made)
    threads = min(threads, groups.count)
    if threads <= 1:
        groups.work()
        return made
    with ThreadPoolExecutor(max_workers=threads) as pool:
        for future in [pool.submit(groups.work) for _ in range(threads)]:
            future.result()
    return made
