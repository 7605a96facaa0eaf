"""Prediction of the model's motion over a time horizon, with exact derivatives by the commands, for predictive control.

Commands are linear between nodes, so that a slew limit that holds between the nodes holds in every period. Valves and
dead times are exact for commands held over a period. The body moves by the time steps of the model.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pliant.compiler.choose import twin
from pliant.control import feedback_loops
from pliant.control.design import LqrDesign
from pliant.control.valve import SupplyValve, supply_of
from pliant.estimation.contract import State
from pliant.linear.linearisation import behind_valve
from pliant.linear.sampled import hold, periods_late
from pliant.mechanics import mechanics_of
from pliant.model import ActuationInput, Valve

Array = np.ndarray
COARSE = 6e-3  # s, longest time step of the model


class Ahead(NamedTuple):
    """Predicted motion at the ends of K periods, and its derivatives with respect to the commands of C chambers at J
    node times.

    Commands are in Pa. There are C chambers, J nodes and N coordinates; the derivatives by the commands of all chambers
    at one node are adjacent.
    """

    position: Array  # (K, N) absolute angles [rad], then strains
    rate: Array  # (K, N)
    slope: Array  # (K, 2 N, J C) of position and rate
    command: Array  # (K, C) at the beginnings of the periods
    valve: Array  # (V,) states of all valves at the end
    valve_slope: Array  # (V, J C)
    waiting: Array  # (W,) commands on their way at the end, those of a chamber together, the youngest first
    waiting_slope: Array  # (W, J C)


class Horizon:
    """Predictor of the motion, for predictive control, under commands that vary linearly between J node times.

    Parameters
    ----------
    design : LqrDesign
        Design whose model, valves, period and latency are used.
    stage : int
        Number of periods between two nodes.
    nodes : int
        Number of nodes.
    """

    def __init__(self, design: LqrDesign, stage: int, nodes: int) -> None:
        model, self.period = design.model, design.period
        self.model, self.stage, self.nodes, self.chambers = model, stage, nodes, model.actuation.count
        self.periods = stage * (nodes - 1) + 1
        node = np.arange(self.periods)[:, None] / stage - np.arange(nodes)
        self.straight = np.maximum(0.0, 1.0 - np.abs(node))  # (K, J) weights of the nodes in every period's command
        self._lines = [
            ValveLine(c, s, self.period, design.latency)
            for c, s in zip(model.chambers, design.supply or (None,) * self.chambers, strict=True)
        ]
        self._parts = max(1, math.ceil(self.period / COARSE - 1e-9))
        body, joints, _ = mechanics_of(model).parts()
        slopes = mechanics_of(model).slopes()
        self._chain = body, joints, slopes
        self._march = twin(feedback_loops.body_ahead, *mechanics_of(model).sizes)
        steps, N = self.periods * self._parts, model.size
        self._places, self._jacobians = np.zeros((2, steps, N)), np.zeros((steps, *slopes.J.shape))

    def later(self, nodes: Array, age: int) -> Array:
        """Return the commands (J, C) [Pa] of C chambers at the present J node times, interpolated from the commands
        `nodes` of a plan that was made `age` periods ago.
        """
        return np.asarray(self.straight[np.minimum(age + self.stage * np.arange(self.nodes), self.periods - 1)] @ nodes)

    def predict(self, state: State, valves: list[Array], waiting: list[Array], nodes: Array) -> Ahead:
        """Return the motion predicted from `state` under the commands `nodes` (J, C) [Pa] of C chambers at J node
        times.

        `valves` are the states of each chamber's valve, `waiting` the delayed commands to each chamber, youngest first.
        """
        J, C, K = self.nodes, self.chambers, self.periods
        command = self.straight @ nodes
        pressure, slope = np.empty((K, C)), np.zeros((K, C, J, C))
        ends, end_slopes, left, left_slopes = [], [], [], []
        for c, line in enumerate(self._lines):
            sent = np.concatenate([waiting[c][::-1], command[:, c]])
            by = np.concatenate([np.zeros((waiting[c].size, J)), self.straight])
            pressure[:, c], slope[:, c, :, c], end, end_slope = line.ahead(sent, by, valves[c])
            ends.append(end)
            end_slopes.append(alone(end_slope, c, C))
            left.append(sent[::-1][: waiting[c].size])
            left_slopes.append(alone(by[::-1][: waiting[c].size], c, C))
        position, rate, moved = self._body(state, pressure, slope.reshape(K, C, J * C))
        return Ahead(
            position, rate, moved, command, np.concatenate(ends), np.concatenate(end_slopes), np.concatenate(left),
            np.concatenate(left_slopes),
        )

    def _body(self, state: State, pressure: Array, slope: Array) -> tuple[Array, Array, Array]:
        """Return positions and rates (K, N) at the ends of the periods, and their derivatives (K, 2 N, J C)."""
        N, parts, scale, actuation = self.model.size, self._parts, state.torque_scale, self.model.actuation
        each = list(zip(self.model.chambers, pressure.T, strict=True))
        torque = scale * np.stack([p * c.lever_at(p) for c, p in each], axis=1) @ actuation.columns
        torque[:, :N] += self._chain[1].K * np.append(state.rest_shift, state.strain_shift)
        x, v = (np.concatenate(pair) for pair in ((state.angle, state.strain), (state.rate, state.strain_rate)))
        positions, rates = self._places
        self._march(
            x, v, self.period / parts, np.repeat(torque, parts, axis=0), self._chain, positions, rates, self._jacobians
        )
        by_input = scale * np.stack([c.law_slope(p) for c, p in each], axis=1)
        drive = by_input[:, :, None] * actuation.columns  # (K, C, N + R) N m/Pa
        by, out = np.zeros((2 * N, slope.shape[2])), np.empty((len(pressure), 2 * N, slope.shape[2]))
        for k in range(len(pressure)):
            felt = drive[k].T @ slope[k]
            for j in range(k * parts, (k + 1) * parts):
                by = self._jacobians[j, : 2 * N].T @ by + self._jacobians[j, 2 * N :].T @ felt
            out[k] = by
        return positions[parts - 1 :: parts].copy(), rates[parts - 1 :: parts].copy(), out


class ValveLine:
    """Discrete-time model of one chamber's valve and dead time, exact for commands that are constant in each period."""

    def __init__(self, chamber: ActuationInput, supply: SupplyValve | None, period: float, latency: float) -> None:
        whole, part, _ = periods_late(chamber.valve.dead_time + latency, period)
        self._old, self._share, self._whole = bool(part), part / period, whole
        models = [behind_valve(np.zeros((0, 0)), np.zeros(0), v)[:2] for v in sides(chamber.valve, supply)]
        self.order = models[0][1].size
        steps = [[hold(A, B, t) for A, B in models] for t in (part, period - part)] if self.order else []
        self._pieces = tuple(np.array([[pair[i] for pair in row] for row in steps]) for i in (0, 1))
        self._march = twin(feedback_loops.valve_ahead)

    def ahead(self, sent: Array, by_node: Array, state: Array) -> tuple[Array, Array, Array, Array]:
        """Return the chamber's mean pressures (K,) [Pa] in K periods, their derivatives (K, J) with respect to the
        commands at the J nodes, the r valve states (r,) at the end and their derivatives (r, J).

        `sent` holds the delayed commands, oldest first, and those of the K periods; `by_node` holds their derivatives.
        """
        count = len(sent) - self._whole - self._old
        if not self._old:  # commands arrive at the start of a period: the one before has no effect
            sent, by_node = np.append(0.0, sent), np.concatenate([0.0 * by_node[:1], by_node])
        sent, by_node = np.ascontiguousarray(sent[: count + 1]), np.ascontiguousarray(by_node[: count + 1])
        if not self.order:
            mix = [self._share, 1.0 - self._share]
            mean, slope = (mix[0] * row[:-1] + mix[1] * row[1:] for row in (sent, by_node))
            return mean, slope, np.zeros(0), np.zeros((0, by_node.shape[1]))
        r, J = self.order, by_node.shape[1]
        values, slopes, now = np.empty((count, r)), np.empty((count, r, J)), np.array(state[:r], dtype=float)
        before = float(now[0])
        self._march(sent, by_node, self._pieces, now, np.empty((r, J + 1)), values, slopes)
        begin = np.append(before, values[:-1, 0])
        slope = 0.5 * (slopes[:, 0] + np.concatenate([np.zeros((1, J)), slopes[:-1, 0]]))
        return np.maximum(0.5 * (begin + values[:, 0]), 0.0), slope, values[-1], slopes[-1]


def sides(valve: Valve, supply: SupplyValve | None) -> tuple[Valve, Valve]:
    """Return two linear models of a valve: the first holds while the chamber empties, the second while it fills."""
    known = supply or supply_of(valve)
    if known is None:
        return valve, valve
    falling, rising = (replace(known.mean, natural_frequency=f) for f in (known.fall_frequency, known.rise_frequency))
    return falling, rising


def alone(rows: Array, chamber: int, chambers: int) -> Array:
    """Extend the derivatives `rows` (R, J) of R values with respect to J commands of one chamber to (R, J C), for the
    commands of all C chambers. The added derivatives are 0.
    """
    out = np.zeros((*rows.shape, chambers))
    out[:, :, chamber] = rows
    return out.reshape(len(rows), rows.shape[1] * chambers)
