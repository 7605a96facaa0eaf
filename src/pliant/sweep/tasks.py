"""The work of a worker on one chunk of samples: arrays in, arrays out, nothing shared, nothing written."""

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
class Campaign:
    """All that a worker needs: the sweep, and the model or the fit that it starts from."""

    sweep: Sweep
    model: Model
    experiments: tuple[Experiment, ...] = ()
    parameters: tuple[Parameter, ...] = ()
    fit_options: dict[str, Any] | None = None
    base: FitResult | None = None  # of a bootstrap: the fit whose residuals are moved
    threads: int | None = 1  # of a batch; where one job is done after the other, all cores

    def bounds(self, chunk: int) -> tuple[int, int]:
        """First sample of a chunk, and the one after its last."""
        first = chunk * self.sweep.together
        return first, min(first + self.sweep.together, self.sweep.size)

    @property
    def chunks(self) -> int:
        """Number of chunks."""
        return -(-self.sweep.size // self.sweep.together)

    def work(self, chunk: int) -> Arrays:
        """The arrays of one chunk, samples first."""
        kinds = {"bootstrap": bootstrap, "multi_start": multi_start}
        return kinds.get(self.sweep.kind, simulated)(self, *self.bounds(chunk))


def simulated(campaign: Campaign, first: int, last: int) -> Arrays:
    """The tip of every sample against time, its highest deflection, and the parameters that made it."""
    from pliant.batch import simulate_batch
    from pliant.simulation import Pulse
    from pliant.simulation.time_step import shared_step

    sweep = campaign.sweep
    varied = table(sweep, first, last)
    count = last - first
    everything = {**{k: np.full(count, v) for k, v in fixed(sweep).items()}, **varied}
    names = campaign.model.actuation.names
    pulse = {"level": 119e3 if len(names) == 1 else 0.0, "start": 0.0, "width": np.inf}
    edges = {k: everything.pop(k, np.full(count, v)) for k, v in pulse.items()}  # for all chambers
    each = [{k: everything.pop(f"{name}.{k}", edges[k]) for k in PULSE} for name in names]  # or what one is given
    pulse_of = cache(Pulse)  # equal ones are one: samples then share their steps
    pressures = [tuple(pulse_of(*(float(own[k][i]) for k in PULSE)) for own in each) for i in range(count)]
    pressures = pressures[:1] if len(set(pressures)) == 1 else pressures
    times = np.arange(round(sweep.duration * sweep.rate) + 1) / sweep.rate
    step = sweep.step or shared_step([campaign.model])  # one for all chunks
    run = simulate_batch(
        campaign.model, pressures, parameters=everything or {"tip_mass": np.full(count, campaign.model.tip_mass)},
        times=times, step=step, variables=("tip_position",), threads=campaign.threads, failures="mark",
    )
    tip = run["tip_position"].values[:, :, -1]
    moved = np.linalg.norm(tip - tip[:, :1], axis=-1)
    return {
        **{f"parameter_{k}": v for k, v in varied.items()}, "tip": tip, "final_tip": tip[:, -1],
        "largest_deflection": moved.max(axis=1), "failed": np.isfinite(run["failed_at"].values),
    }


def refitted(campaign: Campaign, sample: int, experiments: Sequence[Experiment], start: Sequence[Parameter]) -> Arrays:
    """Values of the free parameters after one fit; not a number where it could not be made."""
    free = [p.name for p in start if p.free]
    options = {**(campaign.fit_options or {}), "starts": 1, "rng": generator(campaign.sweep.seed, sample)}
    try:
        found = fit(experiments, campaign.model, start, **options)
    except PliantError:
        nothing = np.array(np.nan)
        return {**{f"parameter_{n}": nothing for n in free}, "rmse": nothing, "failed": np.array(True)}
    values = {f"parameter_{n}": np.array(found.values[n]) for n in free}
    rmse = np.array(float(np.sqrt(np.mean(np.square(list(found.rmse.values()))))))
    return {**values, "rmse": rmse, "failed": np.array(not found.converged)}


def stacked(rows: Sequence[Arrays]) -> Arrays:
    """The samples' arrays as arrays with the samples first."""
    return {name: np.stack([row[name] for row in rows]) for name in rows[0]}


def bootstrap(campaign: Campaign, first: int, last: int) -> Arrays:
    """Fits to the base fit's own prediction with its residuals moved in blocks, which keep their correlation."""
    base = campaign.base
    if base is None:
        raise ValueError("a bootstrap needs the fit whose residuals it moves")
    values = base.values
    start = list(base.parameters)
    step = float((campaign.fit_options or {}).get("step", 2e-3))
    modelled = [predict(base.model, exp, values, step)["compared"] for exp in campaign.experiments]
    rows = []
    for sample in range(first, last):
        rng = generator(campaign.sweep.seed, sample)
        again = [
            with_drawn(exp, redrawn(exp, motion, frames_in(exp, campaign.sweep.block), rng))
            for exp, motion in zip(campaign.experiments, modelled, strict=True)
        ]
        rows.append(refitted(campaign, sample, again, start))
    return stacked(rows)


def frames_in(exp: Experiment, seconds: float) -> int:
    """Frames of a block of some seconds, at least one and at most all of a recording."""
    return int(np.clip(round(seconds / np.median(np.diff(exp.time))), 1, exp.time.size))


def multi_start(campaign: Campaign, first: int, last: int) -> Arrays:
    """Fits from scattered starts, as a fit scatters its own: do they end in one place?"""
    rows = []
    for sample in range(first, last):
        rng = generator(campaign.sweep.seed, sample)
        rows.append(refitted(campaign, sample, campaign.experiments, scattered_start(campaign.parameters, rng)))
    return stacked(rows)
