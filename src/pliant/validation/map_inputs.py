"""Inputs of a plain map: recorded inputs and known loads of experiments, at their frames and behind lags."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from pliant.errors import InputError
from pliant.identification.edges import edges
from pliant.identification.experiment import Experiment
from pliant.recording.rules import INPUT_UNITS
from pliant.simulation import Pulse, Trace
from pliant.simulation.drive import behind_lags
from pliant.simulation.inputs import Input
from pliant.units import shown_in

Array = np.ndarray
IDLE = 0.02  # of the largest range among inputs of one kind: an input that varies less does not move (sensor noise)
TOGETHER = 0.02  # of an input's standard deviation: what the others leave unexplained where they move together
LOADS = {"tip_mass": 0.0}  # known parameters of a recording that are loads, with their value where none is stated
SHORTEST = 1e-6  # s, of a pulse


class InputTable(NamedTuple):
    """The inputs of a plain map by name: C time series that move in the training recordings, and L constant loads."""

    names: tuple[str, ...]
    loads: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """Return the number of inputs and loads, C + L."""
        return len(self.names) + len(self.loads)

    def values(self, exp: Experiment, time_constants: Sequence[float] = ()) -> Array:
        """Return the inputs and loads of an experiment at its T frames, then the inputs behind first-order lags of K
        time constants [s]: (T, C + L + K C), SI units. An input without a record is 0; settled poses have no lag.

        Raises
        ------
        InputError
            When the experiment does not say which of several inputs its pressure drives.
        """
        sources = inputs_of(exp)
        if "" in sources and self.names != ("",):
            if len(self.names) > 1:
                raise InputError(f"experiment {exp.name} does not say which of the inputs {', '.join(self.names)} its "
                                 "pressure drives: name it in drive")
            sources = {name or next(iter(self.names), ""): source for name, source in sources.items()}
        moving = [sources.get(name, Pulse(0.0)) for name in self.names]
        present = [np.asarray(moving_input(exp.time), dtype=float) for moving_input in moving]
        loads = [np.full(exp.time.size, float(exp.known.get(name, LOADS[name]))) for name in self.loads]
        columns = np.array([*present, *loads]).reshape(self.size, exp.time.size).T
        if exp.poses or not moving:
            return np.hstack([columns, *[columns[:, : len(moving)]] * len(time_constants)])
        return np.hstack([columns, *behind_lags(exp.time, moving, time_constants)])


def inputs_of(exp: Experiment) -> dict[str, Input]:
    """Return the inputs of an experiment by name: the measured ones, or a pulse of the known level between the edges
    that its motion shows; then the components of known forces. "" is the name of a single input without one.
    """
    sources: dict[str, Input] = dict(exp.traces)
    if exp.nominal:
        times = {**edges(exp), **exp.known}
        width = np.inf if exp.excitation == "step" else max(times["stop"] - times["start"], SHORTEST)
        sources[""] = Pulse(exp.level, times["start"], width)
    for k, force in enumerate(exp.forces):
        point = force.at if isinstance(force.at, str) else f"point {k + 1}"
        for axis, component in zip("xyz", force.force.T, strict=False):
            sources[f"force {axis} at {point}"] = Trace(force.time, component)
    return sources


def table_of(train: Sequence[Experiment]) -> tuple[InputTable, tuple[str, ...]]:
    """Return the inputs that move in the training experiments, and sentences on those that never move and on those that
    always move together.
    """
    names = list(dict.fromkeys(name for exp in train for name in inputs_of(exp)))
    names = [name for name in names if name or len(names) == 1]
    kinds = {to: kind for exp in train for to, kind in exp.input_kinds.items()}
    kind = [kinds.get(name, "tension" if name.startswith("force ") else "pressure") for name in names]
    inputs = np.concatenate([InputTable(tuple(names)).values(exp) for exp in train])
    span = np.ptp(inputs, axis=0)
    most = {k: max(s for s, other in zip(span, kind, strict=True) if other == k) for k in kind}
    moves = [k for k in range(len(names)) if span[k] > IDLE * most[kind[k]]]
    loads = tuple(name for name in LOADS if len({exp.known.get(name, LOADS[name]) for exp in train}) > 1)
    still = [names[k] for k in range(len(names)) if k not in moves and names[k]]
    notes = [still_sentence(still)] if still and moves else []
    units = {names[k]: INPUT_UNITS.get(kind[k], "Pa") for k in moves}
    return InputTable(tuple(units), loads), (*notes, *together(units, inputs[:, moves]))


def still_sentence(names: Sequence[str]) -> str:
    """Return a sentence on inputs that never move in the training recordings."""
    several = len(names) > 1
    return (f"Input{'s' * several} {', '.join(names)} never move{'' if several else 's'} in the training recordings: "
            f"the plain map leaves {'them' if several else 'it'} out.")


def together(units: Mapping[str, str], seen: Array) -> list[str]:
    """Return a sentence with the linear combination for each of C inputs (N, C) that is one of the inputs before it.

    `units` holds the SI unit of each input by its name.
    """
    names = list(units)
    notes: list[str] = []
    independent: list[int] = []
    spread = np.std(seen, axis=0)
    for k, name in enumerate(names):
        before = seen[:, np.array(independent, dtype=int)]
        regressors = np.column_stack([np.ones(len(seen)), (before - before.mean(axis=0)) / spread[independent]])
        slopes, *_ = np.linalg.lstsq(regressors, seen[:, k], rcond=None)
        if not independent or np.std(seen[:, k] - regressors @ slopes) > TOGETHER * spread[k]:
            independent.append(k)
            continue
        used = [(j, slope / spread[j]) for j, slope in zip(independent, slopes[1:], strict=True)
                if abs(slope) > TOGETHER * spread[k]]
        factor, unit = shown_in(units[name])
        offset = factor * float(slopes[0] - sum(s * seen[:, j].mean() for j, s in used))
        terms = " ".join(f"{factor * s / shown_in(units[names[j]])[0]:+.3g} {names[j]}" for j, s in used)
        rest = f" {offset:+.2g} {unit}" if abs(offset) > TOGETHER * factor * np.ptp(seen[:, k]) else ""
        notes.append(f"Inputs {', '.join([*(names[j] for j, _ in used), name])} always move together in the training "
                     f"recordings ({name} = {terms.removeprefix('+')}{rest}): only the effect of this combination is "
                     "determined; record one of them alone.")
    return notes
