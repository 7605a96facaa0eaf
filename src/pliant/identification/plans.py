"""Intermediate results that forward problems share between recordings, derivatives and evaluations of a fit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from pliant.equations.symbols import Joints, MemoryLaw
from pliant.identification.parameters import apply, of_the_model
from pliant.mechanics import mechanics_of
from pliant.model import Model, Station
from pliant.simulation import equilibrium
from pliant.simulation.chamber_course import row_of
from pliant.simulation.drive import Drive, Layout

Array = np.ndarray


class ModelAt(NamedTuple):
    """A model at some values of its parameters, and its constants for the kernels."""

    model: Model
    body: Any  # of its family: `Mechanics.body`
    joints: Joints
    memory: MemoryLaw
    points: dict[str, Station]  # that can be observed, by name
    torques: dict[bytes, Array]  # of joints under pressures: recordings share them
    rows: dict[bytes, Array]  # of chambers, likewise
    resting: dict[bytes, Array]  # angles at rest, likewise
    beside: dict[tuple[str, ...], Array]  # along, across, aside (3, S) of stations, likewise

    def torque_before(self, pressure: Array) -> Array:
        """Torques (n + S,) of joints and strains long at rest at `pressure` (C,) [Pa], N m."""
        key = pressure.tobytes()
        if key not in self.torques:
            self.torques[key] = self.model.actuation.joint_torques(pressure)
        return self.torques[key]

    def chambers(self, pressure: Array) -> Array:
        """Rows (C, k) of the chambers, `pressure` (C,) [Pa] behind their valves at first, as long as the longest."""
        key = pressure.tobytes()
        if key not in self.rows:
            rows = [row_of(c, float(p)) for c, p in zip(self.model.chambers, pressure, strict=True)]
            length = max(row.size for row in rows)
            self.rows[key] = np.stack([np.pad(row, (0, length - row.size)) for row in rows])
        return self.rows[key]

    def places(self, stations: tuple[str, ...]) -> Array:
        """Along, across and aside (3, S) the links that carry them of some stations, m."""
        if stations not in self.beside:
            self.beside[stations] = np.array([self.points[name][2:] for name in stations]).T
        return self.beside[stations]

    def at_rest(self, pressure: Array) -> Array:
        """Absolute angles (n,), with strains behind them, at rest under `pressure` (C,) [Pa] and no other load."""
        key = pressure.tobytes()
        if key not in self.resting:
            self.resting[key] = mechanics_of(self.model).coordinates(equilibrium(self.model, pressure))
        return self.resting[key]


class Plans:
    """Cache of models, step plans and torques that forward problems share.

    Recordings ask for the same model one after the other, derivatives by what moves no pressure for the same drive, and
    those by valves and laws for the same steps.
    """

    def __init__(self) -> None:
        self.models: dict[Any, ModelAt] = {}
        self.drives: dict[Any, Drive] = {}
        self.layouts: dict[Any, Layout] = {}
        self.slopes: dict[Any, Any] = {}  # derivatives that recordings share, at one set of values: `sensitivity`
        self.poses: dict[Any, Array] = {}  # joint angles of a body that is held

    def at(self, model: Model, values: Mapping[str, float]) -> ModelAt:
        """The `model` with the values of one recording put in; always the same model."""
        key = of_the_model(values)
        if key not in self.models:
            m = apply(model, dict(key))
            points = {p.name: p for p in m.points}
            chain = mechanics_of(m)
            self.models[key] = ModelAt(m, chain.body, chain.joints, m.memory.law(), points, {}, {}, {}, {})
        return self.models[key]

    def forget(self, most: int) -> None:
        """Drop everything of a kind of which there are more than so many."""
        if len(self.models) > most:
            self.models.clear()
        if len(self.drives) > most:
            self.drives.clear()
            self.layouts.clear()  # each keeps what its drives were made of
        if len(self.poses) > most:
            self.poses.clear()
