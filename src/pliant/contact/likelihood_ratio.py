"""A force that sets in: generalised likelihood ratio of a step of the joint torques, on the filter's innovations.

White innovations of unit variance, as long as the model holds; after a step of the torques by J f, f being a force at a
point of the body and J its moment arms, they carry R_j J f, j frames after the onset. Over all onsets of late and all
places along the body the largest (sum y)^2 / sum |R_j J|^2 is the test: the best that a frame after an onset can know.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pliant.compiler.choose import twin
from pliant.contact.moment_arms import moment_arms
from pliant.equations.observation import observe_rows
from pliant.estimation import kalman_loops
from pliant.estimation.measurement import Measurement
from pliant.estimation.noise import Noise
from pliant.estimation.offline import chain_of, frame_of
from pliant.estimation.symbols import FilterNoise, FilterState, Prediction
from pliant.estimation.workspace import make_workspace
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.simulation import state

Array = np.ndarray
WINDOWS = (0.027, 0.04, 0.053, 0.067, 0.08, 0.107, 0.133, 0.173)  # s since the onset
MOTIONS = (0.0, 0.05, 0.25, 1.2, 6.0, 20.0)  # rad^2/s^2 for which the filter's answer is worked out
SETTLED = 2.7  # s after which its covariance stands still
PLACES = (0.25, 0.75)  # of each link but the first, which hardly shows a force


@dataclass(frozen=True)
class Answer:
    """Response of whitened innovations to a step of the joint torques.

    Attributes
    ----------
    motion : (B,) array
        Mean square joint rates [rad^2/s^2] of the B cases.
    response : (B, W, m, n) array
        1/(N m): of row m, so many frames after a unit step of torque n; n + S of a body that lengthens.
    period : float
        s between two frames.
    """

    motion: Array
    response: Array
    period: float

    @property
    def windows(self) -> list[int]:
        """Frames since the onset that are tried."""
        return windows_of(self.period)

    def case(self, motion: Array) -> Array:
        """The case (T,) nearest to the motion (T,) of each frame, in logarithms."""
        edges = np.sqrt(np.maximum(self.motion[1:], 1e-3) * np.maximum(self.motion[:-1], 1e-2))
        return np.searchsorted(edges, motion)


def frames_of(seconds: float, period: float) -> int:
    """Frames in a time, at least one."""
    return max(1, round(seconds / period))


def windows_of(period: float) -> list[int]:
    """`WINDOWS` in frames, each once."""
    return sorted({frames_of(w, period) for w in WINDOWS})


def answer_of(model: Model, noise: Noise, measurement: Measurement, *, step: float) -> Answer:
    """Answer of the settled filter at rest, for bodies that move little and much."""
    grown = [noise.random_walk * float(np.sqrt(1.0 + noise.motion_growth * a)) for a in MOTIONS]
    cases = [replace(noise, random_walk=walk, motion_growth=0.0) for walk in grown]
    period = float(np.median(np.diff(measurement.time)))
    made = [response_of(model, one, measurement, period, max(1, int(np.ceil(period / step)))) for one in cases]
    return Answer(np.array(MOTIONS), np.stack(made), period)


def response_of(model: Model, noise: Noise, measurement: Measurement, period: float, steps: int) -> Array:
    """Whitened innovations (W, m, n) after a unit step of each torque."""
    n, rows = model.size, measurement.rows
    workspace = make_workspace(model, noise.states(model), len(rows))
    q = state.equilibrium(model)
    start = FilterState(
        mechanics_of(model).coordinates(q), np.zeros(n), np.zeros(n), noise.initial(model), state.relaxed(model, q)
    )
    predict = twin(kalman_loops.predict_span, *mechanics_of(model).sizes)
    update, observe = (twin(kernel, *mechanics_of(model).sizes) for kernel in (kalman_loops.update, observe_rows))
    chain, densities = chain_of(model), FilterNoise(*noise.densities(model), np.zeros(1))
    still = Prediction(steps, period / steps, np.zeros(n), densities)
    seen, slopes = np.empty(len(rows)), np.empty((len(rows), n))
    shown = frame_of(model, rows, seen, measurement.variance)

    def frame(own: FilterState, true: Array) -> Array:
        predict(own, chain, still, workspace)
        observe(true, shown, workspace.links, seen, slopes)
        update(own, chain, shown, workspace)
        return shown.innovation

    for _ in range(frames_of(SETTLED, period)):
        frame(start, start.angle.copy())
    frames = windows_of(period)[-1]
    made = np.zeros((frames, len(rows), n))
    push = 1e-4 * float(np.mean(model.stiffness))
    for i in range(n):
        true, own = (FilterState(*(a.copy() for a in start)) for _ in range(2))
        true.disturbance[i] += push
        for j in range(frames):
            predict(true, chain, still, workspace)
            made[j, :, i] = frame(own, true.angle) / push
    return made


def likelihood_ratio(
    answer: Answer, model: Model, innovation: Array, motion: Array, angle: Array
) -> tuple[Array, Array]:
    """Statistic (T,) of a force across the body that set in within the last frames, and how many frames ago (T,).

    A body that lengthens shows forces along it too, but so does every change of pressure where the model errs in the
    axial stiffness: they raise no alarm. For one place and onset it is a chi-square number of one degree of freedom, of
    two in space, where no force set in.

    Parameters
    ----------
    innovation : array (T, m)
        Whitened, of unit variance; rows that are not numbers count as 0.
    motion : array (T,)
        Mean square joint rates of late, rad^2/s^2.
    angle : array (T, n)
        Absolute link angles, rad; strains behind them where segments lengthen.
    """
    e, case = np.nan_to_num(innovation), answer.case(motion)
    link, share = (a.ravel() for a in np.meshgrid(np.arange(min(1, model.n - 1), model.n), PLACES, indexing="ij"))
    J = moment_arms(model, angle, link, share * model.link_length[link])[:, :, :-1]
    best, since = np.zeros(len(e)), np.zeros(len(e), dtype=int)
    for b in np.unique(case):
        R, at = answer.response[b], case == b
        for w in answer.windows:
            y = sum(shifted(e, w - 1 - j) @ R[j] for j in range(w))
            information = sum(R[j].T @ R[j] for j in range(w))
            push = np.einsum("tadn,tn->tad", J[at], np.asarray(y)[at])
            size = np.einsum("tadn,nm,tacm->tadc", J[at], information, J[at])
            ratio = np.zeros(len(e))
            ratio[at] = np.sum(push * np.linalg.solve(size, push[..., None])[..., 0], axis=-1).max(axis=1)
            since[ratio > best] = w
            best = np.maximum(best, ratio)
    return best, since


def shifted(e: Array, frames: int) -> Array:
    """Rows of `frames` ago; none before the first."""
    return np.concatenate([np.zeros((frames, e.shape[1])), e[: len(e) - frames]])
