"""Pneumatic valves with their parameters, and the pressure sensor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pliant.errors import InputError
from pliant.testbed.stepping_loops import Gas, Spool, ValveLaw, fill_chamber, regulate

Array = np.ndarray


@dataclass(frozen=True)
class SupplyRegulator:
    """A digital proportional pressure regulator with dead time, second-order lag and slew limits (SI units, gauge
    pressure).
    """

    frequency: float = 9.0  # Hz
    damping: float = 0.75
    dead_time: float = 0.008  # s
    exhaust_slowdown: float = 1.4
    slew_up: float = 4.0e6  # Pa/s
    slew_down: float = 3.0e6  # Pa/s
    dead_band: float = 400.0  # Pa

    @property
    def law(self) -> ValveLaw:
        """Constants of the regulator for the compiled kernels."""
        return ValveLaw(
            2.0 * np.pi * self.frequency, self.damping, self.exhaust_slowdown, self.slew_up, self.slew_down,
            self.dead_band,
        )


@dataclass(frozen=True)
class Iso6358:
    """A proportional spool valve that fills and empties a chamber through ISO 6358 restrictions."""

    source: float = 5.0e5  # Pa gauge
    ambient: float = 101325.0  # Pa
    fill: float = 2.0e-9  # m3/(s Pa), sonic conductance
    exhaust: float = 2.5e-9  # m3/(s Pa)
    critical_ratio: float = 0.3
    band: float = 2.5e4  # Pa, error at which the spool is fully open
    frequency: float = 60.0  # Hz, of the spool
    damping: float = 0.7
    dead_time: float = 0.005  # s
    volume: float = 3.2e-5  # m3, chamber and tube
    polytropic: float = 1.2
    temperature: float = 293.15  # K

    @property
    def spool(self) -> Spool:
        """Constants of the spool for the compiled kernels."""
        return Spool(2.0 * np.pi * self.frequency, self.damping, self.band)

    @property
    def gas(self) -> Gas:
        """Constants of the chamber's gas for the compiled kernels."""
        return Gas(
            self.source + self.ambient, self.ambient, self.fill, self.exhaust, self.critical_ratio, self.volume,
            self.polytropic, self.temperature,
        )


@dataclass(frozen=True)
class PressureSensor:
    """A pressure transducer with its own clock, noise, bias and resolution."""

    rate: float = 750.0  # Hz
    noise: float = 300.0  # Pa, standard deviation
    bias: float = 150.0  # Pa, standard deviation over specimens
    resolution: float = 3.0e5 / 4096  # Pa, 12 bits of 300 kPa


def supply_pressure(command: Callable[[Array], Array], time: Array, valve: SupplyRegulator | Iso6358) -> Array:
    """Return the gauge pressure that the valve delivers for a command, on an evenly spaced time grid.

    Parameters
    ----------
    command : callable
        Commanded gauge pressure, Pa, at an array of times.
    time : (S,) array, s, evenly spaced
    valve : SupplyRegulator or Iso6358

    Returns
    -------
    (S,) array, Pa gauge

    Raises
    ------
    InputError
        For a negative command or one above the source.
    """
    from pliant.compiler.choose import twin

    asked = np.ascontiguousarray(command(time - valve.dead_time), dtype=float)
    if asked.size < 2:
        raise InputError(f"a valve needs the command at two or more times, got {asked.size}: give more times")
    if not np.all(np.isfinite(asked)) or asked.min() < 0.0:
        raise InputError("the commanded gauge pressure must be finite and >= 0 Pa at all times: correct the command")
    dt = float(time[1] - time[0])
    out = np.zeros(asked.size)
    if isinstance(valve, SupplyRegulator):
        twin(regulate)(asked, dt, valve.law, out)
        return out
    if asked.max() > valve.source:
        raise InputError(f"the command of {asked.max():.0f} Pa exceeds the supply pressure of {valve.source:.0f} Pa: "
                         "lower the command, or raise source of the valve")
    twin(fill_chamber)(asked, dt, 8, valve.spool, valve.gas, out)
    return out


def read_pressure(
    time: Array, pressure: Array, sensor: PressureSensor, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Return the P times (P,) [s] at which the transducer samples the pressure, and its readings (P,) [Pa].

    The first sample falls at a random time within the first period. For several chambers (R, C) each has its own
    transducer, all sampled at the same times, and the readings are (P, C).
    """
    start = float(rng.uniform(0.0, 1.0 / sensor.rate))
    clock = np.arange(start, float(time[-1]), 1.0 / sensor.rate)
    if pressure.ndim == 2:
        return clock, np.stack([_readings(clock, time, p, sensor, rng) for p in pressure.T], axis=1)
    return clock, _readings(clock, time, pressure, sensor, rng)


def _readings(clock: Array, time: Array, pressure: Array, sensor: PressureSensor, rng: np.random.Generator) -> Array:
    value = np.interp(clock, time, pressure) + sensor.bias * float(rng.standard_normal())
    value = value + sensor.noise * rng.standard_normal(clock.size)
    if sensor.resolution > 0:
        value = np.round(value / sensor.resolution) * sensor.resolution
    return np.asarray(value)
