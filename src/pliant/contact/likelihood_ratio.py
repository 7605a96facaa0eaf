"""Detection of a force that begins suddenly, by the likelihood ratio of a torque step in the filter's innovations.

The innovations are white with unit variance as long as the model holds. After a step of the torques by J f, with f a
force at a point of the body and J its moment arms, their mean is R_j J f at j frames after the onset. The test
statistic is the largest (sum y)^2 / sum |R_j J|^2 over recent onsets and all positions along the body.

The filter takes a while to follow a step of the torques. After the release of a force, which is a step too, the
statistic therefore stays above its threshold longer than the force lasts. How it fades is tabulated with R, for each
body and noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pliant.compiler.choose import twin
from pliant.contact.locate import moment_arms
from pliant.equations.observation import observe_rows
from pliant.estimation import kalman_loops
from pliant.estimation.measurement import Measurement
from pliant.estimation.noise import Noise
from pliant.estimation.offline import chain_of, frame_of
from pliant.estimation.symbols import FilterNoise, FilterState, Prediction, make_workspace
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.simulation import state

Array = np.ndarray
WINDOWS = (0.027, 0.04, 0.053, 0.067, 0.08, 0.107, 0.133, 0.173)  # s since the onset
MOTIONS = (0.0, 0.05, 0.25, 1.2, 6.0, 20.0)  # rad^2/s^2, mean square joint rates of the tabulated responses
SETTLED = 2.7  # s after which the filter's covariance is stationary, and the response to a step has faded
PLACES = (0.25, 0.75)  # positions on each link but the first, which hardly responds to a force


@dataclass(frozen=True)
class InnovationResponse:
    """Response of the state filter's whitened innovations to a step of the joint torques, tabulated by speed of motion.

    Attributes
    ----------
    motion : (B,) array
        Mean square joint rates [rad^2/s^2] of the B cases.
    response : (B, W, m, n) array
        Response of row m, at w frames after a unit step of torque n, 1/(N m); n + S torques for an extensible body.
    period : float
        Time between two frames, s.
    fade : (L,) array
        Largest fraction of its peak that the statistic of a step of force still has, 0, 1, ... frames after the peak
        or later, at rest. The filter follows faster in motion.
    """

    motion: Array
    response: Array
    period: float
    fade: Array

    @property
    def windows(self) -> list[int]:
        """Return the times since the onset of a force that the test tries, as numbers of frames."""
        return windows_of(self.period)

    def case(self, motion: Array) -> Array:
        """Return for each of T frames the index (T,) of the tabulated response for the mean square joint rate that is
        closest to `motion` (T,) [rad^2/s^2].
        """
        edges = np.sqrt(np.maximum(self.motion[1:], 1e-3) * np.maximum(self.motion[:-1], 1e-2))
        return np.searchsorted(edges, motion)

    def echo(self, statistic: Array) -> Array:
        """Return how much at most is left in the next L - 1 frames (L - 1,) of the steps of force that the statistic
        (T,) has shown in T frames.
        """
        newest = statistic[: -len(self.fade) : -1]
        return np.array([np.max(newest[: len(self.fade) - j] * self.fade[j : j + len(newest)])
                         for j in range(1, len(self.fade))])  # fmt: skip


def frames_of(seconds: float, period: float) -> int:
    """Convert a time in seconds to a number of frames, at least one."""
    return max(1, round(seconds / period))


def windows_of(period: float) -> list[int]:
    """Return the times since the onset of a force that the test tries (`WINDOWS`), as increasing numbers of frames
    without duplicates.
    """
    return sorted({frames_of(w, period) for w in WINDOWS})


def innovation_response(
    model: Model, noise: Noise, measurement: Measurement, *, time_step: float,
) -> InnovationResponse:
    """Return the response of the filter's innovations to a step of the joint torques, for each mean square joint rate
    in `MOTIONS`. The body is linearised at rest: only the filter's assumed noise depends on the joint rate.
    """
    grown = [noise.random_walk * float(np.sqrt(1.0 + noise.motion_growth * a)) for a in MOTIONS]
    cases = [replace(noise, random_walk=walk, motion_growth=0.0) for walk in grown]
    period = float(np.median(np.diff(measurement.time)))
    longest, whole = windows_of(period)[-1], frames_of(SETTLED, period)
    steps = max(1, int(np.ceil(period / time_step)))
    responses = [
        response_of(model, motion, measurement, period, steps, longest if k else whole)
        for k, motion in enumerate(cases)
    ]
    known = InnovationResponse(np.array(MOTIONS), np.stack([r[:longest] for r in responses]), period, np.ones(1))
    return replace(known, fade=fading(known, model, responses[0]))


def fading(answer: InnovationResponse, model: Model, response: Array) -> Array:
    """Return the attribute `fade` (L,) of an innovation response, from the innovations `response` (L, m, n) in the L
    frames after a unit step of each torque, at rest. Forces at all positions of the test are tried, across the body; in
    space along both axes of the link.
    """
    frames, x = len(response), mechanics_of(model).coordinates(state.equilibrium(model))
    fade = np.zeros(frames)
    for push in moment_arms(model, x[None], *places_of(model))[0, :, :-1].reshape(-1, model.size):
        ratio, _ = likelihood_ratio(answer, model, response @ push, np.zeros(frames), np.tile(x, (frames, 1)))
        peak = int(np.argmax(ratio))
        later = np.maximum.accumulate(ratio[: peak - 1 if peak else None : -1] / ratio[peak])[::-1]
        fade[: later.size] = np.maximum(fade[: later.size], later)
    return fade


def response_of(model: Model, noise: Noise, measurement: Measurement, period: float, steps: int, frames: int) -> Array:
    """Return the response (W, m, n) of the m whitened innovations of the filter to a unit step of each of n joint
    torques, in the W = `frames` frames after the step.
    """
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
    predicted, slopes = np.empty(len(rows)), np.empty((len(rows), n))
    filter_frame = frame_of(model, rows, predicted, measurement.variance)

    def frame(own: FilterState, true: Array) -> Array:
        predict(own, chain, still, workspace)
        observe(true, filter_frame, workspace.sight, predicted, slopes)
        update(own, chain, filter_frame, workspace)
        return filter_frame.innovation

    for _ in range(frames_of(SETTLED, period)):
        frame(start, start.angle.copy())
    response = np.zeros((frames, len(rows), n))
    push = 1e-4 * float(np.mean(model.stiffness))
    for i in range(n):
        true, own = (FilterState(*(a.copy() for a in start)) for _ in range(2))
        true.disturbance[i] += push
        for j in range(frames):
            predict(true, chain, still, workspace)
            response[j, :, i] = frame(own, true.angle) / push
    return response


def likelihood_ratio(
    answer: InnovationResponse, model: Model, innovation: Array, motion: Array, angle: Array
) -> tuple[Array, Array]:
    """Return for each of T frames the test statistic (T,) of a force that began recently and acts perpendicular to the
    body, and the most likely time (T,) since its onset, in frames.

    Without a force, the statistic for one position and onset is chi-square with one degree of freedom (in space, two).
    Forces along an extensible body are not tested, since every change of pressure produces them where the model's axial
    stiffness is wrong.

    Parameters
    ----------
    innovation : array (T, m)
        Whitened innovations of unit variance; NaN counts as 0.
    motion : array (T,)
        Recent mean square joint rates, rad^2/s^2.
    angle : array (T, n)
        Absolute link angles, rad, followed by the strains of extensible segments.
    """
    e, case = np.nan_to_num(innovation), answer.case(motion)
    J = moment_arms(model, angle, *places_of(model))[:, :, :-1]
    best, since = np.zeros(len(e)), np.zeros(len(e), dtype=int)
    for b in np.unique(case):
        R, in_case = answer.response[b], case == b
        for w in answer.windows:
            y = sum(shifted(e, w - 1 - j) @ R[j] for j in range(w))
            information = sum(R[j].T @ R[j] for j in range(w))
            push = np.einsum("tadn,tn->tad", J[in_case], np.asarray(y)[in_case])
            size = np.einsum("tadn,nm,tacm->tadc", J[in_case], information, J[in_case])
            ratio = np.zeros(len(e))
            ratio[in_case] = np.sum(push * np.linalg.solve(size, push[..., None])[..., 0], axis=-1).max(axis=1)
            since[ratio > best] = w
            best = np.maximum(best, ratio)
    return best, since


def places_of(model: Model) -> tuple[Array, Array]:
    """Return the points of the body at which the test tries a force: link index (P,) and distance from the link's joint
    (P,) [m].
    """
    link, share = (a.ravel() for a in np.meshgrid(np.arange(min(1, model.n - 1), model.n), PLACES, indexing="ij"))
    return link, share * model.link_length[link]


def shifted(e: Array, frames: int) -> Array:
    """Return m innovations e (T, m) over T frames, delayed by `frames` frames. Zeros precede the first."""
    return np.concatenate([np.zeros((frames, e.shape[1])), e[: len(e) - frames]])
