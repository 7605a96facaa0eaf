"""Fit parameters of a chain in space: stiffness ratios, tilt of the base, rest rotations of the joints."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from pliant.errors import InputError
from pliant.model import Model, Space

TURN = r"rest_turn_([xyz])_(\d+)"
TILT = r"base_tilt_([xyz])"
ROWS: dict[str, tuple[Any, ...]] = {  # unit, lower, upper, scale, meaning
    "stiffness_ratio": ("1", 1e-2, 1e2, 0.1, "bending stiffness about y over that about x, in space"),
    "twist_ratio": ("1", 1e-3, 1e2, 0.1, "torsional over bending stiffness, in space"),
    TILT: ("rad", -3.2, 3.2, 0.05, "rotation of the base about an axis of the base frame, in space"),
    TURN: ("rad", -3.1, 3.1, 0.05, "rest turn of one joint about an axis of its link, in space"),
}
RATIOS = ("stiffness_ratio", "twist_ratio")


def changed_space(model: Model, values: Mapping[str, float]) -> Space | None:
    """Return the model's data for motion in space with the parameter `values` applied; the same object if unchanged."""
    space = model.space
    changes: dict[str, Any] = {name: values[name] for name in RATIOS if name in values}
    for name, value in values.items():
        if not name.startswith(("base_tilt", "rest_turn")):
            continue
        if found := re.fullmatch(TILT, name):
            changes.setdefault("base_tilt", np.zeros(3) if space is None else space.base_tilt.copy())
            changes["base_tilt"]["xyz".index(found[1])] = value
        elif found := re.fullmatch(TURN, name):
            changes.setdefault("rest_turn", np.zeros((model.n, 3)) if space is None else space.rest_of(model.n))
            changes["rest_turn"][int(found[2]) - 1, "xyz".index(found[1])] = value
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
    """Raise InputError for spatial parameters in a planar model, planar parameters in a spatial one, a joint number
    that does not exist, or twist of a chain that cannot twist.
    """
    planar = re.compile(r"rest_angle(_\d+)?|gravity_angle|base_angle|base_turn|joint_share")
    spatial = re.compile(f"{'|'.join(ROWS)}|base_z|gain_[xy]|cross_gain_.*|.+\\.aside")
    for name in names:
        own = {name, name.partition(".")[2]}
        wrong, owner, other = (spatial, "in space", "in a plane")
        if model.space is not None:
            wrong, owner, other = (planar, "in a plane", "in space")
        if any(map(wrong.fullmatch, own)):
            raise InputError(
                f"parameter {name} needs a chain {owner}, but the model {model.name!r} is {other}: leave it out"
            )
        if "twist_ratio" in own and model.space is not None and not model.space.twist_ratio:
            raise InputError("parameter twist_ratio: this chain cannot twist; give the model a twist_ratio first")
        for own_name in own:
            if (found := re.fullmatch(TURN, own_name)) and not 1 <= int(found[2]) <= model.n:
                raise InputError(f"parameter {name}: the model has joints 1 to {model.n}; use one of their numbers")
