"""Prediction of a recording by a model: positions, angles, and the values that a fit compares."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from pliant.identification.experiment import Experiment, FurtherRows
from pliant.identification.following import observed_rows
from pliant.identification.forward_model import forward_problem
from pliant.identification.observation import modelled_rows, slopes_through
from pliant.identification.parameters import apply
from pliant.model import Model
from pliant.shapes import Float
from pliant.simulation.time_step import rings, shared_step

LONGEST = 2e-3  # s
LONGEST_OVER_DAMPED = 1e-2  # s
LONGEST_SLOW = 5e-2  # s
STEPS_A_FRAME = 4
SLOW = 0.1  # s between frames
Array = np.ndarray


def fit_step(model: Model, values: Mapping[str, float], experiments: Sequence[Experiment] = ()) -> float:
    """Return the longest time step [s] that resolves the modes of a model with the parameter `values` (SI): at most 2
    ms or, if no mode that noticeably moves the tip rings, 10 ms; in that case a quarter of the time between frames and
    at most 50 ms, if the frames of all `experiments` are 0.1 s apart or more (the median of their times). Parameters
    that no model has, such as those of a recording, have no effect.
    """
    applied = apply(model, values)
    apart = [float(np.median(np.diff(e.time))) for e in experiments if e.time.size > 1] or [0.0]
    slow = min(np.median(apart) / STEPS_A_FRAME, LONGEST_SLOW) if min(apart) >= SLOW else LONGEST_OVER_DAMPED
    return shared_step([applied], LONGEST if rings(applied) else slow)


def predict(
    model: Model, exp: Experiment, values: Mapping[str, float], time_step: float | None = None,
) -> dict[str, Any]:
    """Predict the motion of S stations in an experiment by a model: positions (T, S, d) [m] in T frames and d
    dimensions, angles (T, S) [rad], and the pressures (T, C) [Pa] of C chambers.

    Returns a dictionary with the keys "position", "angle", "pressure", "compared" (the predicted values that a fit
    compares) and "model". `values` holds parameter values by name; ``exp.name.parameter`` takes precedence over a
    shared one. `time_step` is in s; default: the longest one, at most 2 ms (10 ms if none rings), that resolves the
    modes of the model.
    """
    forward = forward_problem(model, exp, values, time_step or fit_step(model, values, [exp]))
    rows = observed_rows(forward, forward.numbers, exp.time.size)
    shown = rows[:, : len(exp.stations)]
    return {
        "position": shown[..., : exp.dimension], "angle": referenced_angles(exp, shown),
        "compared": compared_of(exp, rows), "pressure": forward.pressure, "model": forward.model,
    }


def predict_body(
    model: Model, exp: Experiment, values: Mapping[str, float], time_step: float,
) -> Float[Array, "T n+2 d"]:
    """Predict the positions (T, n + 2, d) [m] of base, first joint and n link tips of a chain in an experiment, in T
    frames and d dimensions.
    """
    forward = forward_problem(model, exp, values, time_step)
    along = np.concatenate([[0.0, forward.model.base_length], forward.model.link_length])
    carrier = np.concatenate([[-1, -1], np.arange(forward.model.n)])
    links_problem = forward._replace(carrier=carrier)
    zeros = 0.0 * along
    no_lag = np.zeros(0)  # no sensor observes these points
    numbers = forward.numbers._replace(along=along, across=zeros, aside=zeros, sensor_lag=no_lag)
    return observed_rows(links_problem, numbers, exp.time.size)[..., : exp.dimension]


def compared_of(
    exp: Experiment, rows: Array, about: Array | None = None, recorded: FurtherRows | None = None,
) -> Array:
    """Return the predicted values of `Experiment.compared`, from coordinates `rows` (..., T, S or more, 3) of S
    stations in T frames, and of auxiliary points behind them: positions (..., T, S, d) in d dimensions, or, in a
    recording without positions, its angles (..., T, S, 1) or its values of a further variable (..., T, S, d).

    With `about` (T, S or more, 3), `rows` are derivatives of these coordinates, and those of the values are returned.
    `recorded` stands for the recording's own values of the further variable where the frames are others.
    """
    shown = rows[..., : len(exp.stations), :]
    if exp.alone not in exp.further:
        return referenced_angles(exp, shown)[..., None] if exp.alone else shown[..., : exp.dimension]
    of = partial(further_rows, name=exp.alone, recorded=recorded or exp.further[exp.alone],
                 planar=exp.dimension == 2)  # fmt: skip
    values = of(rows) if about is None else slopes_through(of, about, rows)
    return np.asarray(values[..., : len(exp.axes)])


def further_rows(rows: Array, name: str, recorded: FurtherRows, *, planar: bool) -> Array:
    """Return the predicted values (..., T, S, 3) of a further variable of a recording, followed by NaN, from the
    reference of the recorded ones; see `observation.modelled_rows`.
    """
    return recorded.referenced(modelled_rows(rows, name, recorded.constants, planar=planar))


def referenced_angles(exp: Experiment, rows: Array) -> Array:
    """Return the predicted angles (..., T, S) [rad] of S stations in T frames, measured from the same reference as the
    recorded ones. They are the third coordinate of `rows` (..., T, S, 3).
    """
    angle = rows[..., 2]
    if exp.angle_reference == "joint":
        return np.diff(angle, axis=-1, prepend=0.0)
    return angle - angle[..., :1, :] if exp.angle_reference == "rest" else angle
