"""Batch simulation of chains in space in groups of `WIDTH` samples, one in each element of a SIMD vector.

Springs, chambers with their valves and laws, and segments that lengthen are those of single simulations, and so are the
results, to rounding. Chains with hysteresis or tendons, whose steps iterate, are simulated by `one_by_one`, as are
those of which some alone have bounded springs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from pliant.batch import space_loops
from pliant.batch.samples import initial_values
from pliant.batch.space_loops import LaneRows, LaneSteps
from pliant.compiler import WIDTH
from pliant.compiler.choose import lane_twin
from pliant.compiler.simd import aligned
from pliant.mechanics import Mechanics, mechanics_of
from pliant.mechanics.spatial import SpatialChain
from pliant.model import Model, Valve
from pliant.shapes import Float
from pliant.simulation import state
from pliant.simulation.drive import Drive, Layout, Timeline, driven, initial_pressures, inputs_of, laid_out
from pliant.simulation.inputs import Input
from pliant.simulation.solve import STEPS_PER_PERIOD, check_step

Array = np.ndarray
MOVE = 1e-3  # rad, at which the curvature of the energy is computed


def fits_lanes(model: Model) -> bool:
    """Return whether a model can be simulated in SIMD vectors of chains in space."""
    return mechanics_of(model).simd == "space"


class SpaceBatch(NamedTuple):
    """What all groups of a batch share: samples, output times and the arrays of the results."""

    models: Sequence[Model]
    pressures: Sequence[Sequence[Input]]
    times: Array
    time_step: float
    how: Mapping[str, Any]
    rest: Array  # (samples, N) equilibrium without inputs
    results: dict[str, Array]
    timelines: dict[Any, Timeline]  # of inputs with equal jumps
    layouts: dict[tuple[int, tuple[float, ...]], Layout]  # of inputs that several samples share
    stacks: dict[Any, Array]  # pressures behind the valves that all samples of a group share

    def layout(self, i: int) -> Layout:
        """Return the time steps of sample `i` and the commanded pressures in them."""
        model, inputs = self.models[i], self.pressures[i]
        dead_times = tuple(c.valve.dead_time for c in model.chambers)
        layout = self.layouts.get((id(inputs), dead_times))
        if layout is None:
            many = inputs_of(model, inputs)
            layout = laid_out(many, dead_times, self.times, self.time_step, timelines=self.timelines)
            if self.pressures[0] is self.pressures[-1]:  # one set of inputs for all samples
                self.layouts[id(inputs), dead_times] = layout
        return layout


def run_in_space(
    models: Sequence[Model], pressures: Sequence[Sequence[Input]], times: Float[Array, " T"], time_step: float,
    how: Mapping[str, Any], shapes: Mapping[str, tuple[int, ...]],
) -> dict[str, Array]:
    """Simulate N samples in SIMD vectors. Return the variables in `shapes`, arrays (N, T, ...) over T output times, and
    as "failed_at" (N,) [s] the time at which each sample failed, NaN if it did not.
    """
    rest = unloaded_rest(models)
    check_steps_in_space(models, rest, time_step)
    size = len(models)
    results = {name: np.empty((size, times.size, *shape)) for name, shape in shapes.items()}
    results["failed_at"] = np.full(size, np.nan)
    task = SpaceBatch(models, pressures, times, time_step, how, rest, results, {}, {}, {})
    with ThreadPoolExecutor(max_workers=how["threads"]) as pool:
        for _ in pool.map(lambda first: run_group(task, first), range(0, size, WIDTH)):
            pass
    return task.results


def run_group(task: SpaceBatch, first: int) -> None:
    """Simulate the samples from index `first` that share a SIMD vector, and store their results."""
    last = min(first + WIDTH, len(task.models)) - 1
    members = np.minimum(np.arange(first, first + WIDTH), last)  # the last group is filled with its last sample
    layouts = {i: task.layout(i) for i in set(members.tolist())}
    chains = [mechanics_of(task.models[i]) for i in members]
    steps = group_steps(task, members.tolist(), layouts)
    start = {i: starting_state(task, i, layout) for i, layout in layouts.items()}
    body, joints = (lanes_last([getattr(c, name) for c in chains]) for name in ("body", "joints"))
    work = scratch_of(chains[0])
    shape = task.times.size, task.models[first].size, WIDTH
    out = LaneRows(aligned(shape), aligned(shape), np.full(WIDTH, -1))
    march = lane_twin(space_loops.march_in_space, *chains[0].sizes)
    march(stacked([start[i] for i in members.tolist()]), steps, body, joints, work, out)
    for lane, k in enumerate(out.failed[: last + 1 - first].tolist()):
        if k >= 0:
            task.results["failed_at"][first + lane] = task.times[0] + steps.h[: k + 1, lane].sum()
            out.x[..., lane] = out.v[..., lane] = np.nan
    if "tip_position" in task.results:
        tips = aligned((task.times.size, task.models[first].n, 3, WIDTH))
        lane_twin(space_loops.tips_in_space, *chains[0].sizes)(out.x, body, work, tips)
        task.results["tip_position"][first : last + 1] = np.moveaxis(tips, -1, 0)[: last + 1 - first]
    store(task.results, slice(first, last + 1), chains[0], out)


def group_steps(task: SpaceBatch, members: Sequence[int], layouts: Mapping[int, Layout]) -> LaneSteps:
    """Return the time steps of W samples: in SIMD vectors if their inputs jump at the same times and their chambers
    have no slow states, else each sample's own, padded.
    """
    many, models = [layouts[i] for i in members], [task.models[i] for i in members]
    line = many[0].timeline
    if any(one.timeline is not line for one in many) or not all(c.plain for m in models for c in m.chambers):
        plans = {i: driven(task.models[i], layout) for i, layout in layouts.items()}
        return shared_steps([plans[i] for i in members], task.times.size)
    h, lengths = (stacked([part] * WIDTH) for part in line.intervals[:2])
    torque, mean = aligned((len(h), models[0].actuation.count, WIDTH)), aligned(h.shape)
    for c in range(models[0].actuation.count):
        law = stacked(padded([m.chambers[c].torque for m in models]))
        behind = pressures_behind(task, c, many, [m.chambers[c].valve for m in models])
        lane_twin(space_loops.mean_torques_in_space, 1)(h, lengths, line.intervals.first, behind, law, mean)
        torque[:, c] = mean
    return LaneSteps(h, torque, stacked([np.array(m.actuation.columns) for m in models]), line.grid.keep)


def padded(laws: Sequence[Array]) -> Sequence[Array]:
    """Return the coefficients of polynomial torque laws, filled with zeros to one length."""
    longest = max(map(len, laws))
    return laws if all(len(a) == longest for a in laws) else [np.pad(a, (0, longest - len(a))) for a in laws]


def pressures_behind(task: SpaceBatch, c: int, layouts: Sequence[Layout], valves: Sequence[Valve]) -> Array:
    """Return the pressures (m, 4, W) [Pa] of chamber `c` of W samples behind their valves in m intervals: start,
    middle, end and mean.
    """
    keys = {(id(layout), c, valve) for layout, valve in zip(layouts, valves, strict=True)}
    shared = keys.pop() if len(keys) == 1 and layouts[0] in task.layouts.values() else None
    if shared in task.stacks:
        return task.stacks[shared]
    behind = stacked([layout.behind(c, valve) for layout, valve in zip(layouts, valves, strict=True)])
    if shared:
        task.stacks[shared] = behind
    return behind


def starting_state(task: SpaceBatch, i: int, layout: Layout) -> Array:
    """Return the coordinates and rates (2, N) of sample `i` at the first time."""
    model, chain, size = task.models[i], mechanics_of(task.models[i]), len(task.models)
    angle, rate = (
        None if task.how[name] is None else initial_values(task.how[name], size, model.size)[i]
        for name in ("initial_angle", "initial_rate")
    )
    if angle is None:
        initial = initial_pressures(model, layout)
        angle = state.equilibrium(model, initial) if initial.any() else task.rest[i]
    return np.stack([chain.coordinates(angle), chain.rates(np.zeros(model.size) if rate is None else rate)])


def shared_steps(plans: Sequence[Drive], rows: int) -> LaneSteps:
    """Return the time steps of W samples as arrays with the samples last. A sample with fewer steps between two output
    times gets steps of length 0 there.
    """
    ends = [np.flatnonzero(plan.keep >= 0) for plan in plans]
    counts = [np.diff(end, prepend=-1) for end in ends]
    longest = np.max(counts, axis=0)
    last = np.cumsum(longest)
    h, torque = aligned((int(last[-1]), WIDTH)), aligned((int(last[-1]), plans[0].torque.shape[1], WIDTH))
    h[:], torque[:] = 0.0, 0.0
    for lane, (plan, end, count) in enumerate(zip(plans, ends, counts, strict=True)):
        shift = np.repeat(last - longest - (end + 1 - count), count)
        index = np.arange(plan.h.size) + shift
        h[index, lane], torque[index, :, lane] = plan.h, plan.torque
    keep = np.full(int(last[-1]), -1)
    keep[last - 1] = np.arange(1, rows)
    return LaneSteps(h, torque, stacked([plan.gain for plan in plans]), keep)


def stacked(arrays: Sequence[Any]) -> Array:
    """Return W arrays of one shape as one array with the samples last, aligned to SIMD registers."""
    out = aligned((*np.shape(arrays[0]), len(arrays)))
    if all(a is arrays[0] for a in arrays):  # of samples that are one model
        out[...] = np.asarray(arrays[0])[..., None]
        return out
    for lane, a in enumerate(arrays):
        out[..., lane] = a
    return out


def scratch_of(chain: Mechanics) -> Any:
    """Return the scratch arrays of a chain as a record of arrays for W samples, with the samples last."""
    work = chain.workspace()
    return type(work)(*(aligned((*a.shape, WIDTH), np.zeros) for a in work))


def lanes_last(records: Sequence[Any]) -> Any:
    """Return W records of one type as a record of arrays with the samples last."""
    return type(records[0])(*(stacked(column) for column in zip(*records, strict=True)))


def store(results: dict[str, Array], rows: slice, chain: Mechanics, out: LaneRows) -> None:
    """Copy the coordinates of a group's output rows, and their rates, to the arrays of the batch."""
    x, v = (np.moveaxis(a, -1, 0)[: rows.stop - rows.start] for a in (out.x, out.v))  # (samples, T, N)
    for kind in chain.kinds:
        for name, values in zip(kind.names[:2], (x, v), strict=True):
            if name in results:
                results[name][rows] = values[..., kind.rows]


def every_chain(chains: Sequence[Any]) -> SpatialChain:
    """Return one chain whose constants are those of S chains, along the last axis. Its functions take coordinates
    (..., S, N).
    """
    body, joints = (lanes_last([getattr(c, name) for c in chains]) for name in ("body", "joints"))
    return SpatialChain(chains[0].model, body, joints)


def unloaded_rest(models: Sequence[Model]) -> Array:
    """Return the equilibria (S, N) of S models without inputs; a model that occurs again is solved once."""
    known: dict[int, Array] = {}
    for model in models:
        if id(model) not in known:
            known[id(model)] = state.equilibrium(model, np.zeros(model.actuation.count))
    return np.stack([known[id(model)] for model in models])


def check_steps_in_space(models: Sequence[Model], rest: Array, time_step: float) -> None:
    """Raise InputError if the step [s] is too long for the first mode of any of S models, whose equilibria are `rest`
    (S, N).

    Rayleigh's quotient of equal bends about x bounds the frequencies of all samples; only where the bound is too high,
    the modes themselves are computed.
    """
    check_step(models[0], time_step, "midpoint")
    every = every_chain([mechanics_of(model) for model in models])
    bend = np.zeros_like(rest)
    bend[:, 0 : 2 * models[0].n : 2] = 1.0
    moved = [every.energy(rest + sign * MOVE * bend, 0.0 * rest) for sign in (-1.0, 0.0, 1.0)]
    low, middle, high = (energy.elastic + energy.gravity for energy in moved)
    squared = (low - 2.0 * middle + high) / MOVE**2 / (2.0 * every.energy(rest, bend).kinetic)
    bound = np.sqrt(np.maximum(squared, 0.0)) / (2.0 * np.pi)
    for i in np.flatnonzero(~(time_step * STEPS_PER_PERIOD * bound < 1.0)).tolist():
        check_step(models[i], time_step, "midpoint")
