"""Optimal design of the next experiment: excitations ranked by the standard errors to expect after recording them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pliant.errors import InputError, SimulationError
from pliant.identification.experiment import Experiment
from pliant.identification.prediction import compared_of
from pliant.identification.result import FitResult
from pliant.identification.sensitivity import sensitivities
from pliant.model import Model
from pliant.plain import plain
from pliant.simulation import Chirp, Pulse, Trace, modes, simulate
from pliant.simulation.inputs import Input
from pliant.units import in_words, input_words, shown_in

Array = np.ndarray
CRITERIA = ("E", "D")
LEVELS = (0.25, 0.5, 0.75, 1.0)  # of the highest level
WIDTHS = (0.1, 0.3, 1.0, 3.0)  # s
BEFORE, AFTER = 0.2, 2.0  # s of rest around an excitation
CHIRP = 6.0  # s
BOTH_SIGNS = ("m", "rad")  # units of inputs that act on both sides of 0


@dataclass(frozen=True)
class Candidate:
    """An input that could be recorded next: description, input function, duration [s] and peak level [SI].

    Of a model's inputs, it drives those named in `chambers`, which have the same unit; the others stay at 0.
    """

    words: str
    pressure: Input
    duration: float
    level: float
    chambers: tuple[str, ...] = ()


@dataclass(frozen=True)
class Proposal:
    """Expected standard errors of the parameters after one more recording, made with a given input.

    Attributes
    ----------
    words : str
        Description of the excitation.
    std : dict
        Expected relative standard error of each parameter with the recording added.
    weakest : float
        Expected relative standard error along the least certain direction of the parameters.
    volume : float
        Geometric mean of the relative standard errors along all directions.
    """

    words: str
    std: dict[str, float]
    weakest: float
    volume: float


@dataclass(frozen=True)
class Design:
    """Result of `design`: proposed inputs, best first, and the standard errors without a further recording."""

    now: Proposal
    direction: tuple[str, ...]  # parameters of the least certain direction now
    proposals: tuple[Proposal, ...]
    refused: tuple[str, ...]  # candidates that could not be simulated, with the reason

    def to_dict(self) -> dict[str, Any]:
        """Return the experiment design as a dictionary of plain numbers and strings for JSON."""
        return {**plain(self), "now": plain(self.now, but=("words",))}


def design(
    fitted: FitResult, experiments: Sequence[Experiment], *, highest: float | Mapping[str, float] | None = None,
    criterion: str = "E", time_step: float | None = None, candidates: Sequence[Candidate] | None = None,
) -> Design:
    """Rank inputs for the next recording by the standard errors that the parameters would have after it.

    The Fisher information of the fit and that of a recording simulated under each candidate are added. The simulated
    recording has noise of the size of the fit's residuals, whose correlation in time is taken into account.

    Parameters
    ----------
    fitted : FitResult
    experiments : sequence of Experiment
        The experiments of the fit. The simulated recording takes its stations, frame rate and excitation from them.
    highest : float or mapping, optional
        Highest level that an input may get, SI: one number if all inputs have the same unit, else one for each unit,
        such as ``{"N": 5.0, "m": 3e-3}``. Default: for each unit the highest recorded level.
    criterion : {"E", "D"}
        "E" minimises the error along the least certain direction, "D" the geometric mean over all directions.
    time_step : float, optional
        Longest time step, s; default: that of the fit.
    candidates : sequence of Candidate, optional
        Default: pulses of four levels and four widths and, where the inputs are measured, chirps through the first
        mode. With several inputs, each excitation drives every input alone, then all of one unit together.

    Raises
    ------
    InputError
        When the fit has no free shared parameter, or the limit of an input is missing or passed.
    """
    if criterion not in CRITERIA:
        raise InputError(f"unknown criterion {criterion!r}: use E (weakest direction) or D (all directions)")
    if fitted.covariance is None:
        raise InputError("a design needs the covariance of a fit: fit with at least one free parameter")
    records = {e.name for e in experiments}
    shared = [k for k, n in enumerate(fitted.covariance.names) if n.partition(".")[0] not in records]
    names = [fitted.covariance.names[k] for k in shared]
    if not names:
        raise InputError("a design needs a free parameter that all recordings share, and this fit has none: "
                         "let one be free, such as stiffness")
    limits = limits_of(fitted.model, experiments, highest)
    offered = list(candidates) if candidates is not None else standard(fitted.model, experiments[0], limits)
    for offer in offered:
        check_level(fitted.model, offer, limits)
    scales = {p.name: p.scale or 1.0 for p in fitted.parameters}
    sizes = {n: abs(fitted.values[n]) or scales[n] for n in names}
    unit = np.array(list(sizes.values()))
    known = information_of(fitted.covariance.matrix[np.ix_(shared, shared)] / np.outer(unit, unit))
    now, direction = summary("as it is", known, names)
    suggested, refused = [], []
    for candidate in offered:
        try:
            more = information_gain(fitted, experiments, candidate, sizes, time_step or fitted.time_step)
        except SimulationError as error:
            refused.append(f"{candidate.words}: {error}")
            continue
        suggested.append(summary(candidate.words, known + more, names)[0])
    suggested.sort(key=lambda p: p.weakest if criterion == "E" else p.volume)
    return Design(now, direction, tuple(suggested), tuple(refused))


def limits_of(
    model: Model, experiments: Sequence[Experiment], highest: float | Mapping[str, float] | None,
) -> dict[str, float]:
    """Return the highest level that inputs of each unit may get, by SI unit: the stated one, or the highest recorded.

    Displacements and angles, which have both signs, count by their size.
    """
    unit_of = dict(zip(model.actuation.names, model.actuation.units, strict=True))
    units = list(dict.fromkeys(unit_of.values()))
    if isinstance(highest, Mapping):
        stated = dict(highest)
    elif highest is None or len(units) == 1:
        stated = {} if highest is None else {units[0]: highest}
    else:
        raise InputError(f"the inputs of model {model.name!r} have the units {', '.join(units)}: give the highest "
                         "level of each")  # fmt: skip
    if strange := sorted(set(stated) - set(units)):
        raise InputError(f"no input of model {model.name!r} has the unit {strange[0]!r}: state the highest levels in "
                         f"{', '.join(units)}")  # fmt: skip
    limits = {}
    for unit in units:
        peaks = [[p for name, p in peaks_of(e).items() if unit_of.get(name, units[0]) == unit] for e in experiments]
        peaks_of_case = [abs(most) if unit in BOTH_SIGNS else most for most in (max(p, key=abs) for p in peaks if p)]
        limits[unit] = stated[unit] if unit in stated else max(peaks_of_case, default=0.0)
        if not limits[unit] > 0:
            word = input_words([unit])[0]
            raise InputError(f"the highest {word} of a design must be positive, got {in_words(limits[unit], unit)}: "
                             "set highest")  # fmt: skip
    return limits


def peaks_of(exp: Experiment) -> dict[str, float]:
    """Return the value [SI] of each input of an experiment that is farthest from 0, by the name of the input, which is
    "" for the only one. If none was measured, it is the nominal level.
    """
    return {name: trace.peak for name, trace in exp.traces.items()} or {"": exp.level}


def check_level(model: Model, candidate: Candidate, limits: Mapping[str, float]) -> None:
    """Raise InputError if a candidate exceeds the highest level [SI] of its inputs, which `limits` gives by unit."""
    unit_of = dict(zip(model.actuation.names, model.actuation.units, strict=True))
    for unit in dict.fromkeys(unit_of[name] for name in candidate.chambers or unit_of):
        if abs(candidate.level) > limits[unit] * (1 + 1e-9):
            raise InputError(
                f"candidate {candidate.words!r} reaches {in_words(candidate.level, unit)}, but must not exceed the "
                f"highest {input_words([unit])[0]} of {in_words(limits[unit], unit)}: lower its level, or raise highest"
            )


def standard(model: Model, like: Experiment, limits: Mapping[str, float]) -> list[Candidate]:
    """Return the default inputs to rank, for each input of the model alone and all of one unit together: pulses and
    chirps up to the level [SI] that `limits` gives for the unit.
    """
    names, units = model.actuation.names, model.actuation.units
    if len(names) == 1:
        return courses(model, like, limits[units[0]], units[0])
    together = {unit: tuple(n for n, u in zip(names, units, strict=True) if u == unit) for unit in limits}
    driven: list[tuple[tuple[str, ...], str]] = [((name,), unit) for name, unit in zip(names, units, strict=True)]
    driven += [(group, unit) for unit, group in together.items() if len(group) > 1]
    return [
        replace(course, words=f"{', '.join(group)}: {course.words}", chambers=group)
        for group, unit in driven for course in courses(model, like, limits[unit], unit)
    ]


def courses(model: Model, like: Experiment, limit: float, unit: str) -> list[Candidate]:
    """Return the default time series to rank for one input: pulses up to `limit` in its SI `unit` and, for recordings
    with measured inputs, chirps.
    """
    factor, label = shown_in(unit)
    offered = [
        Candidate(f"pulse, {share * limit * factor:.3g} {label} for {width:g} s", Pulse(share * limit, BEFORE, width),
                  BEFORE + width + AFTER, share * limit)
        for share in LEVELS for width in WIDTHS
    ]
    if like.excitation == "trace":
        first = float(modes(model)[0][0])
        offered += [
            Candidate(
                f"chirp, 0 to {share * limit * factor:.3g} {label}, {0.1 * first:.2g} to {1.5 * first:.2g} Hz in "
                f"{CHIRP:g} s",
                Chirp(0.5 * share * limit, 0.5 * share * limit, 0.1 * first, 1.5 * first, CHIRP, BEFORE),
                BEFORE + CHIRP + AFTER, share * limit,
            ) for share in LEVELS[1::2]
        ]
    return offered


def information_gain(
    fitted: FitResult, experiments: Sequence[Experiment], candidate: Candidate, sizes: dict[str, float],
    time_step: float,
) -> Array:
    """Return the Fisher information (P, P) on P parameters that a recording of a candidate input adds. It refers to
    changes of each parameter relative to its value or, if that is 0, to a typical size.

    The edge times of the recording are unknown as well and are marginalised out.
    """
    like = experiments[0]
    interval = float(np.median(np.diff(like.time)))
    times = np.arange(0.0, candidate.duration, interval)
    model = fitted.model
    driven = candidate.chambers or tuple(c.name for c in model.chambers)
    course = [candidate.pressure if c.name in driven else Pulse(0.0) for c in model.chambers]
    inputs = course if len(course) > 1 else course[0]
    motion = simulate(model, inputs, times=times, time_step=min(time_step, interval), check=False)["station_position"]
    position = motion.sel(station=list(like.stations)).values
    nominal = like.nominal and isinstance(candidate.pressure, Pulse)
    trace = None if nominal else sampled(candidate)
    drives = {} if trace is None or len(course) == 1 else dict.fromkeys(driven, trace)
    further = {name: rows._replace(values=np.zeros((times.size, *rows.values.shape[1:])))
               for name, rows in like.further.items() if name == like.alone}  # fmt: skip
    exp = Experiment(
        "next", times, position, like.stations, "pulse" if nominal else "trace",
        None if drives else trace, level=candidate.level, known=like.known, drives=drives, further=further,
    )
    edges = {"next.start": BEFORE, "next.stop": float(candidate.pressure.jumps[-1])} if nominal else {}
    records = {e.name for e in experiments}
    values = {**{n: v for n, v in fitted.values.items() if n.partition(".")[0] not in records or n in sizes}, **edges}
    every = {**sizes, **dict.fromkeys(edges, 0.01)}
    rows, slopes = sensitivities(model, exp, values, every, time_step)
    compared = compared_of(like, slopes, rows, further.get(like.alone))
    J = compared.reshape(len(every), -1) * np.array(list(every.values()))[:, None]
    noise = np.sqrt(np.mean([v**2 for v in fitted.rmse.values()]) / like.compared.shape[2])
    assert fitted.covariance is not None
    frames = max(1.0, fitted.covariance.correlated / interval)
    whole = J @ J.T / (noise**2 * frames)
    P = len(sizes)
    if not edges:
        return np.asarray(whole)
    return np.asarray(whole[:P, :P] - whole[:P, P:] @ np.linalg.pinv(whole[P:, P:]) @ whole[P:, :P])


def sampled(candidate: Candidate) -> Trace:
    """Return the input of a candidate as a `Trace`: a pulse as four samples at its two jumps, any other input
    sampled at 1 kHz.
    """
    if isinstance(candidate.pressure, Pulse):
        start, stop = candidate.pressure.jumps
        return Trace(np.array([start, start, stop, stop]), candidate.level * np.array([0.0, 1.0, 1.0, 0.0]))
    times = np.arange(0.0, candidate.duration, 1e-3)
    return Trace(times, candidate.pressure(times))


def information_of(covariance: Array) -> Array:
    """Return the Fisher information (P, P) on P parameters, the inverse of their covariance matrix. In directions of
    zero variance, which a fit did not determine, it is set to zero.
    """
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    inverse = np.where(values > 1e-14 * max(float(values[-1]), 1e-300), 1.0 / np.maximum(values, 1e-300), 0.0)
    return np.asarray((vectors * inverse) @ vectors.T)


def summary(words: str, information: Array, names: Sequence[str]) -> tuple[Proposal, tuple[str, ...]]:
    """Return as a `Proposal` the standard errors that follow from a Fisher information, and the names of the parameters
    in the least certain combination.
    """
    values, vectors = np.linalg.eigh(information)
    values = np.maximum(values, 1e-12)
    std = np.sqrt(np.diag((vectors / values) @ vectors.T))
    part = np.abs(vectors[:, 0]) > 0.3 * np.abs(vectors[:, 0]).max()
    proposal = Proposal(
        words, dict(zip(names, (float(s) for s in std), strict=True)), float(values[0] ** -0.5),
        float(np.exp(-0.5 * np.mean(np.log(values)))),
    )
    return proposal, tuple(n for n, p in zip(names, part, strict=True) if p)
