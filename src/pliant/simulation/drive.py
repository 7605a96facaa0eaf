"""Time steps of a simulation under pressure inputs, with the mean torque of each chamber in each step.

The torque of a step is its mean over the step, integrated between the breakpoints of the input. Every jump of a
pressure is the end of a step. The result therefore does not depend on how the edges of the input and the steps align.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from pliant.compiler.choose import twin
from pliant.equations.chamber import mean_of_law
from pliant.equations.symbols import Interval
from pliant.errors import InputError, SimulationError
from pliant.mechanics import mechanics_of
from pliant.model import ActuationInput, Model, Valve
from pliant.numerics.ridge import lagged
from pliant.shapes import Float
from pliant.simulation.chamber_course import (
    Intervals,
    delivered,
    pass_valve,
    row_of,
    take_torques,
    torque_slopes,
    valve_constants,
    valve_row,
)
from pliant.simulation.inputs import Input
from pliant.simulation.march_loops import Steps

Array = np.ndarray
_GAUSS = 0.5 / np.sqrt(3.0)
LONGEST = 1e8  # steps in one simulation: more do not fit into memory
_SAME = 1e-9  # of a step: times closer than this are equal but for rounding
_FINER = 0.5 ** np.arange(5, 0, -1)  # where the first step after a jump is divided: at 1/32, 1/16 ... 1/2 of it
SAME_TIME = 1e-9  # s


class Drive(NamedTuple):
    """Time steps of a simulation with the mean torque of each chamber, and the pressures at the output times."""

    h: Array  # (steps,) s
    torque: Array  # (steps, C) N m, mean of each chamber over each step
    gain: Array  # (C, n) fraction of the chamber's torque at each joint
    keep: Array  # (steps,) output row of the state after the step; negative: no output
    pressure: Array  # (rows, C) Pa, behind the valves, at the output times
    initial: Array  # (C,) Pa, just before the first time, so that a jump there is part of the motion
    stretch: Array | None = None  # (rows, C) hoop stretch at the output times, if a chamber inflates
    load: Array = np.zeros((0, 0, 2))  # (steps, n, 2) N m, mean loads of the links over each step; no rows: no forces
    layout: Layout | None = None  # of the steps
    base: Array = np.zeros((0, 5))  # (steps, 5), in space (steps, 6), motion of the base, see `equations.base`

    @property
    def steps(self) -> Steps:
        """The arguments of the compiled time-stepping loop: step lengths, torques, output rows, loads and base."""
        return Steps(self.h, self.torque, self.gain, self.keep, self.load, self.base)

    @property
    def joint_torque(self) -> Array:
        """Mean torque (steps, n) [N m] of each joint over each step."""
        return np.asarray(self.torque @ self.gain)


class Grid(NamedTuple):
    """Time steps between the output times of a simulation, and the finer intervals between the inputs' kinks."""

    corners: Array  # s, the output times and the jumps, between which all steps are equal
    nodes: Array  # (steps + 1,) s
    fine: Array  # (m + 1,) s, with the breakpoints of the inputs between the nodes
    keep: Array  # (steps,) output row of the state after the step, or -1; -2 where the step ends at a jump


class Driven(NamedTuple):
    """Mean torque in each time step, and pressure and stretch at the output times, of one chamber."""

    torque: Array  # (steps,) N m, mean over each step
    pressure: Array  # (rows,) Pa, behind the valve, at the output times
    stretch: Array  # (rows,) hoop stretch, at the output times


class Timeline:
    """Time steps of a simulation, which inputs with equal jumps and breakpoints share."""

    def __init__(self, grid: Grid, times: Array) -> None:
        self.grid, self.at = grid, np.searchsorted(grid.fine, times)
        first = np.searchsorted(grid.fine, grid.nodes)
        self.intervals = Intervals(np.diff(grid.nodes), np.diff(grid.fine), first)
        self._points: dict[float, Array] = {}

    def points(self, dead_time: float) -> Array:
        """Return the times (2, m) [s] at which an input with this `dead_time` [s] is evaluated (`inner_points`)."""
        if dead_time not in self._points:
            self._points[dead_time] = inner_points(self.grid.fine, dead_time)
        return self._points[dead_time]


class Layout:
    """Time steps of a simulation for given inputs, and the commanded pressures in them.

    Of the chambers only the dead times affect the steps. Pressures behind valves and torques of chambers are cached,
    for models that differ only in other parameters.
    """

    def __init__(
        self, inputs: Sequence[Input], dead_times: Sequence[float], times: Array, timeline: Timeline,
    ) -> None:
        self.timeline, self.grid, self.at, self.intervals = timeline, timeline.grid, timeline.at, timeline.intervals
        self.keep = self.grid.keep
        pairs = list(zip(inputs, dead_times, strict=True))
        self.commands = [between(source(timeline.points(dead))) for source, dead in pairs]
        self.jumps = [source.jumps + dead for source, dead in pairs]
        self.initial = np.array([before(source, dead, times) for source, dead in pairs])
        self._behind: dict[tuple[int, Valve], Array] = {}
        self._driven: dict[tuple[Any, ...], Driven] = {}

    def behind(self, c: int, valve: Valve) -> Array:
        """Return the pressure (m, 4) [Pa] of chamber `c` behind its valve in m time intervals.
        The four columns are the values at start, middle and end, and the mean.
        """
        if (c, valve) not in self._behind:
            self._behind[c, valve] = lagging(valve, self.intervals.lengths, self.commands[c], self.resting(c, valve))
        return self._behind[c, valve]

    def resting(self, c: int, valve: Valve) -> float:
        """Return the initial pressure [Pa] of chamber `c` behind its valve."""
        return delivered(valve, float(self.initial[c]))

    def driven(self, c: int, chamber: ActuationInput) -> Driven:
        """Return the mean torques of chamber `c` in all time steps, with its pressure and stretch
        at the output times.
        """
        key = (c, chamber.key)
        if key not in self._driven:
            behind = self.behind(c, chamber.valve)
            torque, grown = np.empty(self.intervals.h.size), np.ones(self.intervals.lengths.size + 1)
            if not chamber.plain:
                row = row_of(chamber, self.resting(c, chamber.valve))
                take_torques(twin, chamber, row, self.intervals, behind, torque, grown)
            else:  # arithmetic on whole arrays, which needs no compilation before the first simulation
                impulse = self.intervals.lengths * mean_of_law(Interval(*behind.T), chamber.kernel().law)
                torque = np.add.reduceat(impulse, self.intervals.first[:-1]) / self.intervals.h
            levels = np.append(behind[self.at[:-1], 0], behind[-1, 2])
            stretch = grown[self.at] ** 0.25 if chamber.grows else np.ones_like(levels)
            self._driven[key] = Driven(torque, levels, stretch)
        return self._driven[key]

    def jump_slope(self, c: int, k: int) -> Array | None:
        """Return the derivative (steps,) of all step lengths with respect to the time of jump `k` of chamber `c`'s
        input, or None if this derivative does not exist.

        Only the lengths of the steps next to the jump change. None if the jump does not exist, if its time is also an
        output time or is otherwise not the end of a step, or if inputs have breakpoints within steps.
        """
        corners, nodes = self.grid.corners, self.grid.nodes
        if k >= self.jumps[c].size or self.grid.fine.size > nodes.size:
            return None
        moment = self.jumps[c][k]
        i = int(np.searchsorted(corners, moment))
        if not (0 < i < corners.size - 1 and corners[i] == moment):
            return None
        first, corner, last = np.searchsorted(nodes, corners[i - 1 : i + 2])
        if self.keep[corner - 1] >= 0:
            return None
        slope = np.zeros(nodes.size - 1)
        slope[first:corner], slope[corner:last] = 1.0 / (corner - first), -1.0 / (last - corner)
        return slope

    def torque_slopes(self, chambers: Sequence[ActuationInput], rows: Array, h: Array) -> Array:
        """Return the derivatives (steps, C, WIDTH) of the mean torques of C chambers in each time step with respect to
        WIDTH variables. The chambers' constants `rows` and the step lengths `h` are dual numbers: values with their
        derivatives by these variables.

        `rows` has one row for each chamber (`row_of`), h (steps,) one length for each step. Where inputs have
        breakpoints within steps, the derivatives of h must be 0.
        """
        pairs = zip(chambers, rows, self.commands, strict=True)
        return np.stack([torque_slopes(c, row, self.intervals._replace(h=h), u) for c, row, u in pairs], axis=1)


def inputs_of(model: Model, pressure: Any) -> tuple[Input, ...]:
    """Return the pressure inputs of a model as a tuple, one per chamber.
    A single input is accepted for a single chamber.

    Raises
    ------
    InputError
        When an object is not an input, or their number is not that of the chambers.
    """
    many = tuple(pressure) if isinstance(pressure, Sequence) else (pressure,)
    for what in many:
        if not all(hasattr(what, name) for name in ("__call__", "jumps", "breakpoints")):
            raise InputError(f"pressure must be an input, like Pulse(level) or Trace(time, pressure), got {what!r:.60}")
    if len(many) != model.actuation.count:
        pressed = model.actuation.variable == "pressure"
        what = "pressure input(s), one for each chamber" if pressed else "inputs, one for each"
        raise InputError(f"model {model.name!r} needs {model.actuation.count} {what} ({model.actuation.listing}) in "
                         f"this order, got {len(many)}")  # fmt: skip
    return many


def drive(
    model: Model, pressure: Input | Sequence[Input], times: Array, time_step: float, *, graded: bool = False
) -> Drive:
    """Return the time steps, at most `time_step` [s] long, and the chambers' mean torques in them.
    Steps end at all output `times` and pressure jumps.

    Parameters
    ----------
    pressure : Input, or one for each chamber
    times : array (rows,)
        Output times, s, strictly increasing; the first is the start of the simulation.
    graded : bool
        Whether the first two steps after the start and after each jump are divided, as `grade` does.

    Raises
    ------
    InputError
        When the times do not increase or the step is not positive.
    """
    inputs = inputs_of(model, pressure)
    dead_times = [c.valve.dead_time for c in model.chambers]
    return driven(model, laid_out(inputs, dead_times, times, time_step, graded=graded))


def laid_out(
    inputs: Sequence[Input], dead_times: Sequence[float], times: Array, time_step: float, *, graded: bool = False,
    timelines: dict[Any, Timeline] | None = None,
) -> Layout:
    """Return the time steps for one input per chamber, with the commanded pressures, but without torques.

    `timelines` keeps the time steps of inputs with equal jumps and breakpoints, for the same output times and steps.
    """
    times = check_times(times)
    if not (np.isfinite(time_step) and time_step > 0):
        raise InputError(f"time_step must be a positive time in seconds, got {time_step}")
    if (times[-1] - times[0]) / time_step > LONGEST:
        raise InputError(
            f"{times[-1] - times[0]:.6g} s in steps of {time_step:.3g} s are too many steps: use a longer time_step"
        )
    known = {} if timelines is None else timelines
    key = tuple((p.jumps.tobytes(), p.breakpoints.tobytes(), dead) for p, dead in zip(inputs, dead_times, strict=True))
    if key not in known:  # the first of two threads: timelines are compared by identity
        known.setdefault(key, Timeline(grid(inputs, dead_times, times, time_step, graded=graded), times))
    return Layout(inputs, dead_times, times, known[key])


def check_times(times: Array) -> Array:
    """Return the output times (T,) as an array; raise InputError unless there are two or more and they increase."""
    times = np.asarray(times, dtype=float)
    if times.ndim != 1 or times.size < 2 or not np.all(np.diff(times) > 0):
        raise InputError("simulation times must be at least two, strictly increasing, in seconds")
    return times


def driven(model: Model, layout: Layout) -> Drive:
    """Return the time steps of `layout` with the mean torques of the model's chambers in them."""
    columns = [layout.driven(c, chamber) for c, chamber in enumerate(model.chambers)]
    torque, levels, stretch = (np.column_stack(rows) for rows in zip(*columns, strict=True))
    grows = any(c.grows for c in model.chambers)
    gain = np.array(model.actuation.columns)
    initial = initial_pressures(model, layout)
    none = np.zeros((0, *mechanics_of(model).no_loads().shape))
    return Drive(layout.intervals.h, torque, gain, layout.keep, levels, initial, stretch if grows else None, none,
                 layout)  # fmt: skip


def initial_pressures(model: Model, layout: Layout) -> Array:
    """Return the pressures (C,) [Pa] behind the valves of the chambers just before the first time."""
    return np.array([layout.resting(c, chamber.valve) for c, chamber in enumerate(model.chambers)])


def grid(
    inputs: Sequence[Input], dead_times: Sequence[float], times: Array, time_step: float, *, graded: bool = False
) -> Grid:
    """Return time steps of at most `time_step` [s] that end at all output times and at the inputs' jumps.
    Each jump is delayed by the dead time [s] of its valve. `graded` divides the first two steps after each jump.
    """
    same = max(_SAME * time_step, 16.0 * float(np.spacing(np.abs(times).max())))
    pairs = list(zip(inputs, dead_times, strict=True))
    jumps = np.concatenate([p.jumps + dead for p, dead in pairs])
    bends = np.concatenate([p.breakpoints + dead for p, dead in pairs])
    corners = merge(times, jumps, same)
    nodes = subdivide(corners, time_step)
    if graded:
        nodes = grade(nodes, jumps, same)
    keep = np.full(nodes.size - 1, -1)
    keep[np.searchsorted(nodes, corners)[1:] - 1] = -2
    keep[np.searchsorted(nodes, times)[1:] - 1] = np.arange(1, times.size)
    return Grid(corners, nodes, merge(nodes, bends, same), keep)


def before(pressure: Input, dead_time: float, times: Array) -> float:
    """Return the pressure [Pa] of an input, delayed by `dead_time` [s], just before the first of `times`."""
    return float(pressure(np.nextafter(times[0] - dead_time, -np.inf)))


def merge(times: Array, moments: Array, same: float) -> Array:
    """Return the sorted union of `times` and `moments`. Left out are moments outside the range of `times`, and moments
    within `same` of one of `times` or of the moment before.
    """
    moments = np.unique(np.asarray(moments, dtype=float))
    moments = moments[(moments > times[0]) & (moments < times[-1])]
    moments = moments[np.diff(moments, prepend=-np.inf) > same]
    after = np.searchsorted(times, moments)
    apart = np.minimum(times[after] - moments, moments - times[after - 1]) > same
    return np.sort(np.concatenate([times, moments[apart]])) if apart.any() else times


def subdivide(corners: Array, time_step: float) -> Array:
    """Return times [s] that contain all `corners` and divide each gap into equal steps of at most `time_step` [s]."""
    gap = np.diff(corners)
    parts = np.maximum(1, np.ceil(gap / time_step * (1 - 1e-9))).astype(int)
    start = np.repeat(np.arange(gap.size), parts)
    within = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    nodes = corners[start] + within * (gap / parts)[start]
    return np.append(nodes, corners[-1])


def grade(nodes: Array, jumps: Array, same: float) -> Array:
    """Return the ends `nodes` [s] of time steps, with short steps at the start and after each of `jumps` [s]: the first
    step is divided into six, which end at 1/32, 1/16, 1/8, 1/4 and 1/2 of it and at its end, and the next one into two.

    In a sudden change the midpoint rule does not damp a mode that decays within a fraction of the step: its rate
    changes sign in every step (Hairer and Wanner II, Sec. IV.3). The short steps damp these modes and follow the rest.
    A jump ends a step to within `same` [s].
    """
    first = np.append(0, np.searchsorted(nodes, jumps + same, side="right") - 1)
    first = first[(first >= 0) & (first < nodes.size - 1)]
    second = first[first < nodes.size - 2] + 1
    h = np.diff(nodes)
    within = nodes[first, None] + h[first, None] * _FINER
    return np.unique(np.concatenate([nodes, within.ravel(), nodes[second] + 0.5 * h[second]]))


def through_valve(valve: Valve, pressure: Input, nodes: Array, before: float) -> Array:
    """Return the pressure (m, 4) [Pa] behind a valve in the m intervals between times `nodes` [s].
    The four columns are the values at start, middle and end, and the mean.

    `nodes` (m + 1,) [s] are the ends of the intervals.

    The valve starts in equilibrium at the pressure `before` [Pa].
    """
    return lagging(valve, np.diff(nodes), commanded(pressure, nodes, valve.dead_time), before)


def commanded(pressure: Input, nodes: Array, dead_time: float) -> Array:
    """Return the pressure command (m, 4) [Pa], delayed by `dead_time` [s], in the m intervals between times `nodes`
    [s]. The four columns are the values at start, middle and end, and the mean.
    """
    return between(pressure(inner_points(nodes, dead_time)))


def inner_points(nodes: Array, dead_time: float) -> Array:
    """Return the two Gauss points (2, m) [s] of the m intervals between times `nodes` [s], earlier by `dead_time` [s]:
    no jump at a node counts on the wrong side.
    """
    h = np.diff(nodes)
    middle = 0.5 * (nodes[:-1] + nodes[1:]) - dead_time
    return np.stack([middle - _GAUSS * h, middle + _GAUSS * h])


def between(inner: Array) -> Array:
    """Return the pressure command (m, 4) [Pa] in m intervals: the straight lines through its values `inner` (2, m) [Pa]
    at two points of each. The four columns are the values at start, middle and end, and the mean.
    """
    first, second = np.asarray(inner, dtype=float)
    mean = 0.5 * (first + second)
    half = 0.5 * (second - first) / (2 * _GAUSS)
    out = np.empty((mean.size, 4))
    out[:, 0], out[:, 1], out[:, 2], out[:, 3] = mean - half, mean, mean + half, mean
    if not np.isfinite(out).all():
        raise InputError(
            "the pressure input is not finite everywhere between the first and the last time: repair it, or simulate a "
            "part of this time"
        )
    return out


def lagging(valve: Valve, h: Array, commands: Array, before: float) -> Array:
    """Return the pressure (m, 4) [Pa] behind a valve for commands (m, 4) [Pa] in intervals of length h (m,) [s].
    The four columns are the values at start, middle and end, and the mean.
    """
    out = commands.copy()
    pass_valve(twin, valve, valve_constants(valve_row(valve, before)), h, out)
    return out


def too_fast(after: float, length: float, given_way: str = "") -> SimulationError:
    """Return the error of a motion whose step of `length` [s] fails, `after` s after the start, with the reason
    `given_way`. By default, a link turns too fast.
    """
    reason = given_way or (
        f"a link turns by more than a radian within the step of {length * 1e3:.3g} ms, faster than the step can "
        "follow; use a shorter step or a smaller pressure"
    )
    return SimulationError(f"{after:.6g} s after the start {reason}")


def behind_lags(
    time: Float[Array, " T"], sources: Sequence[Input], time_constants: Sequence[complex],
) -> list[Float[Array, "T C"]]:
    """Return C inputs behind first-order lags at T frames, an array (T, C) for each time constant [s].

    The lags begin in equilibrium with the inputs of the first time. A complex time constant -1/p is that of one pole p
    of a damped oscillation, and gives complex values.
    """
    nodes, rows = instants(time, sources)
    pieces = np.stack([commanded(source, nodes, 0.0) for source in sources], axis=2)
    return [lagged(nodes, pieces[:, 0], pieces[:, 2], constant)[rows] for constant in time_constants]


def instants(time: Array, sources: Sequence[Input]) -> tuple[Array, Array]:
    """Return the times (N,) [s] of all frames and of the inputs' kinks until the last frame, and the indices (T,) of
    the T frames among them.
    """
    kinks = np.unique(np.concatenate([source.breakpoints for source in sources]))
    nodes = merge(np.concatenate([kinks[kinks < time[0] - SAME_TIME], time]), kinks, SAME_TIME)
    return nodes, np.searchsorted(nodes, time)
