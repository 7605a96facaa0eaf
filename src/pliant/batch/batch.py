"""The function `simulate_batch`: simulation of many parameter sets, pressures or initial states on all cores."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib import import_module
from typing import Any, TypedDict, Unpack

import numpy as np
import xarray as xr

from pliant.batch.one_by_one import VARIABLES, dimensions, expanded, motion_of, run_alone, samples_alone, sets_of
from pliant.batch.samples import Samples, gather, initial_values, stored
from pliant.batch.simd import Schedule, run_lanes
from pliant.batch.space_lanes import fits_lanes, run_in_space
from pliant.errors import InputError, SimulationError
from pliant.identification.names import find_path
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.options import with_defaults
from pliant.parallel import cores
from pliant.shapes import Float
from pliant.simulation import state
from pliant.simulation.drive import Drive, drive, inputs_of
from pliant.simulation.inputs import Input
from pliant.simulation.result import LABELS
from pliant.simulation.solve import STEPS_PER_PERIOD, check_step, output_times
from pliant.simulation.time_step import shared_step
from pliant.version import __version__

Array = np.ndarray
MODULE = "pliant.exporters.jax_rollouts"
DEVICES = {"gpu": "a GPU, in JAX", "jax": "the device that JAX uses"}


def backend() -> Any:
    """Return the module that simulates batches in JAX."""
    return import_module(MODULE)


def run_on_device(
    models: Sequence[Model], pressures: Sequence[Sequence[Input]], times: Array, time_step: float,
    how: Mapping[str, Any], variables: Sequence[str],
) -> dict[str, Array]:
    """Simulate N samples on the device how["device"] of `DEVICES`. Return arrays (N, T, ...) over T output times by
    variable name and, as "failed_at" (N,) [s], the time at which each sample failed, NaN if it did not.
    """
    jax_rollouts = backend()
    device = jax_rollouts.device_of(how["device"])
    for model in {id(m): m for m in models}.values():
        check_step(model, time_step, "midpoint")
    plans = [drive(m, p, times, time_step) for m, p in zip(models, pressures, strict=True)]
    starts = starting_states(models, plans, how)
    roll_out: Callable[..., tuple[Array, Array, Array]] = jax_rollouts.roll_out
    x, v, failed = roll_out(device, models, plans, starts, times.size)
    results = {name: np.stack([motion_of(m, *rows)[name] for m, *rows in zip(models, x, v, strict=True)])
               for name in variables}  # fmt: skip
    ends = [np.nan if k < 0 else times[0] + plan.h[: k + 1].sum() for k, plan in zip(failed, plans, strict=True)]
    return {**results, "failed_at": np.array(ends)}


def starting_states(models: Sequence[Model], plans: Sequence[Drive], how: Mapping[str, Any]) -> Array:
    """Return the coordinates and rates (N, 2, K) of N samples at the first time."""
    size, K = len(models), models[0].size
    angle, rate = (None if how[k] is None else initial_values(how[k], size, K) for k in
                   ("initial_angle", "initial_rate"))  # fmt: skip
    rows, known = [], {}
    for i, (model, plan) in enumerate(zip(models, plans, strict=True)):
        key = id(model), plan.initial.tobytes()
        if angle is None and key not in known:
            known[key] = state.equilibrium(model, plan.initial)
        chain, q = mechanics_of(model), known[key] if angle is None else angle[i]
        rows.append(np.stack([chain.coordinates(q), chain.rates(np.zeros(K) if rate is None else rate[i])]))
    return np.stack(rows)


class BatchOptions(TypedDict, total=False):
    """Keyword options of `simulate_batch`: initial state, threads, device, and what to do if a sample fails."""

    initial_angle: Array | None
    initial_rate: Array | None
    threads: int | None
    device: str
    failures: str


BATCH_OPTIONS: BatchOptions = {
    "initial_angle": None, "initial_rate": None, "threads": None, "device": "cpu", "failures": "raise",
}


def simulate_batch(
    models: Model | Sequence[Model],
    pressures: Input | Sequence[Input] | Sequence[Sequence[Input]],
    *,
    parameters: Mapping[str, Any] | None = None,
    duration: float | None = None,
    times: Float[Array, " T"] | None = None,
    time_step: float | None = None,
    variables: Sequence[str] = ("joint_angle", "tip_position"),
    **options: Unpack[BatchOptions],
) -> xr.Dataset:
    """Simulate many chains with the same number of links at once. Each sample's motion is that of `simulate`.

    Planar chains with one chamber and chains in space with up to 24 coordinates, without hysteresis or tendons, are
    simulated in SIMD vectors, others one by one on all cores.

    Parameters
    ----------
    models : Model or sequence of Model
        One model for all samples, or one for each.
    pressures : input or sequence of inputs
        Gauge pressure, Pa: one input for all samples, or one for each. For models of several chambers: an input for
        each chamber, or such a set for each sample. Such models, extensible ones and models in space only accept
        parameter names as in a fit.
    parameters : mapping of arrays (N,) or (N, n)
        Parameter values for one model, by names as in a fit (``stiffness``, ``damping_2``, ``torque_1``, ``mass``,
        ``creep_share_1``, ...) or by fields of `Model`; an array (N, n) gives a value for every link.
    duration, times
        Duration, or output times (T,) of all samples, s, as in `simulate`.
    time_step : float, optional
        Longest time step, s. Default: the shortest that `pliant.simulation.time_step.resolving_step` returns for the
        models, at most 1 ms, without regard to `parameters`. A batch has no error estimate: check a few samples by
        `simulate`.
    initial_angle, initial_rate : array (n,) or (N, n)
        Initial joint angles [rad] and rates [rad/s], as in `simulate`; default: equilibrium at the initial pressure.
    variables : sequence of {"joint_angle", "joint_rate", "tip_position", "axial_strain", "axial_strain_rate"}
        Variables to keep; a thousand samples at every millisecond fill gigabytes. In space ``joint_angle`` stands for
        ``joint_angle_x``, ``joint_angle_y`` and, with twist, ``joint_angle_twist``; likewise ``joint_rate``.
    threads : int
        Number of threads; default: one for each core that this process may use. The result does not depend on it.
    device : {"cpu", "gpu", "jax"}, default "cpu"
        With "gpu", the samples are simulated on a GPU by the JAX module of the models (``pliant export --to jax``), in
        double precision; refused where JAX finds no GPU. With "jax", on whatever device JAX uses. Their results differ
        from those of "cpu" by rounding.
    failures : {"raise", "mark"}, default "raise"
        If a step of a sample fails: raise an error, or set that sample to NaN and give the time in ``failed_at``.

    Returns
    -------
    xarray.Dataset
        ``joint_angle`` and ``joint_rate`` (sample, time, joint) [rad, rad/s], ``tip_position`` (sample, time, link,
        axis) [m], strains (sample, time, segment), as in `variables`; ``failed_at`` (sample) [s], NaN for good samples.

    Raises
    ------
    InputError
        When numbers of samples differ, or times, time_step, variables or device are not valid.
    SimulationError
        When a sample fails and `failures` is "raise".
    TypeError
        For an unknown keyword.

    Examples
    --------
    >>> import pliant
    >>> from pliant.batch import simulate_batch
    >>> from pliant.actuators import chen2018
    >>> pulse = pliant.Pulse(level=50e3, start=0.1, width=1.0)
    >>> simulate_batch([chen2018.model()] * 8, pulse, duration=0.2).sizes["sample"]
    8
    """
    how = with_defaults(simulate_batch, options, BATCH_OPTIONS)
    device, failures = how["device"], how["failures"]
    times = output_times(duration, times, time_step)
    time_step = shared_step((models,) if isinstance(models, Model) else models) if time_step is None else time_step
    sets = sets_of(models, pressures)
    if taken_alone(models, parameters or ()) or device != "cpu":
        many_models, sets = samples_of(models, sets, parameters)
        variables = expanded(variables, dimensions(many_models[0]))
        check_choices(variables, device, failures, dimensions(many_models[0]))
        how = {**how, "threads": how["threads"] or cores()}
        results = simulated(many_models, sets, times, time_step, how, variables)
        return labelled(many_models[0], times, results, failures, {"step_s": time_step})
    samples = gather(models, parameters, len(sets))
    many = tuple(inputs_of(samples.template, inputs)[0] for inputs in sets)
    if len(many) not in (1, samples.size):
        raise InputError(f"{samples.size} samples need one pressure, or one for each sample, got {len(many)}")
    check_choices(variables, device, failures)
    check_steps(samples, time_step)
    schedule = Schedule(samples, many, times, time_step)
    start = initial_state(samples, schedule, how["initial_angle"], how["initial_rate"])
    results = run_lanes(samples, schedule, start, variables, how["threads"] or cores())
    return labelled(samples.template, times, results, failures, {"step_s": time_step})


def simulated(
    models: Sequence[Model], sets: Sequence[Sequence[Input]], times: Array, time_step: float, how: Mapping[str, Any],
    variables: Sequence[str],
) -> dict[str, Array]:
    """Simulate N samples with inputs of their own, in SIMD vectors, one by one or on another device.

    Return arrays (N, T, ...) over T output times by variable name and "failed_at" (N,) [s].
    """
    if how["device"] != "cpu":
        return run_on_device(models, sets, times, time_step, how, variables)
    each = {id(model): model for model in models}.values()
    if all(map(fits_lanes, each)) and len({(mechanics_of(m).sizes, m.actuation.count) for m in each}) == 1:
        return run_in_space(models, sets, times, time_step, how, {k: shape_of(models[0], k) for k in variables})
    results = run_alone(models, sets, times, time_step, how)
    return {k: results[k] for k in (*variables, "failed_at")}


def shape_of(model: Model, variable: str) -> tuple[int, ...]:
    """Return the shape of a result variable at one time."""
    nothing = motion_of(model, *np.zeros((2, 1, model.size)))
    return nothing[variable].shape[1:]


def one_by_one(models: Model | Sequence[Model]) -> bool:
    """Return whether samples must be simulated one by one and not in SIMD vectors, because a model has several inputs,
    a torque law that is no polynomial, or extensible segments, or is in space.
    """
    many = (models,) if isinstance(models, Model) else models
    plain = (m.actuation.count == 1 and m.actuation.polynomial and m.space is None for m in many)
    return not all(plain) or any(mechanics_of(m).lengthens for m in many)


def taken_alone(models: Model | Sequence[Model], names: Iterable[str]) -> bool:
    """Return whether the samples of a batch are models of their own: because of the models, or because one of the
    parameters `names` is one of a fit but has no array in `Samples`.
    """
    return one_by_one(models) or any(find_path(name) and not stored(name) for name in names)


def samples_of(
    models: Model | Sequence[Model], sets: list[Sequence[Input]], parameters: Mapping[str, Any] | None,
) -> tuple[list[Model], list[Sequence[Input]]]:
    """Return model and inputs of each sample, from the arguments of `simulate_batch`."""
    if taken_alone(models, parameters or ()):
        return samples_alone(models, sets, parameters)
    samples = gather(models, parameters, len(sets))
    every = [samples.model(i) for i in range(samples.size)] if parameters else [samples.template] * samples.size
    return samples_alone(every if isinstance(models, Model) else models, sets, None)


def check_choices(variables: Sequence[str], device: str, failures: str, known: Mapping[str, Any] = VARIABLES) -> None:
    """Raise InputError for unknown variables, an unknown device, or an unknown treatment of failures."""
    if unknown := [v for v in variables if v not in known]:
        raise InputError(f"unknown variable {unknown[0]!r}: a batch of these models can keep {', '.join(known)}")
    if failures not in ("raise", "mark"):
        raise InputError(f"failures must be 'raise' or 'mark', got {failures!r}")
    if device not in ("cpu", *DEVICES):
        raise InputError(f"device must be one of cpu, {', '.join(DEVICES)}, got {device!r}")


def check_steps(samples: Samples, time_step: float) -> None:
    """Raise InputError if the time step [s] is too long for the first mode of vibration of any sample."""
    if not (np.isfinite(time_step) and time_step > 0):
        raise InputError(f"time_step must be a positive time in seconds, got {time_step}")
    if time_step * STEPS_PER_PERIOD * samples.highest_first_frequency() <= 1.0:
        return
    first = samples.first_frequency()
    long = np.flatnonzero(time_step * STEPS_PER_PERIOD * first > 1.0)
    if long.size:
        worst = float(first.max())
        raise InputError(
            f"a step of {time_step * 1e3:.3g} ms is too long for {long.size} of {samples.size} samples: the first mode "
            f"of sample {first.argmax()} rings at {worst:.3g} Hz; use a step of "
            f"{1e3 / (STEPS_PER_PERIOD * worst):.3g} ms or less"
        )


def initial_state(samples: Samples, schedule: Schedule, angle: Array | None, rate: Array | None) -> Array:
    """Return the initial absolute angles [rad] and rates [rad/s] of the n links of N samples as one array (2, n, N)."""
    n, size = samples.template.n, samples.size

    if angle is None:
        before = np.array([schedule.initial(i) for i in range(1 if schedule.alike else size)])
        q = samples.rest(np.broadcast_to(before, (size,)))
    else:
        q = initial_values(angle, size, n).T
    dq = np.zeros((n, size)) if rate is None else initial_values(rate, size, n).T
    return np.stack([samples.absolute(q), np.cumsum(dq, axis=0)])


def labelled(
    model: Model, times: Array, results: dict[str, Array], failures: str, attributes: dict[str, Any],
) -> xr.Dataset:
    """Return the results of a batch as a dataset.
    A failed sample raises SimulationError or, if so chosen, becomes NaN.
    """
    failed_at = results.pop("failed_at")
    bad = np.flatnonzero(np.isfinite(failed_at))
    if bad.size and failures == "raise":
        raise SimulationError(
            f"{bad.size} of {failed_at.size} samples fail, sample {bad[0]} at {failed_at[bad[0]]:.6g} s: either "
            "a link turns by more than a radian within a step, or a softening spring loses its stiffness, or the "
            "tensions of tendons do not converge; use a shorter step, a smaller pressure, or failures='mark'"
        )
    for a in results.values():
        a[bad] = np.nan
    dims, chain = dimensions(model), mechanics_of(model)
    entries = {k: (dims[k], a, {"units": LABELS[k][0], "long_name": LABELS[k][1]}) for k, a in results.items()}
    failed = {"units": "s", "long_name": "time at which the sample's step failed, NaN where none did"}
    return xr.Dataset(
        {**entries, "failed_at": (("sample",), failed_at, failed)},
        coords={"sample": np.arange(failed_at.size), "time": ("time", times, {"units": "s", "long_name": "time"}),
                **chain.labels, "link": np.arange(1, model.n + 1), "axis": list("xyz"[: chain.dimension])},
        attrs={"schema": "pliant-batch", "model": model.name, "failed_samples": int(bad.size),
               "source": f"pliant {__version__}", **attributes},
    )
