"""Energy from nothing: what a step of fixed length may add to a motion, and the sentence that tells it.

The implicit midpoint rule balances energy to second order in the step. Where links turn so fast that a step cannot draw
their motion, an undamped chain can gain energy that nobody gave it, and a shorter step is the cure.
"""

from __future__ import annotations

from typing import NamedTuple
from warnings import warn

import numpy as np
import xarray as xr

from pliant.mechanics import mechanics_of
from pliant.model import Model

Array = np.ndarray
MOST_GAIN = 0.01  # of the largest energy in the motion
STORED = ("kinetic_energy", "elastic_energy", "gravitational_energy", "memory_energy")
LOST = ("dissipated_energy", "memory_dissipation")
EVERY = 256  # steps between two looks of a `Stepper`


class EnergyWarning(UserWarning):
    """A motion has gained energy that nobody gave it."""


def energy_gain(motion: xr.Dataset) -> float:
    """Largest energy that a motion has and nobody gave it, in parts of the largest that it ever held.

    Parameters
    ----------
    motion : xarray.Dataset
        From `simulate`: kinetic, elastic, gravitational and memory energy, input work, both losses (time), J.

    Returns
    -------
    float
        0 where stored energy less input work plus losses never rises above its first value.
    """
    stored = [motion[name].values for name in STORED if name in motion]
    given = motion["input_work"].values - sum(motion[name].values for name in LOST if name in motion)
    gained = sum(stored) - given
    size = max(float(max(np.ptp(part), np.abs(part).max() if k != 2 else 0.0)) for k, part in enumerate(stored))
    rise = float((gained - gained[0]).max())
    return rise / size if size > 0.0 else 0.0


def tell_gain(motion: xr.Dataset, step: float) -> xr.Dataset:
    """The motion, given its `energy_gain` as an attribute; a warning where it exceeds 1 %."""
    gain = energy_gain(motion)
    if gain > MOST_GAIN:
        warn(
            f"the motion gains {100 * gain:.3g} % of its energy from nothing: the step of {1e3 * step:.3g} ms is too "
            "long for how fast its links turn; use a shorter one, or method='Radau'", EnergyWarning, stacklevel=4,
        )
    motion.attrs["energy_gain"] = gain  # `assign_attrs` would copy the whole
    return motion


class Held(NamedTuple):
    """What a chain holds under a pressure that does not change: no step may add to it."""

    pressure: tuple[float, ...]  # Pa, of each chamber
    energy: float
    size: float  # of its parts, J


def held_energy(model: Model, phi: Array, w: Array, pressure: tuple[float, ...]) -> Held:
    """Energy of a chain under constant pressures, J: the work that they can still do counts as stored."""
    stored = mechanics_of(model).energy(phi, w)
    kinetic, elastic, weight = map(float, stored)
    push = float(model.actuation.joint_torques(pressure) @ mechanics_of(model).joint_coordinates(phi))
    return Held(pressure, kinetic + elastic + weight - push, kinetic + elastic)


class EnergyWatch:
    """Looks at the energy of a chain without memory every `EVERY` steps under one pressure.

    Attributes
    ----------
    gain : float
        Largest energy that came from nothing within one stretch of constant pressure, in parts of what it held.
    """

    def __init__(self, model: Model) -> None:
        self._model, self._left = model, EVERY
        self._before: Held | None = None
        self._reliable = not (model.memory or model.actuation.remembers)
        self.gain = 0.0

    def forget(self) -> None:
        """Begin anew: something else than a pressure has done work."""
        self._before = None

    def look(self, phi: Array, w: Array, pressure: tuple[float, ...], length: float, steps: int = 1) -> None:
        """Take note of steps that were made; `pressure` holds those behind the valves, Pa."""
        before = self._before
        if not self._reliable:
            return
        if before is None or before.pressure != pressure:
            self._before, self._left = Held(pressure, np.nan, 0.0), EVERY
            return
        self._left -= steps
        if self._left > 0:
            return
        self._left = EVERY
        now = held_energy(self._model, phi, w, pressure)
        if np.isnan(before.energy):
            self._before = now
            return
        size = max(now.size, before.size)
        gain = (now.energy - before.energy) / size if size > 0.0 else 0.0
        if gain > MOST_GAIN >= self.gain:
            under = ", ".join(f"{p:.6g}" for p in pressure)
            warn(
                f"the chain gains {100 * gain:.3g} % of its energy from nothing within {EVERY} steps under "
                f"{under} Pa: the step of {1e3 * length:.3g} ms is too long for how fast "
                "its links turn; use a shorter one", EnergyWarning, stacklevel=4,
            )
        self.gain = max(self.gain, gain)
