"""Energy balance of a simulated motion, with warnings if energy appears or disappears without cause.

The implicit midpoint rule balances energy to second order in the step. Where links move too fast for the step, the
computed chain gains energy without a source or loses energy without dissipation.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple
from warnings import warn

import numpy as np
import xarray as xr

from pliant.equations.memory import memory_stored
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.simulation.initial_value import Marched
from pliant.simulation.state import laws_of, memory_energy
from pliant.simulation.time_step import LIMIT, AccuracyWarning

Array = np.ndarray
MOST_MISSING = LIMIT  # of the exchanged energy, see `energy_defects`
STORED = ("kinetic_energy", "elastic_energy", "gravitational_energy", "memory_energy")
BASE_MOVES = "base_force"  # variable of a motion whose base moves: its work is not computed, so nothing is judged
LOST = ("dissipated_energy", "memory_dissipation")
ROUNDING = 1e-9  # of the energies themselves
NOTHING = 1e-18  # J: joints of 1 N m/rad that turn by 1e-9 rad
EVERY = 256  # steps between two balances of a `Stepper`


class EnergyWarning(AccuracyWarning):
    """Warning that the energy of a simulated motion is not balanced."""


def energies(model: Model, marched: Marched) -> dict[str, Array]:
    """Return, by name, the energies (T,) [J] of a motion at T instants: kinetic, elastic, gravitational, work of the
    inputs, dissipated, and with hysteresis that of its branches and their loss.
    """
    x, v, work, states = marched
    stored = mechanics_of(model).energy(x, v)
    values = {
        "kinetic_energy": np.asarray(stored.kinetic),
        "elastic_energy": np.asarray(stored.elastic),
        "gravitational_energy": np.asarray(stored.gravity),
        "input_work": work[:, 0],
        "dissipated_energy": work[:, 1],
    }
    if model.memory:
        values |= {"memory_energy": memory_energy(model, x, states), "memory_dissipation": work[:, -1]}
    return values


def energy_defects(motion: xr.Dataset | Mapping[str, Array]) -> tuple[float, float]:
    """Return the energy that a motion gains without a source, and the energy that it loses without dissipation, as
    fractions of the energy exchanged in the motion.

    The exchanged energy is the largest change of any form of energy or, if larger, the energy dissipated.

    Parameters
    ----------
    motion : xarray.Dataset, or a mapping with the same names
        From `simulate`: kinetic, elastic, gravitational and hysteresis energy, input work, both losses (time), J.

    Returns
    -------
    gain, loss : float
        Largest rise and fall of stored energy - input work + losses from its first value, over the exchanged energy. 0
        where the base moves.
    """
    if BASE_MOVES in motion:
        return 0.0, 0.0
    stored = np.array([motion[name] for name in STORED if name in motion])
    lost = np.sum([np.asarray(motion[name]) for name in LOST if name in motion], axis=0)
    excess = np.sum(stored, axis=0) - np.asarray(motion["input_work"]) + lost
    excess -= excess[0]
    size = in_play(stored.min(axis=1), stored.max(axis=1), float(lost[-1]))
    return (float(excess.max()) / size, -float(excess.min()) / size) if size > 0.0 else (0.0, 0.0)


def in_play(low: Array, high: Array, lost: float) -> float:
    """Return the energy [J] exchanged in a motion: the largest range of any form of energy or, if larger, the
    dissipation `lost`.

    `low` and `high` are the extremes of each form of energy [J].

    The result is 0 where nothing but rounding changes.
    """
    size = max(float((high - low).max()), lost)
    return size if size > max(ROUNDING * float(np.abs([low, high]).max()), NOTHING) else 0.0


class Defects(NamedTuple):
    """Tip error and energy imbalance of a simulated motion."""

    error: float  # of the tip, over the length; NaN: not estimated
    length: float  # m
    gain: float  # energy without a source, over the exchanged energy
    loss: float  # energy lost without dissipation, over the exchanged energy


def warn_of_defects(found: Defects, time_step: float, advice: str) -> None:
    """Issue one warning if a motion's tip error exceeds 1 % of the length, or if more than 1 % of its energy appears or
    disappears.
    """
    missing, energy = missing_energy(found.gain, found.loss)
    if found.error > LIMIT:
        size = (
            f"by {1e3 * found.error * found.length:.3g} mm, {100 * found.error:.3g} % of the length"
            if np.isfinite(found.error) else "by an amount that cannot be estimated"
        )
        also = f", and the motion {energy}" if missing > MOST_MISSING else ""
        text, kind = f"the tip may be wrong {size}{also}", AccuracyWarning
    elif missing > MOST_MISSING:
        text, kind = f"the motion {energy}", EnergyWarning
    else:
        return
    warn(f"{text}: the step of {1e3 * time_step:.3g} ms is too long for this motion; {advice}", kind, stacklevel=4)


def missing_energy(gain: float, loss: float) -> tuple[float, str]:
    """Return the larger of energy gain and loss, as fractions of the exchanged energy, and its description as text."""
    if gain >= loss:
        return gain, f"gains {100 * gain:.3g} % of its energy without a source"
    return loss, f"loses {100 * loss:.3g} % of its energy without dissipation"


def stored_energy(model: Model, x: Array, v: Array, states: Array) -> Array:
    """Return the energies (4,) [J] of a chain: kinetic, elastic, gravitational, and stored by hysteresis.

    `states` are its hysteresis states.
    """
    chain = mechanics_of(model)
    kinetic, elastic, weight = chain.energy(x, v)
    q, K = chain.joint_coordinates(x), chain.joints.K
    hysteresis = [K[i] * memory_stored(i, q[i], states, law) for i, law in enumerate(laws_of(model))]
    return np.array([kinetic, elastic, weight, sum(hysteresis)], dtype=float)


class EnergyWatch:
    """Energy balance of a chain that is simulated step by step, checked every `EVERY` steps.

    Attributes
    ----------
    gain, loss : float
        Largest energies gained without a source and lost without dissipation, as fractions of the exchanged energy (see
        `energy_defects`).
    """

    def __init__(self, model: Model) -> None:
        self._model, self._left = model, 0
        self.total = np.zeros(3)  # J: input work, loss of the dampers, loss of hysteresis; the steps add to it
        self.forget()
        self.gain = self.loss = 0.0

    def forget(self) -> None:
        """Restart the energy balance after the state of the chain was changed from outside."""
        self._first: Array | None = None
        self._low = self._high = np.zeros(4)

    def look(self, x: Array, v: Array, states: Array, length: float, steps: int = 1) -> None:
        """Count `steps` time steps of a `length` [s] each.
        If a check is due, compute the energy balance and warn of missing energy.
        """
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
                f"the chain {energy}: the step of {1e3 * length:.3g} ms is too long for this motion; use a "
                "shorter step", EnergyWarning, stacklevel=4,
            )


class Unwatched(EnergyWatch):
    """In place of an energy balance, for a chain on a base that moves, whose work is not counted."""

    def look(self, x: Array, v: Array, states: Array, length: float, steps: int = 1) -> None:
        """Leave the energies unchecked."""
