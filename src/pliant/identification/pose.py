"""Where observed points lie beside the links, and the pose that their positions show of a body that is held."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pliant.mechanics import mechanics_of
from pliant.model import Model, Station, fixed_length

Array = np.ndarray
LEAST_PULL = 1e-6  # of a held pose towards the unloaded shape, in pulls of a measured point
POSE_STEPS = 60


class PoseChain(NamedTuple):
    """What the places of the links follow from: floats, or complex numbers that carry a derivative."""

    x: Any  # (n + S,) absolute angles, rad, strains behind them
    length: Any  # (n,) m
    base_length: Any  # m
    base_angle: Any  # rad
    share: Any  # (n + 1, S) part of each link that lies in each segment that lengthens


def link_coordinates(chain: PoseChain, points: Array) -> tuple[Array, Array]:
    """Coordinates along and across (P, n + 1) each link of points (P, 2) [m], `bend_sign` undone, the base first.

    Coordinates along a link are those of the link unstretched.
    """
    n = len(chain.length)
    angle = np.append(chain.base_angle, chain.x[:n])
    stretch = 1.0 + chain.share @ chain.x[n:]
    c, s = np.cos(angle), np.sin(angle)
    tips = np.cumsum(np.append(chain.base_length, chain.length) * stretch * [-s, c], axis=1)
    dx, dy = (points.T[:, :, None] - np.column_stack([np.zeros(2), tips[:, :-1]])[:, None])
    return (c * dy - s * dx) / stretch, -c * dx - s * dy


def beside_links(model: Model, x: Array, points: Array) -> tuple[Array, Array]:
    """Coordinates along and across (P, n + 1) the links of a model, at absolute angles and strains x (n + S,)."""
    chain = PoseChain(x, model.link_length, model.base_length, model.base_angle, model.stretch_share)
    return link_coordinates(chain, points)


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
    unloaded = mechanics_of(model).coordinates(np.zeros(model.n))
    phi = unloaded.copy()
    for _ in range(POSE_STEPS):
        c, s = np.cos(phi), np.sin(phi)
        slope = np.stack([model.bend_sign * (across * s - along * c), -along * s - across * c], axis=1)
        off = (seen - mechanics_of(there).stations(phi)[0]).ravel()
        rows, aim = np.concatenate([slope.reshape(-1, model.n), pull]), np.concatenate([off, pull @ (unloaded - phi)])
        move = np.linalg.lstsq(rows, aim)[0]
        phi += move * min(1.0, 0.5 / max(float(np.abs(move).max()), 1e-300))
        if np.abs(move).max() < 1e-13:
            break
    return mechanics_of(model).joint_angles(phi)
