"""Functions with which a worker process computes one chunk of a sweep's samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from pliant.errors import PliantError
from pliant.identification import Experiment, FitResult, Parameter, fit, predict
from pliant.identification.problem import scattered_start
from pliant.identification.resampling import redrawn, with_drawn
from pliant.model import Model
from pliant.sweep.spec import PULSE, Sweep, fixed, generator, table

Array = np.ndarray
Arrays = dict[str, Array]


@dataclass(frozen=True)
class SweepTask:
    """Everything that a worker process needs to compute a sweep: its definition, the model, and recordings to fit."""

    sweep: Sweep
    model: Model
    experiments: tuple[Experiment, ...] = ()
    parameters: tuple[Parameter, ...] = ()
    fit_options: dict[str, Any] | None = None
    base: FitResult | None = None  # for a bootstrap: the fit whose residuals are resampled
    threads: int | None = 1  # threads of a batch; None: all cores, if one job runs at a time
    device: str = "cpu"  # of a batch

    @property
    def bounds(self) -> list[tuple[int, int]]:
        """Return, for each chunk, the index of its first sample and the index after its last sample."""
        size, many = self.sweep.size, self.sweep.together
        return [(first, min(first + many, size)) for first in range(0, size, many)]

    def work(self, chunk: int) -> Arrays:
        """Compute one chunk of samples; return its result arrays by name, with the samples along the first axis."""
        kinds = {"bootstrap": bootstrap, "multi_start": multi_start}
        first = chunk * self.sweep.together
        return kinds.get(self.sweep.kind, simulated)(self, first, min(first + self.sweep.together, self.sweep.size))


def simulated(task: SweepTask, first: int, last: int) -> Arrays:
    """Simulate the samples `first` to `last - 1`; return tip positions over time, peak displacements and parameters."""
    from pliant.batch import simulate_batch
    from pliant.simulation import Pulse
    from pliant.simulation.time_step import shared_step

    sweep = task.sweep
    varied = table(sweep, first, last)
    count = last - first
    everything = {**{k: np.full(count, v) for k, v in fixed(sweep).items()}, **varied}
    names = task.model.actuation.names
    pulse = {"level": 119e3 if len(names) == 1 else 0.0, "start": 0.0, "width": np.inf}
    edges = {k: everything.pop(k, np.full(count, v)) for k, v in pulse.items()}  # for all chambers
    each = [{k: everything.pop(f"{name}.{k}", edges[k]) for k in PULSE} for name in names]  # or what one is given
    pulse_of = cache(Pulse)  # equal ones are one: samples then share their steps
    pressures = [tuple(pulse_of(*(float(sample[k][i]) for k in PULSE)) for sample in each) for i in range(count)]
    pressures = pressures[:1] if len(set(pressures)) == 1 else pressures
    times = np.arange(round(sweep.duration * sweep.rate) + 1) / sweep.rate
    time_step = sweep.time_step or shared_step([task.model])  # one for all chunks
    run = simulate_batch(
        task.model, pressures, parameters=everything or {"tip_mass": np.full(count, task.model.tip_mass)},
        times=times, time_step=time_step, variables=("tip_position",), threads=task.threads, failures="mark",
        device=task.device,
    )
    tip = run["tip_position"].values[:, :, -1]
    moved = np.linalg.norm(tip - tip[:, :1], axis=-1)
    return {
        **{f"parameter_{k}": v for k, v in varied.items()}, "tip": tip, "final_tip": tip[:, -1],
        "largest_deflection": moved.max(axis=1), "failed": np.isfinite(run["failed_at"].values),
    }


def refitted(task: SweepTask, sample: int, experiments: Sequence[Experiment], start: Sequence[Parameter]) -> Arrays:
    """Fit the recordings for one sample of a sweep. Return fitted parameters and error; NaN if the fit fails."""
    free = [p.name for p in start if p.free]
    options = {**(task.fit_options or {}), "starts": 1, "rng": generator(task.sweep.seed, sample)}
    try:
        result = fit(experiments, task.model, start, **options)
    except PliantError:
        nothing = np.array(np.nan)
        return {**{f"parameter_{n}": nothing for n in free}, "rmse": nothing, "failed": np.array(True)}
    values = {f"parameter_{n}": np.array(result.values[n]) for n in free}
    rmse = np.array(float(np.sqrt(np.mean(np.square(list(result.rmse.values()))))))
    return {**values, "rmse": rmse, "failed": np.array(not result.converged)}


def stacked(rows: Sequence[Arrays]) -> Arrays:
    """Combine the result arrays of several samples into one array per name, with the samples along a new first axis."""
    return {name: np.stack([row[name] for row in rows]) for name in rows[0]}


def bootstrap(task: SweepTask, first: int, last: int) -> Arrays:
    """Compute the samples `first` to `last - 1` of a residual bootstrap. Each is a new fit to artificial measurements:
    the motion that the first fit predicts, plus residuals of this fit drawn at random in blocks of consecutive frames.
    """
    base = task.base
    if base is None:
        raise ValueError("a bootstrap needs the fit whose residuals it resamples")
    values = base.values
    start = list(base.parameters)
    modelled = [predict(base.model, exp, values, base.time_step)["compared"] for exp in task.experiments]
    rows = []
    for sample in range(first, last):
        rng = generator(task.sweep.seed, sample)
        again = [
            with_drawn(exp, redrawn(exp, motion, frames_in(exp, task.sweep.block), rng))
            for exp, motion in zip(task.experiments, modelled, strict=True)
        ]
        rows.append(refitted(task, sample, again, start))
    return stacked(rows)


def frames_in(exp: Experiment, seconds: float) -> int:
    """Return the number of frames in a block of `seconds`, at least one and at most all frames of the recording."""
    return int(np.clip(round(seconds / np.median(np.diff(exp.time))), 1, exp.time.size))


def multi_start(task: SweepTask, first: int, last: int) -> Arrays:
    """Fit the recordings from random start values, once per sample, to see whether all reach the same optimum."""
    starts = {s: scattered_start(task.parameters, generator(task.sweep.seed, s)) for s in range(first, last)}
    return stacked([refitted(task, sample, task.experiments, start) for sample, start in starts.items()])
