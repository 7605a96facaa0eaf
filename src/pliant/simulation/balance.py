"""The balance of energy of a computed motion, in both directions, and the sentence that reports what is wrong with it.

The implicit midpoint rule balances energy to second order in the step. Where links move so fast that a step cannot
follow them, a chain gains energy that nobody gave it, or loses energy that nothing took.
"""

from __future__ import annotations

from typing import NamedTuple
from warnings import warn

import numpy as np
import xarray as xr

from pliant.equations.memory import memory_stored
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.simulation.accuracy import LIMIT, AccuracyWarning
from pliant.simulation.memory import laws_of

Array = np.ndarray
MOST_MISSING = 0.01  # of the energy in play
MOST_MISSING_WHERE_RIGHT = 0.1  # where the tip is right
STORED = ("kinetic_energy", "elastic_energy", "gravitational_energy", "memory_energy")
LOST = ("dissipated_energy", "memory_dissipation")
ROUNDING = 1e-9  # of the energies themselves
NOTHING = 1e-18  # J: joints of 1 N m/rad that turn by 1e-9 rad
EVERY = 256  # steps between two looks of a `Stepper`


class EnergyWarning(AccuracyWarning):
    """Energy appears or disappears in a computed motion."""


def energy_defects(motion: xr.Dataset) -> tuple[float, float]:
    """Return the energies that a motion gains from nothing and loses to nothing, as fractions of the energy in play.

    The energy in play is the largest that any form of it changes by, what the dampers took included.

    Parameters
    ----------
    motion : xarray.Dataset
        From `simulate`: kinetic, elastic, gravitational and memory energy, input work, both losses (time), J.

    Returns
    -------
    gain, loss : float
        0 where stored energy less input work plus losses never rises above, or falls below, its first value.
    """
    stored = np.array([motion[name].values for name in STORED if name in motion])
    lost = np.sum([motion[name].values for name in LOST if name in motion], axis=0)
    excess = np.sum(stored, axis=0) - motion["input_work"].values + lost
    excess -= excess[0]
    size = in_play(stored.min(axis=1), stored.max(axis=1), float(lost[-1]))
    return (float(excess.max()) / size, -float(excess.min()) / size) if size > 0.0 else (0.0, 0.0)


def in_play(low: Array, high: Array, lost: float) -> float:
    """Energy in play [J] of forms of energy between two values each; 0 where nothing but rounding moves."""
    size = max(float((high - low).max()), lost)
    return size if size > max(ROUNDING * float(np.abs([low, high]).max()), NOTHING) else 0.0


class Defects(NamedTuple):
    """Faults of a computed motion."""

    error: float  # of the tip, of the length; not a number: not estimated
    length: float  # m
    gain: float  # of the energy in play, from nothing
    loss: float  # of the energy in play, to nothing


def warn_of_defects(found: Defects, step: float, advice: str) -> None:
    """Issue one warning where the tip is wrong by more than 1 % of the length, or energy appears or disappears.

    Energy alone is reported beyond 10 %, beyond 1 % where the error of the tip was not estimated.
    """
    missing, energy = missing_energy(found.gain, found.loss)
    if found.error > LIMIT:
        size = (
            f"by {1e3 * found.error * found.length:.3g} mm, {100 * found.error:.3g} % of the length"
            if np.isfinite(found.error) else "by an amount that cannot be estimated"
        )
        also = f", and the motion {energy}" if missing > MOST_MISSING else ""
        text, kind = f"the tip may be wrong {size}{also}", AccuracyWarning
    elif missing > (MOST_MISSING if np.isnan(found.error) else MOST_MISSING_WHERE_RIGHT):
        text, kind = f"the motion {energy}", EnergyWarning
    else:
        return
    warn(f"{text}: the step of {1e3 * step:.3g} ms is too long for this motion; {advice}", kind, stacklevel=4)


def missing_energy(gain: float, loss: float) -> tuple[float, str]:
    """The larger one of two fractions of the energy in play, and how to put it."""
    if gain >= loss:
        return gain, f"gains {100 * gain:.3g} % of its energy from nothing"
    return loss, f"loses {100 * loss:.3g} % of its energy to nothing"


def stored_energy(model: Model, x: Array, v: Array, states: Array) -> Array:
    """Energies (4,) of a chain now, J: kinetic, elastic, gravitational, of the memory with its states."""
    chain = mechanics_of(model)
    kinetic, elastic, weight = chain.energy(x, v)
    q, K, held = chain.joint_coordinates(x), chain.joints.K, [0.0]
    if model.memory:
        held = [K[i] * memory_stored(i, q[i], states, law) for i, law in enumerate(laws_of(model))]
    return np.array([kinetic, elastic, weight, sum(held)], dtype=float)


class EnergyWatch:
    """Balances the energy of a chain that moves one step at a time, every `EVERY` steps.

    Attributes
    ----------
    gain, loss : float
        Largest energies that came from nothing and went to nothing, as fractions of the energy in play: the largest
        change of a form of energy, or what the dampers took.
    """

    def __init__(self, model: Model) -> None:
        self._model, self._left = model, 0
        self.total = np.zeros(3)  # J: input work, loss of the dampers, loss of the memory; the steps add to it
        self.forget()
        self.gain = self.loss = 0.0

    def forget(self) -> None:
        """Begin anew: something else than the inputs has done work."""
        self._first: Array | None = None
        self._low = self._high = np.zeros(4)

    def look(self, x: Array, v: Array, states: Array, length: float, steps: int = 1) -> None:
        """Take note of steps of a `length` [s] that were made, and warn of energy that is missing."""
        self._left -= steps
        if self._left > 0:
            return
        self._left = EVERY
        stored = stored_energy(self._model, x, v, states)
        if self._first is None:
            self._first, self._low, self._high = stored, stored, stored
            self.total[:] = 0.0
            return
        self._low, self._high = np.minimum(self._low, stored), np.maximum(self._high, stored)
        work, *lost = self.total.tolist()
        size = in_play(self._low, self._high, sum(lost))
        excess = (float(np.sum(stored - self._first)) - work + sum(lost)) / size if size > 0.0 else 0.0
        warned = max(self.gain, self.loss) > MOST_MISSING
        self.gain, self.loss = max(self.gain, excess), max(self.loss, -excess)
        missing, energy = missing_energy(self.gain, self.loss)
        if missing > MOST_MISSING and not warned:
            warn(
                f"the chain {energy}: the step of {1e3 * length:.3g} ms is too long for how fast it moves; use a "
                "shorter one", EnergyWarning, stacklevel=4,
            )
