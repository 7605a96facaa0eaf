"""Arrays that the compiled loops of estimation work in and write to, owned by the caller."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pliant.equations.symbols import Held, Joints, Workspace
from pliant.model import Model
from pliant.simulation import state

Array = np.ndarray


class Scratch(NamedTuple):
    """Scratch arrays of one prediction or update: n links, N states, m rows of the measurement."""

    work: Workspace
    held: Held
    springs: Joints  # those that a step sees, their rest moved by the disturbance
    J: Array  # (3n, 2n)
    W: Array  # (N, N)
    phi: Array  # (n,)
    w: Array  # (n,)
    G: Array  # (2n,)
    gain: Array  # (N,)
    change: Array  # (N,)
    seen: Array  # (m,)
    H: Array  # (m, n)


class Output(NamedTuple):
    """What `kalman_loops.filter_record` writes, frame by frame."""

    predicted: Array  # (T, N)
    predicted_covariance: Array  # (T, N, N)
    estimate: Array  # (T, N)
    covariance: Array  # (T, N, N)
    transition: Array  # (T, N, N), from the estimate of the frame before
    innovation: Array  # (T, m), whitened; not a number where a row was missing
    score: Array  # (T, 4): rows used, normalised innovation squared, log determinant of its covariance, motion


def make_scratch(model: Model, states: int, rows: int) -> Scratch:
    """Scratch arrays for a model, so many states and rows."""
    n, joints = model.n, model.joints()
    springs = joints._replace(theta0=joints.theta0.copy(), K=joints.K.copy())  # writable, like those of `held`
    shapes = [
        (3 * n, 2 * n), (states, states), (n,), (n,), (2 * n,), (states,), (states,), (rows,), (rows, n),
    ]
    return Scratch(state.workspace(n), state.held(model), springs, *(np.zeros(shape) for shape in shapes))


def make_output(frames: int, states: int, rows: int) -> Output:
    """Room for so many frames."""
    N = states
    shapes = [(N,), (N, N), (N,), (N, N), (N, N), (rows,), (4,)]
    return Output(*(np.zeros((frames, *shape)) for shape in shapes))
