"""Targets and tips of the environments in `pliant.exporters.gymnasium`: points that a body reaches, in the plane and in
space, and the tips of many bodies that differ in their parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from pliant.errors import InputError, SimulationError
from pliant.mechanics import Mechanics, PlanarChain, SpatialChain, mechanics_of
from pliant.model import Model
from pliant.simulation import state
from pliant.simulation.state import first_alone, typical_pressure

Array = np.ndarray
PART = 0.8  # of the highest inputs, under which targets are reached
LEVELS, PHASES = 5, 24  # of the surface of targets in space


def highest_inputs(model: Model, highest: float | Sequence[float]) -> Array:
    """Return the highest value of each input (C,): `highest`, one number for all inputs or one for each. If it is 0: in
    the plane twice the typical pressure of the first input for all, in space twice the typical value of each input (for
    an input that bends nothing alone, the largest of its unit). Raise InputError if no input bends the model.
    """
    count = model.actuation.count
    levels = np.asarray(highest, dtype=float)
    if levels.shape not in ((), (count,)) or not (np.isfinite(levels).all() and (levels >= 0.0).all()):
        raise InputError(f"highest must be one value of at least 0, or one for each of {count} inputs, got {highest}")
    if levels.any():
        units = model.actuation.units
        if levels.shape == () and len(set(units)) > 1:
            raise InputError(f"the inputs have several units: give one highest value for each, in {', '.join(units)}")
        return np.broadcast_to(levels, (count,)).copy()
    values = targets_of(model).highest(model)
    if not (values > 0).all():
        raise InputError(
            "pressure does not bend this model, so that it reaches no target: use a model whose chambers have a torque"
        )
    return values


class EpisodeTargets(Protocol):
    """Points that the tip of a body reaches at rest, addressed by `width` numbers between 0 and 1."""

    width: int

    def place(self, address: Array) -> Array:
        """Return the points (M, d) [m] at the addresses (M, width), where targets rest."""

    def moved(self, address: Array, turn: Array) -> Array:
        """Return the points (M, d) [m] of targets that started at `address` (M, width), after `turn` / (2 pi) rounds of
        their motion, with `turn` (M,) [rad].
        """


class CurveOfTargets:
    """Targets in the plane: the curve of tips under pressure in the first chamber alone, up to `PART` of `highest`."""

    width = 1

    @staticmethod
    def highest(model: Model) -> Array:
        """Return the highest values (C,) of C inputs by default: twice the typical pressure of the first."""
        return np.full(model.actuation.count, 2.0 * typical_pressure(model))

    def __init__(self, model: Model, highest: Array) -> None:
        tips = []
        for level in np.linspace(0.0, PART * highest[0], 33):
            try:
                tips.append(tip_at_rest(model, first_alone(model, level)))
            except SimulationError:
                break
        self.points = np.array(tips)

    def place(self, address: Array) -> Array:
        """Return the points (M, 2) [m] at the addresses (M, 1), of which 0 is the tip without pressure."""
        share = np.linspace(0.0, 1.0, len(self.points))
        return np.stack([np.interp(address[:, 0], share, column) for column in self.points.T], axis=-1)

    def moved(self, address: Array, turn: Array) -> Array:
        """Return the points (M, 2) [m] of targets that move along the whole curve and back."""
        return self.place(0.5 - 0.5 * np.cos(turn[:, None] + np.pi * address))


class SurfaceOfTargets:
    """Targets in space: tips under the inputs `input_pattern`. An address is a level and a phase."""

    width = 2

    @staticmethod
    def highest(model: Model) -> Array:
        """Return the highest values (C,) of C inputs by default: twice the typical value of each or, for an input that
        bends nothing alone, the largest of its unit.
        """
        values = np.array([2.0 * typical_pressure(model, k) for k in range(model.actuation.count)])
        for unit in set(model.actuation.units):
            same = np.array([u == unit for u in model.actuation.units])
            values[same & (values == 0.0)] = values[same].max()
        return values

    def __init__(self, model: Model, highest: Array) -> None:
        start = tip_at_rest(model, 0.0 * highest)
        rows = [np.tile(start, (PHASES + 1, 1))]
        for level in np.linspace(0.0, 1.0, LEVELS)[1:]:
            inputs = PART * level * highest * input_pattern(np.arange(PHASES) / PHASES, len(highest))
            try:
                ring = [tip_at_rest(model, values) for values in inputs]
            except SimulationError:  # no equilibrium: the surface ends at the level before
                break
            rows.append(np.array([*ring, ring[0]]))
        self.points = np.array(rows)  # (levels, phases, 3) m

    def place(self, address: Array) -> Array:
        """Return the points (M, 3) [m] at the addresses (M, 2), interpolated between levels and phases."""
        level, phase = np.clip(address[:, 0], 0.0, 1.0) * (len(self.points) - 1), address[:, 1] % 1.0 * PHASES
        i = np.minimum(level.astype(int), max(len(self.points) - 2, 0))
        j = np.minimum(phase.astype(int), PHASES - 1)
        k = np.minimum(i + 1, len(self.points) - 1)
        a, b = (level - i)[:, None], (phase - j)[:, None]
        lower = (1.0 - b) * self.points[i, j] + b * self.points[i, j + 1]
        upper = (1.0 - b) * self.points[k, j] + b * self.points[k, j + 1]
        return np.asarray((1.0 - a) * lower + a * upper)

    def moved(self, address: Array, turn: Array) -> Array:
        """Return the points (M, 3) [m] of targets whose phase advances by one in each turn, at a constant level."""
        return self.place(address + np.stack([0.0 * turn, turn / (2.0 * np.pi)], axis=1))


TARGETS: dict[type[Mechanics], type[CurveOfTargets | SurfaceOfTargets]] = {
    PlanarChain: CurveOfTargets, SpatialChain: SurfaceOfTargets,
}


def targets_of(model: Model) -> type[CurveOfTargets | SurfaceOfTargets]:
    """Return the kind of targets of a model in the plane or in space."""
    return TARGETS[type(mechanics_of(model))]


def input_pattern(phase: Array, count: int) -> Array:
    """Return the fraction (M, C) of each of C inputs at phases (M,): max(0, cos 2 pi (phase - k / C)) of input k, so
    that the inputs rise and fall one after another; of a single input (1 - cos 2 pi phase) / 2.
    """
    if count == 1:
        return np.asarray(0.5 - 0.5 * np.cos(2.0 * np.pi * phase))[:, None]
    return np.maximum(0.0, np.cos(2.0 * np.pi * (phase[:, None] - np.arange(count) / count)))


def tip_at_rest(model: Model, inputs: Array) -> Array:
    """Return the position of the tip [m] in equilibrium under constant inputs (C,)."""
    chain = mechanics_of(model)
    return np.asarray(chain.tips(chain.coordinates(state.equilibrium(model, inputs)))[-1])


class Tips:
    """Tips of chains, each of which is one of several models of one structure.

    Parameters
    ----------
    bodies : sequence of Model
    """

    def __init__(self, bodies: Sequence[Model]) -> None:
        self._chains = [mechanics_of(model) for model in bodies]
        self._in_space = isinstance(self._chains[0], SpatialChain)
        self._rigid = not (self._in_space or bodies[0].extensions)
        columns: tuple[Sequence[object], ...] = ()
        if self._in_space:
            columns = tuple(zip(*(chain.body for chain in self._chains), strict=True))
        elif self._rigid:
            columns = [m.link_length for m in bodies], [m.first_joint for m in bodies]
        self._pool = [np.stack([np.asarray(value) for value in column]) for column in columns]

    def __call__(self, body: Array, position: Array) -> Array:
        """Return the tips (N, d) [m] of N chains at their coordinates (N, size), where chain i is the model with the
        index body[i].
        """
        if self._in_space:  # one evaluation for all: the constants have the chains along the last axis
            chain, constants = self._chains[0], (np.moveaxis(a[body], 0, -1) for a in self._pool)
            every = chain.with_constants(type(chain.body)(*constants), chain.joints)
            return np.asarray(every.tips(position)[:, -1])
        if self._rigid:
            length, first = (a[body] for a in self._pool)
            x = first[:, 0] - (length * np.sin(position)).sum(axis=1)
            return np.stack([x, first[:, 1] + (length * np.cos(position)).sum(axis=1)], axis=1)
        tips = np.empty((len(body), self._chains[0].dimension))
        for k in np.unique(body):
            tips[body == k] = self._chains[k].tips(position[body == k])[:, -1]
        return tips
