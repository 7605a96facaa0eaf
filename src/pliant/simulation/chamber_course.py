"""Chamber pressures under a command, interval by interval: as floats, and as dual numbers with derivatives.

A chamber and its valve enter the compiled loops as one row of numbers, so that whoever wants derivatives by any of them
lays them beside that row (`pliant.compiler.duals`) and runs the same loops.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from pliant.equations import symbols
from pliant.equations.symbols import Lag
from pliant.model import Chamber, Valve
from pliant.simulation import opening_loops, pressure_loops
from pliant.simulation.pressure_loops import UNLIMITED

Array = np.ndarray
Twin = Callable[[Any], Any]  # of a kernel, on floats or on duals
OF_A_VALVE = 11  # entries of a row that are the valve's, the first
BEFORE_LAW = OF_A_VALVE + 8  # and before the torque law, whose length is its own


class ValveConstants(NamedTuple):
    """Constants of a valve in the loops: floats, or duals."""

    lag: Lag
    settle_share: Any
    settle_time: Any  # s
    omega: Any  # rad/s, of a second-order valve
    damping_ratio: Any
    before: Any  # Pa, behind it at first
    dead_band: Any  # Pa
    opening_time: Any  # s


class Intervals(NamedTuple):
    """The steps of a drive and the intervals that they are made of: floats, or duals."""

    h: Any  # (steps,) s
    lengths: Any  # (m,) s, of the intervals
    first: Array  # (steps + 1,) first interval of each step, and their number


def lag_of(valve: Valve) -> Lag:
    """The first-order part of a valve, for the loops."""
    return Lag(
        float(valve.rise_time), float(valve.fall_time), valve.rise_rate or UNLIMITED, valve.fall_rate or UNLIMITED
    )


def delivered(valve: Valve, command: float) -> float:
    """Pressure [Pa] at which the valve settles under a constant command [Pa]: what its dead band leaves of it."""
    return float(np.sign(command) * max(abs(command) - valve.dead_band, 0.0)) if valve.dead_band else command


def valve_row(valve: Valve, before: float) -> Array:
    """All that a pressure behind a valve depends on, beside the command, in one row; it was `before` [Pa] at first."""
    omega = 2 * np.pi * valve.natural_frequency
    rest = valve.settle_share, valve.settle_time, omega, valve.damping_ratio, before, valve.dead_band
    return np.array([*lag_of(valve), *rest, valve.opening_time])


def row_of(chamber: Chamber, before: float) -> Array:
    """All that a chamber's torque depends on, beside the command, in one row: valve, rubber, slow states, law."""
    law, *rubber = chamber.kernel()
    return np.concatenate([valve_row(chamber.valve, before), rubber, chamber.rest_state(before), law])


def valve_constants(row: Array) -> ValveConstants:
    """The entries of a `valve_row`, or of one of duals (.., SLOTS)."""
    single = row[:OF_A_VALVE].tolist() if row.ndim == 1 else row[:OF_A_VALVE]
    return ValveConstants(Lag(*single[:4]), *single[4:])


def pass_valve(run: Twin, valve: Valve, made: ValveConstants, lengths: Any, p: Any) -> None:
    """Turn what is commanded in intervals of some lengths into the pressure behind a valve, p (m, 4) [Pa], in place."""
    if valve.dead_band:
        run(pressure_loops.past_dead_band)(made.dead_band, p)
    if valve.natural_frequency:
        run(pressure_loops.second_order_valve)(lengths, made.omega, made.damping_ratio, made.before, p)
    elif valve.rise_rate or valve.fall_rate:
        run(pressure_loops.rate_limited_valve)(lengths, made.lag, made.before, p)
    elif valve.rise_time or valve.fall_time:
        run(pressure_loops.first_order_valve)(lengths, made.lag.rise, made.lag.fall, made.before, p)
    if valve.opening_time:
        run(opening_loops.through_opening)(lengths, made.opening_time, made.before, p)
    if valve.settle_share:
        run(pressure_loops.settle)(lengths, made.settle_share, made.settle_time, made.before, p)


def take_torques(run: Twin, chamber: Chamber, row: Array, at: Intervals, p: Any, torque: Any, grown: Any) -> None:
    """Write the mean torque of each step, torque (steps,) [N m], from the pressures p (m, 4) behind the valve.

    `row` is that of the chamber. Where its rubber takes time, grown (m + 1,) takes the fourth power of the stretch
    between the intervals.
    """
    law = row[BEFORE_LAW:]
    if chamber.plain:
        run(pressure_loops.law_torques)(*at, p, law, torque)
        return
    state = row[BEFORE_LAW - 2 : BEFORE_LAW].copy() if row.ndim == 1 else row[BEFORE_LAW - 2 : BEFORE_LAW]
    single = row[OF_A_VALVE:BEFORE_LAW].tolist() if row.ndim == 1 else row[OF_A_VALVE:BEFORE_LAW]
    run(pressure_loops.slow_torques)(*at, p, symbols.ChamberConstants(law, *single[:6]), state, torque, grown)


def torque_slopes(chamber: Chamber, row: Array, at: Intervals, commands: Array) -> Array:
    """Derivatives (steps, WIDTH) of the mean torques of the steps, from those beside a `row` of duals.

    The steps' lengths `at.h` are duals too; where each is made of one interval, they stand for the intervals'.
    `commands` (m, 4) [Pa] are those at the start, middle and end of each interval, and their mean.
    """
    from pliant.compiler.duals import WIDTH, dual_twin, duals  # loads the compiler

    def run(kernel: Any) -> Any:
        return dual_twin(kernel, None)

    at = at._replace(lengths=at.h if len(at.h) == at.lengths.size else duals(at.lengths))
    p, torque, grown = duals(commands), duals(np.zeros(len(at.h))), duals(np.zeros(len(at.lengths) + 1))
    pass_valve(run, chamber.valve, valve_constants(row), at.lengths, p)
    take_torques(run, chamber, row, at, p, torque, grown)
    return torque[:, WIDTH:]
