"""The pose in which a hand holds a body, from the places of its observed points."""

from __future__ import annotations

from typing import Any

import numpy as np

from pliant.model import Model, Station, fixed_length
from pliant.simulation import lengthened, state

Array = np.ndarray
LEAST_PULL = 1e-6  # of a held pose towards the unloaded shape, in pulls of a measured point
POSE_STEPS = 60


def beside_links(model: Model, x: Array, points: Array) -> tuple[Array, Array]:
    """Places along and across (P, n + 1) each link of points (P, 2) [m], `bend_sign` undone, the base first.

    Places along a link are those of the link unstretched; x (n,) holds absolute angles, strains behind them.
    """
    stretch = lengthened.stretches(model, x)
    tips = state.tips(model, x) * [model.bend_sign, 1]
    joints = np.concatenate([[[0.0, 0.0]], [stretch[0] * model.first_joint], tips[:-1]])
    angle = np.concatenate([[model.base_angle], x[: model.n]])
    d = points[:, None] - joints
    along = -np.sin(angle) * d[..., 0] + np.cos(angle) * d[..., 1]
    across = -np.cos(angle) * d[..., 0] - np.sin(angle) * d[..., 1]
    return along / stretch, across


def posed(model: Model, carrier: Array, chosen: list[Station], seen: Array, found: dict[Any, Array]) -> Array:
    """Joint angles (n,) that bring the points `chosen` closest to the places `seen` (S, 2), m.

    Gauss-Newton in absolute angles. Where the points leave a joint open, it turns least: a pull towards the unloaded
    shape, a millionth of a point's, decides. Lengths and places alone decide the pose: it is kept in `found`, for
    models that differ in what moves them.
    """
    points = tuple((p.link, p.along, p.across) for p in chosen)
    base = (model.base_length, model.base_angle, model.bend_sign, points)
    key = (*base, *(a.tobytes() for a in (model.link_length, model.rest_angle, seen)))
    if key not in found:
        found[key] = sought(model, carrier, chosen, seen)
    return found[key].copy()


def sought(model: Model, carrier: Array, chosen: list[Station], seen: Array) -> Array:
    """As `posed`."""
    there = fixed_length(model).with_(stations=tuple(chosen))
    links = np.arange(model.n)
    along = np.where(links < carrier[:, None], model.link_length, 0.0)
    along = np.where(links == carrier[:, None], [[p.along] for p in chosen], along)
    across = np.where(links == carrier[:, None], [[p.across] for p in chosen], 0.0)
    pull = LEAST_PULL * model.length * (np.eye(model.n) - np.eye(model.n, k=-1))
    unloaded = state.absolute(model, np.zeros(model.n))
    phi = unloaded.copy()
    for _ in range(POSE_STEPS):
        c, s = np.cos(phi), np.sin(phi)
        slope = np.stack([model.bend_sign * (across * s - along * c), -along * s - across * c], axis=1)
        off = (seen - state.stations(there, phi)[0]).ravel()
        rows, aim = np.concatenate([slope.reshape(-1, model.n), pull]), np.concatenate([off, pull @ (unloaded - phi)])
        move = np.linalg.lstsq(rows, aim)[0]
        phi += move * min(1.0, 0.5 / max(float(np.abs(move).max()), 1e-300))
        if np.abs(move).max() < 1e-13:
            break
    return state.joint_angles(model, phi)
