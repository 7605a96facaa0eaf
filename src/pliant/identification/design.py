"""The next recording to make: the excitation that adds most to what the present recordings determine worst."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pliant.errors import InputError, SimulationError
from pliant.identification.experiment import Experiment
from pliant.identification.result import FitResult
from pliant.identification.sensitivity import sensitivities
from pliant.model import Model
from pliant.simulation import Chirp, Pulse, Trace, modes, simulate
from pliant.simulation.inputs import Input

Array = np.ndarray
CRITERIA = ("E", "D")
LEVELS = (0.25, 0.5, 0.75, 1.0)  # of the highest pressure
WIDTHS = (0.1, 0.3, 1.0, 3.0)  # s
BEFORE, AFTER = 0.2, 2.0  # s of rest around an excitation
CHIRP = 6.0  # s


@dataclass(frozen=True)
class Candidate:
    """An excitation to try: in words, as a pressure, and how long to record it, s.

    `chambers` names those of several chambers that the pressure drives; the others rest.
    """

    words: str
    pressure: Input
    duration: float
    level: float
    chambers: tuple[str, ...] = ()


@dataclass(frozen=True)
class Proposal:
    """Expected gain of one more recording.

    Attributes
    ----------
    words : str
    std : dict
        Expected standard error of each parameter after it, in parts of the parameter.
    weakest : float
        Expected standard error along the direction that then shows worst, in parts.
    volume : float
        Geometric mean of the standard errors along all directions, in parts.
    """

    words: str
    std: dict[str, float]
    weakest: float
    volume: float


@dataclass(frozen=True)
class Design:
    """Proposals, the best first, and what is known without them."""

    now: Proposal
    direction: tuple[str, ...]  # parameters of the direction that shows worst now
    proposals: tuple[Proposal, ...]
    refused: tuple[str, ...]  # what could not be simulated

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, for JSON."""
        rows = [{"words": p.words, "weakest": p.weakest, "volume": p.volume, "std": p.std} for p in self.proposals]
        now = {"weakest": self.now.weakest, "volume": self.now.volume, "std": self.now.std}
        return {"now": now, "direction": list(self.direction), "proposals": rows, "refused": list(self.refused)}


def design(
    fitted: FitResult, experiments: Sequence[Experiment], *, highest: float | None = None, criterion: str = "E",
    step: float = 2e-3, candidates: Sequence[Candidate] | None = None,
) -> Design:
    """Which excitation to record next.

    The information of the fit and that of a recording simulated under each candidate add up. Its noise is the size of
    the fit's residuals, and its frames count as often as these are uncorrelated.

    Parameters
    ----------
    fitted : FitResult
    experiments : sequence of Experiment
        Those of the fit: stations, clock and kind of excitation are theirs.
    highest : float, optional
        Pressure that must not be passed, Pa; default: the highest that was recorded.
    criterion : {"E", "D"}
        Shrink the error along the weakest direction, or along all directions together.
    candidates : sequence of Candidate, optional
        Default: pulses of four levels and four widths and, where the pressure is measured, chirps through the first
        mode; of several chambers in each alone, and in all together.

    Raises
    ------
    InputError
        When the fit has no free shared parameter, or the limit of the pressure is missing or passed.
    """
    if criterion not in CRITERIA:
        raise InputError(f"unknown criterion {criterion!r}: use E (weakest direction) or D (all directions)")
    if fitted.covariance is None:
        raise InputError("a design needs a fit with free parameters: this one has no covariance")
    records = {e.name for e in experiments}
    shared = [k for k, n in enumerate(fitted.covariance.names) if n.partition(".")[0] not in records]
    names = [fitted.covariance.names[k] for k in shared]
    if not names:
        raise InputError("a design needs free parameters that recordings share: this fit has none")
    limit = highest if highest is not None else max(highest_of(e) for e in experiments)
    offered = list(candidates) if candidates is not None else standard(fitted.model, experiments[0], limit)
    if not limit > 0 or any(c.level > limit * (1 + 1e-9) for c in offered):
        raise InputError(f"every candidate must stay below the highest pressure, {limit} Pa, and that above zero")
    scales = {p.name: p.scale or 1.0 for p in fitted.parameters}
    sizes = {n: abs(fitted.values[n]) or scales[n] for n in names}
    unit = np.array(list(sizes.values()))
    known = information_of(fitted.covariance.matrix[np.ix_(shared, shared)] / np.outer(unit, unit))
    now, direction = summary("as it is", known, names)
    found, refused = [], []
    for candidate in offered:
        try:
            more = information_gain(fitted, experiments, candidate, sizes, step)
        except SimulationError as error:
            refused.append(f"{candidate.words}: {error}")
            continue
        found.append(summary(candidate.words, known + more, names)[0])
    found.sort(key=lambda p: p.weakest if criterion == "E" else p.volume)
    return Design(now, direction, tuple(found), tuple(refused))


def standard(model: Model, like: Experiment, limit: float) -> list[Candidate]:
    """Pulses up to the limit and, where the pressure is measured, chirps through the first mode."""
    names = [c.name for c in model.chambers]
    if len(names) > 1:
        return [
            replace(one, words=f"{', '.join(driven)}: {one.words}", chambers=driven)
            for driven in (*((name,) for name in names), tuple(names)) for one in courses(model, like, limit)
        ]
    return courses(model, like, limit)


def courses(model: Model, like: Experiment, limit: float) -> list[Candidate]:
    """Return the candidate time series of one pressure."""
    offered = [
        Candidate(f"pulse, {share * limit * 1e-3:.3g} kPa for {width:g} s", Pulse(share * limit, BEFORE, width),
                  BEFORE + width + AFTER, share * limit)
        for share in LEVELS for width in WIDTHS
    ]
    if like.excitation == "trace":
        first = float(modes(model)[0][0])
        offered += [
            Candidate(
                f"chirp, 0 to {share * limit * 1e-3:.3g} kPa, {0.1 * first:.2g} to {1.5 * first:.2g} Hz in {CHIRP:g} s",
                Chirp(0.5 * share * limit, 0.5 * share * limit, 0.1 * first, 1.5 * first, CHIRP, BEFORE),
                BEFORE + CHIRP + AFTER, share * limit,
            ) for share in LEVELS[1::2]
        ]
    return offered


def information_gain(
    fitted: FitResult, experiments: Sequence[Experiment], candidate: Candidate, sizes: dict[str, float], step: float,
) -> Array:
    """Information (P, P) that a recording under a candidate adds, per relative change of each shared parameter.

    What is the recording's own (edge times) is taken out of it.
    """
    like = experiments[0]
    interval = float(np.median(np.diff(like.time)))
    times = np.arange(0.0, candidate.duration, interval)
    model = fitted.model
    driven = candidate.chambers or tuple(c.name for c in model.chambers)
    course = [candidate.pressure if c.name in driven else Pulse(0.0) for c in model.chambers]
    inputs = course if len(course) > 1 else course[0]
    seen = simulate(model, inputs, times=times, step=min(step, interval), check=False)["station_position"]
    position = seen.sel(station=list(like.stations)).values
    nominal = like.excitation in ("pulse", "step") and isinstance(candidate.pressure, Pulse)
    trace = None if nominal else sampled(candidate)
    drives = {} if trace is None or len(course) == 1 else dict.fromkeys(driven, trace)
    exp = Experiment(
        "next", times, position, like.stations, "pulse" if nominal else "trace",
        None if drives else trace, level=candidate.level, known=like.known, drives=drives,
    )
    own = {"next.start": BEFORE, "next.stop": float(candidate.pressure.jumps[-1])} if nominal else {}
    records = {e.name for e in experiments}
    values = {**{n: v for n, v in fitted.values.items() if n.partition(".")[0] not in records or n in sizes}, **own}
    every = {**sizes, **dict.fromkeys(own, 0.01)}
    _, slopes = sensitivities(model, exp, values, every, step)
    J = slopes[..., :2].reshape(len(every), -1) * np.array(list(every.values()))[:, None]
    noise = np.sqrt(np.mean([v**2 for v in fitted.rmse.values()]) / 2)
    assert fitted.covariance is not None
    frames = max(1.0, fitted.covariance.correlated / interval)
    whole = J @ J.T / (noise**2 * frames)
    P = len(sizes)
    if not own:
        return np.asarray(whole)
    return np.asarray(whole[:P, :P] - whole[:P, P:] @ np.linalg.pinv(whole[P:, P:]) @ whole[P:, :P])


def sampled(candidate: Candidate) -> Trace:
    """A candidate as a measured pressure: pulses with their jumps, everything else at 1 kHz."""
    if isinstance(candidate.pressure, Pulse):
        start, stop = candidate.pressure.jumps
        return Trace(np.array([start, start, stop, stop]), candidate.level * np.array([0.0, 1.0, 1.0, 0.0]))
    times = np.arange(0.0, candidate.duration, 1e-3)
    return Trace(times, candidate.pressure(times))


def information_of(covariance: Array) -> Array:
    """The inverse of a covariance; nothing is known along directions that it leaves open."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    inverse = np.where(values > 1e-14 * max(float(values[-1]), 1e-300), 1.0 / np.maximum(values, 1e-300), 0.0)
    return np.asarray((vectors * inverse) @ vectors.T)


def summary(words: str, information: Array, names: Sequence[str]) -> tuple[Proposal, tuple[str, ...]]:
    """Return standard errors from a Fisher information matrix, and the parameters of its least certain direction."""
    values, vectors = np.linalg.eigh(information)
    values = np.maximum(values, 1e-12)
    std = np.sqrt(np.diag((vectors / values) @ vectors.T))
    part = np.abs(vectors[:, 0]) > 0.3 * np.abs(vectors[:, 0]).max()
    proposal = Proposal(
        words, dict(zip(names, (float(s) for s in std), strict=True)), float(values[0] ** -0.5),
        float(np.exp(-0.5 * np.mean(np.log(values)))),
    )
    return proposal, tuple(n for n, p in zip(names, part, strict=True) if p)


def highest_of(exp: Experiment) -> float:
    """The pressure of an experiment that is farthest from 0, Pa."""
    return max([trace.peak for trace in exp.traces.values()], key=abs, default=exp.level)
