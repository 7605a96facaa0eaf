"""Fit parameters of a chain in space: stiffness ratios, tilt of the base, rest rotations of the joints."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from pliant.errors import InputError
from pliant.identification.names import path_of, paths
from pliant.mechanics import Mechanics, PlanarChain, SpatialChain, mechanics_of
from pliant.model import Model, Space
from pliant.model.features import named
from pliant.model.parts import SPACE, fitted
from pliant.model.quantity import scalars

RATIOS = tuple(name for name in scalars(Space) if name in fitted(SPACE))
PLANAR: tuple[str, ...] = ("rest_angle", "gravity_angle", "base_angle", "base_turn", "joint_share")
IN_SPACE: tuple[str, ...] = ("base_z", "gravity_z", "gain_x", "gain_y", "cross_gain", "aside")


class Foreign(NamedTuple):
    """Parameters that a kind of chain does not have.

    Attributes
    ----------
    stems : tuple of str
        Names without owner and number.
    parts : tuple
        Parts of the model whose fields they are.
    kind, other : str
        Where chains that have them move, and where those that do not.
    """

    stems: tuple[str, ...]
    parts: tuple[Any, ...]
    kind: str
    other: str


FOREIGN: dict[type[Mechanics], Foreign] = {
    PlanarChain: Foreign(IN_SPACE, (SPACE,), "in space", "in a plane"),
    SpatialChain: Foreign(PLANAR, (), "in a plane", "in space"),
}


def changed_space(model: Model, values: Mapping[str, float]) -> Space | None:
    """Return the model's data for motion in space with the parameter `values` applied; the same object if unchanged."""
    space = model.space
    changes: dict[str, Any] = {}
    for name, path in paths(values, SPACE):
        if path.owner:
            continue
        if not path.numbers:
            changes[path.field] = values[name]
        elif path.quantity.per == "axis":
            changes.setdefault(path.field, np.zeros(3) if space is None else getattr(space, path.field).copy())
            changes[path.field]["xyz".index(path.numbers[0])] = values[name]
        else:
            changes.setdefault(path.field, np.zeros((model.n, 3)) if space is None else space.rest_of(model.n))
            changes[path.field][path.number - 1, "xyz".index(path.numbers[0])] = values[name]
    if not changes:
        return space
    if space is None:
        raise InputError(f"the parameter {min(changes)} needs a chain in space, and this model is planar: "
                         "leave it out, or make the model spatial with space = Space()")  # fmt: skip
    return replace(space, **changes)


def space_start(model: Model) -> dict[str, float]:
    """Return start values, by name, of the parameters of a chain in space, from the model; {} for a planar model."""
    space = model.space
    if space is None:
        return {}
    turns = {f"rest_turn_{axis}_{i + 1}": float(v) for i, row in enumerate(space.rest_of(model.n))
             for axis, v in zip("xyz", row, strict=True)}  # fmt: skip
    tilts = {f"base_tilt_{axis}": float(v) for axis, v in zip("xyz", space.base_tilt, strict=True)}
    return {"stiffness_ratio": space.stiffness_ratio, "twist_ratio": space.twist_ratio, **tilts, **turns}


def check_space_names(names: Iterable[str], model: Model) -> None:
    """Raise InputError for spatial parameters in a planar model, planar ones in a spatial model, or a twist ratio of a
    chain that cannot twist.
    """
    foreign = FOREIGN[type(mechanics_of(model))]
    for name in names:
        path = path_of(name)
        if path.stem in foreign.stems or path.part in foreign.parts:
            raise InputError(f"parameter {name} needs a chain {foreign.kind}, but the model {model.name!r} is "
                             f"{foreign.other}: leave it out")  # fmt: skip
        if path.stem == "twist_ratio" and not named(model, ("twist",)):
            raise InputError("parameter twist_ratio: this chain cannot twist; give the model a twist_ratio first")
