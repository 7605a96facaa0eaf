"""One step at a time, for real-time use: the same step as `simulate`, no allocation."""

from __future__ import annotations

import math

import numpy as np

from pliant.compiler.choose import twin
from pliant.errors import InputError, SimulationError
from pliant.model import Model
from pliant.simulation import march_loops, memory_loops, state
from pliant.simulation.balance import EnergyWatch
from pliant.simulation.drive import UNLIMITED
from pliant.simulation.solve import check_step

Array = np.ndarray


class Stepper:
    """A model that moves one step of fixed length at each call. Paper: Eq. (5) [eq:eom], solver D14.

    Parameters
    ----------
    model : Model
        Its valve is applied to the pressures passed in: lag and limits of the rate exact for a pressure held over the
        step.
    step : float
        Length of a step, s.
    pressure : float
        Pressure at the start, Pa, under which the chain begins at rest.

    Attributes
    ----------
    angle, rate : array (n,)
        Absolute link angles [rad] and rates [rad/s], updated in place by `step`.
    memory : array (n, branches)
        States of the model's memory, rad, updated in place; the last column is Bouc-Wen's.
    stretch : float
        Hoop stretch of a chamber that inflates; 1 for a rigid wall.
    time : float
        s since the start.
    energy_gain : float
        Largest share of energy that came from nothing while the pressure did not change, looked at every 256 steps; an
        `EnergyWarning` tells it beyond 1 %. Models that remember or whose chamber swells or inflates are not watched.

    Raises
    ------
    InputError
        When the step is not a positive time short enough for the model, or the valve is of second order or has a
        dead time.
    """

    def __init__(self, model: Model, step: float = 1e-3, pressure: float = 0.0) -> None:
        valve = model.valve
        if valve.dead_time or valve.natural_frequency or valve.settle_share:
            raise InputError("a Stepper takes an ideal or first-order valve: pass it the pressure behind another one")
        check_step(model, step, "midpoint")
        self.model = model
        self.length = step
        self._base = float(model.base_angle)
        self._valve = (float(valve.rise_time), float(valve.fall_time))
        self._rates = (valve.rise_rate or UNLIMITED, valve.fall_rate or UNLIMITED)
        self._inflates = bool(model.inflation_limit or valve.rise_rate or valve.fall_rate)
        self._parts = (model.torque, model.body(), model.joints(), state.workspace(model.n))
        self._remembers = bool(model.memory or model.swell_share)
        kernel = memory_loops.held_step_with_memory if self._remembers else march_loops.held_step
        self._advance = twin(memory_loops.held_step_of_chamber if self._inflates else kernel, model.n)
        self._law = (model.swell_share, model.swell_time, model.torque, model.body(), model.joints())
        self._scratch = (model.memory.law(), state.held(model), state.workspace(model.n))
        self.reset(pressure)
        self.step(pressure)  # compiled here
        self.reset(pressure)

    def reset(self, pressure: float = 0.0) -> None:
        """Back to rest under `pressure` [Pa], time 0."""
        q = state.equilibrium(self.model, pressure)
        self.angle = state.absolute(self.model, q)
        self.rate = np.zeros(self.model.n)
        self.memory = state.relaxed(self.model, q)
        self.pressure = float(pressure)
        self._slow = self.pressure
        self._chamber = np.array([self.pressure, self.pressure, float(self.model.inflation_at(pressure))])
        self.time = 0.0
        self._watch = EnergyWatch(self.model)

    @property
    def energy_gain(self) -> float:
        """Largest share of energy that came from nothing under a pressure that did not change."""
        return self._watch.gain

    @property
    def stretch(self) -> float:
        """Hoop stretch of the chamber."""
        return float(self._chamber[2] ** 0.25)

    def step(self, pressure: float) -> tuple[Array, Array]:
        """Advance one step under `pressure` [Pa], held constant; returns (angle, rate), the live arrays.

        Raises
        ------
        SimulationError
            When the pressure is not finite, or moves a link faster than the step can follow; `reset` before going on.
        """
        if self._inflates:
            share, time, *parts = self._law
            self._advance(
                self.angle, self.rate, self.memory, self._base, self.length, float(pressure), self._chamber,
                (*self._valve, *self._rates), share, time, self.model.inflation_limit, self.model.inflation_time,
                *parts, *self._scratch,
            )
            self.pressure = float(self._chamber[0])
        elif self._remembers:
            self.pressure, self._slow = self._advance(
                self.angle, self.rate, self.memory, self._base, self.length, float(pressure), self.pressure, self._slow,
                *self._valve, *self._law, *self._scratch,
            )
        else:
            self.pressure = self._advance(
                self.angle, self.rate, self._base, self.length, float(pressure), self.pressure, *self._valve,
                *self._parts,
            )
        self.time += self.length
        if not math.isfinite(self.pressure):
            if lost := state.given_way(self.model, self.angle):
                raise SimulationError(f"at {self.time:.6g} s, under {pressure} Pa, {lost}")
            raise SimulationError(
                f"at {self.time:.6g} s, under {pressure} Pa, a link turns by more than a radian within the step of "
                f"{self.length * 1e3:.3g} ms, or the pressure is not finite; use a shorter step or a smaller pressure"
            )
        self._watch.look(self.angle, self.rate, self.pressure, self.length)
        return self.angle, self.rate
