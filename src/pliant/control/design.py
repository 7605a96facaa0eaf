"""Control of outputs by one pressure or several: the rest that is wanted in each period, and the regulator about it.

A path is known ahead: what is wanted later adds the optimal regulator's preview to the steady inputs.

Source: Anderson and Moore, Optimal Control: Linear Quadratic Methods, 1990, ch. 4
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pliant.control.equilibria import equilibria
from pliant.control.gains import Gains, loop_margins, regulator
from pliant.control.limits import Limits
from pliant.control.steady_inputs import output_values, output_weights, rest_under, steady_inputs, written
from pliant.control.tuning import Tuning
from pliant.control.valve import SupplyValve, check_followed
from pliant.errors import InputError
from pliant.linear.sampled import KILO, Margins, least_margins, periods_late
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.simulation import state

Array = np.ndarray
APART = 0.04  # s, between the rests about which a path is linearised
SHOWN = 5  # rests whose margins are shown


@dataclass(frozen=True)
class LqrDesign:
    """A reference for every period, the inputs that hold it, and the regulator about them.

    Attributes
    ----------
    model : Model
    outputs : tuple of str
    still : array (m,)
        Outputs without pressure.
    period, latency : float
        s
    gains : tuple of Gains
    at : array (K,)
        Which gains hold in each period.
    wanted : array (K, m)
        Changes of the outputs from `still`.
    pressure, angle : array (K, C), (K, n)
        Of the rest that is wanted, Pa and rad; of a body that lengthens (K, n + S), strains behind.
    beside : array (K, N)
        Of the state that is wanted, from that rest: how fast it turns, and on a planned trajectory all that the model
        does; rad, rad/s, kPa. In the last period, which is held, it rests.
    lead, ahead : array (K, C), (K + 1, N)
        Command beside the steady inputs, kPa, and slope of the cost of the state, both by what is wanted later.
    path : bool
        Whether what is wanted later is known ahead.
    tuning : Tuning
    late : int
        Periods by which the state is older than the row of its command.
    supply : tuple of SupplyValve or None
        The rig's valve of each chamber, where more is known of it than the model holds; empty: of none.
    along : (array (K,), array (K, m)), optional
        Displacement that is wanted of the tip, m, and direction of its path, of one chamber.
    """

    model: Model
    outputs: tuple[str, ...]
    still: Array
    period: float
    latency: float
    gains: tuple[Gains, ...]
    at: Array
    wanted: Array
    pressure: Array
    angle: Array
    beside: Array
    lead: Array
    ahead: Array
    path: bool
    tuning: Tuning
    late: int
    supply: tuple[SupplyValve | None, ...] = ()
    along: tuple[Array, Array] | None = None

    @cached_property
    def waiting(self) -> tuple[int, ...]:
        """Commands on their way to each chamber."""
        late = (c.valve.dead_time + self.latency for c in self.model.chambers)
        return tuple(periods_late(t, self.period)[2] for t in late)

    @cached_property
    def orders(self) -> tuple[int, ...]:
        """Number of states of each chamber's valve."""
        valves = (c.valve for c in self.model.chambers)
        return tuple(2 if v.natural_frequency else int(v.rise_time + v.fall_time > 0) for v in valves)

    @cached_property
    def resting(self) -> Array:
        """Return the state (N, C) of valves and delayed commands under a constant pressure in kPa in each chamber."""
        made, first = np.zeros((self.gains[0].A.shape[0], len(self.orders))), 2 * self.model.size
        for sizes, held in ((self.orders, 1), (self.waiting, None)):  # of a valve the pressure, not its rate
            for c, size in enumerate(sizes):
                made[first : first + size, c][:held] = 1.0
                first += size
        return made

    def periods(self, first: int, count: int) -> Array:
        """Periods (count,) from `first` on as far as they are known; the last one holds on."""
        return np.minimum(np.arange(first, first + count), len(self.at) - 1)

    def shift(self, k: int) -> Array:
        """Change (N,) of the deviation from what is wanted that time alone makes from period k to k + 1."""
        then, n = min(k + 1, len(self.at) - 1), self.model.size
        out = self.gains[self.at[k]].A @ self.beside[k] - self.beside[then]
        out[:n] += self.angle[k] - self.angle[then]
        return np.asarray(out + self.resting @ (self.pressure[k] - self.pressure[then]) / KILO)

    @cached_property
    def margins(self) -> dict[int, tuple[Margins, ...]]:
        """Return the margins of each chamber's loop, the others closed, at some of the rests, by their index in
        `gains`.
        """
        some = np.unique(np.linspace(0, len(self.gains) - 1, SHOWN).round().astype(int))
        return {int(k): loop_margins(self.gains[k], self.period) for k in some}

    @property
    def least_margins(self) -> Margins:
        """The smallest of each margin."""
        return least_margins(m for each in self.margins.values() for m in each)

    def __str__(self) -> str:
        rows = []
        for k, each in self.margins.items():
            level = written(self.model, self.gains[k].rest.pressure)
            rows += [f"{level}, {chamber.name}: {m}" for chamber, m in zip(self.model.chambers, each, strict=True)]
        return "\n".join(rows)


def design_outputs(
    model: Model, outputs: tuple[str, ...], wanted: Array, limits: Limits, period: float, *,
    tuning: Tuning | None = None, latency: float = 0.0, path: bool = False,
) -> LqrDesign:
    """Return the regulator of outputs along what is wanted of them.

    Parameters
    ----------
    model : Model
        Of one chamber or several, without memory or frozen, with its valves; it may lengthen.
    outputs : tuple of str
        Of tip_x, tip_y [m] and angle_sum [rad], the angle of the last link.
    wanted : array (K, m)
        Changes of these from the rest without pressure, period by period.
    limits : Limits
    period : float
        Of the control, s.
    tuning : Tuning, optional
    latency : float
        s by which the measured state is old; it counts as dead time.
    path : bool
        Whether what is wanted is known ahead and followed as it moves; else it is a row of levels to come to rest at.

    Raises
    ------
    InputError
        When something wanted is out of reach, a valve settles late or has a dead band, or the numbers make no sense.
    """
    wanted = np.asarray(wanted, dtype=float)
    if wanted.ndim != 2 or wanted.shape[1] != len(outputs) or not len(wanted) or not np.isfinite(wanted).all():
        raise InputError(f"outputs are wanted as finite rows (K, {len(outputs)}), got shape {wanted.shape}")
    check_followed(model)
    tuning, highest = tuning or Tuning(), limits.each(model.actuation.count)
    weight = output_weights(model, outputs)
    still = output_values(model, mechanics_of(model).coordinates(state.equilibrium(model, 0.0)), outputs)
    knots = posts(wanted, max(1, round(APART / period)))
    known: dict[bytes, int] = {}
    gains: list[Gains] = []
    for row in wanted[knots]:
        if row.tobytes() not in known:
            start = gains[-1].rest.pressure if gains else np.zeros(highest.size)
            rest = steady_inputs(model, outputs, still + row, highest, start)
            known[row.tobytes()] = len(gains)
            gains.append(regulator(rest, weight, highest, (period, latency), tuning))
    index, rows = np.array([known[row.tobytes()] for row in wanted[knots]]), np.arange(len(wanted))
    pressure = between(rows, knots, [gains[i].rest.pressure for i in index])
    angle = between(rows, knots, [gains[i].rest.linear.position for i in index])
    beside = np.zeros((len(rows), gains[0].A.shape[0]))
    if path and len(rows) > 1:
        beside[:-1, model.size : 2 * model.size] = np.gradient(angle, period, axis=0)[:-1]  # the last row holds on
    lead, ahead = np.zeros_like(pressure), np.zeros((len(rows) + 1, gains[0].A.shape[0]))
    made = LqrDesign(
        model, outputs, still, period, latency, tuple(gains), index[np.searchsorted(knots, rows)], wanted, pressure,
        angle, beside, lead, ahead, path, tuning, round(latency / period),
    )
    if path:
        look_ahead(made)
    return made


def design_lqr(
    model: Model, highest: float, period: float, *, tuning: Tuning | None = None, latency: float = 0.0, grid: int = 9,
) -> LqrDesign:
    """Return the regulator of the tip about its rests under pressures from 0 to `highest` [Pa] of one chamber.

    Parameters
    ----------
    model : Model
        Of one chamber, with its valve.
    highest : float
        Pa
    period : float
        Of the control, s.
    tuning : Tuning, optional
    latency : float
        s by which the measured state is old; it counts as dead time.
    grid : int
        Pressures at which the model is linearised.

    Returns
    -------
    LqrDesign
        ``print(design)`` shows its margins.

    Raises
    ------
    InputError
        When the numbers make no sense, no small pressure moves the tip at rest, or the valve settles late or has a
        dead band.

    Examples
    --------
    >>> from pliant.control import design_lqr
    >>> design = design_lqr(model, highest=190e3, period=4e-3)  # doctest: +SKIP
    >>> print(design)  # doctest: +SKIP
    """
    check_followed(model)
    family, tuning, outputs = equilibria(model, highest), tuning or Tuning(), ("tip_x", "tip_y")
    limit, pressure = np.array([float(highest)]), np.linspace(0.0, highest, grid)[:, None]
    rests = [rest_under(model, p, outputs) for p in pressure]
    gains = tuple(regulator(rest, np.ones(2), limit, (period, latency), tuning) for rest in rests)
    angle, N = np.array([rest.linear.position for rest in rests]), gains[0].A.shape[0]
    return LqrDesign(
        model, outputs, family.tip[0], period, latency, gains, np.arange(grid),
        np.array([rest.value for rest in rests]) - family.tip[0], pressure, angle, np.zeros((grid, N)),
        np.zeros((grid, 1)), np.zeros((grid + 1, N)), False, tuning, round(latency / period),
    )


def posts(wanted: Array, apart: int) -> Array:
    """Periods at whose rests the model is linearised: where the time series turns, and every so many while it moves."""
    last = len(wanted) - 1
    moves = np.append(np.any(np.diff(wanted, axis=0) != 0.0, axis=1), False)
    turns = np.flatnonzero(np.diff(moves.astype(int))) + 1
    return np.unique(np.concatenate([[0, last], turns, np.arange(0, last + 1, apart)[moves[::apart]]]).astype(int))


def between(rows: Array, knots: Array, values: list[Array]) -> Array:
    """Values (K, ...) of every period, straight between those at the knots."""
    return np.stack([np.interp(rows, knots, column) for column in np.array(values).T], axis=1)


def look_ahead(design: LqrDesign) -> None:
    """Fill `ahead` and `lead` from the last period on: s_k = (A - B K)' (P d_k + s_(k+1)), with d_k = `shift`."""
    for k in range(len(design.at) - 1, -1, -1):
        made = design.gains[design.at[k]]
        later = made.P @ design.shift(k) + design.ahead[k + 1]
        design.lead[k] = -made.preview @ later
        design.ahead[k] = (made.A - made.B @ made.K).T @ later
