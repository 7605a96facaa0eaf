"""A simulated plant (actuator, valves and sensors) from a model with any number of chambers."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np

from pliant.control.valve import FINE, SupplyValve, check_followed
from pliant.errors import InputError
from pliant.linear.linearisation import behind_valve
from pliant.linear.sampled import hold
from pliant.mechanics import mechanics_of
from pliant.model import Model, Valve
from pliant.simulation import Stepper

Array = np.ndarray
POINTS = 41  # points of a shape
READING = {"Pa": 300.0, "N": 0.05, "m": 2e-5, "rad": 1e-3}  # noise of a reading, by the unit of the input


class ModelPlant:
    """A simulated actuator with valves, dead times and noisy sensors, moved by one command for each of its inputs.

    Its sensors add white noise to the shape and the pressures. With the file of a different model than the
    controller's, it shows how the controller handles model errors. With the same model, it shows the best possible
    result of the design.

    Parameters
    ----------
    model : Model
    period : float
        Frame period [s]; it must be a multiple of `time_step`.
    time_step : float
        Time step of the model [s]. Dead times are rounded to multiples of it.
    noise : float
        Standard deviation of each coordinate of the shape [m].
    pressure_noise : float, optional
        Standard deviation of a reading of the inputs, in their unit; default: 300 Pa, 0.05 N, 20 um or 1 mrad.
    seed : int
        Seed of the noise.
    supply : tuple of SupplyValve or None, optional
        The rig's valve of each chamber; None to use the model's.
    arc_length : array (S,), optional
        Arc lengths [m] of the points of a shape; default: 41 at equal distances.

    Raises
    ------
    InputError
        When the period is not a whole number of steps, or a valve has a slow settling part, dead band or opening time.
    """

    rides = True  # the points are material points, fixed to the links

    def __init__(
        self, model: Model, *, period: float = 4e-3, time_step: float = 1e-3, noise: float = 1e-4,
        pressure_noise: float | None = None, seed: int = 1, supply: tuple[SupplyValve | None, ...] = (),
        arc_length: Array | None = None,
    ) -> None:
        check_followed(model)
        self._parts = round(period / time_step)
        if self._parts < 1 or abs(self._parts * time_step - period) > 1e-9:
            raise InputError(
                f"the period of {period:g} s is not a whole number of time steps of {time_step:g} s: choose a multiple "
                "of time_step"
            )
        self.period, self.time, self._time_step = period, 0.0, time_step
        bare = [
            replace(c, valve=Valve() if c.valve.natural_frequency else replace(c.valve, dead_time=0.0))
            for c in model.chambers
        ]
        self._stepper = Stepper(model.with_(chambers=tuple(bare)), time_step)
        self._supply = supply or (None,) * len(bare)
        self._valves = [
            hold(*behind_valve(np.zeros((0, 0)), np.zeros(0), c.valve)[:2], time_step)
            if c.valve.natural_frequency else None
            for c in model.chambers
        ]
        self._held = [np.zeros(2) for _ in model.chambers]
        self._waiting = [deque([0.0] * round(c.valve.dead_time / time_step)) for c in model.chambers]
        read = np.array([READING[unit] for unit in model.actuation.units])
        self._rng = np.random.default_rng(seed)
        self._noise = noise, read if pressure_noise is None else np.full(read.size, float(pressure_noise))
        ends = model.base_length + np.append(0.0, np.cumsum(model.link_length))
        self._ends, self._first = np.unique(np.append(0.0, ends), return_index=True)
        self.arc_length = np.linspace(0.0, ends[-1], POINTS) if arc_length is None else np.asarray(arc_length)

    @property
    def tip(self) -> Array:
        """True position of the simulated tip, (2,) in the plane or (3,) in space [m]."""
        return self._stepper.tips()[-1].copy()

    def advance(self, command: float | Array) -> tuple[float, Array, Array]:
        """Hold the commands (C,) of the C inputs for one period. Return the time [s] at its end, and noisy readings
        of S points (S, 2 or 3) [m] of the shape and of the pressures or tendon inputs (C,) in SI units.

        Raises
        ------
        InputError
            When there are not as many commands as chambers, or a command is not finite or negative.
        """
        asked = self._stepper.model.actuation.pressures(command)
        if not (np.isfinite(asked).all() and (asked >= 0.0).all()):
            units = ", ".join(dict.fromkeys(self._stepper.model.actuation.units))
            raise InputError(f"commands must be finite and >= 0 ({units}), got {command}")
        for _ in range(self._parts):
            self._stepper.step(np.array([self._behind(c, p) for c, p in enumerate(asked)]))
        self.time += self.period
        shape, read = self._noise
        pressure = self._pressure() + read * self._rng.standard_normal(asked.size)
        points = self.points()
        return self.time, points + shape * self._rng.standard_normal(points.shape), pressure

    @property
    def position(self) -> Array:
        """Coordinates of the simulated actuator. In the plane they are the absolute angles [rad] of n links followed by
        S strains, as one array (n + S,). In space they are N joint coordinates (N,).
        """
        return self._stepper.position.copy()

    def displace(self, change: Array) -> None:
        """Add `change` to the simulated angles [rad] and strains instantly, as if a hand had displaced and released the
        actuator.
        """
        saved = self._stepper.snapshot()
        self._stepper.restore(saved._replace(angle=saved.angle + change))

    def _behind(self, c: int, asked: float) -> float:
        """Return the mean pressure [Pa] in chamber `c` over a time step under the command `asked` [Pa]."""
        waiting, valve, valve_state = self._waiting[c], self._valves[c], self._held[c]
        waiting.append(asked)
        arrived, supply = waiting.popleft(), self._supply[c]
        if valve is None:
            return arrived
        before = valve_state[0]
        if supply is None:
            valve_state[:] = valve[0] @ valve_state + valve[1] * arrived
            valve_state[0] = max(valve_state[0], 0.0)
        else:
            parts = max(1, round(self._time_step / FINE))
            supply.march(np.full(parts, arrived), self._time_step / parts, valve_state)
        return float(0.5 * (before + valve_state[0]))

    def _pressure(self) -> Array:
        """Return the true pressures (C,) [Pa] behind the valves."""
        inside = self._stepper.pressure
        return np.array([inside[c] if v is None else self._held[c][0] for c, v in enumerate(self._valves)])

    def points(self) -> Array:
        """Return the true positions (S, 2 or 3) [m] of S points of the simulated shape, at the plant's arc lengths
        `arc_length` [m].
        """
        known = mechanics_of(self._stepper.model).nodes(self._stepper.position)[self._first]
        return np.stack([np.interp(self.arc_length, self._ends, column) for column in known.T], axis=1)
