"""Model discrepancy: a standard deviation that grows away from the pressures and speeds of training recordings.

Models that follow all training levels equally well differ between and beyond these levels in how they curve. They agree
on the straight line through the nearest training levels. The deviation of a model from that line is therefore taken to
be uncertain by a fraction of itself. The same holds for the part of a motion that is faster than any training motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from pliant.errors import SimulationError
from pliant.identification.observation import modelled_rows, points_at
from pliant.identification.parameters import apply, for_record
from pliant.identification.prediction import compared_of
from pliant.mechanics import mechanics_of
from pliant.simulation import equilibrium, modes

if TYPE_CHECKING:
    from pliant.identification.experiment import Experiment
    from pliant.model import Model

Array = np.ndarray
INSIDE = 0.3  # relative standard deviation of the deviation from the line between two training levels
BEYOND = 1.0  # the same beyond all levels; both set on the virtual actuators a, b and c, see docs/judging_a_fit.md
FASTER = 0.5  # the same for the part of a motion faster than any training motion
LEVELS = 20  # of the highest pressure: how finely levels are distinguished
GRID = 40  # pressures at which rest is found


def discrepancy(
    model: Model, exp: Experiment, values: Mapping[str, float], modelled: Array, pressure: Array,
    training: Sequence[Experiment],
) -> Array:
    """Return the standard deviation (T, S, 2) [m] of the model's error that is due to pressures and speeds which no
    training recording covers, at T times and S stations.

    The shape is (T, S, 1) [rad] for a recording of angles only. The result is zero for a pressure and a speed that
    occurred in training. For a body with several chambers, speed alone counts.

    Parameters
    ----------
    model : Model
    exp : Experiment
        The recording that is predicted.
    values : mapping
        All parameters by name, including those of `exp`.
    modelled : array (T, S, 2 or 1)
        Predicted positions, m, or angles, rad.
    pressure : array (T, C)
        Pressures behind the valves, Pa.
    training : sequence of Experiment
        The experiments to which the model was fitted.
    """
    m = apply(model, {**for_record(values, exp.name), **exp.known})
    lacking, still = np.zeros_like(modelled), modelled[:1]
    levels = training_levels(m, training)
    if m.actuation.count == 1 and exp.excitation != "release" and len(levels) > 1:
        course = pressure[:, 0]
        grid = np.linspace(min(course.min(), 0.0), max(course.max(), 0.0), GRID)
        rests, straight = rest_places(m, exp, grid, levels)
        share = np.where((grid > levels[-1]) | (grid < 0), BEYOND, INSIDE)[: len(rests), None, None]
        lacking = between(course, grid, share * np.abs(rests - straight))
        still = between(course, grid, rests)
    return np.hypot(lacking, FASTER * faster(exp, modelled, training) * np.abs(modelled - still))


def between(pressure: Array, grid: Array, rows: Array) -> Array:
    """Return positions (T, S, 2) of S stations at the T values of `pressure`, interpolated between the positions `rows`
    (G, S, 2) at the first G pressures of `grid`.
    """
    columns = [np.interp(pressure, grid[: len(rows)], column) for column in rows.reshape(len(rows), -1).T]
    return np.stack(columns, axis=-1).reshape(pressure.size, *rows.shape[1:])


def training_levels(model: Model, training: Sequence[Experiment]) -> Array:
    """Return the L pressures (L,) [Pa], in rising order, at which training recordings are taken to show the body at
    rest: 0, nominal pressures of pulses and steps, and measured pressures kept for at least one period of the first
    mode in total.
    """
    period = 1.0 / float(modes(model)[0][0])
    highest = max((e.peak for e in training), default=0.0)
    levels = {0.0}
    for e in training if highest > 0 else ():
        if e.pressure is None:
            levels |= {e.level} if e.nominal else set()
            continue
        time = np.arange(e.time[0], e.time[-1], 0.1 * period)
        p = e.pressure(time)
        where = np.round(p / highest * LEVELS)
        for k in np.unique(where):
            if (where == k).sum() >= 10:
                levels.add(float(np.median(p[where == k])) if k else 0.0)
    return np.array(sorted(levels))


def rest_places(model: Model, exp: Experiment, grid: Array, levels: Array) -> tuple[Array, Array]:
    """Return two arrays of equilibrium positions (G, S, d) [m] of S stations at the first G pressures of `grid`, in d
    dimensions: exact ones, and ones interpolated between the equilibria at the pressures `levels`. For a recording of
    angles only they hold angles (G, S, 1) [rad].

    Joint angles and strains are interpolated, or extrapolated, from the two nearest training `levels`. Both arrays end
    at the first pressure without an equilibrium.
    """
    angles: list[Array] = []
    known = [equilibrium(model, float(p)) for p in levels]
    for p in grid:
        try:
            angles.append(equilibrium(model, float(p)))
        except SimulationError:
            break
    lines = []
    for p in grid[: len(angles)]:
        k = int(np.clip(np.searchsorted(levels, p), 1, len(levels) - 1))
        share = (p - levels[k - 1]) / (levels[k] - levels[k - 1])
        lines.append(known[k - 1] + share * (known[k] - known[k - 1]))
    points = {p.name: p for p in model.points}
    observed_model = model.with_(stations=tuple(points[name] for name in exp.stations))

    def places(q: list[Array]) -> Array:
        chain = mechanics_of(observed_model)
        base = model.base_angle if exp.angle_reference in ("base", "joint") else 0.0
        rows = np.array([points_at(chain, chain.coordinates(one)) for one in q])
        if exp.dimension == 2:
            rows[..., 2] -= base
        if exp.alone not in exp.further:
            return compared_of(exp, rows)
        recorded = exp.further[exp.alone]
        values = modelled_rows(rows, exp.alone, recorded.constants, planar=exp.dimension == 2)[..., : len(exp.axes)]
        return values - values[:1] if recorded.reference == "rest" else values

    return places(angles), places(lines)


def faster(exp: Experiment, modelled: Array, training: Sequence[Experiment]) -> Array:
    """Return the part of the tip's speed above the highest speed in training, as a fraction of the speed; 0 below it.
    The shape is (T, 1, 1) for T times.
    """
    training_speeds = (speed(e.time, e.last_station, settled=e.poses) for e in training)
    limit = max((float(np.nanmax(s)) for s in training_speeds), default=np.inf)
    model_speed = speed(exp.time, modelled[:, -1], settled=exp.poses)
    return np.where(model_speed > limit, 1.0 - limit / np.maximum(model_speed, 1e-300), 0.0)[:, None, None]


def speed(time: Array, path: Array, *, settled: bool = False) -> Array:
    """Return the speed (T,) [m/s; angles: rad/s] of a point from its positions `path` (T, d) at T times, with d
    coordinates each; 0 for settled poses.
    """
    if settled:
        return np.zeros(len(path))
    return np.asarray(np.linalg.norm(np.gradient(path, time, axis=0), axis=1))
