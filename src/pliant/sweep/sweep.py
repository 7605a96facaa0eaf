"""The function `run_sweep`, which runs a parameter sweep in a folder and continues it there after an interruption."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict, Unpack

import numpy as np
import xarray as xr

from pliant.errors import InputError
from pliant.identification import Experiment, Parameter, fit
from pliant.model import Model
from pliant.model.file import model_to_dict
from pliant.options import with_defaults
from pliant.sweep.scheduler import Account, Count, Notify, executor_of, run_chunks
from pliant.sweep.spec import PULSE, Sweep, sweep_from
from pliant.sweep.store import Store, write_dataset
from pliant.sweep.tasks import SweepTask
from pliant.version import __version__

QUANTILES = (0.025, 0.5, 0.975)
UNITS = {"tip": "m", "final_tip": "m", "largest_deflection": "m", "rmse": "m", "failed": "1",
         "parameter_start": "s", "parameter_width": "s"}


@dataclass(frozen=True)
class SweepResult:
    """Result of a sweep: dataset of all samples, counts of chunks, and the folder that holds them."""

    samples: xr.Dataset
    account: Account
    folder: Path

    def summary(self) -> dict[str, Any]:
        """Return the counts of chunks, and for every variable with one number per sample its median, 95 % interval and
        unit.
        """
        bad = self.samples["failed"].values.astype(bool)
        numbers = {}
        for name, a in self.samples.data_vars.items():
            if a.dims == ("sample",) and name != "failed":
                good = a.values[~bad & np.isfinite(a.values)]
                quantiles = np.quantile(good, QUANTILES).tolist() if good.size else None
                quantile_row = dict(zip(("low", "median", "high"), quantiles, strict=True)) if quantiles else None
                numbers[str(name)] = {**quantile_row, "unit": a.attrs["units"]} if quantile_row else None
        return {
            "samples": int(self.samples.sizes["sample"]), "failed_samples": int(bad.sum()), "numbers": numbers,
            "message": self.account.sentence(), "chunks": self.account.chunks, "computed": self.account.made,
            "found": self.account.found, "restarts": self.account.restarts, "repeated": self.account.repeated,
        }


class Workers(TypedDict, total=False):
    """Keyword options of `run_sweep` that select processes, a cluster or a device; documented there."""

    scheduler: str
    workers: int | None
    make_executor: Callable[[], Any] | None
    count: Count | None
    device: str


WORKERS: Workers = {"scheduler": "local", "workers": None, "make_executor": None, "count": None, "device": "cpu"}


def run_sweep(
    sweep: Sweep | Mapping[str, Any],
    model: Model,
    folder: str | Path,
    *,
    experiments: Sequence[Experiment] = (),
    parameters: Sequence[Parameter] = (),
    fit_options: dict[str, Any] | None = None,
    progress: Notify | None = None,
    **who: Unpack[Workers],
) -> SweepResult:
    """Run a parameter sweep (design, Monte Carlo, bootstrap or multi-start fit), or continue an interrupted one.

    Parameters
    ----------
    sweep : mapping or Sweep
        The ``[sweep]`` table of a study file, SI: ``kind`` (design, monte_carlo, bootstrap, multi_start), ``samples``,
        ``seed``, ``chunk`` (samples computed together), ``parameters``, ``duration`` [s], ``rate`` [Hz] of the output,
        ``time_step`` [s]. Parameters are those of the model, and ``level`` [Pa], ``start`` and ``width`` [s] of the
        pulse. ``NAME.level`` is that of one of several chambers, which otherwise stay at 0. Each is a number, or a
        table of ``values``; of ``low``, ``high`` and ``count``; of ``low`` and ``high``; or of ``mean`` and ``std``.
    model : Model
    folder : str or Path
        Folder for sweep.json, chunks/ and, at the end, samples.nc. An interrupted sweep continues from there.
    scheduler : str
        ``local`` (the default), ``processes``, or ``tcp://host:port`` of a Dask scheduler. The result is the same,
        bit for bit.
    workers : int
        Number of processes for ``processes``; default: one for each core.
    experiments, parameters, fit_options
        For bootstrap and multi_start: arguments of `pliant.fit`.
    progress : callable
        Called with one line of text for each failure of a worker and, without `count`, for each chunk.
    count : callable
        Called with the fraction of finished chunks, 0 to 1.
    make_executor : callable
        Function that returns any other concurrent.futures executor, in place of `scheduler`.
    device : str
        Device of the simulations, as of `simulate_batch`; other than ``cpu``, with the scheduler ``local`` only.

    Returns
    -------
    SweepResult
        ``samples`` holds, for simulations, ``tip`` (sample, time, axis) [m], ``final_tip`` (sample, axis) [m] and
        ``largest_deflection`` (sample) [m]; for fits, ``rmse`` (sample) [m]; for all, ``parameter_NAME`` (sample), SI,
        and ``failed`` (sample).

    Raises
    ------
    InputError
        When the sweep does not fit the model, or the folder holds another sweep.
    PliantError
        When the disk is full or workers fail repeatedly; written chunks are kept, and the sweep can be continued.
    TypeError
        For an unknown keyword.
    """
    hired = with_defaults(run_sweep, who, WORKERS)
    sweep = sweep if isinstance(sweep, Sweep) else sweep_from(dict(sweep))
    check_parameters(sweep, model, experiments)
    maker = hired["make_executor"] or executor_of(hired["scheduler"], hired["workers"])
    check_device(hired["device"], sweep, local=maker is None)
    options = dict(fit_options or {})
    identity = {
        "sweep": sweep.model_dump(mode="json"), "model": model_to_dict(model), "pliant": __version__,
        "experiments": [(e.name, float(np.nansum(e.compared)), e.time.size) for e in experiments],
        "parameters": [repr(p) for p in parameters], "fit": {k: repr(v) for k, v in sorted(options.items())},
    }
    store = Store(Path(folder), identity)
    base = None
    if sweep.kind == "bootstrap":
        base = fit(experiments, model, parameters, **{**options, "rng": sweep.seed})
    threads = None if maker is None else 1
    task = SweepTask(sweep, model, tuple(experiments), tuple(parameters), options, base, threads, hired["device"])
    account = run_chunks(task, store, maker, progress or (lambda _line: None), hired["count"])
    samples = store.combine(task.bounds)
    for name, dims in (("tip", ("time", "axis")), ("final_tip", ("axis",))):
        if name in samples:
            samples[name] = (("sample", *dims), samples[name].values)
    if "tip" in samples:
        clock, axes = np.arange(samples.sizes["time"]) / sweep.rate, list("xyz"[: samples.sizes["axis"]])
        samples = samples.assign_coords(time=clock, axis=axes)
    for variable, a in samples.data_vars.items():
        a.attrs["units"] = unit_of(str(variable), model)
    result = SweepResult(samples, account, Path(folder))
    write_dataset(samples, Path(folder) / "samples.nc")
    store.note({"identity": identity, **result.summary()})
    return result


def check_device(device: str, sweep: Sweep, *, local: bool) -> None:
    """Raise InputError for an unknown device, one that is absent, or one on which a sweep cannot run."""
    from pliant.batch.batch import DEVICES, backend

    if device == "cpu":
        return
    if device not in DEVICES:
        raise InputError(f"device must be one of cpu, {', '.join(DEVICES)}, got {device!r}")
    if sweep.kind in ("bootstrap", "multi_start"):
        raise InputError(f"a {sweep.kind} sweep repeats fits, which run on the processor: leave out device")
    if not local:
        raise InputError(f"device {device!r} is for one process: use the scheduler local")
    backend().device_of(device)


def unit_of(name: str, model: Model) -> str:
    """Return the unit of a result variable of a sweep of a model, such as "Pa"; "1" if unknown."""
    from pliant.identification.parameters import kind_of

    parameter = name.removeprefix("parameter_")
    owner, _, what = parameter.rpartition(".")
    if what == "level" and parameter != name:
        return dict(zip(model.actuation.names, model.actuation.units, strict=True)).get(owner, model.actuation.units[0])
    try:
        return UNITS.get(name) or UNITS.get(f"parameter_{what}") or kind_of(parameter).unit
    except InputError:
        return "1"


def check_parameters(sweep: Sweep, model: Model, experiments: Sequence[Experiment]) -> None:
    """Raise InputError, before any computation starts, if a sweep has parameters that the model lacks."""
    from pliant.batch.batch import taken_alone
    from pliant.batch.one_by_one import check_names
    from pliant.batch.samples import repeated

    if sweep.kind in ("bootstrap", "multi_start"):
        if not experiments:
            raise InputError(f"a {sweep.kind} sweep needs the recordings of a fit: give experiments")
        return
    pulses = (*PULSE, *(f"{c.name}.{k}" for c in model.chambers for k in PULSE))
    inputs = model.actuation
    several = "several " + ("chambers" if inputs.variable == "pressure" else "inputs")
    if (inputs.count > 1 or inputs.variable != "pressure") and not any(
        name.endswith("level") for name in pulses if name in sweep.parameters
    ):
        who, which = (several, "the level of at least one") if inputs.count > 1 else ("a tendon", "its level")
        raise InputError(f"a sweep of {who} needs {which}: {inputs.names[0]}.level, in {inputs.units[0]}")
    if "level" in sweep.parameters and len(set(inputs.units)) > 1:
        levels = ", ".join(f"{name}.level [{unit}]" for name, unit in zip(inputs.names, inputs.units, strict=True))
        raise InputError(f"a sweep of {several} with different units has no common level: give some of {levels}")
    for name, r in sweep.parameters.items():
        if name in pulses:
            continue
        some = r.grid() if r.value is None else np.array([r.value])
        values = np.array([r.low if r.mean is None else r.mean]) if some is None else some
        if taken_alone(model, [name]):
            check_names(model, {name: float(values[0])})
        else:
            repeated(model, {name: values}, 1)

