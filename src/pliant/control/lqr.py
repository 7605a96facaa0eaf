"""Linear-quadratic control of the tip: valve and dead time in the state, integral action, gains scheduled by pressure.

What is weighed is the tip's error and the command; not the sum of the angles, whose lightly damped zeros near 9 Hz
would set a bound to the damping, and not the first joint, whose zeros lie in the right half-plane.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pliant.compiler.choose import tuples, twin
from pliant.control import feedback_loops
from pliant.control.equilibria import Equilibria, equilibria
from pliant.control.limits import Limits
from pliant.control.symbols import (
    COMMAND,
    ERROR,
    INTEGRAL,
    SATURATED,
    Aim,
    Geometry,
    Law,
    Memory,
    Regulator,
    Rules,
    Schedule,
)
from pliant.errors import InputError
from pliant.estimation.contract import State
from pliant.linear.linearisation import LinearModel, linearise
from pliant.linear.sampled import KILO, Margins, Sampled, least_margins, loop_curve, margins, sample
from pliant.model import Model

Array = np.ndarray


@dataclass(frozen=True)
class Tuning:
    """Weights of the quadratic cost, in units that mean the same for every body.

    Parameters
    ----------
    effort : float
        Cost of the command whose static effect is one metre, relative to a tip error of one metre. Smaller is faster.
    damping_time : float
        s; the tip's speed times this counts like an error.
    integral_time : float
        s; the integral of the tip's error over this counts like an error. Larger is slower.
    integral_band : float
        m; larger errors count less in the integral, by the square of their ratio, so that a step does not wind it up.
    """

    effort: float = 0.3
    damping_time: float = 0.09
    integral_time: float = 0.3
    integral_band: float = 5e-4

    def __post_init__(self) -> None:
        if not (self.effort > 0 and self.damping_time >= 0 and self.integral_time > 0):
            raise InputError(f"tuning needs effort > 0, damping_time >= 0 and integral_time > 0, got {self}")


@dataclass(frozen=True)
class LqrDesign:
    """Gains over a grid of pressures with the margins of each loop.

    Attributes
    ----------
    pressure : array (G,)
        Pa
    gain : array (G, N)
        Of the state (angles, rates, valve, commands on their way, integral of the tip's error), Pa per SI unit.
    plant : tuple of Sampled
        At each pressure, the sampled model that the gain was designed for.
    slowest : array (G,)
        Largest magnitude of a closed-loop pole at each pressure, below 1.
    """

    model: Model
    equilibria: Equilibria
    pressure: Array
    gain: Array
    plant: tuple[Sampled, ...]
    slowest: Array
    period: float
    latency: float
    waiting: int
    tuning: Tuning

    @cached_property
    def margins(self) -> tuple[Margins, ...]:
        """At each pressure, of the loop cut at the command, with the full state known."""
        rows = zip(self.plant, self.gain, strict=True)
        return tuple(margins(loop_curve(plant, gain, self.period)) for plant, gain in rows)

    @property
    def least_margins(self) -> Margins:
        """The smallest of each margin."""
        return least_margins(self.margins)

    def __str__(self) -> str:
        rows = (f"{p * 1e-3:6.1f} kPa: {m}" for p, m in zip(self.pressure, self.margins, strict=True))
        return "\n".join(rows)


def design_lqr(
    model: Model, highest: float, period: float, *, tuning: Tuning | None = None, latency: float = 0.0, grid: int = 9,
) -> LqrDesign:
    """Gains of a state feedback on the tip for pressures from 0 to `highest` [Pa].

    Parameters
    ----------
    model : Model
        With its valve.
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
        ``print(design)`` tells its margins.

    Raises
    ------
    InputError
        When the numbers make no sense, or no small pressure moves the tip at rest.

    Examples
    --------
    >>> from pliant.control import design_lqr
    >>> design = design_lqr(model, highest=190e3, period=4e-3)  # doctest: +SKIP
    >>> print(design)  # doctest: +SKIP
    """
    tuning = tuning or Tuning()
    family = equilibria(model, highest)
    rest = linearise(model)
    if rest.static_gain("tip_x") == rest.static_gain("tip_y") == 0.0:
        raise InputError(
            f"at rest no small pressure moves the tip of model {model.name!r}, as where its torque law begins with the "
            "square: feedback has nothing to hold it with there; fit it with a linear term, torque_1"
        )
    pressures = np.linspace(0.0, highest, grid)
    gains, plants, slowest = [], [], []
    for p in pressures:
        linear = linearise(model, float(p))
        plant = with_integral(linear, sample(linear, period, latency), family.at(p)[2], period)
        K = riccati_gain(plant, tip_row(linear, family.at(p)[2], plant.A.shape[0]), linear, family.at(p)[2], tuning)
        gains.append(K)
        plants.append(plant)
        slowest.append(np.abs(np.linalg.eigvals(plant.A - plant.B * K)).max())
    waiting = sum(sample(rest, period, latency).waiting)
    return LqrDesign(
        model, family, pressures, np.array(gains), tuple(plants), np.array(slowest), period, latency, waiting, tuning
    )


def tip_row(linear: LinearModel, direction: Array, size: int) -> Array:
    """Row (size,) that gives the tip's displacement along a direction from the state."""
    row = np.zeros(size)
    row[: linear.A.shape[0]] = direction[0] * linear.row("tip_x") + direction[1] * linear.row("tip_y")
    return row


def with_integral(linear: LinearModel, plant: Sampled, direction: Array, period: float) -> Sampled:
    """The sampled model with the integral of the tip's error [m s] as its last state."""
    N = plant.A.shape[0]
    A, B = np.zeros((N + 1, N + 1)), np.zeros((N + 1, 1))
    A[:N, :N], B[:N] = plant.A, plant.B
    A[N, :N], A[N, N] = period * tip_row(linear, direction, N), 1.0
    return Sampled(A, B, plant.waiting)


def riccati_gain(plant: Sampled, tip: Array, linear: LinearModel, direction: Array, tuning: Tuning) -> Array:
    """State feedback gain (N,) that minimises the sum of squared tip error, speed, integral and command."""
    from scipy.linalg import solve_discrete_are

    n, N = linear.n, plant.A.shape[0]
    speed = np.zeros(N)
    speed[n : 2 * n] = tip[:n]
    Q = np.outer(tip, tip) + tuning.damping_time**2 * np.outer(speed, speed)
    Q[-1, -1] += tuning.integral_time**-2
    Q += 1e-9 * np.mean(tip[:n] ** 2) * np.diag(np.arange(N) < 2 * n)
    gain = direction[0] * linear.static_gain("tip_x") + direction[1] * linear.static_gain("tip_y")
    scale = np.ones(N)
    scale[2 * n : N - 1] = KILO
    A = plant.A * scale[None, :] / scale[:, None]
    B = plant.B * KILO / scale[:, None]
    Q = Q * scale[:, None] * scale[None, :]
    R = np.array([[tuning.effort * (gain * KILO) ** 2]])
    metre = 1e6  # errors in mm: the Riccati equation's numbers stay near one
    P = solve_discrete_are(A, B, Q * metre, R * metre)
    K = np.linalg.solve(R * metre + B.T @ P @ B, B.T @ P @ A)[0]
    return np.asarray(K * KILO / scale)


def tip_slopes(design: LqrDesign) -> tuple[Array, Array]:
    """How far the tip moves along its path: by each absolute angle (G, n) [m/rad], and at rest by the pressure (G,)."""
    rows, slopes = [], []
    for p in design.pressure:
        linear, way = linearise(design.model, float(p)), design.equilibria.at(float(p))[2]
        rows.append(tip_row(linear, way, linear.A.shape[0])[: linear.n])
        slopes.append(way[0] * linear.static_gain("tip_x") + way[1] * linear.static_gain("tip_y"))
    return np.array(rows), np.array(slopes)


class Lqr:
    """The feedback at work: bumpless, within its limits, without windup.

    Parameters
    ----------
    design : LqrDesign
    limits : Limits
    """

    def __init__(self, design: LqrDesign, limits: Limits) -> None:
        if limits.highest > design.pressure[-1] * (1 + 1e-9):
            raise InputError(
                f"the limits allow {limits.highest * 1e-3:g} kPa, the gains reach to {design.pressure[-1] * 1e-3:g} kPa"
            )
        self.design, self.limits = design, limits
        model, family = design.model, design.equilibria
        angle, tip, way = (np.array(rows) for rows in zip(*map(family.at, design.pressure), strict=True))
        schedule = Schedule(design.gain, design.pressure, angle, tip, way, *tip_slopes(design))
        self._no_lead = np.zeros(design.gain.shape[1])
        x0, y0 = (float(v) for v in model.first_joint)
        geometry = Geometry(np.array(model.link_length), x0, y0, float(model.bend_sign))
        rules = Rules(
            float(limits.highest), float(limits.slew), float(design.period), float(design.tuning.integral_band)
        )
        self.regulator = Law(schedule, geometry, rules)
        self._fields = tuples(self.regulator)
        self._steer = twin(feedback_loops.steer)
        self.reset()

    def reset(self, command: float = 0.0) -> None:
        """Start from a `command` [Pa] that has held for long."""
        held = np.zeros(4)
        held[COMMAND] = command
        self.memory = Memory(np.full(self.design.waiting, float(command)), held, np.zeros(8))
        self._memory = tuples(self.memory)

    @property
    def command(self) -> float:
        """The last command, Pa."""
        return float(self.memory.held[COMMAND])

    @property
    def integral(self) -> float:
        """Of the tip's error, m s."""
        return float(self.memory.held[INTEGRAL])

    @property
    def error(self) -> float:
        """Of the tip along its path at the last step, m."""
        return float(self.memory.held[ERROR])

    @property
    def saturated(self) -> int:
        """Steps whose command met a limit."""
        return int(self.memory.held[SATURATED])

    def inputs(self, target: float, valve: Array, lead: Array) -> Regulator:
        """The regulator as `frame_loops` takes it, towards a `target` [Pa], with states of the valve."""
        return Regulator(self.regulator, Aim(float(target), 1.0, 0.0), valve, lead, self.memory)

    def step(
        self, target: float, state: State, valve: Array, *, lead: Array | None = None, lead_tip: float = 0.0
    ) -> float:
        """Command [Pa] for the coming period.

        Parameters
        ----------
        target : float
            Pressure of the model's rest that is wanted, Pa: `Equilibria.pressure_for` finds it for a tip displacement.
        state : State
            As an estimator tells it; shifts of the joints' rest angles and the factor on the torque are made up for at
            once.
        valve : array (v,)
            Pressure behind the valve, and its rate for a valve of second order; Pa, Pa/s. Empty for an ideal valve.
        lead : array (N,), optional
            A row of `Trajectory.lead`: the motion and the command that are wanted, against the rest at `target`.
        lead_tip : float
            m, how far along its path the tip is wanted from its rest at `target`.
        """
        lead = self._no_lead if lead is None else lead
        seen = (state.angle, state.rate, state.rest_shift, valve)
        return float(self._steer(self._fields, (target, state.torque_scale, lead_tip), seen, lead, self._memory))
