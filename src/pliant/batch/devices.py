"""Batches on other devices than the processor, in the JAX module of the models.

An exporter makes the module. As for plug-ins, it is named here and loaded where a device is asked for, because batches
come before exporters.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any

import numpy as np

from pliant.batch.one_by_one import motion_of
from pliant.batch.samples import initial_values
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.simulation import state
from pliant.simulation.drive import Drive, drive
from pliant.simulation.inputs import Input
from pliant.simulation.solve import check_step

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
