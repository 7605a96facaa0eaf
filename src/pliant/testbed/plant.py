"""A simulated plant for controllers: the rod with pressure regulator and sensors, advanced one command at a time."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pliant.errors import InputError, SimulationError
from pliant.testbed.family import Member, member
from pliant.testbed.rod import RodParameters, build_body
from pliant.testbed.scenarios import Circle, Wall, obstacle_rows
from pliant.testbed.stepping import Span, _clock, _out, _work, settle
from pliant.testbed.valve import Iso6358, SupplyRegulator

Array = np.ndarray
SUPPLY_STEP = 2.5e-5  # s, of the regulator's equations


class PlantFrame(NamedTuple):
    """Sensor readings that arrive together: the body's shape from the fibre, and the chamber's pressure from the
    transducer.
    """

    time: float  # s, when the shape was taken
    shape: Array  # (S, 2) m, points of the body in the base frame; NaN where the frame is lost
    pressure: float  # Pa gauge, read when the frame arrives


class Plant:
    """The virtual actuator for closed-loop control: rod, regulator with dead time, fibre sensor and pressure
    transducer.

    The fibre's gain error, wandering bias and noise act on the curvature. The points of a frame are those of the body's
    centreline in the base frame: the offset of the fibre's lumen and the misalignment of its frame are taken as
    corrected.

    Parameters
    ----------
    body : str, int, Member or RodParameters
        Actuator "a", "b" or "c", a seed of the family with its own valve and sensors, or parameters of your own.
    rate : float
        Frame rate of the shape sensor, Hz.
    time_step : float
        Time step of the rod, s; the frame period must be a multiple of it.
    seed : int
        Seed of the sensors' errors.
    perfect : bool
        Use sensors without error, latency and drop-out; the regulator is kept.
    valve : SupplyRegulator, optional
        Default: the valve of the family member.
    obstacles : sequence of Circle or Wall

    Raises
    ------
    InputError
        For an unknown actuator, a frame period that is no multiple of the step, an actuator with several chambers, or a
        member of the family whose valve is a spool where no `valve` is given: the plant supports regulators only.

    Examples
    --------
    >>> from pliant.testbed.plant import Plant
    >>> plant = Plant("a")
    >>> frame = plant.advance(40e3)  # doctest: +SKIP
    """

    def __init__(
        self, body: str | int | RodParameters | Member = "a", *, rate: float = 250.0, time_step: float = 5e-4,
        seed: int = 1, perfect: bool = False, valve: SupplyRegulator | None = None,
        obstacles: Sequence[Circle | Wall] = (),
    ) -> None:
        if isinstance(body, RodParameters):
            body = Member("custom", body)
        who = body if isinstance(body, Member) else member(body)
        self.parameters = who.body
        self.period = 1.0 / rate
        self._substeps = round(self.period / time_step)
        if self._substeps < 1 or abs(self._substeps * time_step - self.period) > 1e-9:
            raise InputError(
                f"the frame period of {self.period:g} s is not a whole number of steps of {time_step:g} s: change rate "
                "or time_step"
            )
        self._time_step = time_step
        chosen = valve or who.valve
        if isinstance(chosen, tuple) or len(self.parameters.chambers) > 1:
            raise InputError(f"actuator {who.name} has {len(self.parameters.chambers)} chambers: Plant supports one; "
                             "choose an actuator with one chamber")
        if isinstance(chosen, Iso6358):
            raise InputError(f"actuator {who.name} has a spool valve: give a regulator as `valve`")
        self._valve = chosen
        self._body = build_body(self.parameters)
        self._rows = obstacle_rows(obstacles)
        fibre, transducer = who.fibre, who.transducer
        if perfect:
            fibre = replace(fibre, noise=0.0, bias=0.0, gain_error=0.0, jitter=0.0, drop_out=0.0, latency=0.0)
            transducer = replace(transducer, noise=0.0, bias=0.0, resolution=0.0)
        self._fibre, self._transducer = fibre, transducer
        self._clock = _clock(self._body, time_step, static=False)
        self._work = _work(self._body)
        self._out = _out(2, self._body.rest_length.size + 1, self._body)
        self._rest = settle(self.parameters, obstacles=self._rows)
        self._specimen = np.random.default_rng([seed, 1]).standard_normal(2)
        self._seed = seed
        self.reset()

    def reset(self) -> None:
        """Return to rest: zero pressure, time 0 and relaxed hysteresis states. The sensors' random errors start again
        from their seed.
        """
        self._state = type(self._rest)(*(array.copy() for array in self._rest))
        self.time = 0.0
        self._held = np.zeros(2)
        self._commands = deque([0.0] * round(self._valve.dead_time / self._time_step))
        self._load = np.zeros(2)
        self._rng = np.random.default_rng([self._seed, 7])
        waves = np.random.default_rng([self._seed, 8]).standard_normal(24) / self._fibre.bias_length
        s = np.cumsum(self._body.weight)
        self._bias_shape = np.vstack([np.cos(np.outer(waves, s)), np.sin(np.outer(waves, s))])
        self._bias = self._rng.standard_normal(48)
        self._late: deque[tuple[float, Array]] = deque()

    @property
    def pressure(self) -> float:
        """True gauge pressure behind the regulator, Pa."""
        return float(self._held[0])

    @property
    def tip(self) -> Array:
        """True position (2,) of the body's tip, m."""
        return self._state.x[self.parameters.elements].copy()

    def push(self, x: float, y: float = 0.0) -> None:
        """Apply a constant force (x, y) [N], in the base frame, to the cap from now on."""
        self._load = np.array([x, y], dtype=float)

    def advance(self, command: float | Array) -> PlantFrame:
        """Hold a commanded gauge pressure [Pa] for one frame period and return the newest frame that has arrived.

        The command is a number or an array of shape (1,).

        Raises
        ------
        InputError
            When the command is not one number, not finite or negative.
        SimulationError
            When the simulation does not converge.
        """
        from pliant.compiler.choose import twin
        from pliant.testbed.stepping_loops import march, regulate_on

        if np.size(command) != 1:
            raise InputError(
                f"the virtual actuator has one chamber, got {np.size(command)} commands: simulate a model with several "
                "chambers by --plant model:FILE"
            )
        level = float(np.ravel(command)[0])
        if not (np.isfinite(level) and level >= 0.0):
            raise InputError(f"the commanded gauge pressure must be finite and >= 0 Pa, got {command}")
        m = self._substeps
        self._commands.extend([level] * m)
        loads = np.zeros((m, 4))
        loads[:, 1:3] = self._load
        asked = np.array([self._commands.popleft() for _ in range(m)])
        behind = np.empty(m)
        twin(regulate_on)(
            asked, self._time_step, max(1, round(self._time_step / SUPPLY_STEP)), self._valve.law, self._held, behind
        )
        loads[:, 0] = behind
        status, _, update, _ = twin(march)(
            loads, Span(0, m, m), self._body, self._rows, self._state, self._clock, self._work, self._out
        )
        if status != 0:
            raise SimulationError(
                f"the rod does not converge at {self.time:.4f} s (last update {update:.1e} m): use a shorter step"
            )
        self.time += self.period
        return self._frame()

    def _frame(self) -> PlantFrame:
        self._late.append((self.time, self._sense()))
        while len(self._late) > 1 and self._late[1][0] + self._fibre.latency <= self.time + 1e-9:
            self._late.popleft()
        taken, shape = self._late[0]
        return PlantFrame(taken + self._fibre.jitter * float(self._rng.standard_normal()), shape, self._read())

    def _sense(self) -> Array:
        """Return the points (S, 2) [m] of the body that the fibre measures: the base and the end of every element."""
        fibre, rng = self._fibre, self._rng
        keep = np.exp(-self.period / fibre.bias_time)
        self._bias = keep * self._bias + np.sqrt(1.0 - keep**2) * rng.standard_normal(self._bias.size)
        weight = self._body.weight
        spread = np.sqrt(fibre.spacing / weight)  # white noise of the samples that one element averages
        kappa = self._state.curvature * (1.0 + fibre.gain_error * self._specimen[0])
        kappa = kappa + fibre.bias / np.sqrt(24) * self._bias @ self._bias_shape
        kappa = kappa + fibre.noise * spread * rng.standard_normal(kappa.size)
        count = self.parameters.elements
        angle = np.cumsum(weight * kappa)[:count]
        points = np.zeros((count + 1, 2))
        points[1:, 0] = -np.cumsum(self._state.length[:count] * np.sin(angle))
        points[1:, 1] = np.cumsum(self._state.length[:count] * np.cos(angle))
        return points if rng.random() >= fibre.drop_out else np.full_like(points, np.nan)

    def _read(self) -> float:
        sensor = self._transducer
        value = self.pressure + sensor.bias * self._specimen[1] + sensor.noise * float(self._rng.standard_normal())
        return float(np.round(value / sensor.resolution) * sensor.resolution if sensor.resolution else value)

    @property
    def arc_length(self) -> Array:
        """Arc lengths (S,) of the frame's points, m."""
        return np.linspace(0.0, self.parameters.length, self.parameters.elements + 1)
