"""Known forces at points of the body, such as the pull of a thread, and the loads on the links that they cause."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pliant.errors import InputError
from pliant.mechanics import mechanics_of
from pliant.model import Model, Station

Array = np.ndarray


class PointForce(NamedTuple):
    """A known force at a point fixed to the body, given as a function of time.

    The force is linear between the given times, and constant before the first and after the last. Two equal times make
    a jump.
    """

    time: Array  # (F,) s, on the clock of the pressure
    force: Array  # (F, 2), in space (F, 3), N, in the base frame
    at: str | Station  # name of an observed point of the model, or another point


def checked(whose: str, force: PointForce, dimension: int = 2) -> PointForce:
    """Return the force with copies of its arrays; raise InputError if it is invalid. `whose` begins the message."""
    time, value = np.array(force.time, dtype=float), np.array(force.force, dtype=float)
    if time.ndim != 1 or time.size == 0 or value.shape != (time.size, dimension):
        axes = ", ".join(("fx", "fy", "fz")[:dimension])
        raise InputError(
            f"{whose}: a known force needs one row [{axes}] for each time, got shapes {value.shape} and {time.shape}"
        )
    if not (np.isfinite(time).all() and np.isfinite(value).all()):
        raise InputError(f"{whose}: a known force and its times must be finite: remove or correct the other values")
    if np.any(np.diff(time) < 0):
        raise InputError(f"{whose}: the times of a known force must not decrease: sort its rows by time")
    return force._replace(time=time, force=value)


def station_of(model: Model, force: PointForce) -> Station:
    """Return the point of the chain at which a known force acts, as a `Station`."""
    if isinstance(force.at, Station):
        point = force.at
    else:
        points = {p.name: p for p in model.points}
        if force.at not in points:
            raise InputError(
                f"a known force acts at {force.at!r}, but the model's points are {', '.join(points)}: use one of these"
            )
        point = points[force.at]
    if not 0 <= point.link < model.n:
        raise InputError(
            f"a known force acts on link {point.link + 1}, but the model has links 1 to {model.n}: use one of these"
        )
    return point


def link_loads(model: Model, forces: Sequence[PointForce], values: Array) -> Array:
    """Return the loads [N m] of F known forces on the links at T instants. `values` (T, F, d) [N] are the d components
    of the forces. The first axis of the result has length T.
    """
    return mechanics_of(model).link_loads([station_of(model, force) for force in forces], values)


def at_time(force: PointForce, time: Array) -> Array:
    """Return the components [N] of a known force at `time` [s], an array of any shape. The result has one more axis,
    the last, for the components.
    """
    return np.stack([np.interp(time, force.time, column) for column in force.force.T], axis=-1)


def loads_at(model: Model, forces: Sequence[PointForce], time: float) -> Array:
    """Return the loads [N m] of known forces on the links at one time [s], in the form that the compiled loops take."""
    if not forces:
        return mechanics_of(model).no_loads()
    values = np.array([[at_time(force, np.array(time)) for force in forces]])
    return np.asarray(link_loads(model, forces, values)[0])


def mean_loads(model: Model, forces: Sequence[PointForce], nodes: Array) -> Array:
    """Return the mean loads [N m] of known forces on the links over each of the m intervals of `nodes` (m + 1,) [s]."""
    impulse = [integral(force, nodes) for force in forces]
    means = [np.diff(rows, axis=0) / np.diff(nodes)[:, None] for rows in impulse]
    return link_loads(model, forces, np.stack(means, axis=1))


def integral(force: PointForce, time: Array) -> Array:
    """Return the time integral (T, d) [N s] of the d components of a known force, from its first time to each of the T
    instants `time` [s].
    """
    knots, value = force.time, force.force
    area = 0.5 * (value[1:] + value[:-1]) * np.diff(knots)[:, None]
    total = np.concatenate([0.0 * value[:1], np.cumsum(area, axis=0)])
    k = np.clip(np.searchsorted(knots, time, side="right") - 1, 0, knots.size - 1)
    return np.asarray(total[k] + 0.5 * (value[k] + at_time(force, time)) * (time - knots[k])[:, None])
