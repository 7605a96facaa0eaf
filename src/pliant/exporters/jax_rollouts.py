"""Batches of `pliant.batch.simulate_batch` in the exported JAX module, on a GPU or on whatever device JAX uses.

Time steps and mean torques of the inputs are those of a batch on the processor; the bodies are advanced in JAX, in
double precision. The results are equal to rounding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from pliant.errors import InputError
from pliant.exporters.jax_batch import accelerator, jax_module, module_of, stacked_parameters
from pliant.mechanics import mechanics_of
from pliant.model import Model, Valve
from pliant.simulation import state
from pliant.simulation.drive import Drive

Array = np.ndarray
NUMBERS = 2**25  # of the inputs of one block of samples: 256 MiB


def device_of(name: str) -> Any:
    """Return the JAX device of the batch device "gpu" or "jax"; raise InputError if there is none."""
    jax = jax_module()
    if name == "jax":
        return jax.devices()[0]
    if (device := accelerator()) is None:
        raise InputError("device 'gpu' needs a GPU that JAX finds, and it finds none: install jax with support for the "
                         "GPU, or use device='cpu'")  # fmt: skip
    return device


def roll_out(
    device: Any, models: Sequence[Model], plans: Sequence[Drive], starts: Array, rows: int,
) -> tuple[Array, Array, Array]:
    """Simulate N samples on a JAX device.

    Parameters
    ----------
    device : JAX device
    models : sequence of Model
        One for each sample. Their valves are not used: they are part of the torques in `plans`.
    plans : sequence of Drive
        Time steps and mean torques of each sample.
    starts : array (N, 2, K)
        Coordinates and rates of each sample at the first time.
    rows : int
        Number of output times T.

    Returns
    -------
    x, v : arrays (N, T, K)
        Coordinates and rates at the output times.
    failed : array (N,)
        Index of the first step that fails, -1 where none does.
    """
    jax = jax_module()
    different, body = distinct(models)
    bodies = [m.with_(chambers=tuple(replace(c, valve=Valve()) for c in m.chambers)) for m in different]
    module = module_of(bodies)
    pool, memory = stacked_parameters(bodies), memories(models, starts)
    h, torque, index = padded_steps(plans, rows)
    block = max(1, min(len(models), NUMBERS // (h[0].size * (torque.shape[-1] + 1))))
    out: list[tuple[Array, Array, Array]] = []
    with jax.enable_x64(True), jax.default_device(device):
        run = jax.jit(jax.vmap(partial(rolled, jax, module)))
        for first in range(0, len(models), block):
            part = np.minimum(np.arange(first, first + block), len(models) - 1)  # one shape is compiled once
            parameters = {name: values[body[part]] for name, values in pool.items()}
            arguments = (starts[part, 0], starts[part, 1], memory[part], h[part], torque[part])
            x, v, last = (np.asarray(a) for a in run(parameters, *arguments))
            out.append((x, v, np.where(last < 0, -1, index[part, last])))
    return tuple(np.concatenate(column)[: len(models)] for column in zip(*out, strict=True))  # type: ignore[return-value]


def distinct(models: Sequence[Model]) -> tuple[list[Model], Array]:
    """Return the distinct objects among N models, and the index (N,) of each model among them."""
    known = {id(model): model for model in models}
    order = {key: k for k, key in enumerate(known)}
    return list(known.values()), np.array([order[id(model)] for model in models])


def memories(models: Sequence[Model], starts: Array) -> Array:
    """Return the hysteresis states (N, coordinates, branches) of N samples, in equilibrium at their start."""
    return np.stack([
        state.relaxed_as_stored(m, mechanics_of(m).joint_coordinates(x))
        for m, x in zip(models, starts[:, 0], strict=True)
    ])  # fmt: skip


def padded_steps(plans: Sequence[Drive], rows: int) -> tuple[Array, Array, Array]:
    """Return lengths (N, T - 1, m) [s] and torques (N, T - 1, m, C) [N m] of the time steps between T output times of N
    samples, at most m between two of them, and the indices (N, (T - 1) m) of these steps in their plans.

    Missing steps have the length 0.
    """
    ends = [np.flatnonzero(plan.keep >= 0) for plan in plans]
    counts = np.array([np.diff(end, prepend=-1) for end in ends])
    most = int(counts.max())
    h = np.zeros((len(plans), (rows - 1) * most))
    torque, index = np.zeros((*h.shape, plans[0].torque.shape[1])), np.zeros(h.shape, dtype=int)
    for i, (plan, count) in enumerate(zip(plans, counts, strict=True)):
        begin = np.cumsum(count) - count
        at = np.arange(plan.h.size) + np.repeat(most * np.arange(rows - 1) - begin, count)
        h[i, at], torque[i, at], index[i, at] = plan.h, plan.torque, np.arange(plan.h.size)
    shape = len(plans), rows - 1, most
    return h.reshape(shape), torque.reshape((*shape, -1)), index


def rolled(
    jax: Any, module: Any, parameters: Any, x: Any, v: Any, memory: Any, h: Any, torque: Any,
) -> tuple[Any, Any, Any]:
    """Return coordinates and rates (T, K) of one body at the output times, and the number of the padded step that fails
    first, -1 if none does. A body that fails stays where it is.
    """
    jnp, c = jax.numpy, module.constants(module.arrays(parameters))

    def one(now: Any, given: Any) -> tuple[Any, None]:
        x, v, memory, k, failed = now
        h, torque = given
        change, after, solved = module.solved_step(c, module.begin(c, x, v, torque @ c["joint_gain"], h), memory)
        moved = x + h * (v + 0.5 * change), v + change
        takes, good = (h > 0.0) & (failed < 0), solved & module.holds(c, *moved, h)
        failed = jnp.where(takes & ~good, k, failed)
        x, v, memory = (jnp.where(takes & good, new, old)
                        for new, old in zip((*moved, after), (x, v, memory), strict=True))  # fmt: skip
        return (x, v, memory, k + 1, failed), None

    def row(now: Any, given: Any) -> tuple[Any, Any]:
        now = jax.lax.scan(one, now, given)[0]
        return now, now[:2]

    first = (x, v, memory, jnp.array(0), jnp.array(-1))
    last, (xs, vs) = jax.lax.scan(row, first, (h, torque))
    return jnp.concatenate([x[None], xs]), jnp.concatenate([v[None], vs]), last[-1]
