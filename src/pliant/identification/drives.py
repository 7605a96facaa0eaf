"""Assignment of recorded inputs to a model's chambers, and checks that each chamber was driven independently."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
import xarray as xr

from pliant.errors import InputError
from pliant.identification.experiment import Experiment, leading
from pliant.identification.names import path_of
from pliant.model import Model
from pliant.recording.inputs import RecordedInput, recorded_inputs
from pliant.recording.rules import INPUT_UNITS
from pliant.simulation import Pulse, Trace
from pliant.simulation.inputs import Input
from pliant.units import inputs_word

Array = np.ndarray
TOGETHER = 1e-3  # sine of the angle between two pressure series (as vectors) below which they count as proportional
SHORTEST = 1e-6  # s, of a pulse
STILL = 0.1  # of the range of the pressure that changes most: smaller changes of other chambers are neglected
IDLE = 0.02  # of that range: largest change of a chamber that counts as not driven (sensor noise, cross-talk)
ALIKE = 0.2  # sine as for TOGETHER, below which two pressures count as nearly equal


def driving(name: str, recording: xr.Dataset, wanted: Mapping[str, str | int]) -> dict[str, RecordedInput]:
    """Return for each model input named in `wanted` the recorded input, such as a pressure, that drives it.

    `wanted` maps each input of the model to the name, or index from 0, of an input of the recording. Pressures are
    counted first, then inputs of other kinds.

    Raises
    ------
    InputError
        When the recording has no such input.
    """
    inputs = recorded_inputs(recording)
    if not inputs:
        raise InputError(f"recording {name} holds no measured pressure or other input that could drive "
                         f"{', '.join(wanted)}: add it to the recording, or leave drive out")  # fmt: skip
    there = [signal.name or "the only one" for signal in inputs]
    what = inputs_word(signal.kind for signal in inputs)
    driven = {}
    for chamber, asked in wanted.items():
        k = there.index(asked) if asked in there else asked
        if not isinstance(k, int) or not 0 <= k < len(there):
            raise InputError(
                f"recording {name} has no {what} {asked!r} to drive {chamber!r}: it has {', '.join(there)} "
                f"(use a name, or its index from 0 to {len(there) - 1})"
            )
        driven[chamber] = inputs[k]
    return driven


def drives_of(name: str, recording: xr.Dataset, wanted: Mapping[str, str | int]) -> dict[str, Trace]:
    """Return for each model input named in `wanted` the measured time series that drives it, as a `Trace`."""
    return traces_of(driving(name, recording, wanted))


def traces_of(driven: Mapping[str, RecordedInput]) -> dict[str, Trace]:
    """Return each recorded input as a `Trace`, by the name of the model's input that it drives."""
    return {to: Trace(signal.time, np.array(signal.values)) for to, signal in driven.items()}


def measured(
    name: str, recording: xr.Dataset, model: Model, drive: Mapping[str, str | int] | None,
) -> list[Trace | Pulse]:
    """Return for each input of a model the recorded input that drives it, as a `Trace`; a constant 0 if none does.

    `drive` maps inputs of the model to recorded inputs as in `driving`. Without it, each recorded input drives the
    input of its name.

    Raises
    ------
    InputError
        When an input of the model has no recorded one, when they differ in kind, or when samples are missing.
    """
    names = model.actuation.names
    if strange := [item for item in drive or () if item not in names]:
        raise InputError(
            f"drive names {strange[0]!r}, but the model has the {inputs_word(model.actuation.kinds)}s "
            f"{model.actuation.listing}: use one of these"
        )
    if drive is None and len(names) == 1:
        driven = {names[0]: only_input(name, recording)}
    else:
        driven = driving(name, recording, {n: n for n in names} if drive is None else drive)
    for to, item in driven.items():
        check_kind(f"recording {name}", model, to, item.kind)
        if lost := int((~np.isfinite(item.values)).sum()):
            raise InputError(f"recording {name}: {lost} samples of the {item.kind} are missing: interpolate them first")
    traces = traces_of(driven)
    return [traces.get(n, Pulse(0.0)) for n in names]


def only_input(name: str, recording: xr.Dataset) -> RecordedInput:
    """Return a recording's only measured input; raise InputError unless there is exactly one."""
    inputs = recorded_inputs(recording)
    listed = ", ".join(signal.name or signal.kind for signal in inputs) or "none"
    if len(inputs) > 1 and all(signal.kind == "pressure" for signal in inputs):
        raise InputError(
            f"recording {name} has several pressures ({listed}): select the one that bends the body, or state with "
            "drive which of them drives which chamber of the model"
        )
    if len(inputs) != 1:
        raise InputError(f"recording {name} has {len(inputs)} measured inputs ({listed}): state with drive which of "
                         "them drives which input of the model")  # fmt: skip
    return inputs[0]


def alone(exp: Experiment, chamber: str) -> bool:
    """Return whether `chamber` alone was driven: the pressures of all others vary by at most 10 % as much."""
    if not exp.drives or leading(exp.drives) != chamber:
        return False
    moves = float(np.ptp(exp.drives[chamber].pressure))
    return all(np.ptp(t.pressure) <= STILL * moves for name, t in exp.drives.items() if name != chamber)


def check_driven(model: Model, experiments: Sequence[Experiment]) -> None:
    """Raise InputError if an experiment drives an unknown chamber, or does not state which chamber it drives."""
    names = [c.name for c in model.chambers]
    for exp in experiments:
        if strange := [d for d in exp.drives if d not in names]:
            raise InputError(
                f"experiment {exp.name} drives the chamber {strange[0]!r}, but model {model.name!r} has "
                f"{', '.join(names)}: name one of these in drive"
            )
        check_kinds(model, exp)
        if len(names) > 1 and exp.excitation != "release" and not exp.drives:
            raise InputError(
                f"experiment {exp.name} does not state which of the chambers {', '.join(names)} its pressure drives: "
                'give drives (in a study: drive = {chamber = "pressure of the recording"}), from measured pressures'
            )


def check_kinds(model: Model, exp: Experiment) -> None:
    """Raise InputError if a recorded input differs in kind (pressure, tension, ...) from the model input it drives."""
    for to, kind in exp.input_kinds.items():
        check_kind(f"experiment {exp.name}", model, to, kind)


def check_kind(who: str, model: Model, to: str, kind: str) -> None:
    """Raise InputError if a recorded input differs in kind (pressure, tension, ...) from the model input `to` that it
    drives; "" is the only one. `who` names the recording.
    """
    k = model.actuation.names.index(to) if to else 0
    wanted = model.actuation.kinds[k]
    if kind != wanted:
        expected, other = ("an angle" if word == "angle" else f"a {word}" for word in (wanted, kind))
        raise InputError(
            f"{who}: input {model.actuation.names[k]!r} of model {model.name!r} is {expected} "
            f"[{model.actuation.units[k]}], but the input that drives it was recorded as {other} "
            f"[{INPUT_UNITS.get(kind, 'Pa')}]: correct driven_by of the tendon, kind in the mapping, or drive"
        )


def inputs_to(model: Model, exp: Experiment, start: float, stop: float) -> tuple[Input, ...]:
    """Return one input function per chamber: the measured pressure delayed by `start` [s] or, if no input was measured,
    a pulse of constant pressure from `start` to `stop`.

    Chambers without a recorded input stay at 0.
    """
    check_driven(model, [exp])
    if exp.excitation != "trace":
        width = np.inf if exp.excitation == "step" else max(stop - start, SHORTEST)
        return (Pulse(exp.level, start, width),)
    signal = [exp.driving(name) for name in model.actuation.names]
    return tuple(Pulse(0.0) if t is None else Trace(t.time + start, t.pressure) for t in signal)


def at_rest(model: Model, exp: Experiment) -> str:
    """Return a sentence that names the model inputs which an experiment leaves undriven; '' if it drives all."""
    if not exp.drives:
        return ""
    inputs = model.actuation
    idle: dict[tuple[str, str], list[str]] = {}
    for name, kind, unit in zip(inputs.names, inputs.kinds, inputs.units, strict=True):
        if name not in exp.drives:
            idle.setdefault((kind, unit), []).append(name)
    return " ".join(
        f"In {exp.name} no {kind} drives {' and '.join(names)}: assumed constant at 0 {unit}."
        for (kind, unit), names in idle.items()
    )


def pressures_at(model: Model, experiments: Sequence[Experiment]) -> Array:
    """Return the pressures (N, C) [Pa] of all C chambers at the N frames of all experiments in sequence."""
    rows = [
        np.stack([e.drives[c.name](e.time) if c.name in e.drives else np.zeros(e.time.size) for c in model.chambers], 1)
        for e in experiments
    ]
    return np.concatenate(rows)


def shared(a: Array, b: Array) -> float:
    """Return how independent two pressure series (N,) of N samples are: the sine of the angle between them as vectors,
    0 if they are proportional.
    """
    p, q = a / np.linalg.norm(a), b / np.linalg.norm(b)
    return float(np.linalg.norm(p - q * (p @ q)))


def fitted_chambers(names: Sequence[str], model: Model) -> list[int]:
    """Return the indices of the chambers to which any of the parameters `names` belongs."""
    return [k for k, c in enumerate(model.chambers) if any(n.startswith(f"{c.name}.") for n in names)]


def hardly_driven(names: Sequence[str], model: Model, experiments: Sequence[Experiment]) -> list[str]:
    """Return warnings about chambers of the parameters `names` whose pressure hardly varied, or only in step with
    another.
    """
    mine = fitted_chambers(names, model)
    if model.actuation.count == 1 or not mine:
        return []
    inputs = pressures_at(model, experiments)
    moves = np.ptp(inputs, axis=0)
    most = int(np.argmax(moves))
    findings = [
        f"{named(model, [k], first=True)} was hardly driven: its {model.chambers[k].kind} changes by only "
        f"{100 * moves[k] / moves[most]:.2g} % as much as that of {model.chambers[most].name}, so its law is uncertain."
        for k in mine if moves[k] <= IDLE * moves[most]
    ]
    driven = [k for k in mine if moves[k] > IDLE * moves[most]]
    uneven = any(path.stem == "stiffness" and path.numbers for path in map(path_of, names))
    for a, b in combinations(driven, 2):
        first, other = model.chambers[a], model.chambers[b]
        if shared(inputs[:, a], inputs[:, b]) < ALIKE:
            overlap = bool(np.any((first.joint_gain != 0) & (other.joint_gain != 0)))
            findings.append(f"{named(model, [a, b], first=True)} {hardly_apart(overlap, uneven)}")
    return findings


def named(model: Model, places: Sequence[int], *, first: bool = False) -> str:
    """Return the kind and names of the model inputs at the indices `places` as text, such as "tendon m2"."""
    inputs = [model.chambers[k] for k in places]
    kinds = {chamber.noun for chamber in inputs}
    what = kinds.pop() if len(kinds) == 1 else "input"
    what = what.capitalize() if first else what
    return f"{what}{'s' * (len(inputs) > 1)} {' and '.join(chamber.name for chamber in inputs)}"


def hardly_apart(overlap: bool, uneven: bool) -> str:
    """Return a warning that two chambers were driven by nearly equal pressures."""
    if overlap:  # uneven: whether the stiffness of each joint is free
        return ("turn the same joints and were hardly driven separately: only the edges of their pressures "
                "distinguish their laws; record one of them alone.")
    said = "were hardly driven separately: only the shape distinguishes their laws"
    if uneven:
        return f"{said}; record one of them alone."
    return (f"{said}. Joints of unequal stiffness would bias these laws by more than their standard errors; record one "
            "of them alone, or free stiffness_*.")


def findings_of_chambers(names: Sequence[str], model: Model, experiments: Sequence[Experiment]) -> str:
    """Return as text why the recordings cannot separate the parameters `names`: a chamber was never driven, or two were
    never driven separately. '' if neither is the case.
    """
    mine = fitted_chambers(names, model)
    if model.actuation.count == 1 or not mine:
        return ""
    inputs = pressures_at(model, experiments)
    if idle := [k for k in mine if not inputs[:, k].any()]:
        return f"{named(model, idle[:1])} is driven in no recording"
    for a, b in combinations(mine, 2):
        if shared(inputs[:, a], inputs[:, b]) < TOGETHER:
            return f"{named(model, [a, b])} were never driven separately: their gains cannot be distinguished"
    return ""
