"""Time steps and mean torques of a batch simulation, for SIMD vectors of eight samples.

Samples whose inputs jump at the same times share their steps. Otherwise the shorter ones are padded with steps of
length zero, which leave a chain unchanged.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pliant.batch import simd_loops
from pliant.batch.samples import Samples
from pliant.compiler.choose import lane_twin
from pliant.compiler.simd import WIDTH, aligned
from pliant.model import Valve
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
        found = through_valve(key[1], self.pressure(i), self.grid(i).nodes, self.initial(i))
        if shared:
            self._behind[key] = found
        return found

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
        # each sample is padded to the longest one with steps of length zero
        plans = {i: drive(self.samples.model(i), self.pressure(i), self.times, self.time_step) for i in set(members)}
        ends = {i: np.flatnonzero(plan.keep >= 0) for i, plan in plans.items()}
        counts = {i: np.diff(end, prepend=-1) for i, end in ends.items()}
        longest = np.max(list(counts.values()), axis=0)
        last = np.cumsum(longest)
        h, torque = aligned((int(last[-1]), WIDTH)), aligned((int(last[-1]), WIDTH))
        h[:], torque[:] = 0.0, 0.0
        for lane, i in enumerate(members):
            before = np.repeat(last - longest - (ends[i] + 1 - counts[i]), counts[i])
            at = np.arange(plans[i].h.size) + before
            h[at, lane], torque[at, lane] = plans[i].h, plans[i].torque[:, 0]
        keep = np.full(int(last[-1]), -1)
        keep[last - 1] = np.arange(1, self.times.size)
        return h, torque, keep
