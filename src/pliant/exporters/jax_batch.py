"""Many bodies at once in the exported JAX module, on the device that JAX uses.

The bodies have one structure and parameters of their own, which are a batch of `exported_parameters`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from types import ModuleType
from typing import Any

import numpy as np

from pliant.errors import InputError
from pliant.exporters.jax_module import CAN, code, exported_parameters, structure
from pliant.exporters.provenance import Provenance
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.model.features import Consumer
from pliant.simulation import state

Array = np.ndarray
JAX_BATCH = Consumer("a batch in JAX", CAN)
OWN = ("START",)  # constants of a structure that bodies of one batch need not share: where a search begins


def jax_module() -> Any:
    """Return the module jax; raise InputError if it is not installed."""
    try:
        import jax
    except ImportError:
        raise InputError("JAX is not installed: pip install 'pliant[jax]'") from None
    return jax


def accelerator() -> Any:
    """Return the first GPU that JAX finds, or None if there is no JAX or no GPU."""
    try:
        devices = jax_module().devices()
    except (InputError, RuntimeError):
        return None
    return next((device for device in devices if device.platform != "cpu"), None)


def module_of(models: Sequence[Model]) -> ModuleType:
    """Return the exported JAX module of the first of several models, loaded.

    Raises
    ------
    InputError
        When the models differ in structure, or have a feature that the module does not express.
    """
    for model in models:
        JAX_BATCH.check(model)
    first, *others = ({k: v for k, v in structure(m).items() if k not in OWN} for m in models)
    for other in others:
        if unlike := [name for name in first if first[name] != other[name]]:
            raise InputError("the models of a batch in JAX must share their structure, and differ in "
                             f"{', '.join(unlike)}: simulate others in a separate batch")  # fmt: skip
    module = ModuleType("pliant_exported_arm")
    text = code(models[0], Provenance(models[0], "jax", "a batch"))
    exec(compile(text, "<exported JAX module>", "exec"), module.__dict__)  # noqa: S102  text of this package
    return module


def stacked_parameters(models: Sequence[Model]) -> dict[str, Array]:
    """Return the parameters of P models by name, as arrays (P, ...); torque laws are padded to one length."""
    rows = [exported_parameters(m) for m in models]
    longest = max(row["torque"].shape[1] for row in rows)
    for row in rows:
        row["torque"] = np.pad(row["torque"], ((0, 0), (0, longest - row["torque"].shape[1])))
    return {name: np.stack([row[name] for row in rows]) for name in rows[0]}


def rest_states(models: Sequence[Model]) -> list[Array]:
    """Return the entries of `BodyState` of P models at rest without input, each with the models along its first axis.

    Computed here: compiling the search of the module's own `rest` takes longer than many episodes.
    """
    rows = []
    for model in models:
        none = np.zeros(model.actuation.count)
        q = state.equilibrium(model, none)
        memory = state.relaxed_as_stored(model, q)
        x = mechanics_of(model).coordinates(q)
        rows.append((x, 0.0 * x, memory, none, model.actuation.rest_state(none), np.zeros(())))
    return [np.stack(column) for column in zip(*rows, strict=True)]


class JaxBodies:
    """Step-by-step simulator of `size` bodies in JAX, in double precision. Its methods are those of
    `pliant.batch.stepper.BatchStepper`.

    Parameters
    ----------
    models : sequence of Model
        The bodies that a chain may be; all chains start as the first.
    size : int
        Number of chains.
    time_step : float
        Time step [s].
    """

    def __init__(self, models: Sequence[Model], size: int, time_step: float) -> None:
        self.size, self._jax = size, jax_module()
        self._module = module_of(models)
        with self._jax.enable_x64(True):
            tree = self._jax.tree_util.tree_map
            self._pool = tree(self._jax.numpy.asarray, stacked_parameters(models))
            self._rests = tree(self._jax.numpy.asarray, self._module.BodyState(*rest_states(models)))
            hold = partial(held, self._jax, self._module, time_step)
            self._hold = self._jax.jit(self._jax.vmap(hold, in_axes=(0, 0, 0, None)))
            self._begin = self._jax.jit(lambda parts, rests, which, bodies: tree(
                lambda part, rest: part.at[which].set(rest[bodies]), parts, rests))  # fmt: skip
            first = np.zeros(size, dtype=int)
            self._parameters, self._state = (tree(lambda a: a[first], part) for part in (self._pool, self._rests))

    @property
    def position(self) -> Array:
        """Return the coordinates (size, N) of the chains: angles [rad], then strains."""
        return np.asarray(self._state.position)

    @property
    def velocity(self) -> Array:
        """Return the rates (size, N) of the coordinates."""
        return np.asarray(self._state.velocity)

    def reset(self, which: Array, bodies: Array) -> None:
        """Restart M of the chains at rest without input. The chain with index which[k] becomes the model with index
        bodies[k], for k from 0 to M - 1.
        """
        absent = self.size - len(which)  # arrays of one length are compiled once; indices out of range have no effect
        chosen, bodies = np.append(which, np.full(absent, self.size)), np.append(bodies, np.zeros(absent, dtype=int))
        with self._jax.enable_x64(True):
            parts, rests = (self._parameters, self._state), (self._pool, self._rests)
            self._parameters, self._state = self._begin(parts, rests, chosen, bodies)

    def hold(self, pressure: Array, steps: int) -> Array:
        """Advance all chains by `steps` time steps under constant inputs (size, C). Return for each chain whether it
        failed, as booleans (size,).
        """
        before = np.asarray(self._state.failed)
        with self._jax.enable_x64(True):
            self._state = self._hold(self._parameters, self._state, np.asarray(pressure, dtype=float), steps)
        return np.asarray(self._state.failed) > before


def held(jax: Any, module: Any, time_step: float, parameters: Any, first: Any, command: Any, steps: Any) -> Any:
    """Return the state of one body after a number of `steps` of `time_step` [s] under constant inputs (C,)."""
    constants = module.constants(module.arrays(parameters))
    return jax.lax.fori_loop(0, steps, lambda _, now: module.advance(constants, now, command, time_step), first)
