"""Simulation of a batch on the processor: groups of `WIDTH` samples in SIMD vectors, on several threads.

Time steps and mean torques of a batch simulation, for SIMD vectors of eight samples.

Samples whose inputs jump at the same times share their steps. Otherwise the shorter ones are padded with steps of
length zero, which leave a chain unchanged.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from pliant.batch import simd_loops
from pliant.batch.one_by_one import march_alone
from pliant.batch.samples import Samples
from pliant.batch.simd_loops import Lane, Output
from pliant.batch.space_lanes import shared_steps
from pliant.compiler import WIDTH
from pliant.compiler.choose import lane_twin
from pliant.compiler.simd import aligned
from pliant.compiler.trace import BOUNDED, spring_rows
from pliant.equations.spring_terms import SPRING_BOUND
from pliant.mechanics.springs import springs_of
from pliant.model import Valve
from pliant.simulation import march_loops
from pliant.simulation.chamber_course import delivered
from pliant.simulation.drive import before, drive, grid, through_valve
from pliant.simulation.inputs import Input

Array = np.ndarray


class LaneGrid(NamedTuple):
    """Time steps of a SIMD vector of samples, the intervals into which pressure inputs divide them, and the output
    rows.
    """

    nodes: Array  # (m + 1,) s
    parts: Array  # (steps + 1,) first interval of each step
    intervals: Array  # (m, W) s, the same for all samples
    steps: Array  # (steps, W) s
    keep: Array  # (steps,) row of the output after the step, negative: none


class Schedule:
    """Time steps of a batch whose samples run in SIMD groups, and the torques averaged over each step. What several
    samples share is computed once.
    """

    def __init__(self, samples: Samples, pressures: Sequence[Input], times: Array, time_step: float) -> None:
        self.samples = samples
        self.pressures = pressures  # one for all samples, or one for each
        self.times = times
        self.time_step = time_step
        self._grids: dict[tuple[bytes, bytes, float], LaneGrid] = {}
        self._behind: dict[tuple[int, Valve], Array] = {}
        self._stacks: dict[tuple[tuple[int, Valve], ...], Array] = {}
        self.remembering = samples.remembering
        self.alike = len(self.pressures) == 1 and len(set(samples.valves)) == 1  # all samples get the same pressure

    def pressure(self, i: int) -> Input:
        """Return the pressure input of sample `i`."""
        return self.pressures[i if len(self.pressures) > 1 else 0]

    def initial(self, i: int) -> float:
        """Return the pressure [Pa] behind the valve of sample `i` before the first time."""
        valve = self.samples.valves[i]
        return delivered(valve, before(self.pressure(i), valve.dead_time, self.times))

    def grid(self, i: int) -> LaneGrid:
        """Return the time steps and intervals of sample `i`. Samples with equal inputs share one result."""
        source, dead = self.pressure(i), self.samples.valves[i].dead_time
        key = (source.jumps.tobytes(), source.breakpoints.tobytes(), dead)
        if key not in self._grids:
            _, corners, fine, keep = grid([source], [dead], self.times, self.time_step)
            intervals, steps = aligned((fine.size - 1, WIDTH)), aligned((keep.size, WIDTH))
            intervals[:], steps[:] = np.diff(fine)[:, None], np.diff(corners)[:, None]
            lane_grid = LaneGrid(fine, np.searchsorted(fine, corners), intervals, steps, keep)
            self._grids.setdefault(key, lane_grid)  # the first of two threads: grids are compared by identity
        return self._grids[key]

    def behind(self, i: int, *, shared: bool) -> Array:
        """Return the pressure (m, 4) [Pa] of sample `i` behind its valve in m time intervals. The four columns are the
        values at start, middle and end, and the mean.
        """
        key = (id(self.pressure(i)), self.samples.valves[i])  # `shared`: keep the result for other samples
        if key in self._behind:
            return self._behind[key]
        passed = through_valve(key[1], self.pressure(i), self.grid(i).nodes, self.initial(i))
        if shared:
            self._behind[key] = passed
        return passed

    def group(self, members: Sequence[int], buffer: Array | None = None) -> tuple[Array, Array, Array]:
        """Return step lengths [s] and mean torques [N m] of a group of W = `WIDTH` samples, both (steps, W), and the
        output row after each step (steps,).

        The torques are written to `buffer` if it has the right shape.
        """
        grids = [self.grid(i) for i in (members[:1] if self.alike else members)]
        if any(g is not grids[0] for g in grids) or self.remembering[members].any():
            return self.padded(members)
        grid = grids[0]
        keys = tuple((id(self.pressure(i)), self.samples.valves[i]) for i in members)
        alike = len(set(keys)) == 1
        stack = self._stacks.get(keys) if alike else None
        if stack is None:
            stack = aligned((len(grid.intervals), 4, WIDTH))
            for lane, i in enumerate(members):
                stack[..., lane] = self.behind(i, shared=len(self.pressures) == 1)
            if alike:
                self._stacks[keys] = stack
        law = aligned((len(self.samples.values["torque"]), WIDTH))
        law[:] = self.samples.values["torque"][:, members]
        torque = buffer if buffer is not None and buffer.shape == grid.steps.shape else aligned(grid.steps.shape)
        lane_twin(simd_loops.mean_torques, self.samples.template.n)(grid.intervals, grid.parts, stack, law, torque)
        return grid.steps, torque, grid.keep

    def padded(self, members: Sequence[int]) -> tuple[Array, Array, Array]:
        """Return step lengths [s], mean torques [N m] and output rows for a group of samples with different time steps
        or slow chamber states. Steps of length 0 are added so that all have the same number.
        """
        plans = {i: drive(self.samples.model(i), self.pressure(i), self.times, self.time_step) for i in set(members)}
        steps = shared_steps([plans[i] for i in members], self.times.size)
        return steps.h, steps.torque[:, 0], steps.keep


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
    springs, rows = springs_of(v), spring_rows(laws_of(samples))
    joints = np.stack([v["rest_angle"], springs.K, v["damping"], v["joint_gain"], *springs.hardening[:rows]])
    base = v["base_length"] * np.stack([-np.sin(v["base_angle"]), np.cos(v["base_angle"])])
    lengths = np.concatenate([v["link_length"], base, v["base_angle"][None]])
    return [*samples.inertia(), samples.values["gravity"], joints, lengths]


def laws_of(samples: Samples) -> int:
    """Return the laws of N samples that `choose.twin` takes: whether the softening of a spring is bounded."""
    return BOUNDED * bool(samples.values[SPRING_BOUND].any())


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
        self.march = lane_twin(simd_loops.march_lanes, self.samples.template.n, 0, 1, 0, laws_of(self.samples))

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
        output = Output(phi, w, tips, np.full(WIDTH, -1))
        scratch = tuple(aligned(shape) for shape in ((n, n, WIDTH), (n, n, WIDTH), (7, n + 1, WIDTH)))
        torque = None
        for group in self.left:
            torque = self.run(group, output, scratch, torque)

    def run(self, group: int, kept: Output, scratch: tuple[Array, ...], torque: Array | None) -> Array:
        """Simulate one group of samples and store its results. Return its array of torques, so that others reuse it."""
        inputs, members = self.members(group)
        h, torque, keep = self.schedule.group(members, torque)
        *fixed, joints, placement, moving = (a[group] for a in self.constants)
        kept.failed[:] = -1
        self.march(moving, h, torque, keep, Lane(tuple(fixed), joints, placement), scratch, kept)
        unpack(self.samples, kept, joints, placement, {k: a[inputs] for k, a in self.results.items()})
        for lane in np.flatnonzero(kept.failed[: inputs.stop - inputs.start] >= 0):
            last = kept.failed[lane]
            self.results["failed_at"][inputs.start + lane] = self.schedule.times[0] + h[: last + 1, lane].sum()
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
            inputs, members = self.members(group)
            h, torque, keep = self.schedule.group(members, torque)
            for lane, i in enumerate(range(inputs.start, inputs.stop)):
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
