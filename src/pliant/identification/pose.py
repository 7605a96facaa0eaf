"""Joint angles of a held body from the measured positions of its points."""

from __future__ import annotations

from typing import Any

import numpy as np

from pliant.mechanics import mechanics_of
from pliant.model import Model, Station, fixed_length

Array = np.ndarray
LEAST_PULL = 1e-6  # weight of the unloaded shape over that of a measured point
POSE_STEPS = 60


def posed(model: Model, chosen: list[Station], seen: Array, found: dict[Any, Array]) -> Array:
    """Return the joint angles (n,) [rad] that bring the points `chosen` closest to the positions `seen` (S, 2) [m].

    Solved by Gauss-Newton in absolute angles. A joint that the points do not determine stays close to the unloaded
    shape, by a regularisation with a millionth of a point's weight. The pose depends on lengths and positions alone and
    is cached in `found`, for models that differ in nothing else.
    """
    points = tuple(p[1:] for p in chosen)
    base = (model.base_length, model.base_angle, points)
    turned = [model.space.rest_turn, model.space.base_tilt] if model.space else [model.rest_angle]
    key = (*base, *(a.tobytes() for a in (model.link_length, *turned, seen)))
    if key not in found:
        found[key] = sought(model, chosen, seen)
    return found[key].copy()


def sought(model: Model, chosen: list[Station], seen: Array) -> Array:
    """Return the joint angles of `posed` without its cache."""
    there = (model if model.space else fixed_length(model)).with_(stations=tuple(chosen))
    chain = mechanics_of(there)
    pull = LEAST_PULL * model.length * chain.to_joints
    unloaded = chain.coordinates(np.zeros(model.size))
    phi = unloaded.copy()
    for _ in range(POSE_STEPS):
        place, slope = chain.points_and_slopes(phi)
        rows = np.concatenate([slope.reshape(-1, model.size), pull])
        aim = np.concatenate([(seen - place).ravel(), pull @ (unloaded - phi)])
        move = np.linalg.lstsq(rows, aim)[0]
        largest = float(np.abs(move).max())
        phi += move * min(1.0, 0.5 / max(largest, 1e-300))
        if largest < 1e-13:
            break
    return chain.joint_coordinates(phi)
