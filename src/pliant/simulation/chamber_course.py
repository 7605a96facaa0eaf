"""Pressures and torques of chambers over the time steps of a simulation, as floats or dual numbers.

A chamber with its valve enters the compiled loops as one row of numbers. For derivatives by any of these numbers, the
row is given as dual numbers (`pliant.compiler.duals`), and the same loops are run.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from pliant.compiler.choose import dual_twin
from pliant.equations import symbols
from pliant.equations.symbols import Lag
from pliant.model import ActuationInput, Valve
from pliant.simulation import pressure_loops
from pliant.simulation.pressure_loops import UNLIMITED

Array = np.ndarray
Twin = Callable[[Any], Any]  # returns the compiled form of a kernel, for floats or for dual numbers
OF_A_VALVE = 11  # number of entries of a row for the valve, which come first
BEFORE_LAW = OF_A_VALVE + 8  # number of entries before those of the torque law, whose number varies


class ValveConstants(NamedTuple):
    """Constants of a valve for the compiled loops: lag, dead band, initial pressure and others, as floats or dual
    numbers.
    """

    lag: Lag
    settle_share: Any
    settle_time: Any  # s
    omega: Any  # rad/s, of a second-order valve
    damping_ratio: Any
    before: Any  # Pa, initial pressure behind the valve
    dead_band: Any  # Pa
    opening_time: Any  # s


class Intervals(NamedTuple):
    """Lengths of a simulation's time steps, and of the finer intervals between the kinks of its pressure inputs.
    They may be dual numbers.
    """

    h: Any  # (steps,) s
    lengths: Any  # (m,) s, lengths of the intervals
    first: Array  # (steps + 1,) index of the first interval of each step; the last entry is m


def lag_of(valve: Valve) -> Lag:
    """Return the lag constants of a valve in the form that the compiled loops take."""
    return Lag(
        float(valve.rise_time), float(valve.fall_time), valve.rise_rate or UNLIMITED, valve.fall_rate or UNLIMITED
    )


def delivered(valve: Valve, command: float) -> float:
    """Return the steady pressure [Pa] behind a valve under a constant command [Pa], dead band included."""
    return float(np.sign(command) * max(abs(command) - valve.dead_band, 0.0)) if valve.dead_band else command


def valve_row(valve: Valve, before: float) -> Array:
    """Return the constants of a valve and its initial pressure `before` [Pa] as one array of numbers."""
    omega = 2 * np.pi * valve.natural_frequency
    rest = valve.settle_share, valve.settle_time, omega, valve.damping_ratio, before, valve.dead_band
    return np.array([*lag_of(valve), *rest, valve.opening_time])


def row_of(chamber: ActuationInput, before: float) -> Array:
    """Return the constants of a chamber and its state at the initial pressure `before` [Pa] as one array of numbers.

    The entries are valve, rubber, slow states and law.
    """
    law, *rubber = chamber.kernel()
    return np.concatenate([valve_row(chamber.valve, before), rubber, chamber.rest_state(before), law])


def valve_constants(row: Array) -> ValveConstants:
    """Return the constants of a valve by name, from an array `row` that begins with them. The constants are floats or
    dual numbers.
    """
    single = row[:OF_A_VALVE].tolist() if row.ndim == 1 else row[:OF_A_VALVE]
    return ValveConstants(Lag(*single[:4]), *single[4:])


def pass_valve(run: Twin, valve: Valve, constants: ValveConstants, lengths: Any, p: Any) -> None:
    """Replace commanded pressures p (m, 4) [Pa] by those behind a valve, in place.
    The columns of p are the values at start, middle and end of m intervals, and the mean.

    The intervals have the `lengths` (m,) [s].
    ``run(kernel)`` returns the compiled form of a kernel. `constants` are the constants of the `valve`.
    """
    if valve.dead_band:
        run(pressure_loops.past_dead_band)(constants.dead_band, p)
    if valve.natural_frequency:
        run(pressure_loops.second_order_valve)(lengths, constants.omega, constants.damping_ratio, constants.before, p)
    elif valve.rise_rate or valve.fall_rate:
        run(pressure_loops.rate_limited_valve)(lengths, constants.lag, constants.before, p)
    elif valve.rise_time or valve.fall_time:
        run(pressure_loops.first_order_valve)(lengths, constants.lag.rise, constants.lag.fall, constants.before, p)
    if valve.opening_time:
        run(pressure_loops.through_opening)(lengths, constants.opening_time, constants.before, p)
    if valve.settle_share:
        run(pressure_loops.settle)(lengths, constants.settle_share, constants.settle_time, constants.before, p)


def take_torques(
    run: Twin, chamber: ActuationInput, row: Array, at: Intervals, p: Any, torque: Any, grown: Any,
) -> None:
    """Write the mean torque of a chamber in each time step to torque (steps,) [N m].
    The pressures p (m, 4) [Pa] behind the valve are those at start, middle and end of m intervals, and the mean.

    `row` is the row of the chamber (`row_of`). If the chamber has slow states, grown (m + 1,) receives the fourth power
    of its hoop stretch between the intervals.
    """
    law = row[BEFORE_LAW:]
    if chamber.plain:
        run(pressure_loops.law_torques)(*at, p, law, torque)
        return
    state = row[BEFORE_LAW - 2 : BEFORE_LAW].copy() if row.ndim == 1 else row[BEFORE_LAW - 2 : BEFORE_LAW]
    single = row[OF_A_VALVE:BEFORE_LAW].tolist() if row.ndim == 1 else row[OF_A_VALVE:BEFORE_LAW]
    run(pressure_loops.slow_torques)(*at, p, symbols.ChamberConstants(law, *single[:6]), state, torque, grown)


def torque_slopes(chamber: ActuationInput, row: Array, at: Intervals, commands: Array) -> Array:
    """Return the derivatives (steps, WIDTH) of a chamber's mean torque in each time step with respect to WIDTH
    variables. The chamber's constants `row` and the step lengths `at.h` are dual numbers: values with their derivatives
    by these variables.

    If every step has one interval, the step lengths also replace the lengths of the intervals. `commands` (m, 4) [Pa]
    are the command at the start, middle and end of each interval, and its mean.
    """
    from pliant.compiler.duals import WIDTH, duals  # loads the compiler

    def run(kernel: Any) -> Any:
        return dual_twin(kernel, None)

    at = at._replace(lengths=at.h if len(at.h) == at.lengths.size else duals(at.lengths))
    p, torque, grown = duals(commands), duals(np.zeros(len(at.h))), duals(np.zeros(len(at.lengths) + 1))
    pass_valve(run, chamber.valve, valve_constants(row), at.lengths, p)
    take_torques(run, chamber, row, at, p, torque, grown)
    return torque[:, WIDTH:]
