"""Known forces at points of the body, as of a thread that pulls: what they do to the links of a chain."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pliant.errors import InputError
from pliant.mechanics import mechanics_of
from pliant.model import Model, Station

Array = np.ndarray


class PointForce(NamedTuple):
    """A known force at a point that is fixed to the body.

    Straight lines between the times, the first and the last force before and after them; two equal times make a jump.
    """

    time: Array  # (F,) s, on the clock of the pressure
    force: Array  # (F, 2), in space (F, 3), N, in the base frame
    at: str | Station  # a point of the model by its name, or a place of its own


def checked(whose: str, force: PointForce, dimension: int = 2) -> PointForce:
    """The force with arrays of its own; InputError, with whose force it is, where it makes no sense."""
    time, value = np.array(force.time, dtype=float), np.array(force.force, dtype=float)
    if time.ndim != 1 or time.size == 0 or value.shape != (time.size, dimension):
        axes = ", ".join(("fx", "fy", "fz")[:dimension])
        raise InputError(f"{whose}: a known force is [{axes}] for each of its times, got {value.shape}, {time.shape}")
    if not (np.isfinite(time).all() and np.isfinite(value).all()) or np.any(np.diff(time) < 0):
        raise InputError(f"{whose}: a known force is finite, at times that do not decrease, s and N")
    return force._replace(time=time, force=value)


def station_of(model: Model, force: PointForce) -> Station:
    """The place of a force on the chain."""
    if isinstance(force.at, Station):
        place = force.at
    else:
        points = {p.name: p for p in model.points}
        if force.at not in points:
            raise InputError(f"a known force pulls at {force.at!r}, but the model's points are {', '.join(points)}")
        place = points[force.at]
    if not 0 <= place.link < model.n:
        raise InputError(f"a known force pulls at link {place.link + 1}: the model has links 1 to {model.n}")
    return place


def link_loads(model: Model, forces: Sequence[PointForce], values: Array) -> Array:
    """Loads (T, ...) of the links under the forces of `values` (T, F, d) [N], N m; see `Mechanics.link_loads`."""
    return mechanics_of(model).link_loads([station_of(model, force) for force in forces], values)


def at_time(force: PointForce, time: Array) -> Array:
    """The force (..., d) at some times (...), N."""
    return np.stack([np.interp(time, force.time, column) for column in force.force.T], axis=-1)


def loads_at(model: Model, forces: Sequence[PointForce], time: float) -> Array:
    """Loads of the links at one time, N m, as kernels take them."""
    if not forces:
        return mechanics_of(model).no_loads()
    values = np.array([[at_time(force, np.array(time)) for force in forces]])
    return np.asarray(link_loads(model, forces, values)[0])


def mean_loads(model: Model, forces: Sequence[PointForce], nodes: Array) -> Array:
    """Same as `link_loads`, the mean over each interval of `nodes` (m + 1,) [s], N m."""
    impulse = [integral(force, nodes) for force in forces]
    means = [np.diff(rows, axis=0) / np.diff(nodes)[:, None] for rows in impulse]
    return link_loads(model, forces, np.stack(means, axis=1))


def integral(force: PointForce, time: Array) -> Array:
    """Integral (T, d) of the force from its first time on, N s; exact, also beyond its last time."""
    knots, value = force.time, force.force
    area = 0.5 * (value[1:] + value[:-1]) * np.diff(knots)[:, None]
    total = np.concatenate([0.0 * value[:1], np.cumsum(area, axis=0)])
    k = np.clip(np.searchsorted(knots, time, side="right") - 1, 0, knots.size - 1)
    return np.asarray(total[k] + 0.5 * (value[k] + at_time(force, time)) * (time - knots[k])[:, None])
