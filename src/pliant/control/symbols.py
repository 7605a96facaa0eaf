"""What the compiled loops of control call their parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import numpy as np

COMMAND, INTEGRAL, ERROR, SATURATED = range(4)  # of `Memory.held`: Pa, m s, m, and the count of commands at a limit
HOLD, WISH, TIP, DIRECTION, SEEN = 0, 1, 2, 4, 6  # where `Memory.out` takes Pa, Pa, and (x, y) of three vectors


class Schedule(NamedTuple):
    """Gains and the model at rest on a grid of pressures."""

    gain: np.ndarray  # (G, N) Pa per SI unit of the state
    pressure: np.ndarray  # (G,) Pa
    angle: np.ndarray  # (G, n) rad, absolute
    tip: np.ndarray  # (G, 2) m
    direction: np.ndarray  # (G, 2) of the tip's path
    tip_by_angle: np.ndarray  # (G, n) m/rad, along that path
    tip_by_pressure: np.ndarray  # (G,) m/Pa


class Geometry(NamedTuple):
    """Where the tip is."""

    link_length: np.ndarray  # (n,) m
    x0: float  # m, first joint
    y0: float  # m
    sign: float  # of the bend


class Rules(NamedTuple):
    """What a command may be."""

    highest: float  # Pa
    slew: float  # Pa/s
    period: float  # s
    integral_band: float  # m


class Law(NamedTuple):
    """The linear-quadratic regulator of a body."""

    schedule: Schedule
    geometry: Geometry
    rules: Rules


class Aim(NamedTuple):
    """What is wanted now."""

    target: float  # Pa, of the rest that is wanted
    scale: float  # the body turns as the model under so many times the pressure
    lead_tip: float  # m, of the tip along its path from that rest


class Seen(NamedTuple):
    """What is known of the body and its valve."""

    angle: np.ndarray  # (n,) rad, absolute
    rate: np.ndarray  # (n,) rad/s
    rest_shift: np.ndarray  # (n,) rad
    valve: np.ndarray  # (v,) Pa, Pa/s


class Memory(NamedTuple):
    """What the regulator carries from step to step, changed in place."""

    waiting: np.ndarray  # (D,) Pa, commands on their way, the youngest first
    held: np.ndarray  # (4,), see COMMAND
    out: np.ndarray  # (8,) workspace, see HOLD


class Regulator(NamedTuple):
    """The regulator at one frame, but for what is seen."""

    law: Law
    aim: Aim
    valve: np.ndarray  # (v,)
    lead: np.ndarray  # (N + 1,), a row of `Trajectory.lead`
    memory: Memory


class SupplyNumbers(NamedTuple):
    """A valve of two frequencies, as it is followed with a gauge."""

    h: float  # s, step of its equation
    rise: float  # rad/s
    fall: float  # rad/s
    damping: float
    gain: np.ndarray  # (2,) of the correction by the gauge
