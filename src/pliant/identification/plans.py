"""Cache of models, time steps and torques that the simulations of a fit share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from pliant.equations.poses import Settling
from pliant.equations.symbols import Joints, MemoryLaw
from pliant.identification.parameters import apply, is_place, moved_stations, of_the_model
from pliant.mechanics import Mechanics, mechanics_of
from pliant.model import Actuation, ActuationInput, Model, Station
from pliant.simulation import equilibrium
from pliant.simulation.chamber_course import row_of
from pliant.simulation.drive import Drive, Layout

Array = np.ndarray


class ModelAt(NamedTuple):
    """A model with parameter values applied, its constants for the compiled loops, and cached results."""

    model: Model
    body: Any  # `Mechanics.body`
    joints: Joints
    memory: MemoryLaw
    points: dict[str, Station]  # observable points by name
    torques: dict[bytes, Array]  # cache of `torque_before`, by pressure
    rows: dict[bytes, Array]  # cache of `chambers`, by pressure
    parts: dict[Any, Any]  # `Plans.parts`
    resting: dict[bytes, Array]  # cache of `at_rest`, by pressure
    beside: dict[tuple[str, ...], Array]  # cache of `places`, by station names
    carriers: dict[tuple[str, ...], Mechanics]  # cache of `carrying`, by station names
    poses: dict[str, list[Settling]]  # of recordings of settled poses, by name: their equilibria, once computed

    def torque_before(self, pressure: Array) -> Array:
        """Return the generalised static torques (n + S,) [N m] of n joints and S strains at constant pressures (C,)
        [Pa].
        """
        key = pressure.tobytes()
        if key not in self.torques:
            self.torques[key] = self.model.actuation.joint_torques(pressure)
        return self.torques[key]

    def chambers(self, pressure: Array) -> Array:
        """Return k constants for each of C chambers, (C, k), as the compiled loops need them. The pressures behind the
        valves start at `pressure` (C,) [Pa].
        """
        key = pressure.tobytes()
        if key not in self.rows:
            rows = [self.row(c, p) for c, p in zip(self.model.chambers, pressure.tolist(), strict=True)]
            self.rows[key] = np.zeros((len(rows), max(row.size for row in rows)))
            for filled, row in zip(self.rows[key], rows, strict=True):
                filled[: row.size] = row
        return self.rows[key]

    def row(self, chamber: ActuationInput, pressure: float) -> Array:
        """Return the constants (k,) of a chamber at `pressure` [Pa], which models with the same chamber share."""
        key = (row_of, chamber.key, pressure)
        if key not in self.parts:
            self.parts[key] = row_of(chamber, pressure)
        row: Array = self.parts[key]
        return row

    def places(self, stations: tuple[str, ...]) -> Array:
        """Return the coordinates (3, S) [m] of S stations relative to their links: along the link, across it in the
        plane, and out of the plane.
        """
        if stations not in self.beside:
            self.beside[stations] = np.array([self.points[name][2:] for name in stations]).T
        return self.beside[stations]

    def carrying(self, stations: tuple[str, ...]) -> Mechanics:
        """Return the mechanics of the chain whose only points are these stations."""
        if stations not in self.carriers:
            points = tuple(self.points[name] for name in stations)
            self.carriers[stations] = mechanics_of(self.model.with_(stations=points))
        return self.carriers[stations]

    def at_rest(self, pressure: Array) -> Array:
        """Return the coordinates of the chain in equilibrium under the constant pressures (C,) [Pa] of C chambers:
        absolute link angles [rad] (in space joint angles), then strains.
        """
        key = pressure.tobytes()
        if key not in self.resting:
            self.resting[key] = mechanics_of(self.model).coordinates(equilibrium(self.model, pressure))
        return self.resting[key]


class Plans:
    """Cache of models, time steps and torques that the simulations of a fit share.

    Recordings use the same model one after another. Derivatives with respect to parameters that change no pressure use
    the same steps and torques, and those with respect to valves and torque laws the same steps.
    """

    def __init__(self) -> None:
        self.models: dict[Any, ModelAt] = {}
        self.bodies: dict[Any, ModelAt] = {}  # by the values of all parameters but the places of markers
        self.drives: dict[Any, Drive] = {}
        self.layouts: dict[Any, Layout] = {}
        self.parts: dict[Any, Any] = {}  # chambers, their constants and hysteresis, by the values of their parameters
        self.slopes: dict[Any, Any] = {}  # derivatives that recordings share, at one set of values: `sensitivity`
        self.poses: dict[Any, Any] = {}  # of a body that is held, see `held_pose.pose_through`

    def at(self, model: Model, values: Mapping[str, float]) -> ModelAt:
        """Return the `model` with the parameter values of one recording applied.
        Equal values return the same cached object.
        """
        model_values = of_the_model(values)
        key = (model_values, model.moving_base)
        if key not in self.models:
            body = (tuple((name, None if is_place(name) else value) for name, value in model_values), model.moving_base)
            if body in self.bodies and body != key:
                like = self.bodies[body]
                m = like.model.with_(**moved_stations(like.model, dict(model_values)))
                points = {p.name: p for p in m.points}
                self.models[key] = like._replace(model=m, points=points, beside={}, carriers={})
            else:
                self.models[key] = self.bodies[body] = self.applied(model, dict(model_values))
        return self.models[key]

    def applied(self, model: Model, values: dict[str, float]) -> ModelAt:
        """Return the `model` with the parameter `values` applied."""
        m = self.sharing_actuation(apply(model, values, self.parts))
        chain = mechanics_of(m)
        constants, points = (chain.body, chain.joints, m.memory.law()), {p.name: p for p in m.points}
        return ModelAt(m, *constants, points, {}, {}, self.parts, {}, {}, {}, {})

    def sharing_actuation(self, model: Model) -> Model:
        """Return the model with the constants of all its inputs together from an earlier one with the same inputs."""
        inputs = model.actuation
        where = inputs.joints, inputs.segment_length, inputs.segment_joints, inputs.turns
        key = (Actuation, *map(id, inputs.inputs), *where)
        model.__dict__["actuation"] = self.parts.setdefault(key, inputs)
        return model

    def forget(self, most: int) -> None:
        """Empty each cache of models, steps and torques that has more than `most` entries; the latest model stays."""
        if len(self.models) > most:
            key, latest = self.models.popitem()
            for cache in (self.models, self.bodies, self.parts):
                cache.clear()
            self.models[key] = latest
        if len(self.drives) > most:
            self.drives.clear()
            self.layouts.clear()  # drives are computed from layouts
        if len(self.poses) > most:
            self.poses.clear()
