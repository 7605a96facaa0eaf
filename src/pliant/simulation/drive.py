"""From a pressure input to what the steps need: their lengths and the mean torque of each.

The torque enters a step as its mean over the step, integrated between the breakpoints of the input, and every jump of
the pressure is the end of a step. So the answer does not depend on how the edges of the input and the steps align.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pliant.compiler.choose import twin
from pliant.equations import section
from pliant.errors import InputError, SimulationError
from pliant.model import Model, Valve
from pliant.simulation import march_loops, memory_loops
from pliant.simulation.inputs import Input

Array = np.ndarray
_GAUSS = 0.5 / np.sqrt(3.0)
LONGEST = 1e8  # steps in one simulation: beyond, memory runs out before the result comes
UNLIMITED = 1e30  # Pa/s; not infinite, whose product with no lag is not a number
_SAME = 1e-9  # of a step: times closer than this are one time, written with different rounding


class Drive(NamedTuple):
    """What the compiled march takes, with the pressure at the output times for the record."""

    h: Array  # (steps,) s
    torque: Array  # (steps,) N m, mean over each step
    keep: Array  # (steps,) row of the output after the step, -1: none
    pressure: Array  # (rows,) Pa, behind the valve, at the output times
    initial: float  # Pa, before anything happens at the first time: a jump there is part of the motion
    stretch: Array | None = None  # (rows,) hoop stretch of a chamber that inflates, at the output times


def drive(model: Model, pressure: Input, times: Array, step: float) -> Drive:
    """Steps of at most `step` [s] that meet every time of `times` and every jump, with their mean torques.

    Parameters
    ----------
    times : array (rows,)
        Output times, s, strictly increasing; the first is the start of the simulation.

    Raises
    ------
    InputError
        When the times do not increase or the step is not positive.
    """
    times = np.asarray(times, dtype=float)
    if times.ndim != 1 or times.size < 2 or not np.all(np.diff(times) > 0):
        raise InputError("simulation times must be at least two, strictly increasing, in seconds")
    if not (np.isfinite(step) and step > 0):
        raise InputError(f"the step must be a positive time in seconds, got {step}")
    if (times[-1] - times[0]) / step > LONGEST:
        raise InputError(f"{times[-1] - times[0]:.6g} s in steps of {step:.3g} s are too many steps: use a longer step")
    dead = model.valve.dead_time
    initial = float(pressure(np.nextafter(times[0] - dead, -np.inf)))
    same = max(_SAME * step, 16.0 * float(np.spacing(np.abs(times).max())))
    nodes = subdivide(merge(times, pressure.jumps + dead, same), step)
    fine = merge(nodes, pressure.breakpoints + dead, same)
    behind = through_valve(model, pressure, fine, initial)
    inflation = inflations(model, np.diff(fine), behind, initial)
    impulse = np.diff(fine) * mean_torques(model, np.diff(fine), behind, initial, inflation)
    h = np.diff(nodes)
    keep = np.full(h.size, -1)
    ends = at = np.searchsorted(nodes, times)
    keep[ends[1:] - 1] = np.arange(1, times.size)
    if fine.size > nodes.size:  # the input bends within steps
        impulse = np.add.reduceat(impulse, np.searchsorted(fine, nodes[:-1]))
        at = np.searchsorted(fine, times)
    shown = np.append(behind[at[:-1], 0], behind[-1, 2])
    stretch = None if inflation is None else np.append(inflation[at[:-1], 0], inflation[-1, 2]) ** 0.25
    return Drive(h, impulse / h, keep, shown, initial, stretch)


def inflations(model: Model, h: Array, behind: Array, initial: float) -> Array | None:
    """Fourth power of the hoop stretch (m, 3) at the start, middle and end of each interval; None for a rigid wall."""
    if not model.inflation_limit:
        return None
    y = np.empty((h.size, 3))
    twin(memory_loops.inflation)(
        h, behind, float(model.inflation_at(initial)), model.inflation_limit, model.inflation_time, y
    )
    return y


def mean_torques(model: Model, h: Array, behind: Array, initial: float, inflation: Array | None = None) -> Array:
    """Mean torque [N m] of each interval; `behind` (m, 4) is the pressure, which was `initial` [Pa] long before."""
    if not model.swell_share and inflation is None:
        return section.mean_torque(behind[:, 0], behind[:, 1], behind[:, 2], behind[:, 3], model.torque)
    slow = np.empty((h.size, 3))
    twin(memory_loops.slow_pressure)(h, behind, initial, model.swell_time, slow)
    start, middle, end, mean = behind.T
    before, half, after = slow.T
    if inflation is not None:
        return section.mean_inflated_torque(
            start, middle, end, mean, before, half, after, inflation[:, 0], inflation[:, 1], inflation[:, 2],
            model.swell_share, model.torque,
        )
    return section.mean_swollen_torque(
        start, middle, end, mean, before, half, after, model.swell_share, model.torque
    )


def merge(times: Array, moments: Array, same: float) -> Array:
    """`times` with those of `moments` that lie between the first and the last, none nearer than `same` to another."""
    moments = np.unique(np.asarray(moments, dtype=float))
    moments = moments[(moments > times[0]) & (moments < times[-1])]
    moments = moments[np.diff(moments, prepend=-np.inf) > same]
    after = np.searchsorted(times, moments)
    apart = np.minimum(times[after] - moments, moments - times[after - 1]) > same
    return np.sort(np.concatenate([times, moments[apart]])) if apart.any() else times


def subdivide(corners: Array, step: float) -> Array:
    """Every corner, with equal parts of at most `step` between neighbours."""
    gap = np.diff(corners)
    parts = np.maximum(1, np.ceil(gap / step * (1 - 1e-9))).astype(int)
    start = np.repeat(np.arange(gap.size), parts)
    within = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    nodes = corners[start] + within * (gap / parts)[start]
    return np.append(nodes, corners[-1])


def through_valve(model: Model, pressure: Input, nodes: Array, before: float) -> Array:
    """Pressure behind the valve at the start, middle and end of each interval of `nodes`, and its mean; (m, 4), Pa.

    The valve starts at rest at the pressure `before` [Pa]. The command is taken as straight within an interval, from
    two inner points, so that a jump at a node is seen from its proper side.
    """
    valve = model.valve
    h = np.diff(nodes)
    middle = 0.5 * (nodes[:-1] + nodes[1:]) - valve.dead_time
    u = np.asarray(pressure(np.stack([middle - _GAUSS * h, middle + _GAUSS * h])), dtype=float)
    mean = 0.5 * (u[0] + u[1])
    half = 0.5 * (u[1] - u[0]) / (2 * _GAUSS)
    out = np.stack([mean - half, mean, mean + half, mean], axis=1)
    if not np.isfinite(out).all():
        raise InputError("the pressure input is not finite everywhere between the first and the last time")
    if valve.natural_frequency:
        twin(march_loops.second_order_valve)(
            h, out[:, 0].copy(), out[:, 2].copy(), 2 * np.pi * valve.natural_frequency, valve.damping_ratio, before, out
        )
    elif valve.rise_rate or valve.fall_rate:
        twin(march_loops.rate_limited_valve)(
            h, out[:, 0].copy(), out[:, 2].copy(), valve.rise_time, valve.fall_time, valve.rise_rate or UNLIMITED,
            valve.fall_rate or UNLIMITED, before, out,
        )
    elif valve.rise_time or valve.fall_time:
        twin(march_loops.first_order_valve)(
            h, out[:, 0].copy(), out[:, 2].copy(), valve.rise_time, valve.fall_time, before, out
        )
    return settled(valve, h, out, before) if valve.settle_share else out


def settled(valve: Valve, h: Array, behind: Array, before: float) -> Array:
    """As `behind` (m, 4), Pa, with the share of the pressure that comes late; at rest at `before` [Pa] long before."""
    late = np.empty((h.size, 3))
    twin(memory_loops.slow_pressure)(h, behind, before, valve.settle_time, late)
    mean = behind[:, 3] - valve.settle_time * (late[:, 2] - late[:, 0]) / h  # of the late one, from its own equation
    return np.asarray(behind + valve.settle_share * (np.column_stack([late, mean]) - behind))


def too_fast(plan: Drive, failed: int, given_way: str = "") -> SimulationError:
    """What to say of a step that turns a link by more than a radian, or in which a spring has `given_way`."""
    if given_way:
        return SimulationError(f"{plan.h[: failed + 1].sum():.6g} s after the start {given_way}")
    return SimulationError(
        f"{plan.h[: failed + 1].sum():.6g} s after the start a link turns by more than a radian within the step of "
        f"{plan.h[failed] * 1e3:.3g} ms, faster than the step can follow; use a shorter step or a smaller pressure"
    )
